"""Regressors of scikit-learn and skorch in simulations: fit, store, run, and how far each is off.

    python pipelines/bring_your_own.py           print the tables
    python pipelines/bring_your_own.py --docs    put them into docs/validation/bring-your-own.md as well

Every regressor is fitted to the bond force of Ogden's rubber, behind the two isochoric features, stored as an artefact, and runs the scene
``uniaxial`` to a stretch of 2.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
import torch
from pages import markdown_table, replace_block
from rich.console import Console
from scipy.optimize import linprog
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

import pdsurrogate as pd
from pdsurrogate.identification import nominal_stress
from pdsurrogate.identification.energy import NEGATIVE, POSITIVE, dictionary, stresses
from pdsurrogate.kernels.threads import thread_count
from pdsurrogate.learning.settings import FitSettings
from pdsurrogate.learning.validation import stiffness_slopes
from pdsurrogate.reports.speed import bench_positions, sheet

LAW = pd.Ogden()
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
    scene = pd.load_scene("uniaxial", spacing=0.05, stretches=2.0, material=LAW.describe())
    return pd.simulate(scene, force).levels[0]["nominal_stress_error"]


def least_slope(force) -> float:
    """Of the normal force by the stretch of a bond, in states of plane stress from 0.5 to 4."""
    states = pd.wide_design(LAW, 10_000, off_surface=0, random_state=1_000_003).X
    return float(stiffness_slopes(force, states).min())


def costs(models: list[tuple[object, str]]) -> list[float]:
    """Nanoseconds a directed bond of whole evaluations on one thread: of each model the least of many timings, taken in turn.

    Other work on the machine only ever adds to a timing.
    """
    body = sheet()
    with thread_count(1):
        positions, out = bench_positions(body, LAW), np.empty_like(body.points)
        bound = [model.bind(body, LAW, pd.ForceSettings(precision=precision)) for model, precision in models]
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
    samples = pd.wide_design(LAW, SAMPLES, random_state=0)
    names, rows, cases = [], [], []
    for number, (name, regressor) in enumerate(regressors().items()):
        console.print(name)
        began = time.perf_counter()
        model = pd.bond_force_pipeline("isochoric", regressor).fit(samples.X, samples.y)
        seconds = time.perf_counter() - began
        path = pd.store(model, samples, LAW, folder, f"own-{number}", "1", name)
        card, force = pd.load_card(path), pd.load_surrogate(path)
        box, resampling = card.errors["box"], card.training.get("resampling")
        taken = "as it is" if resampling is None else f"spline, {force.size}"
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
    exact = pd.AnalyticBondForce(LAW)
    names.append("exact bond force")
    rows.append(["", "", "", "", "0", f"{least_slope(exact.bond_force):.3f}", percent(stress_error("analytic"))])
    cases.append((exact, "float64"))
    header = [
        "regressor",
        "fit (s)",
        "taken over",
        "error of resampling",
        "jumps",
        "error of the force",
        "least slope",
        "stress at 2, error",
        "ns a bond",
    ]
    table = [[name, *row, f"{cost:.0f}"] for name, row, cost in zip(names, rows, costs(cases), strict=True)]
    return markdown_table(header, table)


def refused(folder: Path) -> str:
    """What is not taken, when, and what is said."""
    from sklearn.dummy import DummyRegressor
    from sklearn.linear_model import LinearRegression, LogisticRegression
    from sklearn.preprocessing import StandardScaler

    samples = pd.wide_design(LAW, 500, random_state=0)
    scene = pd.load_scene("uniaxial", spacing=0.2, stretches=1.2, material="ogden")

    def stored(regressor):
        pd.store(pd.bond_force_pipeline("isochoric", regressor).fit(samples.X, samples.y), samples, LAW, folder, "none", "1", "none")

    cases = [
        ("a classifier", "before the training", lambda: pd.bond_force_pipeline("isochoric", LogisticRegression())),
        ("a transformer", "before the training", lambda: pd.bond_force_pipeline("isochoric", StandardScaler())),
        ("a class, not an instance", "before the training", lambda: pd.bond_force_pipeline("isochoric", Ridge)),
        ("a pipeline that is not fitted", "before the run", lambda: pd.simulate(scene, pd.bond_force_pipeline("isochoric"))),
        (
            "a search without a fitted model",
            "before the run",
            lambda: pd.simulate(
                scene,
                GridSearchCV(
                    pd.bond_force_pipeline("isochoric", pd.ChebyshevRegressor()),
                    {"regressor__regressor__regressor__degree": [2, 3]},
                    cv=2,
                    refit=False,
                ).fit(samples.X, samples.y),
            ),
        ),
        ("a regressor of bonds by itself", "before the run", lambda: pd.simulate(scene, LinearRegression().fit(samples.X, samples.y))),
        (
            "a regressor of other columns",
            "at storing",
            lambda: pd.store(LinearRegression().fit(samples.X[:, :3], samples.y), samples, LAW, folder, "none", "1", "none"),
        ),
        ("a regressor that is far off", "at storing", lambda: stored(DummyRegressor())),
    ]
    rows = []
    for what, when, action in cases:
        try:
            action()
            said = "taken"
        except (ValueError, TypeError) as error:
            said = str(error)
        rows.append([what, when, said.replace("|", "\\|")])
    return "\n".join(["| what | when | what is said |", "| --- | --- | --- |", *("| " + " | ".join(row) + " |" for row in rows)])


def search() -> str:
    """A grid search over features and widths, and straight into a run."""
    samples = pd.wide_design(LAW, 2000, random_state=0)
    path = "regressor__regressor__regressor"
    found, rows = {}, []
    for features in ("isochoric", "symmetric"):
        network = pd.LevenbergMarquardtRegressor(activation="algebraic", max_iter=250, random_state=0)
        grid = {f"{path}__hidden_layer_sizes": [(4,), (8,), (16,)]}
        found[features] = GridSearchCV(pd.bond_force_pipeline(features, network), grid, cv=3).fit(samples.X, samples.y)
        for row in pd.learning.fitting.search_table(found[features]):
            units = row[f"{path}__hidden_layer_sizes"][0]
            rows.append([f"{features}, {units} units", f"{1 - row['score']:.1e}"])
    best = max(found.values(), key=lambda one: one.best_score_)
    units = best.best_params_[f"{path}__hidden_layer_sizes"][0]
    table = markdown_table(["features and width", "1 - R² on the folds left out"], rows)
    run = "`pd.simulate(scene, search)` of the best"
    return f"{table}\n\n{run}, {units} units: stress at a stretch of 2 off by {percent(stress_error(best))}."


def of_data() -> str:
    """Kawabata's grid foretold from parts of it, by an energy without a law and by every law."""
    data = pd.load_test_data("kawabata")
    first, second = data.stretches.T
    pulled = np.abs(data.nominal_stress) > 0
    two_modes = pulled & ((np.abs(np.log(second * np.sqrt(first))) < 0.02) | (np.abs(second - 1) < 1e-9))
    half = np.arange(len(data)) // 2 % 2 == 0  # both stresses of a state go together
    parts = {"uniaxial and pure shear": two_modes, "half of the grid": half, "all of it": np.ones(len(data), dtype=bool)}

    def scores(model) -> list[str]:
        row = []
        for known in parts.values():
            model.fit(data.stretches[known], data.nominal_stress[known])
            asked = ~known if not known.all() else known
            truth, found = data.nominal_stress[asked], model.predict(data.stretches[asked])
            r_squared = 1 - ((truth - found) ** 2).sum() / ((truth - truth.mean()) ** 2).sum()
            large = truth > 0.05 * truth.max()
            close = (np.abs(found - truth)[large] <= 0.05 * truth[large]).mean()
            row.append(f"{r_squared:.4f}, {100 * close:.0f} %")
        return row

    rows = [["an energy without a law", *scores(pd.EnergyRegressor())]]
    rows += [[law, *scores(pd.LawRegressor(law))] for law in pd.LAWS if law != "full-network"]
    return markdown_table(["fitted to", *parts], rows)


