"""Artifacts on disk: a folder for each name and version with a card and its payloads, written
once and never changed.
"""

import hashlib
import io
import os
import re
import warnings
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ..arguments import suggestion
from ..array_files import DamagedFile, read_arrays
from ..forces import FORCES, Domain, ForceModel, LearnedBondForce, LearnedEnergy
from ..materials import LAWS, Law
from ..materials.covariance import LawCovariance
from ..scenes import MaterialSpec, Scene
from .card import (
    DIGESTED,
    KINDS,
    NAME_PATTERN,
    PIPELINE,
    SURROGATE,
    VERSION_PATTERN,
    ArtifactError,
    Card,
    new_card,
    read_card,
)
from .places import CARD, by_name, find_artifact, new_artifact, reading

Surrogate = LearnedBondForce | LearnedEnergy
"""Types of the force models that artifacts hold."""

MOST_PAYLOAD = 64 * 2**20
"""Greatest size in bytes of a payload, an ``.npz`` file of an artifact. Chosen: eight times the
largest spline, of `MOST_COEFFICIENTS` doubles; larger files are refused before they are read into
memory.
"""


def load_card(reference: str | Path) -> Card:
    """Return the card of an artifact; nothing else is read.

    Parameters
    ----------
    reference : str or path
        Artifact as for `pdsurrogate.load_surrogate`.

    Returns
    -------
    Card

    Raises
    ------
    ArtifactError
        If the artifact is unknown, or its card is damaged or was changed.

    See Also
    --------
    pdsurrogate.load_surrogate, pdsurrogate.load_pipeline

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> card = pds.load_card("neo-hookean@1")
    >>> card
    <Card of neo-hookean@1: bond-force-network of neo-hookean>
    """
    return _card_of(find_artifact(reference))


def called(folder: Path, card: Card) -> str:
    """Return the name of an artifact for messages, ``NAME@VERSION`` by its folder.

    If the card states another name, as in a copied folder, this name is added in brackets.
    """
    placed = Path(os.path.abspath(folder))  # a link keeps its own name
    if re.fullmatch(VERSION_PATTERN, placed.name) and re.fullmatch(
        NAME_PATTERN, placed.parent.name
    ):
        found = f"{placed.parent.name}@{placed.name}"
    else:
        found = placed.name
    own = f"{card.name}@{card.version}"
    return found + (f" ({own} by its card)" if found != own else "")


def _card_of(folder: Path) -> Card:
    """Return the card in an artifact's folder; raise ArtifactError if its digest shows that it
    was changed after it was stored.
    """
    with reading():
        card = read_card(folder / CARD)
    if card.stated_digest() not in (None, card.found_digest()):
        raise ArtifactError(
            f"{folder / CARD}: digest: {', '.join(DIGESTED)} or training.identification have"
            " changed since the artifact was stored: restore the card, or store the artifact again"
        )
    return card


def load_surrogate(reference: str | Path) -> ForceModel:
    """Return a force model by name, or the surrogate of an artifact.

    The card is read first; the payload must match its digest there, and is read as plain arrays, so
    loading runs no code from the file.

    Parameters
    ----------
    reference : str or path
        Name of an exact force model (a key of `pdsurrogate.forces.FORCES`), or an artifact as for
        `find_artifact`.

    Returns
    -------
    ForceModel

    Raises
    ------
    ArtifactError
        If the artifact is unknown, damaged, does not match its card, or holds anything but plain
        arrays.

    See Also
    --------
    pdsurrogate.store : stores an artifact.
    pdsurrogate.load_card : reads what an artifact states about itself.
    pdsurrogate.load_pipeline : loads the pipeline from which the surrogate was made.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.load_surrogate("neo-hookean@1")
    <NetworkForce neo-hookean@1 of neo-hookean>
    >>> pds.load_surrogate("nosb")
    <NOSBForce nosb>
    """
    if isinstance(reference, str) and reference in FORCES:
        return FORCES[reference]()
    return _surrogate_in(find_artifact(reference))


