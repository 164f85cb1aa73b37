"""Bonds that break: what leaves with them, what stays exact, and what the critical stretch
should be.
"""

import numpy as np
import pytest
from bodies import sheet
from refusals import raising

from pdsurrogate.artifacts import load_surrogate
from pdsurrogate.body import Body, grid
from pdsurrogate.forces import ForceSettings
from pdsurrogate.materials import Gent, NeoHookean, homogeneous
from pdsurrogate.materials.tearing import tearing_energy
from pdsurrogate.problem.fracture import critical_stretch_of
from pdsurrogate.run.damage import Damage, greatest_bond_stretch
from pdsurrogate.scenes import Precut
from pdsurrogate.scenes.tip_diameter import TIP_DIAMETER

LAW = NeoHookean()
CUT = Precut(start=(-0.05, 0.5), end=(0.6, 0.5))
AFFINE = np.array([[1.4, 0.2], [-0.1, 0.9]])


def crossing(body):
    bonds, points = body.bonds, body.all_points
    return np.flatnonzero(CUT.crosses(points[bonds.first], points[bonds.second]))


def bound(name, body, **settings):
    return load_surrogate(name).bind(body, LAW, ForceSettings(breakable=True, **settings))


def wavy(body):
    x1, x2 = body.points.T
    return body.points @ AFFINE.T + 0.02 * np.stack([np.sin(7 * x2), np.cos(5 * x1)], axis=1)


def test_images_lose_the_bonds_of_the_points_they_mirror():
    """A bond broken across a symmetry plane leaves the half model as it leaves the whole."""
    from pdsurrogate.body import ReflectionPlane

    half = Body(
        grid((0.0, 0.0), (0.6, 1.0), 0.1),
        np.full(60, 0.01),
        0.315,
        0.1,
        planes=(ReflectionPlane(0, 0.0, -1, (-1, 1)),),
    )
    full = Body(grid((-0.6, 0.0), (0.6, 1.0), 0.1), np.full(120, 0.01), 0.315, 0.1)
    cut = Precut(start=(-0.22, 0.5), end=(0.22, 0.5))

    def broken_force(body):
        points, bonds = body.all_points, body.bonds
        force, out = bound("analytic", body), np.empty_like(body.points)
        force.break_bonds(np.flatnonzero(cut.crosses(points[bonds.first], points[bonds.second])))
        x1, x2 = body.points.T
        force(np.stack([1.3 * x1, 0.9 * x2 + 0.1 * x1**2], axis=1), out)
        return out

    found, expected = broken_force(half), broken_force(full)[full.points[:, 0] > 0]
    inside = half.points[:, 0] < 0.6  # the free edge at 0.6 is the same in both
    np.testing.assert_allclose(found[inside], expected[inside], atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["analytic", "neo-hookean"])
def test_a_cracked_body_is_still_exact_in_affine_deformation(name):
    """Stress-free faces aside, the tensor correction passes the homogeneous test around a crack:
    interior forces vanish beside it.
    """
    whole = sheet()
    force, out = bound(name, whole, precision="float64"), np.empty_like(whole.points)
    force.break_bonds(crossing(whole))
    force(whole.points.copy(), out)
    assert np.abs(out).max() < 1e-12
    force(whole.points @ AFFINE.T, out)
    F = force.deformation_gradients()
    np.testing.assert_allclose(F, np.broadcast_to(AFFINE, F.shape), atol=1e-12)
    assert np.abs(out.sum(axis=0)).max() < 1e-12 * np.abs(out).max() * len(out)


def test_points_without_support_are_carried_as_free_particles():
    """All bonds of a point broken, or all but those on one line: no force, no NaN, and it is
    counted.
    """
    body = sheet(0.1)
    force, out = bound("neo-hookean", body), np.empty_like(body.points)
    bonds = body.bonds
    i = int(np.argmin(np.linalg.norm(body.points - 0.5, axis=1)))
    own = np.flatnonzero((bonds.first == i) | (bonds.second == i))
    along = np.abs(body.points[bonds.second[own], 1] - body.points[bonds.first[own], 1]) < 1e-9
    for pairs in (own[~along], own[along]):
        force.break_bonds(pairs)
        force(wavy(body), out)
        assert np.flatnonzero(~force.supported).tolist() == [i]
        assert np.isfinite(out).all()
        np.testing.assert_array_equal(out[i], 0)


