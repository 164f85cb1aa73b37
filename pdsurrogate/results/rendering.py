"""Pictures of bodies in space by pyvista, which shades them and hides what lies behind; where it is not installed, by matplotlib."""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path

import numpy as np

from ..body import CellMesh
from . import figures, views
from .files import write_with
from .vtk import CELL_TYPES

SIZE = (1400, 700)
"""Of a picture, in pixels."""

COLOUR_BAR = {
    **{"vertical": True, "position_x": 0.8, "position_y": 0.2, "width": 0.07, "height": 0.6},
    **{"n_labels": 5, "fmt": "%.3g", "title_font_size": 20, "label_font_size": 18},
}
"""Beside the cut, in parts of its half of the picture."""


def save(
    cells: CellMesh, moved: np.ndarray, values: np.ndarray, label: str, title: str, path: Path, scale: tuple[float, float] | None = None
) -> None:
    """Write a PNG of a state: cells displaced by (k, 3) from outside, and cut through the middle, coloured by values (n,).

    Colours go from end to end of the scale, by default of the values.  A warning says so where matplotlib draws it, and why.
    """
    try:
        import pyvista
    except ImportError:
        warnings.warn("pyvista is not installed, so matplotlib draws; pip install 'pdsurrogate[results]'", stacklevel=3)
        figures.save(views.contour_figure([(cells, moved)], [values], label, [title], scale), path)
        return
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        # What VTK takes without a display, but only after it has tried to open one and said aloud that it failed.
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    axis, middle = views.cut_of(cells)
    kinds = {getattr(pyvista.CellType, CELL_TYPES[3, block.shape[1]].upper()): block for block in cells.blocks}
    # Cut before it is deformed, so that the cut is a plane of the undeformed body, as in the pictures by matplotlib.
    grid = pyvista.UnstructuredGrid(kinds, cells.nodes)
    grid.cell_data[label], grid.point_data["u"] = values, moved
    cut = grid.slice(normal=np.eye(3)[axis], origin=np.eye(3)[axis] * middle)
    limits = scale or figures.limits_of(values)
    drawn = pyvista.Plotter(off_screen=True, shape=(1, 2), window_size=SIZE, border=False)
    for number, part in enumerate((grid, cut)):
        drawn.subplot(0, number)
        # Shaded no more than shows the shape: a colour that light darkens is another value.  A cut is flat.
        light = {"ambient": 0.45, "diffuse": 0.6} if number == 0 else {"lighting": False}
        drawn.add_mesh(part.warp_by_vector("u"), scalars=label, cmap="turbo", clim=limits, show_scalar_bar=False, **light)
        # From outside as by matplotlib; of the cut, its lower coordinate runs to the right and the other one up.
        eye = views.EYE if number == 0 else np.eye(3)[axis] * (-1 if axis == 1 else 1)
        drawn.view_vector(eye, viewup=np.eye(3)[2 if number == 0 or axis != 2 else 1])
        drawn.enable_parallel_projection()
    drawn.add_scalar_bar(label, **COLOUR_BAR)
    drawn.subplot(0, 0)
    drawn.add_text(title, font_size=12)
    drawn.subplot(0, 1)
    drawn.add_text(f"deformed section, at rest at x{axis + 1} = {middle:.4g}", font_size=12)
    write_with(path, lambda temporary: drawn.screenshot(str(temporary)))
    drawn.close()
