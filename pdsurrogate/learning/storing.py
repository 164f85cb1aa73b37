"""A model into an artefact, whatever it is a model of."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..arguments import kind_of
from ..artifacts import next_version, own_folder
from ..materials import Law
from .card_text import CardText
from .energy import store_energy
from .energy_form import EnergySamples
from .fitting import store_bond_force
from .sampling import BondSamples


def store(
    model,
    samples: BondSamples | EnergySamples,
    law: Law,
    folder: str | Path | None,
    name: str,
    version: str | None,
    text: str | CardText,
    members: Sequence[tuple] = (),
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
    folder : str, path or None
        That holds artefacts; this one becomes ``folder/NAME/VERSION``.  None for ``artifacts`` in the working folder, where artefacts are
        found by name, or for ``own-artifacts`` where that is a checkout of this package, whose ``artifacts`` holds the shipped ones
        (`pdsurrogate.artifacts.own_folder`).
    name : str
    version : str or None
        None for the next one: versions never change once written.
    text : str or CardText
        What the artefact is for, in a sentence; or that with tables and the identification of the law for the card.
    members : sequence of tuple, optional
        Of a committee in the same artefact: of each a fitted model, the samples that it was fitted to, and its law.  What runs is `model`;
        ``NAME#3`` is the third member, and ``NAME#all`` what runs with the members' deviation told beside it.

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

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> import tempfile
    >>> law = pds.NeoHookean()
    >>> samples = pds.wide_design(law, n_samples=500, stretch_range=(0.7, 2.0))
    >>> model = pds.bond_force_pipeline("isochoric", pds.ChebyshevRegressor((8, 4))).fit(samples.X, samples.y)
    >>> path = pds.store(model, samples, law, tempfile.mkdtemp(), "my-rubber", None, "an example")
    >>> path.parts[-2:]
    ('my-rubber', '1')
    """
    if not isinstance(samples, BondSamples | EnergySamples):
        raise TypeError(f"samples must be BondSamples or EnergySamples, such as wide_design and energy_design draw, not {kind_of(samples)}")
    folder = own_folder() if folder is None else folder
    version = next_version(folder, name) if version is None else version
    keep = store_energy if isinstance(samples, EnergySamples) else store_bond_force
    return keep(model, samples, law, folder, name, version, CardText.of(text), members)
