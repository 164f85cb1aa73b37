"""Regressors of scikit-learn and skorch in simulations: fit, store, run, and how far each is off.

    python pipelines/bring_your_own.py           print the tables
    python pipelines/bring_your_own.py --docs    put them into docs/validation/bring-your-own.md as well

Every regressor is fitted to the bond force of Ogden's rubber, behind the two isochoric features, stored as an artifact, and runs the scene
``uniaxial`` to a stretch of 2.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import warnings
from pathlib import Path

import kawabata
import numpy as np
import torch
from clock import bench_positions, sheet
from pages import markdown_table, replace_block
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
from pdsurrogate.engine.threads import thread_count
from pdsurrogate.identification import committee_spread, nominal_stress
from pdsurrogate.learning.bond_force import stiffness_slopes
from pdsurrogate.learning.settings import FitSettings

LAW = pds.materials.Ogden()
SAMPLES = 2000
PATIENCE = 20.0
"""Seconds of timing of all models, in turn."""
console = Console()


def module() -> torch.nn.Sequential:
    """A network of torch in double precision, as the samples are."""
    layers = [torch.nn.Linear(2, 24), torch.nn.Tanh(), torch.nn.Linear(24, 24), torch.nn.Tanh(), torch.nn.Linear(24, 2)]
    return torch.nn.Sequential(*layers).double()


def regressors() -> dict[str, object]:
    """What a user might bring, by a name."""

    def network(activation, hidden=(16, 16)):
        return MLPRegressor(
            hidden_layer_sizes=hidden, activation=activation, solver="lbfgs", max_iter=2000, max_fun=100_000, tol=1e-9, random_state=0
        )

    torch.manual_seed(0)
    return {
        "MLP, tanh, 16 + 16": network("tanh"),
        "MLP, relu, 16 + 16": network("relu"),
        "MLP, logistic, 16 + 16": network("logistic"),
        "MLP, tanh, 12 + 12 + 12": network("tanh", (12, 12, 12)),
        "GradientBoosting": GradientBoostingRegressor(n_estimators=300, max_depth=4, random_state=0),
        "RandomForest": RandomForestRegressor(100, min_samples_leaf=2, random_state=0),
        "GaussianProcess": GaussianProcessRegressor(RBF((1.0, 1.0)) + WhiteKernel(1e-7), optimizer=None, normalize_y=True),
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


def costs(models: list[tuple[object, str]]) -> list[float]:
    """Nanoseconds a directed bond of whole evaluations on one thread: of each model the least of many timings, taken in turn.

    Other work on the machine only ever adds to a timing.
    """
    body = sheet()
    with thread_count(1):
        positions, out = bench_positions(body, LAW), np.empty_like(body.points)
        bound = [model.bind(body, LAW, pds.ForceSettings(precision=precision)) for model, precision in models]
        least, began = np.full(len(bound), np.inf), time.perf_counter()
        while time.perf_counter() - began < PATIENCE:
            for number, force in enumerate(bound):
                for _ in range(5):
                    start = time.perf_counter()
                    force(positions, out)
                    least[number] = min(least[number], time.perf_counter() - start)
    return (1e9 * least / body.bonds.n_directed).tolist()


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
                "none" if resampling is None or resampling["jump"] == 0 else percent(resampling["jump"]),
                percent(box["on_surface"]["rms"]),
                f"{least_slope(force.bond_force):.3f}",
                percent(stress_error(path)),
            ]
        )
        cases.append((force, "float32"))
    exact = pds.AnalyticBondForce(LAW)
    names.append("exact bond force")
    rows.append(["", "", "", "", "0", f"{least_slope(exact.bond_force):.3f}", percent(stress_error("analytic"))])
    cases.append((exact, "float64"))
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
    table = [[name, *row, f"{cost:.0f}"] for name, row, cost in zip(names, rows, costs(cases), strict=True)]
    return markdown_table(header, table)


def refused(folder: Path) -> str:
    """What is not taken, when, and what is said."""
    from sklearn.dummy import DummyRegressor
    from sklearn.linear_model import LinearRegression, LogisticRegression
    from sklearn.preprocessing import StandardScaler

    samples = pds.training_samples(LAW, 500, random_state=0)
    scene = pds.load_scene("uniaxial", spacing=0.2, stretches=1.2, material="ogden")

    def stored(regressor):
        pds.store(
            pds.surrogate_pipeline(regressor, features="isochoric").fit(samples.X, samples.y), samples, LAW, folder, "none", "1", "none"
        )

    cases = [
        ("a classifier", "before the training", lambda: pds.surrogate_pipeline(LogisticRegression(), features="isochoric")),
        ("a transformer", "before the training", lambda: pds.surrogate_pipeline(StandardScaler(), features="isochoric")),
        ("a class, not an instance", "before the training", lambda: pds.surrogate_pipeline(Ridge, features="isochoric")),
        ("an unfitted pipeline", "before the run", lambda: pds.simulate(scene, pds.surrogate_pipeline(features="isochoric"))),
        (
            "a grid search with `refit=False`",
            "before the run",
            lambda: pds.simulate(
                scene,
                GridSearchCV(
                    pds.surrogate_pipeline(pds.learning.ChebyshevRegressor(), features="isochoric"),
                    {"regressor__regressor__regressor__degree": [2, 3]},
                    cv=2,
                    refit=False,
                ).fit(samples.X, samples.y),
            ),
        ),
        ("a regressor without its samples", "before the run", lambda: pds.simulate(scene, LinearRegression().fit(samples.X, samples.y))),
        (
            "a regressor of three bond quantities",
            "when it is stored",
            lambda: pds.store(LinearRegression().fit(samples.X[:, :3], samples.y), samples, LAW, folder, "none", "1", "none"),
        ),
        ("a regressor with a large error", "when it is stored", lambda: stored(DummyRegressor())),
    ]
    rows = []
    for what, when, action in cases:
        try:
            action()
            said = "taken"
        except (ValueError, TypeError) as error:
            said = str(error)
        rows.append([what, when, said.replace("|", "\\|")])
    return "\n".join(["| input | rejected | message |", "| --- | --- | --- |", *("| " + " | ".join(row) + " |" for row in rows)])


def search() -> str:
    """A grid search over features and widths, and straight into a run."""
    samples = pds.training_samples(LAW, 2000, random_state=0)
    path = "regressor__regressor__regressor"
    found, rows = {}, []
    for features in ("isochoric", "symmetric"):
        network = pds.LevenbergMarquardtRegressor(activation="algebraic", max_iter=250, random_state=0)
        grid = {f"{path}__hidden_layer_sizes": [(4,), (8,), (16,)]}
        found[features] = GridSearchCV(pds.surrogate_pipeline(network, features=features), grid, cv=3).fit(samples.X, samples.y)
        for row in pds.learning.storing.search_table(found[features]):
            units = row[f"{path}__hidden_layer_sizes"][0]
            rows.append([f"{features}, {units} units", f"{1 - row['score']:.1e}"])
    best = max(found.values(), key=lambda one: one.best_score_)
    units = best.best_params_[f"{path}__hidden_layer_sizes"][0]
    table = markdown_table(["features and width", "1 - R² on the held-out folds"], rows)
    run = "`pds.simulate(scene, search)` with the best model"
    return f"{table}\n\n{run} ({units} units): the stress error at stretch 2 is {percent(stress_error(best))}."


NOISE, MEMBERS = 0.02, 8
SETS, SHEETS = 40, 10
"""Sets of noisy stresses of every law whose committees are asked for stresses, and of these those that run a sheet with a hole."""

KNOWN = {
    "ogden": pds.materials.Ogden(moduli=(0.4, -0.02), exponents=(2.0, -2.0), bulk_modulus=420.0),
    "mooney-rivlin": pds.materials.MooneyRivlin(0.4, 400.0, 0.15),
    "gent": pds.materials.Gent(0.4, 400.0, 60.0),
    "arruda-boyce": pds.materials.ArrudaBoyce(0.4, 400.0, 20.0),
    "yeoh": pds.materials.Yeoh(0.4, 400.0, -0.006, 2e-4),
}
"""Laws that noisy data are made from, with the K/mu of the fits; the committee's make was chosen with the first of them alone."""

