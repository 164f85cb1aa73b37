"""Contact with obstacles against finite elements and Hertz, and the picture of a seal for the
guide.

python pipelines/obstacles.py         measures all cases, in some minutes, and draws the picture
python pipelines/obstacles.py seal    the picture alone; --help names other uses

Finite elements of the block: FElupe 11.3, nine-node quadrilaterals in plane strain, displacements
only, half of the block by symmetry, uniform meshes of 28, 40 and 50 elements along each side of the
half; node-to-plane contact by a penalty of 1e5 kPa/cm (FElupe's `MultiPointContact`) of the top and
the free side with the plate, and of the free side with the plane of the bonded face; 120 increments
(60 on 40 elements). Neo-Hookean, mu = 1, K = 100, with the volumetric energy K/8 (J - 1/J)^2.
"""

import tomllib

import matplotlib
import numpy as np
from cases import Study, of_rows, percent, plane_strain_modulus, report, scene_of
from matplotlib.figure import Figure
from pages import DOCS, FIGURES
from tutorials import blocks_of

import pdsurrogate as pds
from pdsurrogate.results import figures

ELEMENTS = {28: (5.039552, 0.489409), 40: (5.037847, 0.489303), 50: (5.037239, 0.489266)}
"""Force of the plate at 30 %, and displacement of the upper corner, by the number of elements."""


def pressed_block(spacing):
    """Force of the plate, errors of it and of the contact width, and penetration."""
    force, corner = ELEMENTS[max(ELEMENTS)]
    result = pds.simulate(scene_of("pressed-block", {"spacing": spacing}), "bond-energy")
    level = result.levels[-1]
    found, contact = -level["forces"]["plate"][1], level["contact"]
    errors = percent(found, force), percent(contact["plate"]["area"], 2 + 2 * corner)
    depth = max(one["penetration"] for one in contact.values()) / spacing
    yield spacing, found, *errors, depth, result.summary["n_force_evaluations"]


def layer_factor(ratio):
    """Return the force on a bonded incompressible layer divided by that on a half space, for a
    contact radius over thickness `ratio`.

    Dimitriadis et al., Biophys. J. 82 (2002) 2798-2810, Eq. (13).
    """
    return 1 + 1.133 * ratio + 1.283 * ratio**2 + 0.769 * ratio**3 + 0.0975 * ratio**4


def indented(cells):
    """A ball on a quarter of a bonded layer four contact radii thick, with
    `cells` cells in the contact radius.
    """
    radius, depth, thickness = 5.0, 0.2, 4.0
    scene = scene_of("indented", {"spacing": 1 / cells})
    level = pds.simulate(scene, "bond-energy").levels[-1]
    modulus = plane_strain_modulus(1.0, 100.0)
    hertz, factor = (
        4 / 3 * modulus * np.sqrt(radius) * depth**1.5,
        layer_factor(np.sqrt(radius * depth) / thickness),
    )
    force, contact = -4 * level["forces"]["ball"][2], level["contact"]["ball"]
    area = 4 * contact["area"] / (np.pi * radius * depth)
    off, layer = contact["penetration"] * cells, hertz * factor
    yield cells, force, hertz, layer, percent(force, layer), area, off


def seal():
    """The picture of the seal of the guide, pressed by 15 and by 25 %, in colors of pressure."""
    guide = blocks_of((DOCS / "guide" / "loading.md").read_text("utf-8"))
    (text,) = (block.text for block in guide if 'name = "seal"' in block.text)
    scene = pds.Scene.model_validate(tomllib.loads(text))
    result = pds.simulate(scene, "bond-energy")
    with matplotlib.rc_context(figures.STYLE):
        figure = Figure(figsize=(6.4, 2.9), layout="constrained")
    limits = (0.0, float(np.percentile(result.field("pressure", -1), 99)))
    for axes, number in zip(figure.subplots(1, 2), (2, -1), strict=True):
        drawn = figures.draw_cells(
            axes, *result.cells(number), result.field("pressure", number), limits
        )
        top = 1 - 0.5 * result.levels[number]["t"]
        axes.plot([-1.1, -1.1, 1.1, 1.1], [1.05, -1, -1, 1.05], color="black", lw=2)
        axes.plot([-1.05, 1.05], [top, top], color="black", lw=4)
        axes.set(
            xlim=(-1.2, 1.2),
            ylim=(-1.1, 1.1),
            title=f"pressed by {100 * (1 - top) / 2:.0f} %",
            xlabel="x₁",
            ylabel="x₂",
        )
    figure.colorbar(drawn, ax=figure.axes, label="pressure")
    figures.save(figure, FIGURES / "guide" / "seal.png")
    yield scene.name, len(result.body)


if __name__ == "__main__":
    spacings, cells = (0.1, 0.05, 0.025), (2, 3, 4)
    report(
        __doc__,
        of_rows("pressed-block", pressed_block, spacings),
        of_rows("indented", indented, cells),
        Study("seal", {"": seal}, {}),
    )
