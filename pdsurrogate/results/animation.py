"""Animations of crack scenes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
from matplotlib.animation import PillowWriter
from matplotlib.figure import Figure

from .figures import STYLE, draw_cells, polygons_of
from .files import MARK, write_with

if TYPE_CHECKING:
    from .result import Result

FRAMES_PER_SECOND = 8


class _Marking(PillowWriter):
    """Writes the mark of the package into the file, which the base leaves no place for."""

    def finish(self) -> None:
        first, *others = self._frames
        first.save(self.outfile, save_all=True, append_images=others, duration=int(1000 / self.fps), loop=0, comment=MARK)


def save(result: Result, path: Path) -> None:
    """Write a GIF of the dynamics of a body in the plane, coloured by damage or else by the greatest stretch."""
    frames = result.in_dynamics()
    if not frames or result.scene.dimension == 3:  # a series of states in space is for ParaView
        return
    fields = result.states[frames[-1]][1]
    quantity, limits = (
        ("damage", (0.0, 1.0)) if "damage" in fields else ("principal_stretch", (1.0, float(fields["principal_stretch"].max())))
    )
    corners = polygons_of(*result.cells(frames[-1]))
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    size = (high - low) / (high - low).max() * 6.0
    with matplotlib.rc_context({**STYLE, "savefig.bbox": None}):
        figure = Figure(figsize=(size[0] + 1.2, size[1] + 0.4), dpi=100, layout="constrained")
        axis = figure.subplots()
        drawn = draw_cells(axis, corners, fields[quantity], clim=limits)
        axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        figure.colorbar(drawn, ax=axis, label=quantity, fraction=0.05, pad=0.01)

        def write(temporary: Path) -> None:
            writer = _Marking(fps=FRAMES_PER_SECOND)
            with writer.saving(figure, str(temporary), dpi=100):
                for number in frames:
                    drawn.set_verts(polygons_of(*result.cells(number)))
                    drawn.set_array(result.states[number][1][quantity])
                    axis.set_title(result.title(number), pad=2)
                    writer.grab_frame()

        write_with(path, write)