def stress_by_stress() -> str:
    """How far single stresses of Kawabata's grid are from what the free energy foretells, and the energy's least stiffness."""
    data = pd.load_test_data("kawabata")
    first, second = data.stretches.T
    pulled = np.abs(data.nominal_stress) > 0
    two_modes = pulled & ((np.abs(np.log(second * np.sqrt(first))) < 0.02) | (np.abs(second - 1) < 1e-9))
    half = np.arange(len(data)) // 2 % 2 == 0
    large = data.nominal_stress > 0.05 * data.nominal_stress.max()
    rows = []
    for name, known in (("uniaxial and pure shear", two_modes), ("half of the grid", half), ("all of it", np.ones(len(data), dtype=bool))):
        model = pd.EnergyRegressor().fit(data.stretches[known], data.nominal_stress[known])
        asked = large & (~known if not known.all() else known)
        inside = asked & (model.beyond(data.stretches) <= 0)
        off = np.sort(np.abs(model.predict(data.stretches) / np.where(large, data.nominal_stress, 1) - 1)[inside])
        shares = [f"{100 * (off <= most).mean():.0f} %" for most in (0.03, 0.05)]
        # W is a sum over the stretches: its curvatures by their logarithms are those of the summands.
        stretch = np.geomspace(0.25, 4.0, 2001)
        curvature = (model.weights_ * stretch[:, None] ** model.exponents_).sum(axis=1) / model.weights_.sum()
        slope = stiffness_slopes(pd.AnalyticBondForce(model.law_).bond_force, pd.wide_design(model.law_, 10_000, off_surface=0).X).min()
        greatest = f"{100 * np.median(off):.1f} %, {100 * off[-1]:.0f} %"
        count = f"{inside.sum()} of {asked.sum()}"
        rows.append([name, count, *shares, greatest, f"{curvature.min():.2f}", f"{slope:.3f}"])
    header = ["fitted to", "within the hull", "met within 3 %", "within 5 %", "off: median, greatest", "least curvature", "least slope"]
    return f"{markdown_table(header, rows)}\n\n{least_greatest_error()}"


