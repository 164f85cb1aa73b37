"""A clamped sheet with a hole against finite elements, whose figures come with the scene."""

import pdsurrogate as pds

scene = pds.load_scene("hole", spacing=0.08)
level = pds.simulate(scene, "bond-energy").levels[-1]

# The scene has reference = "finite-elements": 0.46519 kPa, nine-node quadrilaterals, five digits.
stress, reference = level["nominal_stress"], level["nominal_stress_reference"]
print(f"stress {stress:.5f} kPa, finite elements {reference:.5f}")
assert abs(stress / reference - 1) < 2e-3  # ten points across the hole
