"""Whether relaxation times that fall with the overstress describe cycles better than constant ones.

python pipelines/nonlinear_branches.py          fits both
python pipelines/nonlinear_branches.py --docs   puts the table into the documentation
"""

from collections.abc import Iterator

import numpy as np
from cases import of_rows, report
from histories import CASES, cycles
from scipy.optimize import least_squares

from pdsurrogate.identification.averaging import nonnegative
from pdsurrogate.identification.branch_search import Curves
from pdsurrogate.identification.elastic_part import elastic_without_law
from pdsurrogate.materials.histories import advanced

TIMES = 5.0, 80.0
THRESHOLD = 1.0
POWER = 1.0
"""Start of a search: relaxation times (s), the overstress over the modulus at which a time is half
of its value at rest, and the power by which it falls.
"""

BOUNDS = {"times": (0.01, 1e4), "threshold": (0.01, 1e4), "power": (0.25, 6.0)}
ROUNDS = 3
"""Evaluations of the rate at the end of a step."""

TRIED = [
    *(("VHB 4910", "", *parts) for parts in CASES),
    *(("VHB 4905", f"{one} C", "4.0 at 0.05") for one in (0, 40, 80)),
    *(("VHB 4905", f"{one} C", "4.0 at 0.1") for one in (0, 40, 80)),
]


def branches(curves: Curves, times, threshold: float, power: float) -> np.ndarray:
    """Nominal stresses (n, k) of branches of modulus 1 whose rates 1/time grow by 1 + (s/threshold)
    ^power, where s is the size of the deviator of Cbar C_k^-1. A step has the mean of the rates at
    both of its ends (Bergstrom, Boyce, J. Mech. Phys. Solids 46 (1998) 931, for such rates).
    """

    def faster(squares, states):
        ratios = squares / states
        overstress = np.linalg.norm(ratios - ratios.mean(axis=-1, keepdims=True), axis=-1)
        return 1 + (overstress / threshold) ** power

    squares = curves.squares[..., None, :]
    found = np.ones((*curves.time.shape, len(times), 3))
    begin = faster(squares[0], found[0])
    steps = np.diff(curves.time, axis=0)[..., None] / np.asarray(times)
    for row, step in enumerate(steps, start=1):
        end = begin
        for _ in range(ROUNDS if np.isfinite(threshold) else 1):
            move = advanced(found[row - 1], squares[row - 1], step * (begin + end) / 2)
            found[row] = move(squares[row])
            end = faster(squares[row], found[row])
        begin = end
    slopes = (squares / found)[curves.place]
    return (slopes[..., 0] - slopes[..., 2]) / np.sqrt(curves.squares[curves.place][:, :1])


def compared(material: str, of: str, *parts: str) -> Iterator[tuple]:
    """RMS errors of curves that are fitted and kept back, with constant and with falling times."""
    data, names = cycles(material, of)
    X, y = data.histories(), data.nominal_stress
    curves, kept = Curves.of(X), np.array([any(p in n for p in parts) for n in names])[data.curve]
    known = Curves.of(X[~kept])
    table = elastic_without_law(X[:, :2]).columns(())
    peaks = {one: y[data.curve == one].max() for one in np.unique(data.curve)}
    root = 1 / np.array([peaks[one] for one in data.curve])

    def solved(x):
        times, (threshold, power) = np.exp(x[:2]), np.exp(x[2:]) if len(x) > 2 else (np.inf, 1.0)
        columns = np.column_stack([table[~kept], branches(known, times, threshold, power)])
        sizes = nonnegative(columns, y[~kept], root[~kept])
        return root[~kept] * (columns @ sizes - y[~kept]), sizes, times, threshold, power

    errors: list[list[float]] = []
    constant = np.log(TIMES)
    for start in (constant, np.log([*TIMES, THRESHOLD, POWER])):
        low, high = np.log([BOUNDS["times"]] * 2 + [BOUNDS["threshold"], BOUNDS["power"]]).T
        bounds = low[: len(start)], high[: len(start)]
        best = least_squares(lambda x: solved(x)[0], start, bounds=bounds, diff_step=1e-4)
        _, sizes, times, threshold, power = solved(best.x)
        all_of = np.column_stack([table, branches(curves, times, threshold, power)])
        off = root * (all_of @ sizes - y)
        rms = {one: 100 * np.sqrt((off[data.curve == one] ** 2).mean()) for one in peaks}
        out = {one for one in peaks if kept[data.curve == one].all()}
        fitted = [value for one, value in rms.items() if one not in out]
        errors.append([float(np.sqrt(np.mean(np.square(fitted)))), [rms[one] for one in out]])
    (linear, left), (falling, left_of_falling) = errors
    name = f"{material} {of}".strip()
    yield name, ", ".join(parts), linear, falling, left, left_of_falling, threshold, power


if __name__ == "__main__":
    titles = ("fitted (%): .2f", "falling: .2f", "kept back (%): .1f", "falling: .1f")
    report(
        __doc__,
        of_rows(
            "nonlinear-branches",
            compared,
            TRIED,
            *("material", "kept back", *titles, "threshold: .3g", "power: .2g"),
        ),
    )
