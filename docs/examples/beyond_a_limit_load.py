"""Displacement control: the pressure in a ring at its maximum, beyond which no load can go."""

import pdsurrogate as pds

step = {"to": 3.5, "control": "probes.inner.displacement.0"}
scene = pds.load_scene("ring-pressure", spacing=0.25, steps=[0.3, step])
levels = pds.simulate(scene, "bond-energy").levels
for level in levels:
    moved = level["probes"]["inner"]["displacement"][0]
    print(f"inner boundary moved by {moved:.3f} cm: pressure {level['t']:.4f} kPa")

# The radial equation of equilibrium has 0.71643 there (docs/validation/loads.md). The lattice has
# four points across the wall.
assert abs(levels[-1]["t"] / 0.71643 - 1) < 5e-3
