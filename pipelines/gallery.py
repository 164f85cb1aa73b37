"""Gallery of the built-in scenes: each is run, one after the other, and drawn.

python pipelines/gallery.py              all scenes, in minutes
python pipelines/gallery.py hole tear    these alone; --help names other uses

Pictures go to docs/figures/gallery, and the page to docs/gallery.md.
"""

import io
import time
from functools import partial

from cases import LISTED, Study, report
from pages import FIGURES
from PIL import Image

import pdsurrogate as pds
from pdsurrogate.results.files import replacing
from pdsurrogate.results.provenance import processor
from pdsurrogate.scenes import scene_names

COLORS = 96
"""Colors of a picture: its file is then a third as large, and no difference is seen."""

COARSER = {"penny": 0.1, "tear": 0.04}
"""Spacings at which scenes are drawn that take hours at their own."""

SHOWN = LISTED["gallery"]
"""What is to be seen in each scene, in one line."""


def drawn(name):
    """Run a scene and write its picture."""
    changes = [f"spacing={COARSER[name]:g}"] if name in COARSER else []
    scene, file, began = pds.load_scene(name, changes), io.BytesIO(), time.perf_counter()
    result = pds.simulate(scene)
    seconds = time.perf_counter() - began - result.summary["seconds_compile"]
    result.figure().savefig(file, format="png", dpi=120)
    with replacing(FIGURES / "gallery" / f"{name}.png") as temporary:
        picture = Image.open(file).convert("RGB").quantize(COLORS)
        picture.save(temporary, format="PNG", optimize=True)
    words = "".join(f" --set {change}" for change in changes)
    command = f"pdsurrogate run {name}{words} --out out/{name}"
    force, points = result.summary["force"], result.summary["n_points"]
    yield scene.title, command, force, points, round(seconds, 1), processor()


def page(figures):
    """Picture, command and time of every scene."""
    parts = []
    for name, ((title, command, force, points, seconds, machine),) in sorted(figures.items()):
        parts.append(
            f"## {name}\n\n{title}. {SHOWN[name]}\n\n![{title}](figures/gallery/{name}.png)\n\n"
            f"`{command}`: {points:,} points, force model `{force}`, computed in {seconds:g} s on"
            f" {machine}, without compilation."
        )
    return "\n\n".join(parts)


if __name__ == "__main__":
    cases = {name: partial(drawn, name) for name in scene_names()}
    report(__doc__, Study("gallery", cases, {"gallery": page}))
