"""A kinked cut of two pieces is one crack with one tip, whose energy release rate is known."""

import pdsurrogate as pds

stretch, height = 1.5, 2.0
scene = pds.Scene(
    name="kinked",
    spacing=0.1,
    body=pds.shapes.Rectangle(size=(8.0, height)),
    precuts=(
        {"start": (0.0, 0.5), "end": (1.0, 1.0)},
        {"start": (1.0, 1.0), "end": (4.0, 1.0)},
    ),
    material=pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=1e4),
    grips=({"edge": "bottom"}, {"edge": "top", "travel": 1.0}),
    stretches=(stretch,),
)
(crack,) = pds.simulate(scene, "bond-energy").levels[-1]["cracks"]
print(f"tip {crack['tip']}, length {crack['length']:.3f}, G {crack['energy_release_rate']:.4f}")

# Far behind the tip the strip is slack, far ahead in pure shear: a crack that advances moves this
# state along the strip, whatever its beginning. G = psi h, psi = mu/2 (l^2 + l^-2 - 2).
exact = height * (stretch**2 + stretch**-2 - 2) / 2
assert abs(crack["energy_release_rate"] / exact - 1) < 0.02  # a strip four times as long as high
