"""Conversion of a fitted model of a bond force to the plain arrays that a simulation needs,
exactly or by resampling onto a spline.
"""

import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, MetaEstimatorMixin
from sklearn.compose import TransformedTargetRegressor
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.validation import check_is_fitted

from ..forces import (
    Domain,
    ForceSurrogate,
    LearnedBondForce,
    NetworkForce,
    OwnBondForce,
    PolynomialForce,
    SplineForce,
    is_own_force,
)
from ..kernels.feature_sets import FEATURE_SETS
from ..kernels.network import ACTIVATIONS, MOST_HIDDEN, network_outputs
from ..kernels.spline import FEATURES
from ..materials import Law
from .chebyshev import ChebyshevRegressor
from .pipeline import AT_REST, feature_set_of, feature_values, force_of_outputs
from .resampling import MARGIN, Spline, isochoric_outputs_of, resampled
from .sampling import COLUMNS, wide_bonds
from .target import InputAwareTargetRegressor, is_search, relative_errors

Layers = tuple[tuple[np.ndarray, np.ndarray], ...]

TORCH_ACTIVATIONS = {
    "Algebraic": "algebraic",
    "Sigmoid": "logistic",
    "Tanh": "tanh",
    "ReLU": "relu",
}
"""Names of activations in the kernels by the names of modules of torch."""

AGREEMENT = 1e-5
"""Greatest difference between the outputs of extracted layers and the predictions of their
estimator, divided by the RMS of the predictions. Chosen: networks of torch have single precision
unless a user asks for double.
"""

STATES = 4000
"""Most training states at which a surrogate is compared with the model that it was made of: the RMS
of n normal errors is known to 1/sqrt(2 n), here to about 1 %.
"""


def taken_over(
    model, law: Law, domain: Domain, name: str, states: np.ndarray | None = None
) -> tuple[LearnedBondForce, dict]:
    """Return the surrogate made of a fitted model of a bond force, and a report on the error where
    the model had to be resampled.

    Networks of one to three hidden layers and `ChebyshevRegressor` are converted exactly, with
    scalings folded into their constants, and the report is empty. Any other model is resampled onto
    a spline: of its own features if it is a `surrogate_pipeline` with two or three features,
    otherwise of the two features "isochoric".

    The report names the model and the spline, and states the error of resampling (``rms`` and
    ``max``, divided by the RMS of the force, on states of the training set) and ``jump``, the
    greatest step of a discontinuous function divided by the RMS of its outputs. `states` are the
    bonds of the training set (columns `COLUMNS`) for a model that is no `surrogate_pipeline`; a
    fitted pipeline keeps its own. Without them the errors are those on bonds drawn from the domain.
    """
    model = best_of(model)
    force = force_of(model)
    is_pipeline = isinstance(model, InputAwareTargetRegressor)
    if is_pipeline:
        states = (
            None
            if model.training_inputs_ is None
            else model.training_inputs_ / [1, 1, _horizon_of(model), 1, 1]
        )
    if states is None:
        states = wide_bonds(
            law, STATES, (domain.least_stretch, domain.greatest_stretch), 0.25, 2 / 3, 0
        )[0]
    states = states[np.linspace(0, len(states) - 1, min(STATES, len(states))).astype(int)]
    described = (domain, law.name, law.shape)
    feature_set = "isochoric"
    offsets = np.zeros(2)
    anchored = [1]
    function = isochoric_outputs_of(force)
    if is_pipeline:
        own = feature_set_of(model)
        rest = model.regressor_[1:]
        common = (name, own, model.offsets_.astype(float), *described)
        count = len(FEATURE_SETS[own].names)
        if count == 2 and (polynomial := _polynomial_of(model)) is not None:
            return PolynomialForce(*common, *polynomial), {}
        network = network_of(rest, feature_values(states, own))
        if network is not None:
            return NetworkForce(*common, *network), {}
        if count in FEATURES:
            feature_set = own
            offsets = common[2]
            anchored = list(model.anchored_outputs)
            function = partial(_quietly, rest.predict)
    at_rest = feature_values(np.array([AT_REST]), feature_set)
    right = np.asarray(force(*states.T), dtype=float)

    def made_of(spline: Spline) -> SplineForce:
        found = SplineForce(name, feature_set, offsets, *described, *spline)
        zero = offsets.copy()
        zero[anchored] = found.outputs(at_rest)[0, anchored]
        return replace(found, at_rest=zero)

    def errors(spline: Spline) -> dict[str, float]:
        return relative_errors(made_of(spline).bond_force(*states.T), right)

    spline, jump = resampled(
        function, *feature_box(feature_set, domain, states), lambda spline: errors(spline)["rms"]
    )
    surrogate = made_of(spline)
    onto = f"cubic spline of {' and '.join(surrogate.features)}, {surrogate.size}"
    return surrogate, {
        "model": title_of(regressor_of(model)),
        "onto": onto,
        **errors(spline),
        "jump": jump,
    }


