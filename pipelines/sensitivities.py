"""Sensitivities of equilibria: agreement with differences of converged runs, and cost, into docs/validation/sensitivities.md.

python pipelines/sensitivities.py [NAME ...]           print the rows of the table, by default all, each measured in a process of its own
python pipelines/sensitivities.py --docs [NAME ...]    and put them into the documentation
python pipelines/sensitivities.py newton [--docs]      the residuals of Newton's method

Times are processor times of one thread, without compilation. Memory is the greatest resident size of the process, libraries included.
Differences are central ones of runs converged to 1e-10, over 1e-3 and 2e-3 of a parameter, extrapolated (Richardson), so that their own
error is of fourth order.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pages import markdown_table, replace_block

import pdsurrogate as pds
from pdsurrogate.forces import InternalForce
from pdsurrogate.materials.homogeneous import uniaxial
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.results.provenance import processor
from pdsurrogate.run.sensitivity import array_of, numbers_in, with_numbers
from pdsurrogate.scenes.reading import leaves

CHANGE = 1e-3
"""Change of a parameter in the differences of runs, relative to its value or to the greatest number of its list or array. Chosen: residuals
of 1e-10 then leave some 1e-7 in the differences, and with Richardson's extrapolation the curvature leaves less."""

CONVERGED = {"solver.method": "newton", "solver.tolerance": 1e-10, "precision": "float64"}


@dataclass(frozen=True)
class Case:
    """Scene with parameters and outputs whose derivatives are computed.

    Attributes
    ----------
    what : str
        Name in the table.
    scene : str or dict
        Name of a built-in scene, or a whole scene.
    changes : dict
        Changes of the scene.
    force : str
    parameters : list of str
    outputs : list of str
    coarse : float
        Spacing of the run that loads all kernels before the measurement.
    compared : bool
        Whether the derivatives are compared with differences of runs.
    """

    what: str
    scene: Any
    changes: dict
    force: str
    parameters: list[str]
    outputs: list[str] = field(default_factory=lambda: ["nominal_stress", "forces"])
    coarse: float = 0.25
    compared: bool = True

    def load(self, **more) -> pds.Scene:
        changes = self.changes | more
        return pds.load_scene(self.scene, changes) if isinstance(self.scene, str) else pds.Scene.model_validate(self.scene | changes)


def numbers(key: str, *places) -> list[str]:
    """Names of numbers of one array."""
    return [f"{key}.{place}" for place in places]


OGDEN = {"law": "ogden", "moduli": [1.4911, 0.00284, -0.02367], "exponents": [1.3, 5.0, -2.0], "bulk_modulus": 100.0}
TERMS = {"law": "polyconvex", "bulk_modulus": 100.0, "first": [0.3, 0.01, 1e-3, 1e-4], "second": [0.05, 1e-3, 1e-4], "roots": [0.2, 0.1]}
OF_OGDEN = [*numbers("material.moduli", 0, 1, 2), *numbers("material.exponents", 0, 1, 2), "material.bulk_modulus"]
OF_TERMS = [
    *numbers("material.first", 0, 1, 2, 3),
    *numbers("material.second", 0, 1, 2),
    *numbers("material.roots", 0, 1),
    "material.bulk_modulus",
]
PROBES = {"probes": [{"name": "side", "at": [0.45, 0.0]}, {"name": "up", "at": [0.0, 0.6]}]}
BOX = 35
"""Points along the long sides of the box of torch-fem's benchmark; five along the short one."""

SOFT = {"shear_modulus": 1000 / 2.6, "bulk_modulus": 1000 / 1.2}
"""Moduli of E = 1000 and a Poisson's ratio of 0.3."""

