"""Gradients with which a uniform stress exerts the boundary's load on every point of a body
(theory (78)-(80)).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from ..body import Body, rows_of
from ..body.body import lengths_of
from ..body.ghosts import symmetric
from ..engine.block_arrays import aligned_rows
from ..kernels.ghosts import fold_vectors
from ..ranks.share import connected
from .changed_weights import moments_of, sums_of_products
from .fourth_order import solution_of
from .interface_search import YIELDING
from .kinematics import matrices
from .steps import Steps

if TYPE_CHECKING:
    from .binding import Binding
    from .bond_shares import BondShares

REACH = 2.3
"""Greatest length, in spacings, of a bond whose weight changes. Chosen: the bonds beyond it, half
of those at a horizon of 3.15, hardly make the changes smaller; with 1.6 spacings the changes are up
to four times the weights.
"""

FEW = 4
"""Number of bonds within `REACH`, divided by the dimension, below which all bonds of a point
change. Chosen: a point in the corner of a square lattice has 7 within `REACH`.
"""

DEFINITE = 0.25
"""Least eigenvalue of the factor B of a point beside an interface, relative to the mean one, with
which its bonds change. Chosen: it is 0.37 and more beside boundaries, and negative where images of
a much softer material follow the gradient of the point.
"""


def balanced_changes(
    binding: Binding, shares: BondShares | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return numbers of directed bonds, the changes (k, d) of their weights in the gradients of
    their first points, and their functions.

    The energy depends on gradients of pairs with the volumes of `shares`, or else on those of the
    points. Gradients remain exact for affine motions, and for continuous motions that are affine on
    either side of an interface: the sums of the products of the changes with each of the functions
    (k, d or d + 1) vanish. Among the changes with which the force of a uniform stress on every
    point is the load of the boundary on it, `Body.outward`, the least ones are chosen
    (`_least_changes`). On a lattice the points within a horizon of those on which the boundary acts
    have changes, otherwise all points; but none within a horizon of a point that a cut which
    `Body.outward` does not contain separates, and none that see images beyond a curved held
    boundary, or in the corner of a clamp and a free side beyond the clamp. Points within two
    horizons of an interface have changes if the body is `Body.loaded`. None is returned for a body
    that does not know its boundary.
    """
    kinematics = binding.kinematics
    portion_of = binding.portion_of
    body = kinematics.body
    d = kinematics.body.dimension
    if body.outward is None:
        return None
    bonds = body.bonds
    share = body.share
    ghosts = body.ghosts
    n = len(body)
    owners = body.bond_owners
    regular = body.mesh_cells is None and not body.relaxed
    at_sides = beside(body, np.abs(body.outward).max(axis=1) > 0)
    unknown = ends_of_unknown(body)
    clamped = sees_clamps(body)
    pairs = _pairs_across(body, portion_of)
    across = _ends_of(body, np.stack([bonds.first[pairs], bonds.second[pairs]], axis=1))
    several = body.loaded and share.any(len(pairs) > 0)
    if several:
        at_sides |= beside(body, across)
        across &= beside(body, clamped)
    left_out = beside(body, unknown | across)
    left_out |= _sees(body, [plane.axis is None for plane in body.planes])
    # Beyond a clamp gradients continue otherwise than displacements do, and the corners of clamps
    # and free sides are not homogeneous.
    left_out |= clamped & at_sides
    share.fill(left_out)
    chosen = at_sides if regular else np.ones(n, dtype=bool)
    chosen &= (kinematics.supported[:n] > 0) & ~left_out
    factors, loads = _factors_and_loads(
        binding,
        shares,
        beside(body, chosen | at_sides),
        pairs if several and shares else None,
    )
    loads[left_out] = np.nan
    stiff = np.ones(n)
    if several:
        moduli = np.array([*(portion.law.shear_modulus for portion in binding.portions), np.inf])
        # Changes in stiff materials store more energy. In steps, so that derivatives by moduli
        # leave the changes as they are.
        stiff = np.exp2(np.floor(np.log2(16 * moduli / moduli.min() / YIELDING) / 2))[
            portion_of[:n]
        ]
        loads[np.isinf(stiff)] = np.nan
        least = np.linalg.eigvalsh(factors + factors.transpose(0, 2, 1))[:, 0] / 2
        chosen &= np.isfinite(stiff) & (least >= DEFINITE * np.einsum("nii->n", factors) / d)

    changing = chosen[owners]
    if several:
        changing[kinematics.interfaces.left_out] = False
    numbers = np.flatnonzero(changing)
    if not share.any(len(numbers) > 0):
        return None
    owner = owners[numbers]
    ends = bonds.neighbors[numbers]
    vectors = (body.all_points[ends] - body.points[owner]) / body.spacing
    near = lengths_of(vectors) <= REACH
    count = np.bincount(owner[near], minlength=n)
    share.fill(count)
    near |= (count < FEW * d)[owner]
    numbers = numbers[near]
    owner = owner[near]
    ends = ends[near]
    vectors = vectors[near]
    if several:
        beyond = np.where(
            portion_of[ends] != portion_of[owner], kinematics.interfaces.depths[ends], 0.0
        )
        squares, of_vectors = (
            np.bincount(owner, values, n) for values in (beyond**2, (vectors**2).sum(axis=1) / d)
        )
        # As large as the vectors, so that functions which the bonds do not tell apart are
        # recognized.
        beyond *= np.sqrt(of_vectors / np.where(squares > 0, squares, 1.0))[owner]
        vectors = np.column_stack([vectors, beyond])
    signs = np.vstack([np.ones((n, d)), ghosts.reflection])[ends]
    arrays = share.numbers[owner], body.names[ends] % share.size, signs, vectors
    places = np.arange(len(numbers))
    if share.divided:
        places = rows_of(body, "bonds").numbers[numbers]
        order = np.argsort(np.concatenate(share.everywhere(places[share.own[owner]])))
        arrays = tuple(share.joined(each, owner)[order] for each in arrays)
        whole = np.sort(np.concatenate(share.everywhere(places[share.own[owner]])))
        places = np.searchsorted(whole, places)
    at_ends = np.abs(body.outward).max(axis=1) > 0
    at_ends[ghosts.source] = True
    *of_points, points = [
        share.gather(values) for values in (factors, loads, stiff, at_ends, body.points)
    ]
    # Far from the origin, points divided by the spacing would differ by other vectors than those
    # between them.
    changes = (
        _least_changes(arrays, *of_points, (points - points[0]) / body.spacing)
        if share.is_first
        else None
    )
    changes = share.ranks.to_all(changes)[places]
    return numbers, changes, vectors


