"""Interfaces next to the points of a body, and the weights with which positions give the jumps
of the deformation gradient there.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from ..body import Body
from ..body.body import owners_and_items
from ..body.ghosts import WITH_ROUNDING

NEAREST = (1.6, 2.2, 3.0, 4.0, 6.0)
"""Trial radii, in point spacings, of the neighborhood from which the value at a place is
interpolated: the first that contains enough points is used. Chosen: a circle of radius 1.6 holds
some eight points of a grid, each further radius about twice as many, and points beyond 6 spacings
say little.
"""

WORST_SPREAD = 1e4
"""Greatest accepted condition number of the scaled normal equations of an interpolation; beyond it
the points are not spread enough to determine a linear function. Chosen: it costs four of sixteen
digits; points on one line have an infinite condition number.
"""

CENTERINGS = 3
"""Number of fits of the straight interface next to a point, each centered on the place that the
previous fit found. Chosen: the first fit is one-sided, the second is centered, and the third
corrects the place.
"""

REACH = 2
"""Radius, in horizons, about a place on an interface within which the motion of either side is
fitted; nearer points have greater weights.

With one horizon the fit depends on the three nearest rows, and a point's continued place does not
follow its own displacement: next to a material thirty times as stiff, bond forces then have no
equilibrium. With two, `bimaterial` is as accurate, and the solution converges for a material a
hundred times as stiff.
"""

TORN_REACH = 1.5
"""Radius in horizons, as `REACH`, of the fits on the two sides of an interface that is cut or
torn nearby.
"""

ROUND_REACH = 1.5
"""Radius in horizons, as `REACH`, for interfaces that are circles or spheres. Chosen: the force on
a strip around a disc of 5 cells' radius, three times as stiff as the strip, has an error of 0.2 %;
it was 0.5 % with `REACH`, since the function fitted is less accurate far from the place.
"""

FARTHEST = 1.5
"""Greatest distance, in horizons, at which an interface is assigned to a point. The point is bonded
to points beyond the interface, the nearest within one horizon; half a horizon more is room for
planes that are fitted obliquely.
"""

SIGHT = FARTHEST + REACH
"""Radius, in horizons, around a point of a body divided among ranks within which the rank must have
all points to compute the jump of the deformation gradient that belongs to the point.
"""

ASTRAY = 0.06
"""Greatest share of a horizon's volume on the wrong side of the plane fitted to an interface, for
the interface to count as straight; at a corner it is greater. Chosen: of some 30 points in a
horizon (3.15 spacings in the plane, 1.75 in three dimensions) one may lie on the wrong side and two
may not.
"""

SECTOR = 0.5
"""Sine of the greatest angle by which a point, seen from the place on an interface, may lie on the
other material's side of the fitted plane and still be used in the fit of the motion. Chosen: 30
degrees admit interfaces that curve or turn a little, and exclude material behind a thin layer.
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

WORST_CONDITION = 1e6
"""Greatest accepted condition number of a fit of the motion at an interface, with lengths in units
of the fit's radius. A layer of two rows of points leads to 1e3.
"""

LEAST_RADIUS = 1.5
"""Least radius, in spacings, of a circle or sphere on which depths and normals follow from its
center and not from the points.
"""

