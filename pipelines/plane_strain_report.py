"""The bonded block in plane strain against finite elements: force, bulge and pressure by force model, bulk modulus and spacing.

    python pipelines/plane_strain_report.py [POINTS ...]

POINTS are numbers of points along the smaller side, 16 24 32 50 by default; the last takes some minutes, and only the selective energy is
taken so far.  The table goes into ``docs/validation/plane-strain.md``.
"""

import sys

import numpy as np
from pages import replace_block

import pdsurrogate as pds
from pdsurrogate.forces.pair_energy import PairEnergy


class PlainEnergy(PairEnergy):
    """All of the energy at the bonds, whatever holds the volume."""

    selective = False


class AllAtTheBonds(pds.BondEnergyForce):
    """The bond energy with its volumetric part at the bonds in plane strain too, where it locks: what `bond-energy` is compared with."""

    name = "bond-energy-plain"

    def terms(self, plane):
        return (PlainEnergy,)


MODELS = {"bond-energy": "bond-energy", "all in the bonds": AllAtTheBonds(), "analytic": "analytic", "nosb": "nosb"}
COLUMNS = (
    "force model",
    "K/mu",
    "points per side",
    "stretch",
    "error of the force",
    "error of the bulge",
    "checkerboard",
    "roughness",
    "evaluations",
)
MOST_OF_OTHERS = 32
"""Points a side up to which the other models are compared."""

EDGE = 3
"""Points at the edges that are left out of the figures of the pressure: it is singular in the corners."""


def pressure_figures(result) -> tuple[float, float]:
    """Of the pressure inside, over its spread: what changes sign from point to point, and all that (1 2 1)/4 along both axes takes off."""
    stress = result.states[-1][1]["stress"].reshape(-1, 3, 3)
    columns = len(np.unique(np.round(result.body.points[:, 0], 9)))
    pressure = (np.trace(stress, axis1=1, axis2=2) / 3).reshape(-1, columns)[EDGE:-EDGE, EDGE:-EDGE]

    def filtered(sign):
        rows = pressure[:-2] + sign * 2 * pressure[1:-1] + pressure[2:]
        return (rows[:, :-2] + sign * 2 * rows[:, 1:-1] + rows[:, 2:]) / 16

    spread = pressure.std()
    return np.sqrt((filtered(-1) ** 2).mean()) / spread, (pressure[1:-1, 1:-1] - filtered(1)).std() / spread


def row(name: str, bulk: float, points: int, stretch: float) -> list[str]:
    """One run, as a row of the table."""
    changes = {"material.bulk_modulus": bulk, "spacing": 1 / points, "stretches": stretch}
    start = [name, f"{bulk:g}", str(points), f"{stretch:g}"]
    try:
        result = pds.simulate(pds.load_scene("plane-strain-block", {**changes, "solver.most_evaluations": 20_000}), MODELS[name])
    except pds.SimulationFailed:
        return [*start, "no equilibrium", *["-"] * 4]
    level = result.levels[-1]
    errors = (f"{100 * level[f'{key}_error']:+.2f} %" for key in ("nominal_stress", "greatest_lateral_displacement"))
    return [*start, *errors, *(f"{figure:.4f}" for figure in pressure_figures(result)), str(result.summary["n_force_evaluations"])]


def main(sizes: list[int]) -> None:
    """Run every combination, and write the table as it grows."""
    lines = [f"| {' | '.join(COLUMNS)} |", f"|{' --- |' * len(COLUMNS)}"]
    for name in MODELS:
        for bulk in (100.0, 1000.0):
            for points in (points for points in sizes if points <= MOST_OF_OTHERS or name == "bond-energy"):
                for stretch in (0.95, 1.3):
                    lines.append(f"| {' | '.join(row(name, bulk, points, stretch))} |")
                    print(lines[-1], flush=True)
                    replace_block("plane-strain", "\n".join(lines))


if __name__ == "__main__":
    main([int(argument) for argument in sys.argv[1:]] or [16, 24, 32, 50])
