"""Regressors of any make as surrogates: what is taken over is exact, what is resampled says by
how much it is off.
"""

import numpy as np
import pytest
from conftest import needs_torch
from refusals import raising
from sklearn import config_context
from sklearn.base import BaseEstimator, RegressorMixin, clone
from sklearn.ensemble import GradientBoostingRegressor, RandomForestRegressor
from sklearn.kernel_ridge import KernelRidge
from sklearn.linear_model import LinearRegression, LogisticRegression, Ridge
from sklearn.model_selection import GridSearchCV
from sklearn.multioutput import MultiOutputRegressor
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import (
    FunctionTransformer,
    MinMaxScaler,
    PolynomialFeatures,
    StandardScaler,
)

import pdsurrogate as pds
from pdsurrogate.forces import Domain, NetworkForce, SplineForce
from pdsurrogate.forces.kernel_values import kernel_bond_force, kernel_tractions
from pdsurrogate.learning import surrogate_of
from pdsurrogate.learning.bond_force import BOND_FORCE
from pdsurrogate.learning.export import force_of, taken_over
from pdsurrogate.learning.resampling import fitted_spline, greatest_jump
from pdsurrogate.learning.sampling import COLUMNS, OUTPUTS

LAW = pds.materials.Ogden()
GRID = "regressor__regressor__regressor"


@pytest.fixture(scope="module")
def samples():
    return pds.training_samples(LAW, 1500, (0.6, 2.5), random_state=0)


def fitted(samples, regressor, features="isochoric"):
    return pds.surrogate_pipeline(regressor, features=features).fit(samples.X, samples.y)


def agreement(surrogate, model, samples) -> float:
    """RMS of the difference over the RMS of the force."""
    right = model.predict(samples.X)
    return float(
        np.sqrt(((surrogate.bond_force(*samples.X.T) - right) ** 2).sum() / (right**2).sum())
    )


class Quadratic(RegressorMixin, BaseEstimator):
    """Smooth, and of a make that nobody knows."""

    def fit(self, X, y):
        self.model_ = make_pipeline(PolynomialFeatures(6), LinearRegression()).fit(X, y)
        self.n_features_in_ = X.shape[1]
        return self

    def predict(self, X):
        return self.model_.predict(X)

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.target_tags.multi_output = True
        return tags


@pytest.mark.parametrize("degree", [0, 3])
def test_a_cubic_is_a_spline_of_it_exactly(degree):
    """Cubics lie in the space of cubic splines: least squares give them back."""
    low, high = np.array([-1.0, 0.5]), np.array([2.0, 3.0])

    def cubic(x):
        return np.stack(
            [x[:, 0] ** degree - x[:, 1], 2 * x[:, 1] ** degree + x[:, 0] * x[:, 1]], axis=1
        )

    spline, values = fitted_spline(cubic, low, high, 6)
    force = SplineForce(
        "x",
        "isochoric",
        np.zeros(2),
        Domain(0.5, 2, 0.9, 1.1),
        "ogden",
        {},
        spline.low,
        spline.step,
        spline.coefficients,
    )
    x = low + (high - low) * np.random.default_rng(0).random((200, 2))
    np.testing.assert_allclose(force.outputs(x), cubic(x), atol=1e-11)
    assert greatest_jump(cubic, low, high, values) < 1e-5
    beyond = np.array([[-9.0, 0.5], [2.0, 99.0], [np.nan, 0.5]])
    np.testing.assert_allclose(
        force.outputs(beyond), cubic(np.array([[-1.0, 0.5], [2.0, 3.0], [-1.0, 0.5]])), atol=1e-11
    )


