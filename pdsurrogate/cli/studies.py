"""The command that runs many scenes, or fits many surrogates."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from .application import Bar, Rate, bad_input, err, note, print_json, writing
from .common import AsJson, MaxTime, command
from .interrupts import INTERRUPTED

MOST_FAILURES = 5
"""Number of failures printed one by one; the table lists them all."""


@command()
def study(
    description: Annotated[
        Path, typer.Argument(metavar="STUDY", help="Path of a study file (.toml): a scene or a fit, and its parameters.")
    ],
    folder: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder for runs, table and figure (default: named after the file).")
    ] = None,
    jobs: Annotated[int | None, typer.Option(help="Number of parallel runs (default: as many as the cores allow).", min=1)] = None,
    threads: Annotated[int | None, typer.Option(help="Threads of each run (default: cores divided by jobs).", min=1)] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Address of a Dask scheduler that executes the runs, such as tcp://host:8786.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Overwrite the table of another study in DIR; its runs are kept.")] = False,
    max_time: MaxTime = None,
    as_json: AsJson = False,
) -> None:
    """Run a scene with many parameters, or fit many surrogates, in parallel; finished runs are reused."""
    from ..artifacts import ArtifactError
    from ..results.folder import FolderTaken
    from ..scenes import SceneError
    from ..studies import StudyInterrupted
    from ..studies import study as carry_out
    from ..studies.study import FIGURE, TABLE

    folder = Path(description.stem) if folder is None else folder
    interrupted = None
    try:
        with bad_input(SceneError, ArtifactError, FolderTaken, ValueError), writing(folder), _StudyBar(description.stem) as bar:
            options = {"jobs": jobs, "threads": threads, "scheduler": scheduler, "overwrite": overwrite, "max_time": max_time}
            result = carry_out(description, folder, **options, progress=bar)
    except StudyInterrupted as error:
        interrupted, result = error, error.result
    if result.failures:
        err.print(f"[yellow]{len(result.failures)} of {len(result.rows)} runs failed:[/]", soft_wrap=True)
        for row in result.failures[:MOST_FAILURES]:
            told = ", ".join(f"{key}={row[key]}" for key in result.study.parameters)
            err.print(escape(f"  {row['run']} ({told}): {row['failure']}"), soft_wrap=True, highlight=False)
        if len(result.failures) > MOST_FAILURES:
            err.print(f"  and {len(result.failures) - MOST_FAILURES} more, see the table")
    for caution in result.cautions():
        err.print(f"[yellow]{escape(caution)}[/]", soft_wrap=True)
    figure = f" and {FIGURE}" if (result.folder / FIGURE).exists() else ""
    if as_json:
        print_json(result.rows)
    note(f"{len(result.rows)} runs: {TABLE}{figure} in {folder}")
    if interrupted is not None:
        err.print(f"[yellow]pdsurrogate:[/] {escape(str(interrupted))}", soft_wrap=True)
        raise typer.Exit(INTERRUPTED)
    if result.failures:
        raise typer.Exit(1)
    if result.not_done:
        err.print(f"[yellow]pdsurrogate:[/] the time of {len(result.not_done)} runs was over; the same command goes on with them")
        raise typer.Exit(INTERRUPTED)


class _StudyBar:
    """Progress bar of a study."""

    def __init__(self, name: str) -> None:
        self._progress, self._rate = Bar(), Rate("runs")
        self._name, self._task, self._failed = name, None, 0
        self._ended, self._done, self._runs = 0, 0, 0

    def __enter__(self) -> _StudyBar:
        self._progress.start()
        return self

    def __exit__(self, *exception) -> None:
        self._progress.stop()

    def begin(self, runs: int, done: int, workers) -> None:
        """Print the numbers of runs and workers and start the bar."""
        if workers.caution:
            err.print(f"[yellow]{escape(workers.caution)}.[/]", soft_wrap=True)
        by = (
            f"by the workers of {workers.scheduler}"
            if workers.scheduler
            else f"{workers.jobs} at a time, threads of each: {workers.threads}"
        )
        note(f"{runs} runs, {done} of them done before; {by}")
        self._done, self._runs = done, runs
        self._rate.begin()
        self._task = self._progress.add_task(self._name, total=runs, completed=done, state=f"{done} of {runs} runs")

    def ended(self, place: str, failure: str | None) -> None:
        """Count a finished run."""
        self._failed += failure is not None
        self._ended += 1
        failed = f", {self._failed} failed" if self._failed else ""
        state = f"{self._done + self._ended} of {self._runs} runs{failed}{self._rate.after(self._ended)}"
        self._progress.update(self._task, advance=1, state=state)
