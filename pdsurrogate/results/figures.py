"""Figures: pictures where one would look rather than read."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from ..body import CellMesh
from ..scenes import Units
from .files import MARK, write_with

STYLE = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "figure.dpi": 150,
    "savefig.bbox": "tight",
}


INCHES_OF_A_LETTER = 0.075
"""Width in the font of `STYLE`, on average."""

ONE_COLOUR = 1e-4
"""Of the greatest value: fields that differ by less are shown in one colour.  Equilibria are found to some 1e-6."""

MOST_TICKS = 6
"""Along the axis of a curve: more numbers, of times above all, would run into each other."""


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whole."""
    write_with(path, lambda temporary: figure.savefig(temporary, format="png", metadata={"Software": MARK}))


def polygons_of(cells: CellMesh, displacement: np.ndarray) -> np.ndarray:
    """Corners of cells in the plane where their nodes have moved to, shape (n, 4, 2); a triangle repeats its last one."""
    places = cells.nodes + displacement
    return np.concatenate([places[block[:, [0, 1, 2, 3] if block.shape[1] == 4 else [0, 1, 2, 2]]] for block in cells.blocks])


def limits_of(values: np.ndarray) -> tuple[float, float]:
    """Ends of a scale of colours: what is nearly one value is shown in one colour, since what a solver leaves is not worth a rainbow."""
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


def loading_figure(stretches: list[float], stresses: list[float], references: list[tuple[float, float]], units: Units) -> Figure:
    """Nominal stress against stretch, with reference values as circles."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(4.8, 3.2), layout="constrained")
        axis = figure.subplots()
        axis.plot(stretches, stresses, lw=1.2, label="peridynamics")
        if references:
            axis.plot(*zip(*references, strict=True), "o", mfc="none", color="black", label="reference")
            axis.legend(frameon=False)
        axis.set(xlabel="stretch", ylabel=units.label("nominal stress", "stress"))
        axis.locator_params(axis="x", nbins=MOST_TICKS)
        return figure


def forces_figure(t: list[float], forces: dict[str, list[float]], units: Units) -> Figure:
    """Components of forces, by name and component, against the loading parameter."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(4.8, 3.2), layout="constrained")
        axis = figure.subplots()
        for name, values in forces.items():
            axis.plot(t, values, ".-", lw=1.2, ms=4, label=name)
        if forces:
            axis.legend(frameon=False)
        axis.set(xlabel="t", ylabel=units.label("force on the body", "force"))
        axis.locator_params(axis="x", nbins=MOST_TICKS)
        return figure


def energies_figure(label: str, places: list[float], energies: dict[str, list[float]], units: Units) -> Figure | None:
    """Energies by name over time or the loading parameter; None where there are none."""
    if not energies:
        return None
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(4.8, 3.2), layout="constrained")
        axis = figure.subplots()
        for name, values in energies.items():
            axis.plot(places, values, ".-" if len(places) < 30 else "-", lw=1.2, ms=4, label=name.replace("_", " "))
        # Above: within the curves, which may go anywhere, it would lie over one.
        figure.legend(loc="outside upper center", ncols=3, frameon=False)
        axis.set(xlabel=label, ylabel=units.label("energy", "energy"))
        axis.locator_params(axis="x", nbins=MOST_TICKS)
        return figure


def contour_figure(
    cells: list[np.ndarray], values: list[np.ndarray], label: str, titles: list[str], scale: tuple[float, float] | None = None
) -> Figure:
    """Deformed bodies, to one scale of length, side by side or one below the other, whichever fits a page.

    Parameters
    ----------
    cells : list of ndarray, shape (n, 4, 2)
        See `polygons_of`.
    values : list of ndarray, shape (n,)
        What they are coloured by.
    label : str
        Of the colour bars; where one is too short for it, it stands in the titles.
    titles : list of str
    scale : tuple of float, optional
        Ends of the scale of colours of all; by default those of the values of each.
    """
    extents = np.array([corners.max(axis=(0, 1)) - corners.min(axis=(0, 1)) for corners in cells])
    wide = extents[:, 0].max() > extents[:, 1].max()
    with matplotlib.rc_context(STYLE):
        if wide:
            inches = 6.0 / extents[:, 0].max()
            figure = Figure(figsize=(7.2, (extents[:, 1] * inches + 0.35).sum()), layout="constrained")
            axes = figure.subplots(len(cells), 1, squeeze=False, gridspec_kw={"height_ratios": extents[:, 1]})[:, 0]
            shortest = extents[:, 1].min() * inches
        else:
            inches = 7.2 / (extents[:, 0].sum() * 1.3)
            figure = Figure(figsize=(7.2, extents[:, 1].max() * inches + 0.5), layout="constrained")
            axes = figure.subplots(1, len(cells), squeeze=False, gridspec_kw={"width_ratios": extents[:, 0]})[0]
            shortest = extents[:, 1].max() * inches
        if len(label) * INCHES_OF_A_LETTER > shortest:
            titles, label = [f"{label}, {title}" for title in titles], ""
        for axis, corners, value, title in zip(axes, cells, values, titles, strict=True):
            drawn = draw_cells(axis, corners, value, clim=scale or limits_of(value))
            axis.set_title(title, pad=4)
            # One scale of length for all: every axis shows as much as the largest body needs along its common side.
            middle = corners.mean(axis=(0, 1))
            if wide:
                axis.set_xlim(middle[0] - 0.5 * extents[:, 0].max(), middle[0] + 0.5 * extents[:, 0].max())
            else:
                axis.set_ylim(middle[1] - 0.5 * extents[:, 1].max(), middle[1] + 0.5 * extents[:, 1].max())
            figure.colorbar(drawn, ax=axis, label=label, fraction=0.05, pad=0.01)
        return figure
