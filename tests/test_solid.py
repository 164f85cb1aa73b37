"""Force models of bodies in space: exact in homogeneous states, the gradient of an energy, and no modes but the rigid ones."""

import numpy as np
import pytest

from pdsurrogate.body import Body, ReflectionPlane
from pdsurrogate.forces import FORCES, ForceSettings
from pdsurrogate.materials import NeoHookean, solid

LAW = NeoHookean(2.0, 200.0)
F = np.array([[1.3, 0.2, -0.1], [-0.15, 0.9, 0.2], [0.1, 0.05, 0.88]])


def box(counts=(5, 5, 5), reach=1.75, planes=(), spacing=0.2, **options):
    """A lattice with its lower corner at the origin."""
    axes = [(np.arange(count) + 0.5) * spacing for count in counts]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return Body(points, np.full(len(points), spacing**3), reach * spacing, spacing, planes=planes, **options)


def jittered(reach=2.2, planes=(), amount=0.2):
    """Points off a lattice, of unequal volumes."""
    body, random = box(), np.random.default_rng(5)
    points = body.points + amount * body.spacing * random.uniform(-1, 1, body.points.shape)
    return Body(points, body.volumes * random.uniform(0.8, 1.2, len(points)), reach * body.spacing, body.spacing, planes=planes)


def irregular():
    """Points as a mesh of a ball with a conical bore has them: no lattice, spacings and volumes that differ by a factor of three."""
    random, points = np.random.default_rng(8), []
    while len(points) < 180:
        place = random.uniform(-1, 1, 3)
        radius = np.linalg.norm(place)
        near = 0.13 + 0.13 * radius
        if radius < 1 and np.hypot(place[0], place[1]) > 0.2 + 0.1 * place[2] and all(np.linalg.norm(place - q) > near for q in points):
            points.append(place)
    points = np.array(points)
    volumes = (0.13 + 0.13 * np.linalg.norm(points, axis=1)) ** 3 * random.uniform(0.8, 1.25, len(points))
    return Body(points, volumes, 0.62, 0.25)


def rollers(axes, position=0.0, side=-1):
    return tuple(ReflectionPlane(axis, position, side, tuple(np.where(np.arange(3) == axis, -1, 1))) for axis in axes)


CLAMP = ReflectionPlane(0, 0.0, -1, (-1, -1, -1))


def bound(model, body, law=LAW, **settings):
    return FORCES[model]().bind(body, law, ForceSettings(plane="space", **settings))


def forces(force, positions):
    out = np.empty_like(force.body.points)
    force(positions, out)
    return out


def wavy(points, amount=0.03):
    x1, x2, x3 = points.T
    return points @ F.T + amount * np.stack([np.sin(3 * x2), np.cos(4 * x3), np.sin(2 * x1 + x3)], axis=1)


def turn(axis, degrees):
    """Rotation about an axis (Rodrigues)."""
    n, angle = np.asarray(axis) / np.linalg.norm(axis), np.radians(degrees)
    N = np.array([[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]])
    return np.eye(3) + np.sin(angle) * N + (1 - np.cos(angle)) * N @ N


BODIES = {"lattice": box, "long horizon": lambda: box(reach=3.015), "jittered": jittered, "irregular": irregular}


@pytest.mark.parametrize("model", ["bond-energy", "nosb"])
@pytest.mark.parametrize("name", BODIES)
def test_a_homogeneous_state_is_exact(name, model):
    """The patch test: gradient, mean stress and energy are the law's own, whatever the points are and wherever the body ends."""
    body = BODIES[name]()
    force = bound(model, body)
    forces(force, body.points @ F.T + [3.0, -1.0, 2.0])
    assert force.supported.all()
    np.testing.assert_allclose(force.deformation_gradients(), np.broadcast_to(F, (len(body), 3, 3)), atol=1e-12)
    np.testing.assert_allclose(force.volume_ratios(), np.linalg.det(F), rtol=1e-12)
    np.testing.assert_allclose(force.mean_stress(), solid.first_piola_stress(LAW, F), atol=1e-11 * LAW.bulk_modulus)
    if force.has_energy:
        assert force.energy() == pytest.approx(body.volumes.sum() * solid.energy_density(LAW, F), rel=1e-12)
