"""Bonds that break in bodies of several materials: forces stay the gradient of the energy, and
uniform states stay exact.
"""

import numpy as np
import pytest
from probes import assert_slope

import pdsurrogate as pds
from pdsurrogate.body import Body, ReflectionPlane, grid
from pdsurrogate.discretization import discretize
from pdsurrogate.forces import FORCES, ForceSettings, MaterialPart, bind_portions
from pdsurrogate.materials import NeoHookean
from pdsurrogate.scenes import Precut
from pdsurrogate.testing.bodies import wavy

AFFINE = np.array([[1.2, 0.1], [-0.05, 0.95]])
CUTS = {
    "along": Precut(start=(-0.05, 0.5), end=(0.6, 0.5)),
    "through": Precut(start=(0.52, -0.1), end=(0.52, 0.62)),
}
CASES = [
    ("analytic", "stress", 3.0),
    ("nosb", "stress", 3.0),
    *(("bond-energy", plane, mu) for plane in ("stress", "strain") for mu in (3.0, 10.0)),
]


RECTANGLE, BOX = (
    {"shape": "rectangle", "size": [1.2, 1.0]},
    {
        "shape": "box",
        "size": [1.2, 1.0, 0.4],
    },
)
RELAXED = {"arrangement": "relaxed", "seed": 2}


def cracked(separates=None, planes=()):
    points = grid((0.0, 0.0), (1.2, 1.0), 0.1)
    return Body(points, np.full(len(points), 0.01), 0.315, 0.1, separates=separates, planes=planes)


def bound(name, body, plane, mu):
    """Two layers, the upper one mu times as stiff as the lower."""
    upper = body.points[:, 1] > 0.5
    portions = [
        MaterialPart(NeoHookean(m, 50 * m), FORCES[name](), np.flatnonzero(of))
        for m, of in ((1.0, ~upper), (mu, upper))
    ]
    return bind_portions(
        body, portions, ForceSettings(plane=plane, breakable=True, precision="float64")
    )


def crossing(body, cut):
    bonds, points = body.bonds, body.all_points
    return np.flatnonzero(cut.crosses(points[bonds.first], points[bonds.second]))


def moved(body):
    return body.points + 0.3 * (wavy(body.points) - body.points)


@pytest.mark.parametrize("cut", sorted(CUTS))
@pytest.mark.parametrize(("name", "plane", "mu"), CASES)
def test_broken_bonds_are_as_if_cut_and_in_any_order(name, plane, mu, cut):
    """A crack that has grown bond by bond is the precut at the same place, and breaking in steps
    leaves the same bits as at once.
    """
    whole, forces = cracked(), []
    pairs = crossing(whole, CUTS[cut])
    for parts in ([pairs], np.array_split(pairs, 5)):
        force, out = bound(name, whole, plane, mu), np.empty_like(whole.points)
        for part in parts:
            force.break_bonds(part)
        force(moved(whole), out)
        forces.append(out)
    body = cracked(CUTS[cut].crosses)
    expected = np.empty_like(body.points)
    bound(name, body, plane, mu)(moved(body), expected)
    np.testing.assert_array_equal(forces[0], forces[1])
    np.testing.assert_allclose(forces[0], expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("cut", sorted(CUTS))
@pytest.mark.parametrize(
    ("name", "plane", "mu"), [case for case in CASES if case[0] == "bond-energy"]
)
def test_forces_beside_a_crack_are_the_gradient_of_the_energy(name, plane, mu, cut, random):
    """Differences of fourth order along random directions, and momentum."""
    planes = (ReflectionPlane(0, 1.2, +1, (-1, 1)),)
    body = cracked(planes=planes)
    force, y = bound(name, body, plane, mu), body.points + 0.3 * (moved(body) - body.points)
    force.break_bonds(crossing(body, CUTS[cut]))
    assert_slope(force, y, random.standard_normal((4, *y.shape)))


@pytest.mark.parametrize("cut", sorted(CUTS))
@pytest.mark.parametrize(("name", "plane", "mu"), CASES)
def test_a_uniform_state_stays_right_and_releases_nothing(name, plane, mu, cut):
    """Both materials have the gradient of an affine motion, and the energy of a body without the
    crack: what breaks releases none.
    """
    body = cracked()
    force, out = bound(name, body, plane, mu), np.empty_like(body.points)
    force(body.points @ AFFINE.T, out)
    energy = force.energy() if force.has_energy else None
    force.break_bonds(crossing(body, CUTS[cut]))
    if energy is not None:
        force.pass_bonds(out)
        assert force.energy() == pytest.approx(energy, rel=1e-12)
    force(body.points @ AFFINE.T, out)
    F = force.deformation_gradients()
    np.testing.assert_allclose(F, np.broadcast_to(AFFINE, F.shape), atol=1e-12)
    assert np.abs(out.sum(axis=0)).max() < 1e-11 * np.abs(out).max() * len(out)
    if energy is not None:
        assert force.energy() == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize("mu", [3.0, 10.0])
@pytest.mark.parametrize(
    ("shape", "plane"), [(RECTANGLE | RELAXED, "stress"), (BOX, "space"), (BOX | RELAXED, "space")]
)
def test_uniform_states_of_relaxed_points_and_solids_stay_right(shape, plane, mu):
    """An interface between points that are in no rows, which is torn in one half and crossed by
    a crack in the other.
    """
    ends = {"prescribed": [{"region": "body", "x1": 0.0}], "steps": 1.0}
    body, _, _ = discretize(
        pds.Scene(
            name="layers",
            spacing=0.1,
            horizon_ratio=2.2,
            material="neo-hookean",
            body=shape,
            **ends,
        )
    )
    F = np.diag([1.0, 1.0, 1.05][: body.dimension])
    F[:2, :2] = AFFINE
    force, out = bound("bond-energy", body, plane, mu), np.empty_like(body.points)
    force(body.points @ F.T, out)
    energy = force.energy()
    first, second = (body.all_points[ends] for ends in (body.bonds.first, body.bonds.second))
    torn = ((first[:, 1] > 0.5) != (second[:, 1] > 0.5)) & (first[:, 0] < 0.5)
    through = ((first[:, 0] > 0.8) != (second[:, 0] > 0.8)) & (first[:, 1] < 0.7)
    force.break_bonds(np.flatnonzero(torn | through))
    force.pass_bonds(out)
    assert force.energy() == pytest.approx(energy, rel=1e-11)
    force(body.points @ F.T, out)
    gradients = force.deformation_gradients()
    np.testing.assert_allclose(gradients, np.broadcast_to(F, gradients.shape), atol=1e-11)
    assert force.energy() == pytest.approx(energy, rel=1e-11)
