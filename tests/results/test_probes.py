"""Probes read displacement, stress and deformation gradient at places of a body."""

import numpy as np
import pytest
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.body.local_fit import fields_at
from pdsurrogate.discretization import discretize
from pdsurrogate.materials import plane_stress
from pdsurrogate.results.measures import PointState, Probes
from pdsurrogate.scenes import Probe

F = np.array([[1.2, 0.3], [-0.1, 0.9]])


@pytest.fixture(scope="module")
def stretched():
    body, law = pds.Body.rectangle(1.0, 0.6, 0.1, 0.3), pds.materials.NeoHookean()
    force = pds.load_surrogate("analytic").bind(body, law, pds.ForceSettings())
    return body, law, PointState(force, body.points @ F.T)


@pytest.mark.parametrize("place", [(0.5, 0.3), (0.0, 0.0), (1.0, 0.31), (0.123, 0.6)])
def test_an_affine_motion_is_read_exactly_within_the_body_and_on_its_boundary(stretched, place):
    body, law, state = stretched
    found = Probes(body, (Probe(name="here", at=place),)).read(state, np.zeros(0))["here"]
    np.testing.assert_allclose(found["displacement"], (F - np.eye(2)) @ place, atol=1e-13)
    np.testing.assert_allclose(np.array(found["F"])[:2, :2], F, atol=1e-12)
    np.testing.assert_allclose(
        np.array(found["stress"])[:2, :2], plane_stress.first_piola_stress(law, F), atol=1e-10
    )
    assert np.array(found["F"])[2, 2] == pytest.approx(
        plane_stress.volume_ratio(law, (F * F).sum(), np.linalg.det(F)) / np.linalg.det(F)
    )


def test_a_place_outside_is_told_with_its_key_and_what_is_nearest(stretched):
    body, _, _ = stretched
    with raising(r"probes\.1\.at: \(1\.4, 0\.3\) .* its nearest point is"):
        Probes(body, (Probe(name="a", at=(0.5, 0.3)), Probe(name="b", at=(1.4, 0.3))))


def test_probes_in_planes_of_symmetry_read_from_points_and_images():
    """A motion and a tensor that are symmetric about the planes of an eighth, where the points on
    one side tell 4 % too much.

    Inside the wall a quadratic fit with both sides has the third derivative left along the radius,
    h^2 24/R^2 u/6 at most.
    """
    spacing, planes = 1 / 16, enumerate(("left", "bottom", "back"), 1)
    scene = pds.Scene(
        name="eighth",
        spacing=spacing,
        steps=[1.0],
        body={"shape": "sphere", "radius": 1.0, "part": "eighth"},
        holes=[{"shape": "sphere", "radius": 0.5}],
        material={"law": "neo-hookean", "bulk_modulus": 20.0},
        prescribed=[{"region": face, f"x{axis}": 0.0} for axis, face in planes],
    )
    body, _, _ = discretize(scene)
    places = np.array([[0.75, 0.0, 0.0], [0.0, 0.5, 0.55], [0.45, 0.6, 0.0]])
    moved, tensors = fields_at(body, places)

    def motion(X):
        return X / np.linalg.norm(X, axis=1)[:, None] ** 3

    found = moved(motion(body.points))
    size = np.linalg.norm(motion(places), axis=1)
    assert (
        np.linalg.norm(found - motion(places), axis=1)
        < 4 * spacing**2 / (places**2).sum(axis=1) * size
    ).all()
    squares = (body.points[:, :, None] * body.points[:, None]).reshape(-1, 9)
    found = np.stack(
        [rows @ squares[:, entry] for entry, rows in enumerate(tensors)], axis=1
    ).reshape(-1, 3, 3)
    np.testing.assert_allclose(found, places[:, :, None] * places[:, None], atol=1e-2)
    for place, tensor in zip(places, found, strict=True):
        on_plane = place == 0
        # what changes its sign across is none
        np.testing.assert_allclose(tensor[on_plane[:, None] ^ on_plane], 0, atol=1e-12)
