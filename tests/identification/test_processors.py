"""Fits to data are those of the data: not of the kernel of OpenBLAS that a processor has, nor of
the number of threads.
"""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from threadpoolctl import threadpool_info

FITS = """
import json, warnings
import numpy as np
from threadpoolctl import threadpool_info
import pdsurrogate as pds
from pdsurrogate.calibration.measured import MeasuredScene
from pdsurrogate.calibration.scatter import Rows
from pdsurrogate.identification import MODES, nominal_stress

warnings.simplefilter("ignore")
data = pds.load_test_data("treloar")
to = np.array([0.7, 1.5, 3.0])
states = np.vstack([np.stack([to, lateral(to)], axis=1) for lateral in MODES.values()])
found = {}
for name in ("ogden", "yeoh"):
    model = pds.identification.LawRegressor(name)
    model.fit(data.stretches, data.nominal_stress, data.balanced_weights())
    found[f"identify {name}"] = model.predict(states)
for unseen, floor in (("uniaxial", 1.0), ("uniaxial", 0.05), ("equibiaxial", 0.05)):
    known = data.of(*(set(data.modes) - {unseen}))
    squares = known.nominal_stress**2
    weights = 1 / np.maximum(squares, floor * squares.max())
    model = pds.identification.EnergyRegressor().fit(known.stretches, known.nominal_stress, weights)
    found[f"fit without {unseen}, weights above {floor}"] = model.predict(states)
changes = {"spacing": 0.5, "stretches": [1.2, 1.4], "material": "neo-hookean", "reference": None}
scene = pds.load_scene("hole", changes)
steps, heights = [(step, axis) for step in (1, 2) for axis in (1, 2)], (-1.5, -0.8, 0.9, 1.6)
rows = np.array([(*step, x, y) for step in steps for x in (-1.0, 0.9) for y in heights])
rows = np.vstack([rows, [(1, 0, 0, 0), (2, 0, 0, 0)]])
law = pds.materials.Gent(0.8, 80.0, 12.0)
asked = Rows(rows[:, 0].astype(int), rows[:, 1].astype(int), rows[:, 2:])
exact = MeasuredScene(scene, asked).simulate(law)[0]
noise = np.where(rows[:, 1] > 0, 1e-3, 1e-2)
y = exact + noise * np.random.default_rng(0).standard_normal(len(rows))
model = pds.SceneRegressor(scene, None, refine=1).fit(rows, y, standard_deviation=noise)
found["calibrate --free"] = nominal_stress(model.law_, states)
blas = [one for one in threadpool_info() if one["internal_api"] == "openblas"]
kernels = sorted({one["architecture"] for one in blas})
print(json.dumps({"kernels": kernels, **{name: stress.tolist() for name, stress in found.items()}}))
"""

KERNELS = {"Haswell": "1", "Nehalem": "2"}
"""Kernels of OpenBLAS that run on any x86 processor with AVX2, and numbers of threads."""


@pytest.mark.skipif(
    not any(
        one.get("architecture") for one in threadpool_info() if one["internal_api"] == "openblas"
    ),
    reason="this NumPy has no OpenBLAS with kernels to choose from",
)
def test_stresses_are_those_of_any_kernel_and_number_of_threads():
    """Kernels and threads add in other orders, with relative differences of 1e-16: a choice among
    nearly equal fits may turn over, and then changed forecasts by more than ten percent.
    """
    found = []
    for kernel, threads in KERNELS.items():
        changes = {
            "OPENBLAS_CORETYPE": kernel,
            "OPENBLAS_NUM_THREADS": threads,
            "OMP_NUM_THREADS": threads,
            "NUMBA_NUM_THREADS": threads,
        }
        done = subprocess.run(
            [sys.executable, "-c", FITS],
            env={**os.environ, **changes},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        found.append(json.loads(done.stdout.splitlines()[-1]))
    if [one.pop("kernels") for one in found] != [[kernel] for kernel in KERNELS]:
        pytest.skip(f"OpenBLAS does not take the kernels {', '.join(KERNELS)} on this processor")
    for name, expected in found[0].items():
        np.testing.assert_allclose(found[1][name], expected, rtol=1e-6, err_msg=name)
