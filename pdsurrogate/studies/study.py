"""Function `study`, which carries out the missing runs of a study and collects the results of
all runs in one table.
"""

import logging
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..arguments import check_seconds
from ..discretization import memory_here
from ..progress import event
from ..ranks import communicator
from ..results import figures
from ..results.files import check_writable, remove_leftovers, write_json, write_text
from ..results.folder import SUMMARY, WAY_OUT, FolderTaken, occupied
from ..run.interruption import heard
from .description import Study, load_study, parameters_of_runs
from .runs import DERIVATIVES, NOT_DONE, OUTCOME, FitTask, SceneTask, read_json, tasks_of
from .table import (
    FAILURE,
    RUN,
    as_csv,
    check_quantities,
    columns_of,
    means_of,
    quantities_in,
    study_figure,
)
from .workers import Workers

logger = logging.getLogger(__name__)

TABLE = "study.csv"
MEANS = "study-means.csv"
FIGURE = "study.png"
DESCRIPTION = "study.json"
RUNS = "runs"


@dataclass(frozen=True)
class StudyResult:
    """Results of all runs of a study, as rows of one table.

    Parameters
    ----------
    study : Study
        Description of the study.
    folder : Path
        Folder with ``study.csv``, ``study.png``, for repeated runs ``study-means.csv``, and, in
        ``runs``, a folder for every run.
    rows : list of dict
        One row for every run, in the order of the design: ``run``, the name of its folder;
        parameters and quantities (columns of results) by their keys; and ``failure``, None for a
        run that succeeded.

    See Also
    --------
    pdsurrogate.study : carries out a study.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> import tempfile
    >>> keys = {
    ...     "scene": "uniaxial",
    ...     "force": "neo-hookean",
    ...     "set": {"spacing": 0.25},
    ...     "parameters": {"stretches": [1.2, 1.5]},
    ... }
    >>> result = pds.study(keys, tempfile.mkdtemp(), jobs=1, threads=1)
    >>> [row["failure"] for row in result.rows]
    [None, None]
    """

    study: Study
    folder: Path
    rows: list[dict[str, Any]] = field(repr=False)

    def table(self):
        """Return the rows as one table.

        Returns
        -------
        pandas.DataFrame or list of dict
            A list if pandas is not installed.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> described = pds.Study(scene="uniaxial", parameters={"spacing": [0.25]})
        >>> rows = [{"run": "a", "spacing": 0.25, "failure": None}]
        >>> len(pds.studies.StudyResult(described, None, rows).table())
        1
        """
        try:
            from pandas import DataFrame
        except ImportError:
            return self.rows
        return DataFrame(self.rows, columns=columns_of(self.rows))

    def means(self) -> list[dict[str, Any]]:
        """Return mean and deviation of every quantity over the runs that repeat each other, such as
        those that differ in their seed alone.

        Returns
        -------
        list of dict
            One row for every combination of the other parameters: these, the number of ``runs``
            that succeeded, and for each quantity that all of these have ``QUANTITY.mean`` and, from
            two runs on, the sample standard deviation ``QUANTITY.deviation``. Empty if the study
            repeats no run.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> described = pds.Study(scene="tear", parameters={"body.seed": [1, 2]})
        >>> rows = [
        ...     {"run": name, "body.seed": seed, "stress": seed, "failure": None}
        ...     for name, seed in (("a", 1), ("b", 2))
        ... ]
        >>> {
        ...     key: round(value, 3)
        ...     for key, value in pds.studies.StudyResult(described, None, rows).means()[0].items()
        ... }
        {'runs': 2, 'stress.mean': 1.5, 'stress.deviation': 0.707}
        """
        return (
            means_of(self.rows, self.study.parameters, self.study.repeated)
            if self.study.repeated
            else []
        )

    @property
    def failures(self) -> list[dict[str, Any]]:
        """Rows of the runs that failed; unfinished runs (`not_done`) are not among them.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> described = pds.Study(scene="uniaxial", parameters={"spacing": [0.25, 9.0]})
        >>> rows = [
        ...     {"run": "a", "spacing": 0.25, "failure": None},
        ...     {"run": "b", "spacing": 9.0, "failure": "too large"},
        ... ]
        >>> [row["run"] for row in pds.studies.StudyResult(described, None, rows).failures]
        ['b']
        """
        return [row for row in self.rows if row[FAILURE] not in (None, NOT_DONE)]

    @property
    def not_done(self) -> list[dict[str, Any]]:
        """Rows of the runs that are not finished: not started, interrupted, or out of time.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> described = pds.Study(scene="uniaxial", parameters={"spacing": [0.25]})
        >>> rows = [{"run": "a", "spacing": 0.25, "failure": None}]
        >>> pds.studies.StudyResult(described, None, rows).not_done
        []
        """
        return [row for row in self.rows if row[FAILURE] == NOT_DONE]

    def cautions(self) -> list[str]:
        """Return texts of warnings: of asked quantities that no successful run has, of states
        outside the domain of a surrogate, and of peaks of runs that failed.

        Returns
        -------
        list of str

        Examples
        --------
        >>> from pathlib import Path
        >>> import pdsurrogate as pds
        >>> described = pds.Study(scene="uniaxial", parameters={"spacing": [0.25]})
        >>> rows = [{"run": "a", "spacing": 0.25, "failure": "too coarse"}]
        >>> pds.studies.StudyResult(described, Path("out"), rows).cautions()
        []
        """
        done = [row[RUN] for row in self.rows if row[FAILURE] is None]
        read = {place: read_json(self.folder / RUNS / place / SUMMARY) for place in done}
        summaries = {place: summary for place, summary in read.items() if summary}
        missing = [
            name
            for name in self.study.quantities or ()
            if not any(quantities_in(one, [name]) for one in summaries.values())
        ]
        found = [f"quantities: no run has {name!r}" for name in missing if summaries]
        outside = [place for place in summaries if summaries[place].get("fraction_outside_domain")]
        if outside:
            found.append(
                f"{len(outside)} runs (first {outside[0]}) left the domain of the surrogate; see"
                " fraction_outside_domain"
            )
        peaks = [
            one[RUN] for one in self.failures if any("peak" in key and one[key] for key in one)
        ]
        read = {place: read_json(self.folder / RUNS / place / SUMMARY) or {} for place in peaks}
        cut = [place for place in peaks if not read[place].get("converged")]
        if cut:
            found.append(
                f"peaks of the {len(cut)} runs (first {cut[0]}) that failed are lower bounds, up to"
                " their failure: means leave these runs out"
            )
        return found

    def figure(self):
        """Return a figure of every varying quantity against every varying parameter, the first six
        of each (`MOST_DRAWN`).

        Returns
        -------
        matplotlib.figure.Figure or None
            None if nothing varies.

        Examples
        --------
        >>> from pathlib import Path
        >>> import pdsurrogate as pds
        >>> described = pds.Study(scene="uniaxial", parameters={"spacing": [0.25, 0.5]})
        >>> rows = [{"run": "a", "spacing": 0.25, "stress": 1.0, "failure": None}]
        >>> rows.append({"run": "b", "spacing": 0.5, "stress": 1.1, "failure": None})
        >>> type(pds.studies.StudyResult(described, Path("out"), rows).figure()).__name__
        'Figure'
        """
        return study_figure(self.rows, list(self.study.parameters))


