"""Training samples, pipelines and surrogates for each quantity to learn; errors of fitted models.

The module also holds the check that refuses to store or to run a model with too great an error.
"""

import warnings
from bisect import bisect_left
from dataclasses import replace
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from sklearn.base import clone
from sklearn.model_selection import KFold
from sklearn.utils.validation import check_is_fitted

from ..arguments import (
    check_estimator,
    check_jobs,
    check_kind,
    check_seed,
    check_share,
    check_whole_number,
)
from ..artifacts import load_surrogate
from ..artifacts.card import MOST_STORED, NOTED
from ..forces import (
    AnalyticBondForce,
    Domain,
    ForceModel,
    ForceSurrogate,
    IsochoricNetwork,
    LearnedBondForce,
    LearnedEnergy,
)
from ..forces.agreement import WIDEST
from ..forces.bond_energy import EnergySurrogate
from ..materials import Law
from ..materials.law import checked_law
from ..progress import part
from .bond_force import BOND_FORCE
from .energy import SHEET_ENERGY
from .export import best_of
from .isochoric import ISOCHORIC_ENERGY
from .sampling import checked_range, random_order
from .target import (
    REPORT_SEED,
    REPORTED_STATES,
    InputAwareTargetRegressor,
    Samples,
    Target,
    relative_errors,
)

TARGETS = {target.name: target for target in (BOND_FORCE, SHEET_ENERGY, ISOCHORIC_ENERGY)}
"""Targets, the quantities to learn, by their names in public functions."""

RUN_STATES = 5_000
"""Number of states at which a fitted pipeline in a run is compared with its law: the RMS of n
normal errors is known to 1/sqrt(2 n), here to a percent, which suffices to reject a model.
"""


def target_called(name: str) -> Target:
    """Return the `Target`, the quantity to learn, that has a name in `TARGETS`; raise ValueError
    for an unknown name.
    """
    if not isinstance(name, str) or name not in TARGETS:
        raise ValueError(f"target must be one of {', '.join(TARGETS)}, not {name!r}")
    return TARGETS[name]


def target_of(model) -> Target | None:
    """Return the target that a pipeline, fitted or unfitted, predicts; None for other
    estimators.
    """
    return next((target for target in TARGETS.values() if target.carried_by(model)), None)


def training_samples(
    law: Law,
    n_samples: int | None = None,
    stretch_range: tuple[float, float] | None = None,
    near_rest: float = 0.25,
    random_state: int = 0,
    target: str = "bond-force",
    off_surface: float | None = None,
) -> Samples:
    """Draw training samples of a law in random order, uniform in log-stretch except for a share of
    small strains (theory, section 5).

    Parameters
    ----------
    law : Law
    n_samples : int, optional
        Number of samples; by default 8,000 for a bond force, 2,000 for the energy of a sheet and
        1,000 for an isochoric energy.
    stretch_range : tuple of float, optional
        Least and greatest principal stretch; by default 0.5 to 4, for the energy of a sheet 0.5 to
        5, and for an isochoric energy 0.25 to 4 for three stretches of product 1.
    near_rest : float
        Share of states with strains from 0.1 % to 30 %, or to the end of the range, uniform in the
        logarithm of the strain.
    random_state : int
        Seed.
    target : {"bond-force", "sheet-energy", "isochoric-energy"}
        Quantity to learn: the bond force of a sheet, the energy of a sheet under plane stress, or
        the energy W(I1bar, I2bar) for plane strain and three dimensions, which does not depend on
        the bulk modulus.
    off_surface : float, optional
        For bond forces, the share of states off the plane-stress surface, on which C33 follows from
        the stretches in the plane; two thirds by default. Bond stretch, rotation and C33 are
        perturbed independently, by amounts that shrink with the strain, and the force is the law's
        exact bond force as a function of the perturbed values.

    Returns
    -------
    Samples
        Dimensionless, lengths in units of the horizon.

    Raises
    ------
    TypeError, ValueError
        If an argument is invalid, or the law is not finite in all states of the range.

    See Also
    --------
    pdsurrogate.surrogate_pipeline : makes the pipeline that learns the samples.
    pdsurrogate.evaluate : measures the errors of a fitted pipeline.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> samples = pds.training_samples(
    ...     pds.materials.NeoHookean(),
    ...     n_samples=300,
    ...     stretch_range=(0.7, 2.0),
    ...     target="sheet-energy",
    ... )
    >>> samples.X.shape, samples.design["stretch_range"]
    ((300, 2), [0.7, 2.0])
    """
    checked_law(law)
    chosen = target_called(target)
    n_samples = chosen.n_samples if n_samples is None else n_samples
    check_whole_number(n_samples, "n_samples", 1)
    check_share(near_rest, "near_rest")
    check_seed(random_state)
    if off_surface is not None and chosen is not BOND_FORCE:
        raise ValueError(
            f"off_surface is for the target bond-force; samples of {target} are all on the"
            " plane-stress surface"
        )
    box = checked_range(chosen.stretch_range if stretch_range is None else stretch_range)
    options = {} if off_surface is None else {"off_surface": off_surface}
    samples = chosen.draw(law, n_samples, box, near_rest, random_state, **options)
    if not np.isfinite(samples.y).all():
        least, greatest = reachable_stretches(law, box, target)
        raise ValueError(
            f"{law.name} does not reach the stretches {box[0]:g} to {box[1]:g}; use {least:.4g} to"
            f" {greatest:.4g}"
        )
    return samples.take(random_order(n_samples, near_rest, random_state))


