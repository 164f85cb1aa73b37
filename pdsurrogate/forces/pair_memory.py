"""Branches and softening of the pairs of one material with a selective energy: their history, and
the passes that read it and add to it.
"""

import numpy as np

from ..engine.block_arrays import BLOCK, aligned_rows
from ..kernels import selective_memory
from ..kernels.branches import GREATEST, tensors_of
from ..materials.histories import softened
from .binding import Binding
from .kinematics import matrices
from .pair_passes import SelectivePairs, bond_gradients
from .term import StateArray


class PairMemory:
    """Branches and softening of the pairs of one material.

    Parameters
    ----------
    binding : Binding
    part : SelectivePairs
        Pairs of the material, which get this memory and its pass.
    number : int
        Number of the material.

    Attributes
    ----------
    state : list of StateArray
        History, with a row for every pair of the body: C_k of the branches, Cb, the greatest
        isochoric energy per volume, and the energies dissipated by branches and by softening. Rows
        of C_k and Cb have the components of `pdsurrogate.kernels.branches`.
    accept : BoundPass
        Pass that adds a state to the history, after the time that is its argument ``elapsed``.
    """

    def __init__(self, binding: Binding, part: SelectivePairs, number: int) -> None:
        kinematics = binding.kinematics
        body = kinematics.body
        d = body.dimension
        law = part.points.law
        isochoric = part.isochoric
        precision = isochoric.precision
        tensors = tensors_of(d)
        branches = len(law.memory.branches)
        softened = law.memory.softening is not None
        threads = kinematics.chunks.threads
        self._part = part
        self._owned = body.share.own[body.bonds.first]
        self._moduli, self._times = np.zeros((2, branches))
        self._softening = np.zeros(3 * softened)
        end = "" if binding.whole else f"_{number}"
        pairs = len(body.bonds.first)
        history = (
            np.tile(tensors.DIAGONAL, (pairs, branches)),
            np.tile(tensors.DIAGONAL, (pairs, 1)),
            np.zeros(pairs if softened else 0),
            np.zeros((pairs, 2)),
        )
        names = "branch_states", "isochoric_strains", "greatest_energies", "dissipated_energies"
        self.state = [
            StateArray(f"{name}{end}", "pairs", values, values.ndim == 1)
            for name, values in zip(names, history, strict=True)
            if values.size
        ]
        self._dissipated = history[3]
        numbers = np.arange(pairs, dtype=np.uint32)[part.points.pairs]
        rows = branches * (tensors.TENSOR + 1) + softened
        coefficients = aligned_rows((len(part.geometry), rows, BLOCK), precision)
        for branch in range(branches):
            first = branch * (tensors.TENSOR + 1)
            coefficients[:, first : first + tensors.TENSOR] = np.reshape(tensors.DIAGONAL, (-1, 1))
        buffers = aligned_rows((threads, selective_memory.memory_rows(d), BLOCK), value=1)
        memory = buffers if precision == "float64" else aligned_rows(buffers.shape, precision, 1)
        self._coefficients = coefficients
        stored = np.zeros(len(part.geometry))
        self._stored = stored
        self._begin = kinematics.bind(
            selective_memory.begin_steps[d],
            *(0.0, 1.0),
            numbers,
            self._times,
            self._softening,
            GREATEST[precision],
            history,
            buffers,
            coefficients,
        )
        self.accept = kinematics.bind(
            selective_memory.accept_steps[d],
            *(0.0, 1.0),
            *part.places,
            *part.pairs,
            *isochoric.arguments,
            numbers,
            self._moduli,
            self._times,
            self._softening,
            history,
            memory,
            buffers,
        )
        part.find = kinematics.bind(
            selective_memory.pair_energies[d],
            *part.places,
            part.pressures,
            part.pairs,
            part.end_shares,
            *isochoric.arguments,
            (self._moduli, self._softening, coefficients),
            memory,
            (part.energies, stored, part.forces, part.moments),
        )
        self.set_parameters()
        part.memory = self

    def set_parameters(self) -> None:
        """Take the memory of the law of the part's points."""
        law = self._part.points.law
        scaled = law.memory.scaled(1 / law.shear_modulus)
        self._moduli[:] = [branch.modulus for branch in scaled.branches]
        self._times[:] = [branch.time for branch in scaled.branches]
        if scaled.softening is not None:
            self._softening[:] = scaled.softening.r, scaled.softening.m, scaled.softening.beta
        for bound in (self._begin, self.accept):
            bound.give_number("unit", law.shear_modulus)

    def begin(self, elapsed: float) -> None:
        """Compute the coefficients of evaluations at a time `elapsed` since the state last
        accepted.
        """
        self._begin.give_number("elapsed", elapsed)
        self._begin()

    def at_points(self, isochoric_state) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return means over the bonds of the points of the material in the state last evaluated:
        sums of M over the branches as matrices (k, 3, 3), in units of the shear modulus, and
        factors eta (k,) of softening and stored energies (k,) of branches.

        `isochoric_state` returns the arguments of the isochoric energy for gradients (n, d, d).
        """
        part = self._part
        d = part.forces.shape[1]
        tensors = tensors_of(d)
        first, second = part.points.first, part.points.second
        positions, columns = part.places
        reference = part.geometry.swapaxes(0, 1).reshape(part.geometry.shape[1], -1)
        n = reference[:d].T
        mean = matrices(columns[first] + columns[second]) / 2
        along = (positions[second] - positions[first]) * reference[d, :, None]
        F = bond_gradients(mean, along, n)
        F[reference[d + 1] == 0] = np.eye(d)
        rows = self._coefficients.swapaxes(0, 1).reshape(self._coefficients.shape[1], -1)
        Cb = tensors.isochoric(
            tensors.green(F.transpose(2, 1, 0).reshape(d * d, -1), 1.0), np.linalg.det(F)
        )
        total = np.zeros((len(Cb), len(first)))
        for branch, modulus in enumerate(self._moduli):
            B = rows[branch * (len(Cb) + 1) :]
            M, _ = tensors.take_step(B[: len(Cb)], B[len(Cb)], Cb, tensors.cofactor_of(Cb))
            total += modulus * np.array(M)
        energy = (tensors.contraction(total, Cb) - 3 * self._moduli.sum()) / 2
        eta = np.ones(len(first))
        if len(self._softening):
            W = part.isochoric.evaluate(*isochoric_state(F))[3]
            softening = part.points.law.memory.scaled(1 / part.unit).softening
            eta = softened(softening, W, rows[-1])
        shares = part.end_shares.swapaxes(0, 1).reshape(2, -1)
        whole = np.zeros(len(positions))
        found = np.zeros((len(positions), len(Cb) + 2))
        for end, share in zip((first, second), shares, strict=True):
            np.add.at(whole, end, share)
            np.add.at(found, end, share[:, None] * np.column_stack([*total, eta, energy]))
        found[:, len(Cb)] += whole == 0  # a point without bonds is as at rest
        found = (found.T / np.where(whole > 0, whole, 1.0))[:, part.points.own[0]]
        M = np.zeros((found.shape[1], 3, 3))
        for (r, c), values in zip(tensors.PLACES, found, strict=False):
            M[:, r, c] = M[:, c, r] = values
        return M, found[-2], found[-1]

    def stored(self) -> float:
        """Return the stored isochoric energy in the state last evaluated, divided by the shear
        modulus.
        """
        return float(self._stored.sum())

    def dissipated(self) -> np.ndarray:
        """Return the energies dissipated by branches and by softening on this rank, shape (2,)."""
        return self._dissipated[self._owned].sum(axis=0)
