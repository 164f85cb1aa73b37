"""Where the states that a run records go: memory, or files as they are reached."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

Fields = dict[str, np.ndarray]


class States(Protocol):
    """Recorded states in order: pairs of a time (or stretch) and the fields on the points."""

    times: list[float]

    def append(self, time: float, fields: Fields) -> None:
        """Record a state."""

    def __len__(self) -> int: ...

    def __getitem__(self, number: int) -> tuple[float, Fields]: ...

    def __iter__(self) -> Iterator[tuple[float, Fields]]: ...


class StatesInMemory(list):
    """States kept in memory."""

    @property
    def times(self) -> list[float]:
        """Times of the states."""
        return [time for time, _ in self]

    def append(self, time: float, fields: Fields) -> None:
        """Record a state."""
        super().append((time, fields))


class StatesInFiles:
    """States written as a VTU series with its PVD index the moment they are reached, and read back when asked for.

    Parameters
    ----------
    folder : Path
    points : ndarray, shape (n, 2)
        Reference positions.
    name : str
        Stem of the file names.
    times : list of float
        States that are there already, of a run that is resumed.
    """

    def __init__(self, folder: Path, points: np.ndarray, name: str, times: list[float] | None = None) -> None:
        self.folder, self.points, self.name = folder, points, name
        self.times = list(times or [])

    def append(self, time: float, fields: Fields) -> None:
        """Write a state, and the index with it."""
        from . import vtk

        vtk.write_state(self._path(len(self.times)), self.points, fields)
        self.times.append(time)
        vtk.write_index(self.folder / f"{self.name}.pvd", [(time, self._path(n).name) for n, time in enumerate(self.times)])

    def _path(self, number: int) -> Path:
        return self.folder / f"{self.name}-{number:03d}.vtu"

    def __len__(self) -> int:
        return len(self.times)

    def __getitem__(self, number: int) -> tuple[float, Fields]:
        import meshio

        number = range(len(self.times))[number]
        return self.times[number], dict(meshio.read(self._path(number)).point_data)

    def __iter__(self) -> Iterator[tuple[float, Fields]]:
        return (self[number] for number in range(len(self)))