def reachable_stretches(
    law: Law, stretch_range: tuple[float, float] = WIDEST, target: str = "bond-force"
) -> tuple[float, float]:
    """Return the part of a range of principal stretches in which a law is finite in all states of
    `training_samples`.

    For a law that locks within the range, the logarithms of both bounds are reduced by a common
    factor until the most extreme training states are short of the limit.

    Parameters
    ----------
    law : Law
    stretch_range : tuple of float
        Least and greatest principal stretch.
    target : {"bond-force", "sheet-energy", "isochoric-energy"}
        Target of the samples.

    Returns
    -------
    tuple of float

    Raises
    ------
    ValueError
        If the law locks too near the undeformed state for a surrogate.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> low, high = pds.learning.reachable_stretches(pds.materials.Gent(chain_limit=20.0))
    >>> low >= 0.5, high < 4.0
    (True, True)
    """
    checked_law(law)
    chosen = target_called(target)
    low, high = np.log(checked_range(stretch_range))
    if chosen.reached(law, low, high):
        return float(stretch_range[0]), float(stretch_range[1])
    inside = (
        bisect_left(
            range(1, 1024),
            True,
            key=lambda part: not chosen.reached(law, part / 1024 * low, part / 1024 * high),
        )
        / 1024
    )
    if inside == 0:
        raise ValueError(
            f"{law.name}: the law locks too close to the undeformed state for a surrogate"
        )
    # The energy grows without bound toward the limit; a smooth model can follow it up to a
    # twentieth short of it.
    least, greatest = np.exp([0.95 * inside * low, 0.95 * inside * high]).tolist()
    return least, greatest


