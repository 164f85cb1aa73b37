"""Weights with which positions give the jumps of the deformation gradient at interfaces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from ..body import Body
from ..body.ghosts import WITH_ROUNDING
from .interface_search import (
    FARTHEST,
    NONE,
    YIELDING,
    Beside,
    interfaces_beside,
    points_around,
    round_shapes,
    rounded,
    slabs,
)

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


SIGHT = FARTHEST + REACH
"""Radius, in horizons, around a point of a body divided among ranks within which the rank must have
all points to compute the jump of the deformation gradient that belongs to the point.
"""


SECTOR = 0.5
"""Sine of the greatest angle by which a point, seen from the place on an interface, may lie on the
other material's side of the fitted plane and still be used in the fit of the motion. Chosen: 30
degrees admit interfaces that curve or turn a little, and exclude material behind a thin layer.
"""


WORST_CONDITION = 1e6
"""Greatest accepted condition number of a fit of the motion at an interface, with lengths in units
of the fit's radius. A layer of two rows of points leads to 1e3.
"""


MOST_CURVED = 0.5
"""Greatest product of depth and curvature with which an image takes account of a curved interface.
Chosen: theory (62a) holds for small products; a disc of 5 cells' radius, whose products are up to
0.6, has the same error with all limits from 0.5 on.
"""


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
    places = rounded(places, body.spacing)
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


def _bend(body: Body, places: np.ndarray, beside: Beside, rows: np.ndarray) -> np.ndarray:
    """Return kappa d of theory (62a) for the points `rows`, images beyond `places`; zero unless
    their interfaces are convex and large.
    """
    found = np.zeros(len(rows))
    centers, radii = round_shapes(body)
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
    centers, radii = round_shapes(body)
    for curved, ratio in ((False, REACH), (True, ROUND_REACH)):
        reach = ratio * body.horizon
        for some in slabs(np.flatnonzero((rounds >= 0) == curved)):
            around, there = points_around(tree, places[some], reach * WITH_ROUNDING)
            kinds = portion_of[around]
            first, second = both[some].T[:, :, None]
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
    x, volumes, beyond = at
    depths, spacing = sizes
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
