"""Strength and tearing energy on the card of an artifact, for scenes that leave them to it."""

from typing import TypeVar

from ..scenes import Scene, SceneError
from ..scenes.loading_checks import criteria_of
from ..scenes.model import Criterion
from ..scenes.reading import apply_change
from ..scenes.strict_model import left_to_artifact
from .card import Card, IdentificationEntries
from .store import load_card

DATA_OF_THE_PACKAGE = ("treloar", "kawabata")
"""Names of the test data that are shipped with the package; their stresses are in MPa, which cards
of earlier versions do not state.
"""

PASCALS = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "N/mm^2": 1e6, "N/mm2": 1e6, "bar": 1e5}
PASCALS |= {"psi": 6894.757293168361, "ksi": 6894757.293168361, "kgf/cm2": 98066.5}
"""Units of stress in pascals, to convert moduli from test data to the unit of a scene: those that
messages on test data show (`measurements.quantities.UNITS`), whose library no simulation loads.
"""

MILLIMETERS = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1e3, "in": 25.4}
"""Units of length in millimeters, in which tearing energies on cards are, times the unit of stress.
"""

BROKEN = "tests in tension that went to break"

MEANS = {
    "strength.uniaxial": ("uniaxial", "nominal_stress", BROKEN),
    "strength.stretch": ("uniaxial", "stretch", BROKEN),
    "strength.equibiaxial": ("equibiaxial", "nominal_stress", f"equibiaxial {BROKEN}"),
    "strength.scatter.modulus": ("uniaxial", "weibull_modulus", f"five {BROKEN}"),
}
"""Mode of tests and entry of a card for keys of a criterion, and what is missing without them."""

Given = TypeVar("Given", bound=Criterion)


def unit_of_stress(card: Card, scene: Scene) -> float:
    """Return the unit of stress of a card in that of a scene; 1 if the tests state none.

    Raises
    ------
    SceneError
        If the tests state one, and that of the scene cannot be converted to.
    """
    tests = card.training.get("identification") or {}
    unit = tests.get("stress_unit", "MPa" if tests.get("data") in DATA_OF_THE_PACKAGE else None)
    wanted = scene.units.stress
    if unit is None or unit == wanted:
        return 1.0
    if unit in PASCALS and wanted in PASCALS:
        return PASCALS[unit] / PASCALS[wanted]
    choice = ", ".join(PASCALS if unit in PASCALS else [unit])
    raise SceneError(
        f"scene {scene.name}: units.stress must be one of {choice}, to convert stresses of"
        f" {card.name}@{card.version} from {unit}, not {wanted or 'left out'}"
    )


def with_measured(scene: Scene, card: Card | None) -> Scene:
    """Return a scene in whose criteria of fracture the means of the tests behind an artifact
    replace ``"artifact"``: for the rest of the body those of `card`, if given, for an entry of
    `materials` those of the artifact that it names as its material or force.

    Raises
    ------
    SceneError
        If a card does not have them, or the unit of length is not known; the message names the key.
    """
    if scene.fracture is None or not any(map(left_to_artifact, criteria_of(scene).values())):
        return scene
    parts = tuple(
        part
        if part.fracture is None or not (source := part.material.artifact or part.force)
        else part.model_copy(
            update={
                "fracture": _filled(
                    part.fracture, load_card(source), (scene, f"materials.{number}.fracture")
                )
            }
        )
        for number, part in enumerate(scene.materials)
    )
    rest = _filled(scene.fracture, card, (scene, "fracture")) if card else scene.fracture
    return scene.model_copy(update={"fracture": rest, "materials": parts})


def _filled(
    given: Given,
    card: Card,
    place: tuple[Scene, str],
) -> Given:
    """Return a criterion with the numbers on a card in the units of a scene; `place` are the
    scene and the key of the criterion.
    """
    scene, key = place
    left = left_to_artifact(given)
    if not left:
        return given
    data = given.model_dump()
    tests = IdentificationEntries.model_validate(
        {"data": "", "law": {}, **(card.training.get("identification") or {})}
    )
    try:
        for name in left:
            number = _energy(tests, scene.units.length) if name == "energy" else _mean(tests, name)
            stress = name == "energy" or "nominal_stress" in MEANS[name]
            apply_change(data, name, number * (unit_of_stress(card, scene) if stress else 1.0))
    except ValueError as error:
        raise SceneError(
            f"scene {scene.name}: {key}.{name}: {error} (artifact {card.name}@{card.version})"
        ) from None
    return type(given).model_validate(data)


def _mean(tests: IdentificationEntries, name: str) -> float:
    """Return the mean on a card for a key; raise ValueError if it has none."""
    mode, entry, missing = MEANS[name]
    broken = (tests.at_break or {}).get(mode)
    found = broken and getattr(broken, entry)
    if not found:
        raise ValueError(f"the card has no {missing}: state a number")
    return found[0]


def _energy(tests: IdentificationEntries, unit: str | None) -> float:
    """Return the mean tearing energy of all specimens in the unit of stress of a card, times a
    unit of length.
    """
    tears = (tests.tearing or {}).values()
    number = sum(one.specimens for one in tears)
    if not number:
        raise ValueError("the card has no tear tests: state a number")
    if unit not in MILLIMETERS:
        raise ValueError(f"units.length must be one of {', '.join(MILLIMETERS)}, to convert it")
    return sum(one.specimens * one.energy[0] for one in tears) / number / MILLIMETERS[unit]