def surrogate_pipeline(
    regressor=None,
    target: str = "bond-force",
    features: str | None = None,
    horizon: float = 1.0,
    weight: str | None = None,
    shear_modulus: float = 1.0,
) -> InputAwareTargetRegressor:
    """Make a scikit-learn pipeline (features, scaling, dimensionless target, regressor) that
    predicts a target from ``Samples.X``.

    Energies and their stresses are zero in the undeformed state by construction. In the training of
    energies each residual is divided by the order of magnitude of the energy of rubber in its
    state, such as (tr C + J^-2)/2 for a sheet.

    Parameters
    ----------
    regressor : estimator, optional
        For bond forces, any regressor with the interface of scikit-learn, including pipelines and
        searches; a regressor of a single target is fitted to each output separately; by default a
        Levenberg-Marquardt network of 20 units. For energies, a `SobolevRegressor`, whose
        parameters `anchor`, `flat` and `size` this function sets; by default one of 12 units, or 8
        for an isochoric energy.
    target : {"bond-force", "sheet-energy", "isochoric-energy"}
        Quantity to predict, see `training_samples`.
    features : str, optional
        For bond forces, the features of the regressor, one of
        `pdsurrogate.kernels.feature_sets.FEATURE_SETS`; "symmetric" by default. With "symmetric"
        and "isochoric" features the force is isotropic, mirror symmetric, and zero in the
        undeformed state by construction.
    horizon : float
        For bond forces, the horizon in the unit of the bond lengths in ``Samples.X``; 1 for samples
        of `training_samples`.
    weight : str, optional
        For bond forces, the weight function with which the forces in ``Samples.y`` were made
        dimensional (see `pdsurrogate.learning.algorithm_1`); None for dimensionless forces.
    shear_modulus : float
        For dimensional bond forces, the shear modulus of the material in their unit of stress.

    Returns
    -------
    InputAwareTargetRegressor
        Pipeline that accepts tables (pandas) with the names of the columns in any order, and
        refuses other names. With "symmetric" and "isochoric" features its ``fit`` leaves out
        samples without shear (rotation 0), with a warning: such a sample does not determine the
        derivative of the force by the shear, which the regressor learns.

    Raises
    ------
    ValueError
        If the target or the features are unknown, the regressor is not a regressor, or an option
        does not belong to the target.

    See Also
    --------
    pdsurrogate.training_samples : draws the samples to fit it to.
    pdsurrogate.cross_validate : compares pipelines.
    pdsurrogate.store : stores a fitted pipeline as an artifact.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> samples = pds.training_samples(
    ...     pds.materials.NeoHookean(), n_samples=500, stretch_range=(0.7, 2.0)
    ... )
    >>> model = pds.surrogate_pipeline(
    ...     pds.learning.ChebyshevRegressor(6), features="isochoric"
    ... ).fit(samples.X, samples.y)
    >>> model.predict(samples.X).shape
    (500, 2)
    """
    chosen = target_called(target)
    if chosen is BOND_FORCE:
        return BOND_FORCE.pipeline(regressor, features, horizon, weight, shear_modulus)
    given = {
        "features": features is not None,
        "horizon": horizon != 1,
        "weight": weight is not None,
        "shear_modulus": shear_modulus != 1,
    }
    if any(given.values()):
        raise ValueError(
            f"{max(given, key=given.__getitem__)} is for the target bond-force; {target} has none"
        )
    return chosen.pipeline(regressor)


def surrogate_of(
    model, law: Law, samples: Samples, name: str = "unsaved"
) -> LearnedBondForce | LearnedEnergy:
    """Return the surrogate of a fitted model, as plain arrays that the solver evaluates.

    Parameters
    ----------
    model : estimator or object
        A fitted `surrogate_pipeline` with any regressor, or a search over one. For bond forces also
        another fitted regressor of the five bond quantities (columns of ``Samples.X``), or an
        object with one of the methods ``bond_force(stretch, rotation, length, C33, J)`` and
        ``energy(I1bar, I2bar)`` (see `pdsurrogate.forces.OwnBondForce`).
    law : Law
        Law of the training data.
    samples : Samples
        Samples that the model was fitted to; their design gives the domain in which it holds.
    name : str

    Returns
    -------
    NetworkForce, PolynomialForce, SplineForce, EnergyNetwork or IsochoricNetwork
        Networks of one to three hidden layers and `ChebyshevRegressor` are converted exactly, with
        scalings folded into their constants; any other model of a bond force is resampled onto a
        spline. The model of an energy must be a pipeline with a `SobolevRegressor`.

    Raises
    ------
    TypeError, ValueError
        If the model does not predict the target of the samples, is not fitted, or is not finite
        somewhere in the domain.

    See Also
    --------
    pdsurrogate.store : stores the surrogate as well.
    pdsurrogate.simulate : takes a fitted pipeline as it is.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> law, target = pds.materials.NeoHookean(), "isochoric-energy"
    >>> samples = pds.training_samples(law, n_samples=300, stretch_range=(0.7, 2.0), target=target)
    >>> model = pds.surrogate_pipeline(
    ...     pds.learning.SobolevRegressor(4, "algebraic", max_iter=30, random_state=0), target
    ... )
    >>> pds.learning.surrogate_of(model.fit(samples.X, samples.y), law, samples)
    <IsochoricNetwork unsaved of neo-hookean>
    """
    check_kind(name, str, "name", "text")
    check_kind(samples, Samples, "samples", "Samples, such as training_samples draws")
    checked_law(law)
    return checked_surrogate(model, law, samples, name)[0]


