"""Command ``study``, which runs many scenes, or fits many surrogates."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from typer import Argument, Option

from .. import studies
from ..studies.study import FIGURE, TABLE
from .command import MaxTime
from .terminal import FAILED, INTERRUPTED, WARNING, Bar, ended, err, note, print_json, warn, writing

MOST_FAILURES = 5
"""Number of failures printed one by one; the table lists them all. Chosen: enough to see whether runs fail for one reason, and few enough
for one screen."""


def study(
    description: Annotated[Path, Argument(metavar="STUDY", help="Path of a study file (.toml): a scene or a fit, and its parameters.")],
    folder: Annotated[Path | None, Option("--out", metavar="DIR", help="Folder for the results (default: named after the file).")] = None,
    jobs: Annotated[int | None, Option(help="Number of parallel runs (default: as many as the cores allow).", min=1)] = None,
    threads: Annotated[int | None, Option(help="Threads of each run (default: cores divided by jobs).", min=1)] = None,
    scheduler: Annotated[str | None, Option(metavar="ADDRESS", help="Dask scheduler that executes the runs: tcp://host:8786.")] = None,
    overwrite: Annotated[bool, Option("--overwrite", help="Overwrite the table of another study in DIR; its runs are kept.")] = False,
    max_time: MaxTime = None,
) -> None:
    """Run a scene with many parameters, or fit many surrogates, in parallel; finished runs are reused."""
    folder = Path(description.stem) if folder is None else folder
    options = {"jobs": jobs, "threads": threads, "scheduler": scheduler, "overwrite": overwrite, "max_time": max_time}
    interrupted = None
    try:
        with writing(folder), Bar() as bar:
            result = studies.study(description, folder, **options, progress=_Progress(description.stem, bar))
    except studies.StudyInterrupted as error:
        interrupted, result = error, error.result
    if result.failures:
        err.print(f"[yellow]{len(result.failures)} of {len(result.rows)} runs failed:[/]", soft_wrap=True)
        for row in result.failures[:MOST_FAILURES]:
            parameters = ", ".join(f"{key}={row[key]}" for key in result.study.parameters)
            err.print(escape(f"  {row['run']} ({parameters}): {row['failure']}"), soft_wrap=True, highlight=False)
        if len(result.failures) > MOST_FAILURES:
            err.print(f"  and {len(result.failures) - MOST_FAILURES} more, see the table")
    for caution in result.cautions():
        warn(caution)
    print_json(result.rows)
    note(f"{len(result.rows)} runs: {TABLE}{f' and {FIGURE}' if (result.folder / FIGURE).exists() else ''} in {folder}")
    if interrupted is not None:
        raise ended(INTERRUPTED, str(interrupted), WARNING)
    if result.failures:
        raise typer.Exit(FAILED)
    if result.not_done:
        raise ended(INTERRUPTED, f"the time of {len(result.not_done)} runs was over; the same command goes on with them", WARNING)


class _Progress:
    """Progress of a study on a progress bar, which counts finished and failed runs."""

    def __init__(self, name: str, bar: Bar) -> None:
        self._name, self._bar = name, bar
        self._runs, self._ended, self._failed = 0, 0, 0

    def begin(self, runs: int, done: int, workers) -> None:
        """Print the number of runs, the number of those finished by an earlier call, and the workers; begin the bar."""
        if workers.caution:
            warn(f"{workers.caution}.")
        each = f"{workers.jobs} at a time, threads of each: {workers.threads}"
        note(f"{runs} runs, {done} of them done before; {f'by the workers of {workers.scheduler}' if workers.scheduler else each}")
        self._runs, self._ended = runs, done
        self._bar.count("runs", done, runs, title=self._name)

    def ended(self, place: str, failure: str | None) -> None:
        """Show that the run in the folder `place` has ended; it failed unless `failure` is None."""
        self._failed += failure is not None
        self._ended += 1
        self._bar.count("runs", self._ended, self._runs, f"{self._failed} failed" if self._failed else "")
