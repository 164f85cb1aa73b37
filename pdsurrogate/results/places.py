"""Displacements of a result at places between its points, and displacements measured there."""

from pathlib import Path

import numpy as np
import scipy

from ..body import CellMesh
from .files import write_text
from .states import Fields
from .tables import as_csv, read_table

MEASURED = "measured.csv"
"""Name of the file with measured displacements in the folder of a run."""


def cells_at(cells: CellMesh, points: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the number of the undeformed cell around each place, shape (m,), -1 outside; of solids
    that of the nearest of the `points`, shape (n, d).
    """
    if cells.dimension == 3:
        return scipy.spatial.cKDTree(points).query(places)[1]
    import shapely

    polygons = np.concatenate([shapely.polygons(cells.nodes[block]) for block in cells.blocks])
    found = np.full(len(places), -1)
    at, number = shapely.STRtree(polygons).query(shapely.points(places), predicate="intersects")
    found[at] = number
    return found


def displacements_at(fields: Fields, number: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the displacements of a state at places, shape (m, d), which cells extrapolate linearly
    from their points; NaN where the `number` of the cell is -1.
    """
    d = places.shape[1]
    changes = fields["deformation_gradient"].reshape(-1, 3, 3)[number, :d, :d] - np.eye(d)
    away = places - fields["position"][number, :d]
    moved = fields["displacement"][number, :d] + np.einsum("nij,nj->ni", changes, away)
    moved[number < 0] = np.nan
    return moved


def write_measured(path: Path, steps: np.ndarray, places: np.ndarray, moved: np.ndarray) -> None:
    """Write measured displacements (m, d) of places (m, d) in steps (m,) as CSV."""
    names = _columns(places.shape[1])
    table = np.column_stack([steps, places, moved])
    write_text(path, as_csv([dict(zip(names, row, strict=True)) for row in table.tolist()]))


def read_measured(path: Path, d: int) -> np.ndarray | None:
    """Return the rows of a file of measured displacements, columns step, places and displacements,
    None if there is no file; raise ValueError if a column or an entry is missing.
    """
    rows = read_table(path)
    try:
        table = np.array([[row[name] for name in _columns(d)] for row in rows], dtype=float)
    except (KeyError, ValueError):
        needed = ", ".join(_columns(d))
        raise ValueError(f"{path}: each row needs numbers in the columns {needed}") from None
    return table if rows else None


def _columns(d: int) -> list[str]:
    return ["step", *(f"{name}{axis}" for name in "xu" for axis in range(1, d + 1))]
