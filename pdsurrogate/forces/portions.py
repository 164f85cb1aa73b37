"""Binding of the force models of several materials to one body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..body import Body
from .internal_force import InternalForce
from .protocol import ForceModel, Portion
from .settings import ForceSettings


def bind_portions(body: Body, portions: Sequence[Portion], settings: ForceSettings, rigid: np.ndarray | None = None) -> InternalForce:
    """Prepare the evaluation of a body whose points are of several materials.

    Portions of the same law and model are one material; if all portions are, the body is evaluated as one of a single material.

    Parameters
    ----------
    body : Body
    portions : sequence of Portion
        Portions that together contain every point of the body once.
    settings : ForceSettings
        Settings that every model honours, as far as it uses them.
    rigid : ndarray of int, optional
        Points of rigid parts, without a material; solvers move them, and bonds to other points act on them. The force must have an energy.

    Raises
    ------
    ValueError
        If a point is in none or in two, a model does not describe its law or cannot honour a setting, models of two kinds meet, or bonds
        are to break.
    """
    rigid = np.empty(0, dtype=np.int64) if rigid is None else rigid
    if not portions:
        raise ValueError("the rigid regions take all points of the body: nothing is left to be deformed")
    of_points = np.concatenate([rigid, *(portion.points for portion in portions)])
    if not np.array_equal(np.sort(of_points), np.arange(len(body))):
        raise ValueError("the materials must have every point of the body once")
    families = {portion.model.family: portion.model.name for portion in portions}
    if len(families) > 1:
        raise ValueError(f"the materials of a body take force models of one kind, not {' and '.join(sorted(families.values()))}")
    if settings.breakable and (len(portions) > 1 or len(rigid)):
        raise ValueError("bonds that break (fracture) are taken in a body of one material only: leave out fracture or materials")
    merged = _merged(portions)
    if len(merged) > 1 and (asked := [portion.model.name for portion in merged if portion.model.members]):
        raise ValueError(f"{asked[0]}: the deviation of members is told of bodies of one material; leave out #all")
    if len(merged) == 1 and not len(rigid):
        return merged[0].model.bind(body, merged[0].law, settings)
    honoured = {key for portion in merged for key in portion.model.honoured(settings.plane)}
    for portion in merged:
        # Models that hold everywhere do not use `outside`; those of other materials may have a domain.
        honours = portion.model.honoured(settings.plane)
        spared = "outside" in honoured and "outside" not in honours
        (replace(settings, outside=None) if spared else settings).check(portion.model.name, honours)
        portion.model.check_material(portion.law)
        _check_several(portion.model, settings.plane)
    return InternalForce(body, merged, settings)


def _check_several(model: ForceModel, plane: str) -> None:
    """Raise ValueError if a model cannot describe one of several materials of a body.

    The pressure of bond forces and of NOSB depends on det F at single points (theory, section 16). A point would have to keep its volume
    both in its own motion and in the continued motion of the other material, and no equilibrium exists; with one gradient for both
    materials, states that are homogeneous on either side are not in equilibrium.
    """
    if not model.several_materials:
        raise ValueError(f"{model.name} takes a body of one material; without materials it serves every law")
    if plane not in model.several_materials:
        raise ValueError(
            f"{model.name} takes several materials with plane=stress only: where the volume is held its pressure is wrong beside an "
            "interface; force=bond-energy takes them everywhere"
        )


def _merged(portions: Sequence[Portion]) -> list[Portion]:
    """Return portions of different laws or models, each with all its points."""
    found: list[Portion] = []
    for portion in portions:
        same = next((n for n, other in enumerate(found) if other.law == portion.law and _same(other.model, portion.model)), None)
        if same is None:
            found.append(portion)
        else:
            found[same] = replace(portion, points=np.sort(np.concatenate([found[same].points, portion.points])))
    return found


def _same(model: ForceModel, other: ForceModel) -> bool:
    """Return whether two models are equivalent: the same object, or two of one class without learnt data."""
    return model is other or (type(model) is type(other) and model.name == other.name and not model.payload() and not other.payload())