class StudyInterrupted(RuntimeError):
    """Error for a study stopped by Ctrl-C; the same call resumes the study.

    Parameters
    ----------
    result : StudyResult
        Finished runs, which the error has as its attribute ``result``.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> issubclass(pds.StudyInterrupted, RuntimeError)
    True
    """

    def __init__(self, result: StudyResult) -> None:
        super().__init__(
            f"interrupted; {len(result.not_done)} of {len(result.rows)} runs are left; repeat the"
            " command to run them"
        )
        self.result = result


def study(
    description: Study | Mapping[str, Any] | str | Path,
    folder: str | Path,
    *,
    jobs: int | None = None,
    threads: int | None = None,
    scheduler: str | None = None,
    overwrite: bool = False,
    max_time: float | None = None,
) -> StudyResult:
    """Carry out the missing runs of a study and return all results in one table.

    Every run has its own folder, named after a digest of its scene and force (or of its fit), so
    that no existing run is repeated, even if runs are added to the study; an interrupted run
    resumes from its checkpoint. If a run fails, its row gives the reason and the other runs
    continue.

    Parameters
    ----------
    description : Study, mapping, str or path
        A study, a mapping of its keys, or its file.
    folder : str or path
        Folder of the results.
    jobs : int, optional
        Number of runs at the same time; by default the number of cores divided by `threads` (or by
        1), but no more than there are runs.
    threads : int, optional
        Number of threads of each run; by default the number of cores divided by `jobs`. Results do
        not depend on it.
    scheduler : str, optional
        Address of a Dask scheduler whose workers carry out the runs.
    overwrite : bool
        Whether to replace the table in `folder` even if it has runs that this study does not have;
        the folders of those runs stay.
    max_time : float, optional
        Seconds after which every run ends with a checkpoint, from which an equal call resumes the
        run later; only for studies of scenes.

    Returns
    -------
    StudyResult

    Raises
    ------
    SceneError
        If the study or one of its runs is invalid; no run has been started then.
    ValueError
        If the function is called on several MPI ranks.
    FolderTaken
        If `folder` holds a table that was not written by a study, or (without `overwrite`) a table
        with runs that this study does not have, or if another study is writing there.
    StudyInterrupted
        After Ctrl-C; the table of the finished runs is written.

    See Also
    --------
    pdsurrogate.Study : description of a study.
    pdsurrogate.simulate : runs one scene.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> import tempfile
    >>> keys = {
    ...     "scene": "uniaxial",
    ...     "force": "neo-hookean",
    ...     "set": {"spacing": 0.25},
    ...     "parameters": {"stretches": [1.2, 1.5]},
    ... }
    >>> result = pds.study(keys, tempfile.mkdtemp(), jobs=1, threads=1)
    >>> len(result.rows), len(result.failures)
    (2, 0)
    """
    if communicator().size > 1:
        raise ValueError(
            "a study runs in parallel with jobs or a Dask scheduler, not with MPI ranks: start it"
            " without mpiexec"
        )
    described, source, home = load_study(description)
    try:
        check_quantities(described)
        runs = parameters_of_runs(described)
        # The memory of a scheduler's workers is unknown here.
        tasks = tasks_of(
            described, home.resolve(), runs, memory_here() if scheduler is None else math.inf
        )
    except ValueError as error:
        raise type(error)(f"{source}: {error}") from None
    if max_time is not None:
        check_seconds(max_time, "max_time")
        if described.fit is not None:
            raise ValueError(
                f"{source}: max_time: a fit cannot be resumed from a checkpoint; leave max_time out"
            )
    if not str(folder):
        raise ValueError("folder: the name is empty; give a folder for the results")
    folder = Path(folder).resolve()
    # Among `MOST_RUNS` runs two have the same 16 digits with a probability of 3e-10.
    places = [task.digest[:16] for task in tasks]
    by_place = dict(zip(places, tasks, strict=True))
    workers = Workers.chosen(len(by_place), jobs, threads, scheduler)
    _check_table(folder, places, overwrite)
    check_writable(folder / RUNS)
    with occupied(folder):
        remove_leftovers(folder)
        (folder / RUNS).mkdir(exist_ok=True)  # all workers must see this folder
        ended = _outcomes(folder / RUNS, by_place)
        left = {place: task for place, task in by_place.items() if place not in ended}
        write_json(
            folder / DESCRIPTION, {"study": described.model_dump(mode="json"), "runs": places}
        )

        def result() -> StudyResult:
            rows = [
                _row(folder / RUNS, place, run, ended, described)
                for place, run in zip(places, runs, strict=True)
            ]
            return StudyResult(described, folder, rows)

        count = len(by_place)
        failed = 0
        logger.info(
            "%d runs, %d of them finished earlier; jobs: %d, threads: %d",
            count,
            len(ended),
            workers.jobs,
            workers.threads,
        )
        event("runs", len(ended), count)
        try:
            for place, failure in workers.carry_out(left, folder / RUNS, max_time):
                if failure == NOT_DONE:
                    continue
                ended[place] = failure
                failed += failure is not None
                event("runs", len(ended), count, failed=failed)
        except KeyboardInterrupt:
            heard.set()
            # Runs that ended in the meantime are included.
            ended |= _outcomes(folder / RUNS, left)
            reached = result()
            write_text(folder / TABLE, as_csv(reached.rows))  # drawing a figure is slow
            raise StudyInterrupted(reached) from None
        _write(reached := result())
    return reached


