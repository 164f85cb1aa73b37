"""Figures of what files of laboratories and mesh programs hold: curves of tests, measured fields,
meshes with their groups.
"""

from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ..body.cell_mesh import CellMesh, among
from ..measurements.field import MeasuredField
from ..scenes.model import with_unit
from . import figures


def tests_figure(
    curves: Sequence[tuple[str, Mapping[str, tuple[np.ndarray, np.ndarray]]]],
    xlabel: str,
    ylabel: str,
) -> Figure:
    """Return a figure of tests, names with (x, y) by branch: a color for each test, a kind of line
    for each branch.
    """
    branches = list(dict.fromkeys(branch for _, test in curves for branch in test))
    with figures.styled(4.8, 3.6) as figure:
        axis = figure.subplots()
        for number, (name, test) in enumerate(curves):
            for branch, (x, y) in test.items():
                style = ("-", "--", ":", "-.")[branches.index(branch) % 4]
                label = f"{name}: {branch}" if len(curves) > 1 else branch
                axis.plot(x, y, style, marker=".", ms=3, color=f"C{number % 10}", label=label)
        axis.set(xlabel=xlabel, ylabel=ylabel)
        figure.legend(loc="outside upper center", ncols=2)
        return figure


def field_figure(field: MeasuredField) -> Figure:
    """Return a figure of the displacements of some images: arrows over the places, all points in
    the color of their size.
    """
    steps = np.unique(field.step)
    steps = steps[figures.spread(len(steps), 4)]
    size = np.linalg.norm(field.displacements, axis=1)
    limits = figures.limits_of(size[np.isin(field.step, steps)])
    x1, x2, label = (with_unit(what, field.unit) for what in (*figures.PLACES[:2], "displacement"))
    with figures.styled(2.6 * max(len(steps), 2), 3.2) as figure:
        axes = figure.subplots(1, len(steps), squeeze=False, sharey=True)[0]
        for axis, step in zip(axes, steps, strict=True):
            rows = np.flatnonzero(field.step == step)
            x, y = field.places[rows, :2].T
            colors = axis.scatter(x, y, 4, size[rows], **figures.colors_of(limits))
            # More arrows than 400 would cover each other.
            few = rows[:: -(-len(rows) // 400)]
            arrows = {"angles": "xy", "width": 0.003, "color": "0.2"}
            axis.quiver(*field.places[few, :2].T, *field.displacements[few, :2].T, **arrows)
            axis.set(aspect="equal", title=f"image {step}", xlabel=x1)
        axes[0].set_ylabel(x2)
        figure.colorbar(colors, ax=axes, label=label, aspect=30)
        return figure


def mesh_figure(
    cells: CellMesh,
    cell_groups: Mapping[str, np.ndarray],
    side_groups: Mapping[str, np.ndarray],
    title: str,
) -> Figure:
    """Return a figure of a mesh, of a solid from outside, with colors of its groups of cells
    (numbers of cells) and of sides (nodes); smaller groups cover greater ones.
    """
    by_size = [
        sorted((name for name in of if len(of[name])), key=lambda name: -len(of[name]))
        for of in (cell_groups, side_groups)
    ]
    names = by_size[0] + by_size[1]
    palette = matplotlib.colormaps["tab20" if len(names) > 10 else "tab10"]
    colors = np.array(
        [*(palette(k % palette.N) for k in range(len(names))), to_rgba(figures.PLAIN)]
    )
    shown = np.full(len(cells), len(names))
    for number, name in enumerate(by_size[0]):
        shown[cell_groups[name]] = number
    sides = list(enumerate(by_size[1], len(by_size[0])))
    with figures.styled(7.6, 4.6) as figure:
        if cells.dimension == 3:
            corners, owners = cells.outer_sides
            shown = shown[owners]
            for number, name in sides:
                shown[among(corners, side_groups[name])] = number
            axes = figure.add_subplot(projection="3d", computed_zorder=False)
            box = np.array([cells.nodes.min(axis=0), cells.nodes.max(axis=0)])
            figures.draw_outside(axes, cells, cells.nodes, colors[shown], box, figures.PLACES)
        else:
            axes = figure.subplots()
            figures.draw_mesh(axes, cells, colors[shown])
            for number, name in sides:
                lines = LineCollection(
                    cells.nodes[side_groups[name]], colors=colors[[number]], linewidths=2
                )
                axes.add_collection(lines)
                shown = np.append(shown, number)
            axes.autoscale()
            axes.set(aspect="equal", xlabel=figures.PLACES[0], ylabel=figures.PLACES[1])
        axes.set_title(title)
        handles = [
            Patch(color=colors[number], label=name)
            if number in shown
            else Patch(color="none", label=f"{name} (covered)")
            for number, name in enumerate(names)
        ]
        if handles:
            figure.legend(handles=handles, loc="outside right upper", frameon=False)
        return figure
