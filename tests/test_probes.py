"""Probes read displacement, stress and deformation gradient at places of a body."""

import numpy as np
import pytest

import pdsurrogate as pd
from pdsurrogate.materials import plane_stress
from pdsurrogate.results.measures import PointState
from pdsurrogate.results.probes import Probes
from pdsurrogate.scenes import Probe

F = np.array([[1.2, 0.3], [-0.1, 0.9]])


@pytest.fixture(scope="module")
def stretched():
    body, law = pd.Body.rectangle(1.0, 0.6, 0.1, 0.3), pd.NeoHookean()
    force = pd.load_surrogate("analytic").bind(body, law, pd.ForceSettings())
    return body, law, PointState(force, body.points @ F.T)


@pytest.mark.parametrize("place", [(0.5, 0.3), (0.0, 0.0), (1.0, 0.31), (0.123, 0.6)])
def test_an_affine_motion_is_read_exactly_within_the_body_and_on_its_boundary(stretched, place):
    body, law, state = stretched
    found = Probes(body, (Probe(name="here", at=place),)).read(state)["here"]
    np.testing.assert_allclose(found["displacement"], (F - np.eye(2)) @ place, atol=1e-13)
    np.testing.assert_allclose(np.array(found["F"])[:2, :2], F, atol=1e-12)
    np.testing.assert_allclose(np.array(found["stress"])[:2, :2], plane_stress.first_piola_stress(law, F), atol=1e-10)
    assert np.array(found["F"])[2, 2] == pytest.approx(plane_stress.volume_ratio(law, (F * F).sum(), np.linalg.det(F)) / np.linalg.det(F))


def test_a_place_outside_is_told_with_its_key_and_what_is_nearest(stretched):
    body, _, _ = stretched
    with pytest.raises(ValueError, match=r"probes\.1\.at: \(1\.4, 0\.3\) lies outside the body; its nearest point is"):
        Probes(body, (Probe(name="a", at=(0.5, 0.3)), Probe(name="b", at=(1.4, 0.3))))
