"""Tears of rubber with a branch: what a running crack takes from the body, by its speed, with the
figure for the documentation.

python pipelines/rate_tears.py             all cases, some minutes each
python pipelines/rate_tears.py --docs      the table of all stored figures, and the figure
"""

import numpy as np
from cases import of_rows, report, rows_of, scene_of, stored
from matplotlib.figure import Figure
from pages import FIGURES

import pdsurrogate as pds
from pdsurrogate.results import figures

LENGTH, CUT = 2.5, 0.75
TIMES = (0.0, 0.0003, 0.003, 0.03, 0.3, 3.0)
"""Relaxation times; 0 for elastic rubber."""


def strip(time, stretch_rate):
    """A cut strip of pure shear in plane strain, relaxed at a stretch below that at which it tears,
    and stretched on at a constant rate.
    """
    changes = {"times": 1e6 * (time or 1.0), "dynamics.stretch_rate": stretch_rate}
    branches = [{"modulus": 2.0, "time": time}] if time else []
    return scene_of("rate-tear", changes | {"material.branches": branches})


def torn(time, stretch_rate):
    """Stretch at the greatest force and mean speed of the crack in horizons a relaxation time;
    energy per torn length, from the first broken bond to the last: supplied, released by bonds,
    dissipated by the branch, by viscosity, and the gap of the account.
    """
    result = pds.simulate(strip(time, stretch_rate), "bond-energy", threads=1)
    crack = result.summary["crack"]
    begin, end = crack["start"]["time"], crack["tips"][-1]["time"]
    rows = [row for row in result.history if "kinetic_energy" in row]

    def change(key):
        of = [row.get(key, 0.0) for row in rows]
        return float(np.diff(np.interp([begin, end], [row["time"] for row in rows], of))[0])

    length = LENGTH - CUT
    keys = "released_energy", "dissipated_by_branches", "damped_energy"
    taken = [change(key) / length for key in keys]
    speed = length / (end - begin)
    gap = result.summary["dynamics"][0]["greatest_energy_gap"]
    peak = crack["peak"]["stretch"]
    yield time, speed, speed * time / result.body.horizon, peak, sum(taken), *taken, gap


def main():
    """Measure, and draw what is stored."""
    study = of_rows("rate-tears", torn, [(time, 0.005) for time in TIMES])
    report(__doc__, study)
    rows = np.array(rows_of(stored(study.name)))
    rows = rows[rows[:, 0] > 0]
    figure = Figure(figsize=(5.0, 3.4), layout="constrained")
    axes = figure.subplots()
    axes.stackplot(rows[:, 2], *rows[:, 5:8].T, labels=["bonds", "branch", "viscosity"], alpha=0.7)
    axes.plot(rows[:, 2], rows[:, 4], "ko-", ms=4, label="all")
    axes.set(xscale="log", xlabel="speed of the crack · τ / δ", ylabel="energy per torn length")
    axes.legend()
    figures.save(figure, FIGURES / "rate-tears.png")


if __name__ == "__main__":
    main()
