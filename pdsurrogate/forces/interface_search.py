"""Interfaces next to the points of a body: circles and spheres, planes between the points, and the
nearest points of a much softer material.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from ..body import Body
from ..body.body import owners_and_items
from ..body.ghosts import WITH_ROUNDING

CENTERINGS = 3
"""Number of fits of the straight interface next to a point, each centered on the place that the
previous fit found. Chosen: the first fit is one-sided, the second is centered, and the third
corrects the place.
"""

FARTHEST = 1.5
"""Greatest distance, in horizons, at which an interface is assigned to a point. The point is bonded
to points beyond the interface, the nearest within one horizon; half a horizon more is room for
planes that are fitted obliquely.
"""

ASTRAY = 0.06
"""Greatest share of a horizon's volume on the wrong side of the plane fitted to an interface, for
the interface to count as straight; at a corner it is greater. Chosen: of some 30 points in a
horizon (3.15 spacings in the plane, 1.75 in three dimensions) one may lie on the wrong side and two
may not.
"""

YIELDING = 4.001
"""Ratio of the shear moduli of two materials beyond which the energy of the stiffer one depends on
its own points only.

Otherwise the error of the fitted motion of the softer material, times the stiffer modulus, acts as
a force on the softer one: a layer of 4 cells moves 33 % too little between halves ten times as
stiff, and 83 % between halves a hundred times as stiff. Below this ratio the energies of both sides
depend on each other's points. That is more accurate: homogeneous states are in equilibrium. Chosen
below ten, where the error is a third, and not round: a derivative by the modulus of one of two
materials with a ratio of exactly four must not cross it.
"""

LEAST_RADIUS = 1.5
"""Least radius, in spacings, of a circle or sphere on which depths and normals follow from its
center and not from the points.
"""

ROUNDED = 1e-11
"""Unit, in spacings, to whose multiples places on interfaces are rounded, as components of normals
are to multiples of the number itself. Points on one line across an interface then have exactly the
same place and share one fit. Chosen: far above the rounding of coordinates, and without effect on
results.
"""

NONE = 1e-6
"""Distance, in spacings, of a point from a plane between points that counts as none. Chosen above
the rounding of coordinates a million spacings from the origin, a billionth of a spacing.
"""

SLAB = 2048
"""Number of places to which neighbors are found and functions fitted together. Chosen: the values
of the functions then take 20 MB in the plane and 80 MB in solids; larger numbers only take more
memory.
"""


@dataclass(frozen=True)
class Beside:
    """Interfaces next to points.

    Attributes
    ----------
    depths, normals : ndarray, shapes (k,) and (k, d)
        Distance of every point from its interface, 0 where there is none, and direction to it.
    others : ndarray of int, shape (k,)
        Number of the material beyond.
    astray : ndarray, shape (k,)
        Share of the horizon's volume whose points lie on the other material's side of the
        interface.
    rounds : ndarray of int, shape (k,)
        Number of the circle or sphere that the interface is, -1 for a plane fitted between the
        points.
    """

    depths: np.ndarray
    normals: np.ndarray
    others: np.ndarray
    astray: np.ndarray
    rounds: np.ndarray

    @classmethod
    def nothing(cls, count: int, dimension: int) -> Beside:
        """Return that `count` points have no interface."""
        others = np.full((2, count), -1)
        return cls(
            np.zeros(count), np.zeros((count, dimension)), others[0], np.zeros(count), others[1]
        )

    def put(self, rows: np.ndarray, depths, normals, others, astray=0.0, rounds=-1) -> None:
        """Write the interfaces of the points `rows`."""
        self.depths[rows] = depths
        self.normals[rows] = normals
        self.others[rows] = others
        self.astray[rows] = astray
        self.rounds[rows] = rounds


def interfaces_beside(
    body: Body, portion_of: np.ndarray, moduli: np.ndarray, near: np.ndarray, quadratic: bool
) -> Beside:
    """Return the interfaces next to the points `near`: a circle or sphere, or a plane, or the
    nearest points of a much softer material.
    """
    found = Beside.nothing(len(near), body.dimension)
    tree = scipy.spatial.cKDTree(body.all_points)
    if quadratic:
        _find_rounds(body, tree, portion_of, near, found)
    for some in slabs(np.flatnonzero(found.depths == 0)):
        _find_planes(body, tree, portion_of, near, some, found)
    if quadratic:
        for some in slabs(np.flatnonzero((found.depths == 0) | (found.astray > ASTRAY))):
            _find_softer(body, tree, portion_of, moduli, near, some, found)
    found.normals[:] = rounded(found.normals, 1.0)
    return found


def slabs(rows: np.ndarray) -> Iterator[np.ndarray]:
    """Yield numbers in parts of at most `SLAB`."""
    for start in range(0, len(rows), SLAB):
        yield rows[start : start + SLAB]


def points_around(
    tree: scipy.spatial.cKDTree, places: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers (k, m) of the points within `reach` of each place, in ascending order,
    and flags of the entries that are such.
    """
    found = (
        scipy.spatial.cKDTree(places)
        .sparse_distance_matrix(tree, reach, output_type="coo_matrix")
        .tocsr()
    )
    found.sort_indices()
    counts = np.diff(found.indptr)
    there = np.arange(counts.max()) < counts[:, None]
    numbers = np.zeros(there.shape, dtype=np.int64)
    numbers[there] = found.indices
    return numbers, there


