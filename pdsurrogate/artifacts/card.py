"""Card of an artifact: its description for readers and programs, checked before any other file
is opened.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, TypeAdapter, WrapValidator

from ..arguments import kind_of
from ..forces import EnergyNetwork, IsochoricNetwork, NetworkForce, PolynomialForce, SplineForce
from ..html_tables import html_facts
from ..scenes import SceneError
from ..scenes.reading import leaves
from ..scenes.strict_model import StrictModel
from .shipped import SHIPPED_CARDS

KINDS = {
    model.kind: model
    for model in (NetworkForce, PolynomialForce, SplineForce, EnergyNetwork, IsochoricNetwork)
}
"""Classes of the force models that can be stored, by the entry ``kind`` of a card."""

FORMAT = "pdsurrogate artefact"  # as in all files so far
SCHEMA_VERSION = 3
OLDEST_SCHEMA = 2
"""Version of the format of new cards and payloads (an artifact's other files), and the oldest
version that is read.

A change of the format that an older pdsurrogate would misread raises the version. Cards of version
2 have no digest.
"""

DIGESTED = ("kind", "material", "features", "domain", "errors", "payloads", "members")
"""Entries of a card on which a run depends: the card's digest covers them and
``training.identification``.
"""

NAME_PATTERN = r"^[a-z0-9][a-z0-9._-]{0,63}$"
VERSION_PATTERN = r"^[0-9]{1,9}(\.[0-9]{1,9}){0,2}$"
SHA256 = r"^[0-9a-f]{64}$"
MOST_CARD = 2**20
"""Greatest size of a card in bytes. Chosen: shipped cards have 3 to 9 kB; a larger limit would let
a foreign file fill memory before it is refused.
"""

MOST_PLANES = 1000
"""Most half-planes that bound the hull (the convex polygon in log-stretches) of the test data
behind a surrogate. Chosen: the polygon goes through the outermost states, and has some tens of
sides; every half-plane is evaluated for every state that is compared with the data.
"""

MOST_STORED = 0.1
"""RMS error, divided by the RMS of the exact force or stress, above which a surrogate is not
stored: the entry ``on_surface`` of the report of `pdsurrogate.evaluate`. Chosen to catch mistakes,
such as samples of another law: coarse fits pass with a warning (`NOTED`).
"""

NOTED = 0.01
"""RMS error of a surrogate's force or stress, divided by the RMS of the exact one, above which
storing or running the surrogate warns. Chosen: forces in a run are off by about as much, and fits
of the default sizes reach a thirtieth of it or less.
"""

SURROGATE = "surrogate.npz"
PIPELINE = "pipeline.joblib"
"""Names of an artifact's files other than its card: constants of the surrogate, fitted pipeline."""

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
Share = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True, ge=0)]


class ArtifactError(ValueError):
    """Error for an artifact that cannot be found, read or written; the message gives the reason.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> try:
    ...     pds.load_surrogate("no-such-rubber")
    ... except pds.ArtifactError as error:
    ...     print(str(error)[:30])
    unknown force 'no-such-rubber'
    """


def _looked_at(part: type[StrictModel]) -> WrapValidator:
    """Return a pydantic validator that checks a table of a card against the pydantic model
    `part`, and returns the table itself.
    """
    return WrapValidator(lambda value, _: TypeAdapter(part).validate_python(value) and value)  # type: ignore[truthy-bool]  # raises or is true


class ErrorEntries(StrictModel):
    """Relative errors of a surrogate over a set of states.

    Parameters
    ----------
    rms : float
        RMS error of the bond force or stress, divided by the RMS of the exact one. Unit: none.
    max : float
        Greatest error, divided by the same RMS. Unit: none.
    energy_rms : float, optional
        For an energy its RMS error, divided by the RMS of the exact energy. Unit: none.
    """

    rms: Share
    max: Share
    energy_rms: Share | None = None


class BinEntries(ErrorEntries):
    """Relative errors of a surrogate over the states of one interval of strain.

    Parameters
    ----------
    strain : pair of float
        Bounds of the greatest principal strain. Unit: none.
    """

    strain: tuple[Share, Share]


