"""Fields on the points against tensors of homogeneous states, and the cells that pictures and
files show.
"""

import re

import meshio
import numpy as np
import pytest
from bodies import rotation, sheet
from commands import commanded
from matplotlib import image

import pdsurrogate as pds
from pdsurrogate.discretization.cells import lattice_of
from pdsurrogate.materials import plane_strain, plane_stress, solid
from pdsurrogate.results import measures, vtk
from pdsurrogate.results.states import deformed_cells

LAW = pds.materials.NeoHookean(2.0, 200.0)
F2 = np.array([[1.25, 0.2], [-0.1, 0.9]])
F3 = np.array([[1.2, 0.1, 0.05], [0.0, 0.95, 0.2], [0.1, -0.05, 0.9]])


def cube(count=6):
    spacing = 1 / count
    along = (np.arange(count) + 0.5) * spacing
    points = lattice_of(along, along, along)
    return pds.Body(points, np.full(len(points), spacing**3), 1.75 * spacing, spacing)


def fields_of(name, body, positions, plane):
    force = pds.load_surrogate(name).bind(
        body, LAW, pds.ForceSettings(plane=plane, precision="float64")
    )
    return measures.point_fields(measures.PointState(force, positions))


CASES = [
    ("analytic", "stress"),
    ("bond-energy", "stress"),
    ("nosb", "strain"),
    ("bond-energy", "strain"),
    ("nosb", "space"),
]


@pytest.mark.parametrize(("name", "plane"), [*CASES, ("bond-energy", "space")])
def test_fields_of_a_homogeneous_state(name, plane):
    """Whatever the force, all fields are those of one F, to rounding: stresses by the definition
    of each from the law's own.
    """
    body, F, module = (
        (cube(), F3, solid)
        if plane == "space"
        else (sheet(), F2, {"stress": plane_stress, "strain": plane_strain}[plane])
    )
    fields = fields_of(name, body, body.points @ F.T, plane)
    full = np.eye(3)
    full[: len(F), : len(F)] = F
    if plane == "stress":
        full[2, 2] = plane_stress.volume_ratio(LAW, *plane_stress.invariants(F)) / np.linalg.det(F)
    P, J = solid.first_piola_stress(LAW, full), np.linalg.det(full)
    sigma = P @ full.T / J
    deviator = sigma - np.trace(sigma) / 3 * np.eye(3)
    expected = {
        "deformation_gradient": full.ravel(),
        "stress": P.ravel(),
        "cauchy_stress": sigma.ravel(),
        "volume_ratio": J,
        "principal_stretches": np.sqrt(np.linalg.eigvalsh(full.T @ full))[::-1],
        "principal_stretch": np.sqrt(np.linalg.eigvalsh(F.T @ F))[-1],
        "pressure": -np.trace(sigma) / 3,
        "von_mises": np.sqrt(1.5) * np.linalg.norm(deviator),
        "energy_density": module.energy_density(LAW, F),
        "volume": body.volumes,
    } | ({} if plane == "space" else {"C33": full[2, 2] ** 2})
    for key, value in expected.items():
        np.testing.assert_allclose(
            fields[key], np.broadcast_to(value, fields[key].shape), atol=2e-9, err_msg=key
        )
    np.testing.assert_array_equal(fields["position"][:, : len(F)], body.points)
    assert set(fields) == {*expected, "position", "displacement"}


def test_stress_and_energy_are_those_of_the_learned_energy_that_ran():
    """Its card states errors of some 1e-5: closer to its own derivative than to the law; far
    outside, the exact energy has the word.
    """
    body, model = sheet(), pds.load_surrogate("neo-hookean-energy")
    trace, J = (np.array([value]) for value in plane_stress.invariants(F2))
    own = model.energy_derivatives(LAW, trace, J)
    fields = fields_of(model.name, body, body.points @ F2.T, "stress")
    P = (
        LAW.shear_modulus
        * plane_stress.in_plane_stress(F2[None], 2 * own.by_trace, J * own.by_area)[0]
    )
    np.testing.assert_allclose(
        fields["stress"].reshape(-1, 3, 3)[:, :2, :2],
        np.broadcast_to(P, (len(body), 2, 2)),
        atol=1e-10,
    )
    np.testing.assert_allclose(fields["energy_density"], LAW.shear_modulus * own.psi[0], rtol=1e-11)
    assert (fields["energy_density"] != plane_stress.energy_density(LAW, F2)).all()
    assert fields["domain_deviation"].max() < 0

    greatest = model.domain.greatest_stretch
    far = np.diag([1.1 * greatest, 1.0])
    fields = fields_of(model.name, body, body.points @ far.T, "stress")
    np.testing.assert_allclose(fields["domain_deviation"], np.log(1.1), rtol=1e-9)
    np.testing.assert_allclose(
        fields["energy_density"], plane_stress.energy_density(LAW, far), rtol=1e-9
    )


def anywhere(one, other):
    """Flags of neighbors between which a crack may open: all of them."""
    return np.ones(len(one), dtype=bool)


