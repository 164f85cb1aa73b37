"""Drawings of a `Result`: pictures of its states, curves, an animation of its dynamics, and a
page of HTML that needs no other file.
"""

import base64
import io
import json
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from string import Template

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from ..html_tables import html_facts
from ..progress import event
from . import figures
from .files import MARK, replacing
from .loading_curve import NEGLIGIBLE, loading_curve
from .measures import greatest_of, label_of, scalars_of
from .tables import columns_of, facts, html_history

FRAMES_PER_SECOND = 8
"""Frames of an animation per second. Chosen: single states can be told apart, and the usual
number of them takes some seconds.
"""

PAGE = Path(__file__).with_name("page.html")
"""Path of the template that `html_page` fills in."""

MOST_OUTPUTS = 40
"""Greatest number of states on a page of HTML; from a longer run, states are chosen evenly. Chosen:
the page holds a picture of every field in every state, so that its size grows with both.
"""

MOST_ROWS = 200
"""Greatest number of rows of a run's history on a page of HTML; of a longer one every second, third
or further row is shown. Chosen: the table stays readable, and ``history.csv`` has all rows.
"""

USUAL = ("displacement", "von_mises", "principal_stretch", "damage")
"""Fields that a page of HTML shows by default, as far as the last state has them."""


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
    values, titles = (
        [scalars_of(fields, field) for fields in states],
        [title_of(result, number) for number in numbers],
    )
    limits = limits or figures.limits_of(
        np.concatenate(values), max(greatest_of(fields, field) for fields in states)
    )
    places = [result.scene.units.label(place, "length") for place in figures.PLACES]
    return figures.contour_figure(
        [result.cells(number) for number in numbers],
        values,
        label_of(field, result.scene.units),
        titles,
        limits,
        places,
    )


def whole_figure(result) -> Figure:
    """Return the figure of `Result.figure`, of the deformed body at every level or at a few
    chosen outputs.
    """
    scene = result.scene
    chosen = chosen_states(result, 6 if scene.dimension == 2 and scene.fracture is None else 4)
    if scene.fracture is not None and chosen[-1] in in_dynamics(result):
        field = "damage"
    else:
        field = (
            f"displacement_{(scene.loaded_axis + 1) % scene.dimension + 1}"
            if scene.stretched
            else "displacement"
        )
    return states_figure(result, field, chosen)


def in_dynamics(result) -> list[int]:
    """Return the numbers of the states that were recorded in dynamics."""
    if result.scene.stretched:
        return list(range(len(result.levels), len(result.states)))
    return [number for number, level in enumerate(result.levels) if "time" in level]


def chosen_states(result, most: int) -> list[int]:
    """Return the numbers of the states in a figure of a run: all if grips load the body without
    dynamics, otherwise at most `most`.

    These are spread evenly over all outputs, or, with grips or fracture, over the outputs from the
    first one in dynamics on. If bonds break in dynamics, the states are spread evenly over the
    number of broken bonds.
    """
    moving, count, stretched = in_dynamics(result), len(result.states), result.scene.stretched
    if not count or (stretched and result.scene.dynamics is None):
        return list(range(count))
    cracks = bool(moving) and result.scene.fracture is not None
    chosen = np.linspace(
        moving[0] if moving and (stretched or cracks) else 0, count - 1, min(most, count)
    )
    if cracks:
        broken = np.array([entry["broken_bonds"] for entry in result.summary["crack"]["tips"]])
        if broken[-1] > 0:
            # Frames are distributed evenly over the growth of the crack, which is a small part of
            # the time.
            chosen = np.array(moving)[
                np.searchsorted(broken, np.linspace(0.1, 1.0, most) * broken[-1])
            ]
    return sorted(set(chosen.round().astype(int).tolist()))


