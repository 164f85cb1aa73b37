"""The command that lists artefacts."""

from __future__ import annotations

import sys
from typing import Annotated

from rich.markup import escape
from typer import Argument

from ..artifacts import ArtifactError, called, list_artifacts, load_card
from .command import AsJson, command
from .terminal import print_json, print_table


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
