"""Standard output and standard error: tables, JSON, remarks and progress."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from rich.console import Console, RenderableType
from rich.markup import escape
from rich.measure import Measurement
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

MOST_COLUMNS = 10_000
"""Width, in characters, that no line of a table in its narrowest form reaches."""

SOONEST = 0.5
"""Seconds after which `Rate` gives a rate: an earlier one would mostly measure the start."""

ERROR, WARNING = "[red]pdsurrogate:[/]", "[yellow]pdsurrogate:[/]"
"""Beginnings of lines on standard error."""

out = Console()
err = Console(stderr=True)


@dataclass
class Settings:
    """Values of the options that all commands have, set when a command begins.

    Attributes
    ----------
    quiet : bool
        Neither progress nor remarks are printed.
    as_json : bool
        Standard output is JSON.
    printed : bool
        JSON has been printed.
    """

    quiet: bool = False
    as_json: bool = False
    printed: bool = False


settings = Settings()


def print_json(data) -> None:
    """Print data for programs."""
    settings.printed = True
    sys.stdout.write(json.dumps(data, indent=2) + "\n")


def note(text: str) -> None:
    """Print a remark on standard error, unless the user wants none."""
    if not settings.quiet:
        err.print(escape(text), soft_wrap=True, highlight=False)


def warn(text: str) -> None:
    """Print on standard error what the user should look at."""
    err.print(f"[yellow]{escape(text)}[/]", soft_wrap=True)


def complain(text: str, prefix: str = ERROR) -> None:
    """Print a line on standard error under the name of the program."""
    err.print(prefix, escape(text), soft_wrap=True)


def print_table(
    title: str, columns: Sequence[str], rows: Iterable[Sequence[str] | None], left: int | None = None, folds: Sequence[str] = (), **options
) -> None:
    """Print a table.

    Parameters
    ----------
    title : str
    columns : sequence of str
        Headings.
    rows : iterable
        Cells of each row; None draws a line.
    left : int, optional
        Number of columns, from the first, that are justified left, with the others justified right; by default all.
    folds : sequence of str
        Columns that may break anywhere, such as those of paths.
    **options
        See `rich.table.Table`.
    """
    table = Table(title=title, title_justify="left", **options)
    for number, heading in enumerate(columns):
        justify = "right" if left is not None and number >= left else "left"
        table.add_column(heading, justify=justify, overflow="fold" if heading in folds else "ellipsis")
    for row in rows:
        if row is None:
            table.add_section()
        else:
            table.add_row(*row)
    show(table)


def show(table: Table) -> None:
    """Print a table with all its words and figures whole.

    Columns break between words where the terminal is narrow, and where that is not enough the table is wider than the terminal. Only
    columns with ``overflow="fold"``, for paths, break anywhere.
    """
    for column in table.columns:
        if column.overflow != "fold":
            cells = [Measurement.get(out, out.options, cell) for cell in (column.header, *column.cells)]
            column.min_width = max(cell.minimum for cell in cells)
    needed = Measurement.get(out, out.options.update(width=MOST_COLUMNS), table).minimum
    if needed > out.width:
        table.width = needed
    out.print(table, crop=False)


class Bar(Progress):
    """Progress columns: task, share done, time elapsed and left; below them the ``state`` of the task (counts, rate, residual, energy).

    A narrow terminal would cut the state if it stood in the same line. Nothing is drawn if standard error is no terminal.
    """

    def __init__(self) -> None:
        columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
        super().__init__(*columns, console=err, transient=True, disable=settings.quiet or not err.is_terminal)

    def get_renderables(self) -> Iterator[RenderableType]:
        """Yield the lines of every task."""
        for task in self.tasks:
            yield self.make_tasks_table([task])
            if task.fields["state"]:
                yield Text(task.fields["state"])


@contextmanager
def progress_bar(title: str = "") -> Iterator[Callable[..., None]]:
    """Yield a function that shows the share done and a state in words, under another ``title`` in a new bar."""
    with Bar() as bar:
        current = None

        def shown(share: float, state: str = "", title: str = title) -> None:
            nonlocal current
            if title != current:
                for task in bar.task_ids:
                    bar.remove_task(task)
                current = title
                bar.add_task(escape(title), completed=share, total=1.0, state=state)
            bar.update(bar.task_ids[0], completed=share, state=state)

        if title:
            shown(0.0)
        yield shown


@contextmanager
def counting_bar(items: str, title: str = "") -> Iterator[Callable[..., None]]:
    """Yield a function that shows how many of all items are done, their rate, and a state in words, as `progress_bar` does."""
    rates: dict[str, Rate] = {}
    with progress_bar(title) as shown:

        def counted(done: float, total: int, state: str = "", title: str = title) -> None:
            rate = rates.setdefault(title, Rate(items, done))
            shown(done / total, f"{int(done)} of {total} {items}{rate.after(done)}{state and f', {state}'}", title)

        yield counted


class Rate:
    """Rate of completed items since a count, in a second, or in a minute if fewer than one is completed in a second."""

    def __init__(self, items: str, count: float = 0.0) -> None:
        self._items, self._began, self._first = items, time.monotonic(), count

    def after(self, count: float) -> str:
        """Return the rate at `count` items, with a comma before it; an empty text if it is not known yet."""
        elapsed, done = time.monotonic() - self._began, count - self._first
        if elapsed < SOONEST or done <= 0:
            return ""
        rate = done / elapsed
        return f", {rate:.3g} {self._items}/s" if rate >= 1 else f", {60 * rate:.3g} {self._items}/min"


@contextmanager
def status(text: str) -> Iterator[None]:
    """Show a line on what is being done; nothing if standard error is no terminal."""
    if settings.quiet or not err.is_terminal:
        yield
        return
    with err.status(escape(text)):
        yield
