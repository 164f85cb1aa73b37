"""A network of torch learns a bond force; needs the extra "torch"."""

import torch  # noqa: F401  # says at once if it is missing

import pdsurrogate as pds

law = pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=1e4)
samples = pds.training_samples(law, 500, (0.6, 2.5), random_state=0)
network = pds.TorchMLPRegressor((8,), max_epochs=200, learning_rate=0.03, random_state=0)
model = pds.surrogate_pipeline(network, features="isochoric").fit(samples.X, samples.y)
scene = pds.load_scene("uniaxial", spacing=0.1, stretches=2.0, material=law)
stress = pds.simulate(scene, model).levels[-1]["nominal_stress"]

exact = 2.0 - 2.0**-2  # incompressible: mu (l - l^-2)
print(f"stress {stress:.5f}, exact {exact:.5f}")
assert abs(stress / exact - 1) < 0.01  # the error of the network, of the order of 1e-3
