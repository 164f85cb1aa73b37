"""Elements and groups of a mesh file, and what of it is left out, told before a scene uses it."""

from __future__ import annotations

import warnings
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..body.cell_mesh import numbers_in
from .mesh_cells import sizes_of
from .mesh_files import contents_of, in_body, kinds_of
from .mesh_groups import MeshFile

SOLIDS = ("tetra", "hexahedron", "wedge", "pyramid")
"""First letters of meshio's names of solid cells."""


@dataclass(frozen=True)
class MeshFacts:
    """Elements and groups of a mesh file, and the body that its cells make.

    Attributes
    ----------
    form : str
        Form of the file.
    elements : mapping of str to int
        Counts of all elements of the file, by type.
    mesh : MeshFile
        Cells and groups of the body.
    remarks : tuple of str
        Parts of the file that are left out, and repairs and assumptions.
    """

    form: str
    elements: dict[str, int]
    mesh: MeshFile
    remarks: tuple[str, ...]

    def summary(self) -> dict[str, Any]:
        """Return the facts of the body: dimension, cells, nodes, size (area or volume), the corners
        of the bounding box and the spacing of points.
        """
        cells = self.mesh.cells
        kept = np.ones(len(cells), dtype=bool)
        used = cells.only(kept)[0].nodes
        volumes = self.mesh.centroids[1]
        return {
            "dimension": cells.dimension,
            "cells": len(cells),
            "nodes": len(used),
            "volume" if cells.dimension == 3 else "area": float(volumes.sum()),
            "lower": used.min(axis=0).tolist(),
            "upper": used.max(axis=0).tolist(),
            "spacing": sizes_of(self.mesh.corners(), kept, volumes)[0],
        }

    def groups(self) -> list[dict[str, Any]]:
        """Return a row for each group: its name, whether it lists cells or sides of cells, and
        counts of its cells (points of the body), of its sides, and of the nodes of what it lists.
        """
        mesh = self.mesh
        faces = mesh.cells.faces[0]
        own, *groups = numbers_in(faces, *mesh.side_groups.values())
        listed = dict(zip(mesh.side_groups, groups, strict=True))
        rows = []
        for name, members in mesh.groups_of_cells().items():
            if name in listed:
                sides = faces[np.isin(own, listed[name])]
                counts = {"sides": len(sides), "nodes": len(np.unique(sides))}
            else:
                chosen = np.isin(np.arange(len(mesh.cells)), members)
                counts = {"sides": 0, "nodes": len(mesh.cells.only(chosen)[1])}
            of = "sides" if name in listed else "cells"
            rows.append({"group": name, "lists": of, "cells": len(members), **counts})
        return rows


def describe_mesh(file: str | Path) -> MeshFacts:
    """Return the facts of a mesh file, for a body of its cells of the highest dimension.

    Parameters
    ----------
    file : str or Path
        Mesh file.

    Raises
    ------
    ValueError
        If the file cannot be read, or makes no body.
    """
    path = Path(file)
    if not path.is_file():
        raise ValueError(f"the file {file} does not exist")
    try:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            contents = contents_of(str(path))
            solid = any(kind.startswith(SOLIDS) for kind in kinds_of(contents))
            mesh = in_body(str(path), contents, 3 if solid else 2)
    except ValueError as error:
        raise ValueError(str(error).removeprefix("body.file: ")) from None
    elements: Counter[str] = Counter()
    for each in contents.elements:
        elements[each.type or each.kind] += len(each.numbers)
    remarks = tuple(str(each.message).removeprefix("body.file: ") for each in told)
    return MeshFacts(_form(path), dict(elements), mesh, remarks)


def _form(path: Path) -> str:
    """Return the form of a mesh file in words."""
    if path.suffix.lower() == ".inp":
        return "Abaqus or CalculiX deck"
    with path.open("rb") as file:
        head = file.read(40).split()
    return f"gmsh {head[1].decode()}" if head[:1] == [b"$MeshFormat"] else f"{path.suffix} file"
