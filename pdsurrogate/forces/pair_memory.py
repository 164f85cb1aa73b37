"""Branches and softening of the pairs of one material: their history, and the passes that read it
and add to it.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..engine.block_arrays import BLOCK, aligned_rows
from ..engine.passes import BoundPass
from ..kernels import selective_memory
from ..kernels.branches import GREATEST, tensors_of
from ..kernels.softening import soften
from ..materials import PLANES
from ..materials.memory import padded_knots
from .binding import Binding
from .kinematics import Kinematics, matrices
from .pair_passes import bond_gradients
from .term import StateArray

UNCHANGED = 1e-3
"""Relative change of the relaxation times that pass in a step that is none: an overstress changes
by less.
"""


class PairMemory:
    """Branches and softening of the pairs of one material.

    Parameters
    ----------
    binding : Binding
    part : SelectivePairs
        Pairs of the material, which get this memory and its passes; in a sheet under plane stress
        `PairEnergies` (`SheetMemory`).
    number : int
        Number of the material.

    Attributes
    ----------
    state : list of StateArray
        History, with a row for every pair of the body: C_k of the branches, Cb, the greatest
        isochoric energy per volume, the energies dissipated by branches and by softening, and with
        `ForceSettings.paths` Cb before. Rows of C_k and Cb have the components of
        `pdsurrogate.kernels.branches`.
    bends : bool
        Whether steps follow parabolas, whose errors can be estimated.
    see : callable
        Brings the gradients of the pairs up to date.
    """

    see: Callable[[], None]

    def __init__(self, binding: Binding, part: Any, number: int) -> None:
        kinematics = binding.kinematics
        body = kinematics.body
        d = body.dimension
        law = part.points.law
        energy, precision, volumes = self._energy_of(part)
        tensors = tensors_of(d)
        branches = len(law.memory.branches)
        softened = law.memory.softening is not None
        threads = kinematics.chunks.threads
        self._part = part
        self._plane = PLANES[kinematics.plane]
        self._owned = body.share.own[body.bonds.first]
        self._moduli, self._times = np.zeros((2, branches))
        self._softening = np.zeros(3 * softened)
        end = "" if binding.whole else f"_{number}"
        pairs = len(body.bonds.first)
        thinning = law.memory.thinning
        self._kinematics = kinematics
        self.bends = binding.settings.paths and branches > 0 and not thinning
        history = (
            np.tile(tensors.DIAGONAL, (pairs, branches)),
            np.tile(tensors.DIAGONAL, (pairs if branches else 0, 1)),
            np.zeros(pairs if softened else 0),
            np.zeros((pairs, 2)),
            np.tile(tensors.DIAGONAL, (pairs * self.bends, 1)),
        )
        names = "branch_states", "isochoric_strains", "greatest_energies", "dissipated_energies"
        names += ("earlier_strains",)
        self.state = [
            StateArray(f"{name}{end}", "pairs", values, values.ndim == 1)
            for name, values in zip(names, history, strict=True)
            if values.size
        ]
        self._history = history
        self._dissipated = history[3]
        own = np.arange(pairs, dtype=np.uint32)[part.points.pairs]
        numbers = np.zeros(len(part.points.first), dtype=np.uint32)
        numbers[: len(own)] = own
        self._numbers = numbers
        rows = branches * tensors.STEP + 2 * softened
        passed = aligned_rows((len(part.geometry) * thinning, branches, BLOCK))
        coefficients = aligned_rows((len(part.geometry), rows, BLOCK))
        buffers = aligned_rows((threads, selective_memory.memory_rows(d), BLOCK), value=1)
        memory = buffers if precision == "float64" else aligned_rows(buffers.shape, precision, 1)
        self._coefficients = coefficients
        stored = np.zeros_like(part.energies)
        self._stored = stored
        self._begin = kinematics.bind(
            selective_memory.begin_steps[d],
            *(0.0, -1.0, 1.0),
            numbers,
            self._times,
            passed,
            self._softening,
            GREATEST[precision],
            history,
            buffers,
            coefficients,
        )
        self._accept = kinematics.bind(
            selective_memory.accept_steps[d],
            *(0.0, -1.0, 1.0),
            *part.places,
            *part.pairs[:2],
            volumes,
            *energy,
            numbers,
            len(own),
            self._moduli,
            self._times,
            passed,
            self._softening,
            coefficients,
            history,
            memory,
            buffers,
        )
        self._passed = passed
        self._passing = (
            self._passing_times(part, kinematics, volumes, numbers, history) if thinning else None
        )
        self.set_parameters()
        part.memory = self
        steps = self._moduli, self._softening, coefficients
        part.steps = self._steps_of(part, kinematics, steps, memory, stored)

    def _energy_of(self, part: Any) -> tuple[tuple, str, np.ndarray]:
        """Return the arguments of the isochoric energy, its precision, and the array of the volume
        ratios of pairs, empty if the thickness is held.
        """
        return part.isochoric.arguments, part.isochoric.precision, np.zeros(0)

    def _steps_of(
        self, part: Any, kinematics: Kinematics, steps: tuple, memory: np.ndarray, stored
    ) -> list[BoundPass]:
        """Return the passes of an evaluation; `steps` are moduli, softening and coefficients."""
        bound = kinematics.bind(
            selective_memory.pair_energies[kinematics.body.dimension],
            *part.places,
            part.pressures,
            part.pairs[:2],
            part.end_shares,
            *part.isochoric.arguments,
            steps,
            memory,
            (part.energies, stored, part.walk),
        )
        return [bound]

    def _passing_times(
        self, part: Any, kinematics: Kinematics, volumes: np.ndarray, numbers: np.ndarray, history
    ) -> BoundPass:
        """Return the pass that finds the relaxation times that pass in a step, of branches whose
        times depend on the overstress.
        """
        from ..kernels import rates  # here, for few branches have such times

        d = kinematics.body.dimension
        self._found = np.empty_like(self._passed)
        self._knots = padded_knots(part.points.law.memory.branches)
        return kinematics.bind(
            rates.passed_times[d],
            0.0,
            *part.places,
            *part.pairs[:2],
            volumes,
            numbers,
            self._times,
            self._knots,
            history,
            aligned_rows((kinematics.chunks.threads, rates.search_rows(d), BLOCK), value=1),
            self._found,
        )

    def set_parameters(self) -> None:
        """Take the memory of the law of the part's points."""
        law = self._part.points.law
        scaled = law.memory.scaled(1 / law.shear_modulus)
        self._moduli[:] = [branch.modulus for branch in scaled.branches]
        self._times[:] = [branch.time for branch in scaled.branches]
        if self._passing is not None:
            self._knots[:] = padded_knots(scaled.branches)
        if scaled.softening is not None:
            self._softening[:] = scaled.softening.r, scaled.softening.m, scaled.softening.beta
        for bound in (self._begin, self._accept):
            bound.give_number("unit", law.shear_modulus)

    @property
    def follows_positions(self) -> bool:
        """Whether `begin` depends on the positions."""
        return self._passing is not None

    def begin(self, elapsed: float) -> None:
        """Compute the coefficients of evaluations at a time `elapsed` since the state last
        accepted. The positions are the first ones to be tried.
        """
        if self._passing is not None:
            self._passing.give_number("elapsed", elapsed)
            self._passing()
            self._passed[:] = self._found
        self._give_times(self._begin, elapsed)
        self._begin()

    def settle(self, elapsed: float) -> bool:
        """Find again, at the positions, how many relaxation times pass in the step; return whether
        these differ so much that the coefficients of evaluations have changed.
        """
        if self._passing is None:
            return False
        self._passing()
        if np.isclose(self._found, self._passed, rtol=UNCHANGED, atol=0.0).all():
            return False
        self.begin(elapsed)
        return True

    def accept(self, elapsed: float) -> None:
        """Add the state at the positions to the history, a time `elapsed` after the last one."""
        self._give_times(self._accept, elapsed)
        self._accept()

    def _give_times(self, bound: BoundPass, elapsed: float) -> None:
        """Give a pass the duration of the step, and its ratio to the step before."""
        bound.give_number("elapsed", elapsed)
        bound.give_number("ratio", self._ratio(elapsed))

    def _ratio(self, elapsed: float) -> float:
        """Return the ratio of a step to the one before, 0 if this does not count, and -1 for a
        straight step.
        """
        before = self._kinematics.before
        if before is None or not self.bends:
            return -1.0
        return elapsed / before if before else 0.0

    def path_error(self, begins: bool, total: float) -> list[float]:
        """Return what the pairs of the material add to `path_error` of `internal_force`.

        The third difference of a smooth path is about its second one squared over its first one.
        The change that it makes in C_k is looked for in the direction of the first difference.
        """
        self.see()
        d = self._kinematics.body.dimension
        tensors = tensors_of(d)
        elapsed, ratio = self._kinematics.elapsed, self._ratio(self._kinematics.elapsed)
        (Cb, *_), rows = self._strains(), self._rows()
        of_history = (self._history[n][self._numbers].T for n in (1, 4))
        begun, earlier = (tuple(values) for values in of_history)
        around = tensors.cofactor_of(Cb)

        def size(tensor):
            mixed = tensors.mixed_product(tensor, around, 0.0)
            return np.sqrt(np.abs(tensors.trace_of_product(mixed, mixed)))

        def overstress(C_k):
            M = tensors.cofactor_of(C_k)
            return np.array(tensors.mixed_product(Cb, M, tensors.contraction(Cb, M) / 3))

        moved = tensors.combined(Cb, -1.0, begun)
        second = tensors.combined(moved, -ratio, tensors.combined(begun, -1.0, earlier))
        bow = ratio / (1 + ratio) * size(second) / (size(moved) + np.finfo(float).tiny)
        bow = np.minimum(bow, 1.0) if ratio else np.ones_like(bow)
        stress = error = lasting = 0.0
        for branch, modulus in enumerate(self._moduli):
            B, b = tensors.step_in(rows[branch * tensors.STEP :], slice(None), 1.0)
            times = self._times[branch]
            h = elapsed / times
            off = bow * (bow + np.exp(-h) * begins) / (3 + h)
            found = overstress(tensors.end_step(B, b, Cb))
            other = overstress(tensors.end_step(B, b, tensors.combined(Cb, off, moved)))
            stress = stress + modulus * found
            steps = np.minimum(times, total) / np.minimum(times, elapsed)
            error = error + modulus * (other - found)
            lasting = lasting + steps * modulus * (other - found)
        there = self._reference()[d + 1] > 0
        unit = self._part.points.law.shear_modulus
        return [
            unit * float(np.sqrt(np.nanmax((values**2).sum(axis=0)[there], initial=0.0)))
            for values in (error, lasting, stress)
        ]

    def at_points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return means over the bonds of the points of the material in the state last evaluated:
        sums of M over the branches as matrices (k, 3, 3), in units of the shear modulus, and
        factors eta (k,) of softening and stored energies (k,) that memory adds, in this unit too.
        """
        tensors = tensors_of(self._kinematics.body.dimension)
        Cb, F, J3 = self._strains()
        rows = self._rows()
        total = np.zeros((len(Cb), len(F)))
        for branch, modulus in enumerate(self._moduli):
            B, b = tensors.step_in(rows[branch * tensors.STEP :], slice(None), 1.0)
            M, _ = tensors.take_step(B, b, Cb)
            total += modulus * np.array(M)
        energy = (tensors.contraction(total, Cb) - 3 * self._moduli.sum()) / 2
        eta = np.ones(len(F))
        if len(self._softening):
            W = self._isochoric_energies(F, J3)
            eta, _, rest = soften(W, rows[-2], rows[-1], self._softening)
            energy = energy + rest - W
        found = self._means(np.column_stack([*total, eta, energy]), [*[0.0] * len(Cb), 1.0, 0.0])
        M = np.zeros((found.shape[1], 3, 3))
        for (r, c), values in zip(tensors.PLACES, found, strict=False):
            M[:, r, c] = M[:, c, r] = values
        return M, found[-2], found[-1]

    def _rows(self) -> np.ndarray:
        """Return the coefficients of the steps of the pairs, a column for each."""
        return self._coefficients.swapaxes(0, 1).reshape(self._coefficients.shape[1], -1)

    def _strains(self) -> tuple:
        """Return the components of Cb, deformation gradients and volume ratios of the pairs."""
        d = self._kinematics.body.dimension
        tensors = tensors_of(d)
        F = self._gradients()
        J3, C33 = self._volumes(F)
        C = tensors.green(F.transpose(2, 1, 0).reshape(d * d, -1), C33)
        return tensors.isochoric(C, J3), F, J3

    def _gradients(self) -> np.ndarray:
        """Return the deformation gradients of the pairs; I for one of volume zero."""
        part = self._part
        d = self._kinematics.body.dimension
        first, second = part.points.first, part.points.second
        positions, columns = part.places
        reference = self._reference()
        n = reference[:d].T
        mean = matrices(columns[first] + columns[second]) / 2
        along = (positions[second] - positions[first]) * reference[d, :, None]
        F = bond_gradients(mean, along, n)
        F[reference[d + 1] == 0] = np.eye(d)
        return F

    def _reference(self) -> np.ndarray:
        """Return the geometry of the pairs, a column for each."""
        geometry = self._part.geometry
        return geometry.swapaxes(0, 1).reshape(geometry.shape[1], -1)

    def _means(self, values: np.ndarray, at_rest: Sequence[float]) -> np.ndarray:
        """Return means (m, k) of the `values` of pairs, a row for each, over the bonds of the
        points of the material; a point without bonds is as at rest.
        """
        points = self._part.points
        n = len(points.positions)
        ends = points.first, points.second
        shares = self._shares()

        def summed(values):
            return sum(np.bincount(*pair, n) for pair in zip(ends, shares * values, strict=True))

        whole = summed(1.0)
        columns = zip(values.T, at_rest, strict=True)
        found = np.stack([np.where(whole > 0, summed(values), rest) for values, rest in columns])
        return (found / np.where(whole > 0, whole, 1.0))[:, points.own[0]]

    def _shares(self) -> np.ndarray:
        """Return the shares of the pairs in the volumes of their two ends, one row for each end."""
        return self._part.end_shares.swapaxes(0, 1).reshape(2, -1)

    def _volumes(self, F: np.ndarray) -> tuple:
        """Return volume ratios, and the squared stretches of the thickness, of the pairs."""
        return np.linalg.det(F), 1.0

    def _isochoric_energies(self, F: np.ndarray, J3: np.ndarray) -> np.ndarray:
        """Return the isochoric energies of pairs, in units of the shear modulus."""
        part = self._part
        return part.isochoric.evaluate(*self._plane.isochoric_state(F))[3]

    def stored(self) -> float:
        """Return the stored isochoric energy in the state last evaluated, divided by the shear
        modulus.
        """
        return float(self._stored.sum())

    def dissipated(self) -> np.ndarray:
        """Return the energies dissipated by branches and by softening on this rank, shape (2,)."""
        return self._dissipated[self._owned].sum(axis=0)
