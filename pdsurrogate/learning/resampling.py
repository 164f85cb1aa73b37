"""Resampling of a function of two or three features, or of a bond force, onto a cubic spline
that the kernels evaluate.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_lsq_spline

from ..kernels.bond_force import along_and_across
from ..kernels.feature_sets import FEATURE_SETS
from ..kernels.spline import SUPPORT

TOLERANCE = 1e-5
"""RMS error of a spline, divided by the RMS of the force, at which no more cells are tried: below
the error of single precision in the sums of a run, and far below the error of any fit.
"""

CELLS = {2: (8, 16, 32, 64), 3: (6, 12, 24)}
"""Cells along a feature to try in this order, by the number of features. Chosen: twice as many
cells reduce the error of a smooth function by sixteen; the last tables have 67 and 27 cubed
coefficients, well below `MOST_COEFFICIENTS`.
"""


WORTHWHILE = 0.8
"""Ratio of the error with twice as many cells to the error before, above which no more cells are
tried. A smooth function would reach a sixteenth; chosen near 1, so that only functions whose noise
or kinks decide the error end the search.
"""

MARGIN = 0.01
"""Extension of the box of features at either end, as a fraction of the range of a feature. Chosen:
bonds of a run that leave the sampled box by little stay within the spline; a wider margin spends
cells where no samples lie.
"""

PAIRS = 32
HALVINGS = 20
"""Number of pairs of neighboring samples with the greatest changes that are searched for jumps, and
of halvings of the interval between: 2^-20 is the interval of 1e-6 of jumps. Chosen: a function
with jumps, such as that of trees, has them between most of these pairs.
"""

ANGLES = np.arange(8) * (np.pi / 8) + 0.2
"""Angles of bonds to the greater principal stretch at which the outputs are fitted to a force:
eight, none along an axis, where bonds have no shear.
"""

LEAST_DISTORTION = 0.01
"""Value of the second isochoric feature, cosh log(lambda_1/lambda_2) - 1, below which a function is
extrapolated linearly from this value and its double: toward 0 the shear of bonds determines the
outputs less and less. Chosen: the principal stretches then differ by 15 %; with a smaller value
errors of the function are magnified more, with a greater one the straight line replaces more of it.
"""


class Spline(NamedTuple):
    """Cubic spline on a grid of equal cells: lower end `low` and cell size `step` of each
    feature, and `coefficients` of each output.
    """

    low: np.ndarray
    step: np.ndarray
    coefficients: np.ndarray


def fitted_spline(
    function: Callable, low: np.ndarray, high: np.ndarray, cells: int
) -> tuple[Spline, np.ndarray]:
    """Return the least-squares spline of a function over a box, and the sampled function values,
    shape (samples along a feature, …, 2).

    The box from `low` to `high` has `cells` cells along each of the n features. `function` returns
    outputs, shape (m, 2), of features, shape (m, n). Raise ValueError, with the place, for a value
    that is not finite.
    """
    n = len(low)
    # Three samples along each feature in a cell average steps and noise; with one the spline
    # would follow every step.
    places = np.linspace(0, cells, 3 * cells + 1)
    features = _grid(low, high, len(places))
    values = np.asarray(function(features), dtype=float)
    if values.shape != (len(features), 2):
        raise ValueError(
            f"the model returned values of shape {values.shape} for {len(features)} states, not"
            f" ({len(features)}, 2)"
        )
    if not np.isfinite(values).all():
        where = features[np.flatnonzero(~np.isfinite(values).all(axis=1))[0]]
        raise ValueError(
            "the model returned a value that is not finite at the features"
            f" {', '.join(f'{value:.4g}' for value in where)}"
        )
    values = values.reshape(*[len(places)] * n, 2)
    coefficients = np.moveaxis(values, -1, 0)
    knots = np.arange(1.0 - SUPPORT, cells + SUPPORT)
    for axis in range(1, n + 1):
        coefficients = np.moveaxis(
            make_lsq_spline(places, coefficients, knots, axis=axis).c, 0, axis
        )
    return Spline(low, (high - low) / cells, np.ascontiguousarray(coefficients)), values


def _grid(low, high, count) -> np.ndarray:
    """Return the points of a regular grid with `count` points along each of the n axes of a box,
    shape (count^n, n).
    """
    axes = [np.linspace(*ends, count) for ends in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(low))


def greatest_jump(
    function: Callable, low: np.ndarray, high: np.ndarray, values: np.ndarray
) -> float:
    """Return the greatest jump of a function, divided by its RMS, found by halving the intervals of
    greatest change between samples.

    The result is nearly 0 for a continuous function, and the greatest step near the samples for a
    piecewise constant function. `values` are the sampled function values that `fitted_spline`
    returns.
    """
    n = len(low)
    count = values.shape[0]
    features = _grid(low, high, count).reshape(*[count] * n, n)
    begins = []
    ends = []
    for axis in range(n):
        change = np.linalg.norm(np.diff(values, axis=axis), axis=-1)
        greatest = np.unravel_index(np.argsort(change, axis=None)[-PAIRS:], change.shape)
        begins.append(features[greatest])
        ends.append(
            features[tuple(index + (axis == other) for other, index in enumerate(greatest))]
        )
    begin = np.concatenate(begins)
    end = np.concatenate(ends)
    at_begin = function(begin)
    at_end = function(end)
    for _ in range(HALVINGS):
        middle = (begin + end) / 2
        at_middle = function(middle)
        first = (
            np.linalg.norm(at_middle - at_begin, axis=1)
            >= np.linalg.norm(at_end - at_middle, axis=1)
        )[:, None]
        begin = np.where(first, begin, middle)
        end = np.where(first, middle, end)
        at_begin = np.where(first, at_begin, at_middle)
        at_end = np.where(first, at_middle, at_end)
    return float(
        np.linalg.norm(at_end - at_begin, axis=1).max() / np.sqrt((values**2).sum(axis=-1).mean())
    )


def resampled(
    function: Callable, low, high, error: Callable[[Spline], float]
) -> tuple[Spline, float]:
    """Return a spline of a function with as many cells as `TOLERANCE` needs, and the jump of the
    function (0 if it is continuous).

    `low` and `high` are the ends of the box of features. ``error(spline)`` returns the error of the
    spline; more cells are tried only while they reduce the error enough (`WORTHWHILE`).
    """
    n = len(low)
    best = None
    least = np.inf
    for cells in CELLS[n]:
        spline, values = fitted_spline(function, low, high, cells)
        reached = error(spline)
        if reached < least:
            best = spline
        if reached <= TOLERANCE or reached > WORTHWHILE * least:
            break
        least = reached
        # A thousandth of the RMS within 1e-6 of the box: a continuous function would need a slope
        # of a thousand times its size per box.
        if cells == CELLS[n][0] and (jump := greatest_jump(function, low, high, values)) > 1e-3:
            # More cells would follow the steps of such a function, as of trees, not its trend.
            return fitted_spline(function, low, high, CELLS[n][1])[0], jump
    return best, 0.0


def isochoric_outputs_of(force: Callable) -> Callable:
    """Return a function from isochoric features, shape (k, 2), to the two outputs, shape (k, 2),
    that reproduce a bond force best.

    The outputs are the least-squares fit to ``force(stretch, rotation, length, C33, J)``,
    dimensionless, shape (m, 2), over several directions of the bond. The states have the undeformed
    volume (J3 = J sqrt(C33) = 1), and the bonds have half the length of the horizon. For an
    isotropic force the fitted outputs hold in every direction.
    """
    isochoric = FEATURE_SETS["isochoric"]

    def function(features: np.ndarray) -> np.ndarray:
        found = outputs(np.maximum(features, [-np.inf, LEAST_DISTORTION]))
        low = features[:, 1] < LEAST_DISTORTION
        if low.any():
            beyond = outputs(
                np.column_stack([features[low, 0], np.full(low.sum(), 2 * LEAST_DISTORTION)])
            )
            found[low] += (features[low, 1:] / LEAST_DISTORTION - 1) * (beyond - found[low])
        return found

    def outputs(features: np.ndarray) -> np.ndarray:
        ratio = np.arccosh(1 + features[:, 1])
        cos = np.cos(ANGLES)[:, None]
        sin = np.sin(ANGLES)[:, None]
        J = np.exp(features[:, 0])
        first, second = (np.sqrt(J) * np.exp(sign * ratio / 2) for sign in (1, -1))
        a = first * cos**2 + second * sin**2
        b = (second - first) * sin * cos
        c = first * sin**2 + second * cos**2
        a, b, c, J, C33 = (np.ravel(values) for values in np.broadcast_arrays(a, b, c, J, J**-2))
        stretch = np.hypot(a, b)
        t = np.asarray(force(stretch, np.arctan2(b, a), np.full(len(J), 0.5), C33, J), dtype=float)
        T = along_and_across(*t.T, a, -b, stretch)  # the rotation back
        # T_nn and T_nm are linear in the two outputs (`kernels.feature_sets.isochoric_traction`).
        shared = isochoric.shared(a, b, J, C33)
        by_output = np.stack(
            [
                np.stack(isochoric.traction(shared, *unit, a, b, c, J, C33)[:2], axis=1)
                for unit in np.eye(2)
            ],
            axis=2,
        )
        by_output = by_output.reshape(len(ANGLES), -1, 2, 2)
        T = T.reshape(len(ANGLES), -1, 2)
        normal = np.einsum("akij,akil->kjl", by_output, by_output)
        right = np.einsum("akij,aki->kj", by_output, T)
        return np.linalg.solve(normal, right[..., None])[..., 0]

    return function
