"""A sheet of silicone with holes, and sheets of a printed rubber that tear from notches, predicted
and held against measurements.

python pipelines/experiments.py                   measures all, in some minutes, and draws figures
python pipelines/experiments.py notched-sheets    one of experiments (the holes) and notched-sheets

Holes: Meunier, Chagnon, Favier, Orgeas, Vacher, Polym. Test. 27 (2008) 765. The three tests of the
material are those collected in Chongran-Zhao/Calibration-Hyperelasticity (MIT licence); the 29
stretches along a line of the sheet were read by guanjiashen/hyperelasticity-symbolic-discovery off
Fig. 11 of Zhan et al. 2023.

Notches: V. Slesarenko, "Preliminary experiments", 2019, https://github.com/slslesarenko/jupyterWSM.
The forces were digitized from the figures of that page for this comparison.
"""

import time

import numpy as np
import shapely
from cases import ending_at, of_rows, report, scene_of
from matplotlib.figure import Figure
from pages import FIGURES
from scipy.interpolate import CubicSpline, LinearNDInterpolator, NearestNDInterpolator
from tip_diameters import PAST_PEAK, bonds_a_spacing

import pdsurrogate as pds

DATA = FIGURES.parents[1] / "pipelines" / "data"
TESTS = pds.load_test_data(DATA / "experiment-meunier-2008-tests.csv")
POSITIONS, STRETCHES = np.loadtxt(
    DATA / "experiment-meunier-2008-sheet.csv", delimiter=",", comments="#", skiprows=3
).T
CENTERS = ((-47.5, -21.2), (-14.0, -23.0), (-31.5, -40.5), (-47.5, -59.0), (-14.5, -58.0))
OUTLINE = ((0.0, 0.0), (-62.0, 0.0), (-61.5, -82.5), (0.0, -82.5))
RADIUS, SLIT, THICKNESS, FORCE = 10.0, 1.5, 1.75, 20.0
"""Radius of the holes, width of the slit and thickness in mm, and force in N."""

START, END = np.array([0.0, -22.95]), np.array([-61.852, -24.391])
"""Ends of the line along which the stretches are measured."""

SPACINGS, GRIP = (1.5, 1.0), 68.0
"""Spacings of the points in mm; displacement of the grip in mm, beyond that at the force."""

STROKES, *FORCES = np.genfromtxt(
    DATA / "experiment-slesarenko-2019-notches.csv", delimiter=",", comments="#", skip_header=3
).T
NOTCHED = dict(zip((7.2, 3.6), FORCES, strict=True))
"""Measured forces in N of sheets with two notches, by the length of either in mm, at STROKES in
mm; nan behind the peak.
"""

PEAKS = {7.2: (15.1, 6.58), 3.6: (19.2, 10.14)}
"""Strokes and forces at the peaks of these sheets, digitized like the forces."""

AGAIN = ((18.7, 9.57), (18.1, 9.31), (17.8, 9.17), (18.4, 9.55), (17.7, 9.33), (17.5, 9.26))
"""Strokes and forces at the peaks of six more sheets with notches of 3.6 mm, read off the figure
of the second report.
"""

DEEP, FINE = 2.5, 0.3
"""Of the notched sheets: thickness, and spacing of the points, in mm."""

FITTED = 11.0
"""Stroke in mm up to which the law is fitted to the forces of the sheet with long notches, which
softens beyond it.
"""

BEFORE = 0.9
"""Part of the measured peak up to which forces are compared with those of a sheet whose notches
do not grow.
"""

PULLED = (0.6, 1.5)
"""Strokes between which a tear is simulated, divided by that at the measured peak."""


