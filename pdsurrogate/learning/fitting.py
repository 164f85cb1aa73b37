"""Fit, examine and store a surrogate of a law's bond force: what `pdsurrogate fit` and the shipped pipelines do."""

from __future__ import annotations

import platform
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from sklearn.base import BaseEstimator, clone
from sklearn.model_selection import KFold

from ..arguments import (
    check_called,
    check_estimator,
    check_is,
    check_jobs,
    check_path,
    check_seed,
    check_whole_number,
    kind_of,
)
from ..artifacts import new_artifact, save_artifact
from ..artifacts.card import MOST_STORED, NOTED
from ..body import WEIGHT_FUNCTIONS
from ..forces import Domain
from ..materials import Law
from ..materials.law import checked_law
from .card_text import CardText
from .export import best_of, regressor_of, shift_and_scale, taken_over, title_of
from .pipeline import feature_set_of, parts_of
from .sampling import COLUMNS, PERTURBATION, TARGETS, BondSamples, hull_of, reachable_stretches
from .target import InputAwareTargetRegressor
from .validation import force_report, relative_errors

MEMBER_STATES = 5_000
"""Of each set by which the members of a committee are compared with their laws."""

MOST_WORDS = 200
"""Characters of a parameter on a card."""


class TooInexact(ValueError):
    """A fitted model that is too far from its law to be of use."""


def check_worth_storing(errors: dict, what: str, law: Law, role: str = "is stored as", purpose: str = "written") -> None:
    """Raise `TooInexact` if the report of a model (`force_report`, `evaluate_energy`) says that it is too far from its law; warn if far.

    `role` is what the law is to the model, and `purpose` what the model is not taken for, in messages.
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
        # Where forces at the ends of the range are enormous, all errors are small beside them.
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


def domain_of(samples: BondSamples) -> Domain:
    """Domain of the samples' design: its box of principal stretches, and the J3^2 of its states."""
    low, high = samples.design["stretch_range"]
    hull = hull_of(samples.design)
    bulk = samples.X[:, 4] ** 2 * samples.X[:, 3]
    if samples.design.get("off_surface"):
        # The perturbation's own bounds, which the samples nearly fill.
        reach = np.exp(samples.design.get("perturbation", PERTURBATION)["log_C33"])
        return Domain(low, high, float(1 / reach), float(reach), hull)
    return Domain(low, high, float(bulk.min()), float(bulk.max()), hull)


def cross_validate(
    model,
    samples: BondSamples,
    folds: int = 5,
    random_state: int = 0,
    n_jobs: int = 1,
    progress: Callable[[int], None] = lambda fold: None,
) -> list[dict]:
    """Fit clones of a pipeline to all but one fold of the samples each, and report the relative errors on the fold left out.

    `progress` is told every fold that begins, counted from 0; with more jobs than one, that it is handed out.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> samples = pds.wide_design(pds.NeoHookean(), n_samples=500, stretch_range=(0.7, 2.0))
    >>> model = pds.bond_force_pipeline("isochoric", pds.ChebyshevRegressor(6))
    >>> [row["rms"] < 1e-2 for row in pds.cross_validate(model, samples, folds=2)]
    [True, True]
    """
    check_validation(model, samples, BondSamples, "wide_design", folds, random_state, progress)
    check_jobs(n_jobs)
    splits = _told(KFold(folds, shuffle=True, random_state=random_state).split(samples.X), progress)
    errors = Parallel(n_jobs)(delayed(_error_left_out)(clone(model), samples, train, test) for train, test in splits)
    return [{"fold": number, **error} for number, error in enumerate(errors)]


def check_validation(model, samples, kind: type, maker: str, folds: int, random_state: int, progress: Callable) -> None:
    """Raise TypeError or ValueError for what a cross-validation cannot be made of."""
    check_estimator(model)
    check_is(samples, kind, "samples", f"{maker} draws")
    check_whole_number(folds, "folds", 2, len(samples))
    check_seed(random_state)
    check_called(progress, "progress")


def check_storing(samples, kind: type, law, folder, name, version, members) -> None:
    """Raise TypeError or ValueError for what `pdsurrogate.store` cannot make an artefact of; ArtifactError for a name that is taken."""
    check_is(samples, kind, "samples", "a design draws")
    checked_law(law)
    check_path(folder, "folder")
    new_artifact(folder, name, version)
    if not isinstance(members, list | tuple):
        raise TypeError(f"members must be a list of tuples, each a fitted model, its samples and its law, not {kind_of(members)}")
    for number, member in enumerate(members, 1):
        if not isinstance(member, list | tuple) or len(member) != 3:
            raise TypeError(f"member {number} must be a tuple of a fitted model, its samples and its law, not {kind_of(member)}")
        check_is(member[1], kind, f"the samples of member {number}", "a design draws")
        checked_law(member[2])


def committee_of(members: Sequence[tuple], title: str, built: Callable, examined: Callable, shape: Callable) -> tuple[list, list[dict]]:
    """Surrogates of the members of a committee, and what its card says of them.

    Parameters
    ----------
    members : sequence of tuple
        See `pdsurrogate.store`.
    title : str
        ``NAME@VERSION``.
    built : callable
        ``built(model, samples, law, title)``: the surrogate of a member.
    examined : callable
        ``examined(surrogate, samples, law)``: its errors.
    shape : callable
        The dimensionless parameters of a law that matter to it.

    Raises
    ------
    TooInexact
        See `check_worth_storing`.
    """
    surrogates, cards = [], []
    for number, (model, samples, law) in enumerate(members, 1):
        which = f"{title}#{number}"
        surrogates.append(built(model, samples, law, which))
        report = examined(surrogates[-1], samples, law)
        check_worth_storing(report, which, law)
        cards.append(
            {
                "material": {"law": law.name, "trained_with": law.describe(), "shape": shape(law)},
                "domain": asdict(surrogates[-1].domain),
                "errors": {"box": {key: report[key] for key in ("stretch_range", "n_samples", "on_surface")}},
            }
        )
    return surrogates, cards


