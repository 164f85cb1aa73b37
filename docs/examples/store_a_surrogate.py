"""Cross-validate a surrogate, store it as a versioned artifact, and simulate with it."""

import tempfile

import pdsurrogate as pds

law = pds.materials.Gent(shear_modulus=1.0, bulk_modulus=1e4, chain_limit=30.0)
samples = pds.training_samples(law, 2000, (0.5, 2.5), random_state=0)
polynomial = pds.learning.ChebyshevRegressor((10, 4))
model = pds.surrogate_pipeline(polynomial, features="isochoric").fit(samples.X, samples.y)
folds = pds.cross_validate(model, samples, folds=3)
print(f"greatest relative RMS error of a fold {max(fold['rms'] for fold in folds):.1e}")

with tempfile.TemporaryDirectory() as folder:
    text = pds.CardText("Gent's law with a chain limit of 30", folds)
    path = pds.store(model, samples, law, folder, "my-gent", "1", text)
    force = pds.load_surrogate(path)
    scene = pds.load_scene("uniaxial", spacing=0.1, stretches=2.0, material=law)
    stress = pds.simulate(scene, force).levels[-1]["nominal_stress"]

# Incompressible: P = mu (l - l^-2)/(1 - x/Jm), x = l^2 + 2/l - 3 = 2.
exact = (2.0 - 2.0**-2) / (1 - 2 / 30)
print(f"stress {stress:.5f}, exact {exact:.5f}")
assert abs(stress / exact - 1) < 1e-3  # the cross-validated error of the fit
