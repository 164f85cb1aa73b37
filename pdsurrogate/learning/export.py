"""From a fitted pipeline to the plain arrays that a simulation needs."""

from __future__ import annotations

import numpy as np
from sklearn.preprocessing import StandardScaler
from sklearn.utils.validation import check_is_fitted

from ..forces import Domain, LearntBondForce, NetworkForce, PolynomialForce
from ..materials import Law
from .chebyshev import ChebyshevRegressor
from .pipeline import parts_of
from .target import InputAwareTargetRegressor


def surrogate_of(model: InputAwareTargetRegressor, law: Law, domain: Domain, name: str = "unsaved") -> LearntBondForce:
    """The surrogate of a fitted `bond_force_pipeline`: the same function, both scalings folded into its constants.

    Parameters
    ----------
    model : InputAwareTargetRegressor
        Fitted, with a `ChebyshevRegressor`, or any network that has ``coefs_``, ``intercepts_`` and ``activation``.
    law : Law
        Of the training data.
    domain : Domain
        Where it holds.
    name : str

    Returns
    -------
    NetworkForce or PolynomialForce

    Raises
    ------
    ValueError
        If the pipeline is not of that make, or not fitted.
    """
    parts = parts_of(model)
    check_is_fitted(model)
    common = (name, parts.feature_set, model.offsets_.astype(float), domain, law.name, law.shape)
    scaling, target = shift_and_scale(parts.scaling), shift_and_scale(parts.target)
    if isinstance(parts.regressor, ChebyshevRegressor):
        return PolynomialForce(*common, *_polynomial(parts.regressor, *scaling, *target))
    return NetworkForce(*common, parts.regressor.activation, _layers(parts.regressor, *scaling, *target))


def shift_and_scale(scaler: StandardScaler) -> tuple[np.ndarray, np.ndarray]:
    """What a fitted scaler takes off and divides by: zeros and ones where it was told not to."""
    count = scaler.n_features_in_
    return scaler.mean_ if scaler.with_mean else np.zeros(count), scaler.scale_ if scaler.with_std else np.ones(count)


def _layers(network, shift, scale, target_shift, target_scale):
    coefs = [np.array(weights, dtype=float) for weights in network.coefs_]
    intercepts = [np.array(biases, dtype=float) for biases in network.intercepts_]
    intercepts[0] = intercepts[0] - (shift / scale) @ coefs[0]
    coefs[0] = coefs[0] / scale[:, None]
    coefs[-1] = coefs[-1] * target_scale
    intercepts[-1] = intercepts[-1] * target_scale + target_shift
    return tuple((np.ascontiguousarray(W), np.ascontiguousarray(b)) for W, b in zip(coefs, intercepts, strict=True))


def _polynomial(regressor, shift, scale, target_shift, target_scale):
    centre = shift + scale * regressor.centre_
    coefficients = np.zeros((target_scale.size, *(regressor.powers_.max(axis=0) + 1)))
    for (i, j), values in zip(regressor.powers_, regressor.coef_ * target_scale, strict=True):
        coefficients[:, i, j] = values
    coefficients[:, 0, 0] += target_shift
    return centre, scale * regressor.half_width_, coefficients
