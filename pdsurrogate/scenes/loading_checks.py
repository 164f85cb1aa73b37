"""Checks that the loading of a scene fits together and can be followed; every check raises
ValueError with the key of the wrong part.
"""

import math
from itertools import pairwise

from ..arguments import suggestion
from .amplitudes import amplitude_of
from .loading import controlled_place
from .model import Criterion, SceneData, entries_of
from .regions import FACES, label_of_region
from .tip_diameter import tip_diameters_in

MOST_INCREMENTS = 100_000
"""Greatest number of increments of a step; more would run for days on the smallest body."""


def check_loading(scene: SceneData) -> None:
    """Raise ValueError if the loading of a scene, what breaks or its probes make no sense."""
    for check in (
        _way_of_loading,
        _rigid_regions,
        _grips,
        _program,
        _control,
        _fracture,
        _thickness,
        _amplitudes,
        _probes,
    ):
        check(scene)


def _way_of_loading(scene: SceneData) -> None:
    general = [key for key in ("prescribed", "loads", "obstacles", "steps") if getattr(scene, key)]
    short = [
        key for key in ("grips", "stretches", "times", "holds", "dynamics") if getattr(scene, key)
    ]
    if general and short:
        raise ValueError(
            f"{short[0]} and {general[0]} belong to two different ways to define the loading: use"
            " grips and stretches (with holds and dynamics), or prescribed, loads and obstacles"
            " with steps (with dynamics in a step)"
        )
    if general and not scene.steps:
        raise ValueError(
            f"{general[0]}: needs steps, the values of the loading parameter t to be reached, such"
            " as steps=1"
        )
    if general == ["steps"]:
        raise ValueError(
            "steps: have no effect without prescribed displacements, loads or obstacles"
        )
    if not general and not scene.grips:
        raise ValueError(
            "the scene has no loading: give two grips and stretches, or steps with prescribed"
            " displacements or loads"
        )


def _first_rigid(scene: SceneData) -> str | None:
    """Return the key of the first rigid region of a scene."""
    return next((key for key, part in entries_of(scene, "materials") if part.material.rigid), None)


def _rigid_regions(scene: SceneData) -> None:
    if scene.material is not None and scene.material.rigid:
        raise ValueError("material: cannot be rigid; define rigid regions as entries of materials")
    rigid = _first_rigid(scene)
    moving = next(
        (key for key, step in entries_of(scene, "steps") if step.dynamics is not None), None
    )
    if rigid and scene.stretched:
        raise ValueError(
            f"{rigid}: with a rigid region, define the loading with prescribed, loads and steps,"
            " not with grips"
        )
    if rigid and moving:
        raise ValueError(
            f"{moving}.dynamics: rigid regions ({rigid}) are supported in equilibrium only"
        )


def _grips(scene: SceneData) -> None:
    if not scene.grips:
        return
    if len(scene.grips) != 2:
        raise ValueError(
            f"grips: needs 2 entries, on opposite edges, not {len(scene.grips)}; for other supports"
            " use prescribed"
        )
    pairs = [FACES[axis : axis + 2] for axis in range(0, 2 * scene.dimension, 2)]
    if {grip.edge for grip in scene.grips} not in map(set, pairs):
        raise ValueError(
            "grips: must hold two opposite edges,"
            f" {' or '.join(' and '.join(pair) for pair in pairs)}"
        )
    travel = sum(grip.travel for grip in scene.grips)
    if not math.isclose(travel, 1.0):
        raise ValueError(f"grips: the travel of the two grips must add up to 1, not {travel:g}")
    if not scene.stretches and scene.dynamics is None:
        raise ValueError("grips: need stretches or dynamics")
    if scene.dynamics is not None and scene.dynamics.stretch <= (
        scene.stretches[-1] if scene.stretches else 1.0
    ):
        raise ValueError(
            "dynamics.stretch: must be greater than the last entry of stretches, where the dynamics"
            " start"
        )


def _program(scene: SceneData) -> None:
    if scene.times:
        if len(scene.times) != len(scene.stretches):
            raise ValueError(
                f"times: needs one time for each of the {len(scene.stretches)} stretches, not"
                f" {len(scene.times)}"
            )
        if any(later < earlier for earlier, later in pairwise(scene.times)):
            raise ValueError("times: no time may be before the one of an earlier stretch")
    if scene.reference and scene.remembers:
        raise ValueError(
            f"reference: {scene.reference} is a solution for elastic materials: leave it out, or"
            " the branches and softening"
        )
    still = [entry for entry in entries_of(scene, "steps") if entry[1].dynamics is None]
    timeless = [key for key, step in still if step.duration is None]
    if timeless and len(timeless) < len(still):
        raise ValueError(
            f"{timeless[0]}.duration: missing; other steps in equilibrium have one, and the time of"
            " their outputs needs all"
        )
    begin = 0.0
    before = None
    for key, step in entries_of(scene, "steps"):
        if step.control != before:
            begin = 0.0
            before = step.control
        if (
            step.largest_increment is not None
            and abs(step.to - begin) > MOST_INCREMENTS * step.largest_increment
        ):
            what = "t" if step.control is None else step.control
            raise ValueError(
                f"{key}.largest_increment: {step.largest_increment:g} would need more than"
                f" {MOST_INCREMENTS:,} increments from {what} = {begin:g} to {step.to:g}"
            )
        begin = step.to


def names_of_materials(scene: SceneData) -> list[str]:
    """Return the name of the material of the rest of the body, ``"rest"``, then those of the
    entries of `materials`.
    """
    return [
        "rest",
        *(label_of_region(part.region, key) for key, part in entries_of(scene, "materials")),
    ]


