"""A scene of your own: a square between rollers is stretched in both directions."""

import pdsurrogate as pds

scene = pds.Scene(
    name="biaxial",
    spacing=0.1,
    body=pds.shapes.Rectangle(size=(1.0, 1.0)),
    material=pds.materials.NeoHookean(shear_modulus=2.0, bulk_modulus=2e5),
    prescribed=(
        pds.Prescribed(region="left", x1=0.0),
        pds.Prescribed(region="bottom", x2=0.0),
        pds.Prescribed(region="right", x1=0.5),
        pds.Prescribed(region="top", x2=0.2),
    ),
    steps=(1.0,),
)
force = pds.simulate(scene, "bond-energy").levels[-1]["forces"]["right"][0]

# Incompressible neo-Hookean sheet, stretches 1.5 and 1.2, side 1: P1 = mu (l1 - l1^-3 l2^-2).
exact = 2.0 * (1.5 - 1.5**-3 * 1.2**-2)
print(f"force on the right edge {force:.5f}, exact {exact:.5f}")
assert abs(force / exact - 1) < 1e-4  # of the order of mu/K