def best_of(model):
    """Return the best fitted estimator of a search over parameters, and any other model unchanged.

    If the model or the best estimator is a `Pipeline` of a single step, return this step: in such a
    pipeline a search can exchange whole `surrogate_pipeline` models of different feature sets.
    Raise ValueError for a search that is not fitted, or keeps no fitted estimator.
    """
    if is_search(model):
        check_is_fitted(model)
        if not hasattr(model, "best_estimator_"):
            raise ValueError(f"the {type(model).__name__} has no fitted model: set refit=True")
        model = model.best_estimator_
    return model.steps[0][1] if isinstance(model, Pipeline) and len(model.steps) == 1 else model


def force_of(model) -> Callable:
    """Return the dimensionless bond force ``force(stretch, rotation, length, C33, J)`` of a model.

    The model is as for `pdsurrogate.learning.surrogate_of`, or a function of the five quantities.
    Raise ValueError for a model without such a force.
    """
    model = best_of(model)
    if isinstance(model, InputAwareTargetRegressor):
        feature_set = feature_set_of(model)
        check_is_fitted(model)

        def force(stretch, rotation, length, C33, J):
            X = np.column_stack(
                np.broadcast_arrays(
                    *np.atleast_1d(
                        stretch, rotation, np.multiply(length, _horizon_of(model)), C33, J
                    )
                )
            )
            return force_of_outputs(
                X, _quietly(model.regressor_.predict, X) - model.offsets_, feature_set
            )

        return force
    if isinstance(model, ForceSurrogate):
        return model.bond_force
    if is_own_force(model):
        return OwnBondForce(model).bond_force
    if isinstance(model, BaseEstimator):
        if not callable(getattr(model, "predict", None)):
            raise ValueError(
                f"a {type(model).__name__} has no method predict: give a regressor of bond forces"
            )
        check_is_fitted(model)
        count = getattr(model, "n_features_in_", len(COLUMNS))
        names = list(getattr(model, "feature_names_in_", COLUMNS))
        if count != len(COLUMNS) or sorted(names) != sorted(COLUMNS):
            found = (
                f"{count} features" if count != len(COLUMNS) else f"the columns {', '.join(names)}"
            )
            raise ValueError(
                f"the {type(model).__name__} was fitted to {found}; fit it to the five bond"
                f" quantities {', '.join(COLUMNS)}, in any order, or as part of a"
                " surrogate_pipeline, which computes features from them"
            )
        order = [COLUMNS.index(name) for name in names]
        return lambda *bond: _quietly(
            model.predict, np.column_stack(np.broadcast_arrays(*bond))[:, order]
        )
    if isinstance(model, type):
        raise TypeError(f"{model.__name__} is a class: give an instance, {model.__name__}()")
    if callable(model):
        return lambda *bond: _checked_forces(model, *np.broadcast_arrays(*np.atleast_1d(*bond)))
    raise ValueError(f"a {type(model).__name__} is not a model of a bond force")