def checked_surrogate(
    model, law: Law, samples: Samples, name: str
) -> tuple[LearnedBondForce | LearnedEnergy, dict]:
    """Return the surrogate of a fitted model, and a report on how the model was resampled for it.

    Raise ValueError if the model is a pipeline for another target than that of `samples`.
    """
    model = best_of(model)
    target = samples.target
    found = target_of(model)
    if found is not None and found is not target:
        raise ValueError(
            f"the pipeline predicts the target {found.name}, but the samples belong to the target"
            f" {target.name}"
        )
    return target.surrogate(model, law, target.domain(law, samples), name, samples.X)


def force_model_of(
    model, law: Law, name: str = "fitted pipeline"
) -> LearnedBondForce | LearnedEnergy:
    """Return the surrogate of a fitted `surrogate_pipeline`, or of a search over pipelines, as a
    force model that a simulation can use.

    Unlike `surrogate_of`, this function needs no samples: the training states that the pipeline
    keeps give the domain.

    Parameters
    ----------
    model : estimator
    law : Law
        Law of the training data, which a pipeline does not hold.
    name : str

    Returns
    -------
    LearnedBondForce or LearnedEnergy

    Raises
    ------
    ValueError
        If the model is not such a pipeline, is not fitted, or was read from a file, which does not
        hold the training states.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.learning import force_model_of
    >>> samples = pds.training_samples(
    ...     pds.materials.NeoHookean(), n_samples=500, stretch_range=(0.7, 2.0)
    ... )
    >>> model = pds.surrogate_pipeline(
    ...     pds.learning.ChebyshevRegressor(6), features="isochoric"
    ... ).fit(samples.X, samples.y)
    >>> force_model_of(model, pds.materials.NeoHookean()).name
    'fitted pipeline'
    """
    model = best_of(model)
    target = target_of(model)
    if target is None:
        raise ValueError(
            f"the stretches to which this {type(model).__name__} was fitted are unknown: fit it"
            " within a surrogate_pipeline, or store it with its samples (pds.store), and simulate"
            " the artifact"
        )
    check_is_fitted(model)
    if model.training_inputs_ is None:
        raise ValueError(
            "the stretches to which a pipeline from a file was fitted are unknown: give the"
            " artifact instead"
        )
    return target.surrogate(model, law, target.domain_of_states(law, model.training_inputs_), name)[
        0
    ]


class TooInexact(ValueError):
    """Error raised for a fitted model that is too far from its law to be stored or run."""


def check_worth_storing(
    errors: dict, what: str, law: Law, role: str = "is stored as", purpose: str = "written"
) -> None:
    """Raise `TooInexact` if the error in the report of a model (`evaluate`) is above `MOST_STORED`;
    warn above `NOTED`.

    The other arguments are words for the messages: `what` names the model, `role` says what `law`
    is for the model, and `purpose` what is not done with a refused model.
    """
    rms = errors["on_surface"]["rms"]
    if not rms <= MOST_STORED:
        low, high = errors["stretch_range"]
        raise TooInexact(
            f"{what} has an RMS error of {100 * rms:.3g} % at stretches from {low:g} to {high:g},"
            f" more than {100 * MOST_STORED:g} %; it is not {purpose}: fit it to samples of this"
            " law, and use more samples, a larger regressor or a smaller range"
        )
    worst: dict = max(errors.get("by_strain", ()), key=lambda row: row["rms"], default={"rms": 0.0})
    if rms > NOTED:
        against = "".join([law.name, *(f", {key} = {value:g}" for key, value in law.shape.items())])
        warnings.warn(
            f"{what} has an RMS error of {100 * rms:.2g} % relative to {against}, the law that it"
            f" was compared with and {role}: it was fitted too coarsely, or to samples of another"
            " law",
            stacklevel=4,
        )
    if worst["rms"] > MOST_STORED:
        # Enormous forces at the ends of the range make all errors relatively small.
        low, high = worst["strain"]
        warnings.warn(
            f"{what} has an RMS error of {100 * worst['rms']:.2g} % at strains from {low:g} to"
            f" {high:g}, though it is small relative to the greatest forces: fit it over a smaller"
            " range of stretches",
            stacklevel=4,
        )


