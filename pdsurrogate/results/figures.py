"""Figures of deformed bodies, in the plane or from outside and cut through the middle, and of curves."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import LightSource, Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from ..body.cell_mesh import FACES, CellMesh
from .files import MARK, replacing

Moved = list[tuple[CellMesh, np.ndarray]]
"""One entry for each state: the cells of the body, and the displacements of their nodes, shape (k, d)."""

Limits = tuple[float, float]
"""Values at the ends of a scale of colors."""

STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "figure.dpi": 150,
    "savefig.bbox": "tight",
}
"""Settings of Matplotlib for all figures: letters of 9 points, as in print at the width of a page, and no frame where there is no axis."""

INCHES_OF_A_LETTER = 0.6 * STYLE["font.size"] / 72
"""Mean width of a letter in inches: 0.6 of the font size in `STYLE`."""

ONE_COLOR = 1e-4
"""Least range of a scale of colors, divided by the greatest absolute value on it: a field that varies by much less, as by residuals
of a solver (some 1e-6), has one color."""

MOST_TICKS = 6
"""Greatest number of intervals between ticks on the horizontal axis of curves: with more, their numbers would run into each other."""

MOST_MARKED = 30
"""Number of points of a curve below which every point is marked: more marks would run into each other."""


ELEVATION, AZIMUTH = 22.0, -58.0
"""Direction of view in degrees: from the front right, a little above; x3 points up."""

_UP, _ROUND = np.radians([ELEVATION, AZIMUTH])
EYE = np.array([np.cos(_UP) * np.cos(_ROUND), np.cos(_UP) * np.sin(_ROUND), np.sin(_UP)])
"""Unit vector from a solid to the viewer, by `ELEVATION` and `AZIMUTH`."""


def save(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG file, whole or not at all; `MARK` in the PNG metadata identifies the file as written by this package."""
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", metadata={"Software": MARK})


def polygons_of(cells: CellMesh, displacement: np.ndarray) -> np.ndarray:
    """Return the corners of cells in the plane after a displacement of the nodes (k, 2), shape (n, 4, 2); triangles repeat the last."""
    places = cells.nodes + displacement
    return np.concatenate([places[block[:, [0, 1, 2, 3] if block.shape[1] == 4 else [0, 1, 2, 2]]] for block in cells.blocks])


def limits_of(values: np.ndarray) -> Limits:
    """Return the ends of a color scale: the least and the greatest value, or a wider range (`ONE_COLOR`) if the values hardly differ.

    A field that varies only by a solver's residuals thus has a uniform color.
    """
    low, high = float(values.min()), float(values.max())
    return low, low + max(high - low, ONE_COLOR * max(abs(low), abs(high), 1e-300))


def draw_cells(axis, cells: np.ndarray, values: np.ndarray, **limits):
    """Draw deformed cells, shape (n, 4, 2), in colors of their values; fit the axis to the cells and return the drawn collection.

    The keyword arguments `limits` set the color scale and are passed to Matplotlib's PolyCollection, for example ``clim``.
    """
    drawn = PolyCollection(cells, array=values, cmap="turbo", edgecolors="none", linewidths=0, antialiased=False, rasterized=True, **limits)
    axis.add_collection(drawn)
    low, high = cells.min(axis=(0, 1)), cells.max(axis=(0, 1))
    axis.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axis.set_axis_off()
    return drawn


