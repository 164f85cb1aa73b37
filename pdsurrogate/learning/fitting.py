"""Errors of fitted models: on samples left out, against the law, and whether they are small enough to store the model."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from sklearn.base import clone
from sklearn.model_selection import KFold

from ..arguments import check_called, check_estimator, check_is, check_jobs, check_seed, check_whole_number
from ..artifacts import load_surrogate
from ..artifacts.card import MOST_STORED, NOTED
from ..forces import AnalyticBondForce, Domain, ForceModel, ForceSurrogate, IsochoricNetwork, LearntBondForce, LearntEnergy
from ..forces.bond_energy import EnergySurrogate
from ..materials import Law
from ..materials.law import checked_law
from .bond_force import BOND_FORCE
from .energy import SHEET_ENERGY
from .export import best_of
from .isochoric import ISOCHORIC_ENERGY
from .sampling import checked_range
from .surrogates import force_model_of, target_of
from .targets import Samples, Target
from .validation import relative_errors

MEMBER_STATES = 5_000
"""States in each set at which members of a committee, and fitted pipelines in a run, are compared with their laws: they give an RMS
to a percent, which is enough to refuse a model."""


class TooInexact(ValueError):
    """A fitted model whose error against its law is too large."""


def check_worth_storing(errors: dict, what: str, law: Law, role: str = "is stored as", purpose: str = "written") -> None:
    """Raise `TooInexact` if the error in the report of a model (`evaluate`) is above `MOST_STORED`; warn above `NOTED`.

    `role` is the role of the law, and `purpose` the purpose for which the model is refused, in messages.
    """
    rms = errors["on_surface"]["rms"]
    if NOTED < rms <= MOST_STORED:
        shape = "".join(f", {key} = {value:g}" for key, value in law.shape.items())
        warnings.warn(
            f"{what} is off by {100 * rms:.2g} % RMS from {law.name}{shape}, the law that it was compared with and {role}: was it "
            "fitted to samples of another one, or too coarsely?",
            stacklevel=4,
        )
    worst = max(errors.get("by_strain", ()), key=lambda row: row["rms"], default=None)
    if worst is not None and rms <= NOTED and worst["rms"] > MOST_STORED:
        # Enormous forces at the ends of the range make all errors relatively small.
        low, high = worst["strain"]
        warnings.warn(
            f"{what} is off by {100 * worst['rms']:.2g} % of the force at strains from {low:g} to {high:g}, though by little of the "
            "greatest: fit it over a smaller range of stretches",
            stacklevel=4,
        )
    if not rms <= MOST_STORED:
        low, high = errors["stretch_range"]
        raise TooInexact(
            f"{what} is off by {100 * rms:.3g} % RMS at stretches from {low:g} to {high:g}, more than {100 * MOST_STORED:g} %, and is not "
            f"{purpose}: fit it to more samples, with a larger regressor or over a smaller range, and to samples of this law"
        )


def cross_validate(
    model,
    samples: Samples,
    folds: int = 5,
    random_state: int = 0,
    n_jobs: int = 1,
    progress: Callable[[int], None] = lambda fold: None,
) -> list[dict]:
    """Fit clones of a pipeline to all but one fold of the samples each, and return the relative errors on the fold left out.

    Parameters
    ----------
    model : estimator
        A `surrogate_pipeline`, or another regressor from ``samples.X`` to ``samples.y``.
    samples : Samples
    folds : int
        Number of folds, at least 2.
    random_state : int
        Seed of the split.
    n_jobs : int
        Number of fits that run in parallel.
    progress : callable
        Called with the number of each fold, from 0, when its fit starts (with `n_jobs` above 1, when it is submitted).

    Returns
    -------
    list of dict
        For each fold ``fold``, ``rms`` and ``max`` over the RMS of the force or stress, and for energies ``energy_rms``.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as described.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> samples = pds.training_samples(pds.materials.NeoHookean(), n_samples=500, stretch_range=(0.7, 2.0))
    >>> model = pds.surrogate_pipeline(pds.learning.ChebyshevRegressor(6), features="isochoric")
    >>> [row["rms"] < 1e-2 for row in pds.cross_validate(model, samples, folds=2)]
    [True, True]
    """
    check_estimator(model)
    check_is(samples, Samples, "samples", "training_samples draws")
    check_whole_number(folds, "folds", 2, len(samples))
    check_seed(random_state)
    check_called(progress, "progress")
    check_jobs(n_jobs)

    def task(fold: int, train: np.ndarray, test: np.ndarray):
        progress(fold)
        return delayed(_errors_left_out)(clone(model), samples.take(train), samples.take(test))

    splits = KFold(folds, shuffle=True, random_state=random_state).split(samples.X)
    errors = Parallel(n_jobs)(task(fold, *split) for fold, split in enumerate(splits))
    return [{"fold": number, **error} for number, error in enumerate(errors)]


def _errors_left_out(model, train: Samples, test: Samples) -> dict[str, float]:
    """Fit a model to samples and return its errors on other samples."""
    return test.target.errors(model.fit(train.X, train.y).predict(test.X), test)


def evaluate(
    model, law: Law, stretch_range: tuple[float, float] | None = None, n_samples: int = 20_000, random_state: int = 1_000_003
) -> dict:
    """Compare a model with the exact bond force or energy of a law, in double precision.

    Parameters
    ----------
    model : estimator, str, path, ForceModel, object or callable
        A fitted `surrogate_pipeline`, a search over one, or another regressor of the five bond quantities, evaluated by its own
        ``predict``; an artefact (NAME, NAME@VERSION or a path); a force model; an object with a ``bond_force``; or a function
        ``force(stretch, rotation, length, C33, J)``.
    law : Law
    stretch_range : tuple of float, optional
        Least and greatest principal stretch; by default those of the domain of the model, or 0.5 to 4 without a domain.
    n_samples : int
        States in each set.
    random_state : int
        Seed; choose one that no training used.

    Returns
    -------
    dict
        For bond forces see `pdsurrogate.learning.validation.force_report`. For energies: ``on_surface``: relative errors of the stress
        (``rms``, ``max``) and of the energy (``energy_rms``) over the box of stretches, uniform in their logarithms (for an isochoric
        energy the stretches with product 1, and Kirchhoff stresses); ``by_strain``: these errors by bins of greatest principal strain;
        ``at_rest``: size of energy and stress at rest; ``least_acoustic``: least second derivative of the energy along a rank-one change
        m (x) n of F with unit m and n (for an isochoric energy changes that keep the volume), with ``least_acoustic_exact`` of the law:
        positive values mean that short waves are stable (strong ellipticity). For the energy of a sheet also ``least_curvature`` and
        ``least_curvature_exact``: least eigenvalue of the second derivative by the logarithms of the stretches; for an isochoric energy
        ``shear_modulus`` at rest, which is 1 for the law.

    Raises
    ------
    TypeError, ValueError
        If the model is of another kind, or not fitted.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.load_surrogate("neo-hookean@1")
    >>> pds.evaluate(model.bond_force, pds.materials.NeoHookean(), n_samples=500)["on_surface"]["rms"] < 1e-4
    True
    """
    checked_law(law)
    check_whole_number(n_samples, "n_samples", 1)
    check_seed(random_state)
    if isinstance(model, str | Path):
        model = load_surrogate(model)
        if hasattr(model, "law") and isinstance(model, ForceSurrogate) and model.domain is None:
            model.law = law  # the exact model is of no particular law
    model = best_of(model)
    if target_of(model) in (SHEET_ENERGY, ISOCHORIC_ENERGY):
        model = force_model_of(model, law)
    target, domain = _evaluated_as(model), getattr(model, "domain", None)
    own = (domain.least_stretch, domain.greatest_stretch) if isinstance(domain, Domain) else BOND_FORCE.stretch_range
    return target.report(model, law, checked_range(own if stretch_range is None else stretch_range), n_samples, random_state)


def _evaluated_as(model) -> Target:
    """Return the target as which a model is evaluated; raise TypeError for a force model with neither a bond force nor an energy."""
    if isinstance(model, IsochoricNetwork):
        return ISOCHORIC_ENERGY
    if isinstance(model, EnergySurrogate):
        return SHEET_ENERGY
    if isinstance(model, ForceModel) and not isinstance(model, ForceSurrogate):
        raise TypeError(f"{model.name} has no bond force of its own to evaluate")
    return BOND_FORCE


def stated_against(model: LearntBondForce | LearntEnergy, law: Law, states: np.ndarray) -> LearntBondForce | LearntEnergy:
    """Return a model with its errors against a law in its domain, as on the card of an artefact; raise `TooInexact` above the bound.

    A run judges a fitted pipeline in this way as it does the artefact that `pdsurrogate.store` makes of it. `states` are the inputs that
    the model was fitted to; those of a bond force include states off the surface.
    """
    reach = model.domain.least_stretch, model.domain.greatest_stretch
    if isinstance(model, LearntEnergy):
        found = evaluate(model, law, n_samples=MEMBER_STATES)["on_surface"]
    else:
        some = states[:: -(-len(states) // MEMBER_STATES)].T
        found = relative_errors(model.bond_force(*some), AnalyticBondForce(law).bond_force(*some))
    check_worth_storing({"on_surface": found, "stretch_range": reach}, model.name, law, "which the scene asks for", "run")
    return replace(model, stated={"rms": found["rms"], "max": found["max"], "bulk_ratio": law.bulk_modulus / law.shear_modulus})
