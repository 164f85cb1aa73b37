"""Fracture in space: strips with a turned precut, the trouser tear test, and the disc crack, for ``docs/validation/cracks-in-space.md``.

    python pipelines/cracks_in_space.py [turned] [trousers] [penny]

All parts by default; they take about a quarter of an hour on two cores.
"""

import sys

import numpy as np
from pages import markdown_table, replace_block

import pdsurrogate as pd
from pdsurrogate.materials import homogeneous
from pdsurrogate.scenes.model import TIP_DIAMETERS_IN_SPACE

ANGLES, RATIOS = (0, 15, 30, 45), (1.75, 2.2, 3.015)
HIGH, LONG, LAYERS, CLAMP, TIP = 14, 30, 3, 2, -5
"""Of the strip, in spacings: free height, length, points through the thickness, what is held at either side, place of the precut's end."""

CRITICAL, RATE = 2.0, 0.04
"""Critical stretch, and speed of the clamps over that of shear waves."""

BEGIN, END = 1.2, 1.75
"""Stretches of the strip between which it is pulled in dynamics."""

STARTED = 4
"""Spacings from the precut's end after which a crack counts as running."""


def turned_scene(angle: float, ratio: float) -> pd.Scene:
    """A strip in pure shear whose lattice is turned against it; length, shear modulus and density in units of 1."""
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))

    def place(x, y):
        return [float(cosine * x - sine * y), float(sine * x + cosine * y)]

    def beyond(side):
        return {"half_space": {"point": [*place(0, side * HIGH / 2), 0.0], "normal": [*place(0, side), 0.0]}}

    corners = [place(x * LONG / 2, y * (HIGH / 2 + CLAMP)) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    along = place(LONG + TIP, 0)
    up = place(0, 1)
    travel = [(stretch - 1) * HIGH for stretch in (BEGIN, END)]
    dynamics = {"duration": (travel[1] - travel[0]) / RATE, "density": 1.0, "damping": 0.02, "viscosity": 0.1}
    return pd.Scene.model_validate(
        {
            "name": "turned",
            "spacing": 1.0,
            "horizon_ratio": ratio,
            "body": {"shape": "extrusion", "outline": {"shape": "polygon", "vertices": corners}, "thickness": float(LAYERS)},
            "precuts": [{"corner": [*place(-LONG, 0), -1.0], "sides": [[*along, 0.0], [0.0, 0.0, LAYERS + 2.0]]}],
            "material": {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 20.0},
            "prescribed": [
                {"region": beyond(-1), "x1": 0.0, "x2": 0.0, "x3": 0.0},
                {"region": beyond(1), "x1": up[0], "x2": up[1], "x3": 0.0},
            ],
            "steps": [{"to": travel[0]}, {"to": travel[1], "outputs": 80, "dynamics": dynamics}],
            "fracture": {"critical_stretch": CRITICAL},
        }
    )


def energy_account(rows: list[dict]) -> float:
    """What the energies of the last row miss of what was put in, over that."""
    first, last = rows[0], rows[-1]
    put_in = first["kinetic_energy"] + first["strain_energy"] + last["work"]
    found = sum(last[key] for key in ("kinetic_energy", "strain_energy", "damped_energy", "released_energy"))
    return float(found / put_in - 1)


def in_dynamics(result) -> list[dict]:
    """Rows of the history of the dynamics."""
    return [row for row in result.history if "time" in row]


def turned_row(angle: float, ratio: float) -> list[str]:
    """One strip: tip diameter at which the crack runs, its direction, and how far it strays."""
    result = pd.simulate(turned_scene(angle, ratio))
    law, turn = result.scene.material.build(), np.radians(angle)
    density = homogeneous.uniaxial(law, CRITICAL).energy_density
    tips = [(1 + entry["t"] / (HIGH + 1), tip[:2]) for entry in result.summary["crack"]["tips"] for tip in entry["tips"][:1]]
    stretches = np.array([stretch for stretch, _ in tips])
    places = np.array([place for _, place in tips]) @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    places[:, 0] -= TIP
    running = places[:, 0] >= STARTED
    diameters = ["-", "-", "-"]
    if running.any():
        energy = homogeneous.pure_shear(law, stretches[running][0]).energy_density * (HIGH + 1)
        # The front third of the strip is left out, where its free end is near.
        path = places[places[:, 0] < (LONG / 2 - TIP) * 2 / 3]
        slope = np.polyfit(path[:, 0], path[:, 1], 1)[0] if len(path) > 2 else np.nan
        diameters = [
            f"{energy / (density * result.body.horizon):.2f}",
            f"{np.degrees(np.arctan(slope)):+.1f}",
            f"{np.abs(path[:, 1]).max():.2f}",
        ]
    row = [f"{ratio:g}, {angle:g}", *diameters, f"{100 * energy_account(in_dynamics(result)):+.2f}"]
    print(row, flush=True)
    return row


def turned() -> None:
    """Direction and energy of a crack by the angle of the lattice and the horizon."""
    rows = [turned_row(angle, ratio) for ratio in RATIOS for angle in ANGLES]
    head = [
        "horizon in spacings, angle of the lattice",
        "tip diameter d in horizons",
        "direction (degrees)",
        "greatest distance from its plane (spacings)",
    ]
    replace_block("turned", markdown_table([*head, "energy account (%)"], rows))


TEARS = (
    # horizon and spacing, critical stretch, length of the strip, travels of the legs between which it is torn, and their speed (mm/ms)
    (1.75, 2 / 3, 2.53, 40.0, 16.0, 34.0, 0.8),
    (1.75, 0.5, 2.807, 32.0, 17.0, 27.0, 0.8),
    (2.2, 2 / 3, 2.4066, 32.0, 12.0, 28.0, 1.0),
    (2.2, 0.5, 2.6669, 28.0, 12.0, 25.0, 1.2),
)

STEADY = 21.0
"""Travel from which on the force is averaged: the legs are straight, and the tear goes on."""

LEG_WIDTH, THICKNESS = 8.0, 2.0


def tear_row(ratio: float, spacing: float, critical_stretch: float, length: float, begin: float, end: float, speed: float) -> list[str]:
    """One trouser tear: its energy by the force on the legs over the fracture energy that belongs to the critical stretch."""
    dynamics = {"duration": (end - begin) / speed, "density": 1e-3, "damping": 0.1, "viscosity": 0.002}
    changes = {
        "spacing": spacing,
        "horizon_ratio": ratio,
        "body.size": [length, 2 * LEG_WIDTH, THICKNESS],
        "fracture": {"critical_stretch": critical_stretch},
        "steps": [{"to": begin}, {"to": end, "outputs": 20, "dynamics": dynamics}],
    }
    result = pd.simulate(pd.load_scene("trousers", changes))
    law, rows = result.scene.material.build(), in_dynamics(result)[:-1]  # in the last row the legs come to a halt
    force = float(np.mean([row["force_one_3"] for row in rows if row["t"] > STEADY]))
    measured = pd.tearing_energy(law, force, LEG_WIDTH, THICKNESS)
    put_in = homogeneous.uniaxial(law, critical_stretch).energy_density * TIP_DIAMETERS_IN_SPACE[ratio] * result.body.horizon
    stray = max(abs(entry["tip"][1] - LEG_WIDTH) for entry in result.summary["crack"]["tips"] if entry["tip"])
    figures = [
        f"{spacing:.3g}",
        f"{critical_stretch:g}",
        f"{put_in:.3f}",
        f"{force:.3f}",
        f"{measured:.3f}",
        f"{100 * (measured / put_in - 1):+.1f}",
    ]
    return [*figures, f"{stray:.2f}", f"{100 * energy_account(rows):+.2f}", str(result.summary["n_points"]), str(result.summary["n_steps"])]


def trousers() -> None:
    """Force of the trouser tear against the fracture energy put in."""
    head = [
        "horizon in spacings",
        "spacing (mm)",
        "critical stretch",
        "fracture energy (N/mm)",
        "force (N)",
        "2 F l/h - w (N/mm)",
        "error (%)",
    ]
    head += ["greatest distance from its plane (mm)", "energy account (%)", "points", "steps"]
    replace_block("trousers", markdown_table(head, [tear_row(*tear) for tear in TEARS]))


def penny_row(spacing: float) -> list[str]:
    """Volume of the opened disc, by what it takes off the force, over that of a disc in a cylinder of this radius and no end."""
    result = pd.simulate(pd.load_scene("penny", {"spacing": spacing}))
    scene, law = result.scene, result.scene.material.build()
    stretch, radius, outer, length = scene.stretches[0], scene.precuts[0].radius, scene.body.radius, scene.body.length
    stress, uncut = result.levels[-1]["nominal_stress"], homogeneous.uniaxial(law, stretch).nominal_stress
    volume = (1 - stress / uncut) * (stretch - 1) * length * np.pi * outer**2
    young = 9 * law.bulk_modulus * law.shear_modulus / (3 * law.bulk_modulus + law.shear_modulus)
    poisson = young / (2 * law.shear_modulus) - 1
    # V = 2/sigma times the energy released while the disc grows, with K = 2/pi sigma sqrt(pi a) f(a/R); of an endless body f = 1.
    shares = (np.arange(1000) + 0.5) / 1000 * radius
    ratio = shares / outer
    factor = (1 - ratio / 2 + 0.148 * ratio**3) / np.sqrt(1 - ratio)
    free = 16 * (1 - poisson**2) * stress * radius**3 / (3 * young)
    expected = free * 3 * (factor**2 * shares**2).mean() / radius**2
    grown = ((volume / expected) ** (1 / 3) - 1) * radius / spacing
    return [f"{spacing:.3g}", f"{stress / uncut:.4f}", f"{volume / free:.3f}", f"{volume / expected:.3f}", f"{grown:+.2f}"]


def penny() -> None:
    """Opening of the disc crack against linear elasticity."""
    head = ["spacing (cm)", "force over that without the crack", "volume over Sneddon's", "volume over that in the cylinder"]
    head += ["radius gained (spacings)"]
    replace_block("penny", markdown_table(head, [penny_row(spacing) for spacing in (0.1, 1 / 15, 0.05)]))


PARTS = {part.__name__: part for part in (turned, trousers, penny)}

if __name__ == "__main__":
    for part in sys.argv[1:] or PARTS:
        PARTS[part]()
