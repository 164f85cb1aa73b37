"""Displacements of a result at places between its points: of measurements, of pixels."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy

from ..body import CellMesh
from .files import replacing
from .measures import scalars_of
from .states import Fields

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


def columns_of_measured(d: int) -> list[str]:
    """Return the columns of files of measured displacements: step, places and displacements."""
    return ["step", *(f"{name}{axis + 1}" for name in "xu" for axis in range(d))]


def read_measured(path: Path, d: int) -> np.ndarray | None:
    """Return the rows of a file of measured displacements, shape (m, 1 + 2 d), with NaN for empty
    entries, None if there is no file; raise ValueError if its columns are others.
    """
    if not path.exists():
        return None
    columns = columns_of_measured(d)
    with path.open(encoding="utf-8") as file:
        if file.readline().strip() != ",".join(columns):
            raise ValueError(f"{path}: the columns must be {','.join(columns)}")
        lines = [line for line in file if line.strip()]
    if not lines:
        raise ValueError(f"{path}: there are no rows")
    try:
        return np.loadtxt(
            lines, delimiter=",", ndmin=2, converters=lambda entry: float(entry.strip() or "nan")
        )
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def write_columns(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns of numbers by their headings as CSV, whole or not at all."""
    with replacing(path) as temporary:
        table = np.column_stack([*columns.values()])
        np.savetxt(temporary, table, "%.10g", ",", header=",".join(columns), comments="")


def pixel_grid(
    result, pixels: float, origin: tuple[float, float], fields: Sequence[str]
) -> dict[str, np.ndarray]:
    """Return the displacements of a sheet at the pixels of the image of its undeformed state.

    Parameters
    ----------
    result : Result
    pixels : float
        Number of pixels in the unit of length of the scene.
    origin : tuple of float
        Pixel, column and row, at which the origin of the scene is.
    fields : sequence of str
        Fields to add, as for `Result.plot`.

    Returns
    -------
    dict of ndarray
        ``x`` and ``y``: columns and rows, from 0, whose centers are at whole numbers; ``u`` to the
        right and ``v`` down in pixels, shape (outputs, rows, columns), NaN outside the body; and
        the fields, in the units of the scene.

    Raises
    ------
    ValueError
        If the body is a solid, or a part of it is left of the image or above it.
    """
    if result.scene.dimension == 3:
        raise ValueError("a solid has no field on the pixels of an image")
    cells = result.cells(-1)[0]
    down = np.array([1.0, -1.0])
    corners = np.asarray(origin) + pixels * down * cells.nodes
    low, high = corners.min(axis=0), corners.max(axis=0)
    if low.min() < -0.5:
        raise ValueError(
            f"the body begins at column {low[0]:.0f} and row {low[1]:.0f}, outside the image: the"
            " origin is the pixel (column, row) of the origin of the scene, and rows count down"
        )
    x, y = (np.arange(int(end + 1e-9) + 1) for end in high)
    places = (np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) - origin) * down / pixels
    number = cells_at(cells, result.field("position")[:, :2], places)
    states = []
    for _, known in result.states:
        moved = displacements_at(known, number, places) * down * pixels
        others = [np.where(number < 0, np.nan, scalars_of(known, f)[number]) for f in fields]
        states.append([*moved.T, *others])
    found = np.moveaxis(np.reshape(states, (len(states), -1, len(y), len(x))), 1, 0)
    return {"x": x, "y": y, **dict(zip(("u", "v", *fields), found, strict=True))}
