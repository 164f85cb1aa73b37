"""Figures of deformed bodies, of solids from outside, and of curves."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from ..body.cell_mesh import SLAB, CellMesh
from .files import replacing

Moved = list[tuple[CellMesh, np.ndarray]]
"""One entry for each state: the cells of the body, and the displacements of their nodes, shape
(k, d).
"""

Limits = tuple[float, float]
"""Values at the ends of a scale of colors."""

PLACES = ("x₁", "x₂", "x₃")
"""Labels of the axes of places."""

SEQUENTIAL = "viridis"
DIVERGING = "RdBu_r"
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

PLAIN = "#d9dde3"
"""Color of cells in no region or group."""

OUTLINE: dict[str, Any] = {"colors": "0.2", "linewidths": 0.6, "capstyle": "round", "snap": False}
"""Line around a deformed body."""

AT_REST = {"colors": "0.55", "linewidths": 0.8, "capstyle": "round", "snap": False}
"""Line around the undeformed body."""

PAGE = np.array([5.8, 4.6])
"""Greatest width and height in inches of the panels of a figure together."""

ONE_COLOR = 1e-4
"""Least range of a scale of colors, divided by the greatest absolute value of the field: a
component that varies by much less, as by residuals of a solver (some 1e-6), has one color.
"""


def save(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG file, whole or not at all."""
    box = "tight"
    layout = figure.get_layout_engine()
    if layout is not None:
        # Once the layout is final, the box to keep is known without drawing; `savefig` would draw
        # twice to find it.
        FigureCanvasAgg(figure)
        layout.execute(figure)
        figure.set_layout_engine("none")
        box = figure.get_tightbbox().padded(matplotlib.rcParams["savefig.pad_inches"])
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", bbox_inches=box)


def polygons_of(cells: CellMesh, displacement: np.ndarray) -> np.ndarray:
    """Return the corners of cells in the plane after a displacement of the nodes (k, 2), shape
    (n, 4, 2); triangles repeat the last.
    """
    places = cells.nodes + displacement
    return np.concatenate(
        [places[block if block.shape[1] > 3 else block[:, [0, 1, 2, 2]]] for block in cells.blocks]
    )


def spread(count: int, most: int) -> list[int]:
    """Return at most so many of the numbers below a count, evenly spread, the last one among
    them.
    """
    return np.linspace(count - 1, 0, min(most, count)).round().astype(int)[::-1].tolist()


