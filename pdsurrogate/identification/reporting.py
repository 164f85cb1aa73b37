"""An identification as a dictionary and as a figure."""

from __future__ import annotations

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ..results.figures import STYLE
from .data import BIAXIAL, MODES, TestData
from .stress_regressor import StressRegressor, nominal_stress


def report(model: StressRegressor, data: TestData) -> dict:
    """What was fitted to what, the parameters with their standard errors, and R^2 by mode; plain values, None where not finite."""
    errors = [float(value) if np.isfinite(value) else None for value in model.standard_errors_]
    return {
        "data": data.name,
        "rows": len(data),
        "law": model.law_.describe(),
        "parameters": dict(zip(model.parameter_names_, model.parameters_.tolist(), strict=True)),
        "standard_errors": dict(zip(model.parameter_names_, errors, strict=True)),
        "at_bound": model.at_bound_,
        "r_squared": data.r_squared(model.predict(data.stretches)),
    }


def figure(models: list[StressRegressor], data: TestData) -> Figure:
    """Measured points, and a line for each fitted law, one panel for each mode."""
    modes = data.modes
    with matplotlib.rc_context(STYLE):
        drawn = Figure(figsize=(2.6 * max(len(modes), 2), 2.9), layout="constrained")
        for axis, mode in zip(drawn.subplots(1, len(modes), squeeze=False)[0], modes, strict=True):
            rows = data.of(mode)
            axis.set(title=mode, xlabel="stretch")
            axis.grid(alpha=0.3)
            if mode == BIAXIAL:
                axis.plot(rows.nominal_stress, rows.nominal_stress, "-", color="0.6", lw=0.8)
                for model in models:
                    axis.plot(rows.nominal_stress, model.predict(rows.stretches), ".", ms=3, label=model.law)
                axis.set(xlabel="measured stress", ylabel="stress of the law")
                continue
            axis.plot(rows.stretches[:, 0], rows.nominal_stress, "ko", ms=3, mfc="none", label="test")
            stretch = np.linspace(min(1.0, rows.stretches[:, 0].min()), rows.stretches[:, 0].max(), 200)
            for model in models:
                axis.plot(stretch, nominal_stress(model.law_, np.stack([stretch, MODES[mode](stretch)], axis=1)), lw=1, label=model.law)
        drawn.axes[0].legend(fontsize=7)
        drawn.axes[0].set_ylabel(drawn.axes[0].get_ylabel() or "nominal stress")
        return drawn
