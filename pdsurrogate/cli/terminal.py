"""Output of commands on the terminal: tables, JSON, remarks and progress bars; ending of a
command in one process or on several ranks.
"""

import json
import logging
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta
from types import SimpleNamespace
from typing import Self

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.measure import measure_renderables
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from ..progress import COMPILING, listening
from ..run.interruption import heard

HELP_OPTIONS = {"help_option_names": ["-h", "--help"]}
"""Settings of every command, and of the group of commands, by which both options print help."""

SECONDS_BETWEEN_LINES = 30.0
"""Seconds between two lines about the progress of a task where standard error is not a terminal.
Chosen: a minute tells something, and the log of an hour has some hundred lines.
"""

ERROR = "[red]pdsurrogate:[/]"
WARNING = "[yellow]pdsurrogate:[/]"
"""Beginnings of lines on standard error."""

FAILED = 1
BAD_INPUT = 2
INTERRUPTED = 130
"""Exit statuses; the last one is 128 and the number of the signal, as shells have it."""

SECONDS_BEFORE_THE_OTHERS = 5.0
"""Seconds that the ranks have to end the command together; the ranks that have not ended by then
are killed. Chosen: a rank at work hears of an error after its present force evaluation; a longer
wait only blocks the cores of a failed run.
"""

SECONDS_TO_END = 1.7
"""Time after Ctrl-C until the process is ended; a run that has noticed it takes the time that it
needs to save its state. Chosen above `SECONDS_TO_HEAR` of `run.interruption`, and below the two
seconds that the guide promises.
"""

_INTERRUPTED_IN_A_CALL = (
    b"pdsurrogate: interrupted during a calculation; results that were already written are kept\n"
)

_ranks = None
"""Communicator of the ranks that share the command; None for a command that one process carries
out.
"""

GAP = 2
"""Number of characters between two columns of a table."""

out = Console()
err = Console(stderr=True)


settings = SimpleNamespace(quiet=False, as_json=False, printed=False)
"""State of the output of the present command. `quiet`: neither progress nor remarks are printed;
`as_json`: standard output is JSON; both are set when the command begins. `printed`: JSON has been
printed.
"""


def print_json(data) -> None:
    """Print data as JSON on standard output, if the user gave ``--json``; on several ranks only
    the first rank prints.
    """
    if settings.as_json and not err.quiet:
        settings.printed = True
        sys.stdout.write(json.dumps(data, indent=2) + "\n")


def error_as_json(status: int, reason: str) -> None:
    """Print the reason of an error and the exit status as JSON, unless a result in JSON, which
    states the reason, was printed before.
    """
    if not settings.printed:
        print_json({"error": " ".join(reason.split()), "exit_status": status})


def note(text: str) -> None:
    """Print a remark on standard error, unless the user gave ``--quiet``."""
    if not settings.quiet:
        on_standard_error(escape(text))


def warn(text: str) -> None:
    """Print a warning, in yellow, on standard error."""
    on_standard_error(f"[yellow]{escape(text)}[/]")


def complain(text: str, prefix: str = ERROR) -> None:
    """Print a line on standard error after a prefix, by default the name of the program in red."""
    on_standard_error(f"{prefix} {escape(text)}")


def on_standard_error(text: str) -> None:
    """Print one line on standard error; a terminal gets it broken between words, at its width."""
    err.print(text, soft_wrap=not err.is_terminal, highlight=False)


def print_table(
    title: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    left: int,
) -> None:
    """Print a title and a table of text on standard output; cells that are too wide for the
    terminal are folded, in columns without a space only if the words of the others do not fit.

    Parameters
    ----------
    title : str
    columns : sequence of str
        Headings.
    rows : iterable
        Cells of each row.
    left : int
        Number of columns, from the first, that are left-aligned, while the others are
        right-aligned.
    """
    table = Table(box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0), pad_edge=False)
    headings = [*map(escape, columns)]
    rows = list(rows)
    sizes = [
        measure_renderables(out, out.options, cells) for cells in zip(headings, *rows, strict=True)
    ]
    fits = sum(size.minimum + GAP for size in sizes) - GAP <= out.width
    for number, (heading, size) in enumerate(zip(headings, sizes, strict=True)):
        justify = "right" if number >= left else "left"
        # rich narrows the widest columns that have no width, even below their longest word
        width = size.maximum if fits and size.span == 0 else None
        table.add_column(heading, justify=justify, overflow="fold", width=width)
    for row in rows:
        table.add_row(*row)
    out.print(title, style="bold", markup=False, highlight=False)
    out.print(table)
    out.print()


def print_rows(title: str, rows: Sequence[dict], form: str = ".4g") -> None:
    """Print a table of dictionaries, whose keys are the headings: text, numbers, and None, which is
    left empty; without rows print nothing.
    """
    if rows:
        columns = list(dict.fromkeys(column for row in rows for column in row))
        cells = (
            [
                f"{one:{form}}"
                if isinstance(one, float)
                else escape(str("" if one is None else one))
                for one in map(row.get, columns)
            ]
            for row in rows
        )
        left = sum(isinstance(one, str) for one in rows[0].values())
        print_table(title, [column.replace("_", " ") for column in columns], cells, left)


