"""Pipeline for a bond force: features, scaling, dimensionless target, regressor."""

from functools import partial

import numpy as np
from sklearn.base import is_regressor
from sklearn.compose import TransformedTargetRegressor
from sklearn.multioutput import MultiOutputRegressor
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler
from sklearn.utils import get_tags

from ..arguments import check_known
from ..kernels.bond_force import along_and_across
from ..kernels.feature_sets import FEATURE_SETS
from .base import check_targets, checked_columns, named
from .levenberg_marquardt import LevenbergMarquardtRegressor
from .sampling import COLUMNS, OUTPUTS, force_factor
from .target import InputAwareTargetRegressor, is_search

SHEARLESS = float(np.sqrt(np.finfo(float).eps))
"""Ratio |U_nm|/U_nn up to which a bond counts as one without shear, with U in axes along (n) and
across (m) the bond.

At this ratio the quotient T_nm/U_nm of stress and stretch components, of which an output consists,
has lost half of its digits.
"""

AT_REST = (1.0, 0.0, 1.0, 1.0, 1.0)
"""Bond quantities of an undeformed bond of the length of the horizon."""


def bond_force_pipeline(
    regressor,
    features: str | None,
    horizon: float,
    weight: str | None,
    shear_modulus: float,
) -> InputAwareTargetRegressor:
    """Return an unfitted pipeline that predicts bond forces; `pdsurrogate.surrogate_pipeline`
    explains the arguments.
    """
    features = "symmetric" if features is None else features
    check_known(features, FEATURE_SETS, f"unknown features {features!r}")
    factor = (
        None
        if weight is None
        else partial(force_factor, horizon=horizon, weight=weight, shear_modulus=shear_modulus)
    )
    anchored = FEATURE_SETS[features].anchored
    inner = LevenbergMarquardtRegressor(random_state=0) if regressor is None else regressor
    steps = [
        ("features", feature_transformer(features, horizon)),
        ("scaling", StandardScaler()),
        (
            "regressor",
            TransformedTargetRegressor(_for_two_outputs(inner), transformer=StandardScaler()),
        ),
    ]
    return InputAwareTargetRegressor(
        Pipeline(steps),
        func=partial(outputs_of_force, features=features, factor=factor),
        inverse_func=partial(force_of_outputs, features=features, factor=factor),
        anchor=(AT_REST[0], AT_REST[1], horizon, *AT_REST[3:]) if anchored is not None else None,
        anchored_outputs=(anchored,) if anchored is not None else (),
    )


def _for_two_outputs(regressor):
    """Return the regressor, wrapped in `MultiOutputRegressor` if it fits one target only; raise
    ValueError if it is not a regressor.
    """
    if (
        isinstance(regressor, type)
        or not (hasattr(regressor, "fit") and hasattr(regressor, "predict"))
        or not is_regressor(regressor)
    ):
        title = regressor.__name__ if isinstance(regressor, type) else type(regressor).__name__
        more = "; give an instance of it" if isinstance(regressor, type) else ""
        raise ValueError(f"{title} is not a regressor with the methods fit and predict{more}")
    return regressor if _takes_two_outputs(regressor) else MultiOutputRegressor(regressor)


def _takes_two_outputs(regressor) -> bool:
    """Return whether a regressor fits two targets at once, by its scikit-learn tag; MLPRegressor
    counts although its tag denies it.
    """
    if hasattr(regressor, "steps"):
        return _takes_two_outputs(regressor.steps[-1][1])
    if is_search(regressor):
        return _takes_two_outputs(regressor.estimator)
    # The module of torch defines its outputs.
    return (
        get_tags(regressor).target_tags.multi_output
        or isinstance(regressor, MLPRegressor)
        or hasattr(regressor, "module")
    )


def feature_set_of(model) -> str:
    """Return the name of the feature set of a bond-force pipeline, fitted or unfitted; raise
    ValueError for any other model.
    """
    pipeline = getattr(model, "regressor_", getattr(model, "regressor", None))
    if (
        isinstance(model, InputAwareTargetRegressor)
        and isinstance(pipeline, Pipeline)
        and len(pipeline.steps) > 1
    ):
        features = pipeline.steps[0][1]
        outputs = model.func
        right = (
            getattr(features, "func", None) is feature_values
            and getattr(outputs, "func", None) is outputs_of_force
        )
        if right and features.kw_args["features"] == outputs.keywords["features"]:
            return features.kw_args["features"]
    raise ValueError(
        "give a surrogate_pipeline for bond forces, which begins with the features of bonds, with"
        " their outputs as target"
    )