def title_of(result, number: int) -> str:
    """Return the title of a state for figures: its stretch or loading parameter, and in dynamics
    the time.
    """
    moment, moving = result.states.moments[number], number in in_dynamics(result)
    if result.scene.stretched:
        at = f"stretch {moment.stretch:.3f}" if moving else f"stretch {moment.stretch:g}"
    else:
        at = f"t = {moment.t:.3g}"
    return f"{at}, {result.scene.units.amount(moment.time, 'time', '.4g')}" if moving else at


def loading_figure(result) -> Figure:
    """Return a figure of nominal stress over stretch if grips load the body, otherwise of its
    `loading_curve`.
    """
    scene = result.scene
    if scene.stretched:
        rows = [
            {"stretch": 1.0, "nominal_stress": 0.0},
            *result.levels,
            *(row for row in result.history if "time" in row),
        ]
        known = [level for level in result.levels if "nominal_stress_reference" in level]
        references = [(level["stretch"], level["nominal_stress_reference"]) for level in known]
        curves = {"peridynamics": [row["nominal_stress"] for row in rows]}
        return figures.curves_figure(
            [row["stretch"] for row in rows],
            curves,
            "stretch",
            scene.units.label("nominal stress", "stress"),
            references,
        )
    law = scene.material and scene.material.build()
    volume = result.summary["n_points"] * result.summary["spacing"] ** scene.dimension
    return figures.curves_figure(
        *loading_curve(scene, result.history),
        least=NEGLIGIBLE * volume * law.shear_modulus if law else 0.0,
    )


def energies_figure(result) -> Figure | None:
    """Return a figure of the energies in the history against time, stretch or the loading
    parameter; None if there are no energies.
    """
    rows, units = [row for row in result.history if "strain_energy" in row], result.scene.units
    timed = [row for row in rows if "time" in row]
    key, start = (
        ("time", [])
        if timed
        else ("stretch", [{"stretch": 1.0}])
        if result.scene.stretched
        else ("t", [{"t": 0.0}])
    )
    rows = start + (timed or rows)
    names = [
        column for column in columns_of(rows) if column == "work" or column.endswith("_energy")
    ]
    if not names:
        return None
    energies = {name.replace("_", " "): [row.get(name, 0.0) for row in rows] for name in names}
    xlabel = units.label("time", "time") if timed else {"t": "loading parameter t"}.get(key, key)
    what = "energy" if len(names) > 1 else names[0].replace("_", " ")
    return figures.curves_figure(
        [row[key] for row in rows], energies, xlabel, units.label(what, "energy")
    )


def save_drawings(result, folder: Path) -> None:
    """Draw the loading curve, the deformed body and an animation of a result, as far as they
    apply, and write them to a folder.
    """
    name = result.scene.name
    moves = not result.scene.stretched or result.scene.dynamics is not None
    if moves:
        figures.save(loading_figure(result), folder / f"{name}-loading.png")
    if not result.states.in_pieces:
        figures.save(whole_figure(result), folder / f"{name}.png")
        if moves:
            _save_animation(result, folder / f"{name}.gif")


def _save_animation(result, path: Path) -> None:
    """Write a GIF of the states of a sheet in dynamics, colored by damage if the run has this
    field, else by the greatest stretch.

    Write nothing for a solid or for a run without dynamics.
    """
    numbers = in_dynamics(result)
    if not numbers or result.scene.dimension == 3:  # ParaView shows a series of solids
        return
    fields = result.states[numbers[-1]][1]
    quantity = "damage" if "damage" in fields else "principal_stretch"
    limits = (0.0, 1.0) if quantity == "damage" else (1.0, float(fields[quantity].max()))
    figure = states_figure(result, quantity, numbers[-1:], limits)
    figure.set_dpi(100)
    canvas, axis, frames = FigureCanvasAgg(figure), figure.axes[0], []
    drawn, outline, *_ = axis.collections
    for number in numbers:
        cells, moved = result.cells(number)
        drawn.set_verts(figures.polygons_of(cells, moved))
        drawn.set_array(result.states[number][1][quantity])
        outline.set_segments((cells.nodes + moved)[cells.outer_sides[0]])
        axis.title.set_text(title_of(result, number))
        canvas.draw()
        frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]))
    with replacing(path) as temporary:
        series = {
            "save_all": True,
            "append_images": frames[1:],
            "duration": 1000 // FRAMES_PER_SECOND,
            "loop": 0,
        }
        frames[0].save(temporary, format="GIF", comment=MARK, **series)


