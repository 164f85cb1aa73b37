"""A step of the Levenberg-Marquardt algorithm, whatever the network."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

MOST_DAMPING = 1e12


def improved(
    weights: np.ndarray, loss: float, loss_of: Callable[[np.ndarray], float], normal: np.ndarray, gradient: np.ndarray, damping: float
) -> tuple[np.ndarray, float | None, float]:
    """One accepted step: raise the damping until the loss falls, lower it after.

    Parameters
    ----------
    weights : ndarray, shape (n,)
    loss : float
        There.
    loss_of : callable
        Loss at other weights.
    normal, gradient : ndarray, shapes (n, n) and (n,)
        J^T J and J^T r of the residuals r.
    damping : float
        Marquardt's parameter, relative to the diagonal of `normal`.

    Returns
    -------
    weights, loss, damping
        After the step; the loss is None if no damping makes the step an improvement.
    """
    diagonal = np.diag(normal) + 1e-12 * max(np.trace(normal), 1e-300)
    while damping < MOST_DAMPING:
        try:
            factor = cho_factor(normal + damping * np.diag(diagonal), check_finite=False)
            trial = weights - cho_solve(factor, gradient, check_finite=False)
        except LinAlgError:  # not positive definite
            damping *= 10
            continue
        trial_loss = loss_of(trial)
        if trial_loss < loss:
            return trial, trial_loss, max(damping / 5, 1e-14)
        damping *= 4
    return weights, None, damping
