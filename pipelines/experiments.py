"""A sheet of silicone with holes, and sheets of a printed rubber that tear from notches, predicted
and held against measurements.

python pipelines/experiments.py                  prints the tables, in some minutes, and draws the
figures python pipelines/experiments.py notched-sheets   those of one experiment: experiments (the
holes) or notched-sheets python pipelines/experiments.py --docs           and puts them into
docs/validation/experiments.md

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
from joblib import Parallel, delayed
from matplotlib.figure import Figure
from pages import FIGURES, markdown_table, report
from scipy.interpolate import CubicSpline, LinearNDInterpolator, NearestNDInterpolator
from scipy.stats import norm, t
from sklearn.base import clone

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

MEMBERS, JOBS = 8, 8

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

HALF, LONG, DEEP, FINE = 12.0, 48.0, 2.5, 0.4
"""Of the notched sheets: half of the width, length between the stiff tabs, thickness, spacing of
the points, all in mm.
"""

FITTED = 11.0
"""Stroke in mm up to which the law is fitted to the forces of the sheet with long notches, which
softens beyond it.
"""

BEFORE = 0.9
"""Part of the measured peak up to which forces are compared with those of a sheet whose notches
do not grow.
"""

PULLED, SPEED, SAFETY = (0.6, 1.5), 0.02, 0.4
"""Strokes between which a tear is simulated in dynamics, divided by that at the measured peak;
speed of the tab divided by that of shear waves; part of the critical time step. With its default of
0.7 the last points of the ligament, which retract at once, turn inside out.
"""


def holes() -> tuple[pds.shapes.Polygon, ...]:
    """The holes; the slit from the first center to the third joins two of them."""
    discs = [shapely.Point(center).buffer(RADIUS, 48) for center in CENTERS]
    slit = shapely.LineString([CENTERS[0], CENTERS[2]]).buffer(SLIT / 2, cap_style="flat")
    outlines = [
        np.array(part.exterior.coords)[:-1] for part in shapely.union_all([*discs, slit]).geoms
    ]
    return tuple(
        pds.shapes.Polygon(vertices=tuple(map(tuple, outline.tolist()))) for outline in outlines
    )


def predicted(law, spacing: float) -> dict:
    """Displacement of the grip at the force, and the greatest principal stretches at the
    measured positions then.
    """
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
    points = result.field("position")[:, :2]
    fields = np.stack(
        [result.field("principal_stretch", level) for level in range(len(result.levels))], axis=1
    )
    inner = LinearNDInterpolator(points, fields)(places)
    inner = np.where(np.isnan(inner), NearestNDInterpolator(points, fields)(places), inner)
    stretches = CubicSpline(displacements, np.column_stack([np.ones(len(places)), inner]), axis=1)(
        grip
    )
    return {
        "points": len(points),
        "grip": grip,
        "stretches": stretches,
        "seconds": seconds,
        "forces": forces,
    }


def rms(stretches: np.ndarray) -> float:
    return float(np.sqrt(np.mean((stretches - STRETCHES) ** 2)))


def simulated_test(law, mode: str) -> np.ndarray:
    """Nominal stresses at the stretches of a test, from the forces on a square of 10 mm whose
    sides slide along their grips.
    """
    rows = TESTS.of(mode)
    greatest = float(rows.stretches[:, 0].max()) - 1
    across = {"uniaxial": (), "pure-shear": (0.0,), "equibiaxial": (10 * greatest,)}[mode]
    scene = pds.Scene(
        name=mode,
        spacing=1.0,
        units={"length": "mm", "stress": "MPa", "time": "s"},
        body=pds.shapes.Rectangle(size=(10.0, 10.0)),
        material=law,
        prescribed=(
            pds.Prescribed(region="left", x1=0.0),
            pds.Prescribed(region="right", x1=10 * greatest),
            pds.Prescribed(region="bottom", x2=0.0),
            *(pds.Prescribed(region="top", x2=to) for to in across),
        ),
        steps=(pds.Step(to=1.0, outputs=24),),
    )
    result = pds.simulate(scene, "bond-energy")
    stresses = [0.0, *(level["forces"]["right"][0] / 10 for level in result.levels)]
    return np.interp(rows.stretches[:, 0], np.linspace(1, 1 + greatest, len(stresses)), stresses)


def tests_table(laws: dict) -> str:
    """RMS errors of the tests, by the law itself and by the simulation of the test, in percent
    of the greatest stress.
    """
    rows = []
    for name, law in laws.items():
        row = [name]
        for mode in TESTS.modes:
            measured = TESTS.of(mode)
            of_law = pds.identification.nominal_stress(law, measured.stretches)
            errors = [
                of_law - measured.nominal_stress,
                simulated_test(law, mode) - measured.nominal_stress,
            ]
            row.append(
                ", ".join(
                    f"{100 * np.sqrt(np.mean(one**2)) / measured.nominal_stress.max():.2f} %"
                    for one in errors
                )
            )
        rows.append(row)
        print(row, flush=True)
    return markdown_table(
        ["RMS error of the stress: of the fit, of the simulated test", *TESTS.modes], rows
    )


def row_of(name: str, spacing: float, found: dict) -> list[str]:
    """A row of the table of predictions, which is also printed."""
    off = found["stretches"] - STRETCHES
    row = [
        name,
        f"{spacing:g}",
        f"{found['points']}",
        f"{rms(found['stretches']):.3f}",
        f"{off[np.abs(off).argmax()]:+.2f}",
    ]
    row += [f"{found['grip']:.1f}", f"{found['seconds']:.0f}"]
    print(row, flush=True)
    return row


def figure(energy: dict, spread: np.ndarray, ogden: dict) -> Figure:
    """The force of the grip against its displacement, and measured and predicted stretches along
    the line.
    """
    drawing = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = drawing.subplots(1, 2, width_ratios=(1, 2))
    for name, found, color in (("energy", energy, "C0"), ("Ogden's law", ogden, "C1")):
        left.plot(
            np.linspace(0, GRIP, len(found["forces"])), found["forces"], color=color, label=name
        )
        right.plot(POSITIONS, found["stretches"], "o", markersize=3, color=color, label=name)
    left.axhline(FORCE, color="black", linewidth=0.8)
    left.set(xlabel="displacement of the grip (mm)", ylabel="force (N)")
    left.legend()
    right.errorbar(
        POSITIONS, energy["stretches"], 2 * spread, fmt="none", ecolor="C0", elinewidth=1
    )
    right.plot(POSITIONS, STRETCHES, "kx", markersize=4, label="measured")
    right.set(xlabel="position on the line (mm)", ylabel="greatest principal stretch")
    right.legend()
    return drawing


def committee(regressor) -> list:
    """Copies of a regressor, each fitted to a random half of the rows of the tests."""
    random, members = np.random.default_rng(0), []
    for _ in range(MEMBERS):
        half = random.choice(np.arange(len(TESTS)), -(-len(TESTS) // 2), replace=False)
        member = clone(regressor).set_params(random_state=int(random.integers(2**31)))
        weights = TESTS.balanced_weights()[half]
        members.append(member.fit(TESTS.stretches[half], TESTS.nominal_stress[half], weights))
    return members


def spread_of(found, members) -> np.ndarray:
    """Spread of the results of a committee about a result: its double covers 95 % of normal
    deviations.
    """
    rms = np.sqrt(((np.array(members) - np.asarray(found)) ** 2).mean(axis=0))
    return rms * t.ppf(norm.cdf(2.0), len(members)) / 2.0


def holes_found() -> str:
    """Tables and figure of the sheet with holes."""
    fitted = {
        "energy": pds.identification.EnergyRegressor(),
        "Ogden's law": pds.identification.LawRegressor("ogden"),
    }
    for model in fitted.values():
        model.fit(TESTS.stretches, TESTS.nominal_stress, TESTS.balanced_weights())
    laws = {name: model.law_ for name, model in fitted.items()}
    tables = [tests_table(laws)]
    runs = [(name, spacing) for spacing in SPACINGS for name in laws]
    members = committee(fitted["energy"])
    jobs = [
        *((laws[name], spacing) for name, spacing in runs),
        *((member.law_, SPACINGS[0]) for member in members),
    ]
    results = Parallel(JOBS)(delayed(predicted)(*job) for job in jobs)
    found, others = dict(zip(runs, results, strict=False)), results[len(runs) :]
    rows = [row_of(name, spacing, one) for (name, spacing), one in found.items()]
    header = [
        "learnt from the tests",
        "spacing (mm)",
        "points",
        "RMSE",
        "largest error",
        "grip (mm)",
        "processor time (s)",
    ]
    tables.append(markdown_table(header, rows))
    coarse = found["energy", SPACINGS[0]]
    spread = spread_of(coarse["stretches"], [other["stretches"] for other in others])
    inside = np.abs(coarse["stretches"] - STRETCHES) <= 2 * spread
    of_grip = spread_of(coarse["grip"], [other["grip"] for other in others])
    terms = ", ".join(
        f"{weight:.3g} MPa of {term}"
        for term, weight in zip(fitted["energy"].terms_, fitted["energy"].weights_, strict=True)
    )
    tables.append(
        f"The energy consists of {terms}. The spread of {MEMBERS} members of its committee, each"
        f" fitted to a random half of the rows, at {SPACINGS[0]:g} mm: {spread.mean():.3f} on"
        f" average over the stretches and {spread.max():.3f} at most, and {of_grip:.1f} mm for the"
        f" displacement of the grip. {inside.sum()} of the 29 measured stretches lie within twice"
        " the spread."
    )
    figure(coarse, spread, found["Ogden's law", SPACINGS[0]]).savefig(
        FIGURES / "experiments.png", dpi=150
    )
    return "\n\n".join(tables)


def notched(notch: float, law, steps: list[dict], **more) -> pds.Scene:
    """Half of a sheet with two notches, whose upper tab is moved by t in mm."""
    held = [
        {"region": "bottom", "x1": 0.0, "x2": 0.0},
        {"region": "top", "name": "tab", "x1": 0.0, "x2": 1.0},
    ]
    # A precut that ends between the places where bonds cross it has its length exactly.
    cut = {"start": [-1.0, LONG / 2], "end": [notch + 1e-3 * FINE, LONG / 2]}
    return pds.Scene.model_validate(
        {
            "name": "notched-sheet",
            "spacing": FINE,
            "units": {"length": "mm", "stress": "MPa", "time": "s"},
            "body": {"shape": "rectangle", "size": [HALF, LONG]},
            "precuts": [cut],
            "material": law if isinstance(law, str) else law.describe(),
            "prescribed": [*held, {"region": "right", "x1": 0.0}],
            "steps": steps,
            **more,
        }
    )


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


def at_rest(notch: float, law) -> tuple[CubicSpline, CubicSpline]:
    """Force and energy release rate of a sheet whose notches do not grow, by stroke."""
    strokes = np.linspace(0, 24, 25)
    levels = pds.simulate(notched(notch, law, [{"to": 24.0, "outputs": 24}]), "bond-energy").levels
    forces = [0.0, *(2 * DEEP * level["forces"]["tab"][1] for level in levels)]
    return CubicSpline(strokes, forces), CubicSpline(
        strokes, [0.0, *(level["cracks"][0]["energy_release_rate"] for level in levels)]
    )


def torn(notch: float, law, energy: float) -> dict:
    """Stroke and force at the peak of a simulated tear."""
    speed, (first, last) = SPEED * law.shear_modulus**0.5, PEAKS[notch][0] * np.array(PULLED)
    dynamics = {
        "duration": (last - first) / speed,
        "density": 1.0,
        "damping": speed / LONG,
        "safety": SAFETY,
    }
    scene = notched(
        notch,
        law,
        [{"to": first}, {"to": last, "outputs": 60, "dynamics": dynamics}],
        fracture={"energy": energy},
    )
    result = pds.simulate(scene, "bond-energy")
    rows = [row for row in result.history if "time" in row]
    peak = max(rows, key=lambda row: row["force_tab_2"])
    shown = {
        "critical stretch": result.summary["critical_stretch"],
        "energy error (%)": result.summary["dynamics"][-1]["energy_gap"],
    }
    return {"stroke": peak["t"], "force": 2 * DEEP * peak["force_tab_2"], **shown}


def notches_found() -> str:
    """Table and figure of the sheets with notches."""
    law, rows, drawing, energy = (
        fitted_law(),
        [],
        Figure(figsize=(7, 4), layout="constrained"),
        None,
    )
    axes = drawing.subplots()
    print(law)
    for color, (notch, forces) in zip(("C0", "C1"), NOTCHED.items(), strict=True):
        (stroke, peak), (force, rate) = PEAKS[notch], at_rest(notch, law)
        off = (force(STROKES) - forces)[forces < BEFORE * peak] / peak
        found = float(rate(force.solve(peak, extrapolate=False)[0]))
        energy = energy or found  # that of the sheet with long notches, which comes first
        tear = torn(notch, law, energy)
        measured = [f"{100 * np.sqrt(np.mean(off**2)):.1f}", f"{found:.2f}", f"{rate(stroke):.2f}"]
        rows.append(
            [
                f"{notch:g}",
                *measured,
                f"{peak:.2f}",
                f"{tear['force']:.2f}",
                f"{stroke:.1f}",
                f"{tear['stroke']:.1f}",
            ]
        )
        print(rows[-1], tear, flush=True)
        drawn = np.linspace(0, tear["stroke"], 100)
        axes.plot(STROKES, forces, "x", color=color, label=f"notches of {notch:g} mm, measured")
        axes.plot(drawn, force(drawn), color=color, label="computed, without growth of the notches")
        axes.plot(
            tear["stroke"], tear["force"], "o", color=color, label="peak of the simulated tear"
        )
    strokes, peaks = np.array(AGAIN).T
    # `force` and `rate` are those of the sheet with short notches, which comes last.
    energies = [rate([force.solve(peak, extrapolate=False)[0] for peak in peaks]), rate(strokes)]
    spans = [f"{values.min():.2f} to {values.max():.2f}" for values in (*energies, peaks)]
    rows.append(
        [
            "3.6, six more",
            "-",
            *spans,
            rows[-1][5],
            f"{strokes.min():.1f} to {strokes.max():.1f}",
            rows[-1][7],
        ]
    )
    axes.plot(strokes, peaks, "k+", label="3.6 mm, peaks of six more")
    axes.set(xlabel="stroke (mm)", ylabel="force (N)")
    axes.legend(fontsize="small")
    head = [
        "notches (mm)",
        "rms error of the force before the tear (% of the peak)",
        "G at the force of the peak (N/mm)",
    ]
    head += [
        "G at the stroke of the peak (N/mm)",
        "peak, measured (N)",
        "simulated (N)",
        "stroke at the peak, measured (mm)",
    ]
    drawing.savefig(FIGURES / "notched-sheets.png", dpi=150)
    return markdown_table([*head, "simulated (mm)"], rows)


if __name__ == "__main__":
    report(__doc__, {"experiments": holes_found, "notched-sheets": notches_found})