TESTED = np.linspace(1.05, 2.5, 15)
MEASURED = np.concatenate([np.stack([TESTED, lateral], axis=1) for lateral in (TESTED**-0.5, np.ones(15), TESTED)])
WEIGHTS = {"1/stress²": lambda y: y**-2, "none": np.ones_like}


def identified(name: str, seed: int, weights: str) -> list:
    """Fits to stresses of a law in three modes, each off by a share of itself: to all of them, and the committee's."""
    noise = np.random.default_rng(100 * list(KNOWN).index(name) + seed).standard_normal(len(MEASURED))  # no two laws have the same
    y = nominal_stress(KNOWN[name], MEASURED) * (1 + NOISE * noise)
    weight = WEIGHTS[weights](y)
    model = pds.identification.EnergyRegressor().fit(MEASURED, y, weight)
    return [model, *pds.identification.committee(model, MEASURED, y, MEMBERS, random_state=seed, sample_weight=weight)]


def off_and_spread(results: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far the first of results is off, and the spread of the others about it, relatively."""
    return results[0] / right - 1, committee_spread(results[0], results[1:]) / right


def stresses_of_committees() -> str:
    """How often stresses between and beyond the tests are within twice the spread."""
    random = np.random.default_rng(0)
    between = np.stack([random.uniform(1.1, 2.4, 40), random.uniform(0.8, 1.2, 40)], axis=1)
    beyond = np.stack([np.linspace(2.6, 2.9, 5), np.linspace(0.7, 1.4, 5)], axis=1)
    states, rows = np.vstack([between, beyond]), []
    for name, law in KNOWN.items():
        right, exact = nominal_stress(law, states), nominal_stress(law, MEASURED)
        form = np.abs(pds.identification.EnergyRegressor().fit(MEASURED, exact, exact**-2).predict(states) / right - 1)[
            : len(between)
        ].max()
        for weights in WEIGHTS:
            fits = (identified(name, seed, weights) for seed in range(SETS))
            off, spread = map(
                np.array, zip(*(off_and_spread(np.array([one.predict(states) for one in fit]), right) for fit in fits), strict=True)
            )
            row = [f"{100 * form:.2f} %"]
            for part in (slice(len(between)), slice(len(between), None)):
                sizes = [f"{100 * np.sqrt((values[:, part] ** 2).mean()):.2f} %" for values in (off, spread)]
                row.append(f"{sizes[0]}, {sizes[1]}")
                row.append(f"{100 * (np.abs(off) <= 2 * spread)[:, part].mean():.0f} %")
            rows.append([name, weights, *row])
            print(rows[-1], flush=True)
    within = "within twice the spread"
    header = ["law", "weights", "error without noise", "between the tests: error, spread", within, "beyond: error, spread", within]
    return markdown_table(header, rows)


def sheet_with_a_hole(material, force) -> np.ndarray:
    """Nominal stress of the pull, and greatest narrowing."""
    scene = pds.load_scene("hole", {"spacing": 0.1, "stretches": 1.5}, material=material)
    level = pds.simulate(scene, force).levels[0]
    return np.array([level["nominal_stress"], level["greatest_lateral_displacement"]])


def of_artifact(fits: list, folder: Path) -> np.ndarray:
    """Results of a committee in one artifact, shape (1 + members, 2)."""
    settings = FitSettings(folds=0, samples=2000).within(*fits[0].stretch_range_)
    drawn = settings.committee([one.law_ for one in fits])
    path = pds.store(*drawn[0], folder, "noisy", None, "an energy of noisy data", members=drawn[1:])
    return np.array([sheet_with_a_hole(one[2], f"{path}#{number}" if number else path) for number, one in enumerate(drawn)])


def committees(folder: Path) -> str:
    """Stresses, and sheets with a hole, by energies from noisy data of known laws, with the spread of each committee."""
    rows, counts = [], []
    for number, (name, law) in enumerate(KNOWN.items()):
        right = sheet_with_a_hole(law, "analytic")
        for weights in WEIGHTS if number == 0 else ("1/stress²",):
            stored, found = number == 0 and weights != "none", []
            for seed in range(SHEETS):
                fits = identified(name, seed, weights)
                results = of_artifact(fits, folder) if stored else np.array([sheet_with_a_hole(one.law_, "analytic") for one in fits])
                found.append(off_and_spread(results, right))
                if stored:
                    rows.append([str(seed), *(f"{100 * a:+.2f} %, {100 * 2 * b:.2f} %" for a, b in zip(*found[-1], strict=True))])
            off, spread = np.moveaxis(found, 1, 0)
            rms, inside = [100 * np.sqrt((values**2).mean(axis=0)) for values in (off, spread)], (np.abs(off) <= 2 * spread).sum(axis=0)
            counts.append([name, weights, *(f"{rms[0][n]:.2f} %, {rms[1][n]:.2f} %, {inside[n]} of {SHEETS}" for n in (0, 1))])
            print(counts[-1], flush=True)
    return "\n\n".join(
        [
            stresses_of_committees(),
            "Sheets with a hole, from artifacts with committees for the first law with weights. The columns give the error and twice the "
            "spread:",
            markdown_table(["seed of the noise", "force", "narrowing"], rows),
            "The same for all laws (the rows after the first are computed from the energies without artifacts): RMS error, RMS spread, and "
            "number of sets with an error below twice the spread:",
            markdown_table(["law", "weights", "force", "narrowing"], counts),
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", action="store_true", help="put the tables into docs/validation/bring-your-own.md")
    parser.add_argument("--table", choices=("regressors", "refused", "search", "data", "stresses", "committee"), help="only this one")
    arguments = parser.parse_args()
    tables = {"regressors": of_ten, "refused": refused, "search": lambda folder: search(), "data": lambda folder: kawabata.of_data()}
    tables |= {"stresses": lambda folder: kawabata.stress_by_stress(), "committee": committees}
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of trainings that stop before their end
        for name, make in tables.items():
            if arguments.table in (None, name):
                text = make(Path(folder))
                print(text)
                if arguments.docs:
                    replace_block(f"own-{name}", text)


if __name__ == "__main__":
    main()
