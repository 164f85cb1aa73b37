"""Reports and figures of fits of branches to stresses over time."""

import numpy as np
from matplotlib.figure import Figure

from ..results.figures import styled
from .data import TestData
from .history_regressor import HistoryRegressor
from .reporting import judged, report


def report_of_history(model: HistoryRegressor, data: TestData) -> dict:
    """Return a report of a fit of branches as plain values.

    ``curves`` has the RMS error of each specimen relative to its greatest stress, ``rates`` the
    least and greatest rate of stretch, ``cross_validation`` the errors of stresses left out by
    number of branches.
    """
    predicted = model.predict(model.rows_of(data))
    curves = []
    for number in np.unique(data.curve):
        rows = data.curve == number
        stress = data.nominal_stress[rows]
        off = predicted[rows] - stress
        curves.append(
            {
                "specimen": data.tests.specimens[number].name if data.tests else str(number),
                "mode": str(data.mode[rows][0]),
                "rows": int(rows.sum()),
                "duration": float(np.ptp(data.time[rows])),
                "greatest_stretch": float(data.stretches[rows, 0].max()),
                "relative_rms": float(np.sqrt((off**2).mean()) / np.abs(stress).max()),
            }
        )
    judgement = judged(model, data, model.form)
    if model.softening and model.law_.memory.softening.beta == 0:
        judgement["remarks"].append(
            f"{model.form}: all curves unload from nearly one stretch, so that beta of softening"
            " is not told from m, and is 0; unload from others too"
        )
    if model.branches is None and not model.law_.memory.branches:
        judgement["remarks"].append(
            f"{model.form}: the data show no relaxation beyond their errors, so that there are no"
            " branches; --branches 1 asks for one"
        )
    return {
        "form": model.form,
        **report(model, data, predicted),
        "rates": model.rates_ and [*model.rates_],
        "curves": curves,
        "cross_validation": model.cross_validation_,
        **judgement,
    }


def figure_of_history(model: HistoryRegressor, data: TestData) -> Figure:
    """Return a figure with a panel for each mode of loading: the stresses of each curve, and lines
    of the fit.
    """
    predicted = model.predict(model.rows_of(data))
    with styled(3.4 * len(data.modes), 2.9) as drawn:
        axes = drawn.subplots(1, len(data.modes), squeeze=False)[0]
        for axis, mode in zip(axes, data.modes, strict=True):
            axis.set(title=mode, xlabel="stretch")
            for number in np.unique(data.curve[data.mode == mode]).tolist():
                rows = data.curve == number
                stretch, color = data.stretches[rows, 0], f"C{number % 10}"
                axis.plot(stretch, data.nominal_stress[rows], ".", ms=2, color=color)
                axis.plot(stretch, predicted[rows], "-", lw=1, color=color)
        axes[0].set_ylabel(f"nominal stress{f' ({data.unit})' if data.unit else ''}")
        return drawn
