"""Runs that are ended from outside, as a kill or Ctrl-C ends them."""

import signal
from contextlib import contextmanager

import pytest

from pdsurrogate.progress import listening
from pdsurrogate.run.checkpoints import Checkpoints


class Killed(Exception):
    """A kill."""


def kill():
    raise Killed


def interrupt():
    """End a run as Ctrl-C does."""
    signal.raise_signal(signal.SIGINT)


def while_bonds_break(bonds=20, end=kill):
    """Context that ends a run when more bonds are broken than `bonds`."""

    def listener(stage, done, total, **numbers):
        if numbers.get("broken_bonds", 0) > bonds:
            end()

    return listening(listener)


def at_level(number, end=kill):
    """Context that ends a run when it begins the search for an output in equilibrium, by its
    number from 0.
    """

    def listener(stage, done, total, **numbers):
        if stage == "equilibrium" and done == number and "residual" not in numbers:
            end()

    return listening(listener)


@contextmanager
def killed_with_levels(count):
    """Expect that a kill ends the run in the block, just after the checkpoint of its `count`-th
    level was written.
    """
    write = Checkpoints.write

    def stopping(checkpoints, *rest):
        write(checkpoints, *rest)
        if len(checkpoints.run.state.levels) == count:
            raise Killed

    with pytest.raises(Killed), pytest.MonkeyPatch.context() as patched:  # noqa: PT012 (caller's block)
        patched.setattr(Checkpoints, "write", stopping)
        yield
