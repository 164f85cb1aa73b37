"""Cells at the boundary of a body: cut there, and as large as the volumes of their points."""

import numpy as np
import pytest
import pyvista

import pdsurrogate as pds
from pdsurrogate.body import CellMesh
from pdsurrogate.discretization import discretize

TYPES = {2: pyvista.CellType.QUAD, 3: pyvista.CellType.HEXAHEDRON}


def body_of(name, spacing):
    return discretize(pds.load_scene(name, spacing=spacing))[0]


def grid_of(body):
    nodes = np.pad(body.cells.nodes, ((0, 0), (0, 3 - body.dimension)))
    return pyvista.UnstructuredGrid({TYPES[body.dimension]: body.cells.blocks[0]}, nodes)


@pytest.mark.parametrize(
    ("name", "spacing"),
    [
        *(
            ("hole", 0.1),
            ("hole", 0.25),
            ("disc-torsion", 0.1),
            ("ring-pressure", 0.3),
            ("voids", 0.15),
            ("biaxial-hole", 0.1),
        ),
        *(("penny", 0.2), ("inflation", 0.125)),
    ],
)
def test_every_cell_has_the_volume_of_its_point(name, spacing):
    """By the measures of VTK: cell by cell in the plane, and its integral, in which ParaView's
    has hexahedra of five tetrahedra.
    """
    body = body_of(name, spacing)
    lattice = CellMesh.of_lattice(body.points, body.volumes, np.asarray(body.cell))
    assert np.ptp(body.volumes) > 0.3 * np.prod(body.cell)
    assert body.cells.nodes.shape == lattice.nodes.shape
    for number in (
        range(0, len(body), max(1, len(body) // 40)) if body.dimension == 3 else [slice(None)]
    ):
        grid = grid_of(body).extract_cells(np.arange(len(body))[number])
        size = grid.integrate_data()[{2: "Area", 3: "Volume"}[body.dimension]]
        np.testing.assert_allclose(size, body.volumes[number].sum(), rtol=1e-9)
    if body.dimension == 2:
        np.testing.assert_allclose(
            grid_of(body).compute_cell_sizes()["Area"], body.volumes, rtol=1e-9
        )


def test_outer_corners_lie_on_the_outline():
    body = body_of("hole", 0.1)
    outer = body.cells.nodes[np.unique(body.cells.outer_sides[0])]
    radius = np.linalg.norm(outer, axis=1)
    at_hole = radius < 1.0
    assert at_hole.sum() > 24
    np.testing.assert_allclose(radius[at_hole], 0.4, atol=0.06 * 0.1)
    off = np.abs(outer[~at_hole])
    assert (np.isclose(off[:, 0], 1.5, atol=1e-12) | np.isclose(off[:, 1], 2.0, atol=1e-12)).all()
    # A square lattice within: far from the hole nothing has moved.
    far = np.linalg.norm(body.cells.nodes, axis=1) > 1.0
    np.testing.assert_allclose(
        body.cells.nodes[far] % 0.1, np.round(body.cells.nodes[far] % 0.1, 1), atol=1e-9
    )


@pytest.mark.parametrize(
    "holes", [(), ({"shape": "rectangle", "lower": (0.5, 0.25), "size": (0.5, 0.5)},)]
)
def test_cells_along_the_lattice_are_left_whole(holes):
    scene = pds.load_scene("uniaxial", {"spacing": 0.25, "holes": holes})
    body = discretize(scene)[0]
    np.testing.assert_allclose(body.cells.nodes % 0.25, 0, atol=1e-12)
    np.testing.assert_allclose(grid_of(body).compute_cell_sizes()["Area"], 0.0625, rtol=1e-12)
