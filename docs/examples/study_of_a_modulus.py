"""A study: one scene with several values of parameters, in one table."""

import tempfile

import pdsurrogate as pds

study = {
    "scene": "uniaxial",
    "force": "analytic",
    "set": {"spacing": 0.2, "material.bulk_modulus": 1e5},
    "parameters": {"stretches": [1.5, 2.0], "material.shear_modulus": [1.0, 2.0]},
}
with tempfile.TemporaryDirectory() as folder:
    done = pds.study(study, folder, jobs=1)
for row in done.rows:
    print(row["stretches"], row["material.shear_modulus"], row["nominal_stress"])

# P = mu (l - l^-2), incompressible; K/mu is at least 5e4.
last = done.rows[-1]
exact = last["material.shear_modulus"] * (last["stretches"] - last["stretches"] ** -2)
assert abs(last["nominal_stress"] / exact - 1) < 1e-3
