"""Storage of the states that a run records, in memory or in files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from ..body import Body, CellMesh
from .deformed import deformed_cells
from .folder import is_marked, state_files

Fields = dict[str, np.ndarray]


@dataclass(frozen=True)
class Moment:
    """When a state was.

    Attributes
    ----------
    run_time : float
        Place on the one axis of the whole run, on which states follow each other: 1 at the first level in equilibrium, 2 at the second,
        and so on; from the last level on the time of the dynamics is added.
    stretch : float or None
        Of a scene with grips.
    time : float
        That all dynamics have taken; 0 at a level before them.
    t : float or None
        Loading parameter of a scene with steps.
    """

    run_time: float
    stretch: float | None
    time: float
    t: float | None = None


class States(Protocol):
    """Recorded states in order: pairs of a moment and the fields on the points."""

    moments: list[Moment]

    def append(self, moment: Moment, fields: Fields) -> None:
        """Record a state."""

    def __len__(self) -> int: ...

    def __getitem__(self, number: int) -> tuple[Moment, Fields]: ...

    def __iter__(self) -> Iterator[tuple[Moment, Fields]]: ...


class StatesInMemory(list):
    """States kept in memory."""

    @property
    def moments(self) -> list[Moment]:
        """Moments of the states."""
        return [moment for moment, _ in self]

    def append(self, moment: Moment, fields: Fields) -> None:
        """Record a state."""
        super().append((moment, fields))


class Moments:
    """Moments alone, on ranks other than the first: what was recorded then is there."""

    def __init__(self, moments: list[Moment] | None = None) -> None:
        self.moments = list(moments or [])

    def append(self, moment: Moment, fields: Fields) -> None:
        """Record when a state was."""
        self.moments.append(moment)

    def __len__(self) -> int:
        return len(self.moments)

    def __getitem__(self, number: int) -> tuple[Moment, Fields]:
        raise IndexError("the fields of a run on several ranks are on the first of them")

    def __iter__(self) -> Iterator[tuple[Moment, Fields]]:
        raise IndexError("the fields of a run on several ranks are on the first of them")


def state_path(folder: Path, name: str, number: int) -> Path:
    """File of a state: a VTU, but where it was written in pieces, as by a run on several ranks."""
    path = folder / f"{name}-{number:03d}.pvtu"
    return path if path.exists() else path.with_suffix(".vtu")


def write_index_of(folder: Path, name: str, moments: list[Moment]) -> None:
    """Write the PVD of a scene's states."""
    from . import vtk

    entries = [(moment.run_time, state_path(folder, name, number).name) for number, moment in enumerate(moments)]
    vtk.write_index(folder / f"{name}.pvd", entries)


def remove_later(folder: Path, name: str, count: int) -> None:
    """Remove the files of states beyond the first `count` that a run wrote."""
    for number, path in state_files(folder, name):
        if number >= count and is_marked(path):
            path.unlink()


class StatesInFiles:
    """States that are written as a VTU series with a PVD index when they are reached, and read back when they are used.

    Parameters
    ----------
    folder : Path
    body : Body
        Whose cells are written.
    name : str
        Stem of the file names.
    moments : list of Moment
        States that are there already, of a run that is resumed; files of later ones are removed.
    """

    def __init__(self, folder: Path, body: Body, name: str, moments: list[Moment] | None = None) -> None:
        self.folder, self.body, self.name = folder, body, name
        self.moments = list(moments or [])
        if moments is not None:
            self._write_index()
            remove_later(folder, name, len(moments))

    def append(self, moment: Moment, fields: Fields) -> None:
        """Write a state, and the index with it."""
        from . import vtk

        values = {name: value for name, value in asdict(moment).items() if value is not None}
        cells, nodes = deformed_cells(self.body, fields)
        vtk.write_state(self._path(len(self.moments)), cells, nodes, fields, values)
        self.moments.append(moment)
        self._write_index()

    def _write_index(self) -> None:
        write_index_of(self.folder, self.name, self.moments)

    def _path(self, number: int) -> Path:
        return state_path(self.folder, self.name, number)

    def __len__(self) -> int:
        return len(self.moments)

    def __getitem__(self, number: int) -> tuple[Moment, Fields]:
        from . import vtk

        number = range(len(self.moments))[number]
        return self.moments[number], vtk.read_fields(self._path(number))

    def __iter__(self) -> Iterator[tuple[Moment, Fields]]:
        return (self[number] for number in range(len(self)))


