"""HTML page of a result, without links to the network: pictures of fields with a slider over the outputs, curves and tables."""

import base64
import io
import json
from collections.abc import Callable, Iterator, Sequence
from html import escape
from pathlib import Path
from string import Template

import numpy as np

from ..html_tables import html_facts
from . import drawings, figures
from .measures import scalars_of
from .result import Result
from .tables import html_history

PAGE = Path(__file__).with_name("page.html")
"""Template of the page."""

MOST_OUTPUTS = 40
"""Greatest number of states on a page; of a longer run they are spread evenly. Chosen: the page holds a picture of every state and field,
so that its size grows with both."""

MOST_ROWS = 200
"""Greatest number of rows of the history on a page; of more rows every second, third and so on is shown. Chosen: the table stays readable,
and the file of the history has all rows."""

USUAL = ("displacement", "von_mises", "principal_stretch", "damage")
"""Fields that a page shows by default, where the last state has them."""


def html_page(result: Result, fields: Sequence[str] = (), progress: Callable[[int, int], None] = lambda done, of: None) -> str:
    """Return a page in HTML that shows a result: pictures of fields over the outputs, curves, tables and versions.

    Parameters
    ----------
    result : Result
    fields : sequence of str
        Fields as for `Result.plot`; by default those of `USUAL`.
    progress : callable
        Function of the number of finished pictures and of their total number.

    Raises
    ------
    ValueError
        If the result has no such field.
    """
    count = len(result.states)
    shown = np.unique(np.linspace(0, count - 1, min(MOST_OUTPUTS, count)).round().astype(int)).tolist()
    chosen = list(fields) or ([name for name in USUAL if name in result.field_names()] if shown else [])
    pictures = {field: [] for field in chosen}
    for field, uris in pictures.items():
        for uri in _pictures(result, field, shown):
            uris.append(uri)
            progress(sum(map(len, pictures.values())), len(chosen) * len(shown))
    titles, labels = [result.title(number) for number in shown], {field: result.label(field) for field in chosen}
    curves = {
        "loading curve": result.loading_figure() if result.history else None,
        "energies": drawings.energies_figure(result),
    }
    history = result.history[:: max(1, -(-len(result.history) // MOST_ROWS))]
    return Template(PAGE.read_text("utf-8")).substitute(
        title=escape(f"{result.summary['scene']}, {result.summary['force']}"),
        options="".join(f"<option>{escape(field)}</option>" for field in chosen),
        last=max(len(shown) - 1, 0),
        hidden="" if shown and chosen else "hidden",
        left_out=f"<p>{len(shown)} of {count} outputs are shown.</p>" if len(shown) < count else "",
        curves="".join(f'<img alt="{what}" src="{_uri(figure)}">' for what, figure in curves.items() if figure is not None),
        summary=result.facts(),
        history=html_history(history, result.scene.units),
        scene=result.scene._repr_html_(),
        versions=_versions(result),
        data=json.dumps({"pictures": pictures, "titles": titles, "labels": labels}).replace("</", "<\\/"),
    )


def _pictures(result: Result, field: str, shown: list[int]) -> Iterator[str]:
    """Yield pictures of states of given numbers, coloured by a field to one scale, as data URIs; empty for a state without the field."""
    values = {}
    for number in shown:
        try:
            values[number] = scalars_of(result.states[number][1], field)
        except ValueError:
            if number == shown[-1]:
                raise
    limits = figures.limits_of(np.concatenate(list(values.values()))) if values else None
    for number in shown:
        yield _uri(result.plot(field, number, limits)) if number in values else ""


def _uri(figure) -> str:
    """Return a figure as a data URI that holds a PNG picture."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=110)
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()


def _versions(result: Result) -> str:
    origin = dict(result.summary.get("provenance", {}))
    machine, git = origin.pop("machine", {}), origin.pop("git", None)
    origin |= {"commit": f"{git['commit']}{', changed since' if git['modified'] else ''}"} if git else {}
    digests = {f"digest of {name}": digest for name, digest in result.summary.get("digests", {}).items()}
    return html_facts("Where it comes from", {**origin, **machine, **digests})
