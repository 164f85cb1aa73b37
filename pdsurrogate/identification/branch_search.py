"""Choice of viscoelastic branches: few relaxation times from a logarithmic grid, by the errors of
stresses that are left out of the fit.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from ..materials import Branch, Law, Softening
from ..materials.histories import branch_states, isochoric, softened
from .averaging import nonnegative

PER_DECADE = 4
COARSE = 2
"""Relaxation times of the grid in a decade, and those among which a search starts. Chosen: the
relaxation of a branch spans two decades, so that a spline through the former has errors of 1e-4.
"""

MOST_BRANCHES = 4
"""Most branches of a choice by cross-validation: tests over a few decades of time tell no more."""

LEAST_CURVES = 3
BLOCKS = 5
"""Least number of curves of which one at a time is left out; of fewer curves, blocks of successive
rows, so many in each curve, are left out.
"""


class Curves(NamedTuple):
    """Histories side by side, the shorter ones held at their last state.

    Attributes
    ----------
    time : ndarray, shape (n, n_curves)
    squares : ndarray, shape (n, n_curves, 3)
        Squares of the principal stretches of constant volume.
    place : tuple of ndarray, shape (n_rows,)
        Row and curve of every row of the data.
    row : ndarray of int, shape (n, n_curves)
        Row of the data.
    """

    time: np.ndarray
    squares: np.ndarray
    place: tuple[np.ndarray, np.ndarray]
    row: np.ndarray

    @classmethod
    def of(cls, X: np.ndarray) -> "Curves":
        """Return the curves of rows (stretch, lateral stretch, time, curve); raise ValueError for
        times that decrease.
        """
        names = list(dict.fromkeys(X[:, 3].tolist()))
        rows = [np.flatnonzero(X[:, 3] == name) for name in names]
        longest = max(map(len, rows))
        place = np.zeros((2, len(X)), dtype=int)
        padded = []
        for number, one in enumerate(rows):
            steps = np.diff(X[one, 2])
            if (steps < 0).any():
                row = one[int(np.argmax(steps < 0)) + 1]
                raise ValueError(
                    f"times of a curve must not decrease, but {X[row, 2]:g} is less than the time"
                    " before"
                )
            place[0, one], place[1, one] = np.arange(len(one)), number
            padded.append(np.r_[one, np.full(longest - len(one), one[-1])])
        at = np.array(padded).T
        first, second = X[at, 0], X[at, 1]
        squares = np.stack([first, second, 1 / (first * second)], axis=-1) ** 2
        return cls(X[at, 2], squares, (place[0], place[1]), at)

    def columns(self, branches: Sequence[Branch]) -> np.ndarray:
        """Return the nominal stresses of branches as if their moduli were 1, shape (n_rows,
        n_branches).
        """
        states = branch_states(self.time, self.squares, branches)[self.place]
        squares = self.squares[self.place]
        slopes = squares[:, None] / states
        return (slopes[..., 0] - slopes[..., 2]) / np.sqrt(squares[:, :1])

    def elastic(self, law: Law) -> tuple[np.ndarray, np.ndarray]:
        """Return the isochoric elastic energy of a law in each row, and its nominal stress, which
        is not softened.
        """
        logs = np.log(self.squares[self.place]) / 2
        energy, slopes = isochoric(law, logs)
        return energy, (slopes[:, 0] - slopes[:, 2]) * np.exp(-logs[:, 0])

    def energy(self, law: Law) -> np.ndarray:
        """Return the isochoric elastic energy of a law in each row."""
        return self.elastic(law)[0]

    def softened(self, softening: Softening | None, energy: np.ndarray) -> np.ndarray:
        """Return the factor of softening of each row, 1 without softening, by the energies."""
        if softening is None:
            return np.ones(len(energy))
        return softened(softening, energy, self.peak(energy))

    def stress(self, law: Law) -> np.ndarray:
        """Return the nominal stresses of a law with memory, shape (n_rows,)."""
        branches = law.memory.branches
        moduli = np.array([one.modulus for one in branches])
        energy, stress = self.elastic(law)
        stress = stress * self.softened(law.memory.softening, energy)
        return stress + self.columns(branches) @ moduli

    def greatest_overstress(self, branches: Sequence[Branch]) -> float:
        """Return the greatest overstress of branches, as if their moduli were 1."""
        squares = self.squares[..., None, :]
        ratios = squares / branch_states(self.time, self.squares, branches)
        found = ratios.sum(axis=-1) ** 2 / 3 - (1 / ratios).sum(axis=-1)
        return float(np.sqrt(found.max()))

    def peak(self, values: np.ndarray) -> np.ndarray:
        """Return the greatest value of a curve up to each of its rows."""
        return np.maximum.accumulate(values[self.row], axis=0)[self.place]

    @property
    def numbers(self) -> np.ndarray:
        """Number of the curve of each row, from 0."""
        return self.place[1]

    @property
    def strain(self) -> np.ndarray:
        """First invariant less 3 of each row."""
        return self.squares[self.place].sum(axis=-1) - 3

    def grid(self) -> np.ndarray:
        """Return relaxation times from the median interval between rows to the longest curve."""
        steps = [np.diff(one) for one in self.time.T]
        shortest = min(float(np.median(one[one > 0])) for one in steps if (one > 0).any())
        longest = float(np.ptp(self.time, axis=0).max())
        decades = np.log10(longest / shortest)
        return np.geomspace(shortest, longest, max(5, round(PER_DECADE * decades) + 1))


def constant(times: ArrayLike) -> list[Branch]:
    """Return branches of modulus 1 and constant times."""
    return [Branch(1.0, float(time)) for time in np.asarray(times)]


class Choice(NamedTuple):
    """Chosen relaxation times, and the errors of stresses that were left out.

    Attributes
    ----------
    times : ndarray, shape (n_branches,)
    errors : list of dict
        By number of branches: "branches" and "rms", the error of the stresses that were left out,
        relative to the greatest stress of their curve.
    """

    times: np.ndarray
    errors: list[dict]


class Candidates(NamedTuple):
    """Elastic columns, branches of modulus 1 at the times of a grid, and stresses, which a
    triangular matrix with the same products of columns may stand for.

    Attributes
    ----------
    elastic : ndarray, shape (n, n_elastic)
    relaxing : CubicSpline
        Columns of branches by the logarithm of their time, whose products with others keep.
    stress : ndarray, shape (n,)
    """

    elastic: np.ndarray
    relaxing: CubicSpline
    stress: np.ndarray

    @classmethod
    def of(cls, table: np.ndarray, logs: np.ndarray) -> "Candidates":
        """Return the candidates of a table of their columns."""
        fixed = table.shape[1] - 1 - len(logs)
        spline = CubicSpline(logs, table[:, fixed:-1], axis=1)
        return cls(table[:, :fixed], spline, table[:, -1])

    def solved(self, logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return coefficients, none negative, with branches of some times, and the residuals."""
        columns = np.column_stack([self.elastic, self.relaxing(logs)])
        found = nonnegative(columns, self.stress, np.ones(len(columns)))
        return found, columns @ found - self.stress

    def best(self, number: int) -> np.ndarray:
        """Return the logarithms of the `number` times that describe the stresses best."""
        grid = self.relaxing.x[:: PER_DECADE // COARSE]
        starts = map(np.array, combinations(grid, number))
        start = min(starts, key=lambda logs: np.linalg.norm(self.solved(logs)[1]))
        if not number:
            return start
        low, high = self.relaxing.x[[0, -1]]
        edge = 1e-6 * (high - low)
        start = np.clip(start, low + edge, high - edge)
        refined = least_squares(
            lambda logs: self.solved(logs)[1], start, bounds=(low, high), xtol=1e-6, max_nfev=50
        )
        return refined.x


def choose(
    elastic: np.ndarray,
    relaxing: np.ndarray,
    y: np.ndarray,
    grid: np.ndarray,
    curve: np.ndarray,
    number: int | None,
) -> Choice:
    """Return the times of branches that describe stresses y best together with elastic columns;
    `relaxing` are the columns of the times of a `grid`.

    Without a `number` of branches it is the least whose error of left-out stresses is within one
    standard error of the least error (Hastie, Tibshirani, Friedman, The elements of statistical
    learning, 2009, section 7.10). All columns and `y` are divided by the greatest stresses of the
    curves.
    """
    if number == 0:
        return Choice(np.empty(0), [])
    table, logs = np.column_stack([elastic, relaxing, y]), np.log(grid)

    def of(*parts: np.ndarray) -> Candidates:
        return Candidates.of(np.linalg.qr(np.vstack(parts), mode="r"), logs)

    if number is not None:
        return Choice(np.exp(of(table).best(number)), [])
    folds = list(_folds(curve))
    parts = [np.linalg.qr(table[fold], mode="r") for fold in folds]
    squares = np.zeros((len(folds), MOST_BRANCHES + 1))
    for place, fold in enumerate(folds):
        known, left = of(*parts[:place], *parts[place + 1 :]), of(table[fold])
        for size in range(MOST_BRANCHES + 1):
            times = known.best(size)
            columns = np.column_stack([left.elastic, left.relaxing(times)])
            off = columns @ known.solved(times)[0] - left.stress
            squares[place, size] = off @ off / len(fold)
    mean = squares.mean(axis=0)
    least = int(mean.argmin())
    spread = squares[:, least].std(ddof=1) / np.sqrt(len(folds))
    taken = int(np.argmax(mean <= mean[least] + spread))
    errors = [{"branches": size, "rms": float(np.sqrt(one))} for size, one in enumerate(mean)]
    return Choice(np.exp(of(table).best(taken)), errors)


def _folds(curve: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the rows of each curve, or of a block of successive rows of each of few curves."""
    rows = [np.flatnonzero(curve == one) for one in range(curve.max() + 1)]
    if len(rows) >= LEAST_CURVES:
        yield from rows
        return
    for one in rows:
        yield from (block for block in np.array_split(one, BLOCKS) if len(block))
