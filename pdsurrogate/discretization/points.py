"""Discretization of the body of a scene: its points with volumes, and the bonds that precuts and
empty space cut.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ..body import Body, CellMesh, Cells, Mirror, ReflectionPlane, Round
from ..body.cloud_cells import cubes, voronoi_cells
from ..body.local_fit import REACH
from ..scenes import Box, Circle, Ellipse, Mesh, Rectangle, Scene, SceneError, Sphere
from ..scenes.model import EDGES
from ..scenes.regions import edge_names
from ..scenes.solids import Prism
from .chains import ROUNDING
from .clouds import nearest_volumes, relaxed_points
from .cuts import Cuts, between_cells
from .interfaces import TIED, divided_volumes, round_interfaces, sides_of
from .meshes import Sides, mesh_of
from .planes import held_boundaries, reflected_edges, reflection_planes

if TYPE_CHECKING:
    import shapely

RASTER = 16
"""Number of sampled places along each side of a cell in the plane, which determine the area of
its material to some 1/1000 of a cell.
"""

SCATTERED = 128
"""Number of sampled places in one eighth of a 3D cell, with mirror images in the others. No two in
an eighth have equal coordinates along an axis: the volume on one side of a plane normal to an axis
is found to within 1/40 of a cell.
"""

WITHIN = 1 - 1e-6
"""Share of the way from the middle of a 3D cell to its corners, edges and faces at which material
is tested: a little inside, so that a boundary between two cells cuts neither.
"""

CLEARANCE = 0.4
"""Distance without material, in cells in every direction, that makes a place on a bond empty. Bonds
next to a round hole with a radius above some three cells leave the material by less and remain.
"""

STEP = 0.15
"""Greatest distance, in cells, between neighboring tested places on a bond. In a gap of one cell
the places with `CLEARANCE` to both sides extend over 0.2 cells, so that at least one of them is
tested.
"""

ROOT_OF_CUBES = 1.2207440846057596
"""Root g of g^4 = g + 1: multiples of its first three inverse powers fill a cube evenly (the
sequence of which the plastic number is the member for a square).
"""

MOST_PLACES = 1_000_000
"""Number of places on bonds, or in cells, tested together. Chosen: in three dimensions their
coordinates take 24 MB; larger numbers only take more memory.
"""

STRIPS = 1e-9
"""Change of the integral over an interval, relative to the whole integral, below which `_integral`
does not halve the interval further; it integrates the area of a plane section of a solid. Chosen
above rounding, and far below 1e-6, by which the areas of two grips are told apart.
"""

CUT_SHIFT = 1e-6
"""Distance, in extents of the body, from a grip's plane to the cut that determines its area, and
from a plane of reflection within which a precut ends at or lies in it: more than the rounding of
single precision.
"""

IN_LINE = 1e-3
"""Distance, in spacings, below which two cuts count as lying in one line or plane."""

STATED = 0.01
"""Relative difference between the spacing that a scene states and that of its mesh, above which
there is a warning. Chosen: the spacing of a mesh is a mean over its cells, which nobody states to
better than a percent.
"""

PARTS = {(2, 3): 2, (3, 4): 6}
"""Number of cells that make up a square or cube, by dimension and number of corners of a cell."""


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
        points, volumes, spacing, cell, lower, upper, groups, mesh_cells = _points_of(scene)
        faces = faces_of_groups(scene, lower, upper)
        planes = *held_boundaries(scene, curves), *reflection_planes(scene, lower, upper, faces)
        # Measured by the smaller side, a horizon takes in the same neighbors as with squares where
        # the sides differ by little: by the mean or the larger one some at a distance of (3, 1)
        # cells come in along one direction alone, and errors in pure shear are half as large again.
        horizon = scene.horizon_ratio * (spacing if isinstance(scene.body, Mesh) else min(cell))
        precuts = cuts_of(scene, lower, upper, between=True, planes=planes)
        cuts = _cuts(scene, precuts, horizon, np.array(cell), lower, upper)
        lattice = not isinstance(scene.body, Mesh) and scene.body.arrangement == "lattice"
        inside, rounds = (
            partial(_inside, scene) if lattice and np.ptp(volumes) else None,
            (round_interfaces(scene) if interfaces else ()),
        )
        tessellate = None if lattice or isinstance(scene.body, Mesh) else _cells_around(scene)
        dividing = (
            []
            if isinstance(scene.body, Mesh)
            else [each for each in rounds if each.divides(horizon)]
        )
        if dividing and not lattice:
            volumes = _volumes_by_side(scene, points, volumes, dividing)
        elif dividing:
            volumes = divided_volumes(
                points, volumes, np.array(cell), _places_in_a_cell(scene.dimension)[1], dividing
            )
        of_mesh = groups, mesh_cells, faces
        body = Body(
            points,
            volumes,
            horizon,
            spacing,
            scene.weight,
            planes,
            cuts,
            cell,
            *of_mesh,
            inside,
            tessellate,
            rounds,
        )
        if part_of is not None:
            body = part_of(body)
        _check_precuts(scene, body, precuts)
        return body, lower, upper
    except ValueError as error:
        raise SceneError(f"scene {scene.name}: {error}") from None


def grip_areas(scene: Scene, lower: np.ndarray, upper: np.ndarray) -> dict[str, float]:
    """Return the cross-sectional area of the body at every grip or reflected edge, by the name of
    the edge, in 2D at unit thickness.

    Parameters
    ----------
    scene : Scene
    lower, upper : ndarray, shape (d,)
        Corners of the bounding box of the body.

    Raises
    ------
    SceneError
        If the body has no straight edge or flat face at such an end, or no material there.
    """
    areas, faces = {}, faces_of_groups(scene, lower, upper)
    sides = _outer_sides(scene)[2] if isinstance(scene.body, Mesh) else None
    for edge in [grip.edge for grip in scene.grips] or reflected_edges(scene, faces):
        if sides is not None:
            areas[edge], near = _area_of_sides(sides[_on_edge(sides, edge, lower, upper)]), 0.0
        else:
            axis, side = EDGES[edge]
            shifts = side * CUT_SHIFT * (upper - lower).max() * np.array([1, 2])
            near, far = (
                _section_inside(scene, axis, (lower, upper)[side > 0][axis] - shift, lower, upper)
                for shift in shifts
            )
            # Linear in the distance below a straight edge; below a round or a pointed end all of it
            # is due to the distance.
            areas[edge] = 2 * near - far
        if not areas[edge] > 0.9 * near:
            key = "grips" if scene.grips else "prescribed"
            raise SceneError(
                f"scene {scene.name}: {key}: the body has no straight edge with material at its"
                f" {edge} end that could be held"
            )
    return areas


def _section_inside(
    scene: Scene, axis: int, position: float, lower: np.ndarray, upper: np.ndarray
) -> float:
    """Return the area (length in the plane) of material on the section of a body where
    coordinate `axis` equals `position`.
    """
    others = [other for other in range(scene.dimension) if other != axis]
    if isinstance(scene.body, Rectangle | Box) and not scene.holes:
        return float(np.prod((upper - lower)[others]))
    low, high = lower[others[0]], upper[others[0]]
    count = int(np.ceil(RASTER * (high - low) / scene.spacing))
    # A round body may end between the last place of the raster and the end of its box.
    asked = np.concatenate([[low], low + (high - low) * (np.arange(count) + 0.5) / count, [high]])

    def inside(along: np.ndarray, strips: np.ndarray) -> np.ndarray:
        places = np.empty((len(along), scene.dimension))
        places[:, axis], places[:, others[0]], places[:, others[1:]] = position, along, strips
        return material_at(scene, places)

    def lengths(strips: np.ndarray) -> np.ndarray:
        """Return the length of material on each of several parallel lines in the section, shape
        (lines,).

        Each row of `strips` holds the third coordinate of a line; in the plane, where there is one
        line, the row is empty.
        """
        there = inside(np.tile(asked, len(strips)), np.repeat(strips, len(asked), axis=0)).reshape(
            len(strips), -1
        )
        line, ends = np.nonzero(there[:, 1:] != there[:, :-1])
        starts, stops, before = asked[ends], asked[ends + 1], there[line, ends]
        for _ in range(50):  # bisection, to rounding
            halves = (starts + stops) / 2
            same = inside(halves, strips[line]) == before
            starts, stops = np.where(same, halves, starts), np.where(same, stops, halves)
        found = np.bincount(line, np.where(before, stops, -stops), len(strips))
        return found + np.where(there[:, -1], high, 0) - np.where(there[:, 0], low, 0)

    if scene.dimension == 2:
        return float(lengths(np.zeros((1, 0)))[0])
    return _integral(lambda strips: lengths(strips[:, None]), lower[others[1]], upper[others[1]])


def _integral(values, low: float, high: float) -> float:
    """Integrate the function `values`, which may have kinks and steps, from `low` to `high`.

    Intervals are halved until their integrals by the four-place Lobatto rule change by at most
    `STRIPS` of the whole.
    """
    places, weights = np.array([-1, -(0.2**0.5), 0.2**0.5, 1]), np.array([1, 5, 5, 1]) / 6

    def sums(starts: np.ndarray, widths: np.ndarray) -> np.ndarray:
        at = starts[:, None] + widths[:, None] * (places + 1) / 2
        return values(at.ravel()).reshape(at.shape) @ weights * widths / 2

    # Sixteen parts find every step that is wider than one of them; forty halvings reach rounding.
    starts, widths = low + (high - low) / 16 * np.arange(16), np.full(16, (high - low) / 16)
    whole, total = sums(starts, widths), 0.0
    least = STRIPS * np.abs(whole).sum()
    for _ in range(40):
        widths = np.repeat(widths / 2, 2)
        starts = np.repeat(starts, 2)
        starts[1::2] += widths[1::2]
        halves = sums(starts, widths)
        settled = np.abs(halves.reshape(-1, 2).sum(axis=1) - whole) <= least
        total += halves.reshape(-1, 2)[settled].sum()
        left = np.repeat(~settled, 2)
        starts, widths, whole = starts[left], widths[left], halves[left]
        if not len(whole):
            break
    return float(total + whole.sum())


def _points_of(scene: Scene):
    """Return the points and volumes of a scene's body, its spacing, cell sides, lower and upper
    corner, point groups, and mesh cells.
    """
    if isinstance(scene.body, Mesh):
        mesh = mesh_of(scene.body)
        cells = mesh.corners()
        corners = np.concatenate([block.reshape(-1, scene.dimension) for block in cells])
        points, volumes = mesh.centroids()
        # Its cells have any shape: those whose centroid lies in a hole are left out whole.
        kept = _in_material(scene, points, np.ones(len(points), dtype=bool))
        number = np.cumsum(kept) - 1
        groups = {
            name: number[members[kept[members]]] for name, members in mesh.groups_of_cells().items()
        }
        spacing, cell = _sizes_of_cells(cells, kept, volumes)
        if scene.spacing is not None and abs(scene.spacing - spacing) > STATED * spacing:
            warnings.warn(
                f"scene {scene.name}: spacing: ignored, as the mesh has a spacing of {spacing:.4g};"
                " leave it out",
                stacklevel=5,
            )
        of_mesh = (
            corners.min(axis=0),
            corners.max(axis=0),
            groups,
            CellMesh.of_mesh(mesh.nodes, mesh.cells, kept),
        )
        return points[kept], volumes[kept], spacing, (cell,) * scene.dimension, *of_mesh
    lower, upper = scene.body.bounds()
    if scene.body.arrangement == "relaxed":
        points, volumes = _relaxed(scene, Cells.near(lower, upper, scene.spacing))
        spacing = float(volumes.mean() ** (1 / scene.dimension))
        return points, volumes, spacing, (spacing,) * scene.dimension, lower, upper, {}, None
    cells = Cells.filling(lower, upper, scene.spacing)
    points = cells.centers()
    if isinstance(scene.body, Rectangle | Box) and not scene.holes:
        return (
            points,
            np.full(len(points), cells.volume),
            cells.spacing,
            cells.sides,
            lower,
            upper,
            {},
            None,
        )
    kept = _in_material(scene, points, _within_outline(scene, points))
    return (
        *_material_of_cells(points, kept, cells, partial(material_at, scene)),
        cells.spacing,
        cells.sides,
        lower,
        upper,
        {},
        None,
    )


def _cells_around(scene: Scene) -> Callable[[np.ndarray, np.ndarray], CellMesh]:
    """Return the function that makes the cells of a cloud in the body of a scene, see `Body`."""
    outline = _sheet(scene)
    return cubes if outline is None else lambda points, volumes: voronoi_cells(points, outline)


def _sheet(scene: Scene) -> shapely.Geometry | None:
    """Return the region that the body of a scene without a mesh fills in the plane, of exact
    area; None in three dimensions.
    """
    if scene.dimension == 3:
        return None
    import shapely  # here, because few bodies need it

    outline, *holes = (
        shapely.polygons(shape.boundary(np.full(2, scene.spacing)))
        for shape in (scene.body, *scene.holes)
    )
    return shapely.difference(outline, shapely.union_all(holes))


def _relaxed(scene: Scene, cells: Cells) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and volumes of a cloud in the body of a scene, sampled in `cells`."""
    centers, material = cells.centers(), partial(material_at, scene)
    whole, cut = np.ones(len(centers), dtype=bool), np.empty(0, dtype=np.int64)
    if not isinstance(scene.body, Rectangle | Box) or scene.holes:
        kept = _in_material(scene, centers, _within_outline(scene, centers))
        whole, cut = _whole_and_cut(centers, kept, np.array(cells.sides), material)
    points, volumes = relaxed_points(cells, whole, cut, material, scene.spacing, scene.body.seed)
    sheet = _sheet(scene) if len(cut) else None
    return points, volumes if sheet is None else volumes * (sheet.area / volumes.sum())


