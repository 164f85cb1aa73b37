"""Gradients with which a uniform stress exerts the boundary's load on every point of a body (theory (78)-(80))."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from ..body import Body, rows_of
from ..body.body import lengths_of
from ..body.ghosts import symmetric
from ..ranks.share import connected
from .fourth_order import solution_of
from .kinematics import THINNEST, sums_of_products

if TYPE_CHECKING:
    from .bond_shares import BondShares
    from .kinematics import Kinematics

REACH = 2.3
"""Greatest length, in spacings, of a bond whose weight changes. Chosen: the bonds beyond it, half of those at a horizon of 3.15, hardly
make the changes smaller; with 1.6 spacings the changes are up to four times the weights."""

FEW = 4
"""Number of bonds within `REACH`, divided by the dimension, below which all bonds of a point change. Chosen: a point in the corner of a
square lattice has 7 within `REACH`."""


def balanced_changes(kinematics: Kinematics, shares: BondShares, portion_of: np.ndarray | None) -> tuple[np.ndarray, np.ndarray] | None:
    """Return numbers of directed bonds and the changes (k, d) of their weights in the deformation gradients of their first points.

    Gradients remain exact for affine motions. Among the changes with which the force of a uniform stress on every point is the load of the
    boundary on it, `Body.outward`, the least ones are chosen (`_least_changes`). On a lattice the points within a horizon of those on
    which the boundary acts have changes, otherwise all points; but none within two horizons of an interface between materials
    (`portion_of`) or of a cut that `Body.outward` does not contain, and none that see images beyond a curved held boundary, or in the
    corner of a clamp and a free side beyond the clamp.
    None is returned for a body that does not know its boundary.
    """
    body, d = kinematics.body, kinematics.body.dimension
    if body.outward is None:
        return None
    bonds, share, ghosts, n, owners = body.bonds, body.share, body.ghosts, len(body), body.bond_owners
    regular = body.mesh_cells is None and not body.relaxed
    at_sides = beside(body, np.abs(body.outward).max(axis=1) > 0)
    left_out = beside(body, ends_of_unknown(body, portion_of))
    left_out |= _sees(body, [plane.axis is None for plane in body.planes])
    # Beyond a clamp gradients continue otherwise than displacements do, and the corners of clamps and free sides are not homogeneous.
    left_out |= sees_clamps(body) & at_sides
    share.fill(left_out)
    chosen = at_sides if regular else np.ones(n, dtype=bool)
    chosen &= (kinematics.supported[:n] > 0) & ~left_out
    if not share.any(chosen.any()):
        return None
    reached = beside(body, chosen)
    factors, loads = _factors_and_loads(kinematics, shares, reached)
    loads[left_out] = np.nan

    numbers = np.flatnonzero(chosen[owners])
    owner, ends = owners[numbers], bonds.neighbors[numbers]
    vectors = (body.all_points[ends] - body.points[owner]) / body.spacing
    near = lengths_of(vectors) <= REACH
    count = np.bincount(owner[near], minlength=n)
    share.fill(count)
    near |= (count < FEW * d)[owner]
    numbers, owner, ends, vectors = numbers[near], owner[near], ends[near], vectors[near]
    signs = np.vstack([np.ones((n, d)), ghosts.reflection])[ends]
    arrays = share.numbers[owner], body.names[ends] % share.size, signs, vectors
    places = np.arange(len(numbers))
    if share.divided:
        places = rows_of(body, "bonds").numbers[numbers]
        order = np.argsort(np.concatenate(share.everywhere(places[share.own[owner]])))
        arrays = tuple(share.joined(each, owner)[order] for each in arrays)
        whole = np.sort(np.concatenate(share.everywhere(places[share.own[owner]])))
        places = np.searchsorted(whole, places)
    *of_points, points = [share.gather(values) for values in (factors, loads, body.points)]
    # Far from the origin, points divided by the spacing would differ by other vectors than those between them.
    changes = _least_changes(*arrays, *of_points, (points - points[0]) / body.spacing) if share.leads else None
    changes = share.ranks.to_all(changes)[places]
    return numbers, changes


def beside(body: Body, flags: np.ndarray) -> np.ndarray:
    """Return flags of the points (n,) that are flagged, or have a bond to a flagged point or to an image of one."""
    found, bonds, sources = flags.copy(), body.bonds, np.concatenate([np.arange(len(body)), body.ghosts.source])
    body.share.fill(found)
    every = found[sources]
    found[bonds.first[every[bonds.second]]] = True
    found[sources[bonds.second[every[bonds.first]]]] = True
    body.share.fill(found)
    return found


def _sees(body: Body, planes: list[bool]) -> np.ndarray:
    """Return flags of the points (n,) that have images beyond chosen planes, or other boundaries, as neighbors."""
    images, found = np.array([*planes, False])[body.ghosts.plane], np.zeros(len(body), dtype=bool)
    found[body.bond_owners[np.concatenate([found, images])[body.bonds.neighbors]]] = True
    return found


def sees_clamps(body: Body) -> np.ndarray:
    """Return flags of the points (n,) that have images beyond clamped planes as neighbors."""
    return _sees(body, [plane.axis is not None and max(plane.parity) < 0 for plane in body.planes])


def ends_of_unknown(body: Body, portion_of: np.ndarray | None) -> np.ndarray:
    """Return flags of the points (n,) with bonds to another material, or of which a cut that `Body.outward` does not contain took bonds."""
    found, bonds = np.zeros(len(body.all_points), dtype=bool), body.bonds
    loaded = np.abs(body.outward).max(axis=1) > 0
    loaded = np.concatenate([loaded, loaded[body.ghosts.source]])
    cut = bonds.cut[~loaded[bonds.cut].all(axis=1)]
    found[cut] = True
    if portion_of is not None:
        across = portion_of[bonds.first] != portion_of[bonds.second]
        found[bonds.first[across]] = found[bonds.second[across]] = True
    np.logical_or.at(found, body.ghosts.source, found[len(body) :])
    found = found[: len(body)]
    body.share.fill(found)
    return found


def _factors_and_loads(kinematics: Kinematics, shares: BondShares, reached: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return B (n, d, d) of (80), and the loads a - g (n, d) that changes must exert, on points that are `reached`."""
    body, bonds, n, d = kinematics.body, kinematics.body.bonds, len(kinematics.body), kinematics.body.dimension
    sources, around, owners = kinematics.sources, beside(body, reached), body.bond_owners
    signs = np.vstack([np.ones((n, d)), body.ghosts.reflection])
    pairs = np.flatnonzero(around[bonds.first] | around[sources[bonds.second]])
    first, second, volumes = bonds.first[pairs], bonds.second[pairs], shares.weights_of(pairs)
    along = body.all_points[second] - body.all_points[first]
    length = lengths_of(along)
    along /= length[:, None]
    factors, loads = np.zeros((n, d, d)), body.outward.copy()
    for ends in (first, second):
        for a, b in np.ndindex(d, d):
            across = (0.5 * volumes) * (float(a == b) - along[:, a] * along[:, b])
            factors[:, a, b] += np.bincount(sources[ends], signs[ends, a] * signs[ends, b] * across, n)
    body.share.fill(factors)
    numbers = np.flatnonzero(around[owners])
    owner, ends = owners[numbers], bonds.neighbors[numbers]
    inverse = symmetric(kinematics.inverse_shape)[owner]
    weights = np.einsum("bij,bjk,bk->bi", factors[owner], inverse, kinematics.weighted_bonds[numbers])
    pull = (volumes / length)[:, None] * along
    for sign, points, forces in ((1, first, pull), (-1, second, pull), (1, owner, weights), (-1, ends, weights)):
        for a in range(d):
            loads[:, a] += sign * np.bincount(sources[points], signs[points, a] * forces[:, a], n)
    return factors, loads


