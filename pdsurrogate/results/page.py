"""One page of HTML that holds all of a result: pictures of fields with a slider over the outputs, curves, tables; nothing is fetched."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable, Sequence
from html import escape

import numpy as np

from ..html_tables import html_facts, html_table
from ..scenes import Units
from . import figures
from .result import Result, column_title, scalars_of

MOST_OUTPUTS = 40
"""States that a page shows; of more, as many evenly over the run."""

MOST_ROWS = 200
"""Rows of the history that a page shows."""

USUAL = ("displacement", "von_mises", "principal_stretch", "damage")


def fields_to_show(result: Result) -> list[str]:
    """Return the fields that are shown by default: those of `USUAL` that the last state has."""
    return [name for name in USUAL if name in result.field_names()]


def html_page(result: Result, fields: Sequence[str] = (), progress: Callable[[int, int], None] = lambda done, of: None) -> str:
    """The page of a result.

    Parameters
    ----------
    result : Result
    fields : sequence of str
        As for `Result.plot`; by default `USUAL` ones.
    progress : callable
        Is told how many pictures are drawn, and how many there will be.

    Raises
    ------
    ValueError
        If a field is not there.
    """
    name = result.summary["scene"]
    shown = sorted(set(np.linspace(0, len(result.states) - 1, min(MOST_OUTPUTS, len(result.states))).round().astype(int).tolist()))
    chosen = list(fields) or (fields_to_show(result) if shown else [])
    pictures, count = {}, 0
    for field in chosen:
        limits = _common_limits(result, field, shown)
        pictures[field] = []
        for number in shown:
            pictures[field].append(_picture(result, field, number, limits) if limits is not None else "")
            count += 1
            progress(count, len(chosen) * len(shown))
    titles = [result.title(number) for number in shown]
    data = json.dumps({"pictures": pictures, "titles": titles, "labels": {field: result.label(field) for field in chosen}})
    options = "".join(f"<option>{escape(field)}</option>" for field in chosen)
    curves = [_as_image(result.loading_figure(), "loading curve")] if result.history else []
    energies = figures.energies_figure(*_energies(result))
    curves += [_as_image(energies, "energies")] if energies is not None else []
    left_out = f"<p>{len(shown)} of {len(result.states)} outputs are shown.</p>" if len(shown) < len(result.states) else ""
    return _PAGE.format(
        title=escape(f"{name}, {result.summary['force']}"),
        options=options,
        last=max(len(shown) - 1, 0),
        hidden="" if shown and chosen else "hidden",
        left_out=left_out,
        curves="".join(curves),
        summary=_summary(result),
        history=_history(result),
        scene=result.scene._repr_html_(),
        versions=_versions(result),
        data=data.replace("</", "<\\/"),
    )


def _common_limits(result: Result, field: str, shown: list[int]) -> tuple[float, float] | None:
    """Ends of one scale of colours for all states; None where the field appears in none of them."""
    found = []
    for number in shown:
        try:
            found.append(scalars_of(result.states[number][1], field))
        except ValueError:
            if number == shown[-1]:
                raise
    return figures.limits_of(np.concatenate(found))


def _picture(result: Result, field: str, number: int, limits: tuple[float, float]) -> str:
    """A picture of a state as a data URI; empty where it does not have the field."""
    try:
        result.field(field, number)
    except ValueError:
        return ""
    return _uri(_png(result.plot(field, number, limits)))


def _png(figure) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=110)
    return file.getvalue()


def _uri(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode()


def _as_image(figure, what: str) -> str:
    return f'<img alt="{what}" src="{_uri(_png(figure))}">'


def _energies(result: Result) -> tuple[str, list[float], dict[str, list[float]], Units]:
    """Loading parameter or time, and the energies of the history by their names."""
    rows = [row for row in result.history if "strain_energy" in row]
    timed = [row for row in rows if "time" in row]
    rows, key = (timed, "time") if timed else (rows, "stretch" if result.scene.stretched else "t")
    names = [column for column in dict.fromkeys(key for row in rows for key in row) if column == "work" or column.endswith("_energy")]
    label = column_title(key, result.scene.units)
    energies = {name: [row.get(name, 0.0) for row in rows] for name in names}
    return label, [row[key] for row in rows], energies, result.scene.units


def _summary(result: Result) -> str:
    summary = result.summary
    facts = {
        "force": summary["force"],
        "material": ", ".join(f"{key} {value}" for key, value in summary["material"].items()),
        "points, bonds": f"{summary['n_points']:,}, {summary['n_bonds']:,}",
        "spacing, horizon": f"{summary['spacing']:g}, {result.scene.units.amount(summary['horizon'], 'length', 'g')}",
        "evaluations": f"{summary['n_force_evaluations']:,}",
        "ended": "as asked" if summary["converged"] else summary["failure"],
    }
    return html_facts("Run", facts)


def _history(result: Result) -> str:
    rows = result.history[:: max(1, -(-len(result.history) // MOST_ROWS))]
    if not rows:
        return ""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    header = [column_title(column, result.scene.units) for column in columns]
    return html_table(header, [[f"{row[column]:.5g}" if column in row else "" for column in columns] for row in rows])


def _versions(result: Result) -> str:
    origin = dict(result.summary.get("provenance", {}))
    machine = origin.pop("machine", {})
    git = origin.pop("git", None)
    origin |= {"commit": f"{git['commit']}{', changed since' if git['modified'] else ''}"} if git else {}
    digests = {f"digest of {name}": digest for name, digest in result.summary.get("digests", {}).items()}
    return html_facts("Where it comes from", {**origin, **machine, **digests})


_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="generator" content="pdsurrogate show">
<meta name="viewport" content="width=device-width">
<title>{title}</title>
<style>
body {{ font: 15px/1.45 system-ui, sans-serif; margin: 1.5rem auto; max-width: 72rem; padding: 0 1rem; color: #222; }}
h1 {{ font-size: 1.4rem; }} h2 {{ font-size: 1.1rem; margin-top: 2rem; }}
.frame {{ height: 60vh; display: flex; align-items: center; justify-content: center; border: 1px solid #ddd; }}
.frame img {{ max-width: 100%; max-height: 100%; }}
.controls {{ display: flex; gap: 1rem; align-items: center; margin: .6rem 0; }} .controls input {{ flex: 1; }}
.curves img {{ max-width: 48%; }}
table {{ border-collapse: collapse; margin: .5rem 0; font-size: .85rem; }} caption {{ text-align: left; }}
td, th {{ border: 1px solid #ddd; padding: .15rem .45rem; }} .wide {{ overflow: auto; max-height: 24rem; }}
</style>
</head>
<body>
<h1>{title}</h1>
<section {hidden}>
<div class="controls"><select id="field">{options}</select><input id="output" type="range" min="0" max="{last}" value="{last}">
<output id="title"></output></div>
<div class="frame"><img id="picture" alt="field"></div>
{left_out}
</section>
<h2>Curves</h2>
<div class="curves">{curves}</div>
<h2>Run</h2>
{summary}
<h2>History</h2>
<div class="wide">{history}</div>
<h2>Scene</h2>
{scene}
<h2>Versions</h2>
{versions}
<script type="application/json" id="data">{data}</script>
<script>
const data = JSON.parse(document.getElementById("data").textContent);
const field = document.getElementById("field"), output = document.getElementById("output");
const picture = document.getElementById("picture"), title = document.getElementById("title");
function show() {{
  const states = data.pictures[field.value];
  if (!states) return;
  picture.src = states[output.value];
  picture.alt = data.labels[field.value];
  title.textContent = data.titles[output.value];
}}
field.addEventListener("change", show);
output.addEventListener("input", show);
show();
</script>
</body>
</html>
"""