def _surrogate_in(folder: Path) -> Surrogate:
    """Return the surrogate in the folder of an artifact; raise ArtifactError if payload, kind,
    features, material or covariance contradict the card.
    """
    card = _card_of(folder)
    name = called(folder, card)
    where = f"{folder / CARD}"
    if card.kind not in KINDS:
        raise ArtifactError(
            f"{where}: kind: unknown kind {card.kind!r}; {suggestion(card.kind, KINDS)}"
        )
    data = _checked_payload(folder, card, SURROGATE, MOST_PAYLOAD)
    try:
        model = KINDS[card.kind].from_payload(
            name,
            payload_of(data),
            Domain(**dict(card.domain)),
            card.material.law,
            card.material.shape,
        )
    except DamagedFile as error:
        raise ArtifactError(f"{name}: {SURROGATE}: {error}") from None
    except (ValueError, TypeError, OverflowError) as error:
        raise ArtifactError(
            f"{name}: {SURROGATE} does not contain a {card.kind}, as the card states: {error}"
        ) from None
    if card.material.law in LAWS:
        errors = card.errors["box"]["on_surface"]
        law = law_of(card)
        ratio = law.bulk_modulus / law.shear_modulus
        model = replace(
            model,
            stated={
                "rms": float(errors["rms"]),
                "max": float(errors["max"]),
                "bulk_ratio": ratio,
            },
        )
        try:
            model.check_material(law)
        except ValueError as error:
            raise ArtifactError(
                f"{where}: material: {SURROGATE} does not match the material that the card states:"
                f" {error}"
            ) from None
    if entry := (card.training.get("identification") or {}).get("covariance"):
        try:
            found = LawCovariance(law_of(card), entry["names"], entry["values"])
        except ValueError as error:
            raise ArtifactError(f"{where}: training.identification: {error}") from None
        model = replace(model, covariance=found)
    if card.stated_digest() is None:
        warnings.warn(
            f"{name}: its card is older and has no digest to show changes; store it again",
            stacklevel=3,
        )
    return model


def law_of(card: Card) -> Law:
    """Return the law that a card names, with the parameters for which the model was trained;
    raise ArtifactError if the law is unknown.
    """
    try:
        return MaterialSpec(**card.material.trained_with).build()
    except ValueError as error:
        raise ArtifactError(
            f"{card.name}@{card.version}: the card's material.trained_with: {error}"
        ) from None


def payload_of(data: bytes) -> dict[str, np.ndarray | str]:
    """Return the dictionary of a surrogate's arrays and texts (its ``payload()``) from the bytes of
    the file that `save_artifact` wrote.

    Raises
    ------
    DamagedFile
        If `data` are not those of a file of plain arrays.
    """
    arrays = read_arrays(io.BytesIO(data))
    return {
        key: str(array) if array.ndim == 0 and array.dtype.kind == "U" else array
        for key, array in arrays.items()
    }


@reading()
def surrogate_for(law: Law, family: str = "bond force", plane: str = "stress") -> ForceModel:
    """Return the default force model of a material.

    The model is the artifact on the search path with the name of the law (for bond energies with
    ``-energy`` appended under plane stress and ``-isochoric`` otherwise), if there is such an
    artifact for this material; otherwise the exact model of the family.

    Parameters
    ----------
    law : Law
    family : str
        Kind of formulation, `ForceModel.family`: "bond force", "bond energy", "nosb" or "ba-nosb".
    plane : str
        State of the body: "stress", "strain" or "space".

    Raises
    ------
    ArtifactError
        If the artifact with this name cannot be read.
    """
    energy = f"{law.name}-energy" if plane == "stress" else f"{law.name}-isochoric"
    name, exact = {
        "bond force": (law.name, "analytic"),
        "bond energy": (energy, "bond-energy"),
    }.get(family, (None, family))
    folder = name and by_name(name)
    if folder:
        model = _surrogate_in(folder)
        with suppress(ValueError):  # another material of the same law
            model.check_material(law)
            return model
    return load_surrogate(exact)


def default_force(scene: Scene) -> ForceModel:
    """Return the default force model of a scene.

    For a single material under plane stress this is the model that `surrogate_for` returns. For
    plane strain, for three-dimensional bodies, and for several materials it is the exact bond
    energy. In plane strain and three dimensions the isochoric part of this energy acts at the bonds
    and its volumetric part at the points, which avoids volumetric locking.
    """
    if scene.plane != "stress" or scene.materials or scene.law().memory:
        return load_surrogate("bond-energy")
    return surrogate_for(scene.law())