@pytest.mark.parametrize("body", [sheet(), cube()], ids=["plane", "space"])
def test_corners_of_cells_follow_an_affine_motion(body):
    cells, d = body.cells, body.dimension
    F = F3[:d, :d]
    state = body.points, body.points @ (F - np.eye(d)).T, np.broadcast_to(F, (len(body), d, d))
    np.testing.assert_allclose(cells.moved(*state), cells.nodes @ (F - np.eye(d)).T, atol=1e-13)
    assert cells.torn(*state, anywhere) is cells
    np.testing.assert_allclose(cells.nodes[cells.blocks[0]].mean(axis=1), body.points, atol=1e-13)
    np.testing.assert_allclose(
        [cells.nodes.min(), cells.nodes.max(axis=0)[-1]],
        [0, body.points[:, -1].max() + body.cell[-1] / 2],
        atol=1e-13,
    )


def test_an_open_crack_has_two_flanks():
    """A block in the corner of a cube moves up and aside: nodes on its inner sides are double,
    on the edges of the crack as well.
    """
    body = cube(6)
    moving = (body.points < 0.5).all(axis=1)
    displacement, gradients = (
        np.where(moving[:, None], -0.2, 0.0) * np.ones(3),
        np.broadcast_to(np.eye(3), (len(body), 3, 3)),
    )
    state = body.points, displacement, gradients
    assert body.cells.torn(*state, lambda one, other: one < 0) is body.cells
    cells = body.cells.torn(*state, anywhere)
    assert len(cells.nodes) - len(body.cells.nodes) == 4**3 - 3**3
    np.testing.assert_allclose(np.unique(cells.moved(*state).round(12)), [-0.2, 0.0])


@pytest.mark.parametrize("body", [sheet(), cube()], ids=["plane", "space"])
def test_a_file_holds_cells_and_gives_the_fields_back(tmp_path, body):
    d = body.dimension
    F = F3[:d, :d] @ (rotation(0.3) if d == 2 else np.eye(3))
    plane = "stress" if d == 2 else "space"
    fields = fields_of("nosb", body, body.points @ F.T, plane)
    rows = slice(0, 7), slice(7, None)
    parts = [{name: values[some] for name, values in fields.items()} for some in rows]
    state = *deformed_cells(body, fields), vtk.pack(parts)
    vtk.write_state(tmp_path / "state.vtu", *state, {"t": 0.5})
    found = vtk.StoredFields(tmp_path / "state.vtu")
    assert set(found) == set(fields)
    for name, values in fields.items():
        assert found[name].dtype == (np.float64 if name in vtk.EXACT else np.float32)
        np.testing.assert_allclose(found[name], values, rtol=1e-6, atol=1e-6)
    mesh = meshio.read(tmp_path / "state.vtu")
    assert [(block.type, len(block)) for block in mesh.cells] == [
        ("quad" if d == 2 else "hexahedron", len(body))
    ]
    np.testing.assert_allclose(
        (mesh.points + mesh.point_data["displacement"])[:, :d], mesh.points[:, :d] @ F.T, atol=1e-6
    )


def test_a_scene_in_space_has_files_pictures_and_tables(tmp_path):
    """Mesh of tetrahedra, general way: outputs, probes and a picture."""
    cells = cube(3).cells
    split = ((0, 1, 3, 4), (1, 2, 3, 6), (1, 4, 5, 6), (3, 4, 6, 7), (1, 3, 4, 6))
    blocks = [("tetra", np.concatenate([cells.blocks[0][:, list(corners)] for corners in split]))]
    meshio.write(tmp_path / "cube.vtu", meshio.Mesh(cells.nodes, blocks))
    (tmp_path / "pulled.toml").write_text("""
        name = "pulled"
        spacing = 0.2
        probes = [{ name = "middle", at = [0.5, 0.5, 0.5] }]
        material = { law = "neo-hookean", bulk_modulus = 10.0 }
        [body]
        shape = "mesh"
        file = "cube.vtu"
        dimension = 3
        [[prescribed]]
        region = "left"
        x1 = 0.0
        x2 = 0.0
        x3 = 0.0
        [[prescribed]]
        region = "right"
        x1 = 0.05
        x2 = 0.0
        x3 = 0.0
        [[steps]]
        to = 1.0
        """)
    ended = commanded("run", tmp_path / "pulled.toml", "--out", tmp_path / "out")
    assert re.search(r"\nmiddle +1( +\S+){3}\n", ended.output)
    header = (tmp_path / "out" / "history.csv").read_text().splitlines()[0]
    assert {"force_right_3", "moment_right_3", "middle_displacement_3"} <= {
        column.split(" [")[0] for column in header.split(",")
    }
    mesh = meshio.read(tmp_path / "out" / "pulled-000.vtu")
    assert [(block.type, len(block)) for block in mesh.cells] == [("tetra", 135)]
    assert mesh.cell_data["stress"][0].shape == (135, 9)
    picture = image.imread(tmp_path / "out" / "pulled.png")
    assert picture.std() > 0.05