def _least_changes(owners, ends, signs, vectors, factors, loads, points) -> np.ndarray:
    """Return the least changes (k, d) of bonds that exert the `loads` (n, d) on the points, where changes reach and loads are not NaN.

    The bonds from `owners` to `ends`, sorted by owner, have undeformed `vectors` (k, d) in spacings; `signs` are the reflections of ends
    that are images. The change c of a bond exerts the force B c on its end, and the opposite force on its owner, where
    B (n, d, d) are the owners' `factors`. The changes have the least sum of squares of B c/b, with the mean eigenvalue b of B: each
    component of B c then has equations of its own, and their matrices differ in the signs of images alone.
    """
    n, d = loads.shape
    count, changes = len(owners), np.zeros(vectors.shape)
    moments = sums_of_products(owners, vectors, vectors, n)
    means = np.einsum("nii->n", factors) / d
    thin = np.linalg.eigvalsh(moments)[:, 0] <= THINNEST * np.trace(moments, axis1=1, axis2=2)
    weights = np.where(thin, 0.0, means / means[~thin].mean())
    moments[thin] = np.eye(d)
    roots = np.linalg.cholesky(np.linalg.inv(moments))
    of_owner, places = weights[owners], np.arange(count)
    for components in _alike(signs):
        sign = signs[:, components[0]]
        entries = np.concatenate([of_owner * sign, -of_owner]), (np.tile(places, 2), np.concatenate([ends, owners]))
        differences = scipy.sparse.csr_array(entries, shape=(count, n))
        affine = [scipy.sparse.csr_array((vectors[:, a], (owners, places)), shape=(n, count)) @ differences for a in range(d)]
        slopes = [sum(scipy.sparse.diags_array(roots[:, a, b]) @ affine[a] for a in range(d)) for b in range(d)]
        matrix = (differences.T @ differences - sum(each.T @ each for each in slopes)).tocsr()
        pieces = connected(n, owners, ends)[1]
        wanted = loads[:, components] / means[~thin].mean()
        found = solution_of(matrix, wanted, points, pieces)
        moved = differences @ found
        # Projection onto changes that keep the gradients of affine motions: their sum over a point's bonds, times the vectors, vanishes.
        fits = np.linalg.solve(moments, sums_of_products(owners, vectors, moved, n))
        moved -= np.einsum("ba,bac->bc", vectors, fits[owners])
        changes[:, components] = moved
    factors = np.where(thin[:, None, None], np.eye(d), factors / np.where(means == 0, 1.0, means)[:, None, None])
    return np.where(thin[owners, None], 0.0, np.linalg.solve(factors[owners], changes[:, :, None])[:, :, 0])


def _alike(signs: np.ndarray) -> list[list[int]]:
    """Return the components in groups with the same signs (k, d) of all bonds."""
    columns = [column.tobytes() for column in signs.T]
    return [[number for number, each in enumerate(columns) if each == column] for column in dict.fromkeys(columns)]
