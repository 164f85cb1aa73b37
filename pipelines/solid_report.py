"""Bodies in space against finite elements and exact solutions, at several spacings.

python pipelines/solid_report.py                all cases, with 8, 16, 24 and 32 points a side
python pipelines/solid_report.py --quick        8 and 16
python pipelines/solid_report.py cube torsion   cases whose names have one of these words
python pipelines/solid_report.py --docs         and put the table into the documentation

References: finite elements of `data/solid_fields.json`, which change by 0.05 % or less in their last refinement, the axial force of the
torsion by 0.11 %; of the rollers the root of the two lateral stresses, of the sphere the radial equation of equilibrium.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from pages import markdown_table, replace_block
from rich.console import Console
from scipy.integrate import solve_bvp
from scipy.interpolate import RegularGridInterpolator
from scipy.optimize import brentq

import pdsurrogate as pds

DATA = json.loads((Path(__file__).parent / "data" / "solid_fields.json").read_text())
EDGE = 3
"""Points at the surfaces that are left out of the figures of the pressure, which is singular at bonded edges; of 8 a side one."""

console = Console()


@dataclass(frozen=True)
class Case:
    """A run at several spacings, and what it is compared with.

    Attributes
    ----------
    run : callable
        Of the number of points a side; gives a result.
    measure : callable
        Of a result and that number; gives what the columns show: reaction, displacement, field, pressure, checkerboard, in percent.
    prototype : dict of str
        Figures of a prototype of this energy, by points a side.
    sizes : tuple of int
    """

    run: Callable[[int], pds.Result]
    measure: Callable[[pds.Result, int], list[float | None]]
    prototype: dict[int, str]
    sizes: tuple[int, ...] = (8, 16, 24, 32)


def bonded(name: str, length: float, bulk_modulus: float, stretch: float, prototype: dict[int, str], **more) -> Case:
    """A block between bonded plates: an eighth of it, between planes of symmetry."""

    def run(points: int) -> pds.Result:
        scene = {
            "name": "bonded-eighth",
            "spacing": 1 / points,
            "body": {"shape": "box", "size": [length / 2, 0.5, 0.5], "lower": [0, 0, 0]},
            "material": {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": bulk_modulus},
            "prescribed": [
                {"region": "left", "x1": 0.0, "x2": 0.0, "x3": 0.0},
                {"region": "right", "x1": (stretch - 1) * length / 2},
                {"region": "bottom", "x2": 0.0},
                {"region": "back", "x3": 0.0},
            ],
            "steps": [{"to": 1.0, "largest_increment": min(1.0, 0.1 / abs(stretch - 1))}],
            "solver": {"tolerance": 1e-5},
        }
        return pds.simulate(pds.Scene(**scene))

    def measure(result: pds.Result, points: int) -> list[float | None]:
        reference, cells = DATA[name], (round(length * points / 2), points // 2, points // 2)
        body, fields = result.body, result.states[-1][1]
        order = np.lexsort(body.points.T[::-1])
        places, moved = body.points[order], fields["displacement"][order]
        expected = field_of(reference, "x", "u", 3)(places)
        expected[:, 0] += (stretch - 1) * length / 2
        side = reference["lateral_mid_face"]
        pressure = np.trace(fields["cauchy_stress"].reshape(-1, 3, 3), axis1=1, axis2=2)[order].reshape(cells) / 3
        exact = field_of(reference, "p", "p", 1)(places).reshape(cells)
        edge = EDGE if points > 12 else 1
        inner = np.s_[edge:, :-edge, :-edge]
        spread = exact[inner].std()
        return [
            percent(4 * result.levels[-1]["forces"]["right"][0], reference["reaction"]),
            percent(at_side(moved[:, 1].reshape(cells)), side),
            100 * np.sqrt(((moved - expected) ** 2).sum(axis=1).mean()) / abs(side),
            100 * np.sqrt(((pressure - exact)[inner] ** 2).mean()) / spread,
            100 * np.sqrt((alternating(pressure[inner]) ** 2).mean()) / spread,
        ]

    return Case(run, measure, prototype, **more)


def field_of(reference: dict, axes: str, values: str, components: int) -> RegularGridInterpolator:
    """A field of a reference, as a function of places."""
    grid = [np.array(reference[f"{axes}{axis}"]) for axis in (1, 2, 3)]
    found = np.array(reference[values]).reshape(*(len(axis) for axis in grid), components)
    return RegularGridInterpolator(grid, found if components > 1 else found[..., 0], method="cubic")


def percent(found: float, expected: float) -> float:
    """By how much a value is off."""
    return 100 * (found / expected - 1)


def at_side(values: np.ndarray) -> float:
    """Value in the middle of a side from those of an eighth: even across its planes of symmetry, a parabola to the surface."""
    line = (9 * values[-1] - values[-2]) / 8
    line = (9 * line[:, 0] - line[:, 1]) / 8
    return (15 * line[-1] - 10 * line[-2] + 3 * line[-3]) / 8


def alternating(values: np.ndarray) -> np.ndarray:
    """Part of a field that changes its sign from point to point along all axes."""
    for axis in range(3):
        values = np.moveaxis(values, axis, 0)
        values = np.moveaxis((values[:-2] - 2 * values[1:-1] + values[2:]) / 4, 0, axis) if len(values) > 2 else values[:0]
    return values if values.size else np.full(1, np.nan)


def run_torsion(points: int) -> pds.Result:
    """The scene of the package."""
    return pds.simulate(pds.load_scene("torsion", {"spacing": 1 / points, "solver.tolerance": 1e-5}))


def measure_torsion(result: pds.Result, points: int) -> list[float | None]:
    """Torque, axial force and displacements."""
    reference, level = DATA["cube_torsion60_K100"], result.levels[-1]
    expected = field_of(reference, "x", "u", 3)(result.body.points)
    moved = result.states[-1][1]["displacement"]
    return [
        percent(level["moments"]["right"][0], reference["torque"]),
        percent(level["forces"]["right"][0], reference["axial_force"]),
        100 * np.sqrt(((moved - expected) ** 2).sum(axis=1).mean() / (expected**2).sum(axis=1).mean()),
        None,
        None,
    ]


def rollers(stretch: float) -> Case:
    """A cube between frictionless plates."""

    def run(points: int) -> pds.Result:
        grips = [{"edge": "left", "holds": "normal"}, {"edge": "right", "holds": "normal", "travel": 1.0}]
        scene = {
            "name": "rollers",
            "spacing": 1 / points,
            "body": {"shape": "box", "size": [1, 1, 1], "lower": [0, -0.5, -0.5]},
            "material": {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 100.0},
            "grips": grips,
            "stretches": [stretch],
            "solver": {"tolerance": 1e-7},
        }
        return pds.simulate(pds.Scene(**scene))

    def measure(result: pds.Result, points: int) -> list[float | None]:
        def stresses(side: float) -> tuple[float, float]:
            """Nominal stress along the load and across it."""
            J, K = stretch * side**2, 100.0
            trace, volume = stretch**2 + 2 * side**2, K / 4 * (J - 1 / J) * (1 + J**-2) * J
            return tuple((J ** (-2 / 3) * (x * x - trace / 3) + volume) / x for x in (stretch, side))

        side = brentq(lambda x: stresses(x)[1], 0.5, 1.5, xtol=1e-15)
        places, moved = result.body.points, result.states[-1][1]["displacement"]
        slope = np.polyfit(places[:, 1], moved[:, 1], 1)[0]
        return [percent(result.levels[-1]["nominal_stress"], stresses(side)[0]), percent(1 + slope, side), None, None, None]

    return Case(run, measure, {}, (8, 16))


@cache
def run_sphere(points: int) -> pds.Result:
    """The scene of the package, at both of its pressures."""
    return pds.simulate(pds.load_scene("inflation", {"spacing": 1 / points, "solver.tolerance": 1e-5}))


def inflation(level: int) -> Case:
    """The thick sphere at one of its pressures."""

    def measure(result: pds.Result, points: int) -> list[float | None]:
        places, volumes, moved = result.body.points, result.body.volumes, result.states[level][1]["displacement"]
        radius = np.linalg.norm(places, axis=1)
        expected = sphere(0.25 * (level + 1), 100.0)(radius)
        outward = places / radius[:, None]
        found = (moved * outward).sum(axis=1)

        def over(part: np.ndarray) -> float:
            return percent(float(volumes[part] @ found[part]), float(volumes[part] @ expected[part]))

        apart = np.linalg.norm(moved - expected[:, None] * outward, axis=1)
        return [over(radius < 0.6), over(radius > 0.9), 100 * np.sqrt((apart**2).mean() / (expected**2).mean()), None, None]

    return Case(run_sphere, measure, {}, (8, 12, 16, 24, 32, 40, 48))


def sphere(pressure: float, bulk_modulus: float) -> Callable[[np.ndarray], np.ndarray]:
    """Radial displacement by radius of a neo-Hookean sphere of radii 0.5 and 1 with a pressure on its deformed inner surface."""

    def stresses(along, across):
        J = along * across**2
        trace = along**2 + 2 * across**2
        volume = bulk_modulus / 4 * (J - 1 / J) * (1 + J**-2) * J
        return tuple((J ** (-2 / 3) * (x * x - trace / 3) + volume) / x for x in (along, across))

    def slopes(R, state):
        # Of the radius, and of the radial nominal stress; the radial stretch is what gives that stress.
        radius, stress = state
        across = radius / R
        along = across**-2.0
        for _ in range(30):
            found = stresses(along, across)[0] - stress
            along = along - found / ((stresses(along + 1e-7, across)[0] - stresses(along - 1e-7, across)[0]) / 2e-7)
        return np.array([along, 2 / R * (stresses(along, across)[1] - stress)])

    R = np.linspace(0.5, 1, 41)
    radius, stress = R, np.zeros_like(R)
    for load in np.linspace(0, pressure, 6)[1:]:
        found = solve_bvp(slopes, lambda a, b, load=load: np.array([a[1] + load * (a[0] / 0.5) ** 2, b[1]]), R, [radius, stress], tol=1e-8)
        radius, stress = found.sol(R)
    return lambda places: found.sol(places)[0] - places


CASES = {
    "bonded cube, 1.5, K = 100": bonded("cube_clamped_K100_l1.5", 1.0, 100.0, 1.5, {8: "2.6 / 3.4", 16: "0.70 / 0.48", 24: "0.31 / 0.19"}),
    "bonded cube, 1.5, K = 1000": bonded("cube_clamped_K1000_l1.5", 1.0, 1000.0, 1.5, {16: "0.97 / 0.67", 24: "0.43 / 0.28"}),
    "bonded cube, 0.9, K = 100": bonded("cube_clamped_K100_l0.9", 1.0, 100.0, 0.9, {16: "2.5", 24: "1.5"}),
    "bonded block 2 x 1 x 1, 1.5, K = 100": bonded("block2_clamped_K100_l1.5", 2.0, 100.0, 1.5, {}),
    "torsion by 60 degrees": Case(run_torsion, measure_torsion, {8: "-9.5", 16: "-3.2", 24: "-1.6"}),
    "rollers, 1.5": rollers(1.5),
    "rollers, 0.8": rollers(0.8),
    "thick sphere, p = 0.25": inflation(0),
    "thick sphere, p = 0.5": inflation(1),
}
HEADER = [
    "case",
    "points per side",
    "force, torque, inner displacement (%)",
    "side, axial force, outer displacement (%)",
    "field (%)",
    "pressure (%)",
    "checkerboard (%)",
    "prototype (%)",
    "evaluations",
    "seconds",
]


def shown(value: float | None) -> str:
    """A figure of the table."""
    if value is None or np.isnan(value):
        return ""
    return f"{value:+.2f}" if abs(value) >= 0.005 else f"{value:+.0e}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("words", nargs="*", metavar="WORD")
    parser.add_argument("--quick", action="store_true", help="8 and 16 points a side alone")
    parser.add_argument("--docs", action="store_true", help="put the table into the documentation")
    arguments = parser.parse_args()
    rows = []
    for name, case in CASES.items():
        if arguments.words and not any(word in name for word in arguments.words):
            continue
        for points in case.sizes[: 2 if arguments.quick else None]:
            began = time.perf_counter()
            try:
                result = case.run(points)
            except pds.SimulationFailed as error:
                console.print(f"{name}, {points} points a side: {error}")
                continue
            seconds = time.perf_counter() - began
            figures = case.measure(result, points)
            figures[2:] = [None if value is None else abs(value) for value in figures[2:]]
            unsigned = [shown(value).removeprefix("+") for value in figures[2:]]
            row = [name, str(points), *map(shown, figures[:2]), *unsigned, case.prototype.get(points, "")]
            rows.append([*row, str(result.summary["n_force_evaluations"]), f"{seconds:.0f}"])
            console.print(" | ".join(rows[-1]), soft_wrap=True)
    if arguments.docs:
        replace_block("solid", markdown_table(HEADER, rows))


if __name__ == "__main__":
    main()