def test_bonds_break_beyond_the_critical_stretch_and_only_once():
    body = sheet(0.1)
    damage = Damage(body, 1.5)
    stretched = body.points * [1.6, 1.0]
    pairs = damage.overstretched(stretched)
    bonds = body.bonds
    vectors = body.points[bonds.second] - body.points[bonds.first]
    stretch = np.linalg.norm(vectors * [1.6, 1.0], axis=1) / np.linalg.norm(vectors, axis=1)
    np.testing.assert_array_equal(pairs, np.flatnonzero(stretch > 1.5))
    found, loads = damage.overloaded(stretched)
    np.testing.assert_array_equal(found, pairs)
    np.testing.assert_allclose(loads, stretch[pairs] / 1.5, rtol=1e-12)
    assert len(damage.overstretched(body.points * [1.49, 1.0])) == 0
    damage.break_bonds(pairs)
    assert len(damage.overstretched(stretched)) == 0
    assert np.isnan(body.points * np.nan).all()
    # a lost state is for the force to report
    assert len(damage.overstretched(body.points * np.nan)) == 0


def test_damage_is_the_share_of_weight_that_is_lost():
    """Half of a horizon cut off by a straight crack: bonds from the first row to the other side,
    by (31), summed by hand.
    """
    spacing = 0.05
    points = grid((0.0, 0.0), (1.0, 1.0), spacing)
    cut = Precut(start=(-1.0, 0.5), end=(2.0, 0.5))
    body = Body(
        points, np.full(len(points), spacing**2), 3.15 * spacing, spacing, separates=cut.crosses
    )
    found = Damage(body, 2.0).at_points()
    offsets = np.array(
        [(i, j) for i in range(-3, 4) for j in range(-3, 4) if 0 < i * i + j * j <= 3.15**2]
    )
    shares = 1 / np.linalg.norm(offsets, axis=1)
    beside = np.argmin(np.linalg.norm(points - [0.525, 0.525], axis=1))
    assert found[beside] == pytest.approx(shares[offsets[:, 1] < 0].sum() / shares.sum(), rel=1e-12)
    assert found[np.argmin(np.linalg.norm(points - [0.525, 0.875], axis=1))] == 0


def test_critical_stretch_from_a_fracture_energy():
    """Energy density at the critical stretch times the tip's diameter is the fracture energy:
    half the horizon, twice the density.
    """
    densities = [
        homogeneous.uniaxial(LAW, critical_stretch_of(LAW, 2.0, horizon)).energy_density
        for horizon in (0.3, 0.15)
    ]
    assert densities[0] * TIP_DIAMETER * 0.3 == pytest.approx(2.0, rel=1e-9)
    assert densities[1] == pytest.approx(2 * densities[0], rel=1e-9)
    with raising("gent reaches its limit"):
        critical_stretch_of(Gent(chain_limit=5.0), 1e6, 0.1)


def test_energy_of_a_trouser_tear():
    """Of Neo-Hookean legs that keep their volume nearly: P = mu (l - l^-2), psi = mu/2 (l^2 +
    2/l - 3).
    """
    stretch, width, thickness = 1.3, 8.0, 2.0
    law = NeoHookean(shear_modulus=0.7, bulk_modulus=7e4)
    force = 0.7 * (stretch - stretch**-2) * width * thickness
    density = 0.35 * (stretch**2 + 2 / stretch - 3)
    expected = 2 * force * stretch / thickness - 2 * width * density
    assert tearing_energy(law, force, width, thickness) == pytest.approx(expected, rel=1e-4)
    # stiff legs: 2 F/h
    assert tearing_energy(law, 1e-4, width, thickness) == pytest.approx(1e-4, rel=1e-4)
    with raising("the leg's width must be positive and finite"):
        tearing_energy(law, force, 0.0, thickness)
    with raising("gent reaches its limit at the stretch"):
        tearing_energy(Gent(chain_limit=5.0), 1e6, width, thickness)


@pytest.mark.parametrize(
    "given", [(-1.0, 0.1), (np.nan, 0.1), (1.0, 0.0), (np.inf, 0.1), (1.0, 0.1, 0.0)]
)
def test_impossible_fracture_energies(given):
    with raising("must be positive and finite"):
        critical_stretch_of(LAW, *given)


def test_greatest_bond_stretch():
    body = sheet(0.1)
    assert greatest_bond_stretch(body, body.points * [1.0, 1.7]) == pytest.approx(1.7)
    with raising("positions must be those of the body's points, of shape"):
        greatest_bond_stretch(body, body.points[:-1])


@pytest.mark.parametrize("stretch", [1.0, 0.5, np.nan, np.inf])
def test_impossible_critical_stretches(stretch):
    with raising("critical stretch must be"):
        Damage(sheet(0.1), stretch)