@pytest.mark.parametrize("cells", [(1, 7), (12, 5)])
def test_spline_kernels_of_two_features(random, cells):
    """Random coefficients in both precisions, inside and outside the box, against NumPy."""
    coefficients = random.standard_normal((2, *(count + 3 for count in cells)))
    low, step = np.array([-1.0, 0.0]), np.array([2.0, 2.2]) / cells
    model = SplineForce(
        "x",
        "isochoric",
        np.array([0.1, -0.2]),
        Domain(0.5, 4, 0.7, 1.4),
        "ogden",
        {},
        low,
        step,
        coefficients,
    )
    X = pds.training_samples(pds.materials.NeoHookean(), 600, random_state=1).X
    exact = model.bond_force(*X.T)
    for dtype in (np.float32, np.float64):
        compiled = kernel_bond_force(model, LAW, dtype)(*X.T)
        # Places within a cell are rounded at the size of the box, in cells.
        assert (
            np.abs(compiled - exact).max()
            < 100 * max(cells) * np.finfo(dtype).eps * np.abs(exact).max()
        )


NETWORK = {"solver": "lbfgs", "max_iter": 30, "random_state": 0}


@pytest.mark.parametrize(
    "regressor",
    [
        MLPRegressor(hidden_layer_sizes=(6, 5, 4), activation="tanh", **NETWORK),
        make_pipeline(
            MinMaxScaler(), MLPRegressor(hidden_layer_sizes=(8,), activation="relu", **NETWORK)
        ),
        make_pipeline(
            PolynomialFeatures(1, include_bias=False),
            MLPRegressor(hidden_layer_sizes=(8,), activation="logistic", **NETWORK),
        ),
    ],
    ids=["three layers", "another scaler", "affine features"],
)
@pytest.mark.filterwarnings("ignore:lbfgs")
def test_networks_are_taken_over_exactly(samples, regressor):
    model = fitted(samples, regressor)
    surrogate, report = taken_over(model, LAW, BOND_FORCE.domain(LAW, samples), "x")
    assert isinstance(surrogate, NetworkForce)
    assert report == {}
    # of the logistic function, which the kernels have to 1e-8
    assert agreement(surrogate, model, samples) < 1e-7


@needs_torch
def test_a_network_of_torch_by_skorch_is_taken_over(samples):
    import skorch
    import torch

    torch.manual_seed(0)

    def module():
        return torch.nn.Sequential(
            torch.nn.Linear(2, 8),
            torch.nn.Tanh(),
            torch.nn.Linear(8, 6),
            torch.nn.Tanh(),
            torch.nn.Linear(6, 2),
        )

    net = skorch.NeuralNetRegressor(module, max_epochs=2, lr=0.01, train_split=None, verbose=0)
    single = FunctionTransformer(np.float32)
    model = pds.surrogate_pipeline(make_pipeline(single, net), features="isochoric")
    model.set_params(
        regressor__regressor__transformer=make_pipeline(
            StandardScaler(), FunctionTransformer(np.float32)
        ),
        regressor__regressor__check_inverse=False,
    )
    model.fit(samples.X, samples.y)
    surrogate, report = taken_over(model, LAW, BOND_FORCE.domain(LAW, samples), "x")
    assert isinstance(surrogate, NetworkForce)
    assert report == {}
    assert agreement(surrogate, model, samples) < 1e-5  # torch predicts in single precision


@needs_torch
@pytest.mark.parametrize("double", [False, True])
def test_a_network_of_another_precision_is_told_in_a_line(samples, double):
    import skorch
    import torch

    def network():
        layers = torch.nn.Sequential(torch.nn.Linear(2, 8), torch.nn.Tanh(), torch.nn.Linear(8, 2))
        return layers.double() if double else layers

    net = skorch.NeuralNetRegressor(network, max_epochs=1, train_split=None, verbose=0)
    model = pds.surrogate_pipeline(net, features="isochoric")
    if double:
        assert model.fit(samples.X, samples.y).predict(samples.X).shape == samples.y.shape
        return
    with raising(r"^the regressor takes numbers of another precision .* module.double\(\)") as told:
        model.fit(samples.X, samples.y)
    assert told.value.__suppress_context__


