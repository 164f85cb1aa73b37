"""Scenes and parts of scenes that tests run, by name: those of `data/scenes.toml`."""

import tomllib
from pathlib import Path

SCENES = tomllib.loads((Path(__file__).parent / "data" / "scenes.toml").read_text("utf-8"))
