"""Any regressor of scikit-learn: an MLP learns a bond force, and runs in the compiled solver."""

from sklearn.neural_network import MLPRegressor

import pdsurrogate as pds

law = pds.materials.MooneyRivlin(shear_modulus=1.0, bulk_modulus=1e4, second_share=0.2)
samples = pds.training_samples(law, 2000, (0.6, 2.5), random_state=0)
settings = {"activation": "tanh", "solver": "lbfgs", "max_iter": 2000, "random_state": 0}
mlp = MLPRegressor(hidden_layer_sizes=(12,), **settings)
model = pds.surrogate_pipeline(mlp, features="isochoric").fit(samples.X, samples.y)
scene = pds.load_scene("uniaxial", spacing=0.1, stretches=2.0, material=law)
stress = pds.simulate(scene, model).levels[-1]["nominal_stress"]

# Incompressible, with the share s of C01: P = mu ((1 - s) + s/l) (l - l^-2).
exact = (0.8 + 0.2 / 2.0) * (2.0 - 2.0**-2)
print(f"stress {stress:.5f}, exact {exact:.5f}")
assert abs(stress / exact - 1) < 0.01  # the error of the network, of the order of 1e-3
