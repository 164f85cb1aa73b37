"""Fracture in space: strips with a turned precut, tears and opened strips side by side, and the
disc crack.

python pipelines/cracks_in_space.py                       all parts python
pipelines/cracks_in_space.py turned modes penny    some of them python pipelines/cracks_in_space.py
--docs                and put their tables into docs/validation/cracks-in-space.md

On one core of 2 GHz all parts take some 25 minutes: the strips 5, the modes 4, the tears 13, the
disc crack 3.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from pages import markdown_table, report

import pdsurrogate as pds
from pdsurrogate.materials import homogeneous

ANGLES, RATIOS = (0, 15, 30, 45), (1.75, 2.2, 3.015)
HIGH, LONG, LAYERS, CLAMP, TIP = 14, 30, 3, 2, -5
"""Of the strip, in spacings: free height, length, points through the thickness, what is held at
either side, place of the precut's end.
"""

CRITICAL, RATE = 2.0, 0.04
"""Critical stretch, and speed of the clamps over that of shear waves."""

BEGIN, END = 1.2, 1.75
"""Stretches of the strip between which it is pulled in dynamics."""

STARTED = 4
"""Spacings from the precut's end after which a crack counts as running."""


def turned_scene(angle: float, ratio: float, rate: float = RATE) -> pds.Scene:
    """A strip in pure shear whose lattice is turned against it; length, shear modulus and
    density in units of 1.
    """
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))

    def place(x, y):
        return [float(cosine * x - sine * y), float(sine * x + cosine * y)]

    def beyond(side):
        return {
            "half_space": {
                "point": [*place(0, side * HIGH / 2), 0.0],
                "normal": [*place(0, side), 0.0],
            }
        }

    corners = [
        place(x * LONG / 2, y * (HIGH / 2 + CLAMP)) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    along = place(LONG + TIP, 0)
    up = place(0, 1)
    travel = [(stretch - 1) * HIGH for stretch in (BEGIN, END)]
    dynamics = {
        "duration": (travel[1] - travel[0]) / rate,
        "density": 1.0,
        "damping": 0.02,
        "viscosity": 0.1,
    }
    return pds.Scene.model_validate(
        {
            "name": "turned",
            "spacing": 1.0,
            "horizon_ratio": ratio,
            "body": {
                "shape": "extrusion",
                "outline": {"shape": "polygon", "vertices": corners},
                "thickness": float(LAYERS),
            },
            "precuts": [
                {
                    "corner": [*place(-LONG, 0), -1.0],
                    "sides": [[*along, 0.0], [0.0, 0.0, LAYERS + 2.0]],
                }
            ],
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
    found = sum(
        last[key] for key in ("kinetic_energy", "strain_energy", "damped_energy", "released_energy")
    )
    return float(found / put_in - 1)


def in_dynamics(result) -> list[dict]:
    """Rows of the history of the dynamics."""
    return [row for row in result.history if "time" in row]


def strip_energy(law, stretch: float) -> float:
    """Energy release rate of a long crack in a strip in pure shear; what holds it is a point
    inside.
    """
    return homogeneous.pure_shear(law, stretch).energy_density * (HIGH + 1)


def held_at_tip(result, critical: float) -> float:
    """psi delta: the energy density at the critical stretch by the horizon, of which the tip
    diameter is a multiple.
    """
    return (
        homogeneous.uniaxial(result.scene.material.build(), critical).energy_density
        * result.body.horizon
    )


def turned_row(angle: float, ratio: float) -> list[str]:
    """One strip: tip diameter at which the crack runs, its direction, and how far it strays."""
    result = pds.simulate(turned_scene(angle, ratio))
    law, turn, rows = result.scene.material.build(), np.radians(angle), in_dynamics(result)
    tips = [
        (entry["t"], entry["time"], tip[:2])
        for entry in result.summary["crack"]["tips"]
        for tip in entry["tips"][:1]
    ]
    stretches = np.array([1 + t / (HIGH + 1) for t, _, _ in tips])
    places = np.array([place for _, _, place in tips]) @ np.array(
        [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    )
    places[:, 0] -= TIP
    running = places[:, 0] >= STARTED
    # The front third of the strip is left out, where its free end is near.
    inside = places[:, 0] < (LONG / 2 - TIP) * 2 / 3
    figures = ["-", "-", "-"]
    if running.any():
        path = places[inside]
        slope = np.polyfit(path[:, 0], path[:, 1], 1)[0] if len(path) > 2 else np.nan
        figures = [
            f"{strip_energy(law, stretches[running][0]) / held_at_tip(result, CRITICAL):.2f}",
            f"{np.degrees(np.arctan(slope)):+.1f}",
            f"{np.abs(path[:, 1]).max():.2f}",
        ]
        beyond = [time for (_, time, _), within in zip(tips, inside, strict=True) if not within]
        rows = [row for row in rows if row["time"] <= min(beyond, default=np.inf)]
    return _told([f"{ratio:g}, {angle:g}", *figures, f"{100 * energy_account(rows):+.2f}"])


def _told(row: list[str]) -> list[str]:
    print(row, flush=True)
    return row


def turned() -> str:
    """Direction and energy of a crack by the angle of the lattice and the horizon."""
    rows = [turned_row(angle, ratio) for ratio in RATIOS for angle in ANGLES]
    head = [
        "horizon (spacings), angle of the lattice (degrees)",
        "tip diameter d / δ",
        "direction (degrees)",
        "largest distance from the plane of the precut (spacings)",
    ]
    return markdown_table([*head, "energy error (%)"], rows)


def bonds_across(ratio: float, spacing: float, layers: int) -> float:
    """Bonds that a crack along a row of the lattice cuts, per unit length of it."""
    reach, count = int(ratio), 0
    for x, y, z in np.ndindex(2 * reach + 1, reach + 1, 2 * reach + 1):
        if (x - reach) ** 2 + y**2 + (z - reach) ** 2 <= ratio**2 * (1 + 1e-9):
            count += y * max(0, layers - abs(z - reach))
    return count / spacing


def spent(
    rows: list[dict], per_length: float, thickness: float, begin: float, end: float = np.inf
) -> dict[str, float]:
    """Speed of a crack between two lengths by the bonds that it has cut, and what it spent per
    area.
    """
    lengths = np.array([row["broken_bonds"] for row in rows]) / per_length
    chosen = np.flatnonzero((lengths >= begin) & (lengths <= end))
    first, last = rows[chosen[0]], rows[chosen[-1]]
    grown = lengths[chosen[-1]] - lengths[chosen[0]]
    found = {
        key: (last[key] - first[key]) / (grown * thickness)
        for key in ("released_energy", "damped_energy", "kinetic_energy")
    }
    return found | {"speed": grown / (last["time"] - first["time"])}


def mode_figures(found: dict[str, float], held: float, waves: float) -> list[str]:
    """Speed over that of shear waves, and what the bonds released and the damping took, over psi
    delta.
    """
    return [
        f"{found['speed'] / waves:.2f}",
        f"{found['released_energy'] / held:.2f}",
        f"{found['damped_energy'] / held:.2f}",
    ]


def strip_row(rate: float) -> list[str]:
    """A strip along a row of the lattice at a horizon of 2.2 spacings, by the speed of its
    clamps.
    """
    result = pds.simulate(turned_scene(0, 2.2, rate))
    law, held = result.scene.material.build(), held_at_tip(result, CRITICAL)
    reached = []
    for advance in (1, 4, 12):
        t = next(
            entry["t"]
            for entry in result.summary["crack"]["tips"]
            if entry["tip"] and entry["tip"][0] - TIP >= advance
        )
        reached.append(f"{strip_energy(law, 1 + t / (HIGH + 1)) / held:.2f}")
    found = spent(in_dynamics(result), bonds_across(2.2, 1.0, LAYERS), LAYERS, 4, 12)
    return _told(
        [f"strip, clamp speed {rate:g}", " / ".join(reached), *mode_figures(found, held, 1.0)]
    )


PEEL = {"length": 34.0, "leg": 4.0, "precut": 14.0, "begin": 7.5, "end": 26.0, "steady": 16.8}
"""Of the legs that are pulled apart in their plane (mm): the strip, one leg, the cut, and
travels of the legs.
"""


def peel_row(critical_stretch: float, spacing: float = 2 / 3, ratio: float = 2.2) -> list[str]:
    """Two legs of a cut strip pulled apart in its plane, so that the crack is opened straight
    and goes on as slowly as they do.
    """
    leg, low, begin, end = (
        PEEL["leg"],
        (round(PEEL["leg"] / spacing) // 2 - 0.5) * spacing,
        PEEL["begin"],
        PEEL["end"],
    )
    pins = {"one": low, "two": 2 * leg - low}
    near = 0.3 * spacing
    dynamics = {"duration": end - begin, "density": 1e-3, "damping": 0.1, "viscosity": 0.002}
    changes = {
        "spacing": spacing,
        "horizon_ratio": ratio,
        "body.size": [PEEL["length"], 2 * leg, THICKNESS],
        "precuts": [
            {
                "corner": [-1.0, leg, -1.0],
                "sides": [[PEEL["precut"] + 1, 0.0, 0.0], [0.0, 0.0, THICKNESS + 2]],
            }
        ],
        "regions": {
            name: {"box": [[0.0, at - near, 0.0], [0.7 * spacing, at + near, THICKNESS]]}
            for name, at in pins.items()
        },
        "prescribed": [
            {"region": "right", "x1": 0.0, "x3": 0.0},
            {"region": "one", "x2": -1.0, "x3": 0.0},
            {"region": "two", "x2": 1.0, "x3": 0.0},
        ],
        "fracture": {"critical_stretch": critical_stretch},
        "steps": [{"to": begin}, {"to": end, "outputs": 20, "dynamics": dynamics}],
    }
    result = pds.simulate(pds.load_scene("trousers", changes))
    return _mode_of_legs(
        "legs pulled apart in their plane",
        result,
        critical_stretch,
        "force_one_2",
        leg,
        PEEL["steady"],
    )


def _mode_of_legs(
    name: str, result, critical_stretch: float, force: str, leg: float, steady: float
) -> list[str]:
    """Row of two legs in tension, by Rivlin and Thomas and by what was spent."""
    law, rows, held = (
        result.scene.material.build(),
        in_dynamics(result)[:-1],
        held_at_tip(result, critical_stretch),
    )
    rows = [row for row in rows if row["t"] > steady]
    mean = float(np.mean([abs(row[force]) for row in rows]))
    found = spent(
        rows,
        bonds_across(
            result.scene.horizon_ratio,
            result.scene.spacing,
            round(THICKNESS / result.scene.spacing),
        ),
        THICKNESS,
        0,
    )
    waves = np.sqrt(law.shear_modulus / 1e-3)
    return _told(
        [
            name,
            f"{pds.tearing_energy(law, mean, leg, THICKNESS) / held:.2f}",
            *mode_figures(found, held, waves),
        ]
    )


def modes() -> str:
    """The same critical stretch in a strip that is opened, in legs that are pulled apart in
    their plane, and in a trouser tear.
    """
    critical = TEARS[0].critical_stretch
    torn, _ = torn_trousers(TEARS[0])
    rows = [*(strip_row(rate) for rate in (RATE, RATE / 4)), peel_row(critical)]
    rows.append(_mode_of_legs("trouser tear", torn, critical, "force_one_3", LEG_WIDTH, STEADY))
    head = [
        "crack at 2.2 spacings",
        "G / (ψ δ)",
        "speed / speed of shear waves",
        "released / (ψ δ)",
        "damped / (ψ δ)",
    ]
    return markdown_table(head, rows)


class Tear(NamedTuple):
    """A trouser tear: horizon and spacing, critical stretch, length of the strip, travels of the
    legs between which it is torn, their speed (mm/ms), and the travel from which on the force is
    averaged: the legs are straight, and the tear goes on.
    """

    ratio: float
    spacing: float
    critical_stretch: float
    length: float
    begin: float
    end: float
    speed: float
    steady: float = 21.0


TEARS = (
    Tear(
        2.2, 2 / 3, 2.3947, 32.0, 12.0, 28.0, 1.0
    ),  # the scene as it is shipped, but for the critical stretch
    Tear(2.2, 0.5, 2.6669, 28.0, 12.0, 25.0, 1.2),
    Tear(2.2, 2 / 3, 2.0, 32.0, 11.0, 23.0, 1.0, 18.0),
    Tear(1.75, 2 / 3, 2.53, 40.0, 16.0, 34.0, 0.8),
    Tear(1.75, 0.5, 2.807, 32.0, 17.0, 27.0, 0.8),
)

STEADY = TEARS[0].steady

LEG_WIDTH, THICKNESS = 8.0, 2.0


@cache
def torn_trousers(tear: Tear):
    """The run of a tear, and the rows of its history while its legs move."""
    dynamics = {
        "duration": (tear.end - tear.begin) / tear.speed,
        "density": 1e-3,
        "damping": 0.1,
        "viscosity": 0.002,
    }
    changes = {
        "spacing": tear.spacing,
        "horizon_ratio": tear.ratio,
        "body.size": [tear.length, 2 * LEG_WIDTH, THICKNESS],
        "fracture": {"critical_stretch": tear.critical_stretch},
        "steps": [{"to": tear.begin}, {"to": tear.end, "outputs": 40, "dynamics": dynamics}],
    }
    result = pds.simulate(pds.load_scene("trousers", changes))
    return result, in_dynamics(result)[:-1]  # in the last row the legs come to a halt


def tear_row(tear: Tear) -> list[str]:
    """One trouser tear: its energy by the force on the legs, and the diameter of the tip that
    follows.
    """
    result, rows = torn_trousers(tear)
    law = result.scene.material.build()
    force = float(np.mean([row["force_one_3"] for row in rows if row["t"] > tear.steady]))
    measured = pds.tearing_energy(law, force, LEG_WIDTH, THICKNESS)
    diameter = measured / held_at_tip(result, tear.critical_stretch)
    stray = max(
        abs(entry["tip"][1] - LEG_WIDTH)
        for entry in result.summary["crack"]["tips"]
        if entry["tip"]
    )
    figures = [
        f"{tear.spacing:.3g}",
        f"{tear.critical_stretch:g}",
        f"{force:.3f}",
        f"{measured:.3f}",
        f"{diameter:.2f}",
    ]
    figures += [f"{stray:.2f}", f"{100 * energy_account(rows):+.2f}"]
    return _told(
        [
            f"{tear.ratio:g}",
            *figures,
            str(result.summary["n_points"]),
            str(result.summary["n_steps"]),
        ]
    )


def trousers() -> str:
    """Force of the trouser tear, its energy and the diameter of its tip."""
    head = [
        "horizon (spacings)",
        "spacing (mm)",
        "critical stretch",
        "force (N)",
        "2 F λ/h - w (N/mm)",
        "d / δ",
    ]
    head += [
        "largest distance from the plane of the cut (mm)",
        "energy error (%)",
        "points",
        "steps",
    ]
    return markdown_table(head, [tear_row(tear) for tear in TEARS])


OPENED = 1.0350
"""Volume of the opened disc of the scene `penny` over Sneddon's in an endless body at the same mean
stress, by axisymmetric finite elements of nine nodes on half of the cylinder, graded toward the
edge of the crack: 1.0315, 1.0344 and 1.0350 on finer and finer meshes.
"""


def penny_row(spacing: float) -> list[str]:
    """Volume of the opened disc, by what it takes off the force, over that of a disc in a
    cylinder of this radius and no end.
    """
    result = pds.simulate(pds.load_scene("penny", {"spacing": spacing}))
    scene, law = result.scene, result.scene.material.build()
    stretch, radius, outer, length = (
        scene.stretches[0],
        scene.precuts[0].radius,
        scene.body.radius,
        scene.body.length,
    )
    stress, uncut = (
        result.levels[-1]["nominal_stress"],
        homogeneous.uniaxial(law, stretch).nominal_stress,
    )
    volume = (1 - stress / uncut) * (stretch - 1) * length * np.pi * outer**2
    young = 9 * law.bulk_modulus * law.shear_modulus / (3 * law.bulk_modulus + law.shear_modulus)
    poisson = young / (2 * law.shear_modulus) - 1
    free = 16 * (1 - poisson**2) * stress * radius**3 / (3 * young)
    expected = free * OPENED
    grown = ((volume / expected) ** (1 / 3) - 1) * radius / spacing
    return _told(
        [
            f"{spacing:.3g}",
            f"{stress / uncut:.4f}",
            f"{volume / free:.3f}",
            f"{volume / expected:.3f}",
            f"{grown:+.2f}",
        ]
    )


def penny() -> str:
    """Opening of the disc crack against linear elasticity."""
    head = [
        "spacing (cm)",
        "force / force without the crack",
        "volume / Sneddon",
        "volume / finite elements",
    ]
    head += ["increase of the radius (spacings)"]
    return markdown_table(head, [penny_row(spacing) for spacing in (0.1, 1 / 15, 0.05)])


if __name__ == "__main__":
    report(__doc__, {part.__name__: part for part in (turned, modes, trousers, penny)})