class ReportEntries(StrictModel):
    """Errors of a surrogate as `pdsurrogate.evaluate` reports them; fields that are not declared
    here are finite numbers.

    Parameters
    ----------
    stretch_range : pair of float
        Least and greatest principal stretch of the states. Unit: none.
    n_samples : int
        Number of states.
    on_surface : ErrorEntries
        Errors in states of plane stress; for an isochoric energy in states of constant volume.
    off_surface : ErrorEntries, optional
        Errors of a bond force in states that are not in plane stress, which occur in simulations.
    by_strain : list of BinEntries
        Errors by intervals of strain.
    **extra_data : float
        Further errors, as `pdsurrogate.evaluate` reports them.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Finite]

    stretch_range: tuple[Positive, Positive]
    n_samples: Annotated[int, Field(strict=True, gt=0)]
    on_surface: ErrorEntries
    off_surface: ErrorEntries | None = None
    by_strain: tuple[BinEntries, ...] = ()


class ReportsEntries(StrictModel):
    """Reports of errors by title.

    Parameters
    ----------
    box : ReportEntries
        Errors over all pairs of principal stretches in the range of the domain.
    **extra_data : ReportEntries
        Errors over other states.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, ReportEntries]

    box: ReportEntries


class FeatureEntries(StrictModel):
    """Inputs and outputs of a surrogate.

    Parameters
    ----------
    set : str
        Name of the feature set.
    names : list of str
        Features, in their order.
    come_from : list of str
        Quantities from which the features are computed; the key in cards is ``from``.
    targets : list of str
        Quantities that the surrogate predicts.
    units : str
        Units of features and targets, in words.
    """

    set: str
    names: tuple[str, ...]
    come_from: Annotated[tuple[str, ...], Field(alias="from")]
    targets: tuple[str, ...]
    units: str


class CovarianceEntries(StrictModel):
    """Covariance of the law, from which results have standard errors
    (`pdsurrogate.materials.LawCovariance`).

    Parameters
    ----------
    names : list of str
        Dotted keys of numbers of the law.
    values : list of list of float
        Covariance of these numbers. Unit: product of those of the two numbers.
    """

    names: tuple[str, ...]
    values: tuple[tuple[Finite, ...], ...]


class BreakEntries(StrictModel):
    """States in which specimens broke, in one mode of loading.

    Parameters
    ----------
    specimens : int
        Number of specimens that broke.
    stretch : pair of float
        Mean and standard deviation (null for one specimen) of the stretch. Unit: none.
    nominal_stress : pair of float
        Mean and standard deviation of the nominal stress. Unit: stress.
    work : pair of float
        Mean and standard deviation of the work per undeformed volume up to the break. Unit: stress.
    weibull_modulus : pair of float, optional
        Weibull modulus of the nominal stress, and its standard error, if at least five specimens
        broke. Unit: none.
    """

    specimens: Annotated[int, Field(strict=True, gt=0)]
    stretch: tuple[Positive, Share | None]
    nominal_stress: tuple[Finite, Share | None]
    work: tuple[Finite, Share | None]
    weibull_modulus: tuple[Positive, Positive] | None = None


class TearingEntries(StrictModel):
    """Tearing energy of specimens, in one kind of tear test.

    Parameters
    ----------
    specimens : int
        Number of specimens that tore.
    energy : pair of float
        Mean and standard deviation (null for one specimen) of the energy per undeformed area, by
        the identified law. Unit: stress mm.
    """

    specimens: Annotated[int, Field(strict=True, gt=0)]
    energy: tuple[Positive, Share | None]


class IdentificationEntries(StrictModel):
    """Identification of the law from test data.

    Parameters
    ----------
    data : str
        Name of the test data.
    law : dict
        Name and parameters of the identified law, equal to ``material.trained_with``.
    covariance : CovarianceEntries, optional
        Covariance of the law; none if the data do not determine all of its parameters.
    stress_unit : str, optional
        Unit of the stresses and moduli, if the test data state it.
    at_break : dict of BreakEntries, optional
        Stretch, stress and work at break by mode of loading, if specimens broke.
    tearing : dict of TearingEntries, optional
        Tearing energy by mode ("trouser", "pure-shear-tear"), if there were tear tests.
    **extra_data
        Results of the identification, as ``pdsurrogate identify`` reports them; they
        inform people.
    """

    model_config = ConfigDict(extra="allow")

    data: str
    law: dict[str, Any]
    covariance: CovarianceEntries | None = None
    stress_unit: str | None = None
    at_break: dict[str, BreakEntries] | None = None
    tearing: dict[str, TearingEntries] | None = None


class TrainingEntries(StrictModel):
    """How the surrogate was trained; a simulation reads only `identification`, the rest informs
    people.

    Parameters
    ----------
    design : dict
        How the training samples were drawn: name of the design, number, range of stretches, seed
        and further settings.
    regressor : str
        Class of the regressor.
    parameters : dict
        Parameters of the regressor.
    outcome : dict
        Iterations and losses of the training, if the regressor reports them.
    cross_validation : list of dict
        Relative errors by fold; empty without a cross-validation.
    search : list of dict
        Settings that were compared, with their errors; empty without a comparison.
    identification : IdentificationEntries, optional
        Fit of the law to test data, if the law was identified.
    resampling : dict, optional
        Error of the spline that replaces a regressor without compiled code.
    """

    design: dict[str, Any]
    regressor: str
    parameters: dict[str, Any]
    outcome: dict[str, Any]
    cross_validation: tuple[dict[str, Any], ...]
    search: tuple[dict[str, Any], ...]
    identification: IdentificationEntries | None = None
    resampling: dict[str, Any] | None = None


