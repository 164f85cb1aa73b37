"""Training of any network by the Levenberg-Marquardt algorithm, with its progress for a listener.

`scipy.optimize.least_squares` holds the whole Jacobian of all samples and outputs; here the normal equations are summed from parts of it.
scikit-learn's pipelines do not pass on the progress of the regressors in them, so a listener is a variable of the context.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from .base import COUNT, NOT_NEGATIVE, POSITIVE

MOST_DAMPING = 1e12
"""Damping, relative to the diagonal of the normal matrix, at which a step is below rounding and the training ends."""

CONSTRAINTS = {
    **dict.fromkeys(("max_iter", "n_iter_no_change", "n_init"), COUNT),
    "tol": NOT_NEGATIVE,
    "initial_damping": POSITIVE,
    "random_state": ["random_state"],
}
"""Constraints on the parameters that all regressors trained by this algorithm have."""


Listener = Callable[[int, int, float], None]

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Call `listener` after each iteration of a training in this context, with the iteration, the most iterations and the loss."""
    before = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(before)


def report_iteration(iteration: int, most: int, loss: float) -> None:
    """Call the listener of this context, if there is one, at the end of an iteration."""
    listener = _listener.get()
    if listener is not None:
        listener(iteration, most, loss)


def accepted_steps(
    regressor, number: int, weights: np.ndarray, loss_of: Callable[[np.ndarray], float], normal_equations: Callable
) -> Iterator[tuple[np.ndarray, float]]:
    """Yield the weights and the loss after each of at most ``max_iter`` accepted steps, and report them to a listener.

    Training `number` of the ``n_init`` of a regressor starts from `weights`. ``normal_equations(weights)`` returns J^T J and J^T r of the
    residuals r. It ends early where no damping makes a step an improvement: the loss is then at its least to rounding.
    """
    loss, damping, most = loss_of(weights), regressor.initial_damping, regressor.max_iter
    for iteration in range(number * most + 1, (number + 1) * most + 1):
        weights, loss, damping = improved(weights, loss, loss_of, *normal_equations(weights), damping)
        if loss is None:
            return
        report_iteration(iteration, regressor.n_init * most, loss)
        yield weights, loss


def improved(
    weights: np.ndarray, loss: float, loss_of: Callable[[np.ndarray], float], normal: np.ndarray, gradient: np.ndarray, damping: float
) -> tuple[np.ndarray, float | None, float]:
    """Return weights, loss and damping after a step; the damping is raised until the loss falls, and the loss is None if it never does.

    The damping is relative to the diagonal of `normal`, and is lowered after the step.
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
