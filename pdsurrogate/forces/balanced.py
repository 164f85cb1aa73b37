"""Gradients beside free boundaries with which a uniform stress exerts the boundary's load on every point (theory (78)-(80))."""

from __future__ import annotations

import numpy as np
import scipy

from ..body import Body, rows_of
from .bond_shares import BondShares
from .kinematics import Kinematics

REGULARIZATION = 1e-9
"""Fraction of the mean diagonal entry of the equations for the changes that is added to their diagonal. Translations and linear motions of
the whole boundary make them singular. Chosen far above rounding and far below the stiffness of the longest waves along a boundary, so that
each of the `REFINEMENTS` reduces the error by a thousand or more."""

REFINEMENTS = 4
"""Number of corrections of the solution; two or three reach rounding."""


def balanced_changes(body: Body) -> np.ndarray:
    """Return the changes of the weights of directed bonds in the deformation gradients of their first points, shape (n_bonds, d).

    Gradients remain exact for affine motions. Among the changes with which the force of a uniform stress on every point is the load of the
    boundary on it, `Body.outward`, those of the least sum of squares are chosen. They are zero for points farther than a horizon from those
    on which the boundary acts, and where images beyond curved held boundaries are neighbors.

    Raises
    ------
    ValueError
        If the body does not know its boundary.
    """
    if body.outward is None:
        raise ValueError("correction=balanced needs the boundary of the body, Body.outward; use a scene, or correction=none")
    kinematics, bonds, share, n, d = Kinematics(body, "float64"), body.bonds, body.share, len(body), body.dimension
    owners, ends, ghosts, supported = body.bond_owners, bonds.neighbors, body.ghosts, kinematics.supported[: len(body)] > 0
    weights = kinematics.gradient_weights(kinematics.weighted_bonds, kinematics.inverse_shape)
    volumes = BondShares(kinematics, "float64").weights_of()
    vectors = body.all_points[bonds.second] - body.all_points[bonds.first]
    length = np.linalg.norm(vectors, axis=1)[:, None]
    along, signs = vectors / length, np.vstack([np.ones((n, d)), ghosts.reflection])
    sources = kinematics.sources
    across = 0.5 * volumes[:, None, None] * (np.eye(d) - along[:, :, None] * along[:, None])
    factors, loads = np.zeros((n, d, d)), body.outward.copy()
    for points in (bonds.first, bonds.second):
        np.add.at(factors, sources[points], signs[points][:, :, None] * across * signs[points][:, None])
    share.fill(factors)
    for points, forces in (
        (bonds.first, -volumes[:, None] * along / length),
        (bonds.second, volumes[:, None] * along / length),
        (owners, -np.einsum("bij,bj->bi", factors[owners], weights)),
        (ends, np.einsum("bij,bj->bi", factors[owners], weights)),
    ):
        np.subtract.at(loads, sources[points], signs[points] * forces)

    loaded = np.abs(body.outward).max(axis=1) > 0
    chosen = supported & (scipy.spatial.cKDTree(body.points[loaded]).query(body.points)[0] <= body.horizon) if loaded.any() else loaded
    curved = np.array([*(plane.axis is None for plane in body.planes), False])
    beside = owners[np.concatenate([np.zeros(n, dtype=bool), curved[ghosts.plane]])[ends]]
    chosen[beside], loads[beside] = False, 0.0
    rows = rows_of(body, "bonds")
    vectors = (body.all_points[ends] - body.points[owners]) / body.spacing
    directed = share.numbers[owners], body.names[ends] % share.size, signs[ends], vectors
    whole = [rows.gather(values) for values in directed], [share.gather(values) for values in (factors, loads, chosen)]
    return rows.hand_out(_least_changes(*whole[0], *whole[1]) if share.leads else None)


def _least_changes(owners, ends, signs, vectors, factors, loads, chosen) -> np.ndarray:
    """Return the least changes (n_bonds, d), zero for bonds of points that are not `chosen`, that exert the `loads` (n, d) on the points.

    The bonds from `owners` to `ends` have undeformed `vectors` (n_bonds, d); `signs` are the reflections of ends that are images. The
    change c of a bond exerts the force B c on its end, and the opposite force on its owner, where B (n, d, d) are the owners' `factors`.
    """
    n, d = loads.shape
    found, bonds = np.zeros(vectors.shape), np.flatnonzero(chosen[owners])
    if not len(bonds):
        return found
    count, axes, x, own = len(bonds), np.arange(d), vectors[bonds], owners[bonds]

    def on_points(points: np.ndarray, blocks: np.ndarray) -> scipy.sparse.csr_array:
        row, column = np.broadcast_arrays(d * points[:, None, None] + axes[:, None], d * np.arange(count)[:, None, None] + axes)
        return scipy.sparse.csr_array((blocks.ravel(), (row.ravel(), column.ravel())), shape=(n * d, count * d))

    exerted = on_points(ends[bonds], signs[bonds][:, :, None] * factors[own]) - on_points(own, factors[own])
    # Projection onto changes that keep the gradients of affine motions: their sum over a point's bonds, times the vectors, vanishes.
    places = (np.repeat(np.arange(count), d), (d * own[:, None] + axes).ravel())
    affine = scipy.sparse.csr_array((x.ravel(), places), shape=(count, n * d))
    moments = np.where(chosen[:, None, None], 0.0, np.eye(d))
    np.add.at(moments, own, x[:, :, None] * x[:, None])
    inverse = scipy.sparse.bsr_array((np.linalg.inv(moments), np.arange(n), np.arange(n + 1)), shape=(n * d, n * d))
    projection = scipy.sparse.kron(scipy.sparse.eye_array(count) - affine @ inverse @ affine.T, scipy.sparse.eye_array(d), format="csr")
    exerted = exerted @ projection
    equations, diagonal = exerted @ exerted.T, exerted.multiply(exerted).sum(axis=1)
    touched = np.flatnonzero(diagonal > 0)
    equations, wanted = equations[touched][:, touched].tocsc(), loads.ravel()[touched]
    regular = REGULARIZATION * diagonal.mean() * scipy.sparse.eye_array(len(touched), format="csc")
    # Where the volumes of cells differ from that of the body, the loads have a part that no change exerts; it does not enter the result.
    factor = scipy.sparse.linalg.splu(
        equations + regular, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    forces = np.zeros(len(touched))
    for _ in range(REFINEMENTS):
        forces += factor.solve(wanted - equations @ forces)
    found[bonds] = (projection @ (exerted[touched].T @ forces)).reshape(count, d)
    return found