Reports = Annotated[dict[str, Any], _looked_at(ReportsEntries)]
Features = Annotated[dict[str, Any], _looked_at(FeatureEntries)]
Training = Annotated[dict[str, Any], _looked_at(TrainingEntries)]


class Material(StrictModel):
    """Entry of a card for the material.

    Parameters
    ----------
    law : str
        Name of the law.
    trained_with : dict
        Name and parameters of the law in training.
    shape : dict of float
        Dimensionless parameters on which the force depends, which a scene's material must have;
        they do not change when all moduli are scaled. Unit: none.
    """

    law: str
    trained_with: dict[str, Any]
    shape: dict[str, Finite]


class Payload(StrictModel):
    """Entry of a card for a file of the artifact.

    Parameters
    ----------
    contains : str
        Contents, in words.
    sha256 : str
        SHA-256 of the file, which is checked before the file is read.
    bytes : int
        Size of the file in bytes.
    """

    contains: str
    sha256: Annotated[str, Field(pattern=SHA256)]
    bytes: Count


class DomainSpec(StrictModel):
    """Entry of a card for the domain of states in which the surrogate holds; see
    `pdsurrogate.forces.Domain`.

    Parameters
    ----------
    least_stretch : float
        Least principal stretch. Unit: none.
    greatest_stretch : float
        Greatest principal stretch. Unit: none.
    least_bulk : float
        Least squared volume ratio. Unit: none.
    greatest_bulk : float
        Greatest squared volume ratio. Unit: none.
    hull : list of triples of float, optional
        Convex hull of the test data behind the surrogate: half-planes (n1, n2, d), n1 log l1 + n2
        log l2 <= d, of the two greater of three principal stretches l of product 1. Unit: none.
    rates : pair of float, optional
        Least and greatest rate of stretch of the tests behind the branches of the material. Unit:
        1/s.
    """

    least_stretch: Positive
    greatest_stretch: Positive
    least_bulk: Positive
    greatest_bulk: Positive
    hull: (
        Annotated[
            tuple[tuple[Finite, Finite, Share], ...], Field(min_length=3, max_length=MOST_PLANES)
        ]
        | None
    ) = None
    rates: tuple[Positive, Positive] | None = None


class Card(StrictModel):
    """Card of an artifact, the contents of ``card.json``.

    Parameters
    ----------
    format : str
        Marks the file as a card; the word keeps its British spelling.
    schema_version : int
        Version of the format.
    name : str
        Name of the artifact: lower-case letters, digits and ``._-``.
    version : str
        Version of the artifact: up to three whole numbers with dots between.
    kind : str
        Kind of force model: bond-force-network, bond-force-polynomial, bond-force-spline,
        energy-network or isochoric-network.
    description : str
        Purpose of the artifact, in a sentence.
    material : Material
        Material that the surrogate has learned.
    weight_function : str
        Weight functions of bonds with which the surrogate may be used, in words.
    features : dict
        Inputs and outputs of the surrogate.
    scaling : dict
        Scaling of features and targets in training.
    training : dict
        How the surrogate was trained.
    domain : DomainSpec
        States for which the surrogate is valid.
    errors : dict
        Errors against the exact force or energy.
    made_with : dict of str
        Versions of the packages with which the artifact was made.
    payloads : dict of Payload
        The other files of the artifact by name.
    members : list of dict
        Members of a committee, which earlier versions stored; they are not read.
    digest : str, optional
        SHA-256 of the entries on which a run depends; the package rejects a card whose entries do
        not match it. Cards of schema version 2 have none.
    """

    format: Literal["pdsurrogate artefact"]
    schema_version: int
    name: Annotated[str, Field(pattern=NAME_PATTERN)]
    version: Annotated[str, Field(pattern=VERSION_PATTERN)]
    kind: str
    description: str
    material: Material
    weight_function: str
    features: Features
    scaling: dict[str, Any]
    training: Training
    domain: DomainSpec
    errors: Reports
    made_with: dict[str, str]
    payloads: dict[str, Payload]
    members: tuple[dict[str, Any], ...] = ()
    digest: Annotated[str, Field(pattern=SHA256)] | None = None

    def stated_digest(self) -> str | None:
        """Return the digest with which the card was stored, or None.

        Cards of schema version 2 contain no digest: for those shipped with the package it is that
        listed in `SHIPPED_CARDS`, else None.
        """
        return self.digest or next(
            (
                SHIPPED_CARDS[file.sha256]
                for file in self.payloads.values()
                if file.sha256 in SHIPPED_CARDS
            ),
            None,
        )

    def found_digest(self) -> str:
        """Return the SHA-256 computed anew from the card's entries `DIGESTED` and its
        ``training.identification``.
        """
        content = json.loads(self.to_json())
        parts = {name: content[name] for name in DIGESTED if name in content}
        parts["identification"] = content["training"].get("identification")
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()

    def to_json(self) -> str:
        """Return the text of ``card.json``; entries that have their default value, are left
        out.
        """
        return json.dumps(self.model_dump(exclude_defaults=True), indent=2, allow_nan=False) + "\n"

    def __repr__(self) -> str:
        return f"<Card of {self.name}@{self.version}: {self.kind} of {self.material.law}>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        facts = {
            "what": self.description,
            "kind": self.kind,
            "material": ", ".join(
                f"{key} {value}" for key, value in self.material.trained_with.items()
            ),
            "stretches": f"{self.domain.least_stretch:g} to {self.domain.greatest_stretch:g}",
            "features": self.features["set"],
            "RMS error": f"{self.errors['box']['on_surface']['rms']:.2g}",
        }
        return html_facts(f"Artifact {self.name}@{self.version}", facts)


