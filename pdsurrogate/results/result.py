"""The result of a simulation, and how it is stored."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..body import Body
from ..scenes import Scene, Units
from .files import write_json, write_text
from .folder import HISTORY, SUMMARY, make_room, occupied
from .states import States, StatesInFiles, StatesInMemory

ENERGIES = ("energy", "work", "kinetic_energy", "damped_energy", "strain_energy", "released_energy")
"""Columns of the history that are energies."""


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
        Rows of ``history.csv``, whose headers have units behind the names used here.
    states : States
        Fields on the points at every level, and at every output of dynamics that follow grips: pairs of a moment and fields, see
        `pdsurrogate.results.states.Moment` and `pdsurrogate.results.measures.POINT_FIELDS`.
    """

    scene: Scene
    body: Body
    summary: dict
    history: list[dict] = field(default_factory=list)
    states: States = field(default_factory=StatesInMemory)

    @property
    def levels(self) -> list[dict]:
        """Measures at every level of the loading programme."""
        return self.summary["levels"]

    def displacement(self, level: int = -1) -> np.ndarray:
        """Displacements at a level, shape (n, d)."""
        return self.states[level][1]["displacement"][:, : self.body.dimension]

    def save(self, folder: str | Path, overwrite: bool = False) -> None:
        """Write ``summary.json``, ``history.csv``, a VTU series with its PVD index and a figure of the deformed body.

        Every file is written whole; the summary last, so that a folder with a summary is complete.  Results of an earlier run of the same
        scene in the folder are removed before.

        Parameters
        ----------
        folder : str or path
        overwrite : bool
            Remove results of other scenes as well.

        Raises
        ------
        FolderTaken
            If the folder holds results of another scene, or a file called like one of these that no run wrote, or a run is writing there.
        """
        folder = Path(folder)
        with occupied(folder):
            self._write(folder, overwrite)

    def _write(self, folder: Path, overwrite: bool) -> None:
        from . import animation, figures

        streamed = isinstance(self.states, StatesInFiles) and self.states.folder.resolve() == folder.resolve()
        if not streamed:
            make_room(folder, self.scene.name, overwrite)
        write_text(folder / HISTORY, _as_csv(self.history, self.scene.units))
        if self.states:
            if not streamed:
                written = StatesInFiles(folder, self.body, self.scene.name)
                for state in self.states:
                    written.append(*state)
            figures.save(self.figure(), folder / f"{self.scene.name}.png")
            if not self.scene.stretched or self.scene.dynamics is not None:
                figures.save(self.loading_figure(), folder / f"{self.scene.name}-loading.png")
                animation.save(self, folder / f"{self.scene.name}.gif")
        write_json(folder / SUMMARY, self.summary)

    def figure(self):
        """The deformed body at every level, coloured by the displacement across the loaded direction (Fig. 6).

        Of a general programme at a few outputs, coloured by the size of the displacement; where bonds break, by damage.  Of a body in space
        the view from outside and a cut through the middle.
        """
        chosen = self.chosen_states()
        states = [self.states[n][1] for n in chosen]  # once: a state may have to be read from its file
        if self.scene.fracture is not None and chosen[-1] in self.in_dynamics():
            label, values = "damage", [fields.get("damage", np.zeros(len(self.body))) for fields in states]
        elif not self.scene.stretched:
            label = f"|u| ({self.scene.units.length})"
            values = [np.linalg.norm(fields["displacement"], axis=1) for fields in states]
        else:
            lateral = (self.scene.loaded_axis + 1) % self.body.dimension
            label, values = f"u{lateral + 1} ({self.scene.units.length})", [fields["displacement"][:, lateral] for fields in states]
        titles = [self.title(n) for n in chosen]
        if self.body.dimension == 3:
            from . import views

            return views.contour_figure(self.body, states, values, label, titles)
        from . import figures

        cells = [figures.deformed_cells(self.body.points, fields, self.body.cell) for fields in states]
        return figures.contour_figure(cells, values, label, titles)

    def render(self, path: str | Path, field: str = "von_mises", component: int = 0, level: int = -1) -> None:
        """Write a picture of a state in space, coloured by a field: by pyvista where it is installed, else by matplotlib with a warning.

        Parameters
        ----------
        path : str or path
            Of the PNG.
        field : str
            One of `pdsurrogate.results.measures.POINT_FIELDS` that the state has.
        component : int
            Of a field that has several, from 0; tensors row by row.
        level : int
            Number of the state.

        Raises
        ------
        ValueError
            If the body is in the plane, or the state has no such field or component.
        """
        from . import rendering
        from .measures import POINT_FIELDS

        if self.body.dimension == 2:
            raise ValueError("render draws bodies in space; figure draws those in the plane")
        fields = self.states[level][1]
        if field not in fields:
            raise ValueError(f"field: the state has no {field!r}; there are {', '.join(fields)}")
        values = fields[field].reshape(len(self.body), -1)
        if not 0 <= component < values.shape[1]:
            raise ValueError(f"component: {field} has the components 0 to {values.shape[1] - 1}, not {component}")
        kind = POINT_FIELDS[field].unit
        label = field + (f" {component}" if values.shape[1] > 1 else "") + (f" ({getattr(self.scene.units, kind)})" if kind else "")
        number = range(len(self.states))[level]
        rendering.save(self.body, fields, values[:, component], label, self.title(number), Path(path))

    def in_dynamics(self) -> list[int]:
        """Numbers of the states that were recorded in dynamics."""
        if self.scene.stretched:
            return list(range(len(self.levels), len(self.states)))
        return [number for number, level in enumerate(self.levels) if "time" in level]

    def chosen_states(self, most: int = 4) -> list[int]:
        """Numbers of the states that a figure shows: all levels, or a few outputs of the dynamics while its crack runs."""
        moving, last = self.in_dynamics(), len(self.states) - 1
        if self.scene.stretched and self.scene.dynamics is None:
            return list(range(len(self.states)))
        if self.scene.stretched and not moving:
            return [last] if last >= 0 else []
        if not self.scene.stretched and not (moving and self.scene.fracture is not None):
            return sorted(set(np.linspace(0, last, min(most, last + 1)).round().astype(int).tolist()))
        first = len(self.levels) if self.scene.stretched else moving[0]
        chosen = np.linspace(first, last, most)
        if self.scene.fracture is not None:
            broken = np.array([entry["broken_bonds"] for entry in self.summary["crack"]["tips"]])
            if broken[-1] > 0:
                # Evenly over the growth of the crack, which takes a small part of the time.
                grown = np.searchsorted(broken, np.linspace(0.1, 1.0, most) * broken[-1])
                chosen = np.array(moving)[grown]
        return sorted(set(chosen.round().astype(int).tolist()))

    def title(self, number: int) -> str:
        """What a figure says above a state: the loading parameter, and the time in dynamics."""
        moment, moving = self.states.moments[number], number in self.in_dynamics()
        if self.scene.stretched:
            at = f"stretch {moment.stretch:.3f}" if moving else f"stretch {moment.stretch:g}"
        else:
            at = f"t = {moment.t:.3g}"
        return f"{at}, {moment.time:.4g} {self.scene.units.time}" if moving else at

    def loading_figure(self):
        """Over levels and dynamics: nominal stress against stretch, or, of a general programme, forces against t."""
        from . import figures

        if not self.scene.stretched:
            rows = [{"t": 0.0}, *(row for row in self.history if any(key.startswith("force_") for key in row))]
            columns = list(dict.fromkeys(key for row in rows for key in row if key.startswith("force_")))
            forces = {column.removeprefix("force_"): [row.get(column, 0.0) for row in rows] for column in columns}
            greatest = max((max(map(abs, values)) for values in forces.values()), default=0.0)
            shown = {name: values for name, values in forces.items() if max(map(abs, values)) > 1e-3 * greatest}
            return figures.forces_figure([row["t"] for row in rows], shown, self.summary["units"]["force"])
        rows = [*self.levels, *(row for row in self.history if "time" in row)]
        references = [(level["stretch"], level["nominal_stress_reference"]) for level in self.levels if "nominal_stress_reference" in level]
        stress = [row["nominal_stress"] for row in rows]
        return figures.loading_figure([row["stretch"] for row in rows], stress, references, self.scene.units.stress)


def column_title(column: str, units: Units) -> str:
    """Header of a column of the history: its name, and in brackets its unit where it has one."""
    unit = None
    if column == "time":
        unit = units.time
    elif column == "nominal_stress":
        unit = units.stress
    elif column in ENERGIES or column.startswith("moment_"):
        unit = units.energy
    elif column.startswith("force_"):
        unit = units.force
    elif "_displacement_" in column:
        unit = units.length
    return f"{column} [{unit}]" if unit else column


def _as_csv(rows: list[dict], units: Units) -> str:
    text = io.StringIO()
    if rows:
        # Equilibrium and dynamics fill different columns.
        columns = list(dict.fromkeys(key for row in rows for key in row))
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([column_title(column, units) for column in columns])
        writer.writerows([row.get(column) for column in columns] for row in rows)
    return text.getvalue()
