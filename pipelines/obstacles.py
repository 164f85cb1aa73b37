"""Contact with obstacles against finite elements and Hertz, and the picture of a seal for the
guide.

python pipelines/obstacles.py            prints both tables, in some minutes, and draws the picture
python pipelines/obstacles.py --docs     and puts them into docs/validation/obstacles.md

Finite elements of the block: FElupe 11.3, nine-node quadrilaterals in plane strain, displacements
only, half of the block by symmetry, uniform meshes of 28, 40 and 50 elements along each side of the
half; node-to-plane contact by a penalty of 1e5 kPa/cm (FElupe's `MultiPointContact`) of the top and
the free side with the plate, and of the free side with the plane of the bonded face; 120 increments
(60 on 40 elements). Neo-Hookean, mu = 1, K = 100, with the volumetric energy K/8 (J - 1/J)^2.
"""

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from pages import FIGURES, markdown_table, report

import pdsurrogate as pds
from pdsurrogate.results import figures

ELEMENTS = {28: (5.039552, 0.489409), 40: (5.037847, 0.489303), 50: (5.037239, 0.489266)}
"""Force of the plate at 30 %, and displacement of the upper corner, by the number of elements."""

RUBBER = {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 100.0}


def block(spacing: float) -> pds.Scene:
    """A block of 2 x 1, bonded below, pressed by a flat plate by 30 %; its sides may roll over
    both planes.
    """
    return pds.Scene(
        name="pressed-block",
        spacing=spacing,
        plane="strain",
        horizon_ratio=1.75,
        body=pds.shapes.Rectangle(size=(2.0, 1.0)),
        material=RUBBER,
        prescribed=(pds.Prescribed(region="bottom", x1=0.0, x2=0.0),),
        obstacles=(
            pds.Obstacle(
                half_plane={"point": (0.0, 1.0), "normal": (0.0, 1.0)}, x2=-0.3, name="plate"
            ),
            pds.Obstacle(half_plane={"point": (0.0, 0.0), "normal": (0.0, -1.0)}, name="base"),
        ),
        steps=(pds.Step(to=1.0, outputs=3),),
    )


def pressed_block(spacings: tuple[float, ...] = (0.1, 0.05, 0.025)) -> list[list[str]]:
    """Rows of the table of the block: error of the force, contact width and penetration by
    spacing.
    """
    (force, corner), rows = ELEMENTS[max(ELEMENTS)], []
    for spacing in spacings:
        result = pds.simulate(block(spacing), "bond-energy")
        level = result.levels[-1]
        found, contact = -level["forces"]["plate"][1], level["contact"]
        width = contact["plate"]["area"]
        depth = max(one["penetration"] for one in contact.values()) / spacing
        errors = [
            f"{100 * (found / force - 1):+.2f}",
            f"{100 * (width / (2 + 2 * corner) - 1):+.2f}",
        ]
        rows.append(
            [
                f"{spacing:g}",
                f"{found:.4f}",
                *errors,
                f"{depth:.1e}",
                f"{result.summary['n_force_evaluations']}",
            ]
        )
        print(rows[-1], flush=True)
    return rows


def layer_factor(ratio: float) -> float:
    """Return the force on a bonded incompressible layer divided by that on a half space, for a
    contact radius over thickness `ratio`.

    Dimitriadis et al., Biophys. J. 82 (2002) 2798-2810, Eq. (13).
    """
    return 1 + 1.133 * ratio + 1.283 * ratio**2 + 0.769 * ratio**3 + 0.0975 * ratio**4


def indented(cells: int) -> list[str]:
    """Row of the table of the ball: a quarter of a bonded layer four contact radii thick, with
    `cells` cells in the contact radius.
    """
    radius, depth, thickness = 5.0, 0.2, 4.0
    held = {"back": {"x1": 0.0, "x2": 0.0, "x3": 0.0}, "left": {"x1": 0.0}, "bottom": {"x2": 0.0}}
    scene = pds.Scene(
        name="indented",
        spacing=1 / cells,
        body=pds.shapes.Box(size=(8.0, 8.0, thickness)),
        material=RUBBER,
        prescribed=tuple(
            pds.Prescribed(region=region, **components) for region, components in held.items()
        ),
        obstacles=(
            pds.Obstacle(
                ball={"center": (0.0, 0.0, thickness + radius), "radius": radius},
                x3=-depth,
                name="ball",
            ),
        ),
        steps=(1.0,),
    )
    level = pds.simulate(scene, "bond-energy").levels[-1]
    mu, K = RUBBER["shear_modulus"], RUBBER["bulk_modulus"]
    young, poisson = 9 * K * mu / (3 * K + mu), (3 * K - 2 * mu) / (2 * (3 * K + mu))
    hertz, factor = (
        4 / 3 * young / (1 - poisson**2) * np.sqrt(radius) * depth**1.5,
        layer_factor(np.sqrt(radius * depth) / thickness),
    )
    force, contact = -4 * level["forces"]["ball"][2], level["contact"]["ball"]
    errors = [
        f"{100 * (force / (hertz * factor) - 1):+.1f}",
        f"{4 * contact['area'] / (np.pi * radius * depth):.2f}",
    ]
    row = [
        str(cells),
        f"{force:.4f}",
        f"{hertz:.4f}",
        f"{hertz * factor:.4f}",
        *errors,
        f"{contact['penetration'] * cells:.1e}",
    ]
    print(row, flush=True)
    return row


SEAL = pds.Scene(
    name="seal",
    spacing=0.08,
    plane="strain",
    body=pds.shapes.Circle(radius=1.0, center=(0.0, 0.0)),
    material=RUBBER,
    obstacles=(
        pds.Obstacle(
            half_plane={"point": (0.0, 1.0), "normal": (0.0, 1.0)}, x2=-0.5, name="flange"
        ),
        pds.Obstacle(half_plane={"point": (0.0, -1.0), "normal": (0.0, -1.0)}, name="floor"),
        pds.Obstacle(half_plane={"point": (-1.1, 0.0), "normal": (-1.0, 0.0)}, name="left"),
        pds.Obstacle(half_plane={"point": (1.1, 0.0), "normal": (1.0, 0.0)}, name="right"),
    ),
    prescribed=(
        pds.Prescribed(region={"near": (0.0, 0.0)}, x1=0.0, x2=-0.25, name="middle"),
        pds.Prescribed(region={"near": (0.0, 0.5)}, x1=0.0, name="upright"),
        pds.Prescribed(region={"near": (0.0, -0.5)}, x1=0.0, name="lower"),
    ),
    steps=(pds.Step(to=1.0, outputs=5),),
)


def seal() -> Figure:
    """The seal of the guide, pressed by 15 and by 25 %, in colors of the pressure."""
    result = pds.simulate(SEAL, "bond-energy")
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
    return figure


def of_block() -> str:
    """The table of the block."""
    head = [
        "spacing",
        "force",
        "error of the force (%)",
        "error of the contact width (%)",
        "penetration / spacing",
        "evaluations",
    ]
    return markdown_table(head, pressed_block())


def of_ball() -> str:
    """The table of the ball, and the picture of the seal."""
    with matplotlib.rc_context(figures.STYLE):
        figures.save(seal(), FIGURES / "guide" / "seal.png")
    head = [
        "cells in the radius of contact",
        "force",
        "Hertz",
        "Hertz, layer",
        "error (%)",
        "area / Hertz's",
        "penetration / spacing",
    ]
    return markdown_table(head, [indented(cells) for cells in (2, 3, 4)])


if __name__ == "__main__":
    report(__doc__, {"pressed-block": of_block, "indented": of_ball})
