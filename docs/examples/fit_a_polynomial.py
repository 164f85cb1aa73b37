"""A polynomial learns the bond force of Yeoh's law and replaces it in a simulation."""

import pdsurrogate as pds

law = pds.materials.Yeoh(shear_modulus=1.0, bulk_modulus=1e4, second=0.01, third=1e-4)
samples = pds.training_samples(law, 2000, (0.5, 2.5), random_state=0)
polynomial = pds.learning.ChebyshevRegressor((8, 4))
model = pds.surrogate_pipeline(polynomial, features="isochoric").fit(samples.X, samples.y)
scene = pds.load_scene("uniaxial", spacing=0.1, stretches=2.0, material=law)
stress = pds.simulate(scene, model).levels[-1]["nominal_stress"]

# Incompressible: P = 2 W1 (l - l^-2), 2 W1 = mu (1 + 2 a x + 3 b x^2), x = l^2 + 2/l - 3 = 2.
exact = (1 + 2 * 0.01 * 2 + 3 * 1e-4 * 2**2) * (2.0 - 2.0**-2)
print(f"stress {stress:.5f}, exact {exact:.5f}")
assert abs(stress / exact - 1) < 1e-3  # mu/K, and the error of the fit