def cross_validate(
    model, samples: Samples, folds: int = 5, random_state: int = 0, n_jobs: int = 1
) -> list[dict]:
    """Fit a clone of a pipeline for each fold to the samples outside the fold, and return the
    relative errors on the fold.

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

    Returns
    -------
    list of dict
        For each fold: its number ``fold``; the errors ``rms`` and ``max`` of the force or stress,
        divided by the RMS of the exact ones; and for energies the relative error ``energy_rms``.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as described.

    See Also
    --------
    pdsurrogate.evaluate : errors of a fitted pipeline on new samples.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> samples = pds.training_samples(
    ...     pds.materials.NeoHookean(), n_samples=500, stretch_range=(0.7, 2.0)
    ... )
    >>> model = pds.surrogate_pipeline(pds.learning.ChebyshevRegressor(6), features="isochoric")
    >>> [row["rms"] < 1e-2 for row in pds.cross_validate(model, samples, folds=2)]
    [True, True]
    """
    check_estimator(model)
    check_kind(samples, Samples, "samples", "Samples, such as training_samples draws")
    check_whole_number(folds, "folds", 2, len(samples))
    check_seed(random_state)
    check_jobs(n_jobs)
    splits = KFold(folds, shuffle=True, random_state=random_state).split(samples.X)
    split = (
        (fold, folds, clone(model), samples.take(train), samples.take(test))
        for fold, (train, test) in enumerate(splits)
    )
    return Parallel(n_jobs)(delayed(_errors_left_out)(*one) for one in split)


def _errors_left_out(
    fold: int, folds: int, model, train: Samples, test: Samples
) -> dict[str, float]:
    """Fit a model to the samples `train` and return its relative errors on the samples `test`,
    the `fold` of so many.
    """
    with part("cross-validating", fold, folds, fold=f"fold {fold + 1} of {folds}"):
        return {
            "fold": fold,
            **test.target.errors(model.fit(train.X, train.y).predict(test.X), test),
        }


