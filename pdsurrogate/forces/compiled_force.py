"""Bond forces and energies as functions compiled for blocks of bonds, with their constants."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..engine.block_arrays import BLOCK, SCRATCH_ROWS, aligned_rows
from ..engine.compile import call_block, kernel
from .material_points import MaterialPoints


@kernel
def _call(address, arguments):
    """Call the function compiled for blocks of bonds at an address."""
    call_block(address, *arguments)


def by_blocks(
    evaluate: Callable[[np.ndarray, np.ndarray], object], states: np.ndarray, n_rows: int, dtype
) -> np.ndarray:
    """Return the results, shape (n_rows, n), of a function that accepts only blocks of BLOCK
    states, at n states, shape (rows, n).

    ``evaluate(block, result)`` writes the results of a block (rows, BLOCK) into `result` (n_rows,
    BLOCK); both are of type `dtype`.
    """
    n = states.shape[1]
    found = np.empty((n_rows, n))
    for at in range(0, n, BLOCK):
        size = min(BLOCK, n - at)
        # Copies of the first state fill the last block, so that all its columns are valid states.
        rows = np.repeat(states[:, at : at + 1], BLOCK, axis=1).astype(dtype)
        result = np.zeros((n_rows, BLOCK), dtype)
        rows[:, :size] = states[:, at : at + size]
        evaluate(rows, result)
        found[:, at : at + size] = result[:, :size]
    return found


@dataclass(frozen=True)
class CompiledBondForce:
    """Bond force or energy as a function compiled for blocks of bonds, with its constants.

    Attributes
    ----------
    address : int
        Address of the function (`pdsurrogate.engine.compile.bond_force_signature`); 0 for a force
        that is evaluated in NumPy.
    sizes : ndarray of int64
        Integer constants.
    weights : ndarray, in the precision of the bond pass
        Floating-point constants.
    work_rows : int
        Rows of working memory that the function needs, in the precision of the bond pass.
    needs_length : bool
        Whether the function reads the last row of its states, l/horizon, which is not filled
        otherwise.
    asks_law : bool
        Whether the function calls the law's response that the pass supplies, which accounts for a
        free or held thickness. Any other function returns the force for zero stress across the
        thickness, to which plane strain adds a pressure
        (`pdsurrogate.forces.pair_forces.in_plane_strain`).
    """

    address: int
    sizes: np.ndarray
    weights: np.ndarray
    work_rows: int
    needs_length: bool = False
    asks_law: bool = False

    def constants(self, points: MaterialPoints) -> tuple:
        """Return the arguments of the function: its own constants, then address of the response
        and parameters of the law of `points`.
        """
        return self.sizes, self.weights, points.response.address, points.parameters

    def memory(self, threads: int, dtype) -> np.ndarray:
        """Return an array of working memory for the function, one block for every thread."""
        return aligned_rows((threads, max(self.work_rows, 1), BLOCK), dtype)

    def evaluate(
        self,
        states: np.ndarray,
        n_rows: int,
        response: int = 0,
        parameters: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the result of the function, shape (n_rows, n), at states (rows, n), in double; for
        checks, as it is slow.

        `response` and `parameters` are the compiled response and the parameters of the law, for
        functions that use it (`asks_law`).
        """
        dtype = self.weights.dtype
        law = response, np.zeros(1) if parameters is None else parameters
        memory = self.memory(1, dtype)[0], np.zeros((SCRATCH_ROWS, BLOCK))

        def evaluate(rows: np.ndarray, result: np.ndarray) -> None:
            _call(self.address, (rows, self.sizes, self.weights, *law, *memory, result))

        return by_blocks(evaluate, states, n_rows, dtype)
