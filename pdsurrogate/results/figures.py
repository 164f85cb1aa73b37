"""Figures: pictures where one would look rather than read."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from .files import write_with

STYLE = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "figure.dpi": 150,
    "savefig.bbox": "tight",
}


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whole."""
    write_with(path, lambda temporary: figure.savefig(temporary, format="png"))


def contour_figure(points, states, component, label, titles, spacing) -> Figure:
    """Deformed bodies coloured by one component of their displacement, one below the other and to one scale of length.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
    states : list of ndarray, shape (n, 2)
        Displacements.
    component : int
    label : str
        Of the colour bars.
    titles : list of str
    spacing : float
        Size of a point, in the body's unit of length.
    """
    with matplotlib.rc_context(STYLE):
        extents = [np.ptp(points + state, axis=0) for state in states]
        width = max(extent[0] for extent in extents)
        scale = 6.0 / width
        heights = [max(extent[1] * scale, 0.8) + 0.5 for extent in extents]
        figure = Figure(figsize=(7.2, sum(heights)), layout="constrained")
        axes = figure.subplots(len(states), 1, squeeze=False, gridspec_kw={"height_ratios": heights})[:, 0]
        low = min((points + state)[:, 0].min() for state in states)
        for axis, state, title in zip(axes, states, titles, strict=True):
            deformed = points + state
            drawn = axis.scatter(
                *deformed.T, c=state[:, component], s=(spacing * scale * 72 * 1.25) ** 2, marker="s", linewidths=0, cmap="turbo"
            )
            axis.set(aspect="equal", xlim=(low - 0.02 * width, low + 1.02 * width), title=title)
            axis.set_axis_off()
            figure.colorbar(drawn, ax=axis, label=label, fraction=0.03, pad=0.01)
        return figure