def _volumes_by_side(
    scene: Scene, points: np.ndarray, volumes: np.ndarray, rounds: Sequence[Round]
) -> np.ndarray:
    """Return volumes of the points of a cloud so that the points on each side of round interfaces
    have its whole volume.

    A place belongs to the nearest of the points on its own side. `volumes` has the total volume,
    which does not change.
    """
    cells = Cells.near(*scene.body.bounds(), scene.spacing)
    centers, own, found = cells.centers(), sides_of(points, rounds), np.empty(len(points))
    for side in np.unique(own):

        def part(places: np.ndarray, side: int = side) -> np.ndarray:
            return material_at(scene, places) & (sides_of(places, rounds) == side)

        whole, cut = _whole_and_cut(centers, part(centers), np.array(cells.sides), part)
        found[own == side] = nearest_volumes(cells, whole, cut, part, points[own == side])
    return found * (volumes.sum() / found.sum())


def _sizes_of_cells(
    cells: list[np.ndarray], kept: np.ndarray, volumes: np.ndarray
) -> tuple[float, float]:
    """Return the spacing of a mesh, the mean size (area^(1/2) or volume^(1/3)) of a cell, and the
    side of the squares or cubes of cells.

    `cells` are the corners of the cells block by block, shape (n, corners, d), `kept` flags of the
    cells that are not in holes, and `volumes` those of all cells. Two triangles count as one
    square, six tetrahedra as one cube. Both are volume means: many small cells in a corner do not
    make the horizon small everywhere.
    """
    dimension = cells[0].shape[2]
    parts = np.repeat(
        [PARTS.get((dimension, block.shape[1]), 1) for block in cells],
        [len(block) for block in cells],
    )
    return tuple(
        float(np.average(size[kept] ** (1 / dimension), weights=volumes[kept]))
        for size in (volumes, parts * volumes)
    )


