"""Corrected gradients at incomplete horizons: exact for quadratic motions, and still the gradient of an energy."""

import numpy as np
import pytest
from bodies import build_body
from probes import assert_forces_are_slopes_of_the_energy
from scipy.spatial import cKDTree

import pdsurrogate as pds
from pdsurrogate.body import Body, ReflectionPlane
from pdsurrogate.forces import FORCES, ForceSettings
from pdsurrogate.forces.kinematics import Kinematics

LAW = pds.materials.NeoHookean(1.0, 100.0)
CLAMP = ReflectionPlane(0, 0.0, -1, (-1, -1, -1))
HELD = {"region": "left", "x1": 0.0, "x2": 0.0, "x3": 0.0}
BAR = {
    "name": "bar",
    "spacing": 0.25,
    "body": {"shape": "cylinder", "axis": "x1", "radius": 1.0, "length": 3.0},
    "holes": [{"shape": "cylinder", "axis": "x1", "radius": 0.4, "length": 3.0}],
    "material": {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 100.0},
    "loads": [{"region": "right", "traction": [0.1, 0.0, 0.0]}],
    "steps": [1.0],
}


def block(planes=(), counts=(5, 5, 4), amount=0.1):
    """Points off a lattice, of unequal volumes, by some of the spacing."""
    random, spacing = np.random.default_rng(3), 0.2
    axes = [(np.arange(count) + 0.5) * spacing for count in counts]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points + amount * spacing * random.uniform(-1, 1, points.shape)
    return Body(points, spacing**3 * (1 + 2 * amount * random.uniform(-1, 1, len(points))), 1.75 * spacing, spacing, planes=planes)


def bound(body, model=None, correction="quadratic"):
    return (model or FORCES["bond-energy"]()).bind(body, LAW, ForceSettings(plane="space", correction=correction))


def forces(force, positions):
    out = np.empty_like(positions)
    force(positions, out)
    return out


def off(force, points, slopes, curvatures):
    """Greatest error of a point's gradient in a quadratic motion."""
    force.place(points @ slopes.T + 0.5 * np.einsum("abc,nb,nc->na", curvatures, points, points))
    return np.abs(force.deformation_gradients() - slopes - np.einsum("abc,nc->nab", curvatures, points)).max()


@pytest.mark.parametrize("body", [block(), build_body(pds.Scene(**BAR))], ids=["block", "tube"])
def test_gradients_of_quadratic_motions_are_exact(body):
    random = np.random.default_rng(1)
    slopes, curvatures = np.eye(3) + 0.1 * random.uniform(-1, 1, (3, 3)), 0.05 * random.uniform(-1, 1, (3, 3, 3))
    curvatures = curvatures + curvatures.swapaxes(1, 2)
    assert off(bound(body), body.points, slopes, curvatures) < 1e-10
    assert off(bound(body, correction="none"), body.points, slopes, curvatures) > 0.01 * body.spacing


def test_a_body_that_is_cut_in_two_has_the_forces_of_two_bodies():
    def box(length, lower=0.0, **changes):
        keys = {"holes": [], "body": {"shape": "box", "size": [length, 1.0, 1.0], "lower": [lower, 0.0, 0.0]}}
        return build_body(pds.Scene(**{**BAR, **keys, **changes}))

    cut = {"corner": [1.0, -0.5, -0.5], "sides": [[0.0, 2.0, 0.0], [0.0, 0.0, 2.0]]}
    whole, energy = box(2.0, precuts=[cut]), 0.0
    positions = whole.points + 0.01 * np.random.default_rng(0).standard_normal(whole.points.shape)
    force = bound(whole)
    together = forces(force, positions)
    for part in (box(1.0), box(1.0, 1.0)):
        here = cKDTree(whole.points).query(part.points)[1]
        alone = bound(part)
        np.testing.assert_allclose(forces(alone, positions[here]), together[here], atol=1e-12)
        energy += alone.energy()
    assert force.energy() == pytest.approx(energy, rel=1e-12)
    uncut = bound(box(2.0))
    assert np.abs(forces(uncut, positions) - together).max() > 0.01 * np.abs(together).max()


