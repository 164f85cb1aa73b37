"""Card of an artefact: its description for readers and programs, checked before any other file is opened."""

from __future__ import annotations

import hashlib
import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, WrapValidator

from ..forces import Domain, EnergyNetwork, IsochoricNetwork, NetworkForce, PolynomialForce, SplineForce
from ..html_tables import html_facts
from ..materials import LAWS, Law
from ..scenes import MaterialSpec
from ..scenes.problems import PLAIN, explain

KINDS = {model.kind: model for model in (NetworkForce, PolynomialForce, SplineForce, EnergyNetwork, IsochoricNetwork)}
"""Force models that can be stored, by the kind in their card."""

FORMAT = "pdsurrogate artefact"
SCHEMA_VERSION, OLDEST_SCHEMA = 3, 2
"""Versions of cards and payloads; a change that an older reader would misread raises the first. Cards of version 2 have no digest."""

DIGESTED = ("kind", "material", "features", "domain", "errors", "payloads", "members")
"""Parts of a card that its digest covers, together with the identification: those that a run depends on."""

NAME_PATTERN = r"^[a-z0-9][a-z0-9._-]{0,63}$"
VERSION_PATTERN = r"^[0-9]{1,9}(\.[0-9]{1,9}){0,2}$"
SHA256 = r"^[0-9a-f]{64}$"
MOST_CARD = 2**20
"""Greatest size of a card in bytes. Chosen: shipped cards have 3 to 9 kB, and 1 kB is left for each of 999 members; a larger limit would
let a foreign file fill memory before it is refused."""

MOST_PLANES = 1000
"""Most planes of the hull of test data. Chosen: the hull is a polygon through the outermost states, which has some tens of sides; every
plane is evaluated for every state that is compared with the data."""

MOST_MEMBERS = 999
"""Most members of a committee: `WHICH_MEMBER` reads member numbers of up to three digits, as in ``NAME#999``."""

MOST_STORED = 0.1
"""RMS error on the plane-stress surface, relative to the force, above which a surrogate is not stored. Chosen to catch mistakes, such as
another law: coarse fits pass with a warning (`NOTED`)."""

NOTED = 0.01
"""RMS error, as for `MOST_STORED`, beyond which storing or running a surrogate warns. Chosen: forces in a run are off by about as much, and
fits of the default sizes reach a thirtieth of it or less."""

SURROGATE, MEMBERS, PIPELINE = "surrogate.npz", "members.npz", "pipeline.joblib"
"""Files of an artefact other than its card."""

SAME = 1e-9
"""Relative difference within which two statements of a number in a card agree: it allows for rounding in text and in a formula."""

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
Share = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True, ge=0)]


class ArtifactError(ValueError):
    """Artefact that cannot be found, read or written; the message gives the reason.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> try:
    ...     pds.load_surrogate("no-such-rubber")
    ... except pds.ArtifactError as error:
    ...     print(str(error)[:30])
    unknown force 'no-such-rubber'
    """


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


def _looked_at(part: type[_Part]) -> WrapValidator:
    """Return a pydantic validator that checks a table of a card against the model `part`, and returns the table unchanged."""
    return WrapValidator(lambda value, _: part.model_validate(value) and value)


class _Errors(_Part):
    """Relative errors of a surrogate over a set of states: RMS, greatest, and for energies the RMS of the energy."""

    rms: Share
    max: Share
    energy_rms: Share | None = None


class _Bin(_Errors):
    strain: tuple[Share, Share]