@pytest.mark.parametrize(
    "regressor",
    [
        Quadratic(),
        KernelRidge(kernel="rbf", alpha=1e-4, gamma=0.1),
        make_pipeline(PolynomialFeatures(5), Ridge(1e-6)),
    ],
    ids=str,
)
def test_smooth_functions_are_resampled_to_the_tolerance(samples, regressor):
    model = fitted(samples, regressor)
    surrogate, report = taken_over(model, LAW, BOND_FORCE.domain(LAW, samples), "x")
    assert isinstance(surrogate, SplineForce)
    assert report["jump"] == 0
    assert agreement(surrogate, model, samples) == pytest.approx(report["rms"])
    assert report["rms"] < 2e-5
    for dtype in (np.float32, np.float64):
        assert (kernel_tractions(surrogate, LAW, dtype, 1.0, 0.0, 0.5, 1.0, 1.0) == 0).all()


@pytest.mark.parametrize(
    "regressor",
    [
        RandomForestRegressor(20, random_state=0),
        GradientBoostingRegressor(n_estimators=60, random_state=0),
    ],
    ids=str,
)
def test_steps_of_trees_are_found_and_smoothed(samples, regressor):
    model = fitted(samples, regressor)
    surrogate, report = taken_over(model, LAW, BOND_FORCE.domain(LAW, samples), "x")
    assert report["jump"] > 0.01
    assert report["rms"] == pytest.approx(agreement(surrogate, model, samples))
    assert report["rms"] < 0.1
    boosted = isinstance(regressor, GradientBoostingRegressor)  # which takes one target
    assert isinstance(model.regressor_[-1].regressor_, MultiOutputRegressor) == boosted


@pytest.mark.parametrize("features", ["symmetric", "paper"])
def test_what_sees_more_than_three_features_is_resampled_as_a_function_of_bonds(samples, features):
    """Of a cubic in four or five features the force is not isotropic; what is left of it is the
    error that is stated.
    """
    model = fitted(samples, make_pipeline(PolynomialFeatures(3), Ridge(1e-6)), features)
    surrogate, report = taken_over(model, LAW, BOND_FORCE.domain(LAW, samples), "x")
    assert surrogate.feature_set == "isochoric"
    assert report["rms"] == pytest.approx(agreement(surrogate, model, samples), rel=1e-6)
    assert report["rms"] < 0.2


def test_a_force_of_python_is_resampled(samples):
    """The exact force itself: what is left is the error of resampling, on and off plane stress."""
    exact = pds.AnalyticBondForce(LAW)

    class Mine:
        def bond_force(self, stretch, rotation, length, C33, J):
            return exact.bond_force(stretch, rotation, length, C33, J)

    surrogate, report = taken_over(Mine(), LAW, BOND_FORCE.domain(LAW, samples), "x", samples.X)
    assert report["model"] == "Mine"
    assert (
        np.abs(surrogate.bond_force(*samples.X.T) - samples.y).max()
        < 1e-3 * np.abs(samples.y).max()
    )
    assert report["rms"] < 1e-4


def test_a_plain_pipeline_of_bonds_is_stored_with_its_samples(samples, tmp_path):
    """Fitted to the five bond quantities and nothing of the package; by itself it does not say
    where it holds.
    """
    model = make_pipeline(StandardScaler(), PolynomialFeatures(5), Ridge(1e-6)).fit(
        samples.X, samples.y
    )
    with raising(r"the stretches .*: fit it within a surrogate_pipeline"):
        pds.simulate("uniaxial", model)
    card = pds.load_card(pds.store(model, samples, LAW, tmp_path, "plain", "1", "plain"))
    assert card.training["resampling"]["rms"] < 0.1
    assert card.training["regressor"] == "Pipeline(Ridge)"
    assert pds.evaluate(model, LAW, (0.6, 2.5), 500)["on_surface"]["rms"] < 0.1


