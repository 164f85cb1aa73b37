"""Files of measurements, and reports and figures of calibrations, for the command ``pdsurrogate
calibrate``.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ..identification import MODES
from ..identification.campaign import option_of
from ..identification.reporting import parameters_of, plain
from ..measurements import read_tables
from ..results.figures import DIVERGING, STYLE, spread
from ..results.places import columns_of_measured
from ..results.tables import column_name
from ..scenes import Scene
from .field_files import FieldFacts, FieldRows, field_rows, is_own
from .machine import is_machine, machine_forces
from .regressor import SceneRegressor

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

MOST_MAPS = 5
"""Greatest number of steps whose residuals are drawn, evenly chosen with the last one: maps of
more would be too small to read.
"""


OUTPUTS = {
    "force": "force",
    "force_(.+)_([123])": "forces.{}",
    "moment_(.+)_([123])": "moments.{}",
    "moment_(.+)": "moments.{}",
    "displacement_(.+)_([123])": "displacements.{}",
    "(.+)_displacement_([123])": "probes.{}.displacement",
    "probe_(.+)_u([123])": "probes.{}.displacement",
    "nominal_stress": "nominal_stress",
    "strain_energy": "energy",
}
"""Dotted keys of measured outputs by their columns, as in ``history.csv``; groups are the name
of a region or probe, and a component.
"""


def output_of(column: str) -> str | None:
    """Return the dotted key of the output that a column of a file contains; None for another
    column.
    """
    for pattern, key in OUTPUTS.items():
        if found := re.fullmatch(pattern, column):
            name, *component = found.groups() or (None,)
            return ".".join([key.format(name), *(str(int(number) - 1) for number in component)])
    return None


def read_columns(
    path: Path, columns: tuple[str, ...], others: Callable[[str], object] = lambda name: False
) -> tuple[np.ndarray, list[str], list[str]]:
    """Return columns of numbers from a table with a line of headings, (n, columns), the place of
    each row, and the names of the columns.

    They are those of `columns`, and then further ones that `others` chooses by their names, where
    an empty entry is NaN. Headers may have units in brackets, as those of ``history.csv``.

    Raises
    ------
    ValueError
        If the file cannot be read (`read_tables`), lacks a column or has it twice, or an entry is
        no finite number; the message names the line.
    """
    blocks = read_tables(path).blocks
    tables = [{column_name(one.heading): one.values for one in block.columns} for block in blocks]
    lines = np.concatenate([block.lines for block in blocks])
    if len({*lines}) < len(lines):
        twice = [name for name in tables[1] if name in tables[0]]
        raise ValueError(f"{path}: there are two columns {twice[-1]}")
    if any([*table] != [*tables[0]] for table in tables):
        raise ValueError(f"{path}: there are several tables, of which one is needed")
    table = {name: np.concatenate([one[name] for one in tables]) for name in tables[0]}
    if missing := [name for name in columns if name not in table]:
        found = f"there is no {missing[0]} among {', '.join(table)}"
        raise ValueError(f"{path}: the columns must be {', '.join(columns)}; {found}")
    names = [*columns, *(name for name in table if name not in columns and others(name))]
    places = [f"{path}, line {line}" for line in lines]
    for name in names:
        wrong = [
            isinstance(one, str) or (name in columns and not np.isfinite(one))
            for one in table[name]
        ]
        if any(wrong):
            raise ValueError(f"{places[wrong.index(True)]}: {name} is not a number")
    return np.array([table[name] for name in names], dtype=float).T, places, names


def _check_rows(scene: Scene, found: np.ndarray, places: list[str]) -> None:
    """Raise ValueError with the place of a step, the first column, that the scene does not have,
    or of a copy of an earlier row.
    """
    most = len(scene.stretches) if scene.stretched else np.inf
    for step, where in zip(found[:, 0], places, strict=True):
        if step != round(step) or not 1 <= step <= most:
            known = (
                f"1 to {most}, the stretches of scene {scene.name}"
                if scene.stretched
                else f"the outputs of scene {scene.name} from 1"
            )
            raise ValueError(f"{where}: step {step:g}, but the steps are whole numbers: {known}")
    first = np.unique(found, axis=0, return_index=True)[1]
    if len(first) < len(found):
        where = places[np.delete(np.arange(len(found)), first)[0]]
        raise ValueError(f"{where}: this row is a copy of an earlier one")


def measurements(
    scene: Scene,
    fields: list[Path] | None,
    forces: Path | None,
    stated: Mapping[str, Any],
    times: str | None,
    image: FieldFacts,
    unit: str | None,
) -> tuple[np.ndarray, np.ndarray, dict[str, str], FieldRows | None]:
    """Return the table of measurements and their values, as `SceneRegressor` takes them, from
    files of fields, in a `unit`, and one of outputs or of a machine (`machine_forces`, with what is
    stated of it).

    The third item has, by the names of their columns, the dotted keys of the outputs, which are the
    quantities 0, -1, and so on; the fourth one the first rows, those of fields of a camera.
    """
    images = None
    d = scene.dimension
    tables = []
    values = []
    outputs = {}
    if not fields and forces is None:
        raise ValueError("there is nothing to fit: give --fields, --forces or both")
    machine = forces is not None and is_machine(forces)
    if not machine and (stated or times is not None):
        option = option_of(next(iter(stated), "times"))
        raise ValueError(f"{option} is for --forces with the table of a machine")
    if fields and not is_own(fields, image):
        images = field_rows(scene, fields, image, unit)
        tables.append(images.X)
        values.append(images.y)
    elif fields:
        axes = range(1, d + 1)
        found, places, _ = read_columns(
            fields[0], ("step", *(f"x{axis}" for axis in axes), *(f"u{axis}" for axis in axes))
        )
        _check_rows(scene, found, places)
        for axis in axes:
            tables.append(
                np.column_stack([found[:, 0], np.full(len(found), axis), found[:, 1 : 1 + d]])
            )
            values.append(found[:, d + axis])
    if forces is not None:
        if machine:
            found, places = machine_forces(scene, forces, stated, times)
            names = ["force"]
        else:
            found, places, (_, *names) = read_columns(
                forces, ("step",), lambda name: output_of(name) or name == "evaluations"
            )
        if "evaluations" in names:
            raise ValueError(
                f"{forces}: this is the history of a run, whose step is that of the scene: number"
                " the outputs from 1"
            )
        if not names:
            raise ValueError(
                f"{forces}: there is no column force, nor another one with a measurement, as"
                " history.csv of a run has them (force_right_1, tip_displacement_2)"
            )
        _check_rows(scene, found, places)
        outputs = {name: str(output_of(name)) for name in names}
        for number, column in enumerate(found[:, 1:].T):
            there = np.isfinite(column)
            tables.append(
                np.column_stack(
                    [found[there, 0], np.full(there.sum(), -number), np.zeros((there.sum(), d))]
                )
            )
            values.append(column[there])
    if not sum(map(len, values)):
        raise ValueError(
            f"{forces}: there are no measurements, all entries of {', '.join(outputs)} are empty"
        )
    return np.vstack(tables), np.concatenate(values), outputs, images


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
        states = np.stack([np.array(stretches), MODES[mode](np.array(stretches))], axis=1)
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
        other = "another law may fit better, or a unit of the data is not that of the scene"
        remarks.append(f"{', '.join(model.at_bound_)} reached a bound of the search: {other}.")
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
    d = X.shape[1] - 2
    here = X[:, 1] > 0
    rows, at = np.unique(X[here][:, [0, *range(2, 2 + d)]], axis=0, return_inverse=True)
    moved = np.full((len(rows), d), np.nan)
    moved[at.ravel(), X[here, 1].astype(int) - 1] = y[here]
    steps, places = rows[:, 0], rows[:, 1:]
    for found in model.maps_.values():
        undeformed = found.to_scene(places)
        moved = found.moved(np.searchsorted(found.steps, steps), places + moved) - undeformed
        places = undeformed
    return dict(zip(columns_of_measured(d), [steps, *places.T, *moved.T], strict=True))


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
    with matplotlib.rc_context(STYLE):
        if shown:
            found["outputs"] = drawn = Figure(figsize=(3.4, 2.6 * len(shown)), layout="constrained")
            for axis, (name, here) in zip(
                drawn.subplots(len(shown), squeeze=False)[:, 0], shown.items(), strict=True
            ):
                steps, measured, off = np.array(_steps(model, X, y, here)).T
                deviation = model.standard_deviations_[here][np.argsort(X[here, 0], kind="stable")]
                axis.errorbar(
                    steps,
                    measured,
                    2 * deviation,
                    fmt="ko",
                    ms=3.5,
                    mfc="none",
                    label="measured, ±2σ",
                )
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
    steps = steps[spread(len(steps), MOST_MAPS)]
    reach = np.ptp(X[field, 2:4], axis=0)
    width = 1.3
    size = (
        width * len(steps) + 0.9,
        (width * reach[1] / max(reach[0], 1e-9) + 0.35) * len(components) + 0.3,
    )
    drawn = Figure(figsize=np.minimum(size, 12), layout="constrained")
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
