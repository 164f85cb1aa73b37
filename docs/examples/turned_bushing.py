"""A bushing whose hole is turned by 20 degrees: the torque against the exact solution."""

import numpy as np

import pdsurrogate as pds

a, b, angle = 1.0, 2.0, 20.0
scene = pds.Scene(
    name="bushing",
    plane="strain",
    spacing=0.1,
    body=pds.shapes.Circle(radius=b),
    holes=(pds.shapes.Circle(radius=a),),
    material=pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=100.0),
    prescribed=(
        pds.Prescribed(region="outline", x1=0.0, x2=0.0),
        pds.Prescribed(region="holes", rotation=angle, about=(0.0, 0.0)),
    ),
    steps=(1.0,),
)
torque = pds.simulate(scene).levels[-1]["moments"]["holes"]

# Azimuthal shear keeps all radii, and the torque is linear: M = 4 pi mu angle/(a^-2 - b^-2).
# docs/guide/loading.md: within 0.1 % with ten points across the wall.
exact = 4 * np.pi * np.radians(angle) / (a**-2 - b**-2)
print(f"torque {torque:.4f}, exact {exact:.4f}")
assert abs(torque / exact - 1) < 2e-3
