"""Treloar's rubber: which law, its parameters, a surrogate of its bond force by a regressor of scikit-learn's kind, and a run with it.

A notebook as a script: cells begin with ``# %%``.
"""

# %%
import pdsurrogate as pds

data = pds.load_test_data("treloar").up_to(3.0)
laws = {}
for name in ("neo-hookean", "gent", "mooney-rivlin"):
    laws[name] = pds.identification.LawRegressor(name).fit(data.stretches, data.nominal_stress, data.balanced_weights())
    print(name, laws[name].law_, laws[name].score(data.stretches, data.nominal_stress))

# %% A polynomial in the two isochoric features, cross-validated.
law = laws["gent"].law_
samples = pds.training_samples(law, n_samples=2000, stretch_range=(0.6, 2.5), random_state=0)
model = pds.surrogate_pipeline(pds.learning.ChebyshevRegressor((10, 5)), features="isochoric")
folds = pds.cross_validate(model, samples, folds=3)
print("relative errors left out:", [f"{fold['rms']:.1e}" for fold in folds])

# %% Stored with its card, and run in a scene of that material.
model.fit(samples.X, samples.y)
text = pds.CardText("Gent rubber from Treloar's data up to a stretch of 3", folds)
path = pds.store(model, samples, law, None, "treloar-gent", None, text)
scene = pds.load_scene("uniaxial", spacing=0.1, stretches=[1.5, 2.0], material=law.describe())
result = pds.simulate(scene, path)
error = result.levels[-1]["nominal_stress_error"]
print("stress against the exact solution:", error)
result.plot("stress_11").savefig("treloar.png")
