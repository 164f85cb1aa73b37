"""Reports and figures of calibrations, for the command ``pdsurrogate calibrate``."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ..identification import MODES
from ..identification.reporting import parameters_of, plain
from ..results.figures import DIVERGING, spread, styled
from ..results.places import columns_of_measured
from .regressor import SceneRegressor
from .scatter import Rows

STRETCHES = {
    "uniaxial": (0.8, 1.2, 1.5, 2.0),
    "equibiaxial": (1.1, 1.2, 1.5, 2.0),
    "pure-shear": (1.2, 1.5, 2.0),
}
"""Stretches of homogeneous tests in which a report states the stress of the law with its
standard error.
"""

POOR = 1.5
"""Lack of fit above which a report says that the law does not describe the test."""

MANY = 0.05
"""Share of displacements far from the fit above which they are no outliers."""


def _quantities(X: np.ndarray, columns: Sequence[str]) -> dict[str, np.ndarray]:
    """Return masks of the rows of measurements by name: ``fields``, and the outputs by their
    `columns`.
    """
    return {"fields": X[:, 1] > 0} | {
        name: X[:, 1] == -number for number, name in enumerate(columns)
    }


def report(model: SceneRegressor, X: np.ndarray, y: np.ndarray, columns: Sequence[str]) -> dict:
    """Return a report of a calibration as plain values; standard errors that are infinite are
    None, and outputs are named by `columns`.
    """
    fits = {}
    quantities = _quantities(X, columns)
    for name, here in quantities.items():
        if here.any():
            weights = model.weights_[here]

            def mean_of(squares: np.ndarray, weights: np.ndarray = weights) -> float:
                return float(np.average(np.where(weights > 0, squares, 0.0), weights=weights))

            off = model.residuals_[here]
            sd = model.standard_deviations_[here]
            fits[name] = {
                "rows": int(here.sum()),
                "standard_deviation": mean_of(sd**2) ** 0.5,
                "rms_residual": mean_of(off**2) ** 0.5,
                "lack_of_fit": mean_of((off / sd) ** 2),
                "rms_discretization": mean_of(model.discretization_[here] ** 2) ** 0.5,
            }
    stresses = {}
    for mode, stretches in STRETCHES.items():
        states = np.column_stack([np.array(stretches), MODES[mode](np.array(stretches))])
        found = zip(stretches, *model.nominal_stress(states), strict=True)
        stresses[mode] = [
            {"stretch": at, "nominal_stress": plain(stress), "standard_error": plain(error)}
            for at, stress, error in found
        ]
    outputs = {
        name: [
            {"step": int(step), "measured": float(one), "fit": float(one - off)}
            for step, one, off in _steps(model, X, y, here)
        ]
        for name, here in quantities.items()
        if name != "fields"
    }
    remarks = []
    worst = _worst(model, X, columns)
    if model.undetermined_:
        names = ", ".join(model.undetermined_)
        remarks.append(
            f"The test does not determine {names}: a combination has a standard error above a half"
            " of its value."
        )
    if model.at_bound_:
        remarks.append(
            f"{', '.join(model.at_bound_)} reached a bound of the search: another law may fit"
            " better, or a unit of the data is not that of the scene."
        )
    if model.lack_of_fit_ > POOR:
        remarks.append(
            f"The law leaves residuals of {model.lack_of_fit_**0.5:.2g} standard deviations: the"
            " law, the scene, its spacing, the units of the data or the stated noise are not those"
            " of the test. Standard errors are increased by this factor. The greatest residual, of"
            f" {worst['standard_deviations']:.2g} standard deviations, is that of"
            f" {worst['measured']} in step {worst['step']}."
        )
    maps = {}
    if model.maps_:
        far = int(((model.weights_ < 1) & np.isfinite(model.residuals_)).sum())
        far //= max(1, X.shape[1] - 2)
        maps = {
            "map": model.maps_[0].described(),
            "points": {"beside_body_or_at_edges": model.left_out_, "down_weighted": far},
        }
        if far > MANY * fits["fields"]["rows"] / (X.shape[1] - 2):
            remarks.append(
                f"{far} displacements are far from the fit and count less: too many for outliers."
            )
    return {
        **parameters_of(model),
        **maps,
        "correlation": model.correlation_.tolist(),
        "undetermined": model.undetermined_,
        "lack_of_fit": plain(model.lack_of_fit_),
        "p_value": plain(model.p_value_),
        "measurements": fits,
        "worst": worst,
        "outputs": outputs,
        "stresses": stresses,
        "start": model.start_,
        "simulations": model.n_simulations_,
        "remarks": remarks,
    }


def _worst(model: SceneRegressor, X: np.ndarray, columns: Sequence[str]) -> dict:
    """Return what the measurement is with the greatest residual in standard deviations, and this
    residual.
    """
    off = np.abs(model.residuals_) / model.standard_deviations_
    row = int(np.nanargmax(off))
    step, quantity, *place = X[row].tolist()
    what = (
        f"u{quantity:.0f} at ({', '.join(f'{x:g}' for x in place)})"
        if quantity > 0
        else columns[int(-quantity)]
    )
    return {"step": int(step), "measured": what, "standard_deviations": float(off[row])}


def measured_fields(model: SceneRegressor, X: np.ndarray, y: np.ndarray) -> dict[str, np.ndarray]:
    """Return the displacements among measurements, in the frame of the scene, by columns as of
    `columns_of_measured`, NaN for components that were not measured.
    """
    rows = Rows(*X[:, :2].T.astype(int), X[:, 2:])
    numbers = np.unique(rows.step)
    sight = rows.sight(numbers, y, np.ones(len(y)))[0]
    steps, places, moved = numbers[sight.index], sight.places, sight.displacements
    for found in model.maps_.values():
        undeformed = found.to_scene(places)
        moved = found.moved(np.searchsorted(found.steps, steps), places + moved) - undeformed
        places = undeformed
    names = columns_of_measured(places.shape[1])
    return dict(zip(names, [steps, *places.T, *moved.T], strict=True))


def _steps(
    model: SceneRegressor, X: np.ndarray, y: np.ndarray, here: np.ndarray
) -> list[tuple[float, float, float]]:
    """Return step, measured value and residual of the rows of an output, which a mask chooses,
    in the order of the steps.
    """
    return sorted(zip(X[here, 0], y[here], model.residuals_[here], strict=True))


def figures(
    model: SceneRegressor, X: np.ndarray, y: np.ndarray, columns: Sequence[str]
) -> dict[str, Figure]:
    """Return figures by name: the fit of each output, named by `columns`, and maps of the
    residuals of displacements.
    """
    found = {}
    shown = {
        name: here
        for name, here in _quantities(X, columns).items()
        if name != "fields" and here.any()
    }
    if shown:
        with styled(3.4, 2.6 * len(shown)) as found["outputs"]:
            axes = found["outputs"].subplots(len(shown), squeeze=False)[:, 0]
            for axis, (name, here) in zip(axes, shown.items(), strict=True):
                steps, measured, off = np.array(_steps(model, X, y, here)).T
                deviation = model.standard_deviations_[here][np.argsort(X[here, 0], kind="stable")]
                style = {"fmt": "ko", "ms": 3.5, "mfc": "none", "label": "measured, ±2σ"}
                axis.errorbar(steps, measured, 2 * deviation, **style)
                axis.plot(steps, measured - off, "-", lw=1, label=f"{model.law_.name}, fitted")
                axis.set(xlabel="step", ylabel=name, xticks=steps)
                axis.legend()
    if (X[:, 1] > 0).any():
        found["residuals"] = _residual_maps(model, X)
    return found


def _residual_maps(model: SceneRegressor, X: np.ndarray) -> Figure:
    """Return maps of residuals in standard deviations: a row for each component of the
    displacement, a column for each step.
    """
    field = X[:, 1] > 0
    steps = np.unique(X[field, 0])
    components = np.unique(X[field, 1]).astype(int)
    # Maps of more steps than five would be too small to read.
    steps = steps[spread(len(steps), 5)]
    reach = np.ptp(X[field, 2:4], axis=0)
    width = 1.3
    size = (
        width * len(steps) + 0.9,
        (width * reach[1] / max(reach[0], 1e-9) + 0.35) * len(components) + 0.3,
    )
    with styled(*np.minimum(size, 12)) as drawn:
        axes = drawn.subplots(len(components), len(steps), squeeze=False, sharex=True, sharey=True)
        for line, component in zip(axes, components, strict=True):
            for axis, step in zip(line, steps, strict=True):
                here = field & (X[:, 0] == step) & (X[:, 1] == component)
                off = model.residuals_[here] / model.standard_deviations_[here]
                colors = axis.scatter(
                    *X[here, 2:4].T, c=off, s=4, cmap=DIVERGING, vmin=-4, vmax=4, linewidths=0
                )
                axis.set(title=f"u{component}, step {step:g}", aspect="equal")
        drawn.colorbar(colors, ax=axes, label="(measured - fit) / σ", shrink=0.6)
    return drawn
