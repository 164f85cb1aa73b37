"""Figures of deformed bodies, in the plane or from outside and cut through the middle, and of
curves.
"""

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LightSource, Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from mpl_toolkits.mplot3d.proj3d import proj_transform

from ..body.cell_mesh import CellMesh
from .files import MARK, replacing

Moved = list[tuple[CellMesh, np.ndarray]]
"""One entry for each state: the cells of the body, and the displacements of their nodes, shape
(k, d).
"""

Limits = tuple[float, float]
"""Values at the ends of a scale of colors."""

PLACES = ("x₁", "x₂", "x₃")
"""Labels of the axes of places."""

SEQUENTIAL, DIVERGING = "viridis", "RdBu_r"
"""Color maps of Matplotlib: a perceptually uniform one, and one for signed values, which is
white at zero.
"""

SIGNED = 0.02
"""Least ratio of the greatest values of either sign at which a field is drawn as signed, with a
scale symmetric about zero.
"""

STYLE = matplotlib.rc_params_from_file(
    Path(__file__).with_name("journal.mplstyle"), use_default_template=False
)
"""Settings of Matplotlib for all figures."""

OUTLINE = {"colors": "0.2", "linewidths": 0.6, "capstyle": "round", "snap": False}
"""Line around a deformed body."""

AT_REST = {"colors": "0.55", "linewidths": 0.8, "capstyle": "round", "snap": False}
"""Line around the undeformed body."""

PAGE = np.array([5.8, 4.6])
"""Greatest width and height in inches of the panels of a figure together."""

CREASE = 0.5
"""Cosine of the angle between the normals of neighboring sides of a solid below which their
common edge is drawn.
"""

ONE_COLOR = 1e-4
"""Least range of a scale of colors, divided by the greatest absolute value of the field: a
component that varies by much less, as by residuals of a solver (some 1e-6), has one color.
"""

MOST_TICKS = 6
"""Greatest number of intervals between ticks on the horizontal axis of curves: with more, their
numbers would run into each other.
"""

MOST_MARKED = 30
"""Number of points of a curve below which every point is marked: more marks would run into each
other.
"""


ELEVATION, AZIMUTH = 22.0, -58.0
"""Direction of view in degrees: from the front right, a little above; x3 points up."""

_UP, _ROUND = np.radians([ELEVATION, AZIMUTH])
EYE = np.array([np.cos(_UP) * np.cos(_ROUND), np.cos(_UP) * np.sin(_ROUND), np.sin(_UP)])
"""Unit vector from a solid to the viewer, by `ELEVATION` and `AZIMUTH`."""

ACROSS_AND_UP = np.array(
    [
        [-np.sin(_ROUND), np.cos(_ROUND), 0],
        [-EYE[2] * np.cos(_ROUND), -EYE[2] * np.sin(_ROUND), np.cos(_UP)],
    ]
)
"""Unit vectors in space that point to the right and upward in a view from outside."""

TRIAD = 30.0
"""Length in points of the arrows that show the directions of the axes."""