def test_complete_horizons_and_thin_layers_are_left_alone():
    """On a lattice the outermost layer is corrected; two layers do not determine a curvature, and keep the gradients that they have."""
    body = block(counts=(6, 5, 5), amount=0.0)
    inside = ((body.points > 0.2) & (body.points < body.points.max(axis=0))).all(axis=1)
    np.testing.assert_array_equal(Kinematics(body, "float64", "space", quadratic=True).corrected, ~inside)
    thin = block(counts=(6, 6, 2))
    positions = thin.points * 1.1 + 0.01 * np.random.default_rng(2).uniform(-1, 1, thin.points.shape)
    one, other = (forces(bound(thin, correction=name), positions) for name in ("quadratic", "none"))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("planes", [(), (CLAMP,)], ids=["free", "clamped"])
def test_forces_are_the_gradient_of_the_energy(planes):
    body, random = block(planes), np.random.default_rng(4)
    force = bound(body)
    positions = body.points * [1.1, 0.96, 0.95] + 0.01 * random.uniform(-1, 1, body.points.shape)
    found, step = forces(force, positions), 1e-5
    pairs = force.pair_forces()
    scale = np.abs(found).max()
    if not planes:
        np.testing.assert_allclose(found.sum(axis=0), 0, atol=1e-12 * scale)
        np.testing.assert_allclose(np.cross(positions, found).sum(axis=0), 0, atol=1e-10 * scale)
    # The forces of the pairs, from which reactions are summed, make up the forces on the points.
    total = np.zeros((len(body.all_points), 3))
    np.add.at(total, body.bonds.first, pairs)
    np.add.at(total, body.bonds.second, -pairs)
    np.testing.assert_allclose(total[: len(body)], found, atol=1e-11 * scale)
    assert_forces_are_slopes_of_the_energy(force, positions, found, random, step)


def test_homogeneous_states_are_exact():
    body, F = block(), np.array([[1.3, 0.2, -0.1], [-0.15, 0.9, 0.2], [0.1, 0.05, 0.88]])
    energies = []
    for name in ("quadratic", "none"):
        force = bound(body, correction=name)
        forces(force, body.points @ F.T)
        energies.append(force.energy())
        np.testing.assert_allclose(force.deformation_gradients(), np.broadcast_to(F, (len(body), 3, 3)), atol=1e-12)
    assert energies[0] == pytest.approx(energies[1], rel=1e-12)
    free = np.linalg.eigvalsh(_tangent(bound(body), body.points))
    assert np.count_nonzero(free < 1e-6 * free[-1]) == 6


def _tangent(force, positions):
    tangent, n = force.tangent(positions.copy()), positions.size
    matrix = np.column_stack([tangent @ row for row in np.eye(n)])
    return (matrix + matrix.T) / 2


def test_a_twisted_cylinder_against_rivlin():
    """8 points across; without the correction the torque is 9 % low."""
    radius, length = 0.5, 1.5
    turned = {"region": "right", "rotation": 60.0, "about": [length, 0.0, 0.0], "axis": [1.0, 0.0, 0.0]}
    scene = pds.Scene(
        name="twisted",
        spacing=0.125,
        body={"shape": "cylinder", "axis": "x1", "radius": radius, "length": length},
        material={"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 100.0},
        prescribed=[HELD, turned],
        steps=[1.0],
        solver={"tolerance": 1e-5},
        correction="quadratic",
    )
    result = pds.simulate(scene, "bond-energy")
    assert result.summary["correction"] == "quadratic"
    expected = np.pi / 2 * np.deg2rad(60.0) / length * radius**4
    assert result.levels[-1]["moments"]["right"][0] == pytest.approx(expected, rel=0.015)


def test_what_cannot_be_corrected_is_refused():
    with pytest.raises(ValueError, match="correction=quadratic: bonds cannot break with it; use correction=none"):
        ForceSettings(plane="space", correction="quadratic", breakable=True)
    sheet = Body.rectangle(1.0, 1.0, 0.25, 0.7875)
    for plane, model in (("stress", pds.BondEnergyForce()), ("strain", pds.AnalyticBondForce())):
        with pytest.raises(ValueError, match="does not support correction=quadratic"):
            model.bind(sheet, LAW, ForceSettings(plane=plane, correction="quadratic"))
    with pytest.raises(ValueError, match="nosb does not support correction=quadratic"):
        bound(block(), FORCES["nosb"]())
    stiff = {"region": {"ball": {"center": [1.5, 0.0, 0.6], "radius": 0.3}}, "material": BAR["material"] | {"shear_modulus": 2.0}}
    with pytest.raises(ValueError, match="correction=quadratic supports bodies of one material without rigid regions"):
        pds.simulate(pds.Scene(**BAR, materials=[stiff], prescribed=[HELD], correction="quadratic"), "bond-energy")
