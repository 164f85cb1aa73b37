"""The application that all commands share, its two consoles, and the exit on bad input."""

from __future__ import annotations

import json
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated

import typer
from rich.console import Console, RenderableType
from rich.markup import escape
from rich.measure import Measurement
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from ..ranks import ALONE, communicator


class _Commands(typer.core.TyperGroup):
    """Group of commands that reports wrong arguments as JSON where the command was to print JSON."""

    def invoke(self, ctx):
        settings.as_json, settings.printed = "--json" in (*getattr(ctx, "_protected_args", ()), *ctx.args), False
        try:
            return super().invoke(ctx)
        except Exception as error:
            if hasattr(error, "format_message"):
                _error_as_json(error.exit_code, error.format_message())
            raise
        finally:
            out.quiet = False  # as JSON had it


app = typer.Typer(
    name="pdsurrogate",
    cls=_Commands,
    help="Learnt bond forces of rubber-like materials, and a peridynamic solver that runs on them.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
SECONDS_BEFORE_THE_OTHERS = 5.0
"""Time that ranks have to come to the same end; then one that did not ends with those that did."""

MOST_COLUMNS = 10_000
"""More characters than the narrowest form of any table has in a line."""

out = Console()
err = Console(stderr=True)
_ranks = ALONE
"""Those that share the command, if it is one that ranks can share."""


@dataclass
class Settings:
    """Values of the options that all commands have; they are set when a command begins.

    Attributes
    ----------
    quiet : bool
        No progress and no remarks.
    as_json : bool
        Standard output is JSON.
    printed : bool
        There is something on it already.
    """

    quiet: bool = False
    as_json: bool = False
    printed: bool = False


settings = Settings()


def _version(asked: bool) -> None:
    if asked:
        from .. import __version__

        out.print(f"pdsurrogate {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def _before(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and end.")] = False,
) -> None:
    pass


def print_json(data) -> None:
    """Print data for programs, on standard output as it is."""
    settings.printed = True
    sys.stdout.write(json.dumps(data, indent=2) + "\n")


def _error_as_json(status: int, message: str) -> None:
    """Print as JSON why a command ends, where it was to print JSON and has not printed its results, which give the reason themselves."""
    if settings.as_json and not settings.printed and not _ranks.rank:
        print_json({"error": " ".join(message.split()), "exit_status": status})


def note(text: str) -> None:
    """Print a remark on standard error, unless none are wanted."""
    if not settings.quiet:
        err.print(escape(text), soft_wrap=True, highlight=False)


class Bar(Progress):
    """Progress columns: task, share done, time elapsed and left; below them the ``state`` of the task (counts, rate, residual, energy).

    A narrow terminal would cut all of it if it stood in one line.  Nothing is drawn where standard error is no terminal.
    """

    def __init__(self) -> None:
        columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
        super().__init__(*columns, console=err, transient=True, disable=settings.quiet or not err.is_terminal)

    def get_renderables(self) -> Iterator[RenderableType]:
        """Lines of every task."""
        for task in self.tasks:
            yield self.make_tasks_table([task])
            if task.fields["state"]:
                yield Text(task.fields["state"])


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[..., None]]:
    """Return a progress bar, called with the share done and a state in words; with another ``title`` it begins again under that."""
    with Bar() as bar:
        current, task = title, bar.add_task(escape(title), total=1.0, state="")

        def told(share: float, state: str, title: str = title) -> None:
            nonlocal current, task
            if title != current:
                bar.remove_task(task)
                current, task = title, bar.add_task(escape(title), total=1.0, state="")
            bar.update(task, completed=share, state=state)

        yield told


SOONEST = 0.5
"""Seconds after which a rate is told: before, it is that of what was there already."""