def save(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG file, whole or not at all; `MARK` in the PNG metadata identifies
    the file as written by this package.
    """
    box, layout = "tight", figure.get_layout_engine()
    if layout is not None:
        # Once the layout is final, the box to keep is known without drawing; `savefig` would draw
        # twice to find it.
        FigureCanvasAgg(figure)
        layout.execute(figure)
        figure.set_layout_engine("none")
        box = figure.get_tightbbox().padded(matplotlib.rcParams["savefig.pad_inches"])
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", bbox_inches=box, metadata={"Software": MARK})


def polygons_of(cells: CellMesh, displacement: np.ndarray) -> np.ndarray:
    """Return the corners of cells in the plane after a displacement of the nodes (k, 2), shape
    (n, 4, 2); triangles repeat the last.
    """
    places = cells.nodes + displacement
    return np.concatenate(
        [places[block if block.shape[1] > 3 else block[:, [0, 1, 2, 2]]] for block in cells.blocks]
    )


def limits_of(values: np.ndarray, greatest: float = 0.0) -> Limits:
    """Return the ends of a color scale: symmetric about zero for values of both signs, else the
    least and the greatest value.

    The range is at least `ONE_COLOR` of the greatest absolute value, or of `greatest`, that of all
    components of the field: a field that varies only by a solver's residuals thus has a uniform
    color.
    """
    low, high = float(values.min()), float(values.max())
    size = max(-low, high)
    least = ONE_COLOR * max(size, -high, low, greatest, 1e-300)
    if min(-low, high) > SIGNED * size and size > least:
        return -size, size
    return low, low + max(high - low, least)


def colors_of(limits: Limits) -> dict[str, Any]:
    """Return the color map and the norm of a scale: a diverging map if its ends are symmetric
    about zero, else a uniform one.
    """
    return {
        "cmap": DIVERGING if limits[0] == -limits[1] else SEQUENTIAL,
        "norm": Normalize(*limits),
    }


def draw_cells(axis, cells: CellMesh, displacement: np.ndarray, values: np.ndarray, limits: Limits):
    """Draw cells in the plane after a displacement of the nodes (k, 2), in colors of their
    values, and their outline; return the cells.
    """
    polygons = polygons_of(cells, displacement)
    style = {"edgecolors": "none", "linewidths": 0, "antialiased": False, "rasterized": True}
    drawn = axis.add_collection(
        PolyCollection(polygons, array=values, **style, **colors_of(limits))
    )
    axis.add_collection(
        LineCollection((cells.nodes + displacement)[cells.outer_sides[0]], **OUTLINE)
    )
    low, high = polygons.min(axis=(0, 1)), polygons.max(axis=(0, 1))
    axis.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return drawn


def curves_figure(
    x: Sequence[float],
    curves: dict[str, list[float]],
    xlabel: str,
    ylabel: str,
    references: Sequence[tuple[float, float]] = (),
    least: float = 0.0,
) -> Figure:
    """Return a figure of named curves over the common abscissae `x`, with reference values (x, y)
    as circles.

    The vertical axis shows at least the values up to `least` of either sign, so that residuals look
    like zero.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(4.8, 3.2), layout="constrained")
        axis = figure.subplots()
        for (name, values), marker in zip(
            curves.items(), cycle("osD^vP" if len(x) < MOST_MARKED else [""])
        ):
            axis.plot(x, values, marker=marker, label=name)
        if references:
            axis.plot(
                *zip(*references, strict=True),
                "o",
                ms=7,
                mfc="none",
                color="black",
                label="reference",
                zorder=0,
            )
        if (
            len(axis.lines) > 1
        ):  # above: within the curves, which may go anywhere, it would lie over one
            figure.legend(loc="outside upper center", ncols=3 if len(axis.lines) != 4 else 2)
        low, high = axis.get_ylim()
        if max(-low, high) < least:
            axis.set_ylim(-least, least)
        elif low < 0 < high:
            axis.axhline(0, color="0.7", lw=0.6, zorder=0)
        axis.set(xlabel=xlabel, ylabel=ylabel)
        axis.locator_params(axis="x", nbins=MOST_TICKS)
        return figure


