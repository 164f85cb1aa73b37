"""Passes and other steps of an evaluation, run in order."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ..engine.passes import BoundPass, Chain
from ..ranks import Share


class Steps:
    """Steps of an evaluation, run in order; passes that follow each other run as one `Chain`.

    A step is a bound pass, a function without arguments, or an array with a row for every point, whose halo is filled on a body in shares.
    """

    def __init__(self, share: Share, *steps: BoundPass | Callable[[], object] | np.ndarray) -> None:
        self._calls: list[Callable[[], list[int] | None]] = []
        passes: list[BoundPass] = []
        for step in steps:
            if isinstance(step, BoundPass):
                passes.append(step)
            elif not isinstance(step, np.ndarray) or share.divided:
                self._add(passes)
                passes = []
                self._calls.append(partial(share.fill, step) if isinstance(step, np.ndarray) else step)
        self._add(passes)

    def _add(self, passes: list[BoundPass]) -> None:
        if passes:
            self._calls.append(Chain(*passes))

    def __call__(self) -> list[int]:
        """Run all steps; return the counts of the passes in their order."""
        counts = []
        for call in self._calls:
            counts += call() or ()
        return counts