class Bar(Progress):
    """Progress bar that shows the events of a context: title, share done, time elapsed and left,
    counts and numbers.

    If standard error is not a terminal, a line every `SECONDS_BETWEEN_LINES` says the same; with
    ``--quiet`` there is neither.
    """

    def __init__(self, name: str = "") -> None:
        # The time left follows from the mean speed: single runs of a comparison take minutes, more
        # than a window of the last half a minute.
        super().__init__(
            TextColumn("{task.description}"),
            BarColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[state]}"),
            console=err,
            transient=True,
            disable=settings.quiet or not err.is_terminal,
            get_time=time.monotonic,
            speed_estimate_period=math.inf,
        )
        self._name = name
        self._told = time.monotonic()

    def __enter__(self) -> Self:
        self._listening = listening(self.event)
        self._listening.__enter__()
        self.event("", 0, 1)
        return super().__enter__()

    def __exit__(self, *error) -> None:
        super().__exit__(*error)
        self._listening.__exit__(*error)

    def event(self, stage: str, done: float, total: float, **numbers: float | str) -> None:
        """Show an event of `pdsurrogate.progress`; a new stage begins a new bar."""
        if stage == COMPILING:
            note("Compiling kernels; later runs on this machine load them from the cache.")
            return
        title = escape(": ".join(filter(None, (self._name, stage))))
        if [task.description for task in self.tasks] != [title]:
            for task in self.task_ids:
                self.remove_task(task)
            self.add_task(title, completed=done, total=total, state="")
        counted = [f"{int(done)} of {total:g}"] if total > 1 else []
        named = (
            one if isinstance(one, str) else f"{name.replace('_', ' ')} {one:.4g}"
            for name, one in numbers.items()
        )
        state = ", ".join([*counted, *named])
        self.update(self.task_ids[0], completed=done, state=state)
        if not err.is_terminal and time.monotonic() - self._told > SECONDS_BETWEEN_LINES:
            self._told = time.monotonic()
            left = self.tasks[0].time_remaining
            rest = "" if left is None else f", about {timedelta(seconds=int(left))} left"
            note(f"{title}: {100 * done / total:.0f} % done{rest}{state and f'; {state}'}")


def use_ranks(ranks) -> None:
    """Register the communicator whose ranks share this command: from now on only the first rank
    prints, and all ranks end together.
    """
    global _ranks
    _ranks = ranks
    err.quiet = ranks.rank > 0
    out.quiet = out.quiet or err.quiet  # also quiet for JSON
    ranks.barrier()  # the time that each took to start is no part of the time to end


def ended(status: int, reason: str, prefix: str = ERROR) -> typer.Exit:
    """Print the reason of an error, on one rank only, and return the exception that ends the
    command with an exit status.
    """
    error_as_json(status, reason)
    complain(reason, prefix)
    if _ranks is not None and not _ranks.leave(SECONDS_BEFORE_THE_OTHERS) and err.quiet:
        err.quiet = False
        complain(reason, prefix)
    return typer.Exit(status)


@contextmanager
def bad_input(*kinds: type[Exception], status: int = BAD_INPUT) -> Iterator[None]:
    """Turn errors of given kinds, raised in a context, into one line on standard error and an
    exit status, by default 2 (bad input).
    """
    try:
        yield
    except kinds as error:
        if isinstance(error.__context__, KeyboardInterrupt):  # which kept a file from being closed
            raise error.__context__ from None
        text = (
            f"{error.filename}: {error.strerror}"
            if isinstance(error, OSError) and error.filename
            else str(error)
        )
        raise ended(status, " ".join(text.split())) from None


@contextmanager
def writing(folder) -> Iterator[None]:
    """Turn an OSError raised in a context that writes results, such as a full disk, into one
    line on standard error and exit status 1.
    """
    try:
        yield
    except OSError as error:
        reason = (
            f"could not write {folder or error.filename or 'a file'}: {error.strerror or error}"
        )
        raise ended(FAILED, reason) from None


def end_soon_after_interrupts() -> None:
    """Make Ctrl-C end the process soon, also while it compiles or factorizes a matrix: Python
    itself waits until such a call returns.

    In a run on several MPI ranks no process is ended in this way, because the remaining ranks would
    wait for it.
    """
    # Files that an interrupt leaves half written fail when Python closes them, which would print a
    # traceback.
    sys.unraisablehook = lambda failed: logging.getLogger("pdsurrogate").debug(
        "ignored %r in %r", failed.exc_value, failed.object
    )
    if threading.current_thread() is not threading.main_thread() or os.name == "nt":
        return
    receiver, sender = os.pipe()
    os.set_blocking(sender, False)
    signal.set_wakeup_fd(sender, warn_on_full_buffer=False)

    def watch() -> None:
        while numbers := os.read(receiver, 64):
            shared = _ranks is not None and _ranks.size > 1
            if signal.SIGINT in numbers and not shared and not heard.wait(SECONDS_TO_END):
                os.write(2, _INTERRUPTED_IN_A_CALL)
                os._exit(INTERRUPTED)

    threading.Thread(target=watch, name="interrupts", daemon=True).start()
