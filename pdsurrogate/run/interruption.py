"""Ctrl-C during a run: it ends at the next place where its state is whole."""

from __future__ import annotations

import signal
import threading


class Interrupted(RuntimeError):
    """The run was asked to stop."""

    def __init__(self) -> None:
        super().__init__("interrupted")


class Interruption:
    """Context in which the first interrupt asks, and the second one stops at once.

    Only the main thread is interrupted, and only where nobody else has laid claim to the signal.

    Attributes
    ----------
    asked : bool
        Whether the run is to stop at the next place where its state is whole.
    """

    def __init__(self) -> None:
        self.asked = False
        self._before = None

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            self._before = signal.signal(signal.SIGINT, self._ask)
        return self

    def __exit__(self, *exception) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _ask(self, number, frame) -> None:
        self.asked = True
        signal.signal(signal.SIGINT, self._before)