def load_pipeline(reference: str | Path, *, trust: bool = False):
    """Return the fitted scikit-learn pipeline of an artifact, for refinement.

    The file is a pickle of Python objects: loading it runs code from the file.  The file must match
    its digest in the card, which shows that the file belongs to the card, but not that the author
    of both is trustworthy.

    Parameters
    ----------
    reference : str or path
        Artifact as for `pdsurrogate.load_surrogate`.
    trust : bool
        Must be True: you trust the author of the artifact as you would trust a program of theirs.

    Returns
    -------
    sklearn.pipeline.Pipeline

    Raises
    ------
    ArtifactError
        Without ``trust=True``, or if the artifact is unknown, has no pipeline, or its file does not
        match the card.

    See Also
    --------
    pdsurrogate.load_surrogate : loads the surrogate, which runs no code.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> try:
    ...     pds.load_pipeline("neo-hookean@1")
    ... except pds.ArtifactError as error:
    ...     print("trust=True" in str(error))
    True
    """
    if trust is not True:
        raise ArtifactError(
            "loading a pipeline executes code from its file; pass trust=True if you trust the"
            " author of the artifact"
        )
    # here, because simulations load no pipeline, and the import would take a tenth of the time of a
    # start
    import joblib

    folder = find_artifact(reference)
    return joblib.load(io.BytesIO(_checked_payload(folder, load_card(folder), PIPELINE)))


def save_artifact(
    folder: str | Path,
    card: dict,
    surrogate: Surrogate,
    pipeline=None,
) -> Path:
    """Write an artifact, whole or not at all.

    Parameters
    ----------
    folder : str or path
        The folder that holds artifacts; the new artifact becomes ``folder/NAME/VERSION``.
    card : dict
        Entries of `Card` except format, schema version, payloads and digest.
    surrogate : LearnedBondForce or LearnedEnergy
    pipeline : estimator, optional
        The fitted pipeline.

    Returns
    -------
    Path
        Folder of the new artifact.

    Raises
    ------
    ArtifactError
        If the version exists already (versions are immutable), the name or version is not allowed,
        or the written files cannot be read again, as for a model that the kernels do not evaluate.
        No file is left on disk then.
    """
    target = new_artifact(folder, card["name"], card["version"])
    title = f"{card['name']}@{card['version']}"
    Path(folder).mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(
        prefix=f".{card['name']}-{card['version']}-", dir=folder, ignore_cleanup_errors=True
    ) as held:
        temporary = Path(held) / card["name"] / card["version"]
        temporary.mkdir(parents=True)
        np.savez(temporary / SURROGATE, **surrogate.payload())
        contents = {
            SURROGATE: "the surrogate's constants: plain arrays, all that a simulation needs"
        }
        if pipeline is not None:
            import joblib  # here, as above

            joblib.dump(pipeline, temporary / PIPELINE, compress=0, protocol=4)
            contents[PIPELINE] = (
                "fitted scikit-learn pipeline: a pickle of Python objects, loaded only on explicit"
                " trust"
            )
        payloads = {name: _describe(temporary / name, what) for name, what in contents.items()}
        try:
            full = new_card({**card, "payloads": payloads})
        except ArtifactError as error:
            raise ArtifactError(
                f"{title}: the artifact cannot be stored with this card: {error}"
            ) from None
        (temporary / CARD).write_text(full.to_json(), encoding="utf-8")
        _surrogate_in(temporary)
        target.parent.mkdir(exist_ok=True)
        try:
            os.rename(temporary, target)
        except OSError:
            if not target.exists():
                raise
            raise ArtifactError(
                f"{title} already exists in {folder}, and versions never change; choose another"
                " version"
            ) from None
    return target


def _describe(path: Path, contains: str) -> dict:
    data = path.read_bytes()
    return {"contains": contains, "sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}


def _checked_payload(folder: Path, card: Card, name: str, most: float = np.inf) -> bytes:
    """Return the bytes of a payload file; raise ArtifactError for more than `most` bytes, or if
    size or SHA-256 contradict the card.
    """
    where = f"{called(folder, card)}: {name}"
    if name not in card.payloads:
        raise ArtifactError(f"{where}: the artifact has no such file")
    stated = card.payloads[name]
    if stated.bytes > most:
        raise ArtifactError(
            f"{where}: the card states {stated.bytes} bytes, but files of more than {most} bytes"
            " are not read"
        )
    with reading():
        path = folder / name
        # The size first, so that no file larger than stated is read into memory.
        data = path.read_bytes() if path.stat().st_size == stated.bytes else b""
    if len(data) != stated.bytes or hashlib.sha256(data).hexdigest() != stated.sha256:
        raise ArtifactError(
            f"{where}: the file is damaged or was replaced: its size or SHA-256 differs from the"
            " card"
        )
    return data
