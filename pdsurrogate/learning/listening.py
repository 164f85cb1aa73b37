"""Progress of a training for a listener: pipelines do not pass on any progress of the regressors in them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[[int, int, float], None]

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Call `listener` after every iteration of trainings in this context with its number, the greatest number, and the loss."""
    before = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(before)


def tell(iteration: int, most: int, loss: float) -> None:
    """Say that an iteration has ended, if anyone listens."""
    listener = _listener.get()
    if listener is not None:
        listener(iteration, most, loss)
