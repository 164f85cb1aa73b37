"""Checks of force models and laws of one's own against the properties that those of the package
have.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ..artifacts import load_card, load_surrogate
from ..artifacts.store import law_of
from ..forces import FORCES, ForceModel
from ..forces.own import OwnBondForce, is_own_force
from ..forces.settings import WHERE
from ..materials import PLANES, Law, NeoHookean
from ..materials.law import checked_law
from . import forces, reflections, refusals, runs
from .laws import LAW_PROPERTIES
from .properties import Finding, Property, checked
from .subject import Subject

FORCE_MODEL_PROPERTIES = tuple(
    found
    for module in (forces, reflections, refusals, runs)
    for found in vars(module).values()
    if isinstance(found, Property)
)
"""All properties required of a force model, in the order in which
`pdsurrogate.testing.check_force_model` measures them.
"""


def subject_of(model: Any, law: Law | None = None, plane: str = "stress") -> Subject:
    """Return a force model under test; see `check_force_model`."""
    if plane not in PLANES:
        raise ValueError(f"plane must be {', '.join(PLANES)}, not {plane!r}")
    stated: tuple = ()
    if isinstance(model, str | Path):
        if str(model) not in FORCES:
            card = load_card(model)
            law = law or law_of(card)
            stated = tuple(card.errors["box"]["by_strain"])
        model = load_surrogate(model)
    elif is_own_force(model):
        model = OwnBondForce(model)
    if not isinstance(model, ForceModel):
        raise TypeError(
            "model must be a force model, its name or path, or have bond_force or energy, not"
            f" {model!r}"
        )
    if plane not in model.honors["plane"]:
        raise ValueError(f"{model.name} does not support plane={plane}")
    law = checked_law(law or NeoHookean())
    model.check_material(law)
    return Subject(model, law, plane, stated)


def check_force_model(
    model: Any,
    law: Law | None = None,
    plane: str = "stress",
    properties: Iterable[str] | None = None,
    tolerances: Mapping[str, float] | None = None,
) -> tuple[Finding, ...]:
    """Measure the properties that every force model must have, on small bodies and in small runs.

    Parameters
    ----------
    model : str, path, ForceModel or object
        Force model, its name, an artifact (its name or path), or an object with a ``bond_force`` or
        an ``energy``.
    law : Law, optional
        Material; by default the one on the card of an artifact, otherwise neo-Hookean with a bulk
        modulus of 100 shear moduli.
    plane : {"stress", "strain", "space"}
        Sheets in plane stress or plane strain, or solids.
    properties : iterable of str, optional
        Names of the properties; by default all of `FORCE_MODEL_PROPERTIES`.
    tolerances : mapping of str to float, optional
        Tolerances by the name of the property that replace the usual ones; ``math.inf`` for a
        property that the model is known to lack.

    Returns
    -------
    tuple of Finding
        Value, tolerance and note of each property; a property that does not apply has a note that
        says why.

    Raises
    ------
    AssertionError
        If the model lacks a property; the message has the value and the tolerance of each.
    ArtifactError
        If the model is a name or path of which no artifact can be read.
    TypeError, ValueError
        If an argument is unsuitable, the model does not describe the law or support the plane, or a
        name of a property is unknown.

    See Also
    --------
    pdsurrogate.testing.check_law : the same for a law.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> for finding in pds.testing.check_force_model(
    ...     "bond-energy", properties=["single_precision", "unbreakable"]
    ... ):
    ...     print(finding.name, finding.holds)
    single_precision True
    unbreakable True
    """
    subject = subject_of(model, law, plane)
    return checked(
        f"{subject.model.name}{WHERE[plane]}",
        subject,
        FORCE_MODEL_PROPERTIES,
        properties,
        tolerances,
    )


def check_law(
    law: Law, properties: Iterable[str] | None = None, tolerances: Mapping[str, float] | None = None
) -> tuple[Finding, ...]:
    """Measure the properties that every law must have.

    Parameters
    ----------
    law : Law
    properties : iterable of str, optional
        Names of the properties; by default all of `LAW_PROPERTIES`.
    tolerances : mapping of str to float, optional
        Tolerances by the name of the property that replace the usual ones.

    Returns
    -------
    tuple of Finding
        Value, tolerance and note of each property.

    Raises
    ------
    AssertionError
        If the law lacks a property; the message has the value and the tolerance of each.
    TypeError, ValueError
        If an argument is no law, or a name of a property is unknown.

    See Also
    --------
    pdsurrogate.testing.check_force_model : the same for a force model.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> findings = pds.testing.check_law(pds.materials.Gent(shear_modulus=0.4, bulk_modulus=40.0))
    >>> findings[0].name, all(finding.holds for finding in findings)
    ('derivatives', True)
    """
    return checked(checked_law(law).name, law, LAW_PROPERTIES, properties, tolerances)