class StatesInPieces:
    """States of a body that is divided among ranks, written by each of them for its own points, with one index.

    Parameters
    ----------
    folder : Path
    body : Body
        The part of this rank, of cells of a lattice; of the points around its own it knows the fields as well.
    name, moments
        As for `StatesInFiles`.
    """

    def __init__(self, folder: Path, body: Body, name: str, moments: list[Moment] | None = None) -> None:
        self.folder, self.body, self.name = folder, body, name
        self.moments = list(moments or [])
        if moments is not None and body.share.ranks.rank == 0:
            self._write_index()
            remove_later(folder, name, len(moments))

    def append(self, moment: Moment, fields: Fields) -> None:
        """Write a state, every rank its piece, and the index with it; a rank that cannot ends it for all."""
        from . import vtk

        share, number = self.body.share, len(self.moments)
        path = self.folder / f"{self.name}-{number:03d}.pvtu"
        values = {name: value for name, value in asdict(moment).items() if value is not None}
        cells, nodes = deformed_cells(self.body, fields)  # with those around the rank's own, which say where the common nodes are
        cells, used = cells.only(share.own)
        fields = {name: field[share.own] for name, field in fields.items()} | {vtk.NUMBER: share.numbers[share.own]}
        with _for_all(share):
            vtk.write_state(self._piece(path, share.ranks.rank), cells, nodes[used], fields, values)
        self.moments.append(moment)
        with _for_all(share):
            if share.ranks.rank == 0:
                pieces = [self._piece(path, rank).name for rank in range(share.ranks.size)]
                vtk.write_pieces(path, pieces, {name: field[:1].size for name, field in fields.items()})
                self._write_index()

    @staticmethod
    def _piece(path: Path, rank: int) -> Path:
        return path.with_suffix(f".piece{rank}.vtu")

    def _write_index(self) -> None:
        write_index_of(self.folder, self.name, self.moments)

    def __len__(self) -> int:
        return len(self.moments)

    def __getitem__(self, number: int) -> tuple[Moment, Fields]:
        from . import vtk

        number = range(len(self.moments))[number]
        return self.moments[number], vtk.read_fields(state_path(self.folder, self.name, number))

    def __iter__(self) -> Iterator[tuple[Moment, Fields]]:
        return (self[number] for number in range(len(self)))


@contextmanager
def _for_all(part) -> Iterator[None]:
    """Run a block that writes on every rank, and raise the error of one rank on all of them."""
    error = None
    try:
        yield
    except OSError as found:
        error = found
    part.agree(error)


class SavedStates:
    """States of a run that has ended, or was killed, read from its files when they are used.

    Parameters
    ----------
    folder : Path
    name : str
        Stem of the file names.
    most : int, optional
        States that the run told of; a later one was not told of yet when it was killed.

    Raises
    ------
    OSError, ValueError
        If the index is not there or cannot be read.
    """

    def __init__(self, folder: Path, name: str, most: int | None = None) -> None:
        from . import vtk

        self.folder = folder
        self._paths, self.moments = [], []
        for run_time, path in vtk.read_index(folder / f"{name}.pvd")[:most]:
            values = vtk.read_values(path)
            self._paths.append(path)
            self.moments.append(Moment(run_time, values.get("stretch"), values.get("time", 0.0), values.get("t")))

    def __len__(self) -> int:
        return len(self.moments)

    def __getitem__(self, number: int) -> tuple[Moment, Fields]:
        from . import vtk

        return self.moments[number], vtk.read_fields(self._paths[number])

    def __iter__(self) -> Iterator[tuple[Moment, Fields]]:
        return (self[number] for number in range(len(self)))

    def cells(self, number: int) -> tuple[CellMesh, np.ndarray]:
        """Cells of a state, and the displacements of their nodes."""
        from . import vtk

        return vtk.read_cells(self._paths[number])
