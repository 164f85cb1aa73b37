"""A shear modulus from a force that was measured on a body: a clamped sheet with a hole."""

import numpy as np

import pdsurrogate as pds

# Finite elements of the scene stand for the measurement: 0.46519 kPa over 3 cm at a stretch of 1.2,
# for a shear modulus of 1 kPa (pdsurrogate/scenes/fem.json). Here the rubber has 360 kPa.
measured = 360 * 0.46519 * 3.0
scene = pds.load_scene("hole", spacing=0.2, stretches=[1.2])
X, y = np.array([[1, 0, 0, 0]]), np.array([measured])  # output 1, component 0 for the force
model = pds.SceneRegressor(scene, "neo-hookean", refine=2)
model.fit(X, y, standard_deviation=[0.005 * measured])
modulus, error = model.law_.shear_modulus, model.standard_errors_[0]
print(f"shear modulus {modulus:.1f} ± {error:.1f} kPa")
assert abs(modulus - 360) < 2 * error  # the standard error, 0.5 %, is that of the measurement
