"""VTU files with a PVD index, for ParaView."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

import meshio
import numpy as np

from .files import write_text, write_with


def write_state(path: Path, points: np.ndarray, fields: dict[str, np.ndarray], values: dict[str, float]) -> None:
    """Write the fields of one state, and single values as field data.

    Points are vertices at their reference positions; warp by ``displacement`` to see the deformed body.

    Parameters
    ----------
    path : Path
    points : ndarray, shape (n, 2)
    fields : dict of ndarray, each of shape (n,) or (n, k)
    values : dict of float
    """
    coordinates = np.column_stack([points, np.zeros(len(points))])
    mesh = meshio.Mesh(coordinates, [("vertex", np.arange(len(points))[:, None])], point_data=fields)

    def write(temporary: Path) -> None:
        meshio.write(temporary, mesh, file_format="vtu")
        # meshio reads field data from VTU files and does not write them.
        head, grid, rest = temporary.read_text("utf-8").partition("<UnstructuredGrid>")
        arrays = "".join(
            f'<DataArray type="Float64" Name={quoteattr(name)} NumberOfTuples="1" format="ascii">{value:.17g}</DataArray>'
            for name, value in values.items()
        )
        temporary.write_text(f"{head}{grid}<FieldData>{arrays}</FieldData>{rest}", encoding="utf-8")

    write_with(path, write)


def write_index(path: Path, entries: list[tuple[float, str]]) -> None:
    """Write a PVD that lists VTU files with their times."""
    lines = [f'    <DataSet timestep="{time:.17g}" part="0" file={quoteattr(file)}/>' for time, file in entries]
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n  <Collection>\n'
    write_text(path, head + "\n".join(lines) + "\n  </Collection>\n</VTKFile>\n")