def _told(splits: Iterable, progress: Callable[[int], None]) -> Iterator:
    for fold, split in enumerate(splits):
        progress(fold)
        yield split


def _error_left_out(model, samples, train, test) -> dict[str, float]:
    model.fit(samples.X[train], samples.y[train])
    left_out = BondSamples(samples.X[test], samples.y[test], samples.design)
    return relative_errors(lambda *bond: model.predict(np.stack(bond, axis=1)), left_out)


def store_bond_force(
    model,
    samples: BondSamples,
    law: Law,
    folder: str | Path,
    name: str,
    version: str,
    text: CardText,
    members: Sequence[tuple] = (),
) -> Path:
    """Write the artefact of a model of a bond force with a full card; see `pdsurrogate.store`."""
    check_storing(samples, BondSamples, law, folder, name, version, members)
    title = f"{name}@{version}"
    committee, cards = committee_of(
        members,
        title,
        lambda one, drawn, described, which: taken_over(one, described, domain_of(drawn), which, drawn.X)[0],
        lambda found, drawn, described: force_report(found.bond_force, described, tuple(drawn.design["stretch_range"]), MEMBER_STATES),
        lambda described: described.shape,
    )
    search = search_table(model) if text.search is None and hasattr(model, "cv_results_") else text.search
    model = best_of(model)
    surrogate, resampling = taken_over(model, law, domain_of(samples), title, samples.X)
    low, high = samples.design["stretch_range"]
    errors = {"box": force_report(surrogate.bond_force, law, (low, high))}
    check_worth_storing(errors["box"], title, law)
    if low > 0.5 and reachable_stretches(law) == (0.5, 4.0):
        errors["outside_box"] = force_report(surrogate.bond_force, law, (0.5, 4.0))
    regressor = regressor_of(model) if isinstance(model, InputAwareTargetRegressor) else model
    card = {
        "name": name,
        "version": version,
        "kind": surrogate.kind,
        "description": text.description,
        "material": {"law": law.name, "trained_with": law.describe(), "shape": law.shape},
        "weight_function": "any: the force learnt is dimensionless, t kappa / (w l mu); known are " + ", ".join(WEIGHT_FUNCTIONS),
        "features": {
            "set": surrogate.feature_set,
            "names": list(surrogate.features),
            "from": list(COLUMNS),
            "targets": list(TARGETS),
            "units": "dimensionless; rotation in radians; length in horizons; force in w l mu / kappa",
        },
        "scaling": _scaling(model),
        "training": {
            "design": samples.design,
            "regressor": title_of(regressor),
            "parameters": _plain(regressor.get_params()) if hasattr(regressor, "get_params") else {},
            "outcome": {
                key.removesuffix("_"): value
                for key in ("n_iter_", "loss_", "validation_loss_", "test_score_")
                if np.isscalar(value := getattr(regressor, key, None)) and np.isfinite(value)
            },
            "cross_validation": text.cross_validation or [],
            "search": search or [],
            **({"identification": text.identification} if text.identification else {}),
            **({"resampling": resampling} if resampling else {}),
        },
        "domain": asdict(surrogate.domain),
        "errors": errors,
        "made_with": versions(),
        "members": cards,
    }
    kept = model if isinstance(model, BaseEstimator) else None
    return save_artifact(folder, card, surrogate, kept, committee)


def _scaling(model) -> dict:
    """What the card says of the scalings of a pipeline."""
    try:
        parts = parts_of(model)
    except ValueError:
        return {"folded": "whatever scaling the model has is part of the payload, which is on plain features"}
    (mean, scale), (target_mean, target_scale) = shift_and_scale(parts.scaling), shift_and_scale(parts.target)
    return {
        "feature_mean": mean.tolist(),
        "feature_scale": scale.tolist(),
        "output_mean": target_mean.tolist(),
        "output_scale": target_scale.tolist(),
        "folded": "into the constants of the payload",
    }


def search_table(search) -> list[dict]:
    """Rows of a fitted search over parameters, for a card: what was tried, and the mean and the spread of its scores."""
    found = search.cv_results_
    scores = "mean_test_score" if "mean_test_score" in found else f"mean_test_{search.refit}"
    rows = zip(found["params"], found[scores], found[scores.replace("mean", "std")], strict=True)
    return [{**_plain(parameters), "score": float(mean), "spread": float(spread)} for parameters, mean, spread in rows]


def _in_words(value) -> str:
    """A bond-force pipeline by its features and its regressor, all else as Python shows it."""
    try:
        features = feature_set_of(value)
    except ValueError:
        return repr(value)
    last = value.regressor.steps[-1][1]
    return f"{features} features, {getattr(last, 'regressor', last)!r}"


def _plain(parameters: dict) -> dict:
    """Parameters of an estimator as a card keeps them: numbers and names as they are, all else in words."""

    def plain(value):
        if isinstance(value, tuple | list):
            return [plain(inner) for inner in value]
        if value is None or isinstance(value, bool | int | str) or (isinstance(value, float) and np.isfinite(value)):
            return value
        return value.item() if isinstance(value, np.integer) else _in_words(value)[:MOST_WORDS]

    return {key: plain(value) for key, value in parameters.items()}


def versions() -> dict[str, str]:
    """Versions of everything that shapes an artefact."""
    found = {"python": platform.python_version()}
    for package in ("pdsurrogate", "numpy", "scipy", "scikit-learn", "joblib"):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found