class _Report(_Part):
    """Errors of a surrogate as `pdsurrogate.evaluate` reports them; fields that are not declared here are finite numbers."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Finite]

    stretch_range: tuple[Positive, Positive]
    n_samples: Annotated[int, Field(strict=True, gt=0)]
    on_surface: _Errors
    off_surface: _Errors | None = None
    by_strain: tuple[_Bin, ...] = ()


class _Features(_Part):
    set: str
    names: tuple[str, ...]
    come_from: Annotated[tuple[str, ...], Field(alias="from")]
    targets: tuple[str, ...]
    units: str


class _Identification(_Part):
    """Identification of the law from test data: programs read the declared fields, `data` and `law`; further fields inform people."""

    model_config = ConfigDict(extra="allow")

    data: str
    law: dict[str, Any]


class _Training(_Part):
    """How the surrogate was trained: a simulation reads only `identification`, the fit of the law to test data; the rest informs people."""

    design: dict[str, Any]
    regressor: str
    parameters: dict[str, Any]
    outcome: dict[str, Any]
    cross_validation: tuple[dict[str, Any], ...]
    search: tuple[dict[str, Any], ...]
    identification: _Identification | None = None
    resampling: dict[str, Any] | None = None


Report = Annotated[dict[str, Any], _looked_at(_Report)]
Features = Annotated[dict[str, Any], _looked_at(_Features)]
Training = Annotated[dict[str, Any], _looked_at(_Training)]


class Material(_Part):
    """Entry of a card for the material: the law with its parameters in training, and the dimensionless ones that the force depends on."""

    law: str
    trained_with: dict[str, Any]
    shape: dict[str, Finite]

    def build(self) -> Law:
        """Return the law, with the parameters for which the model was trained; raise ValueError for a wrong field or an unknown law."""
        try:
            return MaterialSpec.model_validate(self.trained_with).build()
        except ValidationError as error:
            raise ValueError(f"material.trained_with: {explain(error)}") from None


class Payload(_Part):
    """Entry of a card for a file of the artefact: contents in words, SHA-256, and size in bytes."""

    contains: str
    sha256: Annotated[str, Field(pattern=SHA256)]
    bytes: Count


class DomainSpec(_Part):
    """Entry of a card for the domain of states in which the surrogate holds; see `pdsurrogate.forces.Domain`."""

    least_stretch: Positive
    greatest_stretch: Positive
    least_bulk: Positive
    greatest_bulk: Positive
    hull: Annotated[tuple[tuple[Finite, Finite, Finite], ...], Field(min_length=3, max_length=MOST_PLANES)] | None = None

    def build(self) -> Domain:
        """Return the domain as the `Domain` against which a run tests its states."""
        return Domain(self.least_stretch, self.greatest_stretch, self.least_bulk, self.greatest_bulk, self.hull)


class MemberSpec(_Part):
    """Entry of a card for a member of the committee, a further surrogate in the artefact: material, domain and errors."""

    material: Material
    domain: DomainSpec
    errors: dict[str, Report]


class Card(_Part):
    """Card of an artefact, the contents of ``card.json``: kind, material, features, training, domain, errors and files."""

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
    errors: dict[str, Report]
    made_with: dict[str, str]
    payloads: dict[str, Payload]
    members: Annotated[tuple[MemberSpec, ...], Field(max_length=MOST_MEMBERS)] = ()
    digest: Annotated[str, Field(pattern=SHA256)] | None = None

    def found_digest(self) -> str:
        """Return the SHA-256 computed anew from the card's entries `DIGESTED` and its ``training.identification``."""
        content = json.loads(self.to_json())
        parts = {name: content[name] for name in DIGESTED if name in content}
        parts["identification"] = content["training"].get("identification")
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()

    def to_json(self) -> str:
        """Return the text of ``card.json``; a hull of test data, a committee and a digest are left out where there is none."""
        return json.dumps(self.model_dump(exclude_defaults=True), indent=2, allow_nan=False) + "\n"

    def of_member(self, number: int) -> Card:
        """Return the card of the committee member with a number, from 1: this card with material, domain and errors of the member."""
        member = self.members[number - 1]
        named = {"description": f"{self.description}; member {number} of {len(self.members)}", "members": (), "digest": None}
        return self.model_copy(update={**named, **dict(member)})

    def __repr__(self) -> str:
        return f"<Card of {self.name}@{self.version}: {self.kind} of {self.material.law}>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        facts = {
            "what": self.description,
            "kind": self.kind,
            "material": ", ".join(f"{key} {value}" for key, value in self.material.trained_with.items()),
            "stretches": f"{self.domain.least_stretch:g} to {self.domain.greatest_stretch:g}",
            "features": self.features["set"],
            "RMS error": f"{self.errors['box']['on_surface']['rms']:.2g}",
            **({"committee": f"{len(self.members)} members"} if self.members else {}),
        }
        return html_facts(f"Artefact {self.name}@{self.version}", facts)


