"""Regressors of scikit-learn and skorch in simulations: fit, store, run, and how far each is off.

python pipelines/bring_your_own.py                measures all
python pipelines/bring_your_own.py KernelRidge    a regressor; --help names other uses

Every regressor is fitted to the bond force of Ogden's rubber, behind the two isochoric features,
stored as an artifact, and runs the scene ``uniaxial`` to a stretch of 2.
"""

import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
import torch
from cases import of_rows, report
from clock import TimedModel, measure_speed, sheet
from sklearn.ensemble import GradientBoostingRegressor, RandomForestRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, WhiteKernel
from sklearn.kernel_ridge import KernelRidge
from sklearn.linear_model import Ridge
from sklearn.model_selection import GridSearchCV
from sklearn.neighbors import KNeighborsRegressor
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures
from sklearn.svm import SVR
from skorch import NeuralNetRegressor

import pdsurrogate as pds
from pdsurrogate.identification import fitted_laws
from pdsurrogate.learning.bond_force import stiffness_slopes

LAW = pds.materials.Ogden()
SAMPLES = 2000


def module():
    """A network of torch in double precision, as the samples are."""
    layers = [
        torch.nn.Linear(2, 24),
        torch.nn.Tanh(),
        torch.nn.Linear(24, 24),
        torch.nn.Tanh(),
        torch.nn.Linear(24, 2),
    ]
    return torch.nn.Sequential(*layers).double()


def regressors():
    """What a user might bring, by a name."""

    def network(activation, hidden=(16, 16)):
        return MLPRegressor(
            hidden_layer_sizes=hidden,
            activation=activation,
            solver="lbfgs",
            max_iter=2000,
            max_fun=100_000,
            tol=1e-9,
            random_state=0,
        )

    torch.manual_seed(0)
    return {
        "MLP, tanh, 16 + 16": network("tanh"),
        "MLP, relu, 16 + 16": network("relu"),
        "MLP, logistic, 16 + 16": network("logistic"),
        "MLP, tanh, 12 + 12 + 12": network("tanh", (12, 12, 12)),
        "GradientBoosting": GradientBoostingRegressor(
            n_estimators=300, max_depth=4, random_state=0
        ),
        "RandomForest": RandomForestRegressor(100, min_samples_leaf=2, random_state=0),
        "GaussianProcess": GaussianProcessRegressor(
            RBF((1.0, 1.0)) + WhiteKernel(1e-7), optimizer=None, normalize_y=True
        ),
        "KernelRidge": KernelRidge(kernel="rbf", alpha=1e-6, gamma=0.2),
        "SVR": SVR(C=10.0, epsilon=1e-3),
        "Ridge on polynomials": make_pipeline(PolynomialFeatures(10), Ridge(1e-8)),
        "KNeighbors": KNeighborsRegressor(8, weights="distance"),
        "skorch, tanh, 24 + 24": NeuralNetRegressor(
            module,
            max_epochs=60,
            lr=1.0,
            batch_size=-1,
            optimizer=torch.optim.LBFGS,
            optimizer__line_search_fn="strong_wolfe",
            train_split=None,
            verbose=0,
        ),
    }


def stress_error(force):
    """Relative error of the nominal stress in the scene uniaxial at a stretch of 2."""
    scene = pds.load_scene("uniaxial", spacing=0.05, stretches=2.0, material=LAW.describe())
    return pds.simulate(scene, force).levels[0]["nominal_stress_error"]


def least_slope(force):
    """Of the normal force by the stretch of a bond, in states of plane stress from 0.5 to 4."""
    states = pds.training_samples(LAW, 10_000, off_surface=0, random_state=1_000_003).X
    return float(stiffness_slopes(force, states).min())


def compared(name):
    """A regressor that is fitted, stored and run."""
    samples, regressor = pds.training_samples(LAW, SAMPLES, random_state=0), regressors()[name]
    began = time.perf_counter()
    with warnings.catch_warnings(action="ignore"):  # of trainings that stop before their end
        model = pds.surrogate_pipeline(regressor, features="isochoric").fit(samples.X, samples.y)
    seconds = time.perf_counter() - began
    with tempfile.TemporaryDirectory() as folder:
        path = pds.store(model, samples, LAW, Path(folder), "own", "1", name)
        card, force = pds.load_card(path), pds.load_surrogate(path)
    box, resampling = card.errors["box"], card.training.get("resampling")
    taken, errors = "unchanged", (None, None)
    if resampling is not None:
        taken, errors = f"spline, {force.size}", (resampling["rms"], resampling["jump"] or None)
    cost = measure_speed([TimedModel(force, "float32", sheet())], LAW)[0]
    figures = box["on_surface"]["rms"], least_slope(force.bond_force), stress_error(force)
    yield name, seconds, taken, *errors, *figures, cost["ns_per_directed_bond_1"]


def search(features):
    """A grid search over widths."""
    samples = pds.training_samples(LAW, 2000, random_state=0)
    network = pds.LevenbergMarquardtRegressor(activation="algebraic", max_iter=250, random_state=0)
    path = "regressor__regressor__regressor__hidden_layer_sizes"
    model, grid = pds.surrogate_pipeline(network, features=features), {path: [(4,), (8,), (16,)]}
    found = GridSearchCV(model, grid, cv=3).fit(samples.X, samples.y)
    for row in pds.learning.storing.search_table(found):
        yield f"{features}, {row[path][0]} units", 1 - row["score"]


DATA = pds.load_test_data("kawabata")
X, Y = DATA.stretches, DATA.nominal_stress
LARGE = 0.05 * Y.max() < Y
"""Stresses whose relative error is asked for."""

TWO_MODES = (Y > 0) & (
    (np.abs(np.log(X[:, 1] * np.sqrt(X[:, 0]))) < 0.02) | (np.abs(X[:, 1] - 1) < 1e-9)
)
# Both stresses of a state go together.
PARTS = {
    "uniaxial and pure shear": TWO_MODES,
    "half of the grid": np.arange(len(Y)) // 2 % 2 == 0,
    "the whole grid": np.ones(len(Y), bool),
}
"""What is fitted; what is left out is asked for, or what was fitted where that is all."""


def foretold(model):
    """Kawabata's biaxial grid foretold from parts of it: R^2, and errors within 5 %."""
    found = pds.identification.EnergyRegressor()
    if model != ENERGY:
        found = pds.identification.LawRegressor(model)
    cells = []
    for known in PARTS.values():
        asked = ~known if not known.all() else known
        truth, predicted = Y[asked], found.fit(X[known], Y[known]).predict(X[asked])
        r_squared = 1 - ((truth - predicted) ** 2).sum() / ((truth - truth.mean()) ** 2).sum()
        within = (np.abs(predicted - truth) <= 0.05 * truth)[LARGE[asked]].mean()
        cells.append(f"{r_squared:.4f}, {100 * within:.0f} %")
    yield model, *cells


ENERGY = "`EnergyRegressor`"

if __name__ == "__main__":
    laws = [name for name in fitted_laws() if name != "full-network"]
    brought, features = regressors(), ["isochoric", "symmetric"]
    report(
        __doc__,
        of_rows("own-regressors", compared, brought),
        of_rows("own-search", search, features),
        of_rows("own-data", foretold, [ENERGY, *laws]),
    )
