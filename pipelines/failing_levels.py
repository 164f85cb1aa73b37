"""Force evaluations of outputs that do not exist, compared with good outputs of the same run, and
of outputs that are hard to find.

python pipelines/failing_levels.py          print both tables (a minute)
python pipelines/failing_levels.py --docs   and put them into the documentation
"""

from __future__ import annotations

import numpy as np
from pages import markdown_table, report

import pdsurrogate as pds

SLENDER = {
    "body": {"shape": "rectangle", "size": [10.0, 0.4]},
    "spacing": 0.1,
    "probes": [],
    "prescribed": [{"region": "left", "x1": 0.0, "x2": 0.0}],
}
COLUMN = {
    **SLENDER,
    "loads": [{"region": "right", "traction": [-1.0, 1e-4]}],
    "steps": [5e-4, 1e-3, 0.1],
}
SHORT_COLUMN = {**COLUMN, "body": {"shape": "rectangle", "size": [4.0, 0.5]}, "steps": [0.01, 0.02]}
STILL = {"dynamics": None, "fracture": None, "reference": None}
PRESSED = {"spacing": 0.125, "stretches": [0.9, 0.8, 0.6, 0.4]}
STIFF = {
    "region": {"box": [[1.5, 0.0], [3.0, 1.0]]},
    "material": {"law": "neo-hookean", "shear_modulus": 1e3, "bulk_modulus": 1e5},
}
CROSSING = [
    {"region": "left", "x1": 0.0, "x2": 0.0},
    {"region": "right", "x1": 0.0, "x2": 0.0},
    {"region": {"box": [[1.0, 0.0], [1.15, 1.0]]}, "name": "first", "x1": 1.0},
    {"region": {"box": [[1.85, 0.0], [2.0, 1.0]]}, "name": "second", "x1": -1.0},
]

FAILING = {
    "ring beyond its greatest pressure": (
        "ring-pressure",
        {"spacing": 0.25, "steps": [0.2, 0.4, 0.6, 0.8]},
        "neo-hookean",
    ),
    "the same, `bond-energy`": (
        "ring-pressure",
        {"spacing": 0.25, "steps": [0.2, 0.4, 0.6, 0.8]},
        "bond-energy",
    ),
    "ring, to far beyond": ("ring-pressure", {"spacing": 0.2, "steps": [0.3, 1.0]}, "neo-hookean"),
    "ring, just below and just beyond": (
        "ring-pressure",
        {"spacing": 0.25, "steps": [0.3, 0.5, 0.6, 0.7, 0.74]},
        "analytic",
    ),
    "sphere beyond its greatest pressure": (
        "inflation",
        {"spacing": 0.125, "steps": [0.2, 0.4, 0.8, 1.6]},
        None,
    ),
    "sheet that buckles between grips": (
        "uniaxial",
        {"spacing": 0.1, "stretches": [0.9, 0.8, 0.6]},
        "analytic",
    ),
    "the same sheet, `bond-energy`": (
        "uniaxial",
        {"spacing": 0.1, "stretches": [0.97, 0.94, 0.91, 0.85]},
        "bond-energy",
    ),
    "column under a dead load": ("traction", SHORT_COLUMN, "analytic"),
    "the same column, `bond-energy`": ("traction", SHORT_COLUMN, "bond-energy"),
    "slender column under a dead load": ("traction", COLUMN, "analytic"),
    "bonded block that folds": ("bonded-block", PRESSED, None),
    "block in plane strain that folds": (
        "plane-strain-block",
        {"spacing": 0.1, "stretches": [0.95, 0.9, 0.8, 0.7]},
        None,
    ),
    "beyond the limit of Gent's law": (
        "gent",
        {"spacing": 0.1, "material.chain_limit": 10.0, "stretches": [2, 3, 3.5, 4, 5]},
        "bond-energy",
    ),
    "regions that cross": (
        "bimaterial",
        {
            **STILL,
            "spacing": 0.1,
            "grips": [],
            "stretches": [],
            "steps": [0.05, 0.2, 1.0],
            "prescribed": CROSSING,
        },
        "bond-energy",
    ),
    "compression of `nosb`": ("uniaxial", {"spacing": 0.1, "stretches": [0.95, 0.8, 0.5]}, "nosb"),
}
"""Runs by name whose last output does not exist: scene, changed keys and force."""