def html_page(result, fields: Sequence[str] = ()) -> str:
    """Return a page in HTML that shows a result: pictures of fields at the outputs, curves, tables,
    and versions of the software.

    Parameters
    ----------
    result : Result
    fields : sequence of str
        Fields as for `Result.plot`; by default displacement, von Mises stress, greatest principal
        stretch and damage, as far as the result has these fields.

    Raises
    ------
    ValueError
        If the result has no such field.
    """
    count = len(result.states)
    shown = np.unique(
        np.linspace(0, count - 1, min(MOST_OUTPUTS, count)).round().astype(int)
    ).tolist()
    chosen = list(fields) or (
        [name for name in USUAL if name in result.field_names()] if shown else []
    )
    pictures = {field: [] for field in chosen}
    for field, uris in pictures.items():
        for uri in _pictures(result, field, shown):
            uris.append(uri)
            event("drawing", sum(map(len, pictures.values())), len(chosen) * len(shown))
    titles, labels = (
        [title_of(result, number) for number in shown],
        {field: label_of(field, result.scene.units) for field in chosen},
    )
    curves = {
        "loading curve": loading_figure(result) if result.history else None,
        "energies": energies_figure(result),
    }
    history = result.history[:: max(1, -(-len(result.history) // MOST_ROWS))]
    return Template(PAGE.read_text("utf-8")).substitute(
        title=escape(f"{result.summary['scene']}, {result.summary['force']}"),
        options="".join(f"<option>{escape(field)}</option>" for field in chosen),
        last=max(len(shown) - 1, 0),
        hidden="" if shown and chosen else "hidden",
        left_out=f"<p>{len(shown)} of {count} outputs are shown.</p>" if len(shown) < count else "",
        curves="".join(
            f'<figure><img alt="{what}" src="{_uri(one)}"></figure>'
            for what, one in curves.items()
            if one is not None
        ),
        summary=facts(result),
        history=html_history(history, result.scene.units),
        scene=result.scene._repr_html_(),
        versions=_versions(result),
        data=json.dumps({"pictures": pictures, "titles": titles, "labels": labels}).replace(
            "</", "<\\/"
        ),
    )


def _pictures(result, field: str, shown: list[int]) -> Iterator[str]:
    """Yield, for each state number in `shown`, a picture colored by a field, as a data URI; all
    pictures have the same color scale.

    For a state without the field yield an empty text; raise ValueError if the last state in `shown`
    lacks the field.
    """
    values = {}
    for number in shown:
        try:
            values[number] = scalars_of(result.states[number][1], field)
        except ValueError:
            if number == shown[-1]:
                raise
    greatest = max((greatest_of(result.states[number][1], field) for number in values), default=0.0)
    limits = figures.limits_of(np.concatenate(list(values.values())), greatest) if values else None
    for number in shown:
        yield _uri(result.plot(field, number, limits)) if number in values else ""


def _uri(figure) -> str:
    """Return a figure as a data URI that holds a PNG picture."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=110)
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()


def _versions(result) -> str:
    origin = dict(result.summary.get("provenance", {}))
    machine, git = origin.pop("machine", {}), origin.pop("git", None)
    origin |= (
        {"commit": f"{git['commit']}{', changed since' if git['modified'] else ''}"} if git else {}
    )
    digests = {
        f"digest of {name}": digest for name, digest in result.summary.get("digests", {}).items()
    }
    return html_facts("Where it comes from", {**origin, **machine, **digests})
