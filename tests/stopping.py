"""Runs that are ended from outside, as a kill or Ctrl-C ends them."""

import signal
from contextlib import contextmanager

import pytest

from pdsurrogate.run.checkpoints import Checkpoints
from pdsurrogate.run.run import Silent


class Killed(Exception):
    """A kill."""


class KilledWhileBondsBreak(Silent):
    """Progress that kills a run in dynamics when more bonds are broken than `bonds`."""

    def __init__(self, bonds=20):
        self.bonds = bonds

    def dynamics(self, done, parameter, broken_bonds):
        if broken_bonds > self.bonds:
            raise Killed


class KilledAtLevel(Silent):
    """Progress that kills a run when it begins a level, by its number from 0."""

    def __init__(self, number):
        self.number = number

    def level(self, number, parameter):
        if number == self.number:
            self.end()

    def end(self):
        raise Killed


class InterruptedAtLevel(KilledAtLevel):
    """Progress that interrupts a run, as Ctrl-C does, when it begins a level, by its number from 0."""

    def end(self):
        signal.raise_signal(signal.SIGINT)


@contextmanager
def killed_with_levels(count):
    """Expect that a kill ends the run in the block, just after the checkpoint of its `count`-th level was written."""
    write = Checkpoints.write

    def stopping(checkpoints, *rest):
        write(checkpoints, *rest)
        if len(checkpoints.run.state.levels) == count:
            raise Killed

    with pytest.raises(Killed), pytest.MonkeyPatch.context() as patched:  # noqa: PT012 (the block is the caller's)
        patched.setattr(Checkpoints, "write", stopping)
        yield
