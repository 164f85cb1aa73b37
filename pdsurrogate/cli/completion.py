"""Completion of names on the command line; shells call these functions through Typer, which keeps the names that begin as typed."""

import os
from glob import escape, glob

from typer import Context

import pdsurrogate as pds


def scenes(incomplete: str) -> list[str]:
    """Return the built-in scenes, and the scene files and folders that begin with a text."""
    found = [f"{path}/" if os.path.isdir(path) else path for path in glob(f"{escape(incomplete)}*")]
    return [*pds.scene_names(), *(path for path in found if path.endswith(("/", ".toml")))]


def forces() -> list[str]:
    """Return the exact force models, and the artifacts as NAME and as NAME@VERSION."""
    return [*pds.forces.FORCES, *artifacts()]


def artifacts() -> list[str]:
    """Return the artifacts that are found by name, as NAME and as NAME@VERSION."""
    found = pds.artifacts.list_artifacts()
    return sorted({*(folder.parent.name for folder in found), *(f"{folder.parent.name}@{folder.name}" for folder in found)})


def laws() -> list[str]:
    """Return the material laws."""
    return list(pds.materials.LAWS)


def fields(context: Context) -> list[str]:
    """Return the fields of the results in the folder that was typed before; none if there are no results."""
    try:
        # An option without its value ends the parsing, before the arguments get their names.
        return pds.load_result(context.params.get("folder") or context.args[0]).field_names()
    except (IndexError, ValueError, OSError):
        return []
