"""From a fitted pipeline to the plain arrays that a simulation needs."""

from __future__ import annotations

import numpy as np
from sklearn.compose import TransformedTargetRegressor
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler

from ..forces import Domain, NetworkForce
from ..materials import Law
from .target import InputAwareTargetRegressor


def network_force(model: InputAwareTargetRegressor, law: Law, domain: Domain, name: str = "unsaved") -> NetworkForce:
    """The network of a fitted `bond_force_pipeline`, with both scalings folded into its first and last layer.

    Parameters
    ----------
    model : InputAwareTargetRegressor
        Fitted, with a regressor that has ``coefs_``, ``intercepts_`` and ``activation``.
    law : Law
        Of the training data.
    domain : Domain
        Where it holds.
    name : str

    Returns
    -------
    NetworkForce

    Raises
    ------
    ValueError
        If the pipeline is not of that make.
    """
    pipeline = getattr(model, "regressor_", None)
    if not isinstance(pipeline, Pipeline) or list(pipeline.named_steps) != ["features", "scaling", "network"]:
        raise ValueError("only a fitted bond_force_pipeline, with steps features, scaling and network, can become a surrogate")
    scaling, last = pipeline["scaling"], pipeline["network"]
    if not isinstance(scaling, StandardScaler) or not isinstance(last, TransformedTargetRegressor):
        raise ValueError("the pipeline's scaling must be a StandardScaler and its network a TransformedTargetRegressor")
    network, target = last.regressor_, last.transformer_
    if not all(hasattr(network, key) for key in ("coefs_", "intercepts_", "activation")):
        raise ValueError(f"{type(network).__name__} has no layers to export (coefs_, intercepts_, activation)")
    coefs = [np.array(weights, dtype=float) for weights in network.coefs_]
    intercepts = [np.array(biases, dtype=float) for biases in network.intercepts_]
    intercepts[0] = intercepts[0] - (scaling.mean_ / scaling.scale_) @ coefs[0]
    coefs[0] = coefs[0] / scaling.scale_[:, None]
    coefs[-1] = coefs[-1] * target.scale_
    intercepts[-1] = intercepts[-1] * target.scale_ + target.mean_
    feature_set = pipeline["features"].kw_args["features"]
    layers = tuple((np.ascontiguousarray(W), np.ascontiguousarray(b)) for W, b in zip(coefs, intercepts, strict=True))
    return NetworkForce(name, feature_set, network.activation, layers, model.offsets_.astype(float), domain, law.name, law.shape)
