"""The lowest mode of a compressed column: extrapolated to zero it gives Euler's load."""

import numpy as np

import pdsurrogate as pds

length, height, modulus = 2.0, 0.2, 900 / 301  # E = 9 K mu/(3 K + mu) with mu = 1, K = 100
euler = np.pi**2 * modulus * height**3 / 12 / (4 * length**2)  # clamped below, free above
scene = pds.Scene(
    name="column",
    spacing=0.02,
    body=pds.shapes.Rectangle(size=(length, height)),
    material=pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=100.0),
    prescribed=(pds.Prescribed(region="left", x1=0.0, x2=0.0),),
    loads=(pds.Load(region="right", traction=(-euler / height, 0.0)),),
    steps=(0.3, 0.6),
)
result = pds.simulate(scene, "bond-energy")
values = [result.lowest_mode(level=level).eigenvalue for level in (0, 1)]
factor = 0.3 + 0.3 * values[0] / (values[0] - values[1])  # where the stiffness vanishes
print(f"critical load {factor:.3f} of Euler's")
assert abs(factor - 1) < 0.03  # ten points through the thickness: 2 % too stiff
