"""What a user brings as a model, an estimator, an artefact or an object of their own: as a force model, and against its law."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

from ..artifacts import load_surrogate
from ..forces import AnalyticBondForce, Domain, ForceModel, ForceSurrogate, LearntBondForce, LearntEnergy
from ..forces.bond_energy import EnergySurrogate
from ..materials import Law
from ..materials.law import checked_law
from .energy import energy_network, evaluate_energy, form_of, range_of_stretches
from .export import best_of, force_of, surrogate_of
from .fitting import MEMBER_STATES, check_worth_storing
from .pipeline import feature_set_of
from .sampling import COLUMNS, BondSamples, checked_range
from .target import InputAwareTargetRegressor
from .validation import force_report, relative_errors

NAME = "fitted pipeline"


def force_model_of(model: BaseEstimator, law: Law) -> LearntBondForce | LearntEnergy:
    """The force model of a fitted `bond_force_pipeline` or `energy_pipeline`, or of a search over one.

    Its domain are the states that it was fitted to.  A pipeline does not know its material: `law` is taken for it.

    Parameters
    ----------
    model : estimator
    law : Law

    Raises
    ------
    ValueError
        If it is none, is not fitted, or was read from a file, which does not say what it was fitted to.
    """
    model = best_of(model)
    form = form_of(model) if isinstance(model, InputAwareTargetRegressor) else None
    if form is None:
        try:
            feature_set_of(model)
        except ValueError:
            raise ValueError(
                f"a {type(model).__name__} by itself does not say which stretches it was fitted to: fit it within a bond_force_pipeline, "
                "which takes any regressor, or give pds.store the samples that it was fitted to, and simulate the artefact"
            ) from None
    check_is_fitted(model)
    if model.training_inputs_ is None:
        raise ValueError(
            "a pipeline read from a file does not say which stretches it was fitted to: give the artefact instead, or fit it here"
        )
    X = model.training_inputs_
    if form is not None:
        return energy_network(model, law, form.range_of(X), X, NAME)
    stretch, rotation, J, C33 = (X[:, COLUMNS.index(name)] for name in ("stretch", "rotation", "J", "C33"))
    # Of the stretch tensor U that a bond's stretch and rotation and the area ratio define.
    U_nn, U_nm = stretch * np.cos(rotation), stretch * np.sin(rotation)
    low, high = range_of_stretches(U_nn**2 + 2 * U_nm**2 + ((J + U_nm**2) / U_nn) ** 2, J)
    bulk = J * J * C33
    return surrogate_of(model, law, Domain(low, high, float(bulk.min()), float(bulk.max())), NAME)


def stated_against(model: LearntBondForce | LearntEnergy, law: Law, states: np.ndarray) -> LearntBondForce | LearntEnergy:
    """A model with its errors against a law where it was fitted, as the card of an artefact states them of its domain.

    So a run judges a fitted pipeline and the artefact that `pdsurrogate.store` makes of it for that law by the same measure.

    Parameters
    ----------
    model : LearntBondForce or LearntEnergy
    law : Law
    states : ndarray, shape (n, 5) or (n, 2)
        Inputs that it was fitted to: of an energy its domain is all of them, of a bond force also what they were perturbed by.

    Raises
    ------
    TooInexact
        Where nothing would be stored.
    """
    if isinstance(model, LearntEnergy):
        found = evaluate_energy(model, law, n_samples=MEMBER_STATES)["on_surface"]
    else:
        some = states[:: -(-len(states) // MEMBER_STATES)]
        found = relative_errors(model.bond_force, BondSamples(some, AnalyticBondForce(law).bond_force(*some.T), {}))
    reach = model.domain.least_stretch, model.domain.greatest_stretch
    check_worth_storing({"on_surface": found, "stretch_range": reach}, model.name, law, "which the scene asks for", "run")
    return replace(model, stated={"rms": found["rms"], "max": found["max"], "bulk_ratio": law.bulk_modulus / law.shear_modulus})


def evaluate(
    model, law: Law, stretch_range: tuple[float, float] | None = None, n_samples: int = 20_000, random_state: int = 1_000_003
) -> dict:
    """Report of a model against the exact bond force, or energy, of a law, in double precision.

    Parameters
    ----------
    model : estimator, str, path, ForceModel, object or callable
        A fitted `bond_force_pipeline` or `energy_pipeline`, a search over one, or another regressor of the five bond quantities: as they
        predict, before anything is taken over or resampled; an artefact (NAME, NAME@VERSION or a path); a force model; an object with a
        ``bond_force``; or a function ``force(stretch, rotation, length, C33, J)``.
    law : Law
    stretch_range : tuple of float, optional
        Of the principal stretches; those of the model's own domain by default, 0.5 to 4 where it states none.
    n_samples : int
        Of each set of states.
    random_state : int
        Seed; choose one that no training used.

    Returns
    -------
    dict
        See `pdsurrogate.learning.validation.force_report`, and of an energy `pdsurrogate.evaluate_energy`.

    Raises
    ------
    TypeError, ValueError
        If the model is none of these, or not fitted.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.load_surrogate("neo-hookean@1")
    >>> pds.evaluate(model.bond_force, pds.NeoHookean(), n_samples=500)["on_surface"]["rms"] < 1e-4
    True
    """
    checked_law(law)
    if isinstance(model, str | Path):
        model = load_surrogate(model)
        if hasattr(model, "law") and isinstance(model, ForceSurrogate) and model.domain is None:
            model.law = law  # of the exact model, which serves every law
    model = best_of(model)
    if isinstance(model, InputAwareTargetRegressor) and form_of(model) is not None:
        model = force_model_of(model, law)
    if isinstance(model, EnergySurrogate | LearntEnergy):
        return evaluate_energy(model, law, stretch_range, n_samples, random_state)
    if isinstance(model, ForceModel) and not isinstance(model, ForceSurrogate):
        raise TypeError(f"{model.name} has no bond force of its own to evaluate")
    domain = getattr(model, "domain", None)
    own = (domain.least_stretch, domain.greatest_stretch) if isinstance(domain, Domain) else (0.5, 4.0)
    stretches = checked_range(own if stretch_range is None else stretch_range)
    return force_report(force_of(model), law, stretches, n_samples, random_state)