MOST_CURVED = 0.5
"""Greatest product of depth and curvature with which an image takes account of a curved interface.
Chosen: theory (62a) holds for small products; a disc of 5 cells' radius, whose products are up to
0.6, has the same error with all limits from 0.5 on.
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
    def nothing(cls, count: int, dimension: int) -> "Beside":
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


@dataclass(frozen=True)
class Fits:
    """Jumps of the deformation gradient at interfaces as linear functions of the positions of a
    body's n points.

    Attributes
    ----------
    depths, normals : ndarray, shapes (n,) and (n, d)
        Distance of every point from its interface, 0 where no jump is known, and direction to it.
    jumps : sparse array, shape (n, n)
        Weights of the positions in the jump of every point.
    images : sparse array, shape (n, n)
        For points that are images of softer material, the weights of deformation gradients in the
        change along the normal.
    apart : sparse array, shape (n, n)
        Weights as `jumps`, of fits to either side alone.
    growth : ndarray, shape (n,)
        Factor 1 + kappa d of theory (62a) of images, 1 elsewhere.
    """

    depths: np.ndarray
    normals: np.ndarray
    jumps: scipy.sparse.csr_array
    images: scipy.sparse.csr_array
    apart: scipy.sparse.csr_array
    growth: np.ndarray


def fitted_jumps(
    body: Body,
    portion_of: np.ndarray,
    moduli: np.ndarray,
    near: np.ndarray,
    quadratic: bool,
    volumes_held: bool,
    watched: bool,
) -> Fits:
    """Return the fits of the jumps at the interfaces beside the points `near`.

    `watched` is whether fits to either side alone are wanted; the other arguments are those of
    `Interfaces`.
    """
    n = len(body)
    modulus_of = np.zeros(portion_of.max() + 1)
    modulus_of[portion_of] = moduli
    beside = interfaces_beside(body, portion_of, moduli, near, quadratic)
    growth = np.ones(n)
    known = np.zeros(len(near), dtype=bool)
    places = body.points[near] + beside.depths[:, None] * beside.normals
    both = np.column_stack([portion_of[near], beside.others])
    places = _rounded(places, body.spacing)
    tree = scipy.spatial.cKDTree(body.points)
    stiff = quadratic & (moduli[near] > YIELDING * modulus_of[beside.others])
    found = beside.depths > 0

    # The jump of the slope is the same from either side: all fits at a place start from the
    # material of the lower number.
    rows = np.flatnonzero(found & ~stiff)
    upwards = np.where(both[:, 0] < both[:, 1], 1.0, -1.0)[:, None] * beside.normals
    keys = np.column_stack([places, upwards, np.sort(both, axis=1), beside.rounds])[rows]
    order = np.lexsort(keys.T)
    which = np.zeros(len(rows), dtype=np.int64)
    which[order[1:]] = np.cumsum((np.diff(keys[order], axis=0) != 0).any(axis=1))
    at = rows[np.unique(which, return_index=True)[1]]
    fits = []
    torn = []
    good = np.zeros(len(at), dtype=bool)
    sides = places[at], upwards[at], np.sort(both[at], axis=1), beside.rounds[at]
    for some, around, x, beyond, heights, volumes, reach in _two_sides(
        body, tree, portion_of, *sides
    ):
        entries, good[some] = _jump_of_slopes(x, volumes, heights * beyond, quadratic)
        fits.append((some, around, entries / reach))
        if watched:
            far = TORN_REACH * body.horizon
            torn.append(
                (
                    some,
                    around,
                    _jump_of_sides(x * (reach / far), volumes, upwards[at[some]], beyond) / far,
                )
            )
    known[rows] = good[which]
    rows = rows[good[which]]
    which = which[good[which]]
    chosen = scipy.sparse.csr_array((np.ones(len(rows)), (near[rows], which)), shape=(n, len(at)))
    jumps, apart = (chosen @ _matrix(parts, len(at), n) for parts in (fits, torn))

    odd = []
    images = []
    rows = np.flatnonzero(found & stiff)
    sides = places[rows], beside.normals[rows], both[rows], beside.rounds[rows]
    for some, around, x, beyond, _, volumes, reach in _two_sides(body, tree, portion_of, *sides):
        at = rows[some]
        own = (around == near[at, None]) & (volumes > 0)
        sizes = (
            beside.depths[at] / reach,
            body.spacing / reach,
        )
        entries, at_image, known[at] = _mirrored(
            (x, volumes, beyond), beside.normals[at], sizes, own, volumes_held
        )
        # Toward the center of a circle or sphere of stiff material the jump of the slope grows,
        # theory (62a).
        bent = known[at] * _bend(body, places[at], beside, at)
        growth[near[at]] += bent
        odd.append((near[at], around, (known[at] * (1 + bent))[:, None] * entries / reach))
        images.append((near[at], around, (known[at] * (1 + 2 * bent))[:, None] * (at_image - own)))
    depths = np.zeros(n)
    normals = np.zeros_like(body.points)
    depths[near] = known * beside.depths
    normals[near] = known[:, None] * beside.normals
    jumps = jumps + _matrix(odd, n, n)
    jumps.sort_indices()
    return Fits(depths, normals, jumps, _matrix(images, n, n), apart, growth)


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
    for some in _slabs(np.flatnonzero(found.depths == 0)):
        _find_planes(body, tree, portion_of, near, some, found)
    if quadratic:
        for some in _slabs(np.flatnonzero((found.depths == 0) | (found.astray > ASTRAY))):
            _find_softer(body, tree, portion_of, moduli, near, some, found)
    found.normals[:] = _rounded(found.normals, 1.0)
    return found


def _slabs(rows: np.ndarray) -> Iterator[np.ndarray]:
    """Yield numbers in parts of at most `SLAB`."""
    for start in range(0, len(rows), SLAB):
        yield rows[start : start + SLAB]


def _around(
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


def _matrix(
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]], count: int, n: int
) -> scipy.sparse.csr_array:
    """Return the matrix (count, n) whose rows are given in parts: the numbers (k,) of rows,
    their columns (k, m) and entries (k, m).
    """
    flat = [np.zeros((3, 0))]
    for rows, columns, entries in parts:
        row, place = np.nonzero(entries)
        flat.append(np.array([entries[row, place], rows[row], columns[row, place]]))
    entries, rows, columns = np.concatenate(flat, axis=1)
    found = scipy.sparse.csr_array(
        (entries, (rows.astype(np.int64), columns.astype(np.int64))), shape=(count, n)
    )
    found.sort_indices()
    return found


def _rounded(values: np.ndarray, unit: float) -> np.ndarray:
    """Return values rounded to multiples of `ROUNDED` units."""
    return np.round(values / (ROUNDED * unit)) * (ROUNDED * unit)


def _shapes(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Return the centers (k, d) and radii (k,) of the body's circles or spheres."""
    return np.array([each.center for each in body.rounds]).reshape(-1, body.dimension), np.array(
        [each.radius for each in body.rounds]
    )


