"""The tangent of the bond-level energy: a matrix-free product, and the assembled sparse matrix."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from ..engine.block_arrays import BLOCK

if TYPE_CHECKING:
    from .bond_energy import BondEnergyEvaluation


class Tangent:
    """Second derivative of the energy by the positions, minus the derivative of the forces: symmetric.

    Parameters
    ----------
    force : BondEnergyEvaluation
        Evaluated in double precision.
    positions : ndarray, shape (n, 2)
        Where the tangent is taken.

    Raises
    ------
    ValueError
        For a force in single precision, and in a state that has no energy.
    """

    def __init__(self, force: BondEnergyEvaluation, positions: np.ndarray) -> None:
        if not force.has_tangent:
            raise ValueError("a tangent is formed in float64 only")
        self.force = force
        force.place(positions)
        c, e = force.bond_columns()
        bond_volume = force.bond_weights
        alive = bond_volume > 0
        trace = np.where(alive, (c * c).sum(axis=1) + (e * e).sum(axis=1), 2.0)
        J = np.where(alive, c[:, 0] * e[:, 1] - c[:, 1] * e[:, 0], 1.0)
        energy = force.energy_derivatives(trace, J)
        self._columns = c, e
        self._derivatives = tuple(
            bond_volume * value
            for value in (energy.by_trace, energy.by_area, energy.by_trace_trace, energy.by_trace_area, energy.by_area_area)
        )
        n_blocks = len(force.geometry)
        rows = np.zeros((9, n_blocks * BLOCK))
        rows[:, : len(bond_volume)] = *c.T, *e.T, *self._derivatives
        self._multiply = force.tangent_pass(np.ascontiguousarray(rows.reshape(9, n_blocks, BLOCK).transpose(1, 0, 2)))

    def product(self, displacements: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """The tangent times displacements (n, 2), of the same shape; costs about one force evaluation."""
        out = np.empty_like(displacements) if out is None else out
        self._multiply(displacements, out)
        np.negative(out, out=out)
        return out

    def matrix(self) -> sparse.csr_array:
        """The assembled tangent, shape (2 n, 2 n), degrees of freedom point by point.

        Points up to three horizons apart are coupled, some thousand entries a row at a horizon of three spacings: for small bodies and for
        eigenvalues; a solver for large ones uses `product`.
        """
        force, body = self.force, self.force.body
        bonds, ghosts, n = body.bonds, body.ghosts, len(body)
        total, pairs = len(body.all_points), len(bonds.first)
        vectors = body.all_points[bonds.second] - body.all_points[bonds.first]
        length = np.linalg.norm(vectors, axis=1)
        m = np.stack([-vectors[:, 1], vectors[:, 0]]) / length
        owners = np.repeat(np.arange(n), np.diff(bonds.pointers).astype(np.int64))
        weights = force.gradient_weights()
        gradient = []
        for b in range(2):
            values = np.concatenate([weights[:, b], -np.bincount(owners, weights[:, b], n)])
            rows, columns = np.concatenate([owners, np.arange(n)]), np.concatenate([bonds.neighbours.astype(np.int64), np.arange(n)])
            gradient.append(sparse.csr_array((values, (rows, columns)), shape=(n, total)))
        identity, each = sparse.identity(n, format="csr"), np.arange(len(ghosts))

        def extended(factors):
            """Values on points, carried to their ghosts times the given factors."""
            mirror = sparse.csr_array((factors, (each, ghosts.source.astype(np.int64))), shape=(len(ghosts), n))
            return sparse.vstack([identity, mirror], format="csr")

        one, pair = np.ones(pairs), np.arange(pairs)
        starts = sparse.csr_array((one, (pair, bonds.first.astype(np.int64))), shape=(pairs, total))
        ends = sparse.csr_array((one, (pair, bonds.second.astype(np.int64))), shape=(pairs, total))
        along, across = [], []
        for a in range(2):
            place = extended(ghosts.parity[:, a])
            along.append(sparse.diags_array(1 / length) @ (ends - starts) @ place)
            across.append(
                sum(
                    sparse.diags_array(m[b] / 2)
                    @ (starts + ends)
                    @ extended(ghosts.parity[:, a] * ghosts.reflection[:, b])
                    @ gradient[b]
                    @ place
                    for b in range(2)
                )
            )
        c, e = self._columns
        p, q, p_trace, p_J, q_J = self._derivatives
        by_trace = {("c", a): 2 * c[:, a] for a in range(2)} | {("e", a): 2 * e[:, a] for a in range(2)}
        by_J = {("c", 0): e[:, 1], ("c", 1): -e[:, 0], ("e", 0): -c[:, 1], ("e", 1): c[:, 0]}
        twist = {(("c", 0), ("e", 1)): 1, (("e", 1), ("c", 0)): 1, (("c", 1), ("e", 0)): -1, (("e", 0), ("c", 1)): -1}
        operators = {("c", a): along[a] for a in range(2)} | {("e", a): across[a] for a in range(2)}
        blocks = [[None, None], [None, None]]
        for left, right in ((left, right) for left in operators for right in operators):
            if left[1] > right[1]:
                continue  # the other half is the transpose
            factor = p_trace * by_trace[left] * by_trace[right] + q_J * by_J[left] * by_J[right]
            factor += p_J * (by_trace[left] * by_J[right] + by_J[left] * by_trace[right])
            factor += 2 * p * (left == right) + q * twist.get((left, right), 0)
            term = operators[left].T @ sparse.diags_array(factor) @ operators[right]
            held = blocks[left[1]][right[1]]
            blocks[left[1]][right[1]] = term if held is None else held + term
        blocks[1][0] = blocks[0][1].T
        order = np.arange(2 * n).reshape(2, n).T.ravel()
        return force.law.shear_modulus * sparse.block_array(blocks, format="csr")[order][:, order]
