"""Figures of what files of laboratories and mesh programs hold: curves of tests, measured fields,
meshes with their groups.
"""

from collections.abc import Mapping

import matplotlib
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ..body.cell_mesh import CellMesh, among
from ..measurements.field import MeasuredField
from . import figures

MOST_STEPS = 4
"""Greatest number of images whose displacements are drawn, evenly chosen with the last one."""

MOST_ARROWS = 400
"""Greatest number of arrows in a panel: more would cover each other."""

NO_GROUP = "#d9dde3"
"""Color of cells in no group."""


def tests_figure(
    curves: Mapping[str, Mapping[str, tuple[np.ndarray, np.ndarray]]], xlabel: str, ylabel: str
) -> Figure:
    """Return a figure of tests, (x, y) by branch and name of the test: a color for each test, a
    kind of line for each branch.
    """
    branches = list(dict.fromkeys(branch for test in curves.values() for branch in test))
    with matplotlib.rc_context(figures.STYLE):
        figure = Figure(figsize=(4.8, 3.6), layout="constrained")
        axis = figure.subplots()
        for number, (name, test) in enumerate(curves.items()):
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
    steps = steps[np.unique(np.linspace(0, len(steps) - 1, MOST_STEPS).round().astype(int))]
    size = np.linalg.norm(field.displacements, axis=1)
    limits = figures.limits_of(size[np.isin(field.step, steps)])
    with matplotlib.rc_context(figures.STYLE):
        figure = Figure(figsize=(2.6 * max(len(steps), 2), 3.2), layout="constrained")
        axes = figure.subplots(1, len(steps), squeeze=False, sharey=True)[0]
        for axis, step in zip(axes, steps, strict=True):
            rows = np.flatnonzero(field.step == step)
            x, y = field.places[rows, :2].T
            colors = axis.scatter(x, y, 4, size[rows], **figures.colors_of(limits))
            few = rows[:: -(-len(rows) // MOST_ARROWS)]
            arrows = {"angles": "xy", "width": 0.003, "color": "0.2"}
            axis.quiver(*field.places[few, :2].T, *field.displacements[few, :2].T, **arrows)
            axis.set(aspect="equal", title=f"image {step}", xlabel=f"x₁ ({field.unit})")
        axes[0].set_ylabel(f"x₂ ({field.unit})")
        figure.colorbar(colors, ax=axes, label=f"displacement ({field.unit})", aspect=30)
        return figure


def mesh_figure(
    cells: CellMesh,
    cell_groups: Mapping[str, np.ndarray],
    side_groups: Mapping[str, np.ndarray],
    title: str,
) -> Figure:
    """Return a figure of a mesh, of a solid from outside: its groups of cells (numbers of cells)
    and of sides (nodes) in colors, the later one where groups overlap.
    """
    palette = matplotlib.colormaps["tab10"]
    colors = np.tile(matplotlib.colors.to_rgba(NO_GROUP), (len(cells), 1))
    names = [*cell_groups, *side_groups]
    color_of = {name: palette(number % 10) for number, name in enumerate(names)}
    for name, members in cell_groups.items():
        colors[members] = color_of[name]
    with matplotlib.rc_context(figures.STYLE):
        figure = Figure(figsize=(7.6, 4.6), layout="constrained")
        if cells.dimension == 3:
            corners, owners = cells.outer_sides
            for name, members in side_groups.items():
                colors[owners[among(corners, members)]] = color_of[name]
            axes = figure.add_subplot(projection="3d", computed_zorder=False)
            box = np.array([cells.nodes.min(axis=0), cells.nodes.max(axis=0)])
            figures.draw_outside(axes, cells, cells.nodes, colors, box, figures.PLACES)
        else:
            axes = figure.subplots()
            polygons = figures.polygons_of(cells, np.zeros_like(cells.nodes))
            style = {"edgecolors": "white", "linewidths": 0.2}
            # The stub of PolyCollection leaves out that it takes one array of polygons.
            axes.add_collection(PolyCollection(polygons, facecolors=colors, **style))  # type: ignore[arg-type]
            axes.add_collection(
                LineCollection(cells.nodes[cells.outer_sides[0]], **figures.OUTLINE)
            )
            for name, members in side_groups.items():
                lines = LineCollection(cells.nodes[members], colors=[color_of[name]], linewidths=2)
                axes.add_collection(lines)
            axes.autoscale()
            axes.set(aspect="equal", xlabel=figures.PLACES[0], ylabel=figures.PLACES[1])
        axes.set_title(title)
        if names:
            handles = [Patch(color=color_of[name], label=name) for name in names]
            figure.legend(handles=handles, loc="outside right upper", frameon=False)
        return figure
