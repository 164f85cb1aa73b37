"""Command ``study``, which runs many scenes, or fits many surrogates."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from .. import studies
from ..studies.study import FIGURE, MEANS, TABLE
from .command import MaxTime
from .terminal import FAILED, INTERRUPTED, WARNING, Bar, ended, note, print_json, warn, writing

MOST_FAILURES = 5
"""Number of failures printed one by one; the table lists them all. Chosen: enough to see whether runs fail for one reason, and few enough
for one screen."""


def study(
    description: Annotated[Path, Argument(metavar="STUDY", help="Study file (.toml): a scene or a fit, and the parameters to vary.")],
    folder: Annotated[Path | None, Option("--out", metavar="DIR", help="Folder for the results (default: named after STUDY).")] = None,
    jobs: Annotated[int | None, Option(help="Number of parallel runs (default: number of cores).", min=1)] = None,
    threads: Annotated[int | None, Option(help="Number of threads of each run (default: cores divided by jobs).", min=1)] = None,
    scheduler: Annotated[str | None, Option(metavar="ADDRESS", help="Dask scheduler for the runs, such as tcp://host:8786.")] = None,
    overwrite: Annotated[bool, Option("--overwrite", help="Overwrite the table of a different study in DIR; runs are kept.")] = False,
    max_time: MaxTime = None,
) -> None:
    """Carry out the runs of a study that are not finished yet, and write its table and figure."""
    folder = Path(description.stem) if folder is None else folder
    options = {"jobs": jobs, "threads": threads, "scheduler": scheduler, "overwrite": overwrite, "max_time": max_time}
    interrupted = None
    try:
        with writing(folder), Bar() as bar:
            result = studies.study(description, folder, **options, progress=_Progress(description.stem, bar))
    except studies.StudyInterrupted as error:
        interrupted, result = error, error.result
    if result.failures:
        warn(f"{len(result.failures)} of {len(result.rows)} runs failed:")
        for row in result.failures[:MOST_FAILURES]:
            parameters = ", ".join(f"{key}={row[key]}" for key in result.study.parameters)
            warn(f"  {row['run']} ({parameters}): {row['failure']}")
        if len(result.failures) > MOST_FAILURES:
            warn(f"  and {len(result.failures) - MOST_FAILURES} more, listed in {result.folder / TABLE}")
    for caution in result.cautions():
        warn(caution)
    print_json(result.rows)
    written = " and ".join(name for name in (TABLE, MEANS, FIGURE) if (result.folder / name).exists())
    note(f"Wrote {written} of {len(result.rows)} runs in {folder}")
    if interrupted is not None:
        raise ended(INTERRUPTED, str(interrupted), WARNING)
    if result.failures:
        raise typer.Exit(FAILED)
    if result.not_done:
        late = f"{len(result.not_done)} runs reached --max-time"
        raise ended(INTERRUPTED, f"{late}; repeat the command to resume them from their checkpoints", WARNING)


class _Progress:
    """Progress of a study on a progress bar, which counts finished and failed runs."""

    def __init__(self, name: str, bar: Bar) -> None:
        self._name, self._bar = name, bar
        self._runs, self._ended, self._failed = 0, 0, 0

    def begin(self, runs: int, done: int, workers) -> None:
        """Print the number of runs, the number of those finished by an earlier call, and the workers; begin the bar."""
        if workers.caution:
            warn(f"{workers.caution}.")
        where = f"{workers.jobs} at a time on {workers.threads} thread{'s' * (workers.threads > 1)} each"
        where = f"on the workers of {workers.scheduler}" if workers.scheduler else where
        note(f"{runs} runs, {done} of them finished earlier; the others run {where}")
        self._runs, self._ended = runs, done
        self._bar.count("runs", done, runs, title=self._name)

    def ended(self, place: str, failure: str | None) -> None:
        """Show that the run in the folder `place` has ended; it failed unless `failure` is None."""
        self._failed += failure is not None
        self._ended += 1
        self._bar.count("runs", self._ended, self._runs, f"{self._failed} failed" if self._failed else "")
