"""Gallery of the built-in scenes: each is run, one after the other, and drawn.

python pipelines/gallery.py              all scenes, in minutes
python pipelines/gallery.py hole tear    these alone; --help names other uses

Pictures go to docs/figures/gallery, and the page to docs/gallery.md.
"""

import io
import time
from functools import partial

from cases import Study, report
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

SHOWN = {
    "biaxial-hole": (
        "A sheet is stretched in both directions, then released in one: rollers let its edges"
        " slide, and the hole follows."
    ),
    "bimaterial": (
        "Two rubbers in series, bonded: the stiffer half stretches less, and the free edges step at"
        " the interface."
    ),
    "bonded-block": (
        "A nearly incompressible cube between bonded plates necks: a test of volumetric locking."
    ),
    "disc-torsion": "The rim is held while the boundary of the hole turns by 45 degrees.",
    "gent": (
        "Uniaxial tension of a law with limiting chain extensibility: section 6.7 of the paper."
    ),
    "hanging": "A strip stretches under its own weight, most at its upper end.",
    "hole": "A sheet with a hole is pulled between clamps: section 6.4 of the paper.",
    "inflation": (
        "An eighth of a thick sphere between planes of symmetry; the inner pressure follows the"
        " moving surface."
    ),
    "load-cycle": "Tension, compression and back: without fracture the body ends as it began.",
    "penny": (
        "A cylinder with a disc crack inside is pulled by 1 %: the opening is known from Sneddon."
    ),
    "plane-strain-block": "A wide block between bonded plates in plane strain, pushed and pulled.",
    "pure-shear": "A wide, low sheet between glued grips: section 6.3 of the paper.",
    "ring-pressure": (
        "Pressure inflates a ring from within: exact by the radial equation of equilibrium."
    ),
    "rotation": "Two edges turn a block by a right angle: nothing in it is strained.",
    "simple-shear": "One plate slides over the other at a fixed distance.",
    "tear": (
        "A precut sheet is stretched until its bonds break, and a crack runs: section 6.5 of the"
        " paper."
    ),
    "torsion": "One plate turns a bonded cube by 60 degrees, in three dimensions.",
    "traction": "A cantilever bends under a dead load on its end.",
    "trousers": (
        "The tear test of the rubber laboratory: two legs are pulled apart out of the plane."
    ),
    "uniaxial": (
        "Tension between rollers: the exact solution is homogeneous, section 6.2 of the paper."
    ),
    "voids": (
        "Cracks run from two precuts to the holes, and between them: section 6.6 of the paper."
    ),
    "zero-energy": (
        "Single columns of points are held, which excites zero-energy modes in models that have"
        " them: section 3 of the paper."
    ),
}
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