class Rate:
    """Rate of completed items in a second, or in a minute where less than one is done in a second."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._began, self._first = time.monotonic(), 0.0

    def begin(self, count: float = 0.0) -> None:
        """Measure from now on, when so many are done."""
        self._began, self._first = time.monotonic(), count

    def after(self, count: float) -> str:
        """The rate when so many are done, with a comma before it; empty where it is not known yet."""
        elapsed, done = time.monotonic() - self._began, count - self._first
        if elapsed < SOONEST or done <= 0:
            return ""
        rate = done / elapsed
        return f", {rate:.3g} {self._what}/s" if rate >= 1 else f", {60 * rate:.3g} {self._what}/min"


@contextmanager
def status(text: str) -> Iterator[Callable[[str], None]]:
    """A line that says what is being done; nothing where standard error is no terminal."""
    if settings.quiet or not err.is_terminal:
        yield lambda text: None
        return
    with err.status(text) as line:
        yield lambda text: line.update(escape(text))


def show(table: Table) -> None:
    """Print a table with all its words and figures whole.

    Columns break between words where the terminal is narrow, and where that is not enough the table is wider than it.  Only those with
    ``overflow="fold"``, for paths, break anywhere.
    """
    for column in table.columns:
        if column.overflow == "fold":
            continue
        cells = [Measurement.get(out, out.options, cell) for cell in (column.header, *column.cells)]
        column.min_width = max(cell.minimum for cell in cells)
    needed = Measurement.get(out, out.options.update(width=MOST_COLUMNS), table).minimum
    if needed > out.width:
        table.width = needed
    out.print(table, crop=False)


def only_the_first_speaks() -> None:
    """Let the first of several ranks speak for all of them.

    Raises
    ------
    NotUnderMPI
        If several processes were started that know nothing of each other.
    """
    global _ranks
    _ranks = communicator()
    err.quiet = _ranks.rank > 0
    out.quiet = out.quiet or err.quiet  # it may be JSON alone that is wanted
    _ranks.barrier()  # how long each took to start says nothing of how they end


def shared() -> bool:
    """Return whether several ranks share the command."""
    return _ranks.size > 1


def ended(status: int, *told: str) -> typer.Exit:
    """Return the exception that ends the command on all ranks, after one of them has printed the reason."""
    lines = [escape(text) if n else text for n, text in enumerate(told)]
    _error_as_json(status, " ".join(told[1:]))
    if not _ranks.rank:
        err.print(*lines, soft_wrap=True)
    if not _ranks.leave(SECONDS_BEFORE_THE_OTHERS) and _ranks.rank:
        err.quiet = False
        err.print(*lines, soft_wrap=True)
    return typer.Exit(status)


@contextmanager
def bad_input(*kinds: type[Exception]) -> Iterator[None]:
    """Turn errors about what the user gave into one line and exit status 2."""
    try:
        yield
    except kinds as error:
        text = f"{error.filename}: {error.strerror}" if isinstance(error, OSError) and error.filename else str(error)
        raise ended(2, "[red]pdsurrogate:[/]", " ".join(text.split())) from None


@contextmanager
def writing(folder) -> Iterator[None]:
    """Turn errors of writing results, a full disk above all, into one line and exit status 1."""
    try:
        yield
    except OSError as error:
        what = f"could not write {folder or error.filename or 'a file'}: {error.strerror or error}"
        raise ended(1, "[red]pdsurrogate:[/]", what) from None


@contextmanager
def said_aloud() -> Iterator[None]:
    """Print warnings that are for users, the package's own among them, as lines without the place in its source."""
    from ..forces import OutsideDomainWarning

    with warnings.catch_warnings():
        warnings.simplefilter("always", OutsideDomainWarning)
        before = warnings.showwarning

        def show(message, category, *where) -> None:
            if issubclass(category, UserWarning) or category.__module__.startswith(__package__.partition(".")[0]):
                err.print(f"[yellow]pdsurrogate:[/] {escape(str(message))}", soft_wrap=True)
            else:
                before(message, category, *where)

        warnings.showwarning = show
        yield


def law_of(name: str, changes: list[str] | None = None):
    """A law by name with parameters given as KEY=VALUE."""
    from ..scenes.reading import parse_change

    given = dict(parse_change(item) for item in changes or [])
    if "law" in given:
        raise ValueError(f"the law is given by its own option, not by --set law={given['law']}")
    return described_law({"law": name, **given})


def described_law(description: dict):
    """The law of a description, as a scene or a card states it."""
    from pydantic import ValidationError

    from ..scenes import MaterialSpec
    from ..scenes.reading import explain

    try:
        return MaterialSpec.model_validate(description).build()
    except ValidationError as error:
        raise ValueError(explain(error)) from None
