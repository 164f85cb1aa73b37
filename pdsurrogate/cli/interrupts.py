"""Ctrl-C that no call holds up: the process ends soon, also while it compiles or factorises a matrix."""

from __future__ import annotations

import os
import signal
import socket
import threading

from ..run.interruption import heard

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells give it: 128 and the number of the signal."""

SECONDS_TO_END = 1.7
"""After an interrupt; a run that has heard it takes the time that it needs to save its state."""

_SAID = b"pdsurrogate: interrupted in the middle of a calculation; what had been saved before is kept\n"


def end_soon_after_interrupts(together) -> None:
    """Watch from a thread of its own for interrupts that Python itself hears of only when a call returns.

    Parameters
    ----------
    together : callable
        Says whether other processes wait for this one, which then is not ended in the middle of anything.
    """
    if threading.current_thread() is not threading.main_thread() or os.name == "nt":
        return
    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)

    def watch() -> None:
        while numbers := receiver.recv(64):
            if signal.SIGINT in numbers and not together() and not heard.wait(SECONDS_TO_END):
                os.write(2, _SAID)
                os._exit(INTERRUPTED)

    threading.Thread(target=watch, name="interrupts", daemon=True).start()
    # The sender lives as long as the process, which its number is with.
    _kept.append(sender)


_kept: list[socket.socket] = []
