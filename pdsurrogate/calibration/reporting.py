"""Files of measurements, and reports and figures of calibrations, for the command ``pdsurrogate calibrate``."""

import csv
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ..identification import MODES
from ..identification.reporting import covariance_of
from ..results.figures import DIVERGING, STYLE
from ..scenes import Scene
from .regressor import SceneRegressor

STRETCHES = {"uniaxial": (0.8, 1.2, 1.5, 2.0), "equibiaxial": (1.1, 1.2, 1.5, 2.0), "pure-shear": (1.2, 1.5, 2.0)}
"""Stretches of homogeneous tests in which a report states the stress of the law with its standard error."""

MOST_MAPS = 5
"""Greatest number of steps whose residuals are drawn, evenly chosen with the last one: maps of more would be too small to read."""


def read_columns(path: Path, columns: tuple[str, ...]) -> tuple[np.ndarray, list[int]]:
    """Return columns of numbers from a CSV file with a line of headings, shape (n, columns), and the line of each row of them.

    Further columns are ignored.

    Raises
    ------
    ValueError
        If the file cannot be read, lacks a column, has it twice or has no rows, or a row has more entries than there are columns, or one
        that is no finite number; the message names the line.
    """
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"cannot read {path}: {getattr(error, 'strerror', None) or 'it is not UTF-8 text'}") from None
    reader = csv.DictReader("" if line.lstrip().startswith("#") else line for line in lines)
    names = [name.strip() for name in reader.fieldnames or ()]
    if missing := [name for name in columns if name not in names]:
        found = f"there is no {missing[0]} among {', '.join(names) or 'none'}"
        raise ValueError(f"{path}: the columns, separated by commas, must be {', '.join(columns)}; {found}")
    if twice := [name for name in columns if names.count(name) > 1]:
        raise ValueError(f"{path}: there are two columns {twice[0]}")
    reader.fieldnames, found, numbers = names, [], []
    for row in reader:
        if None in row:
            raise ValueError(
                f"{path}, line {reader.line_num}: more entries than the {len(names)} columns; decimals have points, not commas"
            )
        try:
            found.append([float(row[name]) for name in columns])
        except (TypeError, ValueError):
            raise ValueError(f"{path}, line {reader.line_num}: {', '.join(columns)} must be numbers") from None
        if not np.isfinite(found[-1]).all():
            raise ValueError(f"{path}, line {reader.line_num}: {', '.join(columns)} must be finite numbers")
        numbers.append(reader.line_num)
    if not found:
        raise ValueError(f"{path}: there are no rows")
    return np.array(found), numbers


def _read_steps(scene: Scene, path: Path, columns: tuple[str, ...]) -> np.ndarray:
    """Return columns of a file, the first of which is ``step``.

    Raise ValueError with the line of a step that the scene does not have, or of a displacement that is a copy of an earlier row.
    """
    found, lines = read_columns(path, ("step", *columns))
    most = len(scene.stretches) if scene.stretched else np.inf
    for step, line in zip(found[:, 0], lines, strict=True):
        if step != round(step) or not 1 <= step <= most:
            known = f"1 to {most}, the stretches of scene {scene.name}" if scene.stretched else f"the outputs of scene {scene.name} from 1"
            raise ValueError(f"{path}, line {line}: step {step:g}, but the steps are whole numbers: {known}")
    first = np.unique(found, axis=0, return_index=True)[1]
    if len(columns) > 1 and len(first) < len(found):
        raise ValueError(f"{path}, line {lines[np.delete(np.arange(len(found)), first)[0]]}: this row is a copy of an earlier one")
    return found


