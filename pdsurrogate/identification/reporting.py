"""Reports of identifications, as dictionaries and as figures, and errors of laws in modes of loading to which they are not fitted."""

from __future__ import annotations

from collections.abc import Iterable

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from sklearn.base import clone

from ..results.figures import STYLE
from .data import BIAXIAL, MODES, TestData
from .examination import standardised
from .stress_regressor import StressRegressor, nominal_stress, states


def report(model: StressRegressor, data: TestData) -> dict:
    """Return the data, the parameters with standard errors, and the errors of a fit as plain values, None in place of infinite ones.

    ``differences`` are those of the law with its bulk modulus, as in a simulation of the tests; ``volume_ratio`` is the greatest one, and
    ``residuals`` lists the rows with the greatest residuals.
    """
    predicted, volume = states(model.law_, data.stretches)
    errors = [float(value) if np.isfinite(value) else None for value in model.standard_errors_]
    return {
        "data": data.name,
        "rows": len(data),
        "law": model.law_.describe(),
        "parameters": dict(zip(model.parameter_names_, model.parameters_.tolist(), strict=True)),
        "standard_errors": dict(zip(model.parameter_names_, errors, strict=True)),
        "at_bound": model.at_bound_,
        "r_squared": data.r_squared(predicted),
        "differences": differences(data, predicted),
        "volume_ratio": float(np.nanmax(volume)) if np.isfinite(volume).any() else None,
        "residuals": standardised(model, data),
    }


def differences(data: TestData, stress: np.ndarray) -> dict[str, dict]:
    """Return the greatest difference of stresses, simulated or of a law, from those measured, by mode.

    ``difference`` is relative to the greatest stress measured in the mode, and ``stretch`` is the stretch along the stress; both are None
    if the stress of a state is not finite.
    """
    found = {}
    for mode in data.modes:
        rows = np.flatnonzero(data.mode == mode)
        off = (stress[rows] - data.nominal_stress[rows]) / max(np.abs(data.nominal_stress[rows]).max(), 1e-300)
        place = int(np.argmax(np.abs(off)))  # argmax treats NaN as the greatest
        known = np.isfinite(off[place])
        found[mode] = {
            "difference": float(off[place]) if known else None,
            "stretch": float(data.stretches[rows[place], 0]) if known else None,
        }
    return found


def figure(models: list[StressRegressor], data: TestData, simulated: np.ndarray | None = None) -> Figure:
    """Draw measured points, a line for each fitted law, and crosses for simulated stresses, in one panel for each mode."""
    modes = data.modes
    with matplotlib.rc_context(STYLE):
        drawn = Figure(figsize=(2.6 * max(len(modes), 2), 2.9), layout="constrained")
        for axis, mode in zip(drawn.subplots(1, len(modes), squeeze=False)[0], modes, strict=True):
            rows, crosses = data.of(mode), None if simulated is None else simulated[data.mode == mode]
            axis.set(title=mode, xlabel="stretch")
            axis.grid(alpha=0.3)
            if mode == BIAXIAL:
                axis.plot(rows.nominal_stress, rows.nominal_stress, "-", color="0.6", lw=0.8)
                for model in models:
                    axis.plot(rows.nominal_stress, model.predict(rows.stretches), ".", ms=3, label=model.law)
                if crosses is not None:
                    axis.plot(rows.nominal_stress, crosses, "rx", ms=3, label="simulated")
                axis.set(xlabel="measured stress", ylabel="stress of the law")
                continue
            axis.plot(rows.stretches[:, 0], rows.nominal_stress, "ko", ms=3, mfc="none", label="test")
            stretch = np.linspace(min(1.0, rows.stretches[:, 0].min()), rows.stretches[:, 0].max(), 200)
            for model in models:
                axis.plot(stretch, nominal_stress(model.law_, np.stack([stretch, MODES[mode](stretch)], axis=1)), lw=1, label=model.law)
            if crosses is not None:
                axis.plot(rows.stretches[:, 0], crosses, "rx", ms=3, label="simulated")
        drawn.axes[0].legend(fontsize=7)
        drawn.axes[0].set_ylabel(drawn.axes[0].get_ylabel() or "nominal stress")
        return drawn


def held_out_modes(models: Iterable[StressRegressor], data: TestData, fitted_to: Iterable[str] | None = None) -> list[dict]:
    """Fit each law to some modes of loading, and return its errors in the others.

    Parameters
    ----------
    models : iterable of StressRegressor
    data : TestData
        Data of at least two modes.
    fitted_to : iterable of str, optional
        Modes to which each law is fitted, with all others held out; by default each mode is held out in turn.

    Returns
    -------
    list of dict
        For each law and each split: ``law``, ``fitted_to``, ``held_out`` (R^2 by mode) and ``relative_rms`` of the rows held out, NaN if
        they are past the limit of the law.
    """
    modes = data.modes
    splits = [list(fitted_to)] if fitted_to is not None else [[mode for mode in modes if mode != left] for left in modes]
    rows = []
    for model in models:
        for train in splits:
            known, unseen = data.of(*train), data.of(*(mode for mode in modes if mode not in train))
            if not len(known) or not len(unseen):
                raise ValueError(
                    f"{data.name}: nothing is fitted or nothing held out: fitted to {', '.join(train) or 'no mode'}, of {', '.join(modes)}"
                )
            fitted = clone(model).fit(known.stretches, known.nominal_stress, known.balanced_weights())
            predicted = fitted.predict(unseen.stretches)
            rows.append(
                {
                    "law": model.law,
                    "fitted_to": train,
                    "held_out": unseen.r_squared(predicted),
                    "relative_rms": float(np.sqrt(((predicted - unseen.nominal_stress) ** 2).sum() / (unseen.nominal_stress**2).sum())),
                }
            )
    return rows