def contour_figure(
    moved: Moved,
    values: list[np.ndarray],
    label: str,
    titles: list[str],
    limits: Limits | None = None,
    places: Sequence[str] = PLACES,
) -> Figure:
    """Return a figure of a deformed body in one or more states, colored by values of the cells, all
    to one scale of colors and of length.

    Bodies in the plane are side by side or one below the other, whichever fits a page. A solid has
    a row for each state: a view from outside, and a section through the middle, whose plane is
    normal to the direction in which the solid is thinnest. A gray line is the outline of the
    undeformed body.

    Parameters
    ----------
    moved : list of tuple
        Cells of the body in each state, with the displacements of the nodes, shape (k, d).
    values : list of ndarray, shape (n,)
        Values of the cells in each state, which colors show.
    label : str
        Label of the color bar.
    titles : list of str
        Title of each state.
    limits : tuple of float, optional
        Ends of the scale of colors; by default as `limits_of` finds them for all states together.
    places : sequence of str
        Labels of the axes.
    """
    draw = _solids if moved[0][0].dimension == 3 else _sheets
    with matplotlib.rc_context(STYLE):
        figure, drawn, axes = draw(
            moved, values, titles, limits or limits_of(np.concatenate(values)), places
        )
        height = figure.get_figheight()
        style = (
            {"aspect": 30, "pad": 0.02, "shrink": min(1.0, 3.6 / height)}
            if height > 2.4
            else {"location": "bottom", "aspect": 40}
        )
        figure.colorbar(drawn, ax=axes, label=label, **style)
        if any(nodes.any() for _, nodes in moved):
            figure.legend(
                handles=[LineCollection([], label="undeformed", **AT_REST)],
                loc="outside lower right",
                borderpad=0,
            )
        return figure


def _box_of(moved: Moved) -> np.ndarray:
    """Return the lower and the upper corner of the space that a body fills at rest and in all
    states, shape (2, d).
    """
    places = [moved[0][0].nodes, *(cells.nodes + displacement for cells, displacement in moved)]
    return np.array(
        [
            np.min([nodes.min(axis=0) for nodes in places], axis=0),
            np.max([nodes.max(axis=0) for nodes in places], axis=0),
        ]
    )


def _sheets(
    moved: Moved, values: list[np.ndarray], titles: list[str], limits: Limits, places: Sequence[str]
) -> tuple[Figure, Any, Any]:
    """Return the figure of `contour_figure` for bodies in the plane, without its color bar, with
    the last drawn cells and the axes.
    """
    box = _box_of(moved)
    count, (width, height) = len(moved), box[1] - box[0]
    # The greatest scale of equal panels that fit a page.
    scale, columns = max(
        (min(PAGE[0] / (n * width), PAGE[1] * n / (count * height)), n)
        for n in range(1, count + 1)
        if count % n == 0
    )
    rows, panel = count // columns, scale * (box[1] - box[0])
    figure = Figure(
        figsize=(columns * panel[0] + 1.5, rows * (panel[1] + 0.4) + 0.8), layout="constrained"
    )
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axis, (cells, displacement), value, title in zip(
        axes.flat, moved, values, titles, strict=True
    ):
        drawn = draw_cells(axis, cells, displacement, value, limits)
        axis.add_collection(LineCollection(cells.nodes[cells.outer_sides[0]], **AT_REST))
        axis.set(title=title, xlabel=places[0], ylabel=places[1])
        axis.label_outer()
    room = 0.02 * max(width, height)
    axis.set(xlim=(box[0, 0] - room, box[1, 0] + room), ylim=(box[0, 1] - room, box[1, 1] + room))
    for name, inches in zip("xy", panel, strict=True):
        axis.locator_params(axis=name, nbins=max(2, int(2 * inches)))
    return figure, drawn, axes


