"""Scenes with loads and several regions against reference solutions, at several spacings.

python pipelines/loading_report.py                    all scenes, to the finest spacing that the table names
python pipelines/loading_report.py --quick            the two coarsest spacings of each
python pipelines/loading_report.py SCENE ...          some of them
python pipelines/loading_report.py --docs           and put the table into the documentation

Reference figures: finite elements (nine-node quadrilaterals on graded meshes, three-field in plane strain; change in the last refinement
0.02 % or less, 0.15 % for the pressed block) and, for the ring, the radial equation of equilibrium to 1e-10.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from pages import markdown_table, replace_block
from rich.console import Console

import pdsurrogate as pds

console = Console()


@dataclass(frozen=True)
class Case:
    """A run, and what is read from its last levels.

    Attributes
    ----------
    scene : str
    changes : dict
        Of the scene.
    level : int
    measures : dict
        By name: function of the level and its value by the reference.
    force : str, optional
    spacings : tuple of float
        From coarse to fine.
    """

    scene: str
    level: int
    measures: dict[str, tuple[Callable[[dict], float], float]]
    changes: dict = field(default_factory=dict)
    force: str | None = None
    spacings: tuple[float, ...] = (0.08, 0.04, 0.02667, 0.02)


def radial(*names: str) -> Callable[[dict], float]:
    """Mean radial displacement of probes on a ring."""

    def measure(level: dict) -> float:
        found = []
        for name in names:
            angle = np.pi / 4 if name.endswith("diagonal") else 0.0
            found.append(np.dot(level["probes"][name]["displacement"], [np.cos(angle), np.sin(angle)]))
        return float(np.mean(found))

    return measure


def moved(probe: str, axis: int) -> Callable[[dict], float]:
    """Displacement of a probe along an axis."""
    return lambda level: level["probes"][probe]["displacement"][axis]


def force(region: str, axis: int) -> Callable[[dict], float]:
    """Force on a region along an axis."""
    return lambda level: level["forces"][region][axis]


INNER, OUTER = radial("inner", "inner-diagonal"), radial("outer", "outer-diagonal")


def ring(level: int, inner: float, outer: float, **changes) -> Case:
    """The ring at one of its pressures."""
    return Case("ring-pressure", level, {"inner radius": (INNER, inner), "outer radius": (OUTER, outer)}, changes)


def block(bulk_modulus: float, level: int, reaction: float, side: float) -> Case:
    """The block in plane strain, for an energy."""
    measures = {"force": (force("top", 1), reaction), "bulge": (moved("side", 0), side)}
    changes = {"material.bulk_modulus": bulk_modulus}
    return Case("plane-strain-block", level, measures, changes, "bond-energy", (1 / 16, 1 / 24, 1 / 32, 0.02))


HOLE = (0.04, 0.02667, 0.02, 0.01333)
"""From 50 points a side on: with 25 the hole is less than four cells in radius, hardly more than a horizon, and two errors of opposite sign
cancel along parts of its boundary."""

FOLLOWED = {"steps": [{"to": to, "control": "probes.inner.displacement.0"} for to in (1.0, 3.5, 5.0)]}

UNDEFORMED = {"loads.0.thickness": "undeformed"}

CASES = {
    "ring, p = 0.1": ring(0, 0.0791810720304842, 0.0497205459671277),
    "ring, p = 0.2": ring(1, 0.17570573731518957, 0.11259074746266551),
    "ring, p = 0.3": ring(2, 0.29766196909141773, 0.19526067243562162),
    **{
        f"ring, inner boundary moved by {to}": Case(
            "ring-pressure", level, {"pressure": (lambda found: found["t"], pressure)}, FOLLOWED, "bond-energy", (0.1, 0.05, 0.02)
        )
        for level, (to, pressure) in enumerate({1.0: 0.5816745356708811, 3.5: 0.7164287438005016, 5.0: 0.7039650505025816}.items())
    },
    "ring, undeformed thickness, p = 0.3": ring(2, 0.312205280106131, 0.2053426967496, **UNDEFORMED),
    "ring, plane strain, p = 0.1": ring(0, 0.07372065726592725, 0.03813612020337542, plane="strain"),
    "ring, plane strain, p = 0.2": ring(1, 0.1650460507436997, 0.08803956655629719, plane="strain"),
    "ring, plane strain, p = 0.3": ring(2, 0.2829626849976654, 0.15651257327381085, plane="strain"),
    "biaxial hole (1.5, 1.5)": Case(
        "biaxial-hole",
        0,
        {"stress": (force("right", 0), 2 * 1.1323729165387342), "hole": (moved("hole-x1", 0), 0.43987790023302137)},
        spacings=HOLE,
    ),
    "biaxial hole (1.5, 1.2)": Case(
        "biaxial-hole",
        1,
        {
            "stress 11": (force("right", 0), 2 * 1.0640606504741994),
            "stress 22": (force("top", 1), 2 * 0.7505685245970383),
            "hole along x1": (moved("hole-x1", 0), 0.40775422029908365),
            "hole along x2": (moved("hole-x2", 1), 0.2323091066112491),
        },
        spacings=HOLE,
    ),
    "cantilever, q = 0.02": Case("traction", 0, {"deflection": (moved("tip", 1), -0.2530964262855094)}),
    "cantilever, q = 0.05": Case("traction", 1, {"deflection": (moved("tip", 1), -0.6055554970222996)}),
    "hanging, b = 0.3": Case("hanging", 0, {"elongation": (moved("lower-end", 1), -0.5456434975204609)}),
    "hanging, b = 0.65": Case("hanging", 1, {"elongation": (moved("lower-end", 1), -1.4876044948678295)}),
    "two materials": Case(
        "bimaterial",
        0,
        {"stress": (force("right", 0), 1.4891826605531446), "interface": (moved("interface", 0), 2.7048027829575614 - 1.5)},
        spacings=(0.1, 0.05, 0.03, 0.02),  # no points on the interface
    ),
    "block, K = 100, +30 %": block(100.0, 1, 2.812458152089511, 0.3029922374600646),
    "block, K = 1000, +30 %": block(1000.0, 1, 2.8908411623763897, 0.3151024256789341),
    "block, K = 100, -5 %": block(100.0, 0, -0.8269604334297689, -0.06667055905064011),
    "block, K = 1000, -5 %": block(1000.0, 0, -0.8646925933626515, -0.07029595896528681),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", metavar="SCENE")
    parser.add_argument("--quick", action="store_true", help="the two coarsest spacings alone")
    parser.add_argument("--docs", action="store_true", help="put the table into the documentation")
    parser.add_argument("--force", help="instead of each case's own")
    arguments = parser.parse_args()
    runs, rows = {}, []
    with console.status("") as status:
        for name, case in CASES.items():
            if arguments.scenes and case.scene not in arguments.scenes:
                continue
            spacings = case.spacings[:2] if arguments.quick else case.spacings
            for measure, (read, reference) in case.measures.items():
                errors = []
                for spacing in spacings:
                    key = case.scene, repr(case.changes), arguments.force or case.force, spacing
                    if key not in runs:
                        status.update(f"{name}, spacing {spacing:g}")
                        scene = pds.load_scene(case.scene, {**case.changes, "spacing": spacing})
                        try:
                            runs[key] = pds.simulate(scene, key[2]).levels
                        except pds.SimulationFailed as error:
                            console.print(f"{name}, spacing {spacing:g}: {error}")
                            runs[key] = error.result.levels
                    levels = runs[key]
                    errors.append(f"{100 * (read(levels[case.level]) / reference - 1):+.2f}" if case.level < len(levels) else "none")
                    console.print(name, measure, spacing, errors[-1])
                rows.append([name, measure, f"{reference:.5g}", " / ".join(f"{spacing:.4g}" for spacing in spacings), " / ".join(errors)])
    table = markdown_table(["case", "quantity", "reference", "spacing (cm)", "error (%)"], rows)
    console.print(table, soft_wrap=True)
    if arguments.docs:
        replace_block("loading", table)


if __name__ == "__main__":
    main()
