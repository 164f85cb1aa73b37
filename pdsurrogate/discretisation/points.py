"""From the description of a scene to the points of its body, and their bonds."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from ..body import Body, Cells
from ..body.local_fit import REACH
from ..scenes import Mesh, Rectangle, Scene, SceneError
from ..scenes.model import EDGES
from ..solvers.planes import reflected_edges, reflection_planes
from .meshes import centroids, mesh_of

RASTER = 16
"""Places along either side of a cell at which it is asked whether there is material: an area to some 1/1000 of a cell."""

CLEARANCE = 0.4
"""Cells without material around a place on a bond, in every direction, that make it empty: bonds beside a round hole of more than
some three cells' radius, whose chords leave the material by less, stay."""

STEP = 0.15
"""Cells between the places on a bond: a gap of one cell is empty over 0.2 of them."""

MOST_PLACES = 1_000_000
"""Places on bonds looked at together, which bounds the memory for them."""

CUT_SHIFT = 1e-6
"""Distance inside a grip's plane, in extents of the body, of the cut whose area is taken: more than corners in single precision are off."""


def discretise(scene: Scene) -> tuple[Body, np.ndarray, np.ndarray]:
    """The points of a scene, less its holes, with its precuts and the images beyond its grips; no bond crosses empty space.

    Returns
    -------
    body : Body
    lower, upper : ndarray, shape (2,)
        Corners of its bounding box, holes not considered.

    Raises
    ------
    SceneError
        If the spacing does not fit the body, the holes leave nothing of it, or a hole or precut misses it.
    """
    try:
        points, volumes, spacing, cell, lower, upper, groups = _points_of(scene)
        planes = reflection_planes(scene, lower, upper)
        # Measured by the smaller side, a horizon takes in the same neighbours as with squares where the sides differ by little: by the
        # mean or the larger one some at a distance of (3, 1) cells come in along one direction alone, and errors in pure shear are half as
        # large again.
        horizon = scene.horizon_ratio * min(cell)
        cuts = _cuts(scene, horizon, cell, lower, upper)
        body = Body(points, volumes, horizon, spacing, scene.weight, planes, cuts, cell, groups)
        _check_precuts(scene, body)
        return body, lower, upper
    except ValueError as error:
        raise SceneError(f"scene {scene.name}: {error}") from None


def grip_areas(scene: Scene, lower: np.ndarray, upper: np.ndarray) -> dict[str, float]:
    """Cross-section of the body at every grip or reflected edge, by edge: area of its cut in the plane there, at unit thickness.

    Parameters
    ----------
    scene : Scene
    lower, upper : ndarray, shape (2,)
        Corners of the bounding box of the body.

    Raises
    ------
    SceneError
        If the body has no straight edge in such a plane, or no material there.
    """
    areas, cells = {}, None
    if isinstance(scene.body, Mesh):
        cells = [block[_outside_holes(scene, centroids(block)[0])] for block in mesh_of(scene.body).corners()]

    def cut(axis: int, position: float) -> float:
        if cells is not None:
            return sum(float(_chords(block, axis, position).sum()) for block in cells)
        return _length_inside(scene, axis, position, lower[1 - axis], upper[1 - axis])

    for edge in [grip.edge for grip in scene.grips] or reflected_edges(scene):
        axis, side = EDGES[edge]
        shift = CUT_SHIFT * (upper - lower).max()
        near, far = (cut(axis, (lower, upper)[side > 0][axis] - side * times * shift) for times in (1, 2))
        # Linear in the distance below a straight edge; below a round or a pointed end all of it is due to the distance.
        areas[edge] = 2 * near - far
        if not areas[edge] > 0.9 * near:
            key = "grips" if scene.grips else "prescribed"
            raise SceneError(f"scene {scene.name}: {key}: the body has no straight edge with material at its {edge} end to be held by")
    return areas


def _length_inside(scene: Scene, axis: int, position: float, low: float, high: float) -> float:
    """Length of the line on which a coordinate has the given value, between two values of the other, that lies in material."""

    def inside(along: np.ndarray) -> np.ndarray:
        places = np.empty((len(along), 2))
        places[:, axis], places[:, 1 - axis] = position, along
        return _material(scene, places)

    count = int(np.ceil(RASTER * (high - low) / scene.spacing))
    middles = low + (high - low) * (np.arange(count) + 0.5) / count
    there = inside(middles)
    ends = np.flatnonzero(there[1:] != there[:-1])
    starts, stops, before = middles[ends], middles[ends + 1], there[ends]
    for _ in range(50):  # bisection, to rounding
        halves = (starts + stops) / 2
        same = inside(halves) == before
        starts, stops = np.where(same, halves, starts), np.where(same, stops, halves)
    bounds = np.concatenate([[low], (starts + stops) / 2, [high]])
    return float(np.diff(bounds)[np.concatenate([[there[0]], ~before])].sum())


