"""Page of HTML that shows a `Result` and needs no other file: a viewer of its fields, pictures
where a browser cannot run it, curves and tables.
"""

import base64
import hashlib
import io
import json
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import matplotlib
import numpy as np

from ..html_tables import html_facts
from ..progress import event
from .contents import leaves_of
from .drawings import (
    chosen_states,
    columns_figure,
    loading_figure,
    states_figure,
    title_of,
)
from .figures import DIVERGING, SEQUENTIAL
from .packing import Pieces, packed
from .tables import column_title, columns_of, facts, html_history, kind_of

PAGE = Path(__file__).with_name("page.html")
VIEWER = Path(__file__).parent / "viewer" / "viewer.js"
"""Template that `html_page` fills in, and the script of the viewer, which
docs/development/contributing.md says how to build.
"""

MOST_CHARACTERS = 9_900_000
"""Greatest length of a page: below 10 MB, which mail programs and browsers take."""

MOST_OUTPUTS = 40
"""Default number of states on a page; from a longer run, states are chosen evenly. Chosen: the page
holds every field in every state, so that its size grows with both.
"""

MOST_ROWS = {"table": 200, "curves": 2000}
"""Greatest number of rows of a run's history in the table and in the curves of a page; of a longer
one every second, third or further row is shown. Chosen: the table stays readable, and
``history.csv`` has all rows.
"""

USUAL = ("damage", "displacement", "von_mises", "principal_stretch")
"""Fields that a page shows first, as far as the last state has them."""

MAPS = (SEQUENTIAL, DIVERGING, "cividis", "inferno", "turbo", "gray")
"""Color maps of the viewer."""


def html_page(
    result,
    fields: Sequence[str] = (),
    most_outputs: int = MOST_OUTPUTS,
    measured: np.ndarray | None = None,
) -> str:
    """Return a page in HTML that shows a result: fields at the outputs in a viewer, pictures,
    curves, tables, and versions of the software.

    Parameters
    ----------
    result : Result
    fields : sequence of str
        Fields as for `Result.plot` that come first where not all have room, and of which the page
        has pictures; by default damage, displacement, von Mises stress and greatest principal
        stretch, as far as the result has these fields.
    most_outputs : int
        Greatest number of outputs in the viewer.
    measured : ndarray, shape (m, 1 + 2 d), optional
        Measured displacements: step (step k is the k-th output), undeformed places and
        displacements in the frame and the unit of the scene.

    Raises
    ------
    ValueError
        If the result has no such field.
    """
    known = result.field_names() if result.states else ()
    chosen = (list(fields) or [name for name in USUAL if name in known]) if known else []
    drawn = []
    for field in chosen:
        # A run in dynamics has fields that its states in equilibrium lack.
        base = field if field in known else field.rpartition("_")[0]
        numbers = [n for n in chosen_states(result) if base in result.states[n][1]]
        drawn.append(_figure(states_figure(result, field, numbers or [-1]), field))
        event("drawing", len(drawn), len(chosen))
    curves = [_figure(loading_figure(result), "loading")] if result.history else []
    if "energy" in map(kind_of, columns_of(result.history)):
        curves.append(_figure(columns_figure(result, "energy", "energy"), "energy"))
    origin = {key: result.summary.get(key, {}) for key in ("provenance", "digests")}
    script = VIEWER.read_text("utf-8")
    parts = {
        "title": escape(f"{result.summary['scene']}, {result.summary['force']}"),
        "about": escape(result.scene.title or ""),
        "drawn": "".join(drawn),
        "curves": "".join(curves),
        "summary": facts(result),
        "history": html_history(_thinned(result.history, "table"), result.scene.units),
        "scene": result.scene._repr_html_(),
        "versions": html_facts("Where it comes from", leaves_of(origin)),
        "viewer": script,
        "digest": base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    }
    data = {"name": result.scene.name, "maps": _maps(), "history": _history(result)}
    left = MOST_CHARACTERS - sum(map(len, parts.values())) - len(_json(data)) - 100_000
    bodies, shown, pieces, told = (
        packed(result, chosen, most_outputs, left, measured) if known else ({}, [], Pieces(), [])
    )
    moments = [result.states.moments[number] for number in shown]
    columns = ("stretch", "t", "time")
    data |= {
        "bodies": bodies,
        "pieces": pieces.listed,
        "length": result.scene.units.length or "",
        "outputs": [title_of(result, number) for number in shown],
        "numbers": shown,
        "axes": {
            column_title(key, result.scene.units): values
            for key in columns
            if any(values := [getattr(moment, key) for moment in moments])
        },
    }
    said = f"Left out, so that the page stays below 10 MB: {'; '.join(told)}."
    return Template(PAGE.read_text("utf-8")).substitute(
        parts,
        left_out=f"<p>{escape(said)}</p>" if told else "",
        data=_json(data),
    )


def _json(data: Any) -> str:
    """Return data as JSON within HTML, where no text of a user can end the element."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _thinned(rows: list[dict], where: str) -> list[dict]:
    return rows[:: max(1, -(-len(rows) // MOST_ROWS[where]))]


def _history(result) -> dict[str, list]:
    """Return the columns of the history by their headers, of six digits, null where a row has no
    number.
    """
    rows = _thinned(result.history, "curves")
    return {
        column_title(column, result.scene.units): [
            float(f"{row[column]:.6g}") if np.isfinite(row.get(column, np.nan)) else None
            for row in rows
        ]
        for column in columns_of(rows)
    }


def _maps() -> dict[str, str]:
    """Return the color maps by name as hexadecimal digits of 64 colors, red, green and blue."""
    shares = np.linspace(0, 1, 64)
    colors = {name: matplotlib.colormaps[name](shares, bytes=True)[:, :3] for name in MAPS}
    return {name: found.tobytes().hex() for name, found in colors.items()}


def _figure(figure, what: str) -> str:
    """Return an element with a figure as a PNG picture."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=110)
    uri = "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()
    return f'<figure><img alt="{escape(what)}" src="{uri}"></figure>'
