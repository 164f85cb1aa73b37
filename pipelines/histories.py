"""Branches learned from cycles of a laboratory, and curves that are kept back.

python pipelines/histories.py          fits, and draws the curves
python pipelines/histories.py --docs   puts the table into the documentation
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from cases import of_rows, report
from pages import FIGURES

import pdsurrogate as pds
from pdsurrogate.identification.history_report import figure_of_history, report_of_history
from pdsurrogate.results import figures

FILE = Path(__file__).parent / "data" / "experiment-hossain-2012-cycles.csv"
CASES = [("3.0",), ("at 0.03", "3.0"), ("at 0.05", "3.0"), ("at 0.01", "3.0")]
"""Parts of the names of curves that are kept back."""


def kept_back(*parts: str) -> Iterator[tuple]:
    """Fit the other curves; the errors of those fitted and of those kept back."""
    data = pds.load_test_data(FILE, mode="uniaxial", history=True)
    names = [one.name for one in data.tests.specimens]
    left = np.array([any(part in name for part in parts) for name in names])
    known = data.where(~left[data.curve])
    model = pds.identification.HistoryRegressor().fit(
        known.histories(), known.nominal_stress, known.weight
    )
    curves = report_of_history(model, data)["curves"]
    errors = [100 * one["relative_rms"] for one in curves]
    fitted = [error for error, out in zip(errors, left, strict=True) if not out]
    others = [f"{n}: {e:.1f}" for n, e, out in zip(names, errors, left, strict=True) if out]
    if parts == CASES[0]:
        figures.save(figure_of_history(model, data), FIGURES / "histories.png")
    branches = [f"{one.modulus:.3g} at {one.time:.3g} s" for one in model.law_.memory.branches]
    yield ", ".join(parts), ", ".join(branches), min(fitted), max(fitted), ", ".join(others)


if __name__ == "__main__":
    columns = "kept back", "branches (MPa)", "least: .1f", "greatest: .1f", "kept back (%)"
    report(__doc__, of_rows("histories", kept_back, CASES, *columns))
