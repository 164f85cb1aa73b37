"""VTU files with a PVD index, for ParaView."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

import meshio
import numpy as np

from .files import write_text, write_with


def write_series(folder: Path, points: np.ndarray, states: list[tuple[float, dict[str, np.ndarray]]], name: str) -> None:
    """Write one VTU a state and a PVD that lists them with their times (here, the stretch).

    Points are vertices at their reference positions; warp by ``displacement`` to see the deformed body.

    Parameters
    ----------
    folder : Path
    points : ndarray, shape (n, 2)
    states : list of (time, fields)
    name : str
        Stem of the file names.
    """
    coordinates = np.column_stack([points, np.zeros(len(points))])
    cells = [("vertex", np.arange(len(points))[:, None])]
    entries = []
    for number, (time, fields) in enumerate(states):
        file = f"{name}-{number:03d}.vtu"
        mesh = meshio.Mesh(coordinates, cells, point_data=fields)
        write_with(folder / file, lambda path, mesh=mesh: meshio.write(path, mesh, file_format="vtu"))
        entries.append(f'    <DataSet timestep="{time:.17g}" part="0" file={quoteattr(file)}/>')
    text = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n  <Collection>\n'
    write_text(folder / f"{name}.pvd", text + "\n".join(entries) + "\n  </Collection>\n</VTKFile>\n")
