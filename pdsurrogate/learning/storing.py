"""A model into an artefact, whatever it is a model of."""

from __future__ import annotations

from pathlib import Path

from ..materials import Law
from .energy import store_energy
from .energy_form import EnergySamples
from .fitting import store_bond_force
from .sampling import BondSamples


def store(
    model,
    samples: BondSamples | EnergySamples,
    law: Law,
    folder: str | Path,
    name: str,
    version: str,
    description: str,
    cross_validation: list[dict] | None = None,
    search: list[dict] | None = None,
    identification: dict | None = None,
) -> Path:
    """Write the artefact of a fitted model with a full card.

    Parameters
    ----------
    model : estimator or object
        Fitted to `samples`: a `bond_force_pipeline`, whatever its regressor, a search over one, or any other regressor of the five bond
        quantities; an object with a ``bond_force``, see `pdsurrogate.learning.surrogate_of`; or an `energy_pipeline`, with samples of an
        energy.
    samples : BondSamples or EnergySamples
        Nondimensional; their design says where the model holds.
    law : Law
    folder, name, version
        As for `pdsurrogate.artifacts.save_artifact`.
    description : str
        What it is for, in a sentence.
    cross_validation, search : list of dict, optional
        Tables for the card; by default that of the search, if the model is one.
    identification : dict, optional
        How the law's parameters were found, for the card (`pdsurrogate.identification.report`).

    Returns
    -------
    Path
        Of the artefact.

    Raises
    ------
    TooInexact
        If it is off by more than `pdsurrogate.learning.fitting.MOST_STORED` on the plane-stress surface; nothing is written then.
    ValueError
        If the model is not fitted, or no model of a bond force or an energy.
    ArtifactError
        See `pdsurrogate.artifacts.save_artifact`.
    """
    keep = store_energy if isinstance(samples, EnergySamples) else store_bond_force
    return keep(model, samples, law, folder, name, version, description, cross_validation, search, identification)
