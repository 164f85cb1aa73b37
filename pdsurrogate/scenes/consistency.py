"""Checks that the parts of a scene fit together; every check raises ValueError with the key of
the wrong part.
"""

from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter

from ..arguments import suggestion
from .loading_checks import check_loading
from .model import SceneData, entries_of
from .obstacles import Obstacle
from .regions import FACES, Region, edge_names, references_in, reserved_names
from .shapes import Mesh
from .solids import Extrusion, Prism
from .strict_model import vectors_in


def check_consistency(scene: SceneData) -> None:
    """Raise ValueError if the parts of a scene, each valid alone, do not fit together, such as a
    shape of the plane in a solid body.
    """
    for check in (_spacing, _arrangement, _dimension, check_loading, _regions):
        check(scene)


def _references(scene: SceneData) -> Iterator[tuple[str, str | Region]]:
    """Yield pairs of a dotted key, such as ``loads.0.region``, and the region, or name of a
    region, that a scene refers to there.
    """
    for name, region in scene.regions.items():
        yield from references_in(f"regions.{name}", region)
    for key, entry in entries_of(scene, "prescribed", "loads", "materials"):
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
    shapes = [*entries_of(scene, "holes")]
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
    dimension = scene.dimension
    body = scene.body.shape
    here, there = ("3D", "2D") if dimension == 3 else ("2D", "3D")
    if (scene.plane == "space") != (dimension == 3):
        taken = "space, which is also the default" if dimension == 3 else "stress or strain"
        raise ValueError(
            f"plane: must be {taken}, not {scene.plane}: the body, a {body}, is {here}"
        )
    for key, part in entries_of(scene, "holes", "precuts"):
        if part.dimension != dimension:
            what = f"a {part.shape}" if key.startswith("holes") else "this cut"
            raise ValueError(f"{key}: {what} is {there}, but the body, a {body}, is {here}")
    for key, holder in [*entries_of(scene, "obstacles"), *_references(scene)]:
        for shape, meant in Obstacle.shapes.items():
            if meant != dimension and getattr(holder, shape, None) is not None:
                known = type(holder).model_fields
                others = [one for one in known if Obstacle.shapes.get(one) == dimension]
                raise ValueError(
                    f"{key}.{shape}: this shape is {there}, but the body, a {body}, is {here}; use"
                    f" {' or '.join(others)}"
                )
    for key, entry in entries_of(scene, "prescribed"):
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
    for key, entry in entries_of(scene, "prescribed", "obstacles"):
        yield from (
            (f"{key}.{name}", name)
            for name in ("x3", "axis")
            if getattr(entry, name, None) is not None
        )
    for key, hold in entries_of(scene, "holds"):
        yield from ((f"{key}.components", name) for name in hold.components or () if name == "x3")
    edges = [
        *((f"{key}.edge", grip) for key, grip in entries_of(scene, "grips")),
        *_references(scene),
    ]
    yield from (
        (key, holder.edge) for key, holder in edges if getattr(holder, "edge", None) in FACES[4:]
    )


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
