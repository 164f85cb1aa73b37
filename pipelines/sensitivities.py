"""Sensitivities of equilibria: agreement with differences of converged runs, and cost.

python pipelines/sensitivities.py            measures all cases, in some minutes
python pipelines/sensitivities.py network    those with such a word in their names; --help has more

Times are processor times without compilation. Differences are central ones of runs converged to
1e-10, over one and two changes of a parameter, extrapolated (Richardson), so that their own error
is of fourth order. They are taken on coarser bodies than the costs.
"""

import time
from dataclasses import replace

import numpy as np
from cases import LISTED, of_rows, report

import pdsurrogate as pds
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.run.parameters import array_of, numbers_in, with_numbers
from pdsurrogate.scenes.reading import apply_change, leaves

CHANGE, CHANGE_OF_K = 1e-3, 1e-2
"""Changes of a parameter in the differences of runs, relative to its value or to the greatest
number of its list or array, and those of a bulk modulus, on which nearly incompressible bodies
depend so little that residuals of 1e-10 need the greater one.
"""

CONVERGED = {"solver.method": "newton", "solver.tolerance": 1e-10, "precision": "float64"}


KEYS = "title", "spacings", "force", "changes", "parameters", "outputs"
CASES = [tuple(case[key] for key in KEYS) for case in LISTED["sensitivities"]]
"""Titles, spacings of the costs and of the comparison, force models, changes of the scene that the
title begins with, parameters and outputs.
"""


def by_runs(scene, force, names, parameter):
    """Derivatives of measurements by a parameter, from four runs."""
    models = checked_models(scene, pds.load_surrogate(force))
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
        changed, used = scene, models
        if parameter != "stretch":
            changed, used = with_numbers(scene, models, {parameter: value + change * step})
        if array is not None:  # with other numbers the model no longer has its stated errors
            used = [
                replace(model, stated=dict(model.stated) | {"rms": 1.0, "max": 1.0})
                for model in used
            ]
        data = changed.model_dump(mode="json")
        if parameter == "stretch":
            data["stretches"] = [value + change * step]
        for key, setting in CONVERGED.items():
            apply_change(data, key, setting)
        row = dict(leaves(pds.simulate(pds.Scene.model_validate(data), used[0]).levels[-1]))
        found[change] = np.array([row[name] for name in names])
    near, far = (found[1] - found[-1]) / (2 * step), (found[2] - found[-2]) / (4 * step)
    return (4 * near - far) / 3


def measured(title, spacings, force, changes, parameters, outputs):
    """Greatest difference of derivatives, over the greatest by the same parameter, and times."""
    fine, coarse = (
        pds.load_scene(title.split("`")[1], changes | {"spacing": spacing}) for spacing in spacings
    )
    small = pds.simulate(coarse, force)
    of_small, off = small.sensitivity(outputs, parameters), []
    for number, parameter in enumerate(parameters):
        expected = by_runs(small.scene, force, of_small.outputs, parameter)
        mine = of_small.derivatives[:, number]
        off.append(np.abs(mine - expected).max() / np.abs(expected).max())
    began = time.process_time()
    result = pds.simulate(fine, force)
    solved = time.process_time()
    found = result.sensitivity(outputs, parameters)
    times = solved - began, time.process_time() - solved
    size = f"{len(found.outputs)} x {len(parameters)}"
    yield title, len(result.body), size, max(off), *times, times[1] / times[0]


if __name__ == "__main__":
    report(
        __doc__,
        of_rows("sensitivities", measured, CASES),
    )
