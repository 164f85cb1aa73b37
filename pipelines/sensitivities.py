"""Sensitivities of equilibria: agreement with differences of converged runs, and cost, into
docs/validation/sensitivities.md.

python pipelines/sensitivities.py [newton] [sensitivities] [torch-fem]   print tables, of cases in
processes of their own python pipelines/sensitivities.py --docs                                 and
put them into the documentation

Times are processor times of one thread, without compilation. Memory is the greatest resident size
of the process, libraries included. Differences are central ones of runs converged to 1e-10, over
one and two changes of a parameter, extrapolated (Richardson), so that their own error is of fourth
order. They are taken on coarser bodies than the costs.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pages import markdown_table, report

import pdsurrogate as pds
from pdsurrogate.forces import InternalForce
from pdsurrogate.materials.homogeneous import uniaxial
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.results.provenance import processor
from pdsurrogate.run.parameters import array_of, numbers_in, with_numbers
from pdsurrogate.scenes.reading import apply_change, leaves

CHANGE, CHANGE_OF_K = 1e-3, 1e-2
"""Changes of a parameter in the differences of runs, relative to its value or to the greatest
number of its list or array, and those of a bulk modulus, on which nearly incompressible bodies
depend so little that residuals of 1e-10 need the greater one. Chosen: the results of both and of a
third of them agree to 5e-7 of the derivatives by K and to 1e-8 of the others.
"""

CONVERGED = {"solver.method": "newton", "solver.tolerance": 1e-10, "precision": "float64"}

SIDE_AND_UP = {"probes": [{"name": "side", "at": [0.45, 0.0]}, {"name": "up", "at": [0.0, 0.6]}]}
MEASURED = ["nominal_stress", "forces", "probes.side.displacement"]


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
        Spacing of the run that loads all kernels before the measurement, and of the comparison with
        differences of runs.
    """

    what: str
    scene: Any
    changes: dict
    force: str
    parameters: list[str]
    outputs: list[str] = field(default_factory=lambda: MEASURED)
    coarse: float = 0.1

    def load(self, **more) -> pds.Scene:
        changes = self.changes | more
        return (
            pds.load_scene(self.scene, changes)
            if isinstance(self.scene, str)
            else pds.Scene.model_validate(self.scene | changes)
        )


def numbers(key: str, *places) -> list[str]:
    """Names of numbers of one array."""
    return [f"{key}.{place}" for place in places]


OGDEN = {
    "law": "ogden",
    "moduli": [1.4911, 0.00284, -0.02367],
    "exponents": [1.3, 5.0, -2.0],
    "bulk_modulus": 100.0,
}
TERMS = {
    "law": "polyconvex",
    "bulk_modulus": 100.0,
    "first": [0.3, 0.01, 1e-3, 1e-4],
    "second": [0.05, 1e-3, 1e-4],
    "roots": [0.2, 0.1],
}
OF_OGDEN = [
    *numbers("material.moduli", 0, 1, 2),
    *numbers("material.exponents", 0, 1, 2),
    "material.bulk_modulus",
]
OF_TERMS = [
    *numbers("material.first", 0, 1, 2, 3),
    *numbers("material.second", 0, 1, 2),
    *numbers("material.roots", 0, 1),
    "material.bulk_modulus",
]
OF_ISOCHORIC = [
    "material.shear_modulus",
    "material.bulk_modulus",
    *numbers("force.output_weights", *range(7)),
    "force.hidden_biases.4",
]
OF_NETWORK = [
    *numbers("force.output_weights", 0, 3, 5, 8),
    *numbers("force.hidden_weights.0", 1, 4, 7),
    *numbers("force.hidden_biases", 2, 6, 9),
]
BOX = 35
"""Points along the long sides of the box of torch-fem's benchmark; five along the short one."""

SOFT = {"shear_modulus": 1000 / 2.6, "bulk_modulus": 1000 / 1.2}
"""Moduli of E = 1000 and a Poisson's ratio of 0.3."""

FEW = {"largest_increment": 1.0}
"""Increments of the stretch as in torch-fem's benchmark, which has 11: here nine."""

