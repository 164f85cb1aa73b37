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
    left = lacking(names, parts)
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


FALLING = [
    *(("VHB 4910", "", *parts) for parts in CASES),
    *(("VHB 4905", f"{one} C", "4.0 at 0.05") for one in (0, 40, 80)),
    *(("VHB 4905", f"{one} C", "4.0 at 0.1") for one in (0, 40, 80)),
]
"""Material, of its curves those that begin with a text, and what is kept back of them, for fits
with times that fall with the overstress and with constant ones.
"""


def lacking(names, parts):
    """Which names have one of the parts."""
    return np.array([any(part in name for part in parts) for name in names])


def with_falling_times(material, of, *parts):
    """RMS errors of curves that are fitted and kept back, with constant and with falling times."""
    data, names = cycles(material, of)
    X, y, left_out = data.histories(), data.nominal_stress, lacking(names, parts)
    numbers, known = np.unique(data.curve), ~left_out[data.curve]
    fitted, kept_back = [], []
    for falling in (False, True):
        model = pds.identification.HistoryRegressor("energy", 2, falling_times=falling)
        off = model.fit(X[known], y[known]).predict(X) - y
        curves = [data.curve == one for one in numbers]
        rms = [100 * np.sqrt((off[rows] ** 2).mean()) / np.abs(y[rows]).max() for rows in curves]
        kept = left_out[numbers]
        fitted.append(float(np.sqrt((np.array(rms)[~kept] ** 2).mean())))
        kept_back.append(np.array(rms)[kept].tolist())
    numbers = dict(zip(model.parameter_names_, model.parameters_, strict=True))
    powers = [value for name, value in numbers.items() if name.startswith("time_power")]
    yield f"{material} {of}".strip(), ", ".join(parts), *fitted, *kept_back, powers


if __name__ == "__main__":
    report(
        __doc__,
        of_rows("histories", kept_back, CASES),
        of_rows("histories-scatter", scatter, REPEATED),
        of_rows("histories-4905", by_temperature, TEMPERATURES),
        of_rows("nonlinear-branches", with_falling_times, FALLING),
    )
