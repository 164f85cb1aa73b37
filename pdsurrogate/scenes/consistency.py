"""Checks that the parts of a scene fit together; every check raises ValueError with the key of
the wrong part.
"""

import math
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from typing import Any

from ..arguments import suggestion
from .amplitudes import amplitude_of
from .loading import controlled_place
from .model import SceneData
from .obstacles import Obstacle
from .regions import FACES, Region, edge_names, label_of_region, references_in, reserved_names
from .shapes import Mesh
from .solids import Extrusion, Prism
from .strict_model import vectors_in
from .tip_diameter import tip_diameters_in

MOST_INCREMENTS = 100_000
"""Greatest number of increments of a step; more would run for days on the smallest body."""


def check_consistency(scene: SceneData) -> None:
    """Raise ValueError if the parts of a scene, each valid alone, do not fit together, such as a
    shape of the plane in a solid body.
    """
    of_body = _spacing, _arrangement, _dimension
    of_loading = (
        _way_of_loading,
        _rigid_regions,
        _grips,
        _program,
        _control,
        _fracture,
        _thickness,
        _amplitudes,
    )
    for check in (*of_body, *of_loading, _probes, _regions):
        check(scene)


def _entries(scene: SceneData, *keys: str) -> Iterator[tuple[str, Any]]:
    """Yield each entry of the lists `keys` of a scene, preceded by its dotted key, such as
    ``loads.0``.
    """
    for key in keys:
        yield from ((f"{key}.{number}", entry) for number, entry in enumerate(getattr(scene, key)))


def _references(scene: SceneData) -> Iterator[tuple[str, str | Region]]:
    """Yield pairs of a dotted key, such as ``loads.0.region``, and the region, or name of a
    region, that a scene refers to there.
    """
    for name, region in scene.regions.items():
        yield from references_in(f"regions.{name}", region)
    for key, entry in _entries(scene, "prescribed", "loads", "materials"):
        yield from references_in(f"{key}.region", entry.region)


def _spacing(scene: SceneData) -> None:
    if scene.spacing is None and not isinstance(scene.body, Mesh):
        raise ValueError(
            "spacing: must be a number, unless the body is a mesh, which has its own spacing"
        )


def _arrangement(scene: SceneData) -> None:
    """Raise ValueError if the lattice has a seed, or a shape that is no body an arrangement."""
    if isinstance(scene.body, Mesh):
        return
    if scene.body.arrangement == "lattice" and scene.body.seed:
        raise ValueError(
            f"body.seed: a lattice has no seed, {scene.body.seed} is for body.arrangement ="
            " 'relaxed'; leave it out"
        )
    shapes = [*_entries(scene, "holes")]
    if isinstance(scene.body, Extrusion):
        shapes += [
            ("body.outline", scene.body.outline),
            *((f"body.holes.{number}", hole) for number, hole in enumerate(scene.body.holes)),
        ]
    for key, shape in shapes:
        if shape.arrangement != "lattice" or shape.seed:
            raise ValueError(
                f"{key}: only the body has an arrangement and a seed of its points; leave them out"
            )


