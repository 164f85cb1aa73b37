"""Commands ``materials``, ``artifacts``, ``scenes`` and ``new``, which list laws, artifacts and
scenes, and write a scene to start from.
"""

import json
import re
import sys
from importlib import resources
from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Argument, Option

from ..artifacts import ArtifactError, find_artifact, list_artifacts, load_card
from ..artifacts.store import called
from ..forces import FORCES
from ..materials import LAWS
from ..results.contents import leaves_of
from ..results.files import write_text
from ..scenes import load_scene, scene_names
from .command import SCENE_HELP, PictureFolder, SetScene, check_folder
from .terminal import note, print_json, print_rows, warn, writing


def materials() -> None:
    """Print a table of the laws and their parameters."""
    print_json(
        [
            {**law().describe(), "bounds": law.bounds, "source": law.reference}
            for law in LAWS.values()
        ]
    )
    rows = []
    for law in LAWS.values():
        default = law()
        for number, name in enumerate(law.defaults()):
            value = np.atleast_1d(getattr(default, name))
            low, high = law.bounds.get(name, (0, None))
            rows.append(
                {
                    "law": "" if number else law.name,
                    "parameter": name,
                    "default": ", ".join(f"{item:.4g}" for item in value),
                    "search range": f"{low:g} to {high:g}"
                    if high is not None
                    else "positive" * name.endswith("modulus"),
                    "source": "" if number else law.reference,
                }
            )
    print_rows("Laws and their parameters; set them with --set material.PARAMETER=VALUE", rows)


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
    known = []
    for folder in list_artifacts():
        try:
            card = load_card(folder)
        except ArtifactError as error:
            warn(f"{folder.parent.name}@{folder.name} cannot be used: {error}")
            continue
        known.append(
            {
                "name": folder.parent.name,
                "version": folder.name,
                "called": called(folder, card),
                "kind": card.kind,
                "law": card.material.law,
                "features": card.features["set"],
                "rms_error": card.errors["box"]["on_surface"]["rms"],
                "path": str(folder),
            }
        )
    exact = [
        {"name": name, "family": model().family, "plane": ", ".join(model().honors["plane"])}
        for name, model in FORCES.items()
    ]
    print_rows("Exact force models, which need no artifact", exact)
    shown = ("called", "law", "features", "rms_error")
    print_rows("Artifacts", [{key: row[key] for key in shown} for row in known])
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
        known = [
            {"name": one.name, "title": one.title, "dimension": one.dimension}
            for one in map(load_scene, scene_names())
        ]
        print_json(known)
        print_rows("Scenes", known)
        return
    scene = load_scene(name, change or [])
    given = scene.model_dump(mode="json", by_alias=True, exclude_defaults=True, exclude_none=True)
    print_json(given)
    rows = [
        {"key": key, "value": value if isinstance(value, str) else json.dumps(value)}
        for key, value in leaves_of(given).items()
    ]
    print_rows(f"Scene {scene.name}", rows)
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
