"""Points in an irregular cloud instead of rows: the same stress of the same rubber."""

import pdsurrogate as pds

changes = {"spacing": 0.1, "stretches": 1.5, "body.arrangement": "relaxed", "body.seed": 1}
rubber = pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=1e4)
scene = pds.load_scene("uniaxial", {**changes, "material": rubber})
level = pds.simulate(scene, "bond-energy").levels[-1]

# P = mu (l - 1/l^2). docs/guide/cracks.md: within 0.12 % of the stress on a lattice.
exact = 1.5 - 1.5**-2
print(f"nominal stress {level['nominal_stress']:.5f}, exact {exact:.5f}")
assert abs(level["nominal_stress"] / exact - 1) < 2e-3