def rounded(values: np.ndarray, unit: float) -> np.ndarray:
    """Return values rounded to multiples of `ROUNDED` units."""
    return np.round(values / (ROUNDED * unit)) * (ROUNDED * unit)


def round_shapes(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Return the centers (k, d) and radii (k,) of the body's circles or spheres."""
    return np.array([each.center for each in body.rounds]).reshape(-1, body.dimension), np.array(
        [each.radius for each in body.rounds]
    )


def _find_rounds(
    body: Body, tree: scipy.spatial.cKDTree, portion_of: np.ndarray, near: np.ndarray, found: Beside
) -> None:
    """Find the circles or spheres next to the points `near` on which the material changes;
    `tree` holds points and ghosts.
    """
    centers, radii = round_shapes(body)
    reach = FARTHEST * body.horizon
    large = np.flatnonzero(radii > LEAST_RADIUS * body.spacing)
    if not len(large) or not len(near):
        return
    which, rows = owners_and_items(
        scipy.spatial.cKDTree(body.points[near]).query_ball_point(
            centers[large], radii[large] + reach
        )
    )
    which, arms = large[which], body.points[near[rows]] - centers[large[which]]
    lengths = np.linalg.norm(arms, axis=1)
    distances = rounded(lengths - radii[which], body.spacing)
    order = np.lexsort((which, np.abs(distances), rows))
    order = order[np.unique(rows[order], return_index=True)[1]]
    # In the middle of a circle or sphere there is no direction, and on it no depth.
    order = order[
        (np.abs(distances[order]) <= reach) & (distances[order] != 0) & (lengths[order] > 0)
    ]
    rows = rows[order]
    which = which[order]
    depths = np.abs(distances[order])
    normals = -np.sign(distances[order])[:, None] * arms[order] / lengths[order, None]
    # Of points equally near to the place beyond the interface, those on the interface may be of the
    # own material.
    places = body.points[near[rows]] + (depths + body.spacing / 2)[:, None] * normals
    owners, beyond = owners_and_items(
        tree.query_ball_point(places, tree.query(places)[0] * (1 + 1e-6), return_sorted=True)
    )
    differ = np.flatnonzero(portion_of[beyond] != portion_of[near[rows[owners]]])
    some, begin = np.unique(owners[differ], return_index=True)
    found.put(
        rows[some],
        depths[some],
        normals[some],
        portion_of[beyond[differ[begin]]],
        rounds=which[some],
    )


def _find_planes(
    body: Body,
    tree: scipy.spatial.cKDTree,
    portion_of: np.ndarray,
    near: np.ndarray,
    rows: np.ndarray,
    found: Beside,
) -> None:
    """Find the interfaces next to the points ``near[rows]`` as planes that divide the volume around
    a point as the two materials there do.

    `tree` holds all points and ghosts. There is none where there are not exactly two materials, or
    no such plane in front of the point.
    """
    places = body.points[near[rows]]
    for _ in range(CENTERINGS):
        if not len(rows):
            return
        around, there = points_around(tree, places, body.horizon * WITH_ROUNDING)
        kinds = portion_of[around]
        V = np.where(there, body.all_volumes[around], 0.0)
        others = there & (kinds != portion_of[near[rows], None])
        total = V.sum(axis=1, keepdims=True)
        least = np.where(others, kinds, len(portion_of)).min(axis=1)
        greatest = np.where(others, kinds, -1).max(axis=1)
        x = body.all_points[around] - places[:, None]
        x -= np.einsum("bk,bka->ba", V / total, x)[:, None]
        second = np.einsum("bk,bka,bkc->bac", V, x, x)
        good = (least == greatest) & (others != there).any(axis=1)
        good &= np.linalg.eigvalsh(second)[:, 0] >= 1e-3 * np.trace(second, axis1=1, axis2=2)
        rows, beyond, around, there, others, V, total, x, second = (
            each[good] for each in (rows, least, around, there, others, V, total, x, second)
        )
        share = (V * others).sum(axis=1, keepdims=True) / total
        normals = np.linalg.solve(
            second, np.einsum("bk,bka->ba", V * (others - share), x)[:, :, None]
        )[:, :, 0]
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        # The other material may lie evenly around the point, a single point at its own place say,
        # so that it has no direction but rounding.
        directed = lengths > 1e-9 / body.horizon
        normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=directed)
        # The plane has as much of the volume beyond it as the other material has.
        points = body.points[near[rows]]
        along = np.where(
            there,
            ((body.all_points[around] - points[:, None]) @ normals[:, :, None])[:, :, 0],
            np.inf,
        )
        order = np.argsort(along, axis=1, kind="stable")
        sums = np.cumsum(np.take_along_axis(V, order, axis=1), axis=1)
        own = np.where(others, 0.0, V).sum(axis=1, keepdims=True)
        behind = (sums < own * (1 + 1e-9)).sum(axis=1, keepdims=True)
        ends = np.take_along_axis(
            order, np.clip(np.hstack([behind - 1, behind]), 0, order.shape[1] - 1), axis=1
        )
        ends = np.take_along_axis(along, ends, axis=1)
        depths = ends.mean(axis=1)
        good = (directed & (behind > 0) & (behind < there.sum(axis=1, keepdims=True)))[:, 0] & (
            np.abs(depths) <= FARTHEST * body.horizon
        )
        places = (points + depths[:, None] * normals)[good]
        rows = rows[good]
        beyond = beyond[good]
        normals = normals[good]
        depths = depths[good]
        astray = (V * (others != (along > ends[:, :1] + NONE * body.spacing)) / total)[good].sum(
            axis=1
        )
    front = depths > NONE * body.spacing
    found.put(rows[front], depths[front], normals[front], beyond[front], astray[front])