def _checked_forces(function: Callable, *bond) -> np.ndarray:
    """Return the forces of a user's function at arrays `bond` of bond quantities; raise
    ValueError unless they are two for each bond.
    """
    force = np.asarray(function(*bond))
    if force.shape != (len(bond[0]), 2):
        raise ValueError(
            "a bond-force function must return t_n and t_tau, an array of shape"
            f" {(len(bond[0]), 2)}, not {force.shape}"
        )
    return force


def _horizon_of(model: InputAwareTargetRegressor) -> float:
    """Return the horizon of a fitted bond-force pipeline, in the unit of length of the training
    samples.
    """
    return model.regressor_[0].kw_args["horizon"]


def _quietly(function: Callable, X) -> np.ndarray:
    """Return the result of a method of an estimator for the array X, without scikit-learn's
    warning if it was fitted to a table.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="X does not have valid feature names")
        return np.asarray(function(X), dtype=float)


def feature_box(
    feature_set: str, domain: Domain, states: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper bounds of the features of the bonds `states` and of a grid of
    bonds that covers a domain.

    The bounds are moved outward by the share `MARGIN` of their distance.
    """
    logs = np.linspace(np.log(domain.least_stretch), np.log(domain.greatest_stretch), 25)
    bulk = np.exp(np.linspace(np.log(domain.least_bulk), np.log(domain.greatest_bulk), 3))
    angles = np.linspace(0.01, np.pi / 2 - 0.01, 13)
    lengths = (0.05, 1.0)
    first, second, J3, angle, length = (
        grid.ravel() for grid in np.meshgrid(np.exp(logs), np.exp(logs), bulk, angles, lengths)
    )
    cos = np.cos(angle)
    sin = np.sin(angle)
    J = first * second
    a = first * cos**2 + second * sin**2
    b = (second - first) * sin * cos
    corners = np.column_stack([np.hypot(a, b), np.arctan2(b, a), length, J3 / J**2, J])
    features = feature_values(np.concatenate([corners, states]), feature_set)
    low = features.min(axis=0)
    high = features.max(axis=0)
    beyond = MARGIN * (high - low)
    return low - beyond, high + beyond


def regressor_of(model):
    """Return the innermost regressor of a fitted pipeline, without features and scalings; return
    any other model unchanged.
    """
    if not isinstance(model, InputAwareTargetRegressor):
        return model
    last = model.regressor_[-1]
    return getattr(last, "regressor_", last)


def title_of(regressor) -> str:
    """Return the class name of a regressor, followed by the class name of an inner estimator in
    brackets, if there is one.
    """
    inner = regressor.steps[-1][1] if hasattr(regressor, "steps") else None
    if inner is None and isinstance(regressor, MetaEstimatorMixin):
        inner = getattr(regressor, "best_estimator_", getattr(regressor, "estimator", None))
    return (
        type(regressor).__name__
        if inner is None
        else f"{type(regressor).__name__}({title_of(inner)})"
    )


def _polynomial_of(model):
    """Return centers and half widths of the features, and coefficients, of a fitted polynomial
    with scalings folded in; else None.
    """
    *scaling, last = (step for _, step in model.regressor_.steps[1:])
    scalers = [*scaling, getattr(last, "transformer_", None)]
    if len(scalers) != 2 or not all(isinstance(scaler, StandardScaler) for scaler in scalers):
        return None
    regressor: Any = last.regressor_
    if not isinstance(regressor, ChebyshevRegressor):
        return None
    (shift, scale), (target_shift, target_scale) = (
        (
            scaler.mean_ if scaler.with_mean else np.zeros(scaler.n_features_in_),
            scaler.scale_ if scaler.with_std else np.ones(scaler.n_features_in_),
        )
        for scaler in scalers
    )
    coefficients = np.zeros((*(regressor.powers_.max(axis=0) + 1), target_scale.size))
    coefficients[tuple(regressor.powers_.T)] = regressor.coef_ * target_scale
    coefficients[(0,) * len(shift)] += target_shift
    return (
        shift + scale * regressor.center_,
        scale * regressor.half_width_,
        np.ascontiguousarray(np.moveaxis(coefficients, -1, 0)),
    )