def beside(body: Body, flags: np.ndarray) -> np.ndarray:
    """Return flags of the points (n,) that are flagged, or have a bond to a flagged point or to
    an image of one.
    """
    found = flags.copy()
    bonds = body.bonds
    sources = np.concatenate([np.arange(len(body)), body.ghosts.source])
    body.share.fill(found)
    every = found[sources]
    found[bonds.first[every[bonds.second]]] = True
    found[sources[bonds.second[every[bonds.first]]]] = True
    body.share.fill(found)
    return found


def _sees(body: Body, planes: list[bool]) -> np.ndarray:
    """Return flags of the points (n,) that have images beyond chosen planes, or other
    boundaries, as neighbors.
    """
    images = np.array([*planes, False])[body.ghosts.plane]
    found = np.zeros(len(body), dtype=bool)
    found[body.bonds.first[np.concatenate([found, images])[body.bonds.second]]] = True
    return found


def sees_clamps(body: Body) -> np.ndarray:
    """Return flags of the points (n,) that have images beyond clamped planes as neighbors."""
    return _sees(body, [plane.axis is not None and max(plane.parity) < 0 for plane in body.planes])


def ends_of_unknown(body: Body) -> np.ndarray:
    """Return flags of the points (n,) of which a cut that `Body.outward` does not contain took
    bonds.
    """
    loaded = np.abs(body.outward).max(axis=1) > 0
    loaded = np.concatenate([loaded, loaded[body.ghosts.source]])
    cut = body.bonds.cut
    return _ends_of(body, cut[~loaded[cut].all(axis=1)])


