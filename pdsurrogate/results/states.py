"""Storage of the states that a run records, in memory or in files."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ..body import Body, CellMesh
from . import vtk
from .folder import state_files

Fields = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Moment:
    """Moment of a run at which a state was recorded: stretch or loading parameter, and time.

    Attributes
    ----------
    run_time : float
        Pseudo-time that orders all states of the run: the number of outputs in equilibrium
        without a duration so far, plus `time`. The PVD index has it where the loading parameter
        does not grow from state to state, and where there is a time.
    stretch : float or None
        Distance of the grips divided by its undeformed value, in a scene with grips.
    time : float
        Total time so far of all stages in dynamics, and of those in equilibrium with a duration.
    t : float or None
        Loading parameter of a scene with steps.
    """

    run_time: float
    stretch: float | None = None
    time: float = 0.0
    t: float | None = None


class States:
    """Sequence of the states that a run records, with their fields in memory; ranks other than the
    first keep only their moments.

    Parameters
    ----------
    moments : list of Moment, optional
        Moments of the states that a resumed run has already recorded.
    """

    def __init__(self, moments: list[Moment] | None = None) -> None:
        self.moments = list(moments or [])
        self._kept: list[Fields | Path] = [{} for _ in self.moments]

    in_pieces = False
    """Whether several ranks wrote the fields in pieces, each for its own points."""

    part = sys.maxsize
    """Number of points of the parts in which `append` takes fields."""

    def append(self, moment: Moment, parts: Iterable[Fields]) -> None:
        """Record a state: its moment, and its fields on the points.

        On a rank that stores no fields, every value in the only one of the `parts` is None.
        """
        (fields,) = parts
        self.keep(moment, fields)

    def keep(self, moment: Moment, fields: Fields | Path) -> None:
        """Keep a moment, and the fields on the points or the path of the file that holds them."""
        self.moments.append(moment)
        self._kept.append(fields)

    def __len__(self) -> int:
        return len(self.moments)

    def __getitem__(self, number: int) -> tuple[Moment, Fields]:
        """Return the moment and the fields on the points of a state, by its number; raise
        RuntimeError on a rank that has no fields.
        """
        moment = self.moments[number]
        kept = self._kept[number]
        if isinstance(kept, Path):
            return moment, vtk.StoredFields(kept)
        if kept.get(vtk.DISPLACEMENT) is None:
            raise RuntimeError(
                "the fields of a run on several ranks are available on the first rank only"
            )
        return moment, kept

    def cells(self, number: int) -> tuple[CellMesh, np.ndarray]:
        """Return the cells of the body in a state that was read from a file, and the
        displacements of their nodes, shape (k, d).
        """
        if not any(isinstance(kept, Path) for kept in self._kept):
            raise ValueError("the result contains neither a body nor files with states")
        return vtk.read_cells(self._kept[number])


class StatesInFiles(States):
    """Sequence of the states of a run in VTU files with a PVD index, written when a state is
    recorded, and read when it is accessed.

    If a body is divided among ranks, every rank writes a piece of each state, for its own points.

    Parameters
    ----------
    folder : Path
    name : str
        Stem of the file names.
    body : Body, optional
        Body with the cells to write; if it is divided among ranks, the share of this rank. States
        without a body are only read.
    moments : list of Moment, optional
        Moments of the states that a resumed run has already recorded; files of later states are
        removed.
    """

    def __init__(
        self, folder: Path, name: str, body: Body | None = None, moments: list[Moment] | None = None
    ) -> None:
        super().__init__(moments)
        self.folder = folder
        self.name = name
        self.body = body
        self._kept = [self._path(number) for number in range(len(self.moments))]
        if moments is not None and body.share.is_first:
            self._write_index()
            for number, path in state_files(folder, name):
                if number >= len(moments):
                    path.unlink()

    @classmethod
    def saved(cls, folder: Path, name: str, most: int | None = None) -> StatesInFiles:
        """Return the states in the folder of a run that has ended or was killed.

        Parameters
        ----------
        folder, name
            As for the class.
        most : int, optional
            Greatest number of states to return: the number in the summary of the run, as a killed
            run may have written one more.

        Raises
        ------
        OSError, ValueError
            If the index is not there or cannot be read.
        """
        states = cls(folder, name)
        for path in vtk.read_index(folder / f"{name}.pvd")[:most]:
            states.keep(Moment(**vtk.read_values(path)), path)
        return states

    @property
    def in_pieces(self) -> bool:
        """True if each of several ranks writes a piece of every state."""
        return self.body is not None and self.body.share.divided

    part = 2**16

    def append(self, moment: Moment, parts: Iterable[Fields]) -> None:
        """Write the file of a state, and the index that lists it; an error on one rank is raised
        on all ranks.
        """
        share = self.body.share
        path = self._path(len(self.moments))
        values = {name: value for name, value in asdict(moment).items() if value is not None}
        d = self.body.dimension
        needed: dict[str, list] = {"displacement": [], "deformation_gradient": [], "damage": []}

        def noted() -> Iterator[Fields]:
            end = 0
            for fields in parts:
                for name, found in needed.items():
                    found += [_needed(fields[name], d)] if name in fields else []
                rows = slice(end, end := end + len(fields["displacement"]))
                if self.in_pieces:
                    own = share.own[rows]
                    fields = {name: field[own] for name, field in fields.items()}
                    fields[vtk.NUMBER] = share.numbers[rows][own]
                yield fields

        fields = vtk.pack(noted())
        whole = {name: np.concatenate(needed.pop(name)) for name in [*needed] if needed[name]}
        cells, nodes = deformed_cells(self.body, whole)
        if self.in_pieces:  # the halo was needed for the nodes between pieces
            path = path.with_suffix(".pvtu")
            cells, used = cells.only(share.own)
            nodes = nodes[used]
        with share.ranks.together():
            vtk.write_state(
                _piece(path, share.ranks.rank) if self.in_pieces else path,
                cells,
                nodes,
                fields,
                values,
            )
        self.keep(moment, path)
        with share.ranks.together():
            if self.in_pieces and share.is_first:
                pieces = [_piece(path, rank).name for rank in range(share.ranks.size)]
                vtk.write_pieces(
                    path, pieces, {name: field.components for name, field in fields.items()}
                )
            if share.is_first:
                self._write_index()

    def _write_index(self) -> None:
        # The loading parameter if it alone orders the states: not where it falls or rests, or in
        # dynamics, whose axis is the time.
        times = np.array(
            [moment.stretch if moment.t is None else moment.t for moment in self.moments]
        )
        if any(moment.time for moment in self.moments) or (np.diff(times) <= 0).any():
            times = np.array([moment.run_time for moment in self.moments])
        vtk.write_index(
            self.folder / f"{self.name}.pvd",
            list(zip(times, (path.name for path in self._kept), strict=True)),
        )

    def _path(self, number: int) -> Path:
        """Return the path of the file of a state: a VTU file, or the PVTU file of a state that
        was written in pieces.
        """
        path = self.folder / f"{self.name}-{number:03d}.pvtu"
        return path if path.exists() else path.with_suffix(".vtu")


def _piece(path: Path, rank: int) -> Path:
    return path.with_suffix(f".piece{rank}.vtu")


def _needed(values: np.ndarray, dimension: int) -> np.ndarray:
    """Return the components of a vector (n, 3) or tensor (n, 9) in so many dimensions, the latter
    in single precision, since they move the nodes of a cell by little beside its point.
    """
    if values.shape[1:] == (3,):
        return values[:, :dimension].copy()
    if values.shape[1:] == (9,):
        kept = values.reshape(-1, 3, 3)[:, :dimension, :dimension]
        return kept.astype(np.float32).reshape(len(kept), -1)
    return values


def deformed_cells(body: Body, fields: Fields) -> tuple[CellMesh, np.ndarray]:
    """Return the cells of a body in a state, and the displacements of their nodes, shape (k, d).

    Along open cracks the nodes are duplicated, so that the cells on the two sides are separate.

    Parameters
    ----------
    body : Body
    fields : dict of ndarray
        Fields of the state by name, among them displacement and deformation gradient.
    """
    d = body.dimension
    cells = body.cells
    F = _needed(fields["deformation_gradient"], d).reshape(-1, d, d)
    state = body.points, _needed(fields["displacement"], d), F
    damaged = fields.get("damage", np.zeros(len(body))) > 0

    def parted(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        broken = damaged[one] & damaged[other]
        return (
            broken
            if body.separates is None
            else broken | body.separates(body.points[one], body.points[other])
        )

    # Neighbors can separate only where bonds are cut or break.
    if damaged.any() or body.separates is not None:
        cells = cells.torn(*state, parted)
    return cells, cells.moved(*state)