def _solids(
    moved: Moved, values: list[np.ndarray], titles: list[str], limits: Limits, places: Sequence[str]
) -> tuple[Figure, Any, Any]:
    """Return the figure of `contour_figure` for solids, without its color bar, with the last
    drawn section and all axes.
    """
    box, colors, (axis, middle) = _box_of(moved), colors_of(limits), cut_of(moved[0][0])
    across = [other for other in range(3) if other != axis]
    figure = Figure(figsize=(7.2, 3.0 * len(moved)), layout="constrained")
    for number, ((cells, displacement), value, title) in enumerate(
        zip(moved, values, titles, strict=True)
    ):
        nodes = cells.nodes + displacement
        outside = figure.add_subplot(
            len(moved), 2, 2 * number + 1, projection="3d", computed_zorder=False
        )
        draw_outside(
            outside,
            cells,
            nodes,
            matplotlib.colormaps[colors["cmap"]](colors["norm"](value)),
            box,
            filled=1.0,
        )
        outside.add_collection3d(
            Line3DCollection(cells.nodes[creases(cells)], **AT_REST, zorder=-1), autolim=False
        )
        outside.set_title(title)
        cut = figure.add_subplot(len(moved), 2, 2 * number + 2)
        polygons, owners, rim = section(cells, nodes, axis, middle)
        flat = [polygon[:, across] for polygon in polygons]
        drawn = cut.add_collection(
            PolyCollection(flat, array=value[owners], edgecolors="face", lw=0.5, **colors)
        )
        for lines, style in (
            (rim, OUTLINE),
            (section(cells, cells.nodes, axis, middle)[2], AT_REST),
        ):
            cut.add_collection(LineCollection(lines[:, :, across], **style))
        low, high = box[:, across] + 0.02 * np.ptp(box) * np.array([[-1], [1]])
        cut.set(
            aspect="equal",
            xlim=(low[0], high[0]),
            ylim=(low[1], high[1]),
            xlabel=places[across[0]],
            ylabel=places[across[1]],
        )
        cut.set_title(f"deformed section, {PLACES[axis]} = {middle:z.3g}")
    return figure, drawn, figure.axes


def cut_of(cells: CellMesh) -> tuple[int, float]:
    """Return the plane of the section in figures of a solid: its normal axis (0, 1 or 2), the
    thinnest direction, and where it lies.
    """
    # The last of equal sides, so that the cut of a cube shows x1, the direction of loading.
    sides = np.ptp(cells.nodes, axis=0)[::-1]
    axis = 2 - int(np.argmin((sides / sides.max()).round(9)))
    # Through the middles of cells, whose values the section shows.
    found = (
        np.concatenate([cells.nodes[block, axis].mean(axis=1) for block in cells.blocks])
        / sides.max()
    )
    layers, counts = np.unique(found.round(9), return_counts=True)
    layers = layers[counts > counts.max() / 2]
    return axis, float(
        min(
            reversed(layers),
            key=lambda place: round(abs(place - (found.min() + found.max()) / 2), 6),
        )
        * sides.max()
    )


def creases(cells: CellMesh) -> np.ndarray:
    """Return the nodes at the ends of the edges of an undeformed solid, shape (m, 2), where its
    surface is creased, see `CREASE`.
    """
    corners, _ = cells.outer_sides
    normals = _normals_of(cells.nodes[corners])
    edges, number = np.unique(
        np.sort(_edges_of(corners).reshape(-1, 2), axis=1), axis=0, return_inverse=True
    )
    mean = (
        np.stack(
            [np.bincount(number.ravel(), np.repeat(component, 4)) for component in normals.T],
            axis=1,
        )
        / 2
    )
    # The mean of two unit normals has a length of cos(angle / 2).
    return edges[((mean**2).sum(axis=1) < (1 + CREASE) / 2) & (edges[:, 0] != edges[:, 1])]


def _edges_of(corners: np.ndarray) -> np.ndarray:
    """Return the nodes at the ends of the edges of sides (n, 4), in order around each, shape (n,
    4, 2).
    """
    return np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)


def _normals_of(sides: np.ndarray) -> np.ndarray:
    """Return the unit normals of sides in three dimensions, shape (n, 4, 3), triangles as well,
    which repeat the last corner.
    """
    normals = np.cross(sides[:, 2] - sides[:, 0], sides[:, 3] - sides[:, 1])
    return normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]


