"""The command that lists the laws."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

from ..materials import LAWS, Law
from .command import AsJson, command
from .terminal import print_json, print_table


@command
def materials(as_json: AsJson = False) -> None:
    """List the material laws with their parameters."""
    if as_json:
        print_json([{**law().describe(), "bounds": law.bounds, "source": law.reference} for law in LAWS.values()])
    columns = ("law", "parameter", "default", "bounds in identification", "source")
    rows = (row for law in LAWS.values() for row in _rows_of(law))
    print_table("Laws; every parameter is set by --set material.NAME=VALUE", columns, rows)


def _rows_of(law: type[Law]) -> Iterator[tuple[str, ...] | None]:
    """Yield a row for each parameter of a law, and None after the last one."""
    default = law()
    for number, field in enumerate(fields(law)):
        value = getattr(default, field.name)
        shown = ", ".join(f"{item:.4g}" for item in value) if isinstance(value, tuple) else f"{value:g}"
        low, high = law.bounds.get(field.name, (0, None))
        bounds = f"{low:g} to {high:g}" if high is not None else "positive" if field.name.endswith("modulus") else ""
        yield "" if number else law.name, field.name, shown, bounds, "" if number else law.reference
    yield None
