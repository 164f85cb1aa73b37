"""Jumps of the deformation gradient beside cuts and cracks at interfaces."""

from __future__ import annotations

import weakref
from functools import partial

import numpy as np
import scipy

from .interface_fits import Fits
from .kinematics import Kinematics
from .steps import Step, sparse_product


class Tears:
    """Choice of the fits of jumps beside cuts and cracks: that of both sides together, those of
    either side, or none.

    Parameters
    ----------
    kinematics : Kinematics
    portion_of : ndarray of int, shape (n + m,)
    fits : Fits
    apart_back : sparse array, shape (n, n)
        Transpose of ``fits.apart`` with the rows of halo points.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        portion_of: np.ndarray,
        fits: Fits,
        apart_back: scipy.sparse.csr_array,
    ) -> None:
        self._kinematics = weakref.proxy(kinematics)
        self._portion_of = portion_of
        n = len(kinematics.body)
        self._apart = fits.apart
        self._apart_back = apart_back
        self._is_image = fits.images.diagonal() != 0
        self._fitted = abs(fits.jumps) + abs(fits.images)
        self._fitted_apart = abs(fits.apart)
        # Points that have lost bonds within one material, and across; factors of the fits of both
        # sides together, and of either side.
        self._lost = np.zeros((2, n), dtype=bool)
        self._intact = np.ones((n, 1))
        self._parted = np.zeros((n, 1))

    def steps(self, positions: np.ndarray, jumps: np.ndarray) -> list[Step]:
        """Return the steps that replace jumps, where the sides are parted, by those of separate
        fits, and by zero where neither holds.
        """
        rows = jumps[: len(self._intact)]
        apart = np.zeros((len(self._intact), jumps.shape[1]))
        scale = partial(_scale, rows, self._intact)
        add = partial(np.add, rows, apart, out=rows)
        return [
            *sparse_product(self._kinematics.chunks, self._apart, positions, apart),
            partial(_scale, apart, self._parted),
            scale,
            add,
        ]

    def steps_back(
        self, on_jumps: np.ndarray, on_points: np.ndarray
    ) -> tuple[list[Step], list[Step]]:
        """Return the steps that divide forces `on_jumps` among the fits, and those that add the
        part of separate fits to `on_points`.
        """
        rows = on_jumps[: len(self._intact)]
        parted = np.zeros_like(on_points)
        divide = [
            partial(np.multiply, rows, self._parted, out=parted),
            parted,
            partial(_scale, rows, self._intact),
        ]
        return divide, [
            parted,
            *sparse_product(self._kinematics.chunks, self._apart_back, parted, on_points, add=True),
        ]

    def kept_rows(self, values: np.ndarray) -> list[Step]:
        """Return the step that sets the first n rows of an array to zero where points have no
        jump because of a cut or a crack.
        """
        rows = values[: len(self._intact)]
        return [lambda: _scale(rows, self._intact + self._parted)]

    def lose(self, first: np.ndarray, second: np.ndarray) -> None:
        """Choose the fits of the jumps after bonds between these points, or ghosts, were lost."""
        share = self._kinematics.body.share
        sources = self._kinematics.sources
        across = self._portion_of[first] != self._portion_of[second]
        for lost, chosen in zip(self._lost, (~across, across), strict=True):
            lost[sources[np.concatenate([first[chosen], second[chosen]])]] = True
            share.fill(lost)
        within = self._fitted @ self._lost[0] > 0
        any_lost = self._fitted @ self._lost.any(axis=0) > 0
        # An image is made from the points of each side alone.
        self._intact[:, 0] = ~np.where(self._is_image, within, any_lost)
        self._parted[:, 0] = ~self._is_image & any_lost & (self._fitted_apart @ self._lost[0] == 0)
        share.fill(self._intact, self._parted)


def _scale(rows: np.ndarray, factors: np.ndarray) -> None:
    """Multiply rows by factors in place."""
    np.multiply(rows, factors, out=rows)