def faces_of_groups(scene: Scene, lower: np.ndarray, upper: np.ndarray) -> dict[str, str]:
    """Return a dictionary from each mesh group that covers a whole edge (or face) of the
    bounding box to the name of this edge.
    """
    mesh = mesh_of(scene.body) if isinstance(scene.body, Mesh) and scene.prescribed else None
    if mesh is None or not mesh.side_groups:
        return {}
    sides, outer, places = _outer_sides(scene)
    members, found = (
        {name: sides.among(corners)[outer] for name, corners in mesh.side_groups.items()},
        {},
    )
    for edge in edge_names(scene.dimension):
        flat = _on_edge(places, edge, lower, upper)
        found |= {
            name: edge for name, inside in members.items() if flat.any() and (inside == flat).all()
        }
    return found


def _area_of_sides(corners: np.ndarray) -> float:
    """Return the total area (length in the plane) of sides of cells, given by the positions of
    their corners, shape (s, corners, d).
    """
    diagonals = corners[:, corners.shape[1] // 2 :] - corners[:, : corners.shape[1] // 2]
    vectors = (
        diagonals[:, 0] if corners.shape[2] == 2 else np.cross(diagonals[:, 0], diagonals[:, 1]) / 2
    )
    return float(np.linalg.norm(vectors, axis=1).sum())


def _outer_sides(scene: Scene) -> tuple[Sides, np.ndarray, np.ndarray]:
    """Return the sides of a mesh's cells, the numbers of the sides on the boundary, and the
    positions of the corners of these.

    The boundary is that of the cells whose centroids lie in no hole of the scene; it includes the
    boundaries of the holes.
    """
    mesh = mesh_of(scene.body)
    sides = mesh.sides()
    outer, _ = sides.boundary(_outside_holes(scene, mesh.centroids()[0]))
    return sides, outer, mesh.nodes[sides.corners[outer]]


def _on_edge(places: np.ndarray, edge: str, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Return flags of the sides, given by their corners' positions (s, corners, d), that lie on
    the named `edge` of the bounding box.
    """
    axis, side = EDGES[edge]
    return (
        np.abs(places[..., axis] - (lower, upper)[side > 0][axis])
        <= CUT_SHIFT * (upper - lower).max()
    ).all(axis=1)


def _within_outline(scene: Scene, places: np.ndarray) -> np.ndarray:
    """Return flags of the places that lie within the outline of a body that is no mesh; all True
    for a rectangle or box.
    """
    return (
        np.ones(len(places), dtype=bool)
        if isinstance(scene.body, Rectangle | Box)
        else scene.body.contains(places)
    )


def _outside_holes(scene: Scene, places: np.ndarray) -> np.ndarray:
    outside = np.ones(len(places), dtype=bool)
    for hole in scene.holes:
        outside &= ~hole.contains(places)
    return outside


def material_at(scene: Scene, places: np.ndarray) -> np.ndarray:
    """Return flags of the places that lie in material: within the outline of the scene's body
    and outside its holes.
    """
    return _within_outline(scene, places) & _outside_holes(scene, places)


def _inside(scene: Scene, places: np.ndarray) -> np.ndarray:
    """Return flags of the places that lie in the body; unlike `material_at` also of places
    beyond a rectangle or box.
    """
    return scene.body.contains(places) & _outside_holes(scene, places)


def contained(scene: Scene, body: Body, places: np.ndarray) -> np.ndarray:
    """Return flags of the places (k, d) that lie in the body of a scene; of a mesh, those within
    3/4 of a spacing of its points.
    """
    if isinstance(scene.body, Mesh):
        return scipy.spatial.cKDTree(body.points).query(places)[0] <= 0.75 * body.spacing
    return _inside(scene, places)


def _in_material(scene: Scene, points: np.ndarray, within: np.ndarray) -> np.ndarray:
    """Return flags of the points that are `within` the outline and in no hole.

    Raise ValueError if a hole contains none of the points within the outline, or no point is left.
    """
    kept = within.copy()
    for number, hole in enumerate(scene.holes):
        inside = hole.contains(points)
        if not (inside & within).any():
            raise ValueError(
                f"holes.{number}: the hole contains no point of the body; it is outside, or smaller"
                " than the spacing"
            )
        kept &= ~inside
    if not kept.any():
        raise ValueError(
            "body: no point is left"
            + (": the holes cover all" if scene.holes else f" at the spacing {scene.spacing:g}")
        )
    return kept


def _material_of_cells(
    centers: np.ndarray, kept: np.ndarray, cells: Cells, material
) -> tuple[np.ndarray, np.ndarray]:
    """Return centroids and volumes of the material in each cell; a cell less than half full is
    merged into the nearest other cells.

    `material(places)` flags places in material; `kept` flags the cells whose centers lie in
    material.

    A raster of places in each cell that a boundary cuts determines its volume of material. If cells
    were kept or left out whole, a curved boundary would be a staircase, whose steps carry no
    stress, and a hole would be larger than it is.
    """
    sides = np.array(cells.sides)
    raster = _places_in_a_cell(len(sides))[1] * sides
    all_there, cut = _whole_and_cut(centers, kept, sides, material)
    points, volumes = centers.copy(), np.where(all_there, cells.volume, 0.0)
    for some in np.array_split(cut, len(cut) * len(raster) // MOST_PLACES + 1):
        samples = centers[some, None] + raster
        there = material(samples.reshape(-1, len(sides))).reshape(samples.shape[:2])
        for cell, sample in zip(
            some,
            (places[chosen] for places, chosen in zip(samples, there, strict=True)),
            strict=True,
        ):
            if len(sample):
                points[cell], volumes[cell] = (
                    sample.mean(axis=0),
                    cells.volume * len(sample) / len(raster),
                )
    whole = np.flatnonzero(volumes >= 0.5 * cells.volume)
    slivers = np.flatnonzero((volumes > 0) & (volumes < 0.5 * cells.volume))
    if not len(whole):
        whole, slivers = slivers, whole
    if len(slivers):
        tree = scipy.spatial.cKDTree(points[whole])
        nearest = tree.query_ball_point(
            points[slivers], tree.query(points[slivers])[0] * (1 + TIED)
        )
        counts = np.array([len(numbers) for numbers in nearest])
        givers, heirs, share = (
            np.repeat(slivers, counts),
            whole[np.concatenate(nearest)],
            1 / np.repeat(counts, counts),
        )
        moments = volumes[:, None] * points
        for sums, parts in (
            (volumes, share * volumes[givers]),
            (moments, share[:, None] * moments[givers]),
        ):
            np.add.at(sums, heirs, parts)
        points[heirs] = moments[heirs] / volumes[heirs, None]
    return points[whole], volumes[whole]


def _whole_and_cut(
    centers: np.ndarray, kept: np.ndarray, sides: np.ndarray, material
) -> tuple[np.ndarray, np.ndarray]:
    """Return flags of the cells that lie in material, and the numbers of the cells that a
    boundary cuts, see `_material_of_cells`.
    """
    all_there, some_there = kept.copy(), kept.copy()
    for corner in _places_in_a_cell(len(sides))[0] * sides:
        there = material(centers + corner)
        all_there &= there
        some_there |= there
    return all_there, np.flatnonzero(some_there & ~all_there)


def _places_in_a_cell(dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Return two sets of places in a cell, relative to its middle in units of its sides.

    The first decides whether a boundary cuts the cell; the second samples the share of material in
    it.
    """
    if dimension == 2:
        corners = (
            np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0]]) / 2
        )
        places = (np.arange(RASTER) + 0.5) / RASTER - 0.5
        return corners, np.stack(np.meshgrid(places, places, indexing="ij"), axis=-1).reshape(-1, 2)
    around = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    # Multiples of the powers of 1/g, g^4 = g + 1, fill a cube evenly.
    eighth = (0.5 + np.arange(SCATTERED)[:, None] * ROOT_OF_CUBES ** -np.arange(1.0, 4.0)) % 1 / 2
    mirrors = around[(around != 0).all(axis=1)]
    return WITHIN / 2 * around[(around != 0).any(axis=1)], (mirrors[:, None] * eighth).reshape(
        -1, 3
    )


