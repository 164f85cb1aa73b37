"""A traction on an edge: the sheet stretches until the law carries the load."""

from scipy.optimize import brentq

import pdsurrogate as pds

load = 0.8
scene = pds.Scene(
    name="loaded",
    spacing=0.1,
    body=pds.shapes.Rectangle(size=(2.0, 1.0)),
    material=pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=1e4),
    prescribed=(
        pds.Prescribed(region="left", x1=0.0),
        pds.Prescribed(region={"near": (0.0, 0.5)}, x2=0.0, name="middle"),
    ),
    loads=(pds.Load(region="right", traction=(load, 0.0)),),
    steps=(0.5, 1.0),
)
level = pds.simulate(scene, "bond-energy").levels[-1]
stretch = 1 + level["displacements"]["right"][0] / 2.0

# Incompressible neo-Hookean sheet: l - 1/l^2 = load/mu. The tolerance is that of the solver.
exact = brentq(lambda length: length - length**-2 - load, 1.0, 3.0)
print(f"stretch {stretch:.5f}, exact {exact:.5f}")
assert abs(stretch / exact - 1) < 1e-3