STRETCHED_BOX = {
    "name": "stretched-box",
    "spacing": 1 / BOX,
    "body": {"shape": "box", "size": [5 / BOX, 1.0, 1.0], "lower": [0.0, -0.5, -0.5]},
    "stretches": [10.0],
    "grips": [
        {"edge": "left", "holds": "normal"},
        {"edge": "right", "holds": "normal", "travel": 1.0},
    ],
}
NEARLY_NEO_HOOKEAN = {
    "law": "polyconvex",
    "bulk_modulus": SOFT["bulk_modulus"],
    "first": [185.0, 0.1, 1e-3, 1e-4],
    "second": [1.0, 0.02, 5e-4],
    "roots": [5.0, 5.0],
}
"""Energy in which every term contributes 0.5 to 5 % of the stress, and the first one the rest."""

ALL = [*MEASURED, "probes.up.displacement"]
COMPARED = {
    "sheet-coefficients": Case(
        "`hole`: 9 coefficients of an energy, K",
        "hole",
        {"spacing": 0.05, "material": TERMS, **SIDE_AND_UP},
        "bond-energy",
        OF_TERMS,
        ALL,
    ),
    "sheet-network": Case(
        "`hole`: 10 numbers of a learned energy",
        "hole",
        {"spacing": 0.05, "precision": "float64", **SIDE_AND_UP},
        "neo-hookean-energy",
        OF_NETWORK,
        ALL,
    ),
    "sheet-forces": Case(
        "`hole`, bond forces: Ogden's 6 numbers, K, stretch",
        "hole",
        {"spacing": 0.05, "material": OGDEN, **SIDE_AND_UP},
        "analytic",
        [*OF_OGDEN, "stretch"],
        ALL,
    ),
    "strain-network": Case(
        "`plane-strain-block`: μ, K, 8 numbers of a learned energy",
        "plane-strain-block",
        {"spacing": 0.025, "stretches": [1.3], "precision": "float64"},
        "neo-hookean-isochoric",
        OF_ISOCHORIC,
    ),
    "solid-law": Case(
        "`bonded-block`: Ogden's 6 numbers, K, stretch",
        "bonded-block",
        {"spacing": 0.0625, "material": OGDEN},
        "bond-energy",
        [*OF_OGDEN, "stretch"],
        coarse=0.125,
    ),
    "solid-network": Case(
        "`bonded-block`: μ, K, 8 numbers of a learned energy",
        "bonded-block",
        {"spacing": 0.0625, "precision": "float64"},
        "neo-hookean-isochoric",
        OF_ISOCHORIC,
        coarse=0.125,
    ),
}
BOXES = {
    "box": Case(
        "neo-Hookean: μ, K",
        STRETCHED_BOX,
        {"material": {"law": "neo-hookean", **SOFT}, "solver": FEW},
        "bond-energy",
        ["material.shear_modulus", "material.bulk_modulus"],
        ["forces.right.0"],
        coarse=1 / 7,
    ),
    "box-ten": Case(
        "sum of terms: 9 coefficients, K",
        STRETCHED_BOX,
        {"material": NEARLY_NEO_HOOKEAN, "solver": FEW},
        "bond-energy",
        OF_TERMS,
        ["forces.right.0"],
        coarse=1 / 7,
    ),
}
CASES = COMPARED | BOXES


def most_memory() -> float:
    """Greatest resident size of this process so far, MB; `getrusage` would count that of the
    process that started this one as well.
    """
    status = Path("/proc/self/status").read_text("utf-8")
    return int(status.partition("VmHWM:")[2].split()[0]) / 1e3


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
    array, known = array_of(parameter, models), numbers_in(scene, models)
    if parameter == "stretch":
        value = scene.stretches[-1]
        step = CHANGE * (value - 1)
    else:
        value, owner = known[parameter], parameter.rpartition(".")[0]
        alike = [
            abs(known[name])
            for name in known
            if name.rpartition(".")[0] == owner and parameter[-1].isdigit()
        ] or [abs(value)]
        step = (CHANGE_OF_K if parameter.endswith("bulk_modulus") else CHANGE) * (
            max(alike) if array is None else np.abs(array).max()
        )
        # coefficients of an energy stay positive
        step = step if array is not None else min(step, abs(value) / 4)
    found = {}
    for change in (-2, -1, 1, 2):
        if parameter == "stretch":
            changed, used = (
                case.load(spacing=case.coarse, stretches=[value + change * step]),
                models,
            )
        else:
            changed, used = with_numbers(scene, models, {parameter: value + change * step})
        if array is not None:  # with other numbers the model no longer has its stated errors
            used = [
                replace(model, stated=dict(model.stated) | {"rms": 1.0, "max": 1.0})
                for model in used
            ]
        data = changed.model_dump(mode="json")
        for key, setting in CONVERGED.items():
            apply_change(data, key, setting)
        row = dict(leaves(pds.simulate(pds.Scene.model_validate(data), used[0]).levels[-1]))
        found[change] = np.array([row[name] for name in names])
    near, far = (found[1] - found[-1]) / (2 * step), (found[2] - found[-2]) / (4 * step)
    return (4 * near - far) / 3


