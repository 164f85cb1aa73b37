"""Drawings of a `Result`: pictures of its states, and curves."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from . import figures
from .measures import greatest_of, label_of, scalars_of
from .tables import columns_of, kind_of

SHOWN_SHARE = 1e-3
"""Size of a force component, divided by that of the greatest component, above which it is drawn or
printed. Chosen: smaller ones may be residuals, which an equilibrium leaves up to a thousandth of
the forces that drive the body.
"""

MOST_PANELS = 4
"""Greatest number of states in a figure of a run."""


def states_figure(
    result, field: str, numbers: list[int], limits: figures.Limits | None = None
) -> Figure:
    """Return a figure of the deformed body, colored by a field, in the states whose indices in
    ``result.states`` are `numbers`.

    All states have one color scale, whose ends are `limits` or by default those of
    `figures.limits_of`.
    """
    # A state may have to be read from its file.
    states = [result.states[number][1] for number in numbers]
    drawn = [(scalars_of(fields, field), greatest_of(fields, field)) for fields in states]
    return figures.contour_figure(
        [result.cells(number) for number in numbers],
        [values for values, _ in drawn],
        label_of(field, result.scene.units),
        [title_of(result, number) for number in numbers],
        limits or _limits_of(drawn),
        [result.scene.units.label(place, "length") for place in figures.PLACES],
    )


def _limits_of(drawn: Iterable[tuple[np.ndarray, float]]) -> figures.Limits:
    """Return the ends of the scale of colors of some states, from the values that are drawn of each
    (`scalars_of`) and the size of the field (`greatest_of`).
    """
    values, sizes = zip(*drawn, strict=True)
    return figures.limits_of(np.concatenate(values), max(sizes))


def whole_figure(result) -> Figure:
    """Return the figure of `Result.figure`, of the deformed body at every level or at a few
    chosen outputs.
    """
    scene = result.scene
    chosen = chosen_states(result)
    if scene.fracture is not None and "crack" in result.summary:
        field = "damage"
    elif scene.stretched:
        field = f"displacement_{(scene.loaded_axis + 1) % scene.dimension + 1}"
    else:
        field = "displacement"
    return states_figure(result, field, chosen)


def chosen_states(result) -> list[int]:
    """Return the numbers of the states in a figure of a run, at most `MOST_PANELS`: evenly spread,
    or, if bonds break in dynamics, evenly over the number of broken bonds.
    """
    tips = result.summary.get("crack", {}).get("tips", ())
    broken = np.array([entry["broken_bonds"] for entry in tips])
    if broken.any():
        # The growth of a crack is a small part of the time.
        begin = len(result.states) - len(broken)
        shares = np.linspace(0.1, 1.0, MOST_PANELS)
        return sorted({*(begin + np.searchsorted(broken, shares * broken[-1])).tolist()})
    return figures.spread(len(result.states), MOST_PANELS)


def title_of(result, number: int) -> str:
    """Return the title of a state for figures: its stretch or loading parameter, and once there
    were dynamics the time.
    """
    moment = result.states.moments[number]
    at = f"t = {moment.t:.3g}" if moment.stretch is None else f"stretch {moment.stretch:.4g}"
    units = result.scene.units
    return f"{at}, {units.amount(moment.time, 'time', '.4g')}" if moment.time else at


def loading_figure(result) -> Figure:
    """Return a figure of nominal stress over stretch if grips load the body, otherwise of the
    forces on it, or of displacements if no motion is prescribed.
    """
    scene = result.scene
    if not scene.stretched:
        moves = scene.obstacles or any(any(e.displacement) or e.rotation for e in scene.prescribed)
        return columns_figure(
            result, *(("force", "force") if moves else ("length", "displacement"))
        )
    known = [level for level in result.levels if "nominal_stress_reference" in level]
    references = [(level["stretch"], level["nominal_stress_reference"]) for level in known]
    return columns_figure(result, "stress", "nominal stress", references)


def columns_figure(
    result, kind: str, what: str, references: Sequence[tuple[float, float]] = ()
) -> Figure:
    """Return a figure of the columns of the history whose unit is of a kind, over the stretch, the
    time or the loading parameter.

    Columns of less than `SHOWN_SHARE` of the greatest are left out.
    """
    scene = result.scene
    history = result.history
    key = "stretch" if scene.stretched else "t"
    timed = [row for row in history if "time" in row]
    if timed and (scene.times or not scene.stretched):
        key = "time"
        history = timed
    greatest = {
        column: max(abs(row.get(column, 0.0)) for row in history)
        for column in columns_of(history)
        if kind_of(column) == kind and not column.startswith("moment_")
    }
    least = SHOWN_SHARE * max(greatest.values(), default=0.0)
    rows = [{key: 1.0 if key == "stretch" else 0.0}, *history]
    return figures.curves_figure(
        [row[key] for row in rows],
        {
            column.removeprefix(f"{what}_").replace("_", " "): [
                row.get(column, 0.0) for row in rows
            ]
            for column, size in greatest.items()
            if size >= least
        },
        {"time": scene.units.label("time", "time"), "t": "loading parameter t"}.get(key, key),
        scene.units.label(what, kind),
        references,
    )


def save_drawings(result, folder: Path) -> None:
    """Draw the loading curve and the deformed body of a result, as far as they apply, and write
    them to a folder.
    """
    scene = result.scene
    name = result.scene.name
    if not scene.stretched or scene.dynamics is not None or scene.times:
        figures.save(loading_figure(result), folder / f"{name}-loading.png")
    if not result.states.in_pieces:
        figures.save(whole_figure(result), folder / f"{name}.png")
