"""Force models of bodies in space: exact in homogeneous states, the gradient of an energy, and
no modes but the rigid ones.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from bodies import fill_gradients
from probes import assert_slope, directions_of

from pdsurrogate.body import Body, ReflectionPlane
from pdsurrogate.body import bonds as bonds_module
from pdsurrogate.discretization.cells import lattice_of
from pdsurrogate.forces import FORCES, ForceSettings
from pdsurrogate.materials import LAWS, InvariantLaw, NeoHookean, solid
from pdsurrogate.solvers.methods import Automatic
from pdsurrogate.testing.subject import forces_at

LAW = NeoHookean(2.0, 200.0)
F = np.array([[1.3, 0.2, -0.1], [-0.15, 0.9, 0.2], [0.1, 0.05, 0.88]])


def box(counts=(5, 5, 5), reach=1.75, planes=(), spacing=0.2, **options):
    """A lattice with its lower corner at the origin."""
    axes = [(np.arange(count) + 0.5) * spacing for count in counts]
    points = lattice_of(*axes)
    return Body(
        points, np.full(len(points), spacing**3), reach * spacing, spacing, planes=planes, **options
    )


def jittered(reach=2.2, planes=(), amount=0.2):
    """Points off a lattice, of unequal volumes."""
    body, random = box(), np.random.default_rng(5)
    points = body.points + amount * body.spacing * random.uniform(-1, 1, body.points.shape)
    return Body(
        points,
        body.volumes * random.uniform(0.8, 1.2, len(points)),
        reach * body.spacing,
        body.spacing,
        planes=planes,
    )


def irregular():
    """Points as a mesh of a ball with a conical bore has them: no lattice, spacings and volumes
    that differ by a factor of three.
    """
    random, points = np.random.default_rng(8), []
    while len(points) < 180:
        place = random.uniform(-1, 1, 3)
        radius = np.linalg.norm(place)
        near = 0.13 + 0.13 * radius
        if (
            radius < 1
            and np.hypot(place[0], place[1]) > 0.2 + 0.1 * place[2]
            and all(np.linalg.norm(place - q) > near for q in points)
        ):
            points.append(place)
    points = np.array(points)
    volumes = (0.13 + 0.13 * np.linalg.norm(points, axis=1)) ** 3 * random.uniform(
        0.8, 1.25, len(points)
    )
    return Body(points, volumes, 0.62, 0.25)


def rollers(axes, position=0.0, side=-1):
    return tuple(
        ReflectionPlane(axis, position, side, tuple(np.where(np.arange(3) == axis, -1, 1)))
        for axis in axes
    )


CLAMP = ReflectionPlane(0, 0.0, -1, (-1, -1, -1))


def bound(model, body, law=LAW, **settings):
    return FORCES[model]().bind(body, law, ForceSettings(plane="space", **settings))


def wavy(points, amount=0.03):
    x1, x2, x3 = points.T
    return points @ F.T + amount * np.stack(
        [np.sin(3 * x2), np.cos(4 * x3), np.sin(2 * x1 + x3)], axis=1
    )


BODIES = {
    "lattice": box,
    "long horizon": lambda: box(reach=3.015),
    "jittered": jittered,
    "irregular": irregular,
}


@pytest.mark.parametrize("model", ["bond-energy", "nosb"])
@pytest.mark.parametrize("name", BODIES)
def test_a_homogeneous_state_is_exact(name, model, monkeypatch):
    """The patch test: gradient, mean stress and energy are the law's own, whatever the points are
    and wherever the body ends.

    The mean stress is a sum over parts of the pairs, of 100 pairs each instead of 500,000.
    """
    monkeypatch.setattr(bonds_module, "SLAB", 100)
    body = BODIES[name]()
    force = bound(model, body)
    forces_at(force, body.points @ F.T + [3.0, -1.0, 2.0])
    assert force.supported.all()
    np.testing.assert_allclose(
        force.deformation_gradients(), np.broadcast_to(F, (len(body), 3, 3)), atol=1e-12
    )
    np.testing.assert_allclose(force.volume_ratios(), np.linalg.det(F), rtol=1e-12)
    np.testing.assert_allclose(
        force.mean_stress(), solid.first_piola_stress(LAW, F), atol=1e-11 * LAW.bulk_modulus
    )
    if force.has_energy:
        assert force.energy() == pytest.approx(
            body.volumes.sum() * solid.energy_density(LAW, F), rel=1e-12
        )


@dataclass(frozen=True)
class Cubic(InvariantLaw):
    """A user's own law: W = (I1bar - 3)/2 + a (I2bar - 3)^2, with an energy of the volume of its
    own.
    """

    name: ClassVar[str] = "cubic"
    reference: ClassVar[str] = "this test"

    curvature: float = 0.2

    @property
    def parameters(self):
        return np.array([self.bulk_modulus / self.shear_modulus, self.curvature])

    @staticmethod
    def isochoric(I1, I2, parameters):
        a, zero = parameters[1], 0 * I1
        return (
            (I1 - 3) / 2 + a * (I2 - 3) * (I2 - 3),
            0.5 + zero,
            2 * a * (I2 - 3),
            zero,
            zero,
            2 * a + zero,
        )

    @staticmethod
    def volumetric(J3, parameters):
        K = parameters[0]
        return K / 2 * (J3 - 1) * (J3 - 1), K * (J3 - 1), K + 0 * J3


@pytest.mark.parametrize(
    "law", [*(cls() for cls in LAWS.values()), Cubic(3.0, 50.0)], ids=lambda law: law.name
)
def test_every_law_of_a_solid(law, random):
    """All seven laws and a user's own: stress and energy in a homogeneous state; forces against the
    energy's slope in another.

    Rounding, 1e-13, times K/mu, and 2e-11 more of laws whose stretches are roots of a cubic
    (`tests/materials/test_responses.py`).
    """
    body = box((4, 4, 4))
    force, tolerance = (
        bound("bond-energy", body, law),
        (1e-12 * law.bulk_modulus + 2e-11) * law.shear_modulus,
    )
    forces_at(force, body.points @ F.T)
    np.testing.assert_allclose(
        force.mean_stress(), solid.first_piola_stress(law, F), atol=tolerance
    )
    assert force.energy() == pytest.approx(
        body.volumes.sum() * solid.energy_density(law, F), rel=1e-10
    )
    check_slope(force, wavy(body.points), [random.standard_normal(body.points.shape)])


def check_slope(force, y, directions):
    """Forces against the slope of the energy by central differences of fourth order, to 1e-7."""
    unit = [direction / np.abs(direction).max() for direction in directions]
    return assert_slope(force, y, unit, 2e-4 * force.body.spacing)


CONTINUED = {
    "rollers": lambda: box(planes=rollers([0, 1, 2])),
    "clamp": lambda: box(planes=(CLAMP,)),
    "clamp between rollers": lambda: jittered(planes=(CLAMP, *rollers([1, 2]))),
    "two clamps and an edge": lambda: box(
        (8, 4, 4), planes=(CLAMP, ReflectionPlane(0, 1.6, 1, (-1, -1, -1)), *rollers([1]))
    ),
    "clamped corner": lambda: box(
        planes=(
            CLAMP,
            ReflectionPlane(1, 0.0, -1, (1, -1, -1)),
            ReflectionPlane(2, 0.0, -1, (-1, -1, -1)),
        )
    ),
}


@pytest.mark.parametrize("name", [*BODIES, *CONTINUED])
def test_forces_are_the_gradient_of_the_energy(name, random):
    """Along random directions and at single points of every kind, to 1e-7 of the force."""
    body = (BODIES | CONTINUED)[name]()
    y = body.points + (0.1 if len(body.ghosts) else 1.0) * (wavy(body.points, 0.02) - body.points)
    targets = [getattr(body.points, name)(axis=0) for name in ("min", "max", "mean")]
    directions = directions_of(random, body, 1, targets)
    check_slope(bound("bond-energy", body), y, directions)


def stiffness(force, y):
    """Minus the derivative of the forces by the positions, by central differences of fourth
    order, shape (3 n, 3 n).
    """
    step, found = 1e-4 * force.body.spacing, np.empty((y.size, y.size))
    for k in range(y.size):
        shift = np.zeros(y.size)
        shift[k] = step
        shift = shift.reshape(y.shape)
        change = 8 * (forces_at(force, y + shift) - forces_at(force, y - shift)) - (
            forces_at(force, y + 2 * shift) - forces_at(force, y - 2 * shift)
        )
        found[:, k] = -change.ravel() / (12 * step)
    return found


@pytest.mark.parametrize("name", ["lattice", "jittered"])
def test_the_tangent_is_symmetric_and_has_the_six_rigid_modes_alone(name):
    """Symmetric in a deformed state; six zero modes at rest.

    Differences of forces of size K V/dx leave some 1e-9 of the greatest eigenvalue.
    """
    body = box((4, 4, 4)) if name == "lattice" else jittered()
    if name == "jittered":
        near = (body.points < 0.8).all(axis=1)
        body = Body(body.points[near], body.volumes[near], body.horizon, body.spacing)
    force, unit = bound("bond-energy", body), LAW.shear_modulus * body.spacing
    tangent = stiffness(force, wavy(body.points, 0.01))
    assert np.abs(tangent - tangent.T).max() < 1e-8 * np.abs(tangent).max()
    modes = np.linalg.eigvalsh(stiffness(force, body.points)) / unit
    assert np.abs(modes[:6]).max() < 1e-6
    assert modes[6] > 0.2


@pytest.mark.parametrize("model", ["bond-energy", "nosb"])
def test_an_eighth_of_a_body_with_its_images_is_the_whole(model):
    """Three planes, their edges and the corner: forces, energy, gradients and the pairs' forces
    are those of the whole body.
    """
    eighth = jittered(planes=rollers([0, 1, 2]))
    points, volumes = eighth.points, eighth.volumes
    x1, x2, x3 = points.T
    # odd across its own plane, even across the others
    u = 0.1 * np.stack([x1 * np.cos(x2), np.sin(x2) * x3**2, x3 + x1**2 * x3], axis=1)
    whole, displacements = points, u
    for axis in range(3):
        flip = np.where(np.arange(3) == axis, -1.0, 1.0)
        whole, displacements = (
            np.concatenate([whole, whole * flip]),
            np.concatenate([displacements, displacements * flip]),
        )
    body = Body(whole, np.tile(volumes, 8), eighth.horizon, eighth.spacing)
    part, full = bound(model, eighth), bound(model, body)
    expected, n = forces_at(full, whole + displacements), len(eighth)
    np.testing.assert_allclose(
        forces_at(part, points + u), expected[:n], atol=1e-12 * LAW.bulk_modulus * eighth.spacing
    )
    np.testing.assert_allclose(
        part.deformation_gradients(), full.deformation_gradients()[:n], atol=1e-12
    )
    np.testing.assert_allclose(part.volume_ratios(), full.volume_ratios()[:n], atol=1e-12)
    if part.has_energy:
        assert 8 * part.energy() == pytest.approx(full.energy(), rel=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_beyond_a_clamp_a_gradient_is_the_planes_along_it_and_its_sources_across(share):
    planes = (CLAMP, *rollers([1]), ReflectionPlane(2, 0.0, -1, (-1, -1, -1)))
    body = box(planes=planes)
    ghosts, n = body.ghosts.held_by_clamps(share), len(body)
    gradients = np.tile(F.T.ravel(), (n + len(ghosts), 1))
    fill_gradients(ghosts, gradients)
    images = gradients[n:].reshape(-1, 3, 3).transpose(0, 2, 1)
    assert len(np.unique(ghosts.image)) == 7  # three planes, three edges, a corner
    mirror, rest = np.diag([1.0, -1.0, 1.0]), np.eye(3)
    for image, found in zip(ghosts.image, images, strict=True):
        clamped = [axis for number, axis in ((0, 0), (2, 2)) if image >> number & 1]
        # What the source has along every axis: all of it across the one clamp, a share along it,
        # less along two.
        kept = np.prod([np.where(np.arange(3) == axis, 1.0, share) for axis in clamped], axis=0)
        expected = rest + (F - rest) * kept
        np.testing.assert_allclose(
            found, mirror @ expected @ mirror if image >> 1 & 1 else expected, atol=1e-15
        )


def test_beyond_a_clamp_that_turns_a_gradient_turns_with_it():
    body = box(planes=(CLAMP,))
    quarter = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    ghosts = body.ghosts.held_by_clamps(0.0)
    gradients = np.tile((quarter @ F).T.ravel(), (len(body) + len(ghosts), 1))
    fill_gradients(ghosts, gradients)
    found = (
        (gradients[len(body) :] + ghosts.gradient_shifts((quarter - np.eye(3))[None]))
        .reshape(-1, 3, 3)
        .transpose(0, 2, 1)
    )
    expected = np.column_stack([quarter @ F[:, 0], quarter[:, 1:]])
    np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), atol=1e-15)


@pytest.mark.parametrize(
    ("bulk_modulus", "stretch", "reaction", "side"),
    [(1000.0, 1.5, 1.25451, -0.11194), (100.0, 0.9, -0.40707, 0.03504)],
)
def test_a_bonded_cube_is_as_finite_elements_have_it(bulk_modulus, stretch, reaction, side):
    """An eighth with 6 points a side: within 1 % of a three-field solution (FElupe 11.3,
    triquadratic hexahedra, converged to 0.05 %).

    The force is 0.25, 0.81 and 0.67 % off, the displacement in the middle of a side 0.15, 0.28 and
    0.57 %.  With all of an image's gradient from its source, forces and sides are off by -0.47 and
    -0.56 %, 0.11 and -0.37 %, -1.7 and -2.4 %.
    """
    h, mirrors = (
        1 / 12,
        [ReflectionPlane(axis, 0.0, -1, tuple(1 - 2 * (axis == np.arange(3)))) for axis in (1, 2)],
    )
    planes = (CLAMP, ReflectionPlane(0, 0.5, 1, (-1, 1, 1)), *mirrors)
    axis = (np.arange(6) + 0.5) * h
    points = lattice_of(axis, axis, axis)
    body = Body(points, np.full(len(points), h**3), 1.75 * h, h, planes=planes)
    force = FORCES["bond-energy"]().bind(
        body, NeoHookean(1.0, bulk_modulus), ForceSettings(plane="space")
    )
    solver, y = Automatic(np.ones_like(points), body.volumes), points.copy()
    for reached in np.linspace(1, stretch, round(abs(stretch - 1) / 0.1) + 1)[1:]:
        force.move_plane(1, np.array([(reached - 1) / 2, 0, 0]))
        y[:, 0] *= reached / (y[:, 0].max() / points[:, 0].max())
        solver.solve(force, y, 1e-5)
    # The force by virtual work of the moved plane, and the side continued to the surface and the
    # planes of symmetry.
    energies = []
    for change in (-1e-4, 1e-4):
        force.move_plane(1, np.array([(stretch - 1) / 2 + change, 0, 0]))
        force(y, np.empty_like(y))
        energies.append(force.energy())
    assert 4 * (energies[1] - energies[0]) / 2e-4 == pytest.approx(reaction, rel=0.01)
    moved = (y - points)[:, 1].reshape(6, 6, 6)
    line = (9 * moved[-1] - moved[-2]) / 8
    line = (9 * line[:, 0] - line[:, 1]) / 8
    assert (15 * line[-1] - 10 * line[-2] + 3 * line[-3]) / 8 == pytest.approx(side, rel=0.01)


def cracked(start, end):
    """Which bonds cross a square from the lower edges to the middle, x3 = 0.45 for x1 < 0.55."""
    share = (0.45 - start[:, 2]) / np.where(
        end[:, 2] == start[:, 2], np.inf, end[:, 2] - start[:, 2]
    )
    return (share > 0) & (share < 1) & (start[:, 0] + share * (end[:, 0] - start[:, 0]) < 0.55)


@pytest.mark.parametrize("name", ["irregular", "clamp between rollers"])
def test_broken_bonds_leave_a_body_that_never_had_them(name, random):
    """Forces, energy and dilatations as of a body cut from the outset; what is released; and still
    the gradient of an energy.

    Broken in two steps, the second from a state whose energy the release is held against.
    """
    body = (BODIES | CONTINUED)[name]()
    cut = Body(
        body.points, body.volumes, body.horizon, body.spacing, planes=body.planes, separates=cracked
    )
    bonds, ends = body.bonds, body.all_points
    pairs = np.flatnonzero(cracked(ends[bonds.first], ends[bonds.second]))
    assert len(pairs) > 20
    assert len(pairs) == len(bonds.first) - len(cut.bonds.first)
    force, expected = bound("bond-energy", body, breakable=True), bound("bond-energy", cut)
    y = body.points + 0.1 * (wavy(body.points, 0.02) - body.points)
    force.break_bonds(pairs[::2])
    forces_at(force, y)
    force.break_bonds(pairs[1::2])
    passed = np.empty_like(y)
    force.pass_bonds(passed)
    energy = force.energy()
    found = check_slope(force, y, [random.standard_normal(y.shape)])
    forces_at(force, y)
    unit = LAW.bulk_modulus * body.spacing**2
    np.testing.assert_allclose(found, forces_at(expected, y), atol=1e-12 * unit)
    assert force.energy() == pytest.approx(expected.energy(), rel=1e-11)
    np.testing.assert_allclose(force.volume_ratios(), expected.volume_ratios(), rtol=1e-12)
    assert energy == pytest.approx(force.energy(), rel=1e-11)
    np.testing.assert_allclose(passed, found, atol=1e-12 * unit)


def test_bonds_that_break_one_by_one_keep_the_gradient(random):
    """Those of a point beside planes of reflection, whose mirrored pairs stay, until it has
    none.
    """
    body = jittered(planes=(CLAMP, *rollers([1])))
    force = bound("bond-energy", body, breakable=True)
    y = body.points + 0.1 * (wavy(body.points, 0.02) - body.points)
    mine = np.flatnonzero((body.bonds.first == 0) | (body.bonds.second == 0))
    for pairs in np.array_split(random.permutation(mine), 4):
        force.break_bonds(pairs)
        check_slope(force, y, [random.standard_normal(y.shape)])
    assert not force.supported[0]


def test_collapsed_pairs_are_told():
    body = box((4, 4, 4))
    force = bound("bond-energy", body, breakable=True)
    forces_at(force, body.points)
    assert len(force.collapsed_pairs()) == 0
    y = body.points.copy()
    i = int(np.linalg.norm(y - 0.5, axis=1).argmin())
    near = (body.bonds.first == i) | (body.bonds.second == i)
    forces_at(force, y * [1.0, 1.0, 0.2])
    assert len(force.collapsed_pairs()) == len(body.bonds.first)
    force.break_bonds(np.flatnonzero(near))
    forces_at(force, y * [1.0, 1.0, 0.2])
    assert not near[force.collapsed_pairs()].any()
