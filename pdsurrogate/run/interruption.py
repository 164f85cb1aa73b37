"""Interruption of a run by Ctrl-C or its time limit: the run ends soon, at its next consistent
state.
"""

from __future__ import annotations

import _thread
import math
import signal
import threading
import time

SECONDS_TO_HEAR = 1.0
"""Seconds after Ctrl-C within which a run should stop by itself; otherwise it is ended, with the
results saved so far. Chosen: most force evaluations take less, and the process still ends within
the two seconds that the guide promises.
"""


class Interrupted(RuntimeError):
    """Exception that stops a run after Ctrl-C or at its time limit, at a consistent state."""


class Interruption:
    """Context in which Ctrl-C requests the end of a run, and enforces it if the run does not react;
    a second Ctrl-C ends it at once.

    Outside the main thread, and where another handler of the signal is installed, the context
    leaves Ctrl-C as it is.

    Parameters
    ----------
    until : float
        Time by `time.perf_counter` at which the run should end.
    insists : bool
        Whether to end a run that does not react within `SECONDS_TO_HEAR`, since setting up a
        preconditioner, or compilation, may last minutes. False with several ranks, since the others
        would wait for the one that ended.
    """

    def __init__(self, until: float = math.inf, insists: bool = True) -> None:
        self.told = False
        self._until = until
        self._insists = insists
        self._before = None
        self._timer = None

    @property
    def out_of_time(self) -> bool:
        """Return whether the time limit of the run has passed."""
        return time.perf_counter() >= self._until

    @property
    def asked(self) -> bool:
        """Return whether the run should stop; to be read only at a consistent state, since
        reading it acknowledges the signal.
        """
        if self.told:
            self._hear()
        return self.told or self.out_of_time

    def __enter__(self) -> Interruption:
        if (
            threading.current_thread() is threading.main_thread()
            and signal.getsignal(signal.SIGINT) is signal.default_int_handler
        ):
            self._before = signal.signal(signal.SIGINT, self._ask)
        return self

    def __exit__(self, *exception) -> None:
        if self.told:
            self._hear()
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _ask(self, number, frame) -> None:
        self.told = True
        signal.signal(signal.SIGINT, self._before)
        if self._insists:
            self._timer = threading.Timer(SECONDS_TO_HEAR, _insist)
            self._timer.daemon = True
            self._timer.start()

    def _hear(self) -> None:
        heard.set()
        if self._timer is not None:
            self._timer.cancel()


def _insist() -> None:
    """Send the signal of Ctrl-C to the main thread, to end it even while it waits; on Windows
    only after a waiting call has returned.
    """
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
    else:
        _thread.interrupt_main()


heard = threading.Event()
"""Event that is set once an interrupted run ends by itself, so that nothing else has to end it."""
