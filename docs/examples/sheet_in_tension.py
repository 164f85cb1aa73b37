"""Uniaxial tension: the stress of a built-in scene against the law of incompressible rubber."""

import pdsurrogate as pds

stretch = 1.5
rubber = pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=1e5)
scene = pds.load_scene("uniaxial", spacing=0.1, stretches=stretch, material=rubber)
stress = pds.simulate(scene, "analytic").levels[-1]["nominal_stress"]

# P = mu (l - 1/l^2) holds for K/mu without limit; at 1e5 the difference is of the order of mu/K.
exact = stretch - stretch**-2
print(f"nominal stress {stress:.5f}, incompressible law {exact:.5f}")
assert abs(stress / exact - 1) < 1e-4
