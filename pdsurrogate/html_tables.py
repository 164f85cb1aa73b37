"""Small tables in HTML, for notebooks."""

from collections.abc import Iterable, Mapping
from html import escape
from typing import Any


def html_facts(title: str, facts: Mapping[str, Any]) -> str:
    """Return the HTML of a table with a title and a row for each name and value; text is
    escaped.
    """
    rows = "".join(
        f"<tr><th style='text-align:left'>{escape(str(key))}</th><td>{escape(str(value))}</td></tr>"
        for key, value in facts.items()
    )
    return f"<table><caption><b>{escape(title)}</b></caption>{rows}</table>"


def html_table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return the HTML of a table with a header and rows of cells; text is escaped."""
    head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
