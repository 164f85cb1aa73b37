"""Reports and figures of fits of branches to stresses over time."""

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ..results.figures import STYLE
from .data import TestData
from .examination import standardized
from .history_regressor import FREE, HistoryRegressor
from .reporting import differences, facts_of_tests, judged, parameters_of


def fitted_history(
    data: TestData,
    law: str | None,
    branches: int | None,
    n_terms: int,
    softening: bool,
    falling_times: bool,
    bulk: dict[str, float],
) -> HistoryRegressor:
    """Fit a law (Ogden's with `n_terms` terms), or an energy without one, with branches and
    softening to test data; `branches` is None for a choice by cross-validation, and their times may
    fall with the overstress.
    """
    model = HistoryRegressor(law or FREE, branches, n_terms, softening, falling_times, **bulk)
    return model.fit_tests(data)


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
        "data": data.name,
        "rows": len(data),
        **parameters_of(model),
        "rates": model.rates_ and [*model.rates_],
        "curves": curves,
        "cross_validation": model.cross_validation_,
        "r_squared": data.r_squared(predicted),
        "differences": differences(data, predicted),
        "residuals": standardized(model, data),
        **facts_of_tests(data),
        **judgement,
    }


def figure_of_history(model: HistoryRegressor, data: TestData) -> Figure:
    """Return a figure with a panel for each mode of loading: the stresses of each curve, and lines
    of the fit.
    """
    predicted = model.predict(model.rows_of(data))
    with matplotlib.rc_context(STYLE):
        drawn = Figure(figsize=(3.4 * len(data.modes), 2.9), layout="constrained")
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
