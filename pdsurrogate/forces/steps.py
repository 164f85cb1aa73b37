"""Sequence of compiled passes and other steps that evaluates a force."""

from collections.abc import Callable
from functools import partial
from itertools import groupby
from typing import TypeAlias

import numpy as np
import scipy

from ..engine.passes import BoundPass, Chain
from ..engine.threads import Chunks
from ..kernels.sums import multiply_rows
from ..ranks import Share

Step: TypeAlias = BoundPass | Callable[[], object] | np.ndarray
"""Step of an evaluation: a compiled pass, a function without arguments, or an array with a row for
every point, for which the step copies the rows of halo points from the ranks that own these points.
"""


class Steps:
    """Sequence of steps that evaluates a force: compiled passes (consecutive ones run as one
    `Chain`), functions, and halo exchanges.
    """

    def __init__(self, share: Share, *steps: Step) -> None:
        self._calls: list[Callable[[], object]] = []
        taken = [step for step in steps if share.divided or not isinstance(step, np.ndarray)]
        for are_passes, group in groupby(taken, lambda step: isinstance(step, BoundPass)):
            others = (
                partial(share.fill, step) if isinstance(step, np.ndarray) else step
                for step in group
            )
            self._calls += [Chain(*others)] if are_passes else others
        self._only = (
            self._calls[0] if len(self._calls) == 1 and isinstance(self._calls[0], Chain) else None
        )

    @property
    def passes(self) -> tuple[BoundPass, ...] | None:
        """The steps, if all of them are passes."""
        return None if self._only is None else self._only.passes

    def __call__(self) -> list[int]:
        """Run all steps in order; return the count that each pass returns, such as the number of
        points without a state.
        """
        if self._only is not None:
            return self._only()
        counts = []
        for call in self._calls:
            found = call()
            if isinstance(call, Chain):
                counts += found
        return counts


def sparse_product(
    chunks: Chunks,
    matrix,
    values: np.ndarray,
    out: np.ndarray,
    add: bool = False,
    every: bool = False,
    variable: bool = False,
) -> list[BoundPass]:
    """Return the pass that writes a sparse matrix times `values` to rows of `out`, or adds it to
    them; no pass for an empty matrix.

    It changes the rows in which the matrix has entries, or all if `every`. If `variable`, the
    matrix is a CSR array with sorted indices whose entries, zeros among them, the caller may
    change.
    """
    if not variable:
        matrix = scipy.sparse.csr_array(matrix)
        matrix.eliminate_zeros()
        matrix.sort_indices()
    pointers = matrix.indptr.astype(np.int64)
    width = values.shape[1]
    rows = np.arange(matrix.shape[0]) if every else np.flatnonzero(np.diff(pointers))
    entries = (
        rows,
        np.append(pointers[rows], pointers[-1]),
        matrix.indices.astype(np.int32, copy=False).view(np.uint32),
        matrix.data,
    )
    arrays = *entries, values, int(add), np.zeros((len(rows), width)), out
    return [multiply_rows(width).bind(*arrays, chunks=chunks)] if len(rows) else []