def holes():
    """The holes; the slit from the first center to the third joins two of them."""
    discs = [shapely.Point(center).buffer(RADIUS, 48) for center in CENTERS]
    slit = shapely.LineString([CENTERS[0], CENTERS[2]]).buffer(SLIT / 2, cap_style="flat")
    outlines = [
        np.array(part.exterior.coords)[:-1] for part in shapely.union_all([*discs, slit]).geoms
    ]
    return tuple(
        pds.shapes.Polygon(vertices=tuple(map(tuple, outline.tolist()))) for outline in outlines
    )


def predicted(name, spacing):
    """Greatest principal stretches at the measured positions at the force, and the displacement of
    the grip then, by an energy or a law that is fitted to the tests.
    """
    fits = {"energy": pds.identification.EnergyRegressor()}
    fits["Ogden's law"] = pds.identification.LawRegressor("ogden")
    law = fits[name].fit(TESTS.stretches, TESTS.nominal_stress, TESTS.balanced_weights()).law_
    scene = pds.Scene(
        name="silicone-sheet",
        spacing=spacing,
        units={"length": "mm", "stress": "MPa", "time": "s"},
        body=pds.shapes.Polygon(vertices=OUTLINE),
        holes=holes(),
        material=law,
        prescribed=(
            pds.Prescribed(region="bottom", x1=0.0, x2=0.0),
            pds.Prescribed(region="top", x1=0.0, x2=GRIP),
        ),
        steps=(pds.Step(to=1.0, outputs=8),),
    )
    begun = time.process_time()
    result = pds.simulate(scene, "bond-energy")
    seconds = time.process_time() - begun
    displacements = np.linspace(0, GRIP, len(result.levels) + 1)
    forces = np.array([0.0, *(THICKNESS * level["forces"]["top"][1] for level in result.levels)])
    grip = float(CubicSpline(displacements, forces - FORCE).roots(extrapolate=False)[0])
    places = START + POSITIONS[:, None] / np.linalg.norm(END - START) * (END - START)
    points, levels = result.field("position")[:, :2], range(len(result.levels))
    fields = np.stack([result.field("principal_stretch", level) for level in levels], axis=1)
    inner = LinearNDInterpolator(points, fields)(places)
    inner = np.where(np.isnan(inner), NearestNDInterpolator(points, fields)(places), inner)
    curves = CubicSpline(displacements, np.column_stack([np.ones(len(places)), inner]), axis=1)
    off = curves(grip) - STRETCHES
    if (name, spacing) == FITS[0]:
        drawing = Figure(figsize=(9, 3.6), layout="constrained")
        left, right = drawing.subplots(1, 2, width_ratios=(1, 2))
        left.plot(displacements, forces)
        left.axhline(FORCE, color="black", linewidth=0.8)
        left.set(xlabel="displacement of the grip (mm)", ylabel="force (N)")
        right.plot(POSITIONS, curves(grip), "o", markersize=3, label="predicted by the energy")
        right.plot(POSITIONS, STRETCHES, "kx", markersize=4, label="measured")
        right.set(xlabel="position on the line (mm)", ylabel="greatest principal stretch")
        right.legend()
        drawing.savefig(FIGURES / "experiments.png", dpi=150)
    rms, largest = np.sqrt(np.mean(off**2)), off[np.abs(off).argmax()]
    yield name, spacing, len(points), rms, largest, grip, seconds


def notched(notch, law, steps, **more):
    """Half of a sheet with two notches, whose upper tab is moved by t in mm."""
    # A precut that ends between the places where bonds cross it has its length exactly.
    changes = {"precuts.0.end.0": notch + 1e-3 * FINE, "steps": steps}
    changes["material"] = law if isinstance(law, str) else law.describe()
    return scene_of("notched-sheet", changes | more)


def fitted_law():
    """Mooney-Rivlin's law that has the forces of the sheet with long notches."""
    used = STROKES < FITTED
    scene = notched(7.2, "mooney-rivlin", [{"to": stroke} for stroke in STROKES[used].tolist()])
    rows = np.array([(number, 0, 0.0, 0.0) for number in range(1, used.sum() + 1)])
    forces = NOTCHED[7.2][used] / (2 * DEEP)
    deviation = np.full(len(forces), 0.005 * forces.max())
    return (
        pds.SceneRegressor(scene, "mooney-rivlin", refine=1, bulk_ratio=100)
        .fit(rows, forces, standard_deviation=deviation)
        .law_
    )


