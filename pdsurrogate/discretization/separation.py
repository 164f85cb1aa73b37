"""Bonds that precuts and empty space cut."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import scipy

from ..body import Body, Cells, Mirror, ReflectionPlane
from ..body.local_fit import REACH
from ..body.surface import IN_PLANE
from ..scenes import Circle, Ellipse, Mesh, Rectangle, Scene, Sphere
from ..scenes.solids import AnyPrecut, Prism
from .cells import MOST_PLACES, lattice_of
from .chains import ROUNDING
from .cuts import Cuts, between_cells
from .material import inside, material_at

CLEARANCE = 0.4
"""Distance without material, in cells in every direction, that makes a place on a bond empty. Bonds
next to a round hole with a radius above some three cells leave the material by less and remain.
"""

STEP = 0.15
"""Greatest distance, in cells, between neighboring tested places on a bond. In a gap of one cell
the places with `CLEARANCE` to both sides extend over 0.2 cells, so that at least one of them is
tested.
"""

IN_LINE = 1e-3
"""Distance, in spacings, below which two cuts count as lying in one line or plane."""


def separation(
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
    extent = float((upper - lower).max())
    pieces = scene.precuts
    flat = [plane for plane in planes if isinstance(plane, ReflectionPlane)]
    cells = None
    if between and not isinstance(scene.body, Mesh) and scene.body.arrangement == "lattice":
        cells = Cells.filling(lower, upper, scene.spacing)
        pieces = between_cells(pieces, cells, ROUNDING * extent)

    def into_planes(piece: AnyPrecut) -> AnyPrecut:
        for plane in flat:
            reach = IN_PLANE * extent
            depths = np.abs(plane.mirrored(piece.edge(scene.spacing)[0])[1])
            half = 0.0 if cells is None else cells.sides[plane.axis] / 2
            # Between a plane and its first row of points a cut is one with its image.
            if plane.symmetric and (depths <= half + ROUNDING * extent).all():
                reach = extent

            def moved(places: np.ndarray, plane: ReflectionPlane = plane, reach: float = reach):
                feet, depths = plane.mirrored(places)
                return np.where(np.abs(depths)[:, None] < reach, feet, places)

            piece = piece.moved(moved)
        return piece

    pieces = [into_planes(piece) for piece in pieces]
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
    there = material_at(scene, lower + pitch * lattice_of(*map(np.arange, counts))).reshape(counts)
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
            empty = np.flatnonzero(~inside(scene, places))
            for offset in around:
                empty = empty[~inside(scene, places[empty] + offset)]
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
    steps = lattice_of(*[np.arange(-2, 3)] * 3)
    shortest = steps[np.gcd.reduce(steps, axis=1) == 1]
    return shortest / np.linalg.norm(shortest, axis=1)[:, None]


def check_precuts(scene: Scene, body: Body, cuts: Cuts) -> None:
    """Raise ValueError if a precut crosses no bond, or crosses one that another precut in the
    same line or plane crosses too.
    """
    cut = body.all_points[body.bonds.cut]
    before = []
    for number in range(len(scene.precuts)):
        crossed = cuts.only(number).crosses(cut[:, 0], cut[:, 1])
        if not body.share.any(crossed.any()):
            raise ValueError(
                f"precuts.{number}: the precut crosses no bond; it is outside the body, in a hole,"
                " or between points"
            )
        edge = cuts.pieces[number].edge(body.spacing)[0]
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
