"""All hard cases, put to any number of force models, as one report."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

import numba
from threadpoolctl import threadpool_limits

from .. import __version__
from ..artifacts import ArtifactError, list_artifacts, load_surrogate
from ..forces import FORCES, ForceModel
from ..results.provenance import processor
from . import conformance, deformations, discretisations, dynamics, tangents
from .case import INAPPLICABLE, PASS, STOPS, WEAK, WEAKNESSES, Case, Subject

CASES: tuple[Case, ...] = (*tangents.CASES, *conformance.PROPERTIES, *deformations.CASES, *discretisations.CASES, *dynamics.CASES)
"""Every case, in the order of the table: the hard ones, and the properties of `conformance`."""


def all_models() -> list[str]:
    """References of every force model of sheets: those that need no artefact, and the highest version of each artefact that is found."""
    found = dict.fromkeys(folder.parent.name for folder in list_artifacts())
    return [*FORCES, *(name for name in found if _takes_sheets(load_surrogate(name)))]


def _takes_sheets(model: ForceModel) -> bool:
    """Whether the cases can be put to a model: they are sheets under plane stress."""
    return "stress" in model.honours["plane"]


def stress_test(references: Iterable[str] | None = None, quick: bool = False, progress: Callable[[str], None] = lambda text: None) -> dict:
    """Put every hard case to every force model.

    Parameters
    ----------
    references : iterable of str, optional
        Force models as on the command line; all by default.
    quick : bool
        A fiftieth of the explicit steps.
    progress : callable
        Told what is being done.

    Returns
    -------
    dict
        ``machine``; ``cases`` with what is asked of each; ``models``: for each its material and, by case, verdict, figure, value,
        limit, weakness and seconds; ``weaknesses``, explained.

    Raises
    ------
    ArtifactError
        If a force model is unknown or damaged, or does not take sheets; before any case is run.
    """
    subjects = [Subject(reference, quick) for reference in (references or all_models())]
    for subject in subjects:
        progress(f"reading {subject.reference}")
        _ = subject.law
        if not _takes_sheets(subject.model):
            planes = " and ".join(subject.model.honours["plane"])
            raise ArtifactError(f"{subject.model.name} takes plane={planes}: the hard cases are sheets under plane stress")
    models = []
    # BLAS threads would spin on the cores that the kernels want.
    with threadpool_limits(1, user_api="blas"):
        for subject in subjects:
            results = {}
            for case in CASES:
                progress(f"{subject.reference}: {case.title}")
                began = time.perf_counter()
                outcome = case.function(subject)
                results[case.key] = {**vars(outcome), "seconds": time.perf_counter() - began}
            models.append({"force": subject.reference, "material": subject.law.describe(), "results": results})
    shown = {result["weakness"] for model in models for result in model["results"].values()}
    return {
        "machine": {"processor": processor(), "threads": numba.config.NUMBA_NUM_THREADS, "version": __version__, "quick": quick},
        "cases": [{"case": case.key, "title": case.title, "asked": case.asked} for case in CASES],
        "models": models,
        "weaknesses": {name: what for name, what in WEAKNESSES.items() if name in shown},
    }


def table(report: dict) -> tuple[list[str], list[list[str]]]:
    """Header and rows: a case a row, a force model a column."""
    header = ["case", "asked", *(model["force"] for model in report["models"])]
    rows = []
    for case in report["cases"]:
        row = [case["title"], case["asked"]]
        for model in report["models"]:
            row.append(cell(model["results"][case["case"]]))
        rows.append(row)
    return header, rows


def cell(result: dict) -> str:
    """A result in a few words."""
    figure = result["figure"]
    # The place and reason of a stop are in the JSON.
    figure = figure if len(figure) <= 60 else figure.split(":")[0].split(", stops")[0]
    if result["verdict"] == INAPPLICABLE:
        return f"- ({figure})"
    if result["verdict"] == WEAK:
        return f"WEAK {figure}: {result['weakness']}"
    return f"{ {PASS: 'pass', STOPS: 'stops'}[result['verdict']] } {figure}".strip()


def count(model: dict) -> dict[str, int]:
    """How many cases of a model came to each verdict."""
    verdicts = [result["verdict"] for result in model["results"].values()]
    return {verdict: verdicts.count(verdict) for verdict in (PASS, STOPS, WEAK, INAPPLICABLE)}