def at_rest(notch, law):
    """Force and energy release rate of a sheet whose notches do not grow, by stroke."""
    strokes = np.linspace(0, 24, 25)
    levels = pds.simulate(notched(notch, law, [{"to": 24.0, "outputs": 24}]), "bond-energy").levels
    forces = [0.0, *(2 * DEEP * level["forces"]["tab"][1] for level in levels)]
    return CubicSpline(strokes, forces), CubicSpline(
        strokes, [0.0, *(level["cracks"][0]["energy_release_rate"] for level in levels)]
    )


def torn(notch, law, energy):
    """Stroke and force at the peak of a simulated tear."""
    steps = [{"to": PEAKS[notch][0] * part} for part in PULLED]
    with ending_at(2 * PAST_PEAK * bonds_a_spacing({"ratio": 3.15, "plane": "stress"})):
        scene = notched(notch, law, steps, fracture={"energy": energy})
        rows = pds.simulate(scene, "bond-energy", threads=1).history
    peak = max(rows, key=lambda row: row["force_tab_2"])
    return {"stroke": peak["t"], "force": 2 * DEEP * peak["force_tab_2"]}


def notches():
    """Rows and figure of the sheets with notches: two of one kind, of which that with long notches
    gives law and tear energy, and six more with short ones.
    """
    law, drawing = fitted_law(), Figure(figsize=(7, 4), layout="constrained")
    axes, energy = drawing.subplots(), None
    print(law)
    for color, (notch, forces) in zip(("C0", "C1"), NOTCHED.items(), strict=True):
        (stroke, peak), (force, rate) = PEAKS[notch], at_rest(notch, law)
        off = (force(STROKES) - forces)[forces < BEFORE * peak] / peak
        found = float(rate(force.solve(peak, extrapolate=False)[0]))
        energy = energy or found  # that of the sheet with long notches, which comes first
        tear = torn(notch, law, energy)
        rms = 100 * np.sqrt(np.mean(off**2))
        simulated = tear["force"], tear["stroke"]
        both = found, float(rate(stroke))
        yield f"{notch:g}", rms, *both, peak, simulated[0], stroke, simulated[1]
        drawn = np.linspace(0, tear["stroke"], 100)
        axes.plot(STROKES, forces, "x", color=color, label=f"notches of {notch:g} mm, measured")
        axes.plot(drawn, force(drawn), color=color, label="computed, without growth of the notches")
        axes.plot(*simulated[::-1], "o", color=color, label="peak of the simulated tear")
    strokes, peaks = np.array(AGAIN).T
    # `force` and `rate` are those of the sheet with short notches, which comes last.
    energies = [rate([force.solve(peak, extrapolate=False)[0] for peak in peaks]), rate(strokes)]
    spans = [f"{one.min():.2f} to {one.max():.2f}" for one in (*energies, peaks)]
    of_strokes = f"{strokes.min():.1f} to {strokes.max():.1f}"
    yield "3.6, six more", None, *spans, simulated[0], of_strokes, simulated[1]
    axes.plot(strokes, peaks, "k+", label="3.6 mm, peaks of six more")
    axes.set(xlabel="stroke (mm)", ylabel="force (N)")
    axes.legend(fontsize="small")
    drawing.savefig(FIGURES / "notched-sheets.png", dpi=150)


FITS = [(name, spacing) for spacing in SPACINGS for name in ("energy", "Ogden's law")]

if __name__ == "__main__":
    report(
        __doc__,
        of_rows("experiments", predicted, FITS),
        of_rows("notched-sheets", notches),
    )