def least_greatest_error() -> str:
    """What no weights can do better: the least of the greatest relative errors of Kawabata's stresses, by a linear programme."""
    data = pd.load_test_data("kawabata")
    X, y = data.stretches, data.nominal_stress
    large = y > 0.05 * y.max()
    columns = stresses(X[large], dictionary(max(POSITIVE), max(NEGATIVE))) / y[large, None]
    rows, terms = columns.shape
    # |columns c - 1| <= t, with t the least.
    matrix = np.block([[columns, -np.ones((rows, 1))], [-columns, -np.ones((rows, 1))]])
    bounds, found = np.concatenate([np.ones(rows), -np.ones(rows)]), []
    for least in (0.0, None):
        limits = [(least, None)] * terms + [(0.0, None)]
        found.append(linprog([0.0] * terms + [1.0], A_ub=matrix, b_ub=bounds, bounds=limits).x[-1])
    return (
        f"Fitted to all of these {rows} stresses for their greatest relative error alone, a sum of powers with weights that are not "
        f"negative leaves {100 * found[0]:.1f} %, and with weights of any sign, which may be unstable, {100 * found[1]:.1f} %."
    )


NOISE, DRAWINGS, MEMBERS = 0.02, 5, 6


def committees(folder: Path) -> str:
    """A sheet with a hole by energies from noisy data of a known law, with the spread of each committee."""
    law = pd.Ogden(moduli=(0.4, -0.02), exponents=(2.0, -2.0))
    stretch = np.linspace(1.05, 2.5, 15)
    X = np.concatenate([np.stack([stretch, lateral], axis=1) for lateral in (stretch**-0.5, np.ones(15), stretch)])
    scene = {"spacing": 0.1, "stretches": 1.5}

    def run(material, force) -> np.ndarray:
        level = pd.simulate(pd.load_scene("hole", scene, material=material), force).levels[0]
        return np.array([level["nominal_stress"], level["greatest_lateral_displacement"]])

    right, rows = run(law, "analytic"), []
    for drawing in range(DRAWINGS):
        noisy = nominal_stress(law, X) * (1 + NOISE * np.random.default_rng(drawing).standard_normal(len(X)))
        model = pd.EnergyRegressor().fit(X, noisy)
        settings = FitSettings(folds=0, samples=2000).within(*model.stretch_range_)
        drawn = settings.committee([model.law_] + [one.law_ for one in pd.committee(model, X, noisy, MEMBERS)])
        path = pd.store(*drawn[0], folder, "noisy", None, "an energy of noisy data", members=drawn[1:])
        found, *others = (
            run(one[2], f"{path}{which}")
            for one, which in zip(drawn, ["", *(f"#{number}" for number in range(1, MEMBERS + 1))], strict=True)
        )
        spread = np.sqrt(((np.array(others) - found) ** 2).mean(axis=0)) / right
        off = found / right - 1
        rows.append([str(drawing), *(f"{100 * a:+.2f} %, {100 * 2 * b:.2f} %" for a, b in zip(off, spread, strict=True))])
        console.print(rows[-1])
    return markdown_table(["noise, seed", "pull: off, twice the spread", "narrowing: off, twice the spread"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", action="store_true", help="put the tables into docs/validation/bring-your-own.md")
    parser.add_argument("--table", choices=("regressors", "refused", "search", "data", "stresses", "committee"), help="only this one")
    arguments = parser.parse_args()
    tables = {"regressors": of_ten, "refused": refused, "search": lambda folder: search(), "data": lambda folder: of_data()}
    tables |= {"stresses": lambda folder: stress_by_stress(), "committee": committees}
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
