"""Regressors of scikit-learn and skorch in simulations: fit, store, run, and how far each is off.

    python pipelines/bring_your_own.py           print the tables python pipelines/bring_your_own.py
    --docs    put them into docs/validation/bring-your-own.md as well

Every regressor is fitted to the bond force of Ogden's rubber, behind the two isochoric features,
stored as an artifact, and runs the scene ``uniaxial`` to a stretch of 2.
"""

from __future__ import annotations

import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
import torch
from clock import TimedModel, measure_speed, sheet
from pages import markdown_table, report
from rich.console import Console
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
PATIENCE = 20.0
"""Seconds of waiting for undisturbed timings of all models."""
console = Console()


def module() -> torch.nn.Sequential:
    """A network of torch in double precision, as the samples are."""
    layers = [
        torch.nn.Linear(2, 24),
        torch.nn.Tanh(),
        torch.nn.Linear(24, 24),
        torch.nn.Tanh(),
        torch.nn.Linear(24, 2),
    ]
    return torch.nn.Sequential(*layers).double()


def regressors() -> dict[str, object]:
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


def stress_error(force) -> float:
    """Relative error of the nominal stress in the scene uniaxial at a stretch of 2."""
    scene = pds.load_scene("uniaxial", spacing=0.05, stretches=2.0, material=LAW.describe())
    return pds.simulate(scene, force).levels[0]["nominal_stress_error"]


def least_slope(force) -> float:
    """Of the normal force by the stretch of a bond, in states of plane stress from 0.5 to 4."""
    states = pds.training_samples(LAW, 10_000, off_surface=0, random_state=1_000_003).X
    return float(stiffness_slopes(force, states).min())


def percent(value: float) -> str:
    return f"{100 * value:.2g} %"


def of_ten(folder: Path) -> str:
    """The table of all regressors."""
    samples = pds.training_samples(LAW, SAMPLES, random_state=0)
    names, rows, cases = [], [], []
    for number, (name, regressor) in enumerate(regressors().items()):
        console.print(name)
        began = time.perf_counter()
        model = pds.surrogate_pipeline(regressor, features="isochoric").fit(samples.X, samples.y)
        seconds = time.perf_counter() - began
        path = pds.store(model, samples, LAW, folder, f"own-{number}", "1", name)
        card, force = pds.load_card(path), pds.load_surrogate(path)
        box, resampling = card.errors["box"], card.training.get("resampling")
        taken = "unchanged" if resampling is None else f"spline, {force.size}"
        names.append(name)
        rows.append(
            [
                f"{seconds:.1f}",
                taken,
                "" if resampling is None else percent(resampling["rms"]),
                (
                    "none"
                    if resampling is None or resampling["jump"] == 0
                    else percent(resampling["jump"])
                ),
                percent(box["on_surface"]["rms"]),
                f"{least_slope(force.bond_force):.3f}",
                percent(stress_error(path)),
            ]
        )
        cases.append(TimedModel(force, "float32", sheet()))
    exact = pds.AnalyticBondForce(LAW)
    names.append("exact bond force")
    rows.append(
        [
            "",
            "",
            "",
            "",
            "0",
            f"{least_slope(exact.bond_force):.3f}",
            percent(stress_error("analytic")),
        ]
    )
    cases.append(TimedModel(exact, "float64", sheet()))
    header = [
        "regressor",
        "fit (s)",
        "stored as",
        "conversion error",
        "largest jump",
        "force error",
        "least slope",
        "stress error at stretch 2",
        "cost (ns)",
    ]
    costs = [found["ns_per_directed_bond_1"] for found in measure_speed(cases, LAW, PATIENCE)]
    table = [
        [name, *row, f"{cost:.0f}"] for name, row, cost in zip(names, rows, costs, strict=True)
    ]
    return markdown_table(header, table)


def search() -> str:
    """A grid search over features and widths, and straight into a run."""
    samples = pds.training_samples(LAW, 2000, random_state=0)
    path = "regressor__regressor__regressor"
    found, rows = {}, []
    for features in ("isochoric", "symmetric"):
        network = pds.LevenbergMarquardtRegressor(
            activation="algebraic", max_iter=250, random_state=0
        )
        grid = {f"{path}__hidden_layer_sizes": [(4,), (8,), (16,)]}
        found[features] = GridSearchCV(
            pds.surrogate_pipeline(network, features=features), grid, cv=3
        ).fit(samples.X, samples.y)
        for row in pds.learning.storing.search_table(found[features]):
            units = row[f"{path}__hidden_layer_sizes"][0]
            rows.append([f"{features}, {units} units", f"{1 - row['score']:.1e}"])
    best = max(found.values(), key=lambda one: one.best_score_)
    units = best.best_params_[f"{path}__hidden_layer_sizes"][0]
    table = markdown_table(["features and width", "1 - R² on the held-out folds"], rows)
    run = "`pds.simulate(scene, search)` with the best model"
    return (
        f"{table}\n\n{run} ({units} units): the stress error at stretch 2 is"
        f" {percent(stress_error(best))}."
    )


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


def of_data() -> str:
    """Kawabata's biaxial grid foretold from parts of it, by an energy without a law and by every
    law: R^2, and errors within 5 %.
    """
    models = {"`EnergyRegressor`": pds.identification.EnergyRegressor()}
    models |= {
        law: pds.identification.LawRegressor(law) for law in fitted_laws() if law != "full-network"
    }
    rows = []
    for name, model in models.items():
        rows.append([name])
        for known in PARTS.values():
            asked = ~known if not known.all() else known
            truth, found = Y[asked], model.fit(X[known], Y[known]).predict(X[asked])
            r_squared = 1 - ((truth - found) ** 2).sum() / ((truth - truth.mean()) ** 2).sum()
            rows[-1].append(
                f"{r_squared:.4f},"
                f" {100 * (np.abs(found - truth) <= 0.05 * truth)[LARGE[asked]].mean():.0f} %"
            )
    return markdown_table(["model, fitted to", *PARTS], rows)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of trainings that stop before their end
        report(
            __doc__,
            {
                "own-regressors": lambda: of_ten(Path(name)),
                "own-search": search,
                "own-data": of_data,
            },
        )
