"""The commands that list laws and artefacts."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import fields
from typing import Annotated

from rich.markup import escape
from typer import Argument

from ..artifacts import ArtifactError, called, list_artifacts, load_card
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


@command
def artifacts(
    reference: Annotated[str | None, Argument(metavar="[REF]", help="Artefact whose card is shown.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the artefacts that are found by name, or show one's card."""
    if reference is not None:
        sys.stdout.write(load_card(reference).to_json())
        return
    known, rows = [], []
    for folder in list_artifacts():
        name, version = folder.parent.name, folder.name
        try:
            card = load_card(folder)
        except ArtifactError as error:
            rows.append((f"{name}@{version}", f"[red]{escape(str(error))}[/]", "", "", str(folder)))
            continue
        shown, law = called(folder, card), card.material.law
        known.append({"name": name, "version": version, "called": shown, "kind": card.kind, "law": law, "path": str(folder)})
        rows.append((escape(shown), law, card.features["set"], f"{card.errors['box']['on_surface']['rms']:.1e}", str(folder)))
    folds = ("artefact", "law", "features", "where")
    print_table("Artefacts", ("artefact", "law", "features", "RMS error", "where"), rows, folds=folds)
    if as_json:
        print_json(known)
