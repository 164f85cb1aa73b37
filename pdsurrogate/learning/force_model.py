"""A fitted pipeline as a force model, without an artefact in between."""

from __future__ import annotations

import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..forces import Domain, LearntBondForce, LearntEnergy
from ..materials import Law
from .energy import energy_network, form_of, range_of_stretches
from .export import surrogate_of
from .sampling import COLUMNS
from .target import InputAwareTargetRegressor

NAME = "fitted pipeline"


def force_model_of(model: InputAwareTargetRegressor, law: Law) -> LearntBondForce | LearntEnergy:
    """The force model of a fitted `bond_force_pipeline` or `energy_pipeline`.

    Its domain are the states that it was fitted to.  A pipeline does not know its material: `law` is taken for it.

    Parameters
    ----------
    model : InputAwareTargetRegressor
    law : Law

    Raises
    ------
    ValueError
        If the pipeline cannot become a surrogate, is not fitted, or was read from a file, which does not say what it was fitted to.
    """
    if not isinstance(model, InputAwareTargetRegressor):
        raise ValueError(
            f"a {type(model).__name__} is no force model: a fitted bond_force_pipeline or energy_pipeline is taken, or an artefact of one"
        )
    check_is_fitted(model)
    if model.training_inputs_ is None:
        raise ValueError(
            "a pipeline read from a file does not say which stretches it was fitted to: give the artefact instead, or fit it here"
        )
    X = model.training_inputs_
    form = form_of(model)
    if form is not None:
        return energy_network(model, law, form.range_of(X), X, NAME)
    stretch, rotation, J, C33 = (X[:, COLUMNS.index(name)] for name in ("stretch", "rotation", "J", "C33"))
    # Of the stretch tensor U that a bond's stretch and rotation and the area ratio define.
    U_nn, U_nm = stretch * np.cos(rotation), stretch * np.sin(rotation)
    low, high = range_of_stretches(U_nn**2 + 2 * U_nm**2 + ((J + U_nm**2) / U_nn) ** 2, J)
    bulk = J * J * C33
    return surrogate_of(model, law, Domain(low, high, float(bulk.min()), float(bulk.max())), NAME)
