"""The command that writes a scene to start from."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from typing import Annotated

from typer import Argument

from ..results.files import write_text
from ..scenes import load_scene
from .command import command
from .endings import writing
from .terminal import note


@command
def new(file: Annotated[Path, Argument(metavar="FILE.toml", help="Path of the scene file to create.")]) -> None:
    """Write a commented scene to start from."""
    if file.suffix != ".toml":
        raise ValueError(f"{file}: the file of a scene ends in .toml")
    if file.exists():
        raise ValueError(f"{file}: the file already exists; choose another name")
    name = re.sub(r"[^A-Za-z0-9 ._-]", "-", file.stem).lstrip(" ._-")[:64] or "scene"
    text = (resources.files(__package__) / "template.toml").read_text("utf-8")
    with writing(file):
        write_text(file, text.format(name=name, file=file))
    load_scene(file)
    note(f"Wrote {file}; look at it with: pdsurrogate scenes {file} --plot; run it with: pdsurrogate run {file} --out out")