def _cuts(
    scene: Scene,
    precuts: Cuts,
    horizon: float,
    cell: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
):
    """Return ``separates(starts, ends)``, which flags bonds that precuts or empty space cut;
    None if a scene has neither.
    """
    tests = [precuts.crosses] if scene.precuts else []
    if not isinstance(scene.body, Mesh) and (scene.holes or not _surely_convex(scene)):
        tests.append(_across_empty_space(scene, horizon, cell, lower, upper))
    if not tests:
        return None

    def separates(starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        crossing = np.zeros(len(starts), dtype=bool)
        for test in tests:
            crossing |= test(starts, ends)
        return crossing

    return separates


def cuts_of(
    scene: Scene,
    lower: np.ndarray,
    upper: np.ndarray,
    between: bool = False,
    planes: Sequence[Mirror] = (),
) -> Cuts:
    """Return the precuts of a scene whose body has a bounding box with the given corners,
    continued beyond the reflection planes among `planes`.

    Those along rows of a lattice lie where the scene has them, or if `between`, on the boundary
    between the cells of these rows.
    """
    extent, pieces = float((upper - lower).max()), scene.precuts
    flat = [plane for plane in planes if isinstance(plane, ReflectionPlane)]
    if between and not isinstance(scene.body, Mesh) and scene.body.arrangement == "lattice":
        cells = Cells.filling(lower, upper, scene.spacing)
        pieces = between_cells(pieces, cells, ROUNDING * extent)

    def into_planes(places: np.ndarray) -> np.ndarray:
        for plane in flat:
            feet, depths = plane.mirrored(places)
            places = np.where(np.abs(depths)[:, None] < CUT_SHIFT * extent, feet, places)
        return places

    inside = _outside_holes if isinstance(scene.body, Mesh) else _inside
    pieces = [piece.moved(into_planes) for piece in pieces] if flat else pieces
    return Cuts(pieces, ROUNDING * extent, partial(inside, scene), flat)


def _surely_convex(scene: Scene) -> bool:
    """Return whether the outline of a scene's body is surely convex, so that no bond between
    points or images leaves it.
    """
    body = scene.body
    if isinstance(body, Prism):
        return not body.straight.bores and isinstance(
            body.straight.section, Rectangle | Circle | Ellipse
        )
    return isinstance(body, Rectangle | Sphere)


def _across_empty_space(
    scene: Scene, horizon: float, cell: np.ndarray, lower: np.ndarray, upper: np.ndarray
):
    """Return a function ``crosses(starts, ends)`` that flags bonds that cross a hole or leave the
    outline.

    On such a bond lies a place that is not in material, nor are places at a distance of `CLEARANCE`
    cells from it in any direction. Beyond its bounding box the body is continued by reflection.
    """
    # Half a cell apart, some place of this lattice lies within 0.36 cells of any empty place, and
    # in the same emptiness.
    pitch = cell / 2
    counts = np.ceil((upper - lower) / pitch).astype(int) + 1
    lattice = lower + pitch * np.stack(
        np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1
    ).reshape(-1, len(counts))
    there = material_at(scene, lattice).reshape(counts)
    if there.all():
        return lambda starts, ends: np.zeros(len(starts), dtype=bool)
    # of the middle of a bond, or of a fit
    near = (
        scipy.ndimage.distance_transform_edt(there, sampling=pitch)
        <= REACH * horizon / 2 + cell.max()
    )
    around = CLEARANCE * cell * _directions(scene.dimension)
    shares = np.linspace(0, 1, int(np.ceil(horizon / (STEP * cell.min()))) + 2)[1:-1]

    def folded(places: np.ndarray) -> np.ndarray:
        inner = lower + np.abs(places - lower)
        return upper - np.abs(upper - inner)

    def crosses(starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        middles = (
            np.rint((folded((starts + ends) / 2) - lower) / pitch).astype(int).clip(0, counts - 1)
        )
        chosen = np.flatnonzero(near[tuple(middles.T)])
        crossing = np.zeros(len(starts), dtype=bool)
        for some in np.array_split(chosen, len(chosen) * len(shares) // MOST_PLACES + 1):
            places = folded(
                (
                    starts[some, None] + shares[:, None] * (ends[some] - starts[some])[:, None]
                ).reshape(-1, len(cell))
            )
            empty = np.flatnonzero(~_inside(scene, places))
            for offset in around:
                empty = empty[~_inside(scene, places[empty] + offset)]
            crossing[some[empty // len(shares)]] = True
        return crossing

    return crosses


def _directions(dimension: int) -> np.ndarray:
    """Return unit vectors spread over all directions: 16 in two dimensions; 98 in three, toward
    lattice points up to two cells away.
    """
    if dimension == 2:
        angles = np.pi / 8 * np.arange(16)
        return np.stack([np.cos(angles), np.sin(angles)], axis=1)
    steps = np.stack(np.meshgrid(*[np.arange(-2, 3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    shortest = steps[np.gcd.reduce(steps, axis=1) == 1]
    return shortest / np.linalg.norm(shortest, axis=1)[:, None]


def _check_precuts(scene: Scene, body: Body, cuts: Cuts) -> None:
    """Raise ValueError if a precut crosses no bond, or crosses one that another precut in the
    same line or plane crosses too.
    """
    cut, before = body.all_points[body.bonds.cut], []
    for number, precut in enumerate(scene.precuts):
        crossed = cuts.only(number).crosses(cut[:, 0], cut[:, 1])
        if not body.share.any(crossed.any()):
            raise ValueError(
                f"precuts.{number}: the precut crosses no bond; it is outside the body, in a hole,"
                " or between points"
            )
        edge = precut.edge(body.spacing)[0]
        for other, (its_edge, its_crossed) in enumerate(before):
            aligned = (
                np.linalg.matrix_rank(
                    np.concatenate([edge, its_edge]) - edge[0], tol=IN_LINE * body.spacing
                )
                < body.dimension
            )
            if aligned and body.share.any((crossed & its_crossed).any()):
                raise ValueError(
                    f"precuts.{number}: the precut lies on precuts.{other}; describe a cut once and"
                    " in one piece"
                )
        before.append((edge, crossed))
