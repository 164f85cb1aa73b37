"""A pressure that follows the boundary: a ring in plane strain against its exact solution."""

import numpy as np

import pdsurrogate as pds

pressure, inner, outer = 0.3, 1.0, 2.0
changes = {"plane": "strain", "spacing": 0.1, "steps": [pressure], "material.bulk_modulus": 1000.0}
level = pds.simulate(pds.load_scene("ring-pressure", changes)).levels[-1]
a = inner + level["probes"]["inner"]["displacement"][0]

# Incompressible neo-Hookean tube with deformed radii a and b of the same area:
# p = mu (log(la/lb) + (lb^-2 - la^-2)/2), where la = a/A and lb = b/B.
la, lb = a / inner, np.sqrt(outer**2 + a**2 - inner**2) / outer
exact = np.log(la / lb) + (lb**-2 - la**-2) / 2
print(f"pressure {pressure}, that of the exact solution at the same inner radius {exact:.4f}")
assert abs(exact / pressure - 1) < 0.01  # ten points across the wall: second order in the spacing
