"""Any function of two or three features, or of bonds, resampled onto a cubic spline that the kernels evaluate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..kernels.feature_sets import FEATURE_SETS
from ..kernels.spline import SUPPORT, cubic_weights

TOLERANCE = 1e-5
"""Error of resampling, RMS of the force over the RMS of the force, that is asked for: below that of single precision in a simulation's sums
and far below that of any fit."""

CELLS = {2: (8, 16, 32, 64), 3: (6, 12, 24)}
"""Cells along a feature that are tried one after the other, by the number of features."""

CELLS_OF_JUMPS = {2: 16, 3: 12}
"""Those for a function that jumps, as trees do: finer ones follow its steps more closely, and what is wanted is what lies under them."""

PER_CELL = 3
"""Samples along each feature in a cell; a spline is their least-squares fit, so that steps and noise are averaged."""

WORTHWHILE = 0.8
"""Share of its error that twice as many cells must leave at most; else what is left is no matter of cells."""

MARGIN = 0.01
"""Of the range of a feature that the box goes beyond it at either end."""

JUMP = 1e-3
"""Change over an interval of 1e-6 of the box, in parts of the RMS of the outputs, from which a function is said to jump."""

PAIRS, HALVINGS = 32, 20
"""Neighbouring samples with the greatest changes that are looked into for jumps, and how often the way between is halved."""

ANGLES = np.arange(8) * (np.pi / 8) + 0.2
"""Directions of bonds to the greater principal stretch, at which a force is asked for its two outputs."""

LEAST_DISTORTION = 0.01
"""Of tr Cbar/(2 Jbar) - 1: below it a function of bonds is continued along a straight line from there and from twice as much, as towards 0
the shear of bonds says less and less about the outputs."""


@dataclass(frozen=True)
class Spline:
    """A cubic spline of even cells: `low` and `step` by feature, and `coefficients` by output."""

    low: np.ndarray
    step: np.ndarray
    coefficients: np.ndarray


def fitted_spline(function: Callable, low: np.ndarray, high: np.ndarray, cells: int) -> tuple[Spline, np.ndarray]:
    """Least-squares spline of a function over a box, and the samples that it was fitted to.

    Parameters
    ----------
    function : callable
        Outputs, shape (m, 2), of features, shape (m, n).
    low, high : ndarray, shape (n,)
        Of the box.
    cells : int
        Along every feature.

    Returns
    -------
    Spline
    values : ndarray, shape (samples along a feature, …, 2)

    Raises
    ------
    ValueError
        If the function has a value that is not finite; says where.
    """
    n = len(low)
    places = np.linspace(0, cells, PER_CELL * cells + 1)
    features = _grid(low, high, len(places))
    values = np.asarray(function(features), dtype=float)
    if values.shape != (len(features), 2):
        raise ValueError(f"the model gives values of shape {values.shape} for {len(features)} states, not ({len(features)}, 2)")
    if not np.isfinite(values).all():
        where = features[np.flatnonzero(~np.isfinite(values).all(axis=1))[0]]
        raise ValueError(f"the model has no finite value at features {', '.join(f'{value:.4g}' for value in where)}")
    values = values.reshape(*[len(places)] * n, 2)
    cell = np.minimum(np.floor(places), cells - 1).astype(int)
    basis = np.zeros((len(places), cells + SUPPORT - 1))
    for offset, weight in enumerate(cubic_weights(places - cell)):
        basis[np.arange(len(places)), cell + offset] = weight
    solve, coefficients = np.linalg.pinv(basis), np.moveaxis(values, -1, 0)
    for axis in range(1, n + 1):
        coefficients = np.moveaxis(np.tensordot(solve, coefficients, (1, axis)), 0, axis)
    return Spline(low, (high - low) / cells, np.ascontiguousarray(coefficients)), values


def _grid(low, high, count) -> np.ndarray:
    axes = [np.linspace(*ends, count) for ends in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(low))


def greatest_jump(function: Callable, low: np.ndarray, high: np.ndarray, values: np.ndarray) -> float:
    """Greatest change of a function that is left when the way between neighbouring samples is halved, in parts of its RMS.

    Of a continuous function nothing is left; of one made of steps the greatest step near the samples.

    Parameters
    ----------
    function, low, high
        See `fitted_spline`.
    values : ndarray
        Its samples.
    """
    n, count = len(low), values.shape[0]
    features = _grid(low, high, count).reshape(*[count] * n, n)
    begins, ends = [], []
    for axis in range(n):
        change = np.linalg.norm(np.diff(values, axis=axis), axis=-1)
        greatest = np.unravel_index(np.argsort(change, axis=None)[-PAIRS:], change.shape)
        begins.append(features[greatest])
        ends.append(features[tuple(index + (axis == other) for other, index in enumerate(greatest))])
    begin, end = np.concatenate(begins), np.concatenate(ends)
    at_begin, at_end = function(begin), function(end)
    for _ in range(HALVINGS):
        middle = (begin + end) / 2
        at_middle = function(middle)
        first = (np.linalg.norm(at_middle - at_begin, axis=1) >= np.linalg.norm(at_end - at_middle, axis=1))[:, None]
        begin, end = np.where(first, begin, middle), np.where(first, middle, end)
        at_begin, at_end = np.where(first, at_begin, at_middle), np.where(first, at_middle, at_end)
    return float(np.linalg.norm(at_end - at_begin, axis=1).max() / np.sqrt((values**2).sum(axis=-1).mean()))


def resampled(function: Callable, low, high, error: Callable[[Spline], float]) -> tuple[Spline, float]:
    """A spline of as many cells as the tolerance asks for, and the jump of the function (0 if it is continuous).

    Parameters
    ----------
    function, low, high
        See `fitted_spline`.
    error : callable
        Error of resampling of a spline.
    """
    n, jump, best, least = len(low), None, None, np.inf
    for cells in CELLS[n]:
        spline, values = fitted_spline(function, low, high, cells)
        reached = error(spline)
        if reached < least:
            best = spline
        if reached <= TOLERANCE or reached > WORTHWHILE * least:
            break
        least = reached
        if jump is None:
            jump = greatest_jump(function, low, high, values)
            if jump > JUMP:
                return fitted_spline(function, low, high, CELLS_OF_JUMPS[n])[0], jump
    return best, 0.0


def isochoric_outputs_of(force: Callable) -> Callable:
    """The outputs of the isochoric features that a bond force has, by least squares over the directions of a bond.

    The states have J3 = 1, and bonds half as long as the horizon.  A force that is isotropic has the same outputs in all directions.

    Parameters
    ----------
    force : callable
        ``force(stretch, rotation, length, C33, J)``, dimensionless, shape (m, 2).
    """

    def function(features: np.ndarray) -> np.ndarray:
        found, low = outputs(np.maximum(features, [-np.inf, LEAST_DISTORTION])), features[:, 1] < LEAST_DISTORTION
        if low.any():
            beyond = outputs(np.stack([features[low, 0], np.full(low.sum(), 2 * LEAST_DISTORTION)], axis=1))
            found[low] += (features[low, 1:] / LEAST_DISTORTION - 1) * (beyond - found[low])
        return found

    def outputs(features: np.ndarray) -> np.ndarray:
        J = np.exp(features[:, 0])
        ratio = np.arccosh(1 + features[:, 1])
        first, second = (np.sqrt(J) * np.exp(sign * ratio / 2) for sign in (1, -1))
        C33 = J**-2
        normal, right = np.zeros((len(J), 2, 2)), np.zeros((len(J), 2))
        for angle in ANGLES:
            cos, sin = np.cos(angle), np.sin(angle)
            a, b, c = first * cos**2 + second * sin**2, (second - first) * sin * cos, first * sin**2 + second * cos**2
            stretch = np.hypot(a, b)
            t = np.asarray(force(stretch, np.arctan2(b, a), np.full(len(J), 0.5), C33, J), dtype=float)
            T = np.stack([t[:, 0] * a - t[:, 1] * b, t[:, 0] * b + t[:, 1] * a], axis=1) / stretch[:, None]
            # T_nn and T_nm as they depend on the two outputs, which is linearly (`kernels.feature_sets.isochoric_traction`).
            by_output = np.empty((len(J), 2, 2))
            for output, unit in enumerate(((1.0, 0.0), (0.0, 1.0))):
                shared = FEATURE_SETS["isochoric"].shared(a, b, J, C33)
                T_nn, T_nm, _ = FEATURE_SETS["isochoric"].traction(shared, *unit, a, b, c, J, C33)
                by_output[:, 0, output], by_output[:, 1, output] = T_nn, T_nm
            normal += np.einsum("kij,kil->kjl", by_output, by_output)
            right += np.einsum("kij,ki->kj", by_output, T)
        return np.linalg.solve(normal, right[..., None])[..., 0]

    return function
