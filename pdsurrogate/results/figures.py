"""Figures of deformed bodies in the plane and of curves."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from ..body import CellMesh
from .files import MARK, replacing

Moved = list[tuple[CellMesh, np.ndarray]]
"""Cells of states, each with the displacements of their nodes."""

Limits = tuple[float, float]
"""Values at the ends of a scale of colours."""

STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "figure.dpi": 150,
    "savefig.bbox": "tight",
}

INCHES_OF_A_LETTER = 0.075
"""Mean width of a letter in the font of `STYLE`."""

ONE_COLOUR = 1e-4
"""Share of the greatest value: fields that vary by less are shown in one colour. Equilibria are found to some 1e-6."""

MOST_TICKS = 6
"""Ticks along the axis of a curve: more numbers, of times above all, would run into each other."""

MOST_MARKED = 30
"""Points of a curve up to which each is marked: more marks would run into each other."""


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whole."""
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", metadata={"Software": MARK})


def polygons_of(cells: CellMesh, displacement: np.ndarray) -> np.ndarray:
    """Return the moved corners of cells in the plane, shape (n, 4, 2); a triangle repeats its last one."""
    places = cells.nodes + displacement
    return np.concatenate([places[block[:, [0, 1, 2, 3] if block.shape[1] == 4 else [0, 1, 2, 2]]] for block in cells.blocks])


def limits_of(values: np.ndarray) -> Limits:
    """Return the ends of a scale of colours, wide enough to show residuals of a solver in one colour."""
    low, high = float(values.min()), float(values.max())
    return low, low + max(high - low, ONE_COLOUR * max(abs(low), abs(high), 1e-300))


def draw_cells(axis, cells: np.ndarray, values: np.ndarray, **limits):
    """Fill deformed cells with colours, and fit the axis to them."""
    drawn = PolyCollection(cells, array=values, cmap="turbo", edgecolors="none", linewidths=0, antialiased=False, rasterized=True, **limits)
    axis.add_collection(drawn)
    low, high = cells.min(axis=(0, 1)), cells.max(axis=(0, 1))
    axis.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axis.set_axis_off()
    return drawn


def curves_figure(
    x: list[float], curves: dict[str, list[float]], xlabel: str, ylabel: str, references: Sequence[tuple[float, float]] = ()
) -> Figure:
    """Return a figure of curves by their names over common places, with reference values as circles."""
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
    """Return a figure of deformed bodies, to one scale of length, side by side or one below the other, whichever fits a page.

    Parameters
    ----------
    moved : list of tuple
        Cells of recorded states, with the displacements of their nodes.
    values : list of ndarray, shape (n,)
        Values of the cells, which colours show.
    label : str
        Label of the colour bars; the titles take it if a bar is too short.
    titles : list of str
    scale : tuple of float, optional
        Ends of the scale of colours of all; by default those of the values of each.
    """
    bodies = [polygons_of(*pair) for pair in moved]
    extents = np.array([np.ptp(corners, axis=(0, 1)) for corners in bodies])
    width, height = extents.max(axis=0)
    wide = width > height
    heights = extents[:, 1] * (6.0 / width if wide else 7.2 / (extents[:, 0].sum() * 1.3))
    shape = (len(bodies), 1) if wide else (1, len(bodies))
    ratios = {"height_ratios": heights} if wide else {"width_ratios": extents[:, 0]}
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, (heights + 0.35).sum() if wide else heights.max() + 0.5), layout="constrained")
        axes = figure.subplots(*shape, squeeze=False, gridspec_kw=ratios).flat
        if len(label) * INCHES_OF_A_LETTER > (heights.min() if wide else heights.max()):
            titles, label = [f"{label}, {title}" for title in titles], ""
        for axis, corners, value, title in zip(axes, bodies, values, titles, strict=True):
            drawn = draw_cells(axis, corners, value, clim=scale or limits_of(value))
            axis.set_title(title, pad=4)
            # One scale of length for all: every axis shows as much as the largest body needs along its common side.
            (x, y), half = corners.mean(axis=(0, 1)), 0.5 * max(width, height)
            axis.set(**({"xlim": (x - half, x + half)} if wide else {"ylim": (y - half, y + half)}))
            figure.colorbar(drawn, ax=axis, label=label, fraction=0.05, pad=0.01)
        return figure