def _chords(cells: np.ndarray, axis: int, position: float) -> np.ndarray:
    """Length that each of some convex polygons cuts off a line on which a coordinate has the given value."""
    following = np.roll(cells, -1, axis=1)
    spans = (cells[..., axis] > position) != (following[..., axis] > position)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (position - cells[..., axis]) / (following[..., axis] - cells[..., axis])
        crossing = cells[..., 1 - axis] + share * (following[..., 1 - axis] - cells[..., 1 - axis])
    chords = np.where(spans, crossing, -np.inf).max(axis=1) - np.where(spans, crossing, np.inf).min(axis=1)
    return chords[spans.any(axis=1)]


def _points_of(scene: Scene):
    """Points and volumes, holes left out, their spacing and cell, the corners of the bounding box of the body, and groups of its points."""
    if isinstance(scene.body, Mesh):
        mesh = mesh_of(scene.body)
        cells = mesh.corners()
        corners = np.concatenate([block.reshape(-1, 2) for block in cells])
        points, volumes = (np.concatenate(parts) for parts in zip(*map(centroids, cells), strict=True))
        # Its cells have any shape: those whose centroid lies in a hole are left out whole.
        kept = _in_material(scene, points, np.ones(len(points), dtype=bool))
        number = np.cumsum(kept) - 1
        groups = {name: number[members[kept[members]]] for name, members in mesh.groups_of_cells().items()}
        cell = (scene.spacing, scene.spacing)
        return points[kept], volumes[kept], scene.spacing, cell, corners.min(axis=0), corners.max(axis=0), groups
    lower, upper = scene.body.bounds()
    cells = Cells.filling(lower, upper, scene.spacing)
    points = cells.centres()
    rectangle = isinstance(scene.body, Rectangle)
    if rectangle and not scene.holes:
        return points, np.full(len(points), cells.area), cells.spacing, cells.sides, lower, upper, {}
    kept = _in_material(scene, points, _within_outline(scene, points))
    return *_material_of_cells(points, kept, cells, partial(_material, scene)), cells.spacing, cells.sides, lower, upper, {}


def _within_outline(scene: Scene, places: np.ndarray) -> np.ndarray:
    """Which places lie within the outline of a body that is no mesh; of a rectangle, whose grid fills it, all that are asked for."""
    return np.ones(len(places), dtype=bool) if isinstance(scene.body, Rectangle) else scene.body.contains(places)


def _outside_holes(scene: Scene, places: np.ndarray) -> np.ndarray:
    outside = np.ones(len(places), dtype=bool)
    for hole in scene.holes:
        outside &= ~hole.contains(places)
    return outside


def _material(scene: Scene, places: np.ndarray) -> np.ndarray:
    """Which places there is material at."""
    return _within_outline(scene, places) & _outside_holes(scene, places)


def _in_material(scene: Scene, points: np.ndarray, within: np.ndarray) -> np.ndarray:
    """Which of the points are left of those within the outline, the holes taken away; an error where a hole or the body holds none."""
    kept = within.copy()
    for number, hole in enumerate(scene.holes):
        inside = hole.contains(points)
        if not (inside & within).any():
            raise ValueError(f"holes.{number}: no point of the body lies in it; is it outside, or smaller than the spacing?")
        kept &= ~inside
    if not kept.any():
        raise ValueError(
            "body: no point is left" + (": its holes take all of it" if scene.holes else f"; the spacing is {scene.spacing:g}")
        )
    return kept