def exact_reaction(case: Case, scene: pds.Scene, parameter: str) -> float:
    """Derivative of the box's reaction: the area is 1, so that it is the nominal stress of
    uniaxial tension.
    """
    models = checked_models(scene, pds.load_surrogate(case.force))
    value = numbers_in(scene, models)[parameter]
    sides = [
        with_numbers(scene, models, {parameter: value * (1 + side)})[0].law()
        for side in (-2e-2, -1e-2, 1e-2, 2e-2)
    ]
    far, near, after, beyond = (uniaxial(law, scene.stretches[-1]).nominal_stress for law in sides)
    return (8 * (after - near) - (beyond - far)) / (12e-2 * value)


def measure(name: str) -> None:
    """Measure a case, and print what was found."""
    case = CASES[name]
    small = pds.simulate(case.load(spacing=case.coarse), case.force)
    of_small = small.sensitivity(case.outputs, case.parameters)
    scene = case.load()
    result, seconds, evaluations = timed(lambda: pds.simulate(scene, case.force))
    held = most_memory()
    found, more_seconds, more_evaluations = timed(
        lambda: result.sensitivity(case.outputs, case.parameters)
    )
    row = {
        "points": len(result.body.points),
        "outputs": len(found.outputs),
        "equilibrium": [seconds, evaluations, held],
        "sensitivity": [more_seconds, more_evaluations, most_memory()],
    }
    off = []
    for number, parameter in enumerate(case.parameters):
        if name in BOXES:
            mine, expected = (
                found.derivatives[:, number],
                np.array([exact_reaction(case, result.scene, parameter)]),
            )
        else:
            mine, expected = (
                of_small.derivatives[:, number],
                by_runs(case, small.scene, of_small.outputs, parameter),
            )
        off.append(float(np.abs(mine - expected).max() / np.abs(expected).max()))
        print(f"{parameter}: {off[-1]:.1e}", file=sys.stderr, flush=True)
    print("FOUND " + json.dumps(row | {"off": max(off)}))


def measured(name: str) -> dict:
    """What `measure` finds in a process of its own, with one thread."""
    command = [sys.executable, "-W", "ignore", __file__, "--measure", name]
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment)
    return json.loads(
        next(line for line in done.stdout.splitlines() if line.startswith("FOUND")).removeprefix(
            "FOUND "
        )
    )


HEADER = [
    *(
        "scene and parameters",
        "points",
        "outputs x parameters",
        "greatest difference",
        "force evaluations",
    ),
    *(
        "equilibrium (s)",
        "derivatives (s)",
        "ratio",
        "equilibrium (MB)",
        "with derivatives (MB)",
        "ratio",
    ),
]


def row_of(name: str) -> list[str]:
    """Row of the table for a case."""
    found = measured(name)
    (seconds, evaluations, held), (more_seconds, more_evaluations, most) = (
        found["equilibrium"],
        found["sensitivity"],
    )
    return [
        CASES[name].what,
        f"{found['points']:,}",
        f"{found['outputs']} x {len(CASES[name].parameters)}",
        f"{found['off']:.0e}",
        f"{evaluations}, {more_evaluations}",
        *(f"{number:.2f}" for number in (seconds, more_seconds, more_seconds / seconds)),
        *(f"{held:.0f}", f"{most:.0f}", f"{most / held:.2f}"),
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
        residuals = [
            row["residual"] for row in result.convergence if row.get("residual") is not None
        ]
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
    return markdown_table(
        ["scene, bond-energy", "points", "residuals from 1e-3 on", "iterations"], rows
    )


def of_cases(cases: dict[str, Case]) -> str:
    """The table of some cases, each measured in a process of its own."""
    rows = []
    for name in cases:
        rows.append(row_of(name))
        print(*rows[-1], sep=" | ", flush=True)
    return f"Processor: {processor()}.\n\n{markdown_table(HEADER, rows)}"


if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[1] == "--measure":
        measure(sys.argv[2])
    else:
        report(
            __doc__,
            {
                "newton": newton,
                "sensitivities": lambda: of_cases(COMPARED),
                "torch-fem": lambda: of_cases(BOXES),
            },
        )