STRETCHED_BOX = {
    "name": "stretched-box",
    "spacing": 1 / BOX,
    "body": {"shape": "box", "size": [5 / BOX, 1.0, 1.0], "lower": [0.0, -0.5, -0.5]},
    "stretches": [10.0],
    "grips": [{"edge": "left", "holds": "normal"}, {"edge": "right", "holds": "normal", "travel": 1.0}],
}
SMALL_TERMS = {
    "law": "polyconvex",
    "bulk_modulus": SOFT["bulk_modulus"],
    "first": [SOFT["shear_modulus"] / 2, 1e-9, 1e-10, 1e-11],
    "second": [1e-6, 1e-8, 1e-10],
    "roots": [1e-6, 1e-6],
}

CASES = {
    "sheet-coefficients": Case(
        "`hole`, plane stress: 9 coefficients of an energy and K",
        "hole",
        {"spacing": 0.05, "material": TERMS, **PROBES},
        "bond-energy",
        OF_TERMS,
        ["nominal_stress", "forces", "probes.side.displacement", "probes.up.displacement"],
    ),
    "sheet-network": Case(
        "`hole`, plane stress: 10 weights and biases of a network",
        "hole",
        {"spacing": 0.05, "precision": "float64", **PROBES},
        "neo-hookean-energy",
        [
            *numbers("force.output_weights", 0, 3, 5, 8),
            *numbers("force.hidden_weights.0", 1, 4, 7),
            *numbers("force.hidden_biases", 2, 6, 9),
        ],
        ["nominal_stress", "forces", "probes.side.displacement", "probes.up.displacement"],
    ),
    "sheet-forces": Case(
        "`hole`, plane stress, bond forces without energy: Ogden's 7 numbers, stretch",
        "hole",
        {"spacing": 0.05, "material": OGDEN, **PROBES},
        "analytic",
        [*OF_OGDEN, "stretch"],
        ["nominal_stress", "forces", "probes.side.displacement", "probes.up.displacement"],
    ),
    "strain-network": Case(
        "`plane-strain-block`: μ, K, 8 weights of a network",
        "plane-strain-block",
        {"spacing": 0.025, "stretches": [1.3], "precision": "float64"},
        "neo-hookean-isochoric",
        ["material.shear_modulus", "material.bulk_modulus", *numbers("force.output_weights", *range(8))],
        ["nominal_stress", "forces", "probes.side.displacement"],
    ),
    "solid-law": Case(
        "`bonded-block`: Ogden's 7 numbers, stretch",
        "bonded-block",
        {"spacing": 0.0625, "material": OGDEN},
        "bond-energy",
        [*OF_OGDEN, "stretch"],
        ["nominal_stress", "forces", "probes.side.displacement"],
    ),
    "solid-network": Case(
        "`bonded-block`: μ, K, 8 weights of a network",
        "bonded-block",
        {"spacing": 0.0625, "precision": "float64"},
        "neo-hookean-isochoric",
        ["material.shear_modulus", "material.bulk_modulus", *numbers("force.output_weights", *range(8))],
        ["nominal_stress", "forces", "probes.side.displacement"],
    ),
    "box": Case(
        "box of 5 x 35 x 35 points to a stretch of 10: μ, K",
        STRETCHED_BOX,
        {"material": {"law": "neo-hookean", **SOFT}},
        "bond-energy",
        ["material.shear_modulus", "material.bulk_modulus"],
        ["forces.right.0"],
        coarse=1 / 7,
        compared=False,
    ),
    "box-ten": Case(
        "the same: 9 coefficients of an energy and K",
        STRETCHED_BOX,
        {"material": SMALL_TERMS},
        "bond-energy",
        OF_TERMS,
        ["forces.right.0"],
        coarse=1 / 7,
        compared=False,
    ),
}


