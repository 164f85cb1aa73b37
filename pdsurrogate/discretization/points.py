"""Discretization of the body of a scene: its points with volumes, and the bonds that precuts and
empty space cut.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..body import Body, CellMesh, Cells, Round
from ..body.cloud_cells import cubes, voronoi_cells
from ..scenes import Mesh, Scene, SceneError
from .cells import material_of_cells, raster_of
from .clouds import nearest_volumes, relaxed_points
from .interfaces import divided_volumes, round_interfaces, sides_of
from .material import inside, material_at, points_in_material
from .mesh_cells import sizes_of
from .meshes import faces_of_groups, mesh_of
from .planes import held_boundaries, reflection_planes
from .separation import check_precuts, cuts_of, separation

if TYPE_CHECKING:
    import shapely

STATED = 0.01
"""Relative difference between the spacing that a scene states and that of its mesh, above which
there is a warning. Chosen: the spacing of a mesh is a mean over its cells, which nobody states to
better than a percent.
"""


def discretize(
    scene: Scene,
    part_of: Callable[[Body], Body] | None = None,
    curves: bool = True,
    interfaces: bool = True,
) -> tuple[Body, np.ndarray, np.ndarray]:
    """Return the body of a scene: points outside holes, mirrored points beyond held edges, and no
    bonds across precuts or empty space.

    Parameters
    ----------
    scene : Scene
    part_of : callable, optional
        ``part_of(body)`` returns the wanted part of the whole body, such as that of one rank; bonds
        are made for this part only.
    curves : bool
        Whether mirrored points hold boundaries of any shape; otherwise they hold edges alone.
    interfaces : bool
        Whether round interfaces between materials divide cells; otherwise each cell is of the
        material of its point.

    Returns
    -------
    body : Body
    lower, upper : ndarray, shape (d,)
        Corners of its bounding box, holes not considered.

    Raises
    ------
    SceneError
        If the spacing does not fit the body, the holes leave nothing of it, or a hole or precut
        misses it.
    """
    try:
        given, lower, upper = _of_mesh(scene) if isinstance(scene.body, Mesh) else _of_shapes(scene)
        faces = faces_of_groups(scene, lower, upper)
        planes = *held_boundaries(scene, curves), *reflection_planes(scene, lower, upper, faces)
        # Measured by the smaller side, a horizon takes in the same neighbors as with squares where
        # the sides differ by little: by the mean or the larger one some at a distance of (3, 1)
        # cells come in along one direction alone, and errors in pure shear are half as large again.
        horizon = scene.horizon_ratio * min(given["spacing"], *given["cell"])
        cuts = cuts_of(scene, lower, upper, between=True, planes=planes)
        rounds = round_interfaces(scene) if interfaces else ()
        dividing = [each for each in rounds if each.divides(horizon)]
        if dividing and not isinstance(scene.body, Mesh):
            given["volumes"] = _volumes_by_side(scene, given, dividing)
        body = Body(
            **given,
            horizon=horizon,
            weight=scene.weight,
            planes=planes,
            separates=separation(scene, cuts, horizon, np.array(given["cell"]), lower, upper),
            faces=faces,
            rounds=rounds,
            loaded=bool(scene.obstacles)
            or any(load.kind in ("traction", "pressure") for load in scene.loads),
        )
        if part_of is not None:
            body = part_of(body)
        check_precuts(scene, body, cuts)
        return body, lower, upper
    except ValueError as error:
        raise SceneError(f"scene {scene.name}: {error}") from None


def _of_mesh(scene: Scene) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """Return arguments of `Body` for the points of a mesh, and the corners of its bounding box."""
    mesh = mesh_of(scene.body)
    blocks = mesh.corners()
    corners = np.concatenate([block.reshape(-1, scene.dimension) for block in blocks])
    points, volumes = mesh.centroids
    # Its cells have any shape: those whose centroid lies in a hole are left out whole.
    kept = points_in_material(scene, points)
    number = np.cumsum(kept) - 1
    spacing, cell = sizes_of(blocks, kept, volumes)
    if scene.spacing is not None and abs(scene.spacing - spacing) > STATED * spacing:
        warnings.warn(
            f"scene {scene.name}: spacing: ignored, as the mesh has a spacing of {spacing:.4g};"
            " leave it out",
            stacklevel=5,
        )
    groups = mesh.groups_of_cells().items()
    given = {
        "points": points[kept],
        "volumes": volumes[kept],
        "spacing": spacing,
        "cell": (cell,) * scene.dimension,
        "groups": {name: number[members[kept[members]]] for name, members in groups},
        "mesh_cells": CellMesh.of_mesh(mesh.cells.nodes, mesh.cells.blocks, kept),
    }
    return given, corners.min(axis=0), corners.max(axis=0)


def _of_shapes(scene: Scene) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """Return arguments of `Body` for the points of a lattice or cloud, and the corners of the
    bounding box.
    """
    lower, upper = scene.body.bounds()
    material = partial(material_at, scene)
    lattice = scene.body.arrangement == "lattice"
    cells = (Cells.filling if lattice else Cells.near)(lower, upper, scene.spacing)
    points_in_material(scene, cells.centers())
    if lattice:
        points, volumes = material_of_cells(cells, material)
        spacing = cells.spacing
        sides = cells.sides
        follow = {"inside": partial(inside, scene) if np.ptp(volumes) else None}
    else:
        sheet = None if scene.dimension == 3 else _sheet(scene)
        points, volumes = relaxed_points(cells, material, scene.spacing, scene.body.seed)
        volumes = volumes if sheet is None else volumes * (sheet.area / volumes.sum())
        spacing = float(volumes.mean() ** (1 / scene.dimension))
        sides = (spacing,) * scene.dimension
        follow = {"tessellate": cubes if sheet is None else partial(voronoi_cells, sheet)}
    given = {"points": points, "volumes": volumes, "spacing": spacing, "cell": sides, **follow}
    return given, lower, upper


def _sheet(scene: Scene) -> shapely.Geometry:
    """Return the region that the body of a scene without a mesh fills in the plane, of exact
    area.
    """
    import shapely  # here, because few bodies need it

    outline, *holes = (
        shapely.polygons(shape.boundary(np.full(2, scene.spacing)))
        for shape in (scene.body, *scene.holes)
    )
    return shapely.difference(outline, shapely.union_all(holes))


def _volumes_by_side(scene: Scene, given: dict[str, Any], rounds: Sequence[Round]) -> np.ndarray:
    """Return volumes of the points of a lattice or cloud so that the points on each side of round
    interfaces have its whole volume.

    In a cloud, whose total volume does not change, a place belongs to the nearest of the points on
    its own side.
    """
    points = given["points"]
    volumes = given["volumes"]
    if scene.body.arrangement == "lattice":
        raster = raster_of(scene.dimension)
        return divided_volumes(points, volumes, np.array(given["cell"]), raster, rounds)
    cells = Cells.near(*scene.body.bounds(), scene.spacing)
    own = sides_of(points, rounds)
    found = np.empty(len(points))
    for side in np.unique(own):

        def part(places: np.ndarray, side: int = side) -> np.ndarray:
            return material_at(scene, places) & (sides_of(places, rounds) == side)

        found[own == side] = nearest_volumes(cells, part, points[own == side])
    return found * (volumes.sum() / found.sum())
