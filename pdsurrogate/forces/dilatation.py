"""Linearised dilatation of the points of a selective energy, by which solvers precondition systems with a great bulk modulus."""

from __future__ import annotations

import numpy as np

from ..body import Body
from ..engine.block_arrays import aligned_rows, power_of_two
from ..engine.threads import Chunks
from ..kernels import dilatation, selective_energy
from ..kernels.ghosts import place_points
from .bond_shares import BondShares
from .pair_passes import SelectivePairs
from .smoothing import Smoothing
from .steps import Steps
from .term import Binding


class LinearisedDilatation:
    """Derivative D of the smoothed dilatations of the points by the positions, and its transpose (theory (58)), in single precision.

    Solvers use it in approximations of the tangent.

    Parameters
    ----------
    binding : Binding
        Body of one material.
    shares : BondShares
        Shares and sums, with their broken bonds.
    smoothing : Smoothing
    dilatations : ndarray, shape (n,)
        Smoothed, as last evaluated.
    pairs : SelectivePairs

    Attributes
    ----------
    stiffness : ndarray, shape (n,)
        C, the stiffness of the points against a change of their dilatation, V_i mu U''.
    """

    def __init__(self, binding: Binding, shares: BondShares, smoothing: Smoothing, dilatations: np.ndarray, pairs: SelectivePairs) -> None:
        kinematics, body = binding.kinematics, binding.kinematics.body
        bonds, ghosts = body.bonds, body.ghosts
        chunks, first, second = kinematics.chunks, pairs.points.first, pairs.points.second
        self._body, self._law, self._unit, self._dilatations = body, pairs.points.law, pairs.unit, dilatations
        self._smoothing, gradient_ghosts = smoothing, kinematics.gradient_ghosts
        d, n, total = body.dimension, len(body), len(body.all_points)
        length = dilatation.record_length(d)
        derivatives = aligned_rows((len(first), length), np.float32)
        by_pair, means = np.zeros(len(first), dtype=np.float32), np.zeros(n, dtype=np.float32)
        self._linearise = dilatation.volume_derivatives[d].bind(
            kinematics.positions, kinematics.gradients, (first, second, pairs.geometry), pairs.buffers, derivatives, chunks=chunks
        )

        displacements, gradients = np.zeros((total, d)), aligned_rows((total, d * d))
        records, self._changes = aligned_rows((total, length), np.float32), np.zeros(n, dtype=np.float32)
        images = ghosts.source, ghosts.parity, np.zeros_like(ghosts.parity)
        self._place = place_points.bind(np.ascontiguousarray(body.points), *images, displacements, chunks=chunks)
        of_gradients = gradient_ghosts.source, gradient_ghosts.gradient_parity, gradient_ghosts.gradient_reflection
        self._find_changes = Steps(
            body.share,
            self._place,
            kinematics.gradient_pass(displacements, gradients, 0.0),
            gradients[:n],
            dilatation.displacement_records.bind(displacements, gradients, *of_gradients, records, chunks=chunks),
            dilatation.volume_changes[d].bind(derivatives, records, bonds.pair_pointers, second, by_pair, chunks=chunks),
            selective_energy.means_over_bonds.bind(bonds.pointers, bonds.pair_of, shares.bond_shares, by_pair, 0.0, means, chunks=chunks),
            means,
            self._smoothing.bind(means, self._changes, chunks),
        )

        self._values, pressures = means, np.zeros(total, dtype=np.float32)
        self._forces = np.zeros((total, d))
        # The gradients are no longer needed when the forces are computed.
        self._find_forces = Steps(
            body.share,
            means,
            self._smoothing.bind(means, pressures, chunks),
            pressures[:n],
            dilatation.pair_pressures.bind(pressures, first, second, pairs.end_shares, by_pair, chunks=chunks),
            dilatation.sum_pressures[d].bind(derivatives, by_pair, *shares.pairs_of_points, self._forces, gradients, chunks=chunks),
            *shares.steps_to_points(gradients, self._forces, 1.0),
        )
        self._chunks = chunks
        self.stiffness = np.zeros(n)

    def take(self) -> None:
        """Linearise the dilatations about the state last evaluated."""
        self._linearise()
        self._smoothing.take()
        self.stiffness[:] = self._unit * self._body.volumes * self._law.volumetric(self._dilatations, self._law.parameters)[2]

    def changes(self, displacements: np.ndarray) -> np.ndarray:
        """Return D u, shape (n,), for displacements (n, d)."""
        displacements = np.ascontiguousarray(displacements)
        self._body.share.fill(displacements)
        self._place.give("given", displacements)
        self._find_changes()
        self._body.share.clear(self._changes)
        return self._changes.astype(float)

    def forces(self, values: np.ndarray) -> np.ndarray:
        """Return D^T s, shape (n, d), for values (n,) at the points; it costs about as much as `changes`."""
        # The smoothing, weighted by volumes, is its own transpose. A power of two keeps the values in the range of single precision.
        pressures = values / self._body.volumes
        unit = power_of_two(self._body.share.total(float(np.abs(pressures).sum())))
        np.divide(pressures, unit, out=self._values, casting="same_kind")
        self._find_forces()
        return -unit * self._forces[: len(values)]

    def polynomial(self, coefficients: np.ndarray) -> SmoothingPolynomial:
        """Return a polynomial of the smoothing W, to be applied to values at the points: the sum of c_k T_k(2 W^2 - I)."""
        return SmoothingPolynomial(self._smoothing, coefficients, self._body, self._chunks)


class SmoothingPolynomial:
    """Sum of c_k T_k(2 W^2 - I) with Chebyshev polynomials T_k and the smoothing W of points, by Clenshaw's recurrence.

    Parameters
    ----------
    smoothing : Smoothing
    coefficients : ndarray
    body : Body
    chunks : Chunks
    """

    def __init__(self, smoothing: Smoothing, coefficients: np.ndarray, body: Body, chunks: Chunks) -> None:
        n, self._share = len(body), body.share
        self._values, self._sums = np.zeros(n, dtype=np.float32), np.zeros((2, n), dtype=np.float32)
        once, passes = np.zeros(n, dtype=np.float32), []
        for number, coefficient in enumerate(coefficients[:0:-1]):
            # b_k = c_k v + 2 (2 W^2 - I) b_(k + 1) - b_(k + 2), which is overwritten.
            first, second = self._sums[number % 2], self._sums[1 - number % 2]
            passes += [first, smoothing.bind(first, once, chunks), once]
            passes.append(smoothing.bind_sum(once, 4.0, ((-2.0, first), (coefficient, self._values), (-1.0, second)), second, chunks))
        first, second = (self._sums[(len(coefficients) - 1 + shift) % 2] for shift in (0, 1))
        self._result = np.zeros(n, dtype=np.float32)
        passes += [first, smoothing.bind(first, once, chunks), once]
        ends = (-1.0, first), (coefficients[0], self._values), (-1.0, second)
        passes.append(smoothing.bind_sum(once, 2.0, ends, self._result, chunks))
        self._run = Steps(self._share, *passes)

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Return the product with values (n,)."""
        self._values[:] = values
        self._sums[:] = 0.0
        self._run()
        self._share.clear(self._result)
        return self._result.astype(float)
