"""The energy release rate of a long strip in pure shear against Rivlin's and Thomas' relation."""

import pdsurrogate as pds

stretch, height = 1.5, 2.0
scene = pds.Scene(
    name="strip",
    spacing=0.1,
    body=pds.shapes.Rectangle(size=(8.0, height)),
    precuts=({"start": (0.0, 1.0), "end": (4.0, 1.0)},),
    material=pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=1e4),
    grips=({"edge": "bottom"}, {"edge": "top", "travel": 1.0}),
    stretches=(stretch,),
)
(crack,) = pds.simulate(scene, "bond-energy").levels[-1]["cracks"]

# G = psi h, with psi = mu/2 (l^2 + l^-2 - 2) in pure shear of an incompressible sheet.
exact = height * (stretch**2 + stretch**-2 - 2) / 2
print(f"G = {crack['energy_release_rate']:.4f}, psi h = {exact:.4f}")
assert abs(crack["energy_release_rate"] / exact - 1) < 0.02  # a strip four times as long as high