def read_card(data: bytes, where: str) -> Card:
    """Return the card in the bytes of a ``card.json``; `where` is the path for messages.

    Raises
    ------
    ArtifactError
        If the card is damaged, incomplete, or of a schema that this version does not read; the message gives the remedy.
    """
    if len(data) > MOST_CARD:
        raise ArtifactError(f"{where}: the card has {len(data)} bytes, which is not a card")
    try:
        content = json.loads(data.decode(), parse_constant=_finite, parse_float=_finite, object_pairs_hook=_without_duplicates)
    except (ValueError, RecursionError) as error:
        raise ArtifactError(f"{where}: the card is damaged, it is not valid JSON: {error}; put back what was written") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ArtifactError(f"{where}: format: this is not the card of a {FORMAT}")
    schema = content.get("schema_version")
    if type(schema) is not int:
        raise ArtifactError(f"{where}: schema_version: the card has no schema_version that is a whole number, so it is damaged")
    if not OLDEST_SCHEMA <= schema <= SCHEMA_VERSION:
        newer = f"this pdsurrogate reads {SCHEMA_VERSION}: upgrade pdsurrogate to use it"
        remedy = newer if schema > SCHEMA_VERSION else "which is no longer read: fit it again with this pdsurrogate"
        raise ArtifactError(f"{where}: the artefact has schema version {schema}, {remedy}")
    try:
        return checked_card(content)
    except RecursionError:
        raise ArtifactError(f"{where}: the card is damaged: its tables are nested too deeply") from None
    except ArtifactError as error:
        raise ArtifactError(f"{where}: the card is damaged: {error}; put back what was written, or store the artefact again") from None


def checked_card(content: Mapping[str, Any]) -> Card:
    """Return a card made of plain values (numbers, text, lists and tables), after checking that the values agree with one another.

    Raises
    ------
    ArtifactError
        If values are wrong or contradict each other; the message names the fields and the right values.
    """
    check_plain(content)
    try:
        card = Card.model_validate(content)
    except (ValidationError, OverflowError) as error:
        raise ArtifactError(_explained(error) if isinstance(error, ValidationError) else "a whole number is too large") from None
    if card.schema_version > OLDEST_SCHEMA and card.digest is None:
        raise ArtifactError("digest: is missing")
    if problem := next(_contradictions(card), None):
        raise ArtifactError(problem)
    return card


def new_card(entries: Mapping[str, Any]) -> Card:
    """Return the card of a new artefact: the entries completed by format, schema version and digest; see `checked_card` for errors."""
    card = checked_card({"format": FORMAT, "schema_version": SCHEMA_VERSION, **entries, "digest": "0" * 64})
    return card.model_copy(update={"digest": card.found_digest()})


def check_plain(content: Mapping[str, Any]) -> None:
    """Raise ArtifactError unless all values in nested tables and lists are None, finite numbers or text, as a card can hold."""
    for field, value in _leaves(dict(content)):
        if not (value is None or isinstance(value, bool | int | str) or (isinstance(value, float) and math.isfinite(value))):
            raise ArtifactError(f"{field}: must be a finite number, text, a list or a table, not {_shown(value)}")


def _contradictions(card: Card) -> Iterator[str]:
    """Yield a message for each contradiction between entries of a card, and for each value beyond the limits of stored artefacts."""
    files = {SURROGATE, *([MEMBERS] if card.members else [])}
    for name in sorted(files ^ set(card.payloads) - {PIPELINE}):
        there = f"with {len(card.members)} members it has {', '.join(sorted(files))} and maybe {PIPELINE}"
        yield f"payloads.{name}: is {'missing' if name in files else 'unknown'}; {there}"
    design = card.training["design"]
    hull = design.get("hull")
    if (hull is None) != (card.domain.hull is None) or not same_values(hull, card.domain.hull):
        yield "domain.hull: must be the same as training.design.hull"
    try:
        reach = math.exp(design["perturbation"]["log_C33"]) if design.get("off_surface") else None
    except (TypeError, KeyError, OverflowError):
        yield f"training.design.perturbation: must be a table with the number log_C33, not {_shown(design.get('perturbation'))}"
    bulk = card.domain.least_bulk, card.domain.greatest_bulk
    if reach is not None and not same_values(bulk, (1 / reach, reach)):
        right = 1 / reach, reach
        yield f"domain: least_bulk and greatest_bulk must be {right} by training.design.perturbation.log_C33, not {bulk}"
    parts: list[tuple[str, Card | MemberSpec]] = [("", card)]
    for key, part in [*parts, *((f"members.{number}.", member) for number, member in enumerate(card.members))]:
        yield from (f"{key}{problem}" for problem in _contradictions_of(part, card.kind))
    identified = card.training.get("identification")
    if identified is not None and not same_values(identified["law"], card.material.trained_with):
        yield f"training.identification.law: must be material.trained_with, {card.material.trained_with}, not {identified['law']}"