def _check_table(folder: Path, places: list[str], overwrite: bool) -> None:
    """Raise FolderTaken if the folder holds a table not written by a study, or, without
    `overwrite`, one with runs that this study lacks.

    `places` are the names of the folders of the runs of this study.
    """
    described = (folder / DESCRIPTION).exists()
    if not described and (folder / TABLE).exists():
        raise FolderTaken(
            f"{folder / TABLE} was not written by a study and would be overwritten; use another"
            " folder"
        )
    if overwrite or not described:
        return
    try:
        runs = set(read_json(folder / DESCRIPTION)["runs"])
    except (TypeError, KeyError):
        runs = {"unknown"}
    if lost := runs - set(places):
        raise FolderTaken(
            f"{folder} contains the table of a study with {len(lost)} runs that are not in this"
            f" study; {WAY_OUT}"
        )


def _write(result: StudyResult) -> None:
    write_text(result.folder / TABLE, as_csv(result.rows))
    if means := result.means():
        write_text(result.folder / MEANS, as_csv(means))
    else:
        (result.folder / MEANS).unlink(missing_ok=True)
    if figure := result.figure():
        figures.save(figure, result.folder / FIGURE)
    else:
        (result.folder / FIGURE).unlink(missing_ok=True)


def _row(
    runs: Path,
    place: str,
    parameters: dict[str, Any],
    ended: Mapping[str, str | None],
    study: Study,
) -> dict[str, Any]:
    summary = read_json(runs / place / SUMMARY) if place in ended else None
    asked = {RUN: place, **parameters}
    quantities = quantities_in(summary, study.quantities) if summary else {}
    rates = (read_json(runs / place / DERIVATIVES) if study.derivatives and summary else None) or {
        "values": {},
        "failure": None,
    }
    failure = ended.get(place, NOT_DONE) or rates["failure"]
    return {
        **asked,
        **quantities,
        **rates["values"],
        **asked,
        FAILURE: failure,
    }  # if a name is both, the parameter wins


def _outcomes(runs: Path, tasks: Mapping[str, SceneTask | FitTask]) -> dict[str, str | None]:
    """Return, by the name of its folder in `runs`, the reason of failure of each finished run, None
    if it succeeded.

    `tasks` are the runs to look for, by the same names; unfinished runs and results of other tasks
    are left out.
    """
    found = {}
    for place, task in tasks.items():
        with suppress(KeyError, TypeError):
            written = read_json(runs / place / OUTCOME)
            if written["digest"] == task.digest and not (
                written["failure"] is None and task.lacks_derivatives(runs / place)
            ):
                found[place] = written["failure"]
    return found
