"""The result of a simulation, and how it is stored."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..body import Body
from ..scenes import Scene
from .files import write_json, write_text


@dataclass
class Result:
    """What a simulation gave.

    Attributes
    ----------
    scene : Scene
    body : Body
    summary : dict
        What ``summary.json`` holds: identity, size, convergence, cost and ``levels``.
    history : list of dict
        Rows of ``history.csv``.
    states : list of (stretch, fields)
        Fields on the points at every level, see `pdsurrogate.results.measures.point_fields`.
    """

    scene: Scene
    body: Body
    summary: dict
    history: list[dict] = field(default_factory=list)
    states: list[tuple[float, dict[str, np.ndarray]]] = field(default_factory=list)

    @property
    def levels(self) -> list[dict]:
        """Measures at every level of the loading programme."""
        return self.summary["levels"]

    def displacement(self, level: int = -1) -> np.ndarray:
        """Displacements at a level, shape (n, 2)."""
        return self.states[level][1]["displacement"][:, :2]

    def save(self, folder: str | Path) -> None:
        """Write ``summary.json``, ``history.csv``, a VTU series with its PVD index and a figure of the deformed body.

        Every file is written whole; the summary last, so that a folder with a summary is complete.
        """
        from . import figures, vtk

        folder = Path(folder)
        write_text(folder / "history.csv", _as_csv(self.history))
        if self.states:
            vtk.write_series(folder, self.body.points, self.states, self.scene.name)
            figures.save(self.figure(), folder / f"{self.scene.name}.png")
        write_json(folder / "summary.json", self.summary)

    def figure(self):
        """The deformed body at every level, coloured by the displacement across the loaded direction (Fig. 6)."""
        from . import figures

        lateral = 1 - self.scene.loaded_axis
        return figures.contour_figure(
            [figures.deformed_cells(self.body.points, fields, self.body.spacing) for _, fields in self.states],
            [fields["displacement"][:, lateral] for _, fields in self.states],
            f"u{lateral + 1} ({self.scene.units.length})",
            [f"stretch {stretch:g}" for stretch, _ in self.states],
        )


def _as_csv(rows: list[dict]) -> str:
    text = io.StringIO()
    if rows:
        writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return text.getvalue()