def _bend(body: Body, places: np.ndarray, beside: Beside, rows: np.ndarray) -> np.ndarray:
    """Return kappa d of theory (62a) for the points `rows`, images beyond `places`; zero unless
    their interfaces are convex and large.
    """
    found = np.zeros(len(rows))
    (centers, radii) = _shapes(body)
    curved = np.flatnonzero(beside.rounds[rows] >= 0)
    which = beside.rounds[rows[curved]]
    of_curved = rows[curved]
    convex = ((places[curved] - centers[which]) * beside.normals[of_curved]).sum(axis=1) > 0
    large = np.array([each.divides(body.horizon) for each in body.rounds], dtype=bool)[which]
    bent = np.minimum((body.dimension - 1) * beside.depths[of_curved] / radii[which], MOST_CURVED)
    found[curved] = np.where(convex & large, bent, 0.0)
    return found


def _two_sides(
    body: Body,
    tree: scipy.spatial.cKDTree,
    portion_of: np.ndarray,
    places: np.ndarray,
    normals: np.ndarray,
    both: np.ndarray,
    rounds: np.ndarray,
) -> Iterator[tuple]:
    """Yield the points to which the motion is fitted at places on interfaces, for some of the
    places at a time.

    The items are the numbers (k,) of these places, the numbers of the points (k, m), their
    positions relative to the place in units of the radius of the fit (k, m, d), flags of those of
    the second of the materials `both`, toward which `normals` point, heights above the interface,
    volumes, which are zero where a point does not belong to the fit, and the radius. `tree` holds
    the points, not the ghosts; `rounds` are as in `Beside`.
    """
    centers, radii = _shapes(body)
    for curved, ratio in ((False, REACH), (True, ROUND_REACH)):
        reach = ratio * body.horizon
        for some in _slabs(np.flatnonzero((rounds >= 0) == curved)):
            around, there = _around(tree, places[some], reach * WITH_ROUNDING)
            kinds = portion_of[around]
            (first, second) = both[some].T[:, :, None]
            x = (body.points[around] - places[some, None]) / reach
            beyond = kinds == second
            heights = (x @ normals[some, :, None])[:, :, 0]
            if curved:
                center = centers[rounds[some]]
                radius = radii[rounds[some], None]
                outwards = np.sign(((places[some] - center) * normals[some]).sum(axis=1))[:, None]
                heights = (
                    outwards
                    * (np.linalg.norm(body.points[around] - center[:, None], axis=2) - radius)
                    / reach
                )
            # Beyond a thin layer or a gap there may be more of the same material, which does not
            # belong to this interface. A point at the place itself is on the interface, whatever
            # rounding says.
            there &= (
                np.where(beyond, -1.0, 1.0) * heights <= SECTOR * np.linalg.norm(x, axis=2) + NONE
            )
            there &= beyond | (kinds == first)
            yield (
                some,
                around,
                x,
                beyond,
                heights,
                np.where(there, body.volumes[around], 0.0),
                reach,
            )


