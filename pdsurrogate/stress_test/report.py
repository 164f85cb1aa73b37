"""Report of all hard cases for any number of force models."""

import time
from collections.abc import Iterable

from threadpoolctl import threadpool_limits

from .. import __version__
from ..artifacts import ArtifactError, list_artifacts, load_surrogate
from ..engine.threads import most_threads, thread_count
from ..forces import FORCES
from ..progress import part
from ..results.provenance import processor
from . import conformance, deformations, runs, tangents
from .case import INAPPLICABLE, PASS, STOPS, WEAK, WEAKNESSES, Case, Subject

CASES: tuple[Case, ...] = tuple(dict.fromkeys((*tangents.CASES, *conformance.PROPERTIES, *deformations.CASES, *runs.CASES)))
"""All hard cases in the order of the report's table: tangents, required properties (`conformance`), deformations, and runs."""


BODIES = {"stress": "sheets under plane stress", "space": "solids"}
"""Planes ("stress", "space") in which force models are tested on the hard cases, with the names of their bodies in messages."""


BRIEF = (*FORCES, "neo-hookean", "neo-hookean-isochoric")
"""Force models that are tested by default: the exact ones, and a learned bond force and a learned energy of the same rubber."""


def all_models(plane: str = "stress") -> list[str]:
    """Return the names of all force models that support a plane ("stress", "strain" or "space"): built-in models, then artifacts.

    An artifact without a version stands for its newest version.
    """
    found = dict.fromkeys(folder.parent.name for folder in list_artifacts())
    return [name for name in (*FORCES, *found) if plane in load_surrogate(name).honors["plane"]]


def stress_test(
    references: Iterable[str] | None = None,
    full: bool = False,
    planes: Iterable[str] = tuple(BODIES),
    threads: int | None = None,
) -> dict:
    """Test every force model on every hard case.

    Parameters
    ----------
    references : iterable of str, optional
        Force models as on the command line; each is tested in those `planes` that it supports. By default those of `BRIEF`, or with
        `full` all models are tested.
    full : bool
        Whether to take all 100,000 explicit time steps of a case, not a fiftieth, or in one case a tenth.
    planes : iterable of {"stress", "space"}
        Sheets in plane stress, three-dimensional bodies, or both; there is no report of plane strain.
    threads : int, optional
        Greatest number of threads of the kernels; by default all.

    Returns
    -------
    dict
        ``machine``; ``cases``: title, requirement and ``planes`` of each; ``models``: for each model and plane its material and
        ``results``, with verdict, figure, value, limit, weakness and seconds by the name of the case; ``weaknesses``: explanations of those
        found.

    Raises
    ------
    ArtifactError
        If a force model is unknown or damaged, or supports none of the planes; before any case is run.
    ValueError
        If `threads` is greater than the number of available threads.
    """
    planes, subjects = list(planes), []
    every = dict.fromkeys(name for plane in planes for name in all_models(plane))
    for reference in references or [name for name in every if full or name in BRIEF]:
        taken = load_surrogate(reference).honors["plane"]
        found = [Subject(reference, full, plane) for plane in planes if plane in taken]
        if not found:
            asked = " or ".join(BODIES[plane] for plane in planes)
            raise ArtifactError(f"{reference} supports plane={' and '.join(taken)} only, but the hard cases are those of {asked}")
        subjects += found
    # A damaged card is found here, before any case is run.
    models = [{"force": one.reference, "plane": one.plane, "material": one.law.describe(), "results": {}} for one in subjects]
    tests = [(*pair, case) for pair in zip(subjects, models, strict=True) for case in CASES if pair[0].plane in case.planes]
    # BLAS threads would spin on the cores that the kernels need.
    with thread_count(threads, limit=True), threadpool_limits(1, user_api="blas"):
        for done, (subject, model, case) in enumerate(tests):
            began = time.perf_counter()
            with part("hard cases", done, len(tests), case=f"{subject.reference}, {BODIES[subject.plane]}: {case.title}"):
                outcome = case(subject)
            model["results"][case.key] = {**vars(outcome), "seconds": time.perf_counter() - began}
    shown = {result["weakness"] for model in models for result in model["results"].values()}
    return {
        "machine": {"processor": processor(), "threads": threads or most_threads(), "version": __version__, "full": full},
        "cases": [
            {"case": case.key, "title": case.title, "asked": case.asked, "planes": [plane for plane in BODIES if plane in case.planes]}
            for case in CASES
        ],
        "models": models,
        "weaknesses": {name: what for name, what in WEAKNESSES.items() if name in shown},
    }


def planes_of(report: dict) -> list[str]:
    """Return the planes ("stress", "space") in which the models of a report were tested; each has a table."""
    return [plane for plane in BODIES if any(model["plane"] == plane for model in report["models"])]


def table(report: dict, plane: str) -> tuple[list[str], list[list[str]]]:
    """Return the header and the rows of a report's table for a plane: a row for each case, a column for each force model."""
    models = [model for model in report["models"] if model["plane"] == plane]
    cases = [case for case in report["cases"] if plane in case["planes"]]
    rows = [[case["title"], case["asked"], *(cell(model["results"][case["case"]]) for model in models)] for case in cases]
    return ["case", "asked", *(model["force"] for model in models)], rows


def cell(result: dict) -> str:
    """Return the text of a table cell for the result of one case (an entry of ``results`` in a report): verdict, figure and weakness."""
    figure = result["figure"]
    # The JSON has the place and the reason of a stop.
    figure = figure if len(figure) <= 60 else figure.split(":")[0].split(", stops")[0]
    if result["verdict"] == INAPPLICABLE:
        return f"- ({figure})"
    if result["verdict"] == WEAK:
        return f"WEAK {figure}: {result['weakness']}"
    return f"{result['verdict']} {figure}".strip()


def count(model: dict) -> dict[str, int]:
    """Return the number of cases with each verdict, for one model of a report."""
    verdicts = [result["verdict"] for result in model["results"].values()]
    return {verdict: verdicts.count(verdict) for verdict in (PASS, STOPS, WEAK, INAPPLICABLE)}
