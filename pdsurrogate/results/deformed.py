"""The cells of a body as they lie in a recorded state."""

from __future__ import annotations

import numpy as np

from ..body import Body, CellMesh


def deformed_cells(body: Body, fields: dict[str, np.ndarray]) -> tuple[CellMesh, np.ndarray]:
    """Cells of a body, apart where a crack is open, and the displacements of their nodes, shape (k, d).

    Parameters
    ----------
    body : Body
    fields : dict of ndarray
        Of a state, see `pdsurrogate.results.measures.POINT_FIELDS`; displacement and deformation gradient are read.
    """
    d, cells = body.dimension, body.cells
    F = fields["deformation_gradient"].reshape(-1, 3, 3)[:, :d, :d]
    state = body.points, fields["displacement"][:, :d], F
    # Only where bonds are cut or break can neighbours come apart.
    if np.any(fields.get("damage", 0)) or body.separates is not None:
        cells = cells.torn(*state)
    return cells, cells.moved(*state)
