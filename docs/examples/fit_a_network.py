"""A small network, trained by the Levenberg-Marquardt method, learns a bond force."""

import pdsurrogate as pds

law = pds.materials.MooneyRivlin(shear_modulus=1.0, bulk_modulus=1e4, second_share=0.2)
samples = pds.training_samples(law, 1500, (0.6, 2.5), random_state=0)
network = pds.LevenbergMarquardtRegressor((20,), "algebraic", max_iter=150, random_state=0)
model = pds.surrogate_pipeline(network, features="isochoric").fit(samples.X, samples.y)
# In single precision, the default, the large weights of this network leave too much noise.
changes = {"spacing": 0.1, "stretches": 2.0, "precision": "float64"}
scene = pds.load_scene("uniaxial", {**changes, "material": law})
stress = pds.simulate(scene, model).levels[-1]["nominal_stress"]

# Incompressible, with the share s of C01: P = mu ((1 - s) + s/l) (l - l^-2).
exact = (0.8 + 0.2 / 2.0) * (2.0 - 2.0**-2)
print(f"stress {stress:.5f}, exact {exact:.5f}")
assert abs(stress / exact - 1) < 5e-3  # the error of the network, of the order of 1e-4