def _material_of_cells(centres: np.ndarray, kept: np.ndarray, cells: Cells, material) -> tuple[np.ndarray, np.ndarray]:
    """Centroids and volumes of what lies in each cell; what fills less than half of one goes to the nearest of the others.

    `material` says of places whether there is any; `kept`, the same of the cells' centres.

    Cells cut by an outline count with the part of them that is there, found on a raster: with whole cells a curved boundary would be a
    staircase, whose steps carry no stress, and a hole larger than it is.
    """
    sides = np.array(cells.sides)
    corners = sides / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0]])
    found = np.stack([kept, *(material(centres + corner) for corner in corners)])
    cut = np.flatnonzero(found.any(axis=0) & ~found.all(axis=0))
    places = (np.arange(RASTER) + 0.5) / RASTER - 0.5
    raster = np.stack(np.meshgrid(places, places, indexing="ij"), axis=-1).reshape(-1, 2) * sides
    points, volumes = centres.copy(), np.where(found.all(axis=0), cells.area, 0.0)
    for cell in cut:
        sample = centres[cell] + raster
        sample = sample[material(sample)]
        if len(sample):
            points[cell], volumes[cell] = sample.mean(axis=0), cells.area * len(sample) / len(raster)
    whole = np.flatnonzero(volumes >= 0.5 * cells.area)
    slivers = np.flatnonzero((volumes > 0) & (volumes < 0.5 * cells.area))
    if not len(whole):
        whole, slivers = slivers, whole
    if len(slivers):
        _, nearest = cKDTree(points[whole]).query(points[slivers])
        heirs = whole[nearest]
        moments = volumes[:, None] * points
        for sums, parts in ((volumes, volumes[slivers]), (moments, moments[slivers])):
            np.add.at(sums, heirs, parts)
        points[heirs] = moments[heirs] / volumes[heirs, None]
    return points[whole], volumes[whole]


def _cuts(scene: Scene, horizon: float, cell: tuple[float, float], lower: np.ndarray, upper: np.ndarray):
    """Which bonds precuts and empty space separate; None where there is nothing of either."""
    tests = [precut.crosses for precut in scene.precuts]
    if not isinstance(scene.body, Mesh) and (scene.holes or not isinstance(scene.body, Rectangle)):
        tests.append(_across_empty_space(scene, horizon, np.array(cell), lower, upper))
    if not tests:
        return None

    def separates(starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        crossing = np.zeros(len(starts), dtype=bool)
        for test in tests:
            crossing |= test(starts, ends)
        return crossing

    return separates


def _across_empty_space(scene: Scene, horizon: float, cell: np.ndarray, lower: np.ndarray, upper: np.ndarray):
    """Which bonds cross a hole, or leave the outline: those with a place on them that has no material within `CLEARANCE` of it.

    Beyond the planes of its grips the body is its own image.
    """
    # Half a cell apart, some place of this lattice lies within 0.36 cells of any empty place, and in the same emptiness.
    pitch = cell / 2
    counts = np.ceil((upper - lower) / pitch).astype(int) + 1
    lattice = lower + pitch * np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 2)
    there = _material(scene, lattice).reshape(counts)
    if there.all():
        return lambda starts, ends: np.zeros(len(starts), dtype=bool)
    near = distance_transform_edt(there, sampling=pitch) <= REACH * horizon / 2 + cell.max()  # of the middle of a bond, or of a fit
    angles = np.pi / 8 * np.arange(16)
    around = CLEARANCE * cell * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    shares = np.linspace(0, 1, int(np.ceil(horizon / (STEP * cell.min()))) + 2)[1:-1]

    def folded(places: np.ndarray) -> np.ndarray:
        inner = lower + np.abs(places - lower)
        return upper - np.abs(upper - inner)

    def material(places: np.ndarray) -> np.ndarray:
        return scene.body.contains(places) & _outside_holes(scene, places)

    def crosses(starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        middles = np.rint((folded((starts + ends) / 2) - lower) / pitch).astype(int).clip(0, counts - 1)
        chosen = np.flatnonzero(near[middles[:, 0], middles[:, 1]])
        crossing = np.zeros(len(starts), dtype=bool)
        for some in np.array_split(chosen, len(chosen) * len(shares) // MOST_PLACES + 1):
            places = folded((starts[some, None] + shares[:, None] * (ends[some] - starts[some])[:, None]).reshape(-1, 2))
            empty = np.flatnonzero(~material(places))
            for offset in around:
                empty = empty[~material(places[empty] + offset)]
            crossing[some[empty // len(shares)]] = True
        return crossing

    return crosses


def _check_precuts(scene: Scene, body: Body) -> None:
    cut = body.all_points[body.bonds.cut]
    for number, precut in enumerate(scene.precuts):
        if not len(cut) or not precut.crosses(cut[:, 0], cut[:, 1]).any():
            raise ValueError(f"precuts.{number}: it cuts no bond; it lies outside the body, in a hole, or between neighbouring points")