def network_of(estimator, features: np.ndarray) -> tuple[str, Layers] | None:
    """Return activation and layers of a fitted estimator that is a network the kernels evaluate;
    None for any other estimator.

    Networks are scikit-learn's ``MLPRegressor``, other estimators with ``coefs_``, ``intercepts_``
    and ``activation``, and skorch's regressors whose module is a sequence of linear layers with one
    kind of activation between; also as the last step of a pipeline whose other steps are affine,
    and with an affine transformation of the target. The layers are compared with the predictions of
    the estimator at `features`, shape (m, n), so that a module with another forward pass, or a step
    that is not affine, is not accepted.
    """
    try:
        activation, layers = _layers_of(estimator, features.shape[1])
    except NoNetwork:
        return None
    if activation not in ACTIVATIONS or not 1 <= len(layers) - 1 <= MOST_HIDDEN:
        return None
    values = network_outputs(features, layers, ACTIVATIONS[activation])
    expected = _quietly(estimator.predict, features)
    agree = expected.shape == values.shape and np.abs(
        values - expected
    ).max() <= AGREEMENT * np.sqrt((expected**2).mean())
    return (activation, layers) if agree else None


class NoNetwork(Exception):
    """Exception for an estimator whose last step is not a network with layers."""


def _layers_of(estimator, n_features: int) -> tuple[str, Layers]:
    """Return activation and layers of a network, with all other steps folded in as if affine;
    raise `NoNetwork` without layers.
    """
    if isinstance(estimator, Pipeline):
        first = estimator.steps[0][1]
        rest = estimator[1:]
        if not len(rest):
            return _layers_of(first, n_features)
        matrix, shift = _affine(estimator[:1].transform, n_features)
        activation, ((weights, biases), *others) = _layers_of(rest, len(shift))
        return activation, ((matrix @ weights, shift @ weights + biases), *others)
    if isinstance(estimator, TransformedTargetRegressor):
        activation, (*others, (weights, biases)) = _layers_of(estimator.regressor_, n_features)
        matrix, shift = _affine(estimator.transformer_.inverse_transform, biases.size)
        return activation, (*others, (weights @ matrix, biases @ matrix + shift))
    if all(hasattr(estimator, key) for key in ("coefs_", "intercepts_", "activation")):
        pairs = zip(estimator.coefs_, estimator.intercepts_, strict=True)
        return estimator.activation, tuple(
            (np.array(W, dtype=float), np.array(b, dtype=float)) for W, b in pairs
        )
    if hasattr(estimator, "module_"):
        return layers_of_module(estimator.module_)
    raise NoNetwork


def _affine(transform, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrix M and the vector c of the affine function ``transform``, x -> x M + c,
    of `count` features.
    """
    values = _quietly(transform, np.vstack([np.zeros((1, count)), np.eye(count)]))
    return values[1:] - values[0], values[0]


def layers_of_module(module) -> tuple[str, Layers]:
    """Return the activation and the linear layers of a torch module; raise `NoNetwork` unless
    layers and one activation alternate.
    """
    leaves = [leaf for leaf in module.modules() if not list(leaf.children())]
    names = [type(leaf).__name__ for leaf in leaves]
    kinds = set(names[1::2])
    if (
        len(leaves) % 2 == 0
        or set(names[::2]) != {"Linear"}
        or len(kinds) != 1
        or not kinds <= set(TORCH_ACTIVATIONS)
    ):
        raise NoNetwork
    layers = []
    for leaf in leaves[::2]:
        weights, biases = (
            None if array is None else array.detach().cpu().numpy().astype(float)
            for array in (leaf.weight, leaf.bias)
        )
        layers.append(
            (np.ascontiguousarray(weights.T), np.zeros(len(weights)) if biases is None else biases)
        )
    return TORCH_ACTIVATIONS[kinds.pop()], tuple(layers)
