"""From a fitted pipeline to the plain arrays that a simulation needs."""

from __future__ import annotations

import numpy as np
from sklearn.compose import TransformedTargetRegressor
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler

from ..forces import Domain, LearntBondForce, NetworkForce, PolynomialForce
from ..materials import Law
from .chebyshev import ChebyshevRegressor
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
        If the pipeline is not of that make.
    """
    pipeline = getattr(model, "regressor_", None)
    if not isinstance(pipeline, Pipeline) or list(pipeline.named_steps) != ["features", "scaling", "regressor"]:
        raise ValueError("only a fitted bond_force_pipeline, with steps features, scaling and regressor, can become a surrogate")
    scaling, last = pipeline["scaling"], pipeline["regressor"]
    if not isinstance(scaling, StandardScaler) or not isinstance(last, TransformedTargetRegressor):
        raise ValueError("the pipeline's scaling must be a StandardScaler and its regressor a TransformedTargetRegressor")
    regressor, target = last.regressor_, last.transformer_
    feature_set = pipeline["features"].kw_args["features"]
    common = (name, feature_set, model.offsets_.astype(float), domain, law.name, law.shape)
    if isinstance(regressor, ChebyshevRegressor):
        return PolynomialForce(*common, *_polynomial(regressor, scaling, target))
    if all(hasattr(regressor, key) for key in ("coefs_", "intercepts_", "activation")):
        return NetworkForce(*common, regressor.activation, _layers(regressor, scaling, target))
    raise ValueError(f"{type(regressor).__name__} has no layers to export (coefs_, intercepts_, activation)")


def _layers(network, scaling, target):
    coefs = [np.array(weights, dtype=float) for weights in network.coefs_]
    intercepts = [np.array(biases, dtype=float) for biases in network.intercepts_]
    intercepts[0] = intercepts[0] - (scaling.mean_ / scaling.scale_) @ coefs[0]
    coefs[0] = coefs[0] / scaling.scale_[:, None]
    coefs[-1] = coefs[-1] * target.scale_
    intercepts[-1] = intercepts[-1] * target.scale_ + target.mean_
    return tuple((np.ascontiguousarray(W), np.ascontiguousarray(b)) for W, b in zip(coefs, intercepts, strict=True))


def _polynomial(regressor, scaling, target):
    if regressor.n_features_in_ != 2:
        raise ValueError(f"the kernels evaluate polynomials in two features, this one has {regressor.n_features_in_}")
    centre = scaling.mean_ + scaling.scale_ * regressor.centre_
    coefficients = np.zeros((target.scale_.size, *(regressor.powers_.max(axis=0) + 1)))
    for (i, j), values in zip(regressor.powers_, regressor.coef_ * target.scale_, strict=True):
        coefficients[:, i, j] = values
    coefficients[:, 0, 0] += target.mean_
    return centre, scaling.scale_ * regressor.half_width_, coefficients