def draw_outside(
    axes, cells: CellMesh, nodes: np.ndarray, of_cells: np.ndarray, box: np.ndarray, filled: float
) -> None:
    """Draw a solid from outside: the outer sides of the cells that face the viewer, and the
    directions of the axes.

    `nodes` are the deformed nodes, shape (k, 3), `of_cells` the colors of the cells (RGBA), shape
    (n, 4), `box` the lower and upper corner of the part of space in view, shape (2, 3), and
    `filled` the share of the view's width or height that it fills.
    """
    axes.set(xlim=box[:, 0], ylim=box[:, 1], zlim=box[:, 2])
    axes.view_init(ELEVATION, AZIMUTH)
    axes.set_proj_type("ortho")
    axes.set_axis_off()
    axes.set_box_aspect(box[1] - box[0])
    across_and_up = proj_transform(
        *box[np.indices((2, 2, 2)), np.arange(3)[:, None, None, None]].reshape(3, -1),
        axes.get_proj(),
    )[:2]
    axes.set_box_aspect(
        box[1] - box[0], zoom=filled * axes.viewLim.width / np.ptp(across_and_up, axis=1).max()
    )
    corners, owners = cells.outer_sides
    sides = nodes[corners]
    normals = _normals_of(sides)
    seen = np.flatnonzero(normals @ EYE > 0)
    brightness = 0.8 + 0.2 * np.clip(normals[seen] @ LightSource(AZIMUTH, 45).direction, 0, 1)
    colors = of_cells[owners[seen]].copy()
    colors[:, :3] *= brightness[:, None]
    axes.add_collection3d(
        Poly3DCollection(
            sides[seen], facecolors=colors, edgecolors=colors, linewidths=0.2, zsort="average"
        )
    )
    for name, *way in zip(PLACES, *ACROSS_AND_UP, strict=True):
        style = {"arrowstyle": "<|-", "lw": 0.8, "color": "0.2", "shrinkA": 2, "shrinkB": 0}
        at = {
            "xy": (0.05, 0.04),
            "xycoords": "axes fraction",
            "xytext": TRIAD * np.array(way),
            "textcoords": "offset points",
        }
        axes.annotate(
            name, **at, arrowprops=style, ha="center", va="center", color="0.2", fontsize=8
        )


def section(
    cells: CellMesh, nodes: np.ndarray, axis: int, position: float
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Return the deformed polygons in which a plane of the undeformed body cuts its cells, and the
    outline of them all.

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
    rim : ndarray, shape (m, 2, 3)
        Segments in which the plane cuts the surface.
    """

    def cut(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the sides that the plane crosses, and where it enters and leaves them,
        undeformed and deformed, shape (m, 2, 2, 3).
        """
        ends = _edges_of(corners)
        # Corners on the plane count as below it: of two cells that share a side there, one has the
        # cut.
        heights = cells.nodes[ends, axis] - position
        crossed = (heights[..., 0] > 0) != (heights[..., 1] > 0)
        there = np.flatnonzero(crossed.sum(axis=1) == 2)
        ends, heights = ends[there][crossed[there]], heights[there][crossed[there]]
        share = (heights[:, 0] / (heights[:, 0] - heights[:, 1]))[:, None]
        places = [
            ((1 - share) * at[ends[:, 0]] + share * at[ends[:, 1]]).reshape(-1, 2, 3)
            for at in (cells.nodes, nodes)
        ]
        return there, *places

    corners, owners = cells.sides()
    there, was, now = cut(corners)
    order = np.argsort(owners[there], kind="stable")
    found, first = np.unique(owners[there][order], return_index=True)
    polygons = []
    for before, after in zip(
        np.split(was[order], first[1:]), np.split(now[order], first[1:]), strict=True
    ):
        flat = np.delete(before.reshape(-1, 3) - before.mean(axis=(0, 1)), axis, axis=1)
        polygons.append(after.reshape(-1, 3)[np.argsort(np.arctan2(flat[:, 1], flat[:, 0]))][::2])
    return polygons, found, cut(cells.outer_sides[0])[2]