def _contradictions_of(part: Card | MemberSpec, kind: str) -> Iterator[str]:
    """Yield a message for each contradiction between material, domain and errors of a surrogate or committee member, `part`."""
    material, domain = part.material, part.domain
    if material.trained_with.get("law") != material.law:
        yield f"material.law: must be that of material.trained_with, {_shown(material.trained_with.get('law'))}, not {_shown(material.law)}"
    if material.law in LAWS:  # a user's own law may be absent here
        try:
            law = material.build()
        except ValueError as error:
            yield str(error)
            return
        right = law.describe()
        for name in sorted(set(right) - set(material.trained_with)):
            yield f"material.trained_with.{name}: is missing"
        shape = KINDS[kind].shape_of(law) if kind in KINDS else law.shape
        for name in sorted(set(shape) | set(material.shape)):
            found, meant = (numbers.get(name, "not there") for numbers in (material.shape, shape))
            if not same_values(found, meant):
                yield f"material.shape.{name}: must be {meant} by material.trained_with, not {found}"
    if "box" not in part.errors:
        yield "errors.box: is missing"
        return
    for low, high in (("least_stretch", "greatest_stretch"), ("least_bulk", "greatest_bulk")):
        if getattr(domain, low) > getattr(domain, high):
            yield f"domain.{low}: must be at most domain.{high}, {getattr(domain, high)}, not {getattr(domain, low)}"
    examined = part.errors["box"]["stretch_range"]
    for name, end in zip(("least_stretch", "greatest_stretch"), examined, strict=True):
        if not same_values(getattr(domain, name), end):
            yield f"domain.{name}: must be that of errors.box.stretch_range, {end}, over which it was examined, not {getattr(domain, name)}"
    for number, (*normal, distance) in enumerate(domain.hull or ()):
        if not any(normal) or distance < 0:
            yield f"domain.hull.{number}: must be n1, n2, d with n1 or n2 other than 0, and d, how far rest lies within, at least 0"
    box = part.errors["box"]
    rms, greatest = box["on_surface"]["rms"], box["on_surface"]["max"]
    if rms > MOST_STORED:
        yield f"errors.box.on_surface.rms: must be at most {MOST_STORED}, as nothing that is farther off is stored, not {rms}"
    # The greatest of n errors with this root mean square.
    most = math.sqrt(box["n_samples"]) * rms
    if not rms * (1 - SAME) <= greatest <= (1 + SAME) * most:
        yield f"errors.box.on_surface.max: must be from rms to rms sqrt(n_samples), {rms} to {most}, not {greatest}"


def same_values(one, other) -> bool:
    """Return whether two nested plain values are equal, where numbers may differ by `SAME` and tuples count as lists."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return set(one) == set(other) and all(same_values(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(same_values, one, other))
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (one, other))
    return math.isclose(one, other, rel_tol=SAME, abs_tol=0) if numbers else one == other


def _leaves(value: Any, field: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (dotted path, value) for every single value in nested tables and lists."""
    if isinstance(value, dict | list | tuple):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _leaves(inner, f"{field}.{key}" if field else str(key))
    else:
        yield field, value


WORDS = {
    **PLAIN,
    "missing": "is missing",
    "extra_forbidden": "is unknown: take it out",
    "float_type": "must be a number",
    "finite_number": "must be a finite number",
    **dict.fromkeys(("int_type", "int_from_float"), "must be a whole number"),
    "string_type": "must be text",
    "string_unicode": "must be text in Unicode",
    "string_pattern_mismatch": "must match {pattern}",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "too_short": "must have at least {min_length} entries",
    "too_long": "must have at most {max_length} entries",
}
"""Messages about a field by pydantic's types of errors."""


def _explained(error: ValidationError) -> str:
    """Return one line of text on a pydantic error: for each problem the field, the kind of value required, and the value found."""
    lines = []
    for problem in error.errors():
        field, kind = ".".join(map(str, problem["loc"])), problem["type"]
        words = WORDS[kind].format(**problem.get("ctx", {})) if kind in WORDS else problem["msg"]
        given = "" if kind in ("missing", "extra_forbidden") else f", not {_shown(problem['input'])}"
        lines.append(f"{field}: {words}{given}")
    return "; ".join(lines)


def _shown(value: Any) -> str:
    text = "a table" if isinstance(value, dict) else "a list" if isinstance(value, list | tuple) else repr(value)
    return text if len(text) <= 80 else text[:77] + "..."


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is {'not' if math.isnan(value) else 'too large'} a number")
    return value


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    for key, count in Counter(key for key, _ in pairs).items():
        if count > 1:
            raise ValueError(f"{key!r} is there twice in one table")
    return dict(pairs)