def _ends_of(body: Body, pairs: np.ndarray) -> np.ndarray:
    """Return flags of the points (n,) that are ends of pairs (k, 2) of points and images, or
    mirrored by such ends.
    """
    found = np.zeros(len(body), dtype=bool)
    found[np.concatenate([np.arange(len(body)), body.ghosts.source])[pairs]] = True
    body.share.fill(found)
    return found


def _pairs_across(body: Body, portion_of: np.ndarray | None) -> np.ndarray:
    """Return the numbers of the pairs of two materials, or of a material and a rigid part."""
    return np.flatnonzero(
        [] if portion_of is None else portion_of[body.bonds.first] != portion_of[body.bonds.second]
    )


def _factors_and_loads(
    binding: Binding, shares: BondShares | None, reached: np.ndarray, across: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return B (n, d, d) of (80), and the loads a - g (n, d) that changes must exert, on points
    that are `reached`.

    With numbers of the pairs `across` interfaces, they are those of energies that depend on the
    jumps there. Without `shares` the energy of a point follows from its own gradient.
    """
    kinematics = binding.kinematics
    body = binding.kinematics.body
    bonds = binding.kinematics.body.bonds
    sources = kinematics.sources
    around = beside(body, reached)
    owners = body.bond_owners
    n, d = body.points.shape
    signs = np.vstack([np.ones((n, d)), body.ghosts.reflection])
    loads = body.outward.copy()
    pulls = []
    if shares is None:
        factors = body.volumes[:, None, None] * np.eye(d)
    else:
        deformable = None
        if across is not None:
            deformable = binding.portion_of[owners] < len(binding.portions)
        pairs = np.flatnonzero(around[bonds.first] | around[sources[bonds.second]])
        both = bonds.first[pairs], bonds.second[pairs]
        volumes = shares.weights_of(pairs, deformable)
        along = body.all_points[both[1]] - body.all_points[both[0]]
        length = lengths_of(along)
        along /= length[:, None]
        pull = (volumes / length)[:, None] * along
        pulls = [(1, both[0], pull), (-1, both[1], pull)]
        factors = np.zeros((n, d, d))
        for ends in both:
            for a, b in np.ndindex(d, d):
                transverse = (0.5 * volumes) * (float(a == b) - along[:, a] * along[:, b])
                factors[:, a, b] += np.bincount(
                    sources[ends], signs[ends, a] * signs[ends, b] * transverse, n
                )
        body.share.fill(factors)
        if across is not None:
            loads += _through_jumps(binding, shares, across, factors)
    numbers = np.flatnonzero(around[owners])
    owner = owners[numbers]
    ends = bonds.neighbors[numbers]
    inverse = symmetric(kinematics.inverse_shape)[owner]
    of_bonds = kinematics.weighted_bonds[kinematics.places_of(numbers, owner)]
    weights = np.einsum("bij,bjk,bk->bi", factors[owner], inverse, of_bonds)
    for sign, points, forces in (*pulls, (1, owner, weights), (-1, ends, weights)):
        for a in range(d):
            loads[:, a] += sign * np.bincount(sources[points], signs[points, a] * forces[:, a], n)
    return factors, loads


def _through_jumps(
    binding: Binding, shares: BondShares, pairs: np.ndarray, factors: np.ndarray
) -> np.ndarray:
    """Return the forces (n, d) that a unit tension exerts through the jumps at interfaces,
    crossed by `pairs`; add to the `factors` B.
    """
    kinematics = binding.kinematics
    portion_of = binding.portion_of
    body = kinematics.body
    n, d = kinematics.body.points.shape
    total = len(kinematics.positions)
    forces = np.zeros((total, d))
    moments = np.zeros((total, d * d))
    pulls = np.zeros((total, d))
    on_points = np.zeros((n, d))
    own_moments = aligned_rows((n, d * d))
    own_moments[:] = factors.reshape(n, d * d)  # they are symmetric
    both = (body.bonds.first[pairs], body.bonds.second[pairs])
    owners = portion_of[body.bond_owners]
    along = body.all_points[both[1]] - body.all_points[both[0]]
    length = lengths_of(along)[:, None]
    along /= length
    transverse = 0.5 * (np.eye(d) - along[:, :, None] * along[:, None]).reshape(-1, d * d)
    for number in range(len(binding.portions)):
        volumes = shares.weights_of(pairs, owners == number)
        for sign, ends in zip((1, -1), both, strict=True):
            seen = (volumes * (portion_of[ends] != number))[:, None]
            np.add.at(forces, ends, sign * seen / length * along)
            np.add.at(moments, ends, seen * transverse)
    ghosts = body.ghosts
    Steps(
        body.share,
        *kinematics.interfaces.steps_back(forces, moments, own_moments, on_points),
        *(step for each in kinematics.changed for step in each.pull_steps(own_moments, pulls)),
        kinematics.bind(fold_vectors, pulls, ghosts.source, ghosts.parity),
    )()
    factors[:] = matrices(own_moments)
    return on_points + pulls[:n]


def _least_changes(
    bonds: tuple[np.ndarray, ...], factors, loads, stiff, at_ends, points
) -> np.ndarray:
    """Return the least changes (k, d) of bonds that exert the `loads` (n, d) on the points, where
    changes reach and loads are not NaN.

    The `bonds`, sorted by owner, are given by their owners and ends, the reflections of ends that
    are images, and their undeformed vectors (k, d) in spacings, beside interfaces with one more
    function that changes must not see. The change c of a bond exerts the force B c on its end, and
    the opposite force on its owner, where B (n, d, d) are the owners' `factors`. The changes have
    the least sum of squares of s B c/b, with the mean eigenvalue b of B and the owner's number s in
    `stiff`: each component of B c then has equations of its own, and their matrices differ in the
    signs of images alone. `at_ends` flags the points where interfaces may end.
    """
    owners, ends, signs, vectors = bonds
    n, d = loads.shape
    count = len(owners)
    changes = np.zeros((len(owners), d))
    functions = range(vectors.shape[1])
    moments, thin = moments_of(owners, vectors, d, n)
    means = np.einsum("nii->n", factors) / d
    weights = np.where(thin, 0.0, means / means[~thin].mean()) / stiff
    roots = np.linalg.cholesky(np.linalg.inv(moments))
    of_owner = weights[owners]
    places = np.arange(count)
    # Changes do not see kinks along straight interfaces, which end at the boundary; around a piece
    # inside there is none.
    within = ~vectors[:, d:].any(axis=1)
    _, pieces = connected(n, owners[within], ends[within])
    inside = ~np.isin(pieces, pieces[at_ends])
    within |= inside[owners] | inside[ends]
    _, pieces = connected(n, owners[within], ends[within])
    for components in _alike(signs):
        sign = signs[:, components[0]]
        entries = (
            np.concatenate([of_owner * sign, -of_owner]),
            (
                np.tile(places, 2),
                np.concatenate([ends, owners]),
            ),
        )
        differences = scipy.sparse.csr_array(entries, shape=(count, n))
        affine = [
            scipy.sparse.csr_array((vectors[:, a], (owners, places)), shape=(n, count))
            @ differences
            for a in functions
        ]
        slopes = [
            sum(scipy.sparse.diags_array(roots[:, a, b]) @ affine[a] for a in functions)
            for b in functions
        ]
        matrix = (differences.T @ differences - sum(each.T @ each for each in slopes)).tocsr()
        wanted = loads[:, components] / means[~thin].mean()
        found = solution_of(matrix, wanted, points, pieces)
        moved = differences @ found
        # Projection onto changes that keep the gradients of affine motions: their sum over a
        # point's bonds, times the functions, vanishes.
        fits = np.linalg.solve(moments, sums_of_products(owners, vectors, moved, n))
        moved -= np.einsum("ba,bac->bc", vectors, fits[owners])
        changes[:, components] = moved / stiff[owners, None]
    factors = np.where(
        thin[:, None, None], np.eye(d), factors / np.where(means == 0, 1.0, means)[:, None, None]
    )
    return np.where(
        thin[owners, None], 0.0, np.linalg.solve(factors[owners], changes[:, :, None])[:, :, 0]
    )


def _alike(signs: np.ndarray) -> list[list[int]]:
    """Return the components in groups with the same signs (k, d) of all bonds."""
    columns = [column.tobytes() for column in signs.T]
    return [
        [number for number, each in enumerate(columns) if each == column]
        for column in dict.fromkeys(columns)
    ]
