"""Commands ``materials``, ``artifacts``, ``scenes`` and ``new``, which list laws, artifacts and
scenes, and write a scene to start from.
"""

import json
import re
import sys
from collections.abc import Iterator
from dataclasses import fields
from importlib import resources
from pathlib import Path
from typing import Annotated

from rich.markup import escape
from typer import Argument, Option

from ..artifacts import ArtifactError, find_artifact, list_artifacts, load_card
from ..artifacts.store import called
from ..forces import FORCES
from ..materials import LAWS, Law
from ..results.contents import leaves_of
from ..results.files import write_text
from ..scenes import load_scene, scene_names
from .command import SCENE_HELP, PictureFolder, SetScene, check_folder
from .terminal import note, print_json, print_table, warn, writing


def materials() -> None:
    """Print a table of the laws and their parameters."""
    print_json(
        [
            {**law().describe(), "bounds": law.bounds, "source": law.reference}
            for law in LAWS.values()
        ]
    )
    columns = ("law", "parameter", "default", "search range", "source")
    rows = (row for law in LAWS.values() for row in _rows_of_law(law))
    print_table(
        "Laws and their parameters; set them with --set material.PARAMETER=VALUE", columns, rows
    )


def _rows_of_law(law: type[Law]) -> Iterator[tuple[str, ...] | None]:
    """Yield a table row for each parameter of a material law, and None, which draws a line,
    after the last row.
    """
    default = law()
    for number, field in enumerate(fields(law)):
        value = getattr(default, field.name)
        shown = (
            ", ".join(f"{item:.4g}" for item in value) if isinstance(value, tuple) else f"{value:g}"
        )
        low, high = law.bounds.get(field.name, (0, None))
        bounds = (
            f"{low:g} to {high:g}"
            if high is not None
            else "positive"
            if field.name.endswith("modulus")
            else ""
        )
        yield "" if number else law.name, field.name, shown, bounds, "" if number else law.reference
    yield None


CARD = "Artifact whose card is printed as JSON: NAME, NAME@VERSION or a path (default: list all)."


def artifacts(
    reference: Annotated[str | None, Argument(metavar="REF", help=CARD)] = None,
) -> None:
    """Print tables of the exact force models and the artifacts, or the card of an artifact as
    JSON.
    """
    if reference is not None:
        find_artifact(reference, ())
        sys.stdout.write(load_card(reference).to_json())
        return
    known, rows = [], {}
    for folder in list_artifacts():
        name, version = folder.parent.name, folder.name
        try:
            card = load_card(folder)
        except ArtifactError as error:
            warn(f"{name}@{version} cannot be used: {error}")
            continue
        shown, law = called(folder, card), card.material.law
        known.append(
            {
                "name": name,
                "version": version,
                "called": shown,
                "kind": card.kind,
                "law": law,
                "path": str(folder),
            }
        )
        row = (
            escape(shown),
            law,
            card.features["set"],
            f"{card.errors['box']['on_surface']['rms']:.1e}",
        )
        rows.setdefault(folder.parent.parent, []).append(row)
    exact = (
        (name, model().family, ", ".join(model().honors["plane"])) for name, model in FORCES.items()
    )
    print_table("Exact force models, which need no artifact", ("name", "family", "plane"), exact)
    for root, found in rows.items():
        print_table(f"Artifacts in {root}", ("artifact", "law", "features", "RMS error"), found)
    print_json(known)


def scenes(
    name: Annotated[
        str | None, Argument(metavar="SCENE", help=f"{SCENE_HELP} (default: all).")
    ] = None,
    plot: Annotated[
        bool,
        Option(
            "--plot",
            help="Plot the scene with its regions, grips, loads and probes, without running it.",
        ),
    ] = False,
    change: SetScene = None,
    pictures: PictureFolder = None,
) -> None:
    """Print a table of the built-in scenes, or of the keys of one, and write its picture if
    asked.
    """
    if pictures is not None and not plot:
        raise ValueError("--out is the folder for the picture that --plot draws: add --plot")
    if name is None:
        if plot or change:
            raise ValueError(
                f"{'--plot' if plot else '--set'} needs a scene: pdsurrogate scenes SCENE --plot"
            )
        known = [load_scene(one) for one in scene_names()]
        print_json(
            [{"name": one.name, "dimension": one.dimension, "title": one.title} for one in known]
        )
        rows = ((one.name, "solid" if one.dimension == 3 else "sheet", one.title) for one in known)
        print_table("Scenes", ("scene", "body", "title"), rows)
        return
    scene = load_scene(name, change or [])
    given = scene.model_dump(mode="json", by_alias=True, exclude_defaults=True, exclude_none=True)
    print_json(given)
    rows = (
        (key, escape(value if isinstance(value, str) else json.dumps(value)))
        for key, value in leaves_of(given).items()
    )
    print_table(f"Scene {scene.name}", ("key", "value"), rows, show_header=False)
    if plot:
        # Imported here, since only pictures need matplotlib.
        from ..results import figures
        from ..run.preview import preview

        pictures = pictures or Path()
        path = pictures / f"{scene.name}-scene.png"
        check_folder(pictures)
        figure = preview(scene)
        with writing(pictures):
            figures.save(figure, path)
        note(f"Wrote {path}")


def new(
    file: Annotated[Path, Argument(metavar="FILE.toml", help="Path of the scene file to create.")],
) -> None:
    """Write the template of a scene to a new file."""
    if file.suffix != ".toml":
        raise ValueError(f"{file}: the name of a scene file ends in .toml; write {file}.toml")
    if file.exists():
        raise ValueError(f"{file}: the file already exists; choose another name")
    name = re.sub(r"[^A-Za-z0-9 ._-]", "-", file.stem).lstrip(" ._-")[:64] or "scene"
    text = (resources.files(__package__) / "template.toml").read_text("utf-8")
    with writing(file):
        write_text(file, text.format(name=name, file=file))
    load_scene(file)
    print_json({"name": name, "path": str(file)})
    note(
        f"Wrote {file}; plot it with: pdsurrogate scenes {file} --plot; run it with: pdsurrogate"
        f" run {file} --out out"
    )