def feature_transformer(features: str, horizon: float = 1.0) -> FunctionTransformer:
    """Return a scikit-learn transformer from the five bond quantities (`COLUMNS`) to the
    features of a named feature set.
    """
    return FunctionTransformer(
        feature_values,
        kw_args={"features": features, "horizon": horizon},
        feature_names_out=partial(_names, features=features),
        check_inverse=False,
    )


@named()
def feature_values(X, features: str = "symmetric", horizon: float = 1.0) -> np.ndarray:
    """Return the features of a named feature set, shape (n, n_features), for bonds X with the
    columns `COLUMNS`.
    """
    a, b, U_mm, J, C33, length = _bond_state(X)
    chosen = FEATURE_SETS[features]
    return np.stack(
        chosen.inputs(chosen.shared(a, b, J, C33), a, b, U_mm, J, C33, length / horizon), axis=1
    )


@named(COLUMNS, OUTPUTS)
def outputs_of_force(X, y, features: str, factor=None) -> np.ndarray:
    """Return the training targets of the regressor, shape (n, 2): the two scalars from which a
    feature set composes the bond forces y.

    ``factor(length)`` is the unit of dimensional forces, by which y is divided; None stands for
    dimensionless forces. Outputs that vary by rounding only are made constant: scaled to unit
    variance they would be noise to fit. If one of the outputs is a derivative by the shear U_nm,
    both are NaN for a bond with U_nm = 0, whose force does not determine the derivative.
    """
    a, b, U_mm, J, C33, length = _bond_state(X)
    check_targets(y, OUTPUTS)
    force = np.asarray(y) if factor is None else y / factor(length)[:, None]
    T_nn, T_nm = along_and_across(*force.T, a, -b, X[:, 0]).T  # the rotation back
    chosen = FEATURE_SETS[features]
    without_shear = np.abs(b) <= SHEARLESS * a
    b = np.where(without_shear, 0.0, b)
    with np.errstate(divide="ignore", invalid="ignore"):
        outputs = np.stack(
            chosen.outputs(chosen.shared(a, b, J, C33), T_nn, T_nm, a, b, U_mm, J, C33), axis=1
        )
    undetermined = without_shear & ~np.isfinite(outputs).all(axis=1)
    outputs[undetermined] = np.nan
    if not undetermined.all():
        known = outputs[~undetermined]
        constant = np.ptp(known, axis=0) < 1e-10 * np.abs(known).max()
        outputs[np.ix_(~undetermined, constant)] = np.median(known[:, constant], axis=0)
    return outputs


@named()
def force_of_outputs(X, z, features: str, factor=None) -> np.ndarray:
    """Return bond forces along and across the deformed bonds X, shape (n, 2), from outputs z, shape
    (n, 2), of a regressor.

    The feature set named `features` defines how the outputs determine the force. ``factor(length)``
    is the unit of dimensional forces, by which the result is multiplied; None stands for
    dimensionless forces. The inverse is `outputs_of_force`.
    """
    a, b, U_mm, J, C33, length = _bond_state(X)
    chosen = FEATURE_SETS[features]
    T_nn, T_nm, _ = chosen.traction(
        chosen.shared(a, b, J, C33), z[:, 0], z[:, 1], a, b, U_mm, J, C33
    )
    force = along_and_across(T_nn, T_nm, a, b, X[:, 0])
    return force if factor is None else force * factor(length)[:, None]


def _bond_state(X):
    """Return the components U_nn, U_nm and U_mm of the stretch tensor, J, C33 and length of the
    bonds X (columns `COLUMNS`).

    The axis n is along the undeformed bond, and m across. Raise ValueError for rotations that no
    stretch tensor gives a bond: a right angle or more.
    """
    stretch, rotation, length, C33, J = checked_columns(X, COLUMNS, ("stretch", "C33", "J"))
    a = stretch * np.cos(rotation)
    b = stretch * np.sin(rotation)
    if not (a > 0).all():
        raise ValueError(
            "rotation: a bond is turned by a right angle or more relative to its horizon, which no"
            " stretch tensor can do"
        )
    return a, b, (J + b * b) / a, J, C33, length


@named()
def _names(transformer, input_features, features):
    return np.asarray(FEATURE_SETS[features].names, dtype=object)