def most_memory() -> float:
    """Greatest resident size of this process so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


class Counted:
    """Number of evaluations of all internal forces within a ``with`` block."""

    def __enter__(self) -> Counted:
        self._evaluate, self.evaluations = InternalForce.__call__, 0

        def evaluate(force: InternalForce, positions: np.ndarray, out: np.ndarray) -> None:
            self.evaluations += 1
            self._evaluate(force, positions, out)

        InternalForce.__call__ = evaluate
        return self

    def __exit__(self, *_) -> None:
        InternalForce.__call__ = self._evaluate


def timed(work: Callable) -> tuple[Any, float, int]:
    """Result of `work`, seconds of the processor, and force evaluations."""
    with Counted() as counted:
        began = time.process_time()
        found = work()
        return found, time.process_time() - began, counted.evaluations


def by_runs(case: Case, scene: pds.Scene, names: tuple[str, ...], parameter: str) -> np.ndarray:
    """Derivatives of measurements by a parameter, from four runs."""
    models = checked_models(scene, pds.load_surrogate(case.force))
    array, owner = array_of(parameter, models), parameter.rpartition(".")[0]
    value = scene.stretches[-1] if parameter == "stretch" else numbers_in(scene, models)[parameter]
    step = CHANGE * (abs(value) if array is None else float(np.abs(array).max()))
    if parameter == "stretch":
        step = CHANGE * (value - 1)
    elif array is None and parameter.rpartition(".")[2].isdigit():
        known = numbers_in(scene, models)
        step = CHANGE * max(abs(known[name]) for name in known if name.rpartition(".")[0] == owner)
        step = min(step, abs(value) / 4)
    found = {}
    for change in (-2, -1, 1, 2):
        if parameter == "stretch":
            changed, used = case.load(stretches=[value + change * step]), models
        else:
            changed, used = with_numbers(scene, models, {parameter: value + change * step})
        if array is not None:
            used = [replace(model, stated=dict(model.stated) | {"rms": 1.0, "max": 1.0}) for model in used]
        result = pds.simulate(pds.load_scene(changed, CONVERGED), used[0])
        row = dict(leaves(result.levels[-1]))
        found[change] = np.array([row[name] for name in names])
    near, far = (found[1] - found[-1]) / (2 * step), (found[2] - found[-2]) / (4 * step)
    return (4 * near - far) / 3


def measure(name: str, compared: bool) -> None:
    """Measure a case, and print what was found."""
    case = CASES[name]
    pds.simulate(case.load(spacing=case.coarse), case.force).sensitivity(case.outputs, case.parameters)
    at_first, scene = most_memory(), case.load()
    result, seconds, evaluations = timed(lambda: pds.simulate(scene, case.force))
    held = most_memory()
    found, more_seconds, more_evaluations = timed(lambda: result.sensitivity(case.outputs, case.parameters))
    row = {
        "points": len(result.body.points),
        "outputs": len(found.outputs),
        "parameters": len(case.parameters),
        "equilibrium_s": seconds,
        "equilibrium_evaluations": evaluations,
        "sensitivity_s": more_seconds,
        "sensitivity_evaluations": more_evaluations,
        "loaded_MB": at_first,
        "equilibrium_MB": held,
        "sensitivity_MB": most_memory(),
    }
    if case.compared and compared:
        off = []
        for number, parameter in enumerate(case.parameters):
            expected = by_runs(case, result.scene, found.outputs, parameter)
            off.append(float(np.abs(found.derivatives[:, number] - expected).max() / np.abs(expected).max()))
            print(f"{parameter}: {off[-1]:.1e}", file=sys.stderr, flush=True)
        row["off"] = max(off)
    elif not case.compared:
        # The reaction is the nominal stress of uniaxial tension times the area, which is 1; its derivatives are those by the law's numbers.
        off = []
        for number, parameter in enumerate(case.parameters):
            models = checked_models(result.scene, pds.load_surrogate(case.force))
            value = numbers_in(result.scene, models)[parameter]
            sides = [with_numbers(result.scene, models, {parameter: value * (1 + side)})[0].law() for side in (-2e-4, -1e-4, 1e-4, 2e-4)]
            far, near, next_to, beyond = (uniaxial(law, result.scene.stretches[-1]).nominal_stress for law in sides)
            exact = (8 * (next_to - near) - (beyond - far)) / (12e-4 * value)
            off.append(abs(float(found.derivatives[0, number] / exact - 1)))
            print(f"{parameter}: {found.derivatives[0, number]:.9g} {exact:.9g}", file=sys.stderr, flush=True)
        row["off"] = max(off)
    print("FOUND " + json.dumps(row))


def measured(name: str, compared: bool) -> dict:
    """What `measure` finds in a process of its own, with one thread."""
    command = [sys.executable, "-W", "ignore", __file__, "--measure", name] + [] * compared + ["--quick"] * (not compared)
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment)
    return json.loads(next(line for line in done.stdout.splitlines() if line.startswith("FOUND")).removeprefix("FOUND "))


def row_of(name: str, compared: bool) -> list[str]:
    """Row of the table for a case."""
    found = measured(name, compared)
    evaluations = f"{found['equilibrium_evaluations']} / {found['sensitivity_evaluations']}"
    return [
        CASES[name].what,
        f"{found['points']:,}",
        f"{found['outputs']} x {found['parameters']}",
        f"{found['off']:.0e}" if "off" in found else "",
        evaluations,
        f"{found['equilibrium_s']:.2f}",
        f"{found['sensitivity_s']:.2f}",
        f"{found['sensitivity_s'] / found['equilibrium_s']:.2f}",
        f"{found['equilibrium_MB']:.0f}",
        f"{found['sensitivity_MB']:.0f}",
        f"{found['sensitivity_MB'] / found['equilibrium_MB']:.2f}",
    ]


HEADER = [
    *("scene and parameters", "points", "outputs x parameters", "off", "evaluations, equilibrium / derivatives", "equilibrium (s)"),
    *("derivatives (s)", "time, ratio", "equilibrium (MB)", "with derivatives (MB)", "memory, ratio"),
]


def newton() -> str:
    """Residuals of Newton's method from 1e-3, in units of shear modulus / spacing."""
    rows = []
    for name, changes in (
        ("uniaxial", {"stretches": [1.5]}),
        ("uniaxial", {"stretches": [2.5]}),
        ("bonded-block", {}),
        ("hole", {"spacing": 0.05}),
    ):
        scene = pds.load_scene(name, {**changes, **CONVERGED})
        result = pds.simulate(scene, "bond-energy")
        residuals = [row["residual"] for row in result.convergence if row.get("residual") is not None]
        below = [residual for residual in residuals if residual < 1e-3]
        rows.append(
            [
                f"`{name}` to {scene.stretches[-1]:g}",
                f"{len(result.body.points):,}",
                ", ".join(f"{value:.0e}" for value in below),
                str(len(below) - 1),
            ]
        )
        print(*rows[-1], sep=" | ", flush=True)
    return markdown_table(["scene, bond-energy", "points", "residuals from 1e-3 on", "iterations"], rows)


def main(names: list[str], docs: bool, compared: bool) -> None:
    """Measure cases one after another, and print the table or put it into the documentation."""
    if "newton" in names or not names:
        text = newton()
        print(text)
        if docs:
            replace_block("newton", text)
    for block, chosen in (("sensitivities", [name for name in CASES if not name.startswith("box")]), ("torch-fem", ["box", "box-ten"])):
        wanted = [name for name in chosen if not names or name in names]
        rows = []
        for name in wanted:
            rows.append(row_of(name, compared))
            print(*rows[-1], sep=" | ", flush=True)
        if docs and wanted == chosen:
            replace_block(block, f"Processor: {processor()}.\n\n{markdown_table(HEADER, rows)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of newton, {', '.join(CASES)}; by default all")
    parser.add_argument("--docs", action="store_true", help="put complete tables into the documentation")
    parser.add_argument("--quick", action="store_true", help="leave out the differences of runs")
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if unknown := set(given.names) - {"newton", *CASES}:
        parser.error(f"there is no case {', '.join(unknown)}; there are newton, {', '.join(CASES)}")
    if given.measure:
        measure(given.measure, not given.quick)
    else:
        main(given.names, given.docs, not given.quick)