def measurements(scene: Scene, fields: Path | None, forces: Path | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the table of measurements and their values, as `SceneRegressor` takes them, from a file of fields and one of forces."""
    d, tables, values = scene.dimension, [], []
    if fields is None and forces is None:
        raise ValueError("there is nothing to fit: give --fields, --forces or both")
    if fields is not None:
        axes = range(1, d + 1)
        found = _read_steps(scene, fields, (*(f"x{axis}" for axis in axes), *(f"u{axis}" for axis in axes)))
        for axis in axes:
            tables.append(np.column_stack([found[:, 0], np.full(len(found), axis), found[:, 1 : 1 + d]]))
            values.append(found[:, d + axis])
    if forces is not None:
        found = _read_steps(scene, forces, ("force",))
        tables.append(np.column_stack([found[:, 0], np.zeros((len(found), 1 + d))]))
        values.append(found[:, 1])
    return np.vstack(tables), np.concatenate(values)


def report(model: SceneRegressor, X: np.ndarray, y: np.ndarray) -> dict:
    """Return a report of a calibration as plain values; standard errors that are infinite are None."""
    errors = [float(value) if np.isfinite(value) else None for value in model.standard_errors_]
    field = X[:, 1] > 0
    fits = {}
    for name, here in (("fields", field), ("forces", ~field)):
        if here.any():
            off, sd = model.residuals_[here], model.standard_deviations_[here]
            fits[name] = {
                "rows": int(here.sum()),
                "standard_deviation": float(np.sqrt((sd**2).mean())),
                "rms_residual": float(np.sqrt((off**2).mean())),
                "lack_of_fit": float(((off / sd) ** 2).mean()),
                "rms_discretization": float(np.sqrt((model.discretization_[here] ** 2).mean())),
            }
    stresses = {}
    for mode, stretches in STRETCHES.items():
        states = np.stack([np.array(stretches), MODES[mode](np.array(stretches))], axis=1)
        found = zip(stretches, *model.nominal_stress(states), strict=True)
        stresses[mode] = [{"stretch": at, "nominal_stress": _plain(stress), "standard_error": _plain(error)} for at, stress, error in found]
    steps = [{"step": int(step), "force": float(one), "fit": float(one - off)} for step, one, off in _forces(model, X, y)]
    return {
        "law": model.law_.describe(),
        "parameters": dict(zip(model.parameter_names_, model.parameters_.tolist(), strict=True)),
        "standard_errors": dict(zip(model.parameter_names_, errors, strict=True)),
        "correlation": model.correlation_.tolist(),
        "covariance": covariance_of(model),
        "at_bound": model.at_bound_,
        "undetermined": model.undetermined_,
        "lack_of_fit": _plain(model.lack_of_fit_),
        "p_value": _plain(model.p_value_),
        "measurements": fits,
        "worst": _worst(model, X),
        "forces": steps,
        "stresses": stresses,
        "simulations": model.n_simulations_,
    }


def _worst(model: SceneRegressor, X: np.ndarray) -> dict:
    """Return what the measurement is with the greatest residual in standard deviations, and this residual."""
    off = np.abs(model.residuals_) / model.standard_deviations_
    row = int(np.nanargmax(off))
    step, quantity, *place = X[row].tolist()
    what = f"u{quantity:.0f} at ({', '.join(f'{x:g}' for x in place)})" if quantity > 0 else "the force"
    return {"step": int(step), "measured": what, "standard_deviations": float(off[row])}


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _forces(model: SceneRegressor, X: np.ndarray, y: np.ndarray) -> list[tuple[float, float, float]]:
    """Return step, measured value and residual of the rows that are forces, by step."""
    here = X[:, 1] == 0
    return sorted(zip(X[here, 0], y[here], model.residuals_[here], strict=True))


def figures(model: SceneRegressor, X: np.ndarray, y: np.ndarray) -> dict[str, Figure]:
    """Return figures by name: the fit of the forces, and maps of the residuals of displacements in standard deviations."""
    found = {}
    with matplotlib.rc_context(STYLE):
        if rows := _forces(model, X, y):
            steps, measured, off = np.array(rows).T
            found["forces"] = drawn = Figure(figsize=(3.4, 2.6), layout="constrained")
            axis = drawn.subplots()
            axis.errorbar(
                steps, measured, 2 * model.standard_deviations_[X[:, 1] == 0], fmt="ko", ms=3.5, mfc="none", label="measured, ±2σ"
            )
            axis.plot(steps, measured - off, "-", lw=1, label=f"{model.law_.name}, fitted")
            axis.set(xlabel="step", ylabel="force", xticks=steps)
            axis.legend()
        if (X[:, 1] > 0).any():
            found["residuals"] = _residual_maps(model, X)
    return found


def _residual_maps(model: SceneRegressor, X: np.ndarray) -> Figure:
    """Return maps of residuals in standard deviations: a row for each component of the displacement, a column for each step."""
    field = X[:, 1] > 0
    steps, components = np.unique(X[field, 0]), np.unique(X[field, 1]).astype(int)
    steps = steps[np.unique(np.linspace(0, len(steps) - 1, MOST_MAPS).round().astype(int))]
    reach = np.ptp(X[field, 2:4], axis=0)
    width = 1.3
    size = (width * len(steps) + 0.9, (width * reach[1] / max(reach[0], 1e-9) + 0.35) * len(components) + 0.3)
    drawn = Figure(figsize=np.minimum(size, 12), layout="constrained")
    axes = drawn.subplots(len(components), len(steps), squeeze=False, sharex=True, sharey=True)
    for line, component in zip(axes, components, strict=True):
        for axis, step in zip(line, steps, strict=True):
            here = field & (X[:, 0] == step) & (X[:, 1] == component)
            off = model.residuals_[here] / model.standard_deviations_[here]
            colors = axis.scatter(*X[here, 2:4].T, c=off, s=4, cmap=DIVERGING, vmin=-4, vmax=4, linewidths=0)
            axis.set(title=f"u{component}, step {step:g}", aspect="equal")
    drawn.colorbar(colors, ax=axes, label="(measured - fit) / σ", shrink=0.6)
    return drawn