def criteria_of(scene: SceneData) -> dict[str, Criterion]:
    """Return the criteria of fracture of a scene by their keys."""
    if scene.fracture is None:
        return {}
    return {
        "fracture": scene.fracture,
        **{
            f"fracture.interfaces.{number}": one
            for number, one in enumerate(scene.fracture.interfaces)
        },
        **{
            f"{key}.fracture": part.fracture
            for key, part in entries_of(scene, "materials")
            if part.fracture is not None
        },
    }


def criteria_give(scene: SceneData, key: str) -> bool:
    """Return whether a scene gives the "energy" or "strength" of a material or an interface."""
    return any(getattr(one, key) is not None for one in criteria_of(scene).values())


def _moves(scene: SceneData) -> bool:
    return scene.dynamics is not None or any(step.dynamics for step in scene.steps)


def tears_slowly(scene: SceneData) -> bool:
    """Return whether the bonds of a scene break in equilibrium (`Fracture.process`)."""
    given = scene.fracture
    return given is not None and (
        not _moves(scene) if given.process is None else given.process == "quasi-static"
    )


def _fracture(scene: SceneData) -> None:
    """Raise ValueError if fracture has no dynamics, no effective diameter of a crack tip, or an
    interface of unknown materials.
    """
    if scene.fracture is None:
        own = next(
            (key for key, part in entries_of(scene, "materials") if part.fracture is not None), None
        )
        if own:
            raise ValueError(
                f"{own}.fracture: needs fracture, the critical stretch or the energy of the rest of"
                " the body"
            )
        return
    if scene.fracture.process == "dynamics" and not _moves(scene):
        where = "a step with dynamics" if scene.steps else "dynamics"
        raise ValueError(
            f'fracture.process: needs {where}, or process = "quasi-static" for a slow tear'
        )
    if rigid := _first_rigid(scene):
        raise ValueError(f"{rigid}: rigid regions cannot be part of a scene with fracture")
    names = names_of_materials(scene)
    given = set()
    for number, interface in enumerate(scene.fracture.interfaces):
        key = f"fracture.interfaces.{number}.between"
        between = frozenset(interface.between)
        for name in interface.between:
            if names.count(name) != 1:
                known = "two materials have this name" if name in names else suggestion(name, names)
                raise ValueError(f"{key}: there is no single material {name!r}; {known}")
        if len(between) == 1:
            raise ValueError(
                f"{key}: an interface lies between two materials, not within"
                f" {interface.between[0]!r}"
            )
        if between in given:
            raise ValueError(
                f"{key}: the interface between {' and '.join(interface.between)} has two entries;"
                " leave one out"
            )
        given.add(between)
    if criteria_give(scene, "energy"):
        tip_diameters_in(scene)  # for which force model, a run checks


def _control(scene: SceneData) -> None:
    """Raise ValueError if a step controls a displacement of which t cannot be found, or that no
    probe has.
    """
    controlled = [
        (f"{key}.control", step.control)
        for key, step in entries_of(scene, "steps")
        if step.control is not None
    ]
    for key, control in controlled:
        name, component = controlled_place(control)
        names = [probe.name for probe in scene.probes]
        if name not in names:
            raise ValueError(
                f"{key}: there is no probe {name!r};"
                f" {suggestion(name, names) if names else 'add one to probes'}"
            )
        if component >= scene.dimension:
            raise ValueError(
                f"{key}: components of a displacement count from 0, so that {scene.dimension - 1}"
                " is the last one here"
            )
        if not scene.loads:
            raise ValueError(f"{key}: needs loads, of which the step finds the factor t")
        for other, load in entries_of(scene, "loads"):
            if load.amplitude != "ramp":
                raise ValueError(
                    f"{key}: the step finds the factor of the loads, which must be proportional to"
                    f" t: remove {other}.amplitude"
                )
        for other, entry in entries_of(scene, "prescribed"):
            if any(entry.displacement) or entry.rotation:
                raise ValueError(
                    f"{key}: the step finds the factor of the loads alone, but {other} moves with"
                    " t: prescribe 0 there"
                )
        if scene.obstacles:
            raise ValueError(f"{key}: a body with obstacles cannot be controlled by a displacement")
        if any(step.dynamics is not None for step in scene.steps):
            raise ValueError(
                f"{key}: no step of the scene may be in dynamics, whose motion needs the t at which"
                " it begins"
            )
        if scene.fracture is not None:
            raise ValueError(f"{key}: a scene with fracture cannot be controlled by a displacement")
        if rigid := _first_rigid(scene):
            raise ValueError(
                f"{key}: a body with a rigid region ({rigid}) cannot be controlled by a"
                " displacement"
            )


def _thickness(scene: SceneData) -> None:
    for key, load in entries_of(scene, "loads"):
        if scene.plane != "stress" and load.thickness is not None:
            why = (
                "a solid has none"
                if scene.dimension == 3
                else "under plane strain the thickness does not change"
            )
            raise ValueError(f"{key}.thickness: {why}; leave it out")


def _amplitudes(scene: SceneData) -> None:
    """Raise ValueError if an amplitude of a scene has no value at the end of a step; a run
    checks the values within steps itself.
    """
    for key, entry in entries_of(scene, "prescribed", "loads", "obstacles"):
        try:
            for step in scene.steps:
                if step.control is None:
                    amplitude_of(entry.amplitude)(step.to)
        except ValueError as error:
            raise ValueError(f"{key}.amplitude: {error}") from None


def _probes(scene: SceneData) -> None:
    names = [probe.name for probe in scene.probes]
    if twice := [name for name in names if names.count(name) > 1]:
        raise ValueError(f"probes: the name {twice[0]!r} is used twice")