def read_card(path: Path) -> Card:
    """Read and check the card at a path; raise ArtifactError, with file and field, for a wrong
    card, OSError if there is none to read.
    """
    where = str(path)
    with path.open("rb") as file:
        data = file.read(MOST_CARD + 1)
    if len(data) > MOST_CARD:
        raise ArtifactError(
            f"{where}: the file has more than {MOST_CARD} bytes, so it is not a card"
        )
    try:
        content = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise ArtifactError(
            f"{where}: the card is damaged (not valid JSON): {error}; restore the file that was"
            " written"
        ) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ArtifactError(f"{where}: format: this is not the card of a pdsurrogate artifact")
    schema = content.get("schema_version")
    if type(schema) is not int or not OLDEST_SCHEMA <= schema <= SCHEMA_VERSION:
        raise ArtifactError(
            f"{where}: schema_version: this pdsurrogate reads {OLDEST_SCHEMA} to {SCHEMA_VERSION},"
            f" not {kind_of(schema)}: upgrade pdsurrogate to read a newer card; fit an artifact"
            " with an older card again"
        )
    try:
        return checked_card(content)
    except (ArtifactError, RecursionError) as error:
        raise ArtifactError(
            f"{where}: the card is damaged: {error}; restore the file, or store the artifact again"
        ) from None


def checked_card(content: Mapping[str, Any]) -> Card:
    """Return a card made of plain values (numbers, text, lists and tables); raise ArtifactError
    with the field for a wrong value.
    """
    check_plain(content)
    try:
        card = Card(**content)
    except SceneError as error:
        raise ArtifactError(str(error)) from None
    if card.schema_version > OLDEST_SCHEMA and card.digest is None:
        raise ArtifactError("digest: this entry is missing")
    return card


def new_card(entries: Mapping[str, Any]) -> Card:
    """Return the card of a new artifact: `entries` completed by format, schema version and digest.

    Raise ArtifactError for values that a card may not have, and if ``training.identification``
    reports the fit of test data to another law or to other parameters than
    ``material.trained_with`` states.
    """
    card = checked_card(
        {"format": FORMAT, "schema_version": SCHEMA_VERSION, **entries, "digest": "0" * 64}
    )
    identified = card.training.get("identification")
    right = card.material.trained_with
    if identified and json.dumps(identified["law"], sort_keys=True) != json.dumps(
        right, sort_keys=True
    ):
        raise ArtifactError(
            f"training.identification.law: must be the law in material.trained_with, {right}, not"
            f" {identified['law']}"
        )
    return card.model_copy(update={"digest": card.found_digest()})


def check_plain(content: Mapping[str, Any]) -> None:
    """Raise ArtifactError unless all values in nested tables and lists are None, finite numbers
    or text, as a card can hold.
    """
    for field, value in leaves(content):
        if not (
            value is None
            or isinstance(value, bool | int | str)
            or (isinstance(value, float) and math.isfinite(value))
        ):
            raise ArtifactError(
                f"{field}: must be a finite number, text, a list or a table, not {kind_of(value)}"
            )
