"""How far a training has come, for whoever asks: regressors are fitted within pipelines, which hand nothing of that out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[[int, int, float], None]

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Context in which trainings tell `listener` after every iteration its number, the most there can be, and the loss."""
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