def _dimension(scene: SceneData) -> None:
    """Raise ValueError if a part of a scene belongs to the plane and the body is a solid, or the
    other way round.
    """
    dimension, body = scene.dimension, scene.body.shape
    here, there = ("3D", "2D") if dimension == 3 else ("2D", "3D")
    if (scene.plane == "space") != (dimension == 3):
        taken = "space, which is also the default" if dimension == 3 else "stress or strain"
        raise ValueError(
            f"plane: must be {taken}, not {scene.plane}: the body, a {body}, is {here}"
        )
    for key, part in _entries(scene, "holes", "precuts"):
        if part.dimension != dimension:
            what = f"a {part.shape}" if key.startswith("holes") else "this cut"
            raise ValueError(f"{key}: {what} is {there}, but the body, a {body}, is {here}")
    for key, holder in [*_entries(scene, "obstacles"), *_references(scene)]:
        for shape, meant in Obstacle.shapes.items():
            if meant != dimension and getattr(holder, shape, None) is not None:
                known = type(holder).model_fields
                others = [one for one in known if Obstacle.shapes.get(one) == dimension]
                raise ValueError(
                    f"{key}.{shape}: this shape is {there}, but the body, a {body}, is {here}; use"
                    f" {' or '.join(others)}"
                )
    for key, entry in _entries(scene, "prescribed"):
        if dimension == 3 and entry.rotation is not None and entry.axis is None:
            raise ValueError(
                f"{key}.axis: a rotation of a solid needs the direction of its axis, such as"
                " axis=[1, 0, 0]"
            )
    for key, name in _of_solids_alone(scene) if dimension == 2 else ():
        others = (
            f"x1, x2 and the edges {', '.join(edge_names(2))}" if name in FACES else "x1 and x2"
        )
        raise ValueError(f"{key}: a 2D body has no {name}, only {others}")
    for key, vector in vectors_in(scene):
        if len(vector) != dimension:
            raise ValueError(
                f"{key}: needs {dimension} components for a {here} body, not {len(vector)}"
            )


def _of_solids_alone(scene: SceneData) -> Iterator[tuple[str, str]]:
    """Yield the name of each component, axis or face in a scene that only solids have, preceded
    by its dotted key.
    """
    for key, entry in _entries(scene, "prescribed", "obstacles"):
        yield from (
            (f"{key}.{name}", name)
            for name in ("x3", "axis")
            if getattr(entry, name, None) is not None
        )
    for key, hold in _entries(scene, "holds"):
        yield from ((f"{key}.components", name) for name in hold.components or () if name == "x3")
    edges = [
        *((f"{key}.edge", grip) for key, grip in _entries(scene, "grips")),
        *_references(scene),
    ]
    yield from (
        (key, holder.edge) for key, holder in edges if getattr(holder, "edge", None) in FACES[4:]
    )