def test_a_search_goes_straight_into_storing_and_evaluation(samples, tmp_path):
    search = GridSearchCV(
        pds.surrogate_pipeline(pds.learning.ChebyshevRegressor(), features="isochoric"),
        {f"{GRID}__degree": [2, 6]},
        cv=3,
    )
    search.fit(samples.X, samples.y)
    card = pds.load_card(pds.store(search, samples, LAW, tmp_path, "searched", "1", "searched"))
    assert [row[f"{GRID}__degree"] for row in card.training["search"]] == [2, 6]
    assert card.training["parameters"] == {"degree": 6}
    assert pds.evaluate(search, LAW, (0.6, 2.5), 500) == pds.evaluate(
        search.best_estimator_, LAW, (0.6, 2.5), 500
    )
    search.refit = False
    with raising("has no fitted model: set refit=True"):
        pds.evaluate(
            GridSearchCV(search.estimator, search.param_grid, cv=2, refit=False).fit(
                samples.X, samples.y
            ),
            LAW,
        )


def test_artifacts_and_names_are_evaluated_as_well(samples, tmp_path):
    path = pds.store(
        fitted(samples, pds.learning.ChebyshevRegressor(6)),
        samples,
        LAW,
        tmp_path,
        "mine",
        "1",
        "x",
    )
    report = pds.evaluate(path, LAW, n_samples=500)
    assert report["stretch_range"] == [0.6, 2.5]
    assert pds.evaluate("analytic", LAW, (0.6, 2.5), 300)["on_surface"]["max"] < 1e-13
    assert "energy_rms" in pds.evaluate("ogden-isochoric", LAW, n_samples=300)["on_surface"]
    with raising("nosb has no bond force or energy of its own", TypeError):
        pds.evaluate("nosb", LAW)


@pytest.mark.parametrize(
    ("regressor", "message"),
    [
        (
            LogisticRegression(),
            "LogisticRegression is not a regressor with the methods fit and predict",
        ),
        (StandardScaler(), "StandardScaler is not a regressor"),
        (Ridge, "Ridge is not a regressor .*; give an instance of it"),
        (3, "int is not a regressor"),
    ],
)
def test_what_cannot_work_says_so_before_the_training(regressor, message):
    with raising(message):
        pds.surrogate_pipeline(regressor, features="isochoric")


def test_what_cannot_work_says_so_before_the_run(samples, tmp_path):
    for columns in (3, 4):
        with raising(f"was fitted to {columns} features; fit it to "):
            pds.store(
                LinearRegression().fit(samples.X[:, :columns], samples.y),
                samples,
                LAW,
                tmp_path,
                "x",
                "1",
                "x",
            )
    with raising("not fitted"):
        surrogate_of(pds.surrogate_pipeline(), LAW, samples)

    class Holed:
        def bond_force(self, stretch, rotation, length, C33, J):
            return np.full((len(stretch), 2), np.nan)

    with raising(r"Holed: bond_force returned t_n = nan, t_tau = nan, .* at stretch = "):
        pds.store(Holed(), samples, LAW, tmp_path, "x", "1", "x")
    assert list(tmp_path.iterdir()) == []


def test_frames_of_pandas_go_through_with_their_names(samples):
    """Columns in, columns between the steps where `set_output` asks for them, and the numbers of
    arrays.
    """
    pandas = pytest.importorskip("pandas")
    X, y = (
        pandas.DataFrame(samples.X, columns=COLUMNS),
        pandas.DataFrame(samples.y, columns=OUTPUTS),
    )
    names = ["log Jbar", "tr Cbar/(2 Jbar) - 1"]
    right = fitted(samples, Ridge(0.1)).predict(samples.X)
    plain = pds.surrogate_pipeline(Ridge(0.1), features="isochoric")
    framed = clone(plain)
    framed.regressor.set_output(transform="pandas")
    with config_context(transform_output="pandas"):
        np.testing.assert_allclose(clone(plain).fit(X, y).predict(X), right, rtol=1e-12, atol=1e-12)
    for model in (plain.fit(X, y), framed.fit(X, y)):
        assert model.feature_names_in_.tolist() == list(COLUMNS)
        np.testing.assert_allclose(model.predict(X), right, rtol=1e-12, atol=1e-12)
        with raising(r"X .* columns stretch, .*, J, .* not stretch, .*, j"):
            model.predict(X.rename(columns={"J": "j"}))
    assert framed.regressor_[:-1].transform(X).columns.tolist() == names
    assert framed.regressor_[-1].regressor_.feature_names_in_.tolist() == names
    assert isinstance(surrogate_of(framed, LAW, samples), SplineForce)