def curves_figure(
    x: list[float], curves: dict[str, list[float]], xlabel: str, ylabel: str, references: Sequence[tuple[float, float]] = ()
) -> Figure:
    """Return a figure of named curves over the common abscissae `x`, with reference values (x, y) as circles."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(4.8, 3.2), layout="constrained")
        axis = figure.subplots()
        for name, values in curves.items():
            axis.plot(x, values, ".-" if len(x) < MOST_MARKED else "-", lw=1.2, ms=4, label=name)
        if references:
            axis.plot(*zip(*references, strict=True), "o", mfc="none", color="black", label="reference")
        if curves:  # above: within the curves, which may go anywhere, it would lie over one
            figure.legend(loc="outside upper center", ncols=3, frameon=False)
        axis.set(xlabel=xlabel, ylabel=ylabel)
        axis.locator_params(axis="x", nbins=MOST_TICKS)
        return figure


def contour_figure(moved: Moved, values: list[np.ndarray], label: str, titles: list[str], scale: Limits | None = None) -> Figure:
    """Return a figure of a deformed body in one or more states, colored by values of the cells, all to one scale of length.

    Bodies in the plane are side by side or one below the other, whichever fits a page. A solid has a row for each state: a view from
    outside, and a section through the middle, whose plane is normal to the direction in which the solid is thinnest.

    Parameters
    ----------
    moved : list of tuple
        Cells of the body in each state, with the displacements of the nodes, shape (k, d).
    values : list of ndarray, shape (n,)
        Values of the cells in each state, which colors show.
    label : str
        Label of the color bars; it moves to the titles if a bar is too short.
    titles : list of str
        Title of each state.
    scale : tuple of float, optional
        Ends of the scale of colors of all states; by default every state has a scale of its own.
    """
    draw = _solids if moved[0][0].dimension == 3 else _sheets
    with matplotlib.rc_context(STYLE):
        return draw(moved, values, label, titles, [scale or limits_of(value) for value in values])


def _sheets(moved: Moved, values: list[np.ndarray], label: str, titles: list[str], scales: list[Limits]) -> Figure:
    """Return the figure of `contour_figure` for bodies in the plane."""
    bodies = [polygons_of(*pair) for pair in moved]
    width, height = sides = np.max([np.ptp(corners, axis=(0, 1)) for corners in bodies], axis=0)
    rows, columns = (len(bodies), 1) if width > height else (1, len(bodies))
    inches = height * (6.0 / width if width > height else 5.5 / (columns * width))
    figure = Figure(figsize=(7.2, rows * (inches + 0.4)), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).flat
    if len(label) * INCHES_OF_A_LETTER > inches:
        titles, label = [f"{label}, {title}" for title in titles], ""
    for axis, corners, value, title, scale in zip(axes, bodies, values, titles, scales, strict=True):
        drawn = draw_cells(axis, corners, value, clim=scale)
        axis.set_title(title, pad=4)
        # One scale of length for all: every axis shows as much as the largest body needs.
        (left, bottom), (right, top) = np.mean([axis.get_xlim(), axis.get_ylim()], axis=1) + np.outer([-0.5, 0.5], sides)
        axis.set(xlim=(left, right), ylim=(bottom, top))
        figure.colorbar(drawn, ax=axis, label=label, fraction=0.05, pad=0.01)
    return figure


def _solids(moved: Moved, values: list[np.ndarray], label: str, titles: list[str], scales: list[Limits]) -> Figure:
    """Return the figure of `contour_figure` for solids: a view from outside and a section for each state."""
    places = [cells.nodes + displacement for cells, displacement in moved]
    box = np.array([np.min([nodes.min(axis=0) for nodes in places], axis=0), np.max([nodes.max(axis=0) for nodes in places], axis=0)])
    axis, middle = cut_of(moved[0][0])
    across = [other for other in range(3) if other != axis]
    figure = Figure(figsize=(7.2, 2.9 * len(moved)), layout="constrained")
    for number, ((cells, _), nodes, value, title, scale) in enumerate(zip(moved, places, values, titles, scales, strict=True)):
        limits = Normalize(*scale)
        outside = figure.add_subplot(len(moved), 2, 2 * number + 1, projection="3d", computed_zorder=False)
        draw_outside(outside, cells, nodes, matplotlib.colormaps["turbo"](limits(value)), box, zoom=1.25)
        outside.set_title(title, pad=0)
        cut = figure.add_subplot(len(moved), 2, 2 * number + 2)
        polygons, owners = section(cells, nodes, axis, middle)
        drawn = PolyCollection([polygon[:, across] for polygon in polygons], array=value[owners], cmap="turbo", norm=limits, lw=0.2)
        drawn.set_edgecolor("face")
        cut.add_collection(drawn)
        cut.set(aspect="equal", xlim=box[:, across[0]], ylim=box[:, across[1]])
        cut.set_axis_off()
        cut.set_title(f"deformed section, at rest at x{axis + 1} = {middle:.4g}", pad=2)
        figure.colorbar(drawn, ax=cut, label=label, fraction=0.05, pad=0.05, shrink=0.8)
    return figure


def cut_of(cells: CellMesh) -> tuple[int, float]:
    """Return the plane of the section in figures of a solid: its normal axis (0, 1 or 2), the thinnest direction, and its position."""
    # The last of equal sides, so that the cut of a cube shows x1, the direction of loading.
    sides = np.ptp(cells.nodes, axis=0)[::-1]
    axis = 2 - int(np.argmin((sides / sides.max()).round(9)))
    return axis, float(cells.nodes[:, axis].min() + cells.nodes[:, axis].max()) / 2


def draw_outside(axes, cells: CellMesh, nodes: np.ndarray, of_cells: np.ndarray, box: np.ndarray, zoom: float) -> None:
    """Draw a solid from outside: the outer sides of the cells that face the viewer.

    `nodes` are the deformed nodes, shape (k, 3), `of_cells` the colors of the cells (RGBA), shape (n, 4), `box` the lower and upper corner
    of the part of space in view, shape (2, 3), and `zoom` the magnification.
    """
    axes.set(xlim=box[:, 0], ylim=box[:, 1], zlim=box[:, 2])
    axes.set_box_aspect(box[1] - box[0], zoom=zoom)
    axes.view_init(ELEVATION, AZIMUTH)
    axes.set_proj_type("ortho")
    axes.set_axis_off()
    corners, beside = cells.faces
    outer = beside[:, 1] < 0
    sides, owners = nodes[corners[outer]], beside[outer, 0]
    normals = np.cross(sides[:, 2] - sides[:, 0], sides[:, 3] - sides[:, 1])  # of triangles as well, which repeat the last corner
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    seen = np.flatnonzero(normals @ EYE > 0)
    brightness = 0.8 + 0.2 * np.clip(normals[seen] @ LightSource(AZIMUTH, 45).direction, 0, 1)
    colors = of_cells[owners[seen]].copy()
    colors[:, :3] *= brightness[:, None]
    axes.add_collection3d(Poly3DCollection(sides[seen], facecolors=colors, edgecolors=colors, linewidths=0.2, zsort="average"))


def section(cells: CellMesh, nodes: np.ndarray, axis: int, position: float) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the deformed polygons in which a plane of the undeformed body cuts its cells.

    Parameters
    ----------
    cells : CellMesh
        Cells of a solid.
    nodes : ndarray, shape (k, 3)
        Deformed positions of the nodes of the cells.
    axis : int
        Normal axis of the plane.
    position : float
        Coordinate of the plane along the axis.

    Returns
    -------
    polygons : list of ndarray, each of shape (corners, 3)
    owners : ndarray of int
        Number of the cell to which each polygon belongs.
    """
    # Corners on the plane count as below it: of two cells that share a side there, one has the cut.
    above = cells.nodes[:, axis] > position
    polygons, owners, begin = [], [], 0
    for block in cells.blocks:
        faces = np.array(FACES[3, block.shape[1]])
        edges = np.unique(np.sort(np.stack([faces, np.roll(faces, 1, axis=1)], axis=2).reshape(-1, 2)), axis=0)
        cut = np.flatnonzero(above[block].any(axis=1) & ~above[block].all(axis=1))
        for number in cut:
            ends = block[number][edges]
            ends = ends[above[ends[:, 0]] != above[ends[:, 1]]]
            heights = cells.nodes[ends, axis]
            share = ((position - heights[:, 0]) / (heights[:, 1] - heights[:, 0]))[:, None]
            was, now = ((1 - share) * at[ends[:, 0]] + share * at[ends[:, 1]] for at in (cells.nodes, nodes))
            flat = np.delete(was - was.mean(axis=0), axis, axis=1)
            polygons.append(now[np.argsort(np.arctan2(flat[:, 1], flat[:, 0]))])
        owners.append(begin + cut)
        begin += len(block)
    return polygons, np.concatenate(owners)
