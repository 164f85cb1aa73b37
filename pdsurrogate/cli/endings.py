"""Ends of a command: errors as one line and an exit status, alone or on several ranks; Ctrl-C during a long call."""

from __future__ import annotations

import os
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

from ..run.interruption import heard
from .terminal import ERROR, complain, err, out, print_json, settings

if TYPE_CHECKING:
    from ..ranks import Communicator

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130
"""Exit statuses; the last one is 128 and the number of the signal, as shells have it."""

SECONDS_BEFORE_THE_OTHERS = 5.0
"""Time that ranks have to come to the same end; a rank that does not is ended with the others."""

SECONDS_TO_END = 1.7
"""Time after Ctrl-C until the process is ended; a run that has noticed it takes the time that it needs to save its state."""

_INTERRUPTED_IN_A_CALL = b"pdsurrogate: interrupted in the middle of a calculation; what had been saved before is kept\n"

_ranks: Communicator | None = None
"""Ranks that share the command; None for a command that one process carries out."""

_sender: socket.socket
"""Socket that Python writes signals to; it lives as long as the process."""


def share(ranks: Communicator) -> None:
    """Share the command among ranks, of which the first prints for all."""
    global _ranks
    _ranks = ranks
    err.quiet = ranks.rank > 0
    out.quiet = out.quiet or err.quiet  # also quiet for JSON
    ranks.barrier()  # the time that each took to start is no part of the time to end


def ended(status: int, reason: str, prefix: str = ERROR) -> typer.Exit:
    """Return the exception that ends the command on all ranks, after one of them has printed the reason."""
    first = _ranks is None or not _ranks.rank
    if first:
        error_as_json(status, reason)
        complain(reason, prefix)
    if _ranks is not None and not _ranks.leave(SECONDS_BEFORE_THE_OTHERS) and not first:
        err.quiet = False
        complain(reason, prefix)
    return typer.Exit(status)


def error_as_json(status: int, reason: str) -> None:
    """Print the reason as JSON if the command was to print JSON and has not done so: results give the reason themselves."""
    if settings.as_json and not settings.printed:
        print_json({"error": " ".join(reason.split()), "exit_status": status})


@contextmanager
def bad_input(*kinds: type[Exception]) -> Iterator[None]:
    """Turn errors in what the user gave into one line and exit status 2."""
    try:
        yield
    except kinds as error:
        text = f"{error.filename}: {error.strerror}" if isinstance(error, OSError) and error.filename else str(error)
        raise ended(BAD_INPUT, " ".join(text.split())) from None


@contextmanager
def writing(folder) -> Iterator[None]:
    """Turn errors in writing results, such as a full disk, into one line and exit status 1."""
    try:
        yield
    except OSError as error:
        reason = f"could not write {folder or error.filename or 'a file'}: {error.strerror or error}"
        raise ended(FAILED, reason) from None


def end_soon_after_interrupts() -> None:
    """End the process soon after Ctrl-C, also while it compiles or factorises a matrix: Python itself waits until such a call returns.

    A process that shares its command with others is not ended: they would wait for it.
    """
    if threading.current_thread() is not threading.main_thread() or os.name == "nt":
        return
    global _sender
    receiver, _sender = socket.socketpair()
    _sender.setblocking(False)
    signal.set_wakeup_fd(_sender.fileno(), warn_on_full_buffer=False)

    def watch() -> None:
        while numbers := receiver.recv(64):
            shared = _ranks is not None and _ranks.size > 1
            if signal.SIGINT in numbers and not shared and not heard.wait(SECONDS_TO_END):
                os.write(2, _INTERRUPTED_IN_A_CALL)
                os._exit(INTERRUPTED)

    threading.Thread(target=watch, name="interrupts", daemon=True).start()