SHUFFLED = ["C33", "J", "rotation", "length", "stretch"]


def test_columns_of_frames_are_told_by_their_names(samples):
    """Columns in another order were taken by their places, and names of other things as well:
    both in silence.
    """
    pandas = pytest.importorskip("pandas")
    X, y = (
        pandas.DataFrame(samples.X, columns=COLUMNS),
        pandas.DataFrame(samples.y, columns=OUTPUTS),
    )
    swapped, other = X[SHUFFLED], X.rename(columns={"J": "detF"})
    model = pds.surrogate_pipeline(pds.learning.ChebyshevRegressor(4), features="isochoric")
    right = clone(model).fit(X, y)
    for found in (clone(model).fit(swapped, y[["t_tau", "t_n"]]), right):
        np.testing.assert_array_equal(found.predict(swapped), right.predict(X))
    with raising(r"X must have the columns stretch, .*, in any order, not .*detF"):
        clone(model).fit(other, y)
    with raising(r"X must have the columns stretch, .*, in any order, not .*more"):
        right.predict(X.assign(more=1.0))
    with raising("y must have the columns t_n, t_tau, in any order, not t_n, force"):
        clone(model).fit(X, y.rename(columns={"t_tau": "force"}))
    energies = pds.training_samples(LAW, 100, (0.7, 2.0), target="isochoric-energy")
    frame = pandas.DataFrame(energies.X[:, ::-1], columns=["I2bar", "I1bar"])
    energy = pds.surrogate_pipeline(
        pds.learning.SobolevRegressor(2, max_iter=2, random_state=0), "isochoric-energy"
    ).fit(frame, energies.y)
    np.testing.assert_array_equal(energy.predict(frame), energy.predict(frame[["I1bar", "I2bar"]]))


def test_a_regressor_fitted_to_a_frame_by_itself_is_asked_in_its_order(samples):
    pandas = pytest.importorskip("pandas")
    X = pandas.DataFrame(samples.X, columns=COLUMNS)
    alone = make_pipeline(PolynomialFeatures(2), LinearRegression())
    model = clone(alone).fit(X[SHUFFLED], samples.y)
    np.testing.assert_allclose(
        force_of(model)(*samples.X.T), model.predict(X[SHUFFLED]), rtol=1e-12
    )
    with raising(r"was fitted to the columns .*detF; fit it to .* stretch"):
        force_of(clone(alone).fit(X.rename(columns={"J": "detF"}), samples.y))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"step": np.array([0.1, -0.1])}, "step must be positive"),
        ({"low": np.zeros(3)}, "low has shape"),
        ({"coefficients": np.zeros((2, 3, 9))}, "coefficients have shape"),
        ({"coefficients": np.zeros((2, 1100, 1100))}, "at most 1048576 are taken"),
        ({"feature_set": "symmetric"}, "a spline takes two or three features, symmetric are 4"),
        ({"more": np.zeros(1)}, "payload has"),
    ],
)
def test_plain_payloads_that_are_no_spline(samples, change, message):
    model = surrogate_of(fitted(samples, Quadratic()), LAW, samples)
    assert np.array_equal(
        SplineForce.from_payload("x", model.payload(), model.domain, "ogden", {}).coefficients,
        model.coefficients,
    )
    with raising(message):
        SplineForce.from_payload("x", {**model.payload(), **change}, model.domain, "ogden", {})
