"""Plane strain of nearly incompressible rubber between rollers: no locking."""

import pdsurrogate as pds

scene = pds.Scene(
    name="long-body",
    plane="strain",
    spacing=0.1,
    body=pds.shapes.Rectangle(size=(1.0, 1.0)),
    material=pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=1e4),
    prescribed=(
        pds.Prescribed(region="left", x1=0.0),
        pds.Prescribed(region="bottom", x2=0.0),
        pds.Prescribed(region="right", x1=0.3),
    ),
    steps=(1.0,),
)
force = pds.simulate(scene).levels[-1]["forces"]["right"][0]

# Incompressible: l2 = 1/l1, P = mu (l - l^-3).
exact = 1.3 - 1.3**-3
print(f"force {force:.5f}, exact {exact:.5f}")
assert abs(force / exact - 1) < 1e-3  # mu/K, and the solver
