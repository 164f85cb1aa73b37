"""Progress of long work: simulations, fits, calibrations, comparisons and studies report events to
the function that listens to them.

The listener is a context variable, since scikit-learn's pipelines and searches pass nothing on to
their regressors.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[..., None]

COMPILING = "compiling"
"""Stage of the event that kernels are being compiled, which happens once on a machine."""

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


def event(stage: str, done: float, total: float, **numbers: float | str) -> None:
    """Report that `done` of `total` parts of a stage are done, with numbers by name, such as a
    residual.
    """
    if (listener := _listener.get()) is not None:
        listener(stage, done, total, **numbers)


@contextmanager
def listening(listener: Listener | None) -> Iterator[None]:
    """Context in which a function is called with the progress of all work of this package.

    Parameters
    ----------
    listener : callable or None
        ``listener(stage, done, total, **numbers)``: what is done, such as "equilibrium" or
        "training", how many of how many parts of it are done, and numbers by name, such as
        ``residual``; text may be among them. An error that it raises ends the work. None listens to
        nothing.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> stages = set()
    >>> with pds.progress.listening(lambda stage, done, total, **numbers: stages.add(stage)):
    ...     result = pds.simulate(
    ...         pds.load_scene("uniaxial", spacing=0.25, stretches=1.5), "neo-hookean"
    ...     )
    >>> "equilibrium" in stages
    True
    """
    before = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(before)


@contextmanager
def part(stage: str, number: int, count: int, **numbers: float | str) -> Iterator[None]:
    """Context of one of `count` parts of a stage, by its number from 0: events within it are
    progress of this part.
    """
    outer = _listener.get()
    event(stage, number, count, **numbers)
    if outer is None:
        yield
        return

    def of_part(_: str, done: float, total: float, **more: float | str) -> None:
        outer(stage, number + done / total, count, **numbers, **more)

    with listening(of_part):
        yield