def evaluate(
    model,
    law: Law,
    stretch_range: tuple[float, float] | None = None,
    n_samples: int = REPORTED_STATES,
    random_state: int = REPORT_SEED,
) -> dict:
    """Compare a model with the exact bond force or energy of a law, in double precision.

    Parameters
    ----------
    model : estimator, str, path, ForceModel, object or callable
        A fitted `surrogate_pipeline`, a search over one, or another regressor of the five bond
        quantities, evaluated by its own ``predict``; an artifact (NAME, NAME@VERSION or a path); a
        force model; an object with a ``bond_force``; or a function ``force(stretch, rotation,
        length, C33, J)``.
    law : Law
    stretch_range : tuple of float, optional
        Least and greatest principal stretch; by default those of the domain of the model, or 0.5 to
        4 without a domain.
    n_samples : int
        Number of states on the plane-stress surface, and for bond forces as many states off the
        surface.
    random_state : int
        Seed; choose one that no training used.

    Returns
    -------
    dict
        ``on_surface``: relative errors (``rms``, ``max``) of the force or stress, and for energies
        ``energy_rms``, at states with all stretches in `stretch_range`, uniform in their logarithms
        (for an isochoric energy three stretches with product 1, and Kirchhoff stresses);
        ``by_strain``: these errors by bins of greatest principal strain; ``at_rest``: the absolute
        value, in the undeformed state, of the bond force, of the isochoric energy, or of the energy
        or stress of a sheet, whichever is greater.

        For bond forces also ``off_surface``: errors in states whose C33 is not that of plane
        stress; ``least_slope``: least derivative of the force along the bond by the bond stretch at
        fixed rotation, J and C33, in the states of both sets, with ``least_slope_exact`` of the
        exact force. Short waves are unstable unless the least slope is positive.

        For energies also ``least_acoustic``: least second derivative of the energy along a rank-one
        change m (x) n of F with unit m and n (for an isochoric energy changes that keep the
        volume), with ``least_acoustic_exact`` of the law: positive values mean that short waves are
        stable (strong ellipticity). For the energy of a sheet also ``least_curvature`` and
        ``least_curvature_exact``: least eigenvalue of the second derivative by the logarithms of
        the stretches; for an isochoric energy ``shear_modulus``: that of the undeformed state,
        which is 1 for the law.

    Raises
    ------
    TypeError, ValueError
        If the model is of another kind, or not fitted.

    See Also
    --------
    pdsurrogate.cross_validate : errors of pipelines that are fitted to parts of the samples.
    pdsurrogate.store : stores a pipeline with its errors.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.load_surrogate("neo-hookean@1")
    >>> pds.evaluate(model.bond_force, pds.materials.NeoHookean(), n_samples=500)["on_surface"][
    ...     "rms"
    ... ] < 1e-4
    True
    """
    checked_law(law)
    check_whole_number(n_samples, "n_samples", 1)
    check_seed(random_state)
    if isinstance(model, str | Path):
        model = load_surrogate(model)
        if isinstance(model, AnalyticBondForce):
            model.law = law  # the exact model is of no particular law
    model = best_of(model)
    if target_of(model) in (SHEET_ENERGY, ISOCHORIC_ENERGY):
        model = force_model_of(model, law)
    if isinstance(model, ForceModel) and not isinstance(
        model, ForceSurrogate | EnergySurrogate | IsochoricNetwork
    ):
        raise TypeError(f"{model.name} has no bond force or energy of its own to evaluate")
    target = (
        ISOCHORIC_ENERGY
        if isinstance(model, IsochoricNetwork)
        else SHEET_ENERGY
        if isinstance(model, EnergySurrogate)
        else BOND_FORCE
    )
    domain = getattr(model, "domain", None)
    own = (
        (domain.least_stretch, domain.greatest_stretch)
        if isinstance(domain, Domain)
        else BOND_FORCE.stretch_range
    )
    return target.report(
        model,
        law,
        checked_range(own if stretch_range is None else stretch_range),
        n_samples,
        random_state,
    )


def stated_against(
    model: LearnedBondForce | LearnedEnergy, law: Law, states: np.ndarray
) -> LearnedBondForce | LearnedEnergy:
    """Return a copy of a model with its errors against a law as attribute ``stated``; raise
    `TooInexact` for errors above `MOST_STORED`.

    So a run knows the errors of a pipeline that was fitted in memory and has no card. `states` are
    the inputs of the training: the error of a bond force is computed on them, that of an energy by
    `evaluate` on new states.
    """
    reach = model.domain.least_stretch, model.domain.greatest_stretch
    if isinstance(model, LearnedEnergy):
        found = evaluate(model, law, n_samples=RUN_STATES)["on_surface"]
    else:
        some = states[:: -(-len(states) // RUN_STATES)].T
        found = relative_errors(model.bond_force(*some), AnalyticBondForce(law).bond_force(*some))
    check_worth_storing(
        {"on_surface": found, "stretch_range": reach},
        model.name,
        law,
        "which the scene asks for",
        "run",
    )
    return replace(
        model,
        stated={
            "rms": found["rms"],
            "max": found["max"],
            "bulk_ratio": law.bulk_modulus / law.shear_modulus,
        },
    )
