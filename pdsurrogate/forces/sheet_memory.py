"""Branches and softening of the pairs of one material in a sheet under plane stress."""

import numpy as np

from ..engine.block_arrays import BLOCK, aligned_rows
from ..engine.passes import BoundPass
from ..kernels import sheet_memory
from ..materials import PLANES
from .binding import Binding
from .kinematics import Kinematics
from .pair_memory import PairMemory
from .pair_passes import PairEnergies

plane = PLANES["stress"]


class SheetMemory(PairMemory):
    """Branches and softening of the pairs of one material in a sheet, whose thickness follows from
    the sum of all stresses.

    Parameters
    ----------
    binding : Binding
    part : PairEnergies
        Pairs of the material, which get this memory and its passes.
    number : int
        Number of the material.
    """

    _part: PairEnergies

    def __init__(self, binding: Binding, part: PairEnergies, number: int) -> None:
        self._J3 = aligned_rows((len(part.points.first),), value=1)
        super().__init__(binding, part, number)

    def _energy_of(self, part: PairEnergies) -> tuple[tuple, str, np.ndarray]:
        points = part.points
        self._isochoric = plane.isochoric_response.block(points.law).address or 0
        none = np.zeros(1, dtype=np.int64), np.zeros(1)
        return (0, (*none, self._isochoric, points.parameters)), "float64", self._J3

    def _steps_of(
        self, part: PairEnergies, kinematics: Kinematics, steps: tuple, memory: np.ndarray, stored
    ) -> list[BoundPass]:
        points = part.points
        law = points.response.address, self._isochoric, points.parameters
        buffers = aligned_rows(
            (kinematics.chunks.threads, sheet_memory.BUFFER_ROWS, BLOCK), value=1
        )
        self._find_volumes = kinematics.bind(
            sheet_memory.pair_volumes, *part.places, part.pairs[:2], law, steps, buffers, self._J3
        )
        results = part.count_rows, part.energies, stored, part.walk
        find = kinematics.bind(
            sheet_memory.pair_energies,
            *part.places,
            part.pairs[:2],
            law,
            steps,
            buffers,
            results,
        )
        return [find]

    def begin(self, elapsed: float) -> None:
        if self.follows_positions:  # by the thickness of a step at that of constant volume
            self._J3[:] = 1.0
            super().begin(elapsed)
            self._find_volumes()
        super().begin(elapsed)

    def settle(self, elapsed: float) -> bool:
        if self.follows_positions:
            self._find_volumes()
        return super().settle(elapsed)

    def accept(self, elapsed: float) -> None:
        self._find_volumes()
        super().accept(elapsed)

    def volume_ratios(self) -> np.ndarray:
        """Return the volume ratios J3 of the points of the material at the positions, means over
        their bonds.
        """
        self._find_volumes()
        return self._means(self._J3[:, None], [1.0])[0]

    def _shares(self) -> np.ndarray:
        return np.tile(self._reference()[3], (2, 1))

    def _volumes(self, F: np.ndarray) -> tuple:
        self._find_volumes()
        return self._J3, (self._J3 / np.linalg.det(F)) ** 2

    def _isochoric_energies(self, F: np.ndarray, J3: np.ndarray) -> np.ndarray:
        return plane.isochoric_response(self._part.points.law, *plane.invariants(F), J3)[3]