GOOD = {
    "voids, to stretch 2": (
        "voids",
        {**STILL, "spacing": 0.1, "stretches": [1.05, 1.15, 1.4, 2.0]},
        None,
    ),
    "voids, compressed to 0.5": (
        "voids",
        {**STILL, "spacing": 0.15, "stretches": [0.9, 0.8, 0.5]},
        "bond-energy",
    ),
    "tear, to stretch 2": (
        "tear",
        {**STILL, "spacing": 0.15, "stretches": [1.1, 1.4, 2.0]},
        "bond-energy",
    ),
    "bonded block, K = 1000 mu": (
        "bonded-block",
        {"spacing": 0.125, "material.bulk_modulus": 1e3, "stretches": [1.1, 1.3]},
        None,
    ),
    "plane strain, K = 10,000 mu": (
        "plane-strain-block",
        {"spacing": 0.1, "material.bulk_modulus": 1e4},
        None,
    ),
    "half a thousand times as stiff": (
        "bimaterial",
        {"spacing": 0.1, "reference": None, "materials": [STIFF]},
        None,
    ),
    "ring at 98 % of its greatest pressure": (
        "ring-pressure",
        {"spacing": 0.25, "steps": [0.3, 0.5, 0.6, 0.7]},
        "analytic",
    ),
    "the same from 0.4 to 0.62, finer": (
        "ring-pressure",
        {"spacing": 0.2, "steps": [0.4, 0.62]},
        "neo-hookean",
    ),
    "near the limit of Gent's law": (
        "gent",
        {"spacing": 0.1, "material.chain_limit": 10.0, "stretches": [2, 3, 5]},
        "analytic",
    ),
    "slender beam that bends": (
        "traction",
        {**SLENDER, "loads": [{"region": "right", "traction": [0.0, -6e-4]}], "steps": [1.0]},
        "analytic",
    ),
    "compression of `nosb` to 0.8": (
        "uniaxial",
        {"spacing": 0.1, "stretches": [0.95, 0.8]},
        "nosb",
    ),
}
"""Runs by name whose outputs are all good, some of them hard to find."""


def run(name: str, changes: dict, force: str | None) -> tuple[pds.Result, str]:
    """Return the result of a run and the message with which it failed, or "" if it did not."""
    try:
        return pds.simulate(pds.load_scene(name, changes), *[force] if force else []), ""
    except pds.SimulationFailed as error:
        return error.result, str(error)


def costs(result: pds.Result, message: str) -> tuple[list[int], int]:
    """Return the force evaluations for each good output of a run, and those after its last good
    output; of what `run` returns.
    """
    rows, ends, failing = result.convergence, {}, None
    target = next(key for key in rows[0] if key in ("stretch", "t"))
    for row in rows:
        failing = row[target] if "failure" in row else failing
        ends[row[target]] = row["evaluation"]
    found = list(ends)[: list(ends).index(failing)] if message else list(ends)
    marks = [0, *(ends[one] for one in found)]
    return np.diff(marks).tolist(), result.summary["n_force_evaluations"] - marks[-1]


def failing() -> str:
    """Return the table of runs whose last output does not exist."""
    rows = []
    for name, case in FAILING.items():
        result, message = run(*case)
        good, bad = costs(result, message)
        usual = float(np.mean(good))
        reached = message.partition("the last equilibrium was found at ")[2].partition(",")[0]
        rows.append([name, ", ".join(map(str, good)), str(bad), f"{bad / usual:.1f}", reached])
        print(*rows[-1], sep=" | ", flush=True)
    return markdown_table(
        ["run", "good outputs", "failing one", "failing / mean of good", "reached"], rows
    )


def good() -> str:
    """Return the table of runs that end well."""
    rows = []
    for name, case in GOOD.items():
        result, message = run(*case)
        rows.append(
            [name, ", ".join(str(one) for one in costs(result, message)[0]), message or "done"]
        )
        print(*rows[-1], sep=" | ", flush=True)
    return markdown_table(["run", "evaluations for each output", "end"], rows)


if __name__ == "__main__":
    report(__doc__, {"failing-levels": lambda: f"{failing()}\n\n{good()}"})