def _way_of_loading(scene: SceneData) -> None:
    general = [key for key in ("prescribed", "loads", "obstacles", "steps") if getattr(scene, key)]
    short = [key for key in ("grips", "stretches", "holds", "dynamics") if getattr(scene, key)]
    if general and short:
        ways = (
            "use grips and stretches (with holds and dynamics), or prescribed, loads and obstacles"
            " with steps (with dynamics in a step)"
        )
        raise ValueError(
            f"{short[0]} and {general[0]} belong to two different ways to define the loading:"
            f" {ways}"
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


def _rigid_regions(scene: SceneData) -> None:
    if scene.material is not None and scene.material.rigid:
        raise ValueError("material: cannot be rigid; define rigid regions as entries of materials")
    rigid = next((key for key, part in _entries(scene, "materials") if part.material.rigid), None)
    moving = next(
        (key for key, step in _entries(scene, "steps") if step.dynamics is not None), None
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
    begin, before = 0.0, None
    for key, step in _entries(scene, "steps"):
        if step.control != before:
            begin, before = 0.0, step.control
        if (
            step.largest_increment is not None
            and abs(step.to - begin) > MOST_INCREMENTS * step.largest_increment
        ):
            what = "t" if step.control is None else step.control
            most = (
                f"{step.largest_increment:g} would need more than {MOST_INCREMENTS:,} increments"
                f" from {what} = {begin:g} to {step.to:g}"
            )
            raise ValueError(f"{key}.largest_increment: {most}")
        begin = step.to


def names_of_materials(scene: SceneData) -> list[str]:
    """Return the name of the material of the rest of the body, ``"rest"``, then those of the
    entries of `materials`.
    """
    return [
        "rest",
        *(label_of_region(part.region, key) for key, part in _entries(scene, "materials")),
    ]


def gives_fracture_energy(scene: SceneData) -> bool:
    """Return whether a scene gives the fracture energy of a material or an interface."""
    criteria = (
        []
        if scene.fracture is None
        else [
            scene.fracture,
            *scene.fracture.interfaces,
            *(part.fracture for part in scene.materials),
        ]
    )
    return any(one is not None and one.energy is not None for one in criteria)


def _fracture(scene: SceneData) -> None:
    """Raise ValueError if fracture has no dynamics, no effective diameter of a crack tip, or an
    interface of unknown materials.
    """
    if scene.fracture is None:
        own = next(
            (key for key, part in _entries(scene, "materials") if part.fracture is not None), None
        )
        if own:
            raise ValueError(
                f"{own}.fracture: needs fracture, the critical stretch or the energy of the rest of"
                " the body"
            )
        return
    if scene.dynamics is None and not any(step.dynamics for step in scene.steps):
        where = "a step with dynamics" if scene.steps else "dynamics"
        raise ValueError(f"fracture: needs {where}, since a running crack is not in equilibrium")
    names, given = names_of_materials(scene), set()
    for number, interface in enumerate(scene.fracture.interfaces):
        key, between = f"fracture.interfaces.{number}.between", frozenset(interface.between)
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
    if gives_fracture_energy(scene):
        tip_diameters_in(scene)  # for which force model, a run checks


def _control(scene: SceneData) -> None:
    """Raise ValueError if a step controls a displacement of which t cannot be found, or that no
    probe has.
    """
    controlled = [
        (f"{key}.control", step.control)
        for key, step in _entries(scene, "steps")
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
        for other, load in _entries(scene, "loads"):
            if load.amplitude != "ramp":
                raise ValueError(
                    f"{key}: the step finds the factor of the loads, which must be proportional to"
                    f" t: remove {other}.amplitude"
                )
        for other, entry in _entries(scene, "prescribed"):
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
        if rigid := next(
            (other for other, part in _entries(scene, "materials") if part.material.rigid), None
        ):
            raise ValueError(
                f"{key}: a body with a rigid region ({rigid}) cannot be controlled by a"
                " displacement"
            )


def _thickness(scene: SceneData) -> None:
    for key, load in _entries(scene, "loads"):
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
    for key, entry in _entries(scene, "prescribed", "loads", "obstacles"):
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


def _regions(scene: SceneData) -> None:
    """Raise ValueError if a scene refers to a region that does not exist, or a region refers to
    itself, directly or through others.
    """
    reserved = reserved_names(scene.dimension)
    for key, reference in _references(scene):
        if not isinstance(reference, str):
            continue
        if reference == "holes" or reference.startswith("holes."):
            _check_hole(scene, key, reference)
        elif reference not in (*reserved, *scene.regions):
            raise ValueError(
                f"{key}: there is no region {reference!r};"
                f" {suggestion(reference, [*scene.regions, *reserved])}"
            )
    defined_by = {
        name: [part for _, part in references_in("", region) if isinstance(part, str)]
        for name, region in scene.regions.items()
    }
    try:
        TopologicalSorter(defined_by).prepare()
    except CycleError as error:
        circle = error.args[1][::-1]
        raise ValueError(
            f"regions.{circle[0]}: the region refers to itself: {' -> '.join(circle)}"
        ) from None


def _check_hole(scene: SceneData, key: str, name: str) -> None:
    """Raise ValueError if a region such as ``holes.0`` names a hole that the body does not have;
    skip meshes, which are read later.
    """
    if isinstance(scene.body, Mesh):
        return
    # The bores of a tube and the holes of an extrusion are numbered after the scene's own.
    count = len(scene.holes) + (
        len(scene.body.straight.bores) if isinstance(scene.body, Prism) else 0
    )
    names = [*(f"holes.{number}" for number in range(count)), "holes"]
    if not count or name not in names:
        there = f"there are {', '.join(names)}" if count else "the body has no holes"
        raise ValueError(f"{key}: there is no region {name!r}; {there}")
