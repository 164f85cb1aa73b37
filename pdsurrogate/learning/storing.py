"""Storing of fitted models as artifacts, with cards that hold their material, domain, training
and errors.
"""

import platform
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path

import numpy as np
from sklearn.base import BaseEstimator

from .. import __version__
from ..arguments import check_kind, check_path, check_tables
from ..artifacts.card import check_plain
from ..artifacts.places import new_artifact, next_version, own_folder
from ..artifacts.store import save_artifact
from ..materials import Law
from ..materials.law import checked_law
from .export import best_of, regressor_of, title_of
from .fitting import check_worth_storing, checked_surrogate
from .pipeline import feature_set_of
from .target import Samples


@dataclass(frozen=True)
class CardText:
    """Text of a user for the card (``card.json``) of an artifact, in addition to the entries
    computed from the model.

    Parameters
    ----------
    description : str
        Purpose of the artifact, in a sentence.
    cross_validation : list of dict, optional
        Errors by fold, as `pdsurrogate.cross_validate` returns them.
    search : list of dict, optional
        Parameters that a search tried, and their errors; by default the table of the fitted model
        if this is a search.
    identification : dict, optional
        Report of the identification of the law (as ``pdsurrogate identify`` gives it).

    Raises
    ------
    TypeError, ValueError
        If a value is of the wrong type, or is something else than None, finite numbers, text, lists
        and dictionaries of them, all that JSON can hold; the message names the value.

    See Also
    --------
    pdsurrogate.store : stores an artifact with its card.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.CardText("Neo-Hookean, 20 units").description
    'Neo-Hookean, 20 units'
    """

    description: str
    cross_validation: list[dict] | None = None
    search: list[dict] | None = None
    identification: dict | None = None

    def __post_init__(self) -> None:
        check_kind(self.description, str, "description", "text")
        check_tables(self.cross_validation, "cross_validation")
        check_tables(self.search, "search")
        check_kind(self.identification, dict | None, "identification", "a dictionary, or None")
        check_plain(
            {
                "cross_validation": self.cross_validation,
                "search": self.search,
                "identification": self.identification,
            }
        )


