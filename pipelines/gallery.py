"""Gallery of the built-in scenes: each is run, one after the other, and drawn.

python pipelines/gallery.py                  all scenes as they are: hours, for tear and voids
python pipelines/gallery.py --points 4000    coarser where a scene has more points: minutes
python pipelines/gallery.py hole tear        these alone; the others keep their pictures and times

Pictures go to docs/figures/gallery, their commands and times to gallery.json there, and the page to
docs/gallery.md.
"""

import argparse
import io
import json
import time

from pages import DOCS, FIGURES
from PIL import Image
from rich.console import Console

import pdsurrogate as pds
from pdsurrogate.discretization import discretize
from pdsurrogate.results.files import replacing, write_json, write_text
from pdsurrogate.results.provenance import processor
from pdsurrogate.scenes import scene_names

console = Console()
FOLDER = FIGURES / "gallery"
TABLE = FOLDER / "gallery.json"

COLORS = 96
"""Colors of a picture: its file is then a third as large, and no difference is seen."""

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


def coarser(scene: pds.Scene, points: int | None) -> pds.Scene:
    """The scene, at the least multiple of its spacing that makes at most so many points and fits
    its body and regions.
    """
    if points is None or len(discretize(scene)[0]) <= points:
        return scene
    for factor in range(2, 40):
        try:
            found = pds.load_scene(scene.name, spacing=round(factor * scene.spacing, 12))
            if len(discretize(found)[0]) <= points:
                return found
        except pds.SceneError:
            continue
    raise ValueError(f"{scene.name} has no spacing with {points} points or fewer")


def draw(scene: pds.Scene, changed: bool) -> dict:
    """Run a scene, write its picture, and return its entry in the table."""
    began = time.perf_counter()
    result = pds.simulate(scene)
    seconds = time.perf_counter() - began
    file = io.BytesIO()
    result.figure().savefig(file, format="png", dpi=120)
    FOLDER.mkdir(exist_ok=True)
    with replacing(FOLDER / f"{scene.name}.png") as temporary:
        Image.open(file).convert("RGB").quantize(COLORS).save(
            temporary, format="PNG", optimize=True
        )
    command = (
        f"pdsurrogate run {scene.name}{f' --set spacing={scene.spacing:g}' if changed else ''}"
        f" --out out/{scene.name}"
    )
    return {
        "title": scene.title,
        "command": command,
        "force": result.summary["force"],
        "points": result.summary["n_points"],
        "seconds": round(seconds - result.summary["seconds_compile"], 1),
        "processor": processor(),
    }


def page(entries: dict[str, dict]) -> str:
    """The page of the gallery."""
    machine = ", ".join(sorted({entry["processor"] for entry in entries.values()}))
    lines = [
        "# Gallery",
        "",
        (
            "Every built-in scene, drawn as `pdsurrogate run` draws it: the command below each"
            " picture makes it. Scenes that take long are"
        ),
        (
            f"shown at a coarser spacing than their own. Times are those of the run on {machine},"
            " without compilation."
        ),
        "`python pipelines/gallery.py` makes all of it.",
    ]
    for name, entry in entries.items():
        size = (
            f"{entry['points']:,} points, force model `{entry['force']}`, computed in"
            f" {entry['seconds']:g} s"
        )
        picture = f"![{entry['title']}](figures/gallery/{name}.png)"
        lines += [
            "",
            f"## {name}",
            "",
            f"{entry['title']}. {SHOWN[name]}",
            "",
            picture,
            "",
            f"`{entry['command']}`: {size}.",
        ]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", help="scenes to run; all by default")
    parser.add_argument(
        "--points", type=int, help="most points of a scene; finer ones are made coarser"
    )
    arguments = parser.parse_args()
    entries = json.loads(TABLE.read_text("utf-8")) if TABLE.exists() else {}
    for name in arguments.scenes or scene_names():
        scene = pds.load_scene(name)
        chosen = coarser(scene, arguments.points)
        with console.status(f"{name}, spacing {chosen.spacing:g}"):
            entries[name] = draw(chosen, chosen is not scene)
        console.print(f"{name}: {entries[name]['points']:,} points, {entries[name]['seconds']:g} s")
        write_json(TABLE, dict(sorted(entries.items())))
    write_text(DOCS / "gallery.md", page(dict(sorted(entries.items()))))


if __name__ == "__main__":
    main()