def _find_softer(
    body: Body,
    tree: scipy.spatial.cKDTree,
    portion_of: np.ndarray,
    moduli: np.ndarray,
    near: np.ndarray,
    rows: np.ndarray,
    found: Beside,
) -> None:
    """Find interfaces next to the points ``near[rows]``, placed half a spacing before the nearest
    points of a much softer material.

    `tree` holds all points and ghosts. Points without a much softer material (`YIELDING`) in their
    horizon keep what was found.
    """
    around, there = points_around(tree, body.points[near[rows]], body.horizon * WITH_ROUNDING)
    there &= moduli[around] * YIELDING < moduli[near[rows], None]
    rows, around, there = (each[there.any(axis=1)] for each in (rows, around, there))
    arms = body.all_points[around] - body.points[near[rows], None]
    distances = np.where(there, np.linalg.norm(arms, axis=2), np.inf)
    nearest = distances < distances.min(axis=1, keepdims=True) * (1 + 1e-6)
    normals = np.einsum("bk,bka->ba", nearest / nearest.sum(axis=1, keepdims=True), arms)
    lengths = np.linalg.norm(normals, axis=1)
    front = lengths > body.spacing / 2
    softer = around[np.arange(len(rows)), nearest.argmax(axis=1)]
    found.put(
        rows[front],
        lengths[front] - body.spacing / 2,
        normals[front] / lengths[front, None],
        portion_of[softer[front]],
    )
