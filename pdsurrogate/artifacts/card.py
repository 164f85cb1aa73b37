"""The card of an artefact: everything about it that a person or a program wants to know before anything is unpickled."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ..forces import Domain
from ..html_tables import html_facts
from ..scenes.reading import explain

FORMAT = "pdsurrogate artefact"
SCHEMA_VERSION = 2
"""Raised with every change of the card or the payload that an older reader would misunderstand."""

NAME_PATTERN = r"^[a-z0-9][a-z0-9._-]{0,63}$"
VERSION_PATTERN = r"^[0-9]{1,9}(\.[0-9]{1,9}){0,2}$"
MOST_BYTES = 2**20
MOST_PLANES = 1000
"""Of the hull of test data."""

MOST_MEMBERS = 999
"""Of a committee."""

Finite = Annotated[float, Field(allow_inf_nan=False)]


class CardError(ValueError):
    """A card that cannot be read or does not make sense."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Material(_Part):
    """What the surrogate describes: a law, and those dimensionless parameters that its bond force depends on."""

    law: str
    trained_with: dict[str, Any]
    shape: dict[str, Finite]


class Payload(_Part):
    """One file of an artefact."""

    contains: str
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    bytes: Annotated[int, Field(ge=0)]


class DomainSpec(_Part):
    """Where the surrogate holds; see `pdsurrogate.forces.Domain`."""

    least_stretch: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    greatest_stretch: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    least_bulk: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    greatest_bulk: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    hull: Annotated[tuple[tuple[Finite, Finite, Finite], ...], Field(min_length=3, max_length=MOST_PLANES)] | None = None

    def build(self) -> Domain:
        """The domain that the solver tests."""
        return Domain(self.least_stretch, self.greatest_stretch, self.least_bulk, self.greatest_bulk, self.hull)


class MemberSpec(_Part):
    """A member of a committee: a surrogate beside that which runs, of its own material."""

    material: Material
    domain: DomainSpec
    errors: dict[str, Any]


class Card(_Part):
    """Contents of ``card.json``."""

    format: Literal["pdsurrogate artefact"]
    schema_version: int
    name: Annotated[str, Field(pattern=NAME_PATTERN)]
    version: Annotated[str, Field(pattern=VERSION_PATTERN)]
    kind: str
    description: str
    material: Material
    weight_function: str
    features: dict[str, Any]
    scaling: dict[str, Any]
    training: dict[str, Any]
    domain: DomainSpec
    errors: dict[str, Any]
    made_with: dict[str, str]
    payloads: dict[str, Payload]
    members: Annotated[tuple[MemberSpec, ...], Field(max_length=MOST_MEMBERS)] = ()

    def to_json(self) -> str:
        """The card as it is stored; what most have none of, a hull of test data and a committee, is left out where there is none."""
        content = self.model_dump()
        for part in (content, *content["members"]):
            if part["domain"]["hull"] is None:
                del part["domain"]["hull"]
        if not self.members:
            del content["members"]
        return json.dumps(content, indent=2, allow_nan=False) + "\n"

    def of_member(self, number: int) -> Card:
        """The card of a member of the committee, the first of which is 1."""
        member = self.members[number - 1]
        named = {"description": f"{self.description}; member {number} of {len(self.members)}", "members": ()}
        return self.model_copy(update={**named, "material": member.material, "domain": member.domain, "errors": member.errors})

    def __repr__(self) -> str:
        return f"<Card of {self.name}@{self.version}: {self.kind} of {self.material.law}>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        error = self.errors.get("box", {}).get("on_surface", {}).get("rms")
        facts = {
            "what": self.description,
            "kind": self.kind,
            "material": ", ".join(f"{key} {value}" for key, value in self.material.trained_with.items()),
            "stretches": f"{self.domain.least_stretch:g} to {self.domain.greatest_stretch:g}",
            "features": self.features.get("set", ""),
            "RMS error": "not stated" if error is None else f"{error:.2g}",
            **({"committee": f"{len(self.members)} members"} if self.members else {}),
        }
        return html_facts(f"Artefact {self.name}@{self.version}", facts)


def read_card(data: bytes, where: str) -> Card:
    """Read a card.

    Raises
    ------
    CardError
        If it is damaged, incomplete, or of a schema that this version does not know; says which and what to do.
    """
    if len(data) > MOST_BYTES:
        raise CardError(f"{where}: the card has {len(data)} bytes, which is not a card")
    try:
        content = json.loads(data.decode("utf-8"), parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise CardError(f"{where}: the card is damaged, it is not valid JSON: {error}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise CardError(f"{where}: this is not the card of a {FORMAT}")
    schema = content.get("schema_version")
    if type(schema) is not int:
        raise CardError(f"{where}: the card has no schema_version, so it is damaged")
    if schema > SCHEMA_VERSION:
        raise CardError(
            f"{where}: the artefact has schema version {schema}, this pdsurrogate reads {SCHEMA_VERSION}: upgrade pdsurrogate to use it"
        )
    if schema < SCHEMA_VERSION:
        raise CardError(f"{where}: the artefact has schema version {schema}, which is no longer read: fit it again with this pdsurrogate")
    try:
        return Card.model_validate(content)
    except ValidationError as error:
        raise CardError(f"{where}: the card is damaged: {explain(error)}") from None


def _refuse(constant: str):
    raise ValueError(f"{constant} is not a number")