def _find_rounds(
    body: Body, tree: scipy.spatial.cKDTree, portion_of: np.ndarray, near: np.ndarray, found: Beside
) -> None:
    """Find the circles or spheres next to the points `near` on which the material changes;
    `tree` holds points and ghosts.
    """
    (centers, radii) = _shapes(body)
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
    distances = _rounded(lengths - radii[which], body.spacing)
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
        around, there = _around(tree, places, body.horizon * WITH_ROUNDING)
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
    around, there = _around(tree, body.points[near[rows]], body.horizon * WITH_ROUNDING)
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


def _weights_of_value(
    values: np.ndarray, weights: np.ndarray, wanted: np.ndarray, worst: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights (b, k) with which values at points give a number of the function that fits
    them best, and whether each is known.

    Parameters
    ----------
    values : ndarray, shape (b, k, m)
        Values of the m functions of which the fitted one is the sum.
    weights : ndarray, shape (b, k)
    wanted : ndarray, shape (m,) or (b, m)
        Factors with which the coefficients of the functions are summed.
    worst : float
        Greatest accepted condition number, of Frobenius norms, of the normal equations.
    """
    if not len(values):
        return np.zeros_like(weights), np.zeros(0, dtype=bool)
    with np.errstate(invalid="ignore", divide="ignore"):
        second = (
            values.transpose(0, 2, 1)
            @ (weights[:, :, None] * values)
            / weights.sum(axis=1)[:, None, None]
        )
    good = np.linalg.cond(second, "fro") < worst
    found = np.zeros_like(weights)
    solved = np.linalg.solve(second[good], np.broadcast_to(wanted, second.shape[:2])[good, :, None])
    found[good] = (
        weights[good] * (values[good] @ solved)[:, :, 0] / weights[good].sum(axis=1, keepdims=True)
    )
    return found, good


def _jump_of_sides(
    x: np.ndarray, volumes: np.ndarray, normals: np.ndarray, beyond: np.ndarray
) -> np.ndarray:
    """Return weights as `_jump_of_slopes` does, of linear functions that are fitted to the two
    sides separately.

    They are zero if the points of either side do not determine a linear function. `beyond` flags
    the points of the other side.
    """
    weights = volumes * np.maximum(1 - (x * x).sum(axis=2), 0.0)
    values = np.dstack([np.ones_like(weights), x])
    wanted = np.column_stack([np.zeros(len(x)), normals])
    (theirs, one), (own, two) = (
        _weights_of_value(values, weights * side, wanted, WORST_CONDITION)
        for side in (beyond, ~beyond)
    )
    return (theirs - own) * (one & two)[:, None]


def _jump_of_slopes(
    x: np.ndarray, volumes: np.ndarray, beyond: np.ndarray, quadratic: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights (b, k) with which values at points give the jump of their slope along
    normals across b interfaces.

    The jump belongs to the continuous function that fits the values best. On either side this
    function is quadratic if `quadratic` is True and the points determine it, or else linear. The
    second array returned flags the places where they determine a linear function; weights elsewhere
    are zero.

    Parameters
    ----------
    x : ndarray, shape (b, k, d)
        Positions of the points relative to a place on the interface, in units of the radius of the
        fit.
    volumes : ndarray, shape (b, k)
    beyond : ndarray, shape (b, k)
        Distances from the interface of points beyond it, zero for others.
    quadratic : bool
    """
    d = x.shape[2]
    weights = volumes * np.maximum(1 - (x * x).sum(axis=2), 0.0)
    curved = [x[:, :, a] * x[:, :, b] for a in range(d) for b in range(a + 1)]
    values = np.dstack([beyond, np.ones_like(beyond), x, *curved, beyond[:, :, None] * x])
    found = np.zeros_like(weights)
    good = np.zeros(len(x), dtype=bool)
    for count in (values.shape[2], 2 + d) if quadratic else (2 + d,):
        left = np.flatnonzero(~good)
        found[left], good[left] = _weights_of_value(
            values[left, :, :count], weights[left], np.eye(count)[0], WORST_CONDITION
        )
    return found, good


def _mirrored(
    at: tuple[np.ndarray, np.ndarray, np.ndarray],
    normals: np.ndarray,
    sizes: tuple[np.ndarray, float],
    own: np.ndarray,
    by_gradient: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the weights (b, k) with which values at points give the jumps that make stiff points
    odd mirror images of softer material.

    Like the images of a clamp, theory (22), such images continue the stress of the softer material
    undisturbed up to a nearly undeformed stiff material. The second array returned holds the
    weights with which values at the softer points give the value at the mirrored place, the third
    flags the places where the points determine the values at the interface and at the mirrored
    place.

    Parameters
    ----------
    at : tuple of ndarray
        Positions of the points relative to the places on the interface (b, k, d), their volumes (b,
        k), and flags of the softer ones.
    normals : ndarray, shape (b, d)
    sizes : tuple
        Distances (b,) of the stiff points to the interface, and spacing, in the unit of the
        positions.
    own : ndarray of bool, shape (b, k)
        True at the stiff points themselves.
    by_gradient : bool
        Whether the deformed place on the interface follows from the stiff point and its gradient;
        the weights then omit the gradient's term.
    """
    (x, volumes, beyond) = at
    (depths, spacing) = sizes
    mirrored, good = _interpolation(x, volumes * beyond, depths[:, None] * normals, spacing)
    if by_gradient:
        return (mirrored - own) / depths[:, None], mirrored, good
    at_interface, known = _interpolation(x, volumes * ~beyond, np.zeros_like(normals), spacing)
    return (mirrored + own - 2 * at_interface) / depths[:, None], mirrored, good & known


def _interpolation(
    x: np.ndarray, volumes: np.ndarray, places: np.ndarray, spacing: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return weights (b, k) that interpolate values at points `x` (b, k, d) to places (b, d),
    exactly for linear functions.

    They belong to the nearest points with volumes (b, k). The second array returned flags the
    places where points within the greatest radius of `NEAREST` spacings determine a linear
    function.
    """
    arms = (x - places[:, None]) / spacing
    distances = np.linalg.norm(arms, axis=2)
    found = np.zeros_like(volumes)
    good = np.zeros(len(x), dtype=bool)
    for reach in NEAREST:
        # A point at the place itself has all the weight.
        weights = volumes * np.maximum(1 - distances / reach, 0.0) ** 2 / (distances**2 + 1e-8)
        left = np.flatnonzero(~good & (np.count_nonzero(weights, axis=1) > x.shape[2]))
        weights = weights[left]
        values = np.dstack([np.ones_like(weights), arms[left]])
        squares = (weights[:, :, None] * values**2).sum(axis=1, keepdims=True) / weights.sum(
            axis=1
        )[:, None, None]
        values /= np.sqrt(np.maximum(squares, 1e-300))
        found[left], good[left] = _weights_of_value(
            values, weights, np.eye(1 + x.shape[2])[0], WORST_SPREAD
        )
    return found, good
