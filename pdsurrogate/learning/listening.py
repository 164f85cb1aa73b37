"""Progress of trainings, for a listener: scikit-learn's pipelines do not pass on the progress of the regressors in them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

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
