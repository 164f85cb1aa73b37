"""Branches and softening of the pairs of one material with a selective energy: their history, and
the passes that read it and add to it.
"""

import numpy as np

from ..engine.block_arrays import BLOCK, aligned_rows
from ..kernels import selective_memory
from ..kernels.branches import GREATEST, tensors_of
from .binding import Binding
from .pair_passes import SelectivePairs
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

    def stored(self) -> float:
        """Return the stored isochoric energy in the state last evaluated, divided by the shear
        modulus.
        """
        return float(self._stored.sum())

    def dissipated(self) -> np.ndarray:
        """Return the energies dissipated by branches and by softening on this rank, shape (2,)."""
        return self._dissipated[self._owned].sum(axis=0)