def limits_of(values: np.ndarray, greatest: float = 0.0) -> Limits:
    """Return the ends of a color scale: symmetric about zero for values of both signs, else the
    least and the greatest value.

    The range is at least `ONE_COLOR` of the greatest absolute value, or of `greatest`, that of all
    components of the field: a field that varies only by a solver's residuals thus has a uniform
    color.
    """
    low = float(values.min())
    high = float(values.max())
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
    values, and their outline; return the cells, an image where they are smaller than two pixels.
    """
    places = cells.nodes + displacement
    used = np.zeros(len(places), dtype=bool)
    for block in cells.blocks:
        used[block] = True
    low = places[used].min(axis=0)
    high = places[used].max(axis=0)
    pixel = float(((high - low) / (PAGE * STYLE["figure.dpi"])).max())
    counts = np.ceil((high - low) / pixel).astype(int)
    if 4 * len(cells) > counts.prod():
        image = image_of(cells, (places - low) / pixel, values, counts)
        far = low + counts * pixel
        drawn = axis.imshow(
            image,
            extent=(low[0], far[0], low[1], far[1]),
            origin="lower",
            interpolation="nearest",
            **colors_of(limits),
        )
    else:
        style = {"edgecolors": "none", "linewidths": 0, "antialiased": False, "rasterized": True}
        polygons = polygons_of(cells, displacement)
        drawn = axis.add_collection(
            PolyCollection(polygons, array=values, **style, **colors_of(limits))
        )
    axis.add_collection(LineCollection(places[cells.outer_sides[0]], **OUTLINE))
    axis.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return drawn


def image_of(
    cells: CellMesh, places: np.ndarray, values: np.ndarray, counts: np.ndarray
) -> np.ndarray:
    """Return the values of the cells that cover the middles of pixels, NaN where none does, shape
    (rows, columns), with the nodes at `places` (k, 2) in pixels and `counts` columns and rows.
    """
    image = np.full(counts[::-1], np.nan)
    end = 0
    for block in cells.blocks:
        for corners in np.array_split(block, range(SLAB, len(block), SLAB)):
            begin, end = end, end + len(corners)
            around = places[corners] - 0.5
            first = np.ceil(around.min(axis=1)).astype(int)
            many = np.floor(around.max(axis=1)).astype(int) + 1 - first
            pixels = many.prod(axis=1)
            cell = np.repeat(np.arange(len(corners)), pixels)
            number = np.arange(len(cell)) - np.repeat(pixels.cumsum() - pixels, pixels)
            column, row = (first[cell] + np.stack(np.divmod(number, many[cell, 1]), axis=1)).T
            x, y = around[cell].transpose(2, 1, 0)
            right, up = np.roll(x, -1, axis=0) - x, np.roll(y, -1, axis=0) - y
            turns = right * (row - y) - up * (column - x)
            inside = (turns >= 0).all(axis=0) | (turns <= 0).all(axis=0)
            image[row[inside], column[inside]] = values[begin:end][cell[inside]]
    return image


def draw_mesh(axis, cells: CellMesh, colors: np.ndarray) -> None:
    """Draw undeformed cells in the plane in their `colors` (RGBA), shape (n, 4), and their
    outline.
    """
    polygons = polygons_of(cells, np.zeros_like(cells.nodes))
    # The stub of PolyCollection leaves out that it takes one array of polygons.
    drawn = PolyCollection(polygons, facecolors=colors, edgecolors="white", linewidths=0.2)  # type: ignore[arg-type]
    axis.add_collection(drawn)
    axis.add_collection(LineCollection(cells.nodes[cells.outer_sides[0]], **OUTLINE))


@contextmanager
def styled(width: float, height: float) -> Iterator[Figure]:
    """Yield an empty figure of a size in inches, drawn in the style of all figures."""
    with matplotlib.rc_context(STYLE):
        yield Figure(figsize=(width, height), layout="constrained")


def curves_figure(
    x: Sequence[float],
    curves: dict[str, list[float]],
    xlabel: str,
    ylabel: str,
    references: Sequence[tuple[float, float]] = (),
) -> Figure:
    """Return a figure of named curves over the common abscissae `x`, with reference values (x, y)
    as circles.
    """
    with styled(4.8, 3.2) as figure:
        axis = figure.subplots()
        # More marks than thirty would run into each other.
        for (name, values), marker in zip(curves.items(), cycle("osD^vP" if len(x) < 30 else [""])):
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
        if low < 0 < high:
            axis.axhline(0, color="0.7", lw=0.6, zorder=0)
        axis.set(xlabel=xlabel, ylabel=ylabel)
        # The numbers of more ticks would run into each other.
        axis.locator_params(axis="x", nbins=6)
        return figure


def contour_figure(
    moved: Moved,
    values: list[np.ndarray],
    label: str,
    titles: list[str],
    limits: Limits,
    places: Sequence[str],
) -> Figure:
    """Return a figure of a deformed body in one or more states, colored by values of the cells, all
    to one scale of colors and of length.

    The states are side by side or one below the other, whichever fits a page. A gray line is the
    outline of an undeformed body in the plane.

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
    limits : tuple of float
        Ends of the scale of colors.
    places : sequence of str
        Labels of the axes.
    """
    rest = moved[0][0]
    count = len(moved)
    nodes = np.concatenate([rest.nodes, *(cells.nodes + way for cells, way in moved)])
    box = np.array([nodes.min(axis=0), nodes.max(axis=0)])
    flat = rest.dimension == 2
    width, height = size = box[1] - box[0] if flat else np.ones(2)
    # The greatest scale of equal panels that fit a page.
    scale, columns = max(
        (min(PAGE[0] / (n * width), PAGE[1] * n / (count * height)), n)
        for n in range(1, count + 1)
        if count % n == 0
    )
    rows = count // columns
    panel = scale * size
    with styled(columns * panel[0] + 1.5, rows * (panel[1] + 0.4) + 0.8) as figure:
        axes = figure.subplots(
            *(rows, columns),
            squeeze=False,
            sharex=flat,
            sharey=flat,
            subplot_kw={} if flat else {"projection": "3d"},
        )
        colors = ScalarMappable(**colors_of(limits))
        for axis, (cells, way), value, title in zip(axes.flat, moved, values, titles, strict=True):
            axis.set_title(title)
            if not flat:
                of_sides = colors.to_rgba(value)[cells.outer_sides[1]]
                draw_outside(axis, cells, cells.nodes + way, of_sides, box, places)
                continue
            draw_cells(axis, cells, way, value, limits)
            axis.add_collection(LineCollection(cells.nodes[cells.outer_sides[0]], **AT_REST))
            axis.set(xlabel=places[0], ylabel=places[1])
            axis.label_outer()
        if flat:
            room = 0.02 * max(size)
            axis.set(xlim=box[:, 0] + [-room, room], ylim=box[:, 1] + [-room, room])
            for name, inches in zip("xy", panel, strict=True):
                axis.locator_params(axis=name, nbins=max(2, int(2 * inches)))
            if any(way.any() for _, way in moved):
                undeformed = LineCollection([], label="undeformed", **AT_REST)
                figure.legend(handles=[undeformed], loc="outside lower right", borderpad=0)
        figure.colorbar(colors, ax=axes, label=label, aspect=30, pad=0.02 if flat else 0.1)
        return figure


def draw_outside(
    axes,
    cells: CellMesh,
    nodes: np.ndarray,
    of_sides: np.ndarray,
    box: np.ndarray,
    places: Sequence[str],
) -> None:
    """Draw the outer sides of the cells of a solid in three-dimensional axes.

    `nodes` are the deformed nodes, shape (k, 3), `of_sides` the colors of the outer sides (RGBA),
    shape (s, 4), `box` the lower and upper corner of the part of space in view, shape (2, 3), and
    `places` the labels of the axes.
    """
    style = {"edgecolors": (0, 0, 0, 0.3), "linewidths": 0.2}
    sides = Poly3DCollection(nodes[cells.outer_sides[0]], facecolors=of_sides, **style)
    axes.add_collection3d(sides)
    axes.set(xlim=box[:, 0], ylim=box[:, 1], zlim=box[:, 2])
    axes.set(xlabel=places[0], ylabel=places[1], zlabel=places[2])
    axes.set(proj_type="ortho", aspect="equal")
    axes.view_init(22, -58)  # from the front right, a little above; x3 points up
    axes.locator_params(nbins=3)