def store(
    model,
    samples: Samples,
    law: Law,
    folder: str | Path | None,
    name: str,
    version: str | None,
    text: str | CardText,
) -> Path:
    """Write a fitted model as an artifact, with a card of its material, domain, training and
    errors.

    Parameters
    ----------
    model : estimator or object
        Model fitted to `samples`: a `surrogate_pipeline` with any regressor, or a search over one;
        for bond forces also another regressor of the five bond quantities, or an object with a
        ``bond_force``, see `pdsurrogate.learning.surrogate_of`.
    samples : Samples
        Dimensionless samples; their design gives the domain in which the model holds.
    law : Law
    folder : str, path or None
        Folder of artifacts, in which ``NAME/VERSION`` is created. None stands for ``artifacts`` in
        the working folder, where artifacts are found by name; or for ``own-artifacts`` in a
        checkout of this package, whose ``artifacts`` holds the shipped artifacts
        (`pdsurrogate.artifacts.own_folder`).
    name : str
    version : str or None
        Version, which never changes once written; None for the next one.
    text : str or CardText
        Purpose of the artifact in a sentence; or a `CardText` with this sentence, tables and the
        identification of the law.

    Returns
    -------
    Path
        Folder of the artifact.

    Raises
    ------
    TooInexact
        If the error of the model on the plane-stress surface is above
        `pdsurrogate.artifacts.card.MOST_STORED`; nothing is written then.
    TypeError, ValueError
        If the model is not fitted, or does not predict the target of the samples.
    ArtifactError
        See `pdsurrogate.artifacts.store.save_artifact`.

    See Also
    --------
    pdsurrogate.CardText : what the author states about an artifact.
    pdsurrogate.load_surrogate : loads the surrogate of an artifact.
    pdsurrogate.load_card : reads the card of an artifact.
    pdsurrogate.load_pipeline : loads the pipeline of an artifact.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> import tempfile
    >>> law = pds.materials.NeoHookean()
    >>> samples = pds.training_samples(law, n_samples=500, stretch_range=(0.7, 2.0))
    >>> model = pds.surrogate_pipeline(
    ...     pds.learning.ChebyshevRegressor((8, 4)), features="isochoric"
    ... ).fit(samples.X, samples.y)
    >>> path = pds.store(model, samples, law, tempfile.mkdtemp(), "my-rubber", None, "an example")
    >>> path.parts[-2:]
    ('my-rubber', '1')
    """
    check_kind(samples, Samples, "samples", "Samples, such as training_samples draws")
    checked_law(law)
    folder = own_folder() if folder is None else folder
    check_path(folder, "folder")
    version = next_version(folder, name) if version is None else version
    new_artifact(folder, name, version)
    text = text if isinstance(text, CardText) else CardText(text)
    target = samples.target
    title = f"{name}@{version}"
    surrogate, resampling = checked_surrogate(model, law, samples, title)
    errors = target.report(surrogate, law, tuple(samples.design["stretch_range"]))
    check_worth_storing(errors, title, law)
    search = (
        search_table(model)
        if text.search is None and hasattr(model, "cv_results_")
        else text.search
    )
    model = best_of(model)
    regressor = regressor_of(model)
    card = {
        "name": name,
        "version": version,
        "kind": surrogate.kind,
        "description": text.description,
        "material": {
            "law": law.name,
            "trained_with": law.describe(),
            "shape": dict(surrogate.shape_of(law)),
        },
        "domain": asdict(surrogate.domain),
        "errors": {"box": errors},
        "weight_function": target.weight_function,
        "features": {
            "set": surrogate.feature_set,
            "names": list(surrogate.features),
            "from": list(target.columns),
            "targets": list(target.outputs),
            "units": target.units,
        },
        "scaling": {"folded": "into the constants of the payload"},
        "training": {
            "design": samples.design,
            "regressor": title_of(regressor),
            "parameters": (
                _plain(regressor.get_params()) if hasattr(regressor, "get_params") else {}
            ),
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
        "made_with": versions(),
    }
    kept = model if isinstance(model, BaseEstimator) else None
    return save_artifact(folder, card, surrogate, kept)


def search_table(search) -> list[dict]:
    """Return, for a card, the table of a fitted search over parameters: for each try its
    parameters, mean score and standard deviation.
    """
    found = search.cv_results_
    scores = "mean_test_score" if "mean_test_score" in found else f"mean_test_{search.refit}"
    rows = zip(found["params"], found[scores], found[scores.replace("mean", "std")], strict=True)
    return [
        {**_plain(parameters), "score": float(mean), "spread": float(spread)}
        for parameters, mean, spread in rows
    ]


def _plain(parameters: dict) -> dict:
    """Return parameters of an estimator for a card: numbers, text and lists unchanged, any other
    value as text.
    """

    def plain(value):
        if isinstance(value, tuple | list):
            return [plain(inner) for inner in value]
        if (
            value is None
            or isinstance(value, bool | int | str)
            or (isinstance(value, float) and np.isfinite(value))
        ):
            return value
        if isinstance(value, np.integer):
            return value.item()
        try:  # a pipeline for bond forces by its features and its regressor
            features = feature_set_of(value)
            last = value.regressor.steps[-1][1]
            words = f"{features} features, {getattr(last, 'regressor', last)!r}"
        except ValueError:
            words = repr(value)
        # The ``repr`` of a nested estimator may run to pages; its beginning holds its name.
        return words[:200]

    return {key: plain(value) for key, value in parameters.items()}


def versions() -> dict[str, str]:
    """Return, by name, the versions of Python and of the packages that influence an artifact."""
    others = {
        package: metadata.version(package)
        for package in ("numpy", "scipy", "scikit-learn", "joblib")
    }
    return {"python": platform.python_version(), "pdsurrogate": __version__, **others}
