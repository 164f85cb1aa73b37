"""Branches learned from cycles of a laboratory, and curves that are kept back.

python pipelines/histories.py          fits, and draws the curves
python pipelines/histories.py --docs   puts the tables into the documentation
"""

import warnings
from pathlib import Path

import numpy as np
from cases import of_rows, report
from pages import FIGURES

import pdsurrogate as pds
from pdsurrogate.identification.history_report import figure_of_history, report_of_history
from pdsurrogate.results import figures

DATA = Path(__file__).parent / "data"
FILES = {
    "VHB 4910": DATA / "experiment-hossain-2012-cycles.csv",
    "VHB 4905": DATA / "experiment-vhb4905-cycles.csv",
}
CASES = [("3.0",), ("at 0.03", "3.0"), ("at 0.05", "3.0"), ("at 0.01", "3.0")]
"""Parts of the names of curves that are kept back."""

TEMPERATURES = [
    (f"{temperature} C", f"4.0 at {rate}")
    for temperature, rates in (
        (0, (0.03, 0.05, 0.1)),
        (20, (0.03, 0.1)),
        (40, (0.03, 0.05, 0.1)),
        (60, (0.03, 0.1)),
        (80, (0.03, 0.05, 0.1)),
    )
    for rate in rates
]
"""Temperatures with three curves or more, and the rates that are kept back."""

REPEATED = [(1.45, 0.01), (1.45, 0.03), (1.45, 0.05), (1.95, 0.01), (1.95, 0.05), (2.45, 0.01)]
REPEATED += [(2.45, 0.05)]
"""Stretches that several strips reached at the same rates."""


def cycles(material, of=""):
    """The curves of a material whose names begin with a text, and their names."""
    data = pds.load_test_data(FILES[material], mode="uniaxial", history=True)
    names = [one.name for one in data.tests.specimens]
    of_these = [number for number, name in enumerate(names) if name.startswith(of)]
    return data.where(np.isin(data.curve, of_these)), names


def errors(data, names, *parts):
    """A fit to the curves whose names lack the given parts; branches in words, and errors by name:
    fitted ones and those kept back.
    """
    left = np.array([any(part in name for part in parts) for name in names])
    model = pds.identification.HistoryRegressor().fit_tests(data.where(~left[data.curve]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pds.forces.OutsideDomainWarning)
        curves = report_of_history(model, data)["curves"]
        if parts == CASES[0]:
            figures.save(figure_of_history(model, data), FIGURES / "histories.png")
    branches = [f"{one.modulus:.3g} at {one.time:.3g} s" for one in model.law_.memory.branches]
    off = {one["specimen"]: 100 * one["relative_rms"] for one in curves}
    out = [name for name, one in zip(names, left, strict=True) if one and name in off]
    fitted = [error for name, error in off.items() if name not in out]
    return ", ".join(branches), fitted, {name: off[name] for name in out}


def kept_back(*parts):
    """Fit the other curves of VHB 4910; the errors of those fitted and of those kept back."""
    branches, fitted, left = errors(*cycles("VHB 4910"), *parts)
    others = [f"{name}: {error:.1f}" for name, error in left.items()]
    yield ", ".join(parts), branches, min(fitted), max(fitted), ", ".join(others)


def by_temperature(temperature, rate):
    """Fit the other curves of VHB 4905 of a temperature; the error of the one kept back."""
    branches, fitted, left = errors(*cycles("VHB 4905", temperature), rate)
    yield temperature, rate, branches, max(fitted), *left.values()


def scatter(stretch, rate):
    """Stresses of first loading of VHB 4910 at a stretch and a rate, of each strip."""
    data, names = cycles("VHB 4910")
    found = []
    for number, name in enumerate(names):
        rows = np.flatnonzero(data.curve == number)
        rows = rows[: data.stretches[rows, 0].argmax() + 1]
        if name.endswith(f"at {rate}") and data.stretches[rows, 0].max() > stretch:
            at = np.interp(stretch, data.stretches[rows, 0], data.nominal_stress[rows])
            found.append(1000 * float(at))
    yield stretch, rate, found, 100 * (max(found) - min(found)) / float(np.mean(found))


if __name__ == "__main__":
    columns = "kept back", "branches (MPa)", "least: .1f", "greatest: .1f", "kept back (%)"
    titles = "temperature", "kept back", "branches (MPa)", "greatest: .1f", "kept back (%): .1f"
    repeated = "stretch: g", "rate (1/s): g", "stresses (kPa): .1f", "spread (%): .1f"
    report(
        __doc__,
        of_rows("histories", kept_back, CASES, *columns),
        of_rows("histories-scatter", scatter, REPEATED, *repeated),
        of_rows("histories-4905", by_temperature, TEMPERATURES, *titles),
    )
