"""Outside the domain of a surrogate, and where a bond has no features at all: nothing jumps,
nothing lies.
"""

import warnings

import numpy as np
import pytest
from bodies import rotation, sheet
from commands import commanded
from conftest import SHIPPED
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.artifacts import load_surrogate
from pdsurrogate.forces import (
    AnalyticBondForce,
    BANOSBForce,
    Domain,
    ForceSettings,
    InvalidState,
    OutsideDomain,
    OutsideDomainWarning,
)
from pdsurrogate.kernels.domain import blend
from pdsurrogate.materials import Gent, plane_stress

LAW = pds.materials.NeoHookean()
PAPER = load_surrogate(SHIPPED / "neo-hookean-paper")


def forces(model, positions, body, law=LAW, **settings):
    force = model.bind(body, law, ForceSettings(precision="float64", **settings))
    out = np.empty_like(positions)
    force(positions, out)
    return force, out


def changes_along(path, steps, **settings):
    """Greatest change of any force between neighboring states on a path through [0, 1], over the
    greatest force.
    """
    body = sheet(width=0.8, height=0.8)
    force = PAPER.bind(
        body, LAW, ForceSettings(precision="float64", correction="scalar", **settings)
    )
    found = []
    for share in np.linspace(0, 1, steps):
        out = np.empty_like(body.points)
        force(body.points @ path(share).T, out)
        found.append(out)
    found = np.array(found)
    return np.abs(np.diff(found, axis=0)).max() / np.abs(found).max()


@pytest.mark.parametrize("bound", ["least stretch", "greatest stretch", "bulk"])
def test_the_force_is_continuous_at_the_edge_of_the_domain(bound):
    """A continuous force changes by a tenth as much in steps of a tenth; one that jumps by the
    error of the fit does not.
    """
    path = {
        "least stretch": lambda share: np.diag([1.5, 0.85 - 0.1 * share]),
        "greatest stretch": lambda share: np.diag([3.3 + share, 1.2]),
        # J3 falls with the area.
        "bulk": lambda share: np.diag([0.84, 0.95 - 0.12 * share]),
    }[bound]
    body = sheet(width=0.8, height=0.8)
    for share, outside in ((0, 0.0), (1, 1.0)):
        assert (
            forces(PAPER, body.points @ path(share).T, body, correction="scalar")[
                0
            ].fraction_outside
            == outside
        )
    coarse, fine = changes_along(path, 101), changes_along(path, 1001)
    assert fine < 0.15 * coarse


def test_the_blend_has_two_continuous_derivatives():
    """From 0 to 1, flat and without curvature at both ends, where it goes over into constants;
    the slope is that of the value.
    """
    t, step = np.linspace(-0.5, 1.5, 401), 1e-5
    value, slope = blend(t)
    assert (value[t <= 0] == 0).all()
    assert (value[t >= 1] == 1).all()
    before, after = (blend(t + sign * step) for sign in (-1, 1))
    curvature = (after[1] - before[1]) / (2 * step)
    # Differences are exact to the step squared times the third derivative, 60 at most.
    np.testing.assert_allclose(slope, (after[0] - before[0]) / (2 * step), atol=1e-8)
    assert np.abs(np.diff(curvature)).max() < 60 * 1.01 * (t[1] - t[0])


def test_the_interior_of_a_domain():
    inner = Domain(0.5, 4.0, 0.9, 1.3).interior
    assert 0.5 < inner.least_stretch < 0.55
    assert 3.4 < inner.greatest_stretch < 4.0
    assert 0.9 < inner.least_bulk < 1 < inner.greatest_bulk < 1.3
    away = Domain(1.2, 4.0, 0.9, 1.3)
    assert away.interior is away  # rest lies outside: there is nothing to be nearer to


@pytest.mark.parametrize(("J", "C33"), [(1.0, 1.0), (2.0, 0.25), (9.0, 1 / 81), (0.3, 8.0)])
@pytest.mark.parametrize("stretch", [0.05, 1.0, 3.0])
def test_a_turned_bond_is_pushed_back(law, stretch, J, C33):
    """T_nn rises with a = U_nn from -3 to 3, through a = 0, and T_nm with b: whatever the turn,
    the force leads back to rest.
    """
    a = np.linspace(-3, 3, 601)
    with np.errstate(invalid="ignore"):
        T_nn, T_nm, T_mm = plane_stress.bond_traction(
            law, a, 0 * a + 0.1 * stretch, J + 0 * a, C33 + 0 * a
        )
    defined = np.isfinite(T_nn)
    # A law that ends has no answer for a bond folded flat, and hardens as it comes near; every
    # other law has one everywhere.
    if law.name not in ("gent", "arruda-boyce", "full-network"):
        assert defined.all()
        # In a sheet at equibiaxial stretch 3 the exact force of laws that soften, or that know
        # I2bar, is not monotone itself: q > 0. The third power of I1bar - 3 in a sheet pressed to
        # 0.3 of its volume and 8 times as thick is not, either.
        if law.name == "neo-hookean" or (C33 >= 0.1 and not (law.name == "polyconvex" and J < 1)):
            assert (np.diff(T_nn) > 0).all()
    if law.name == "neo-hookean" or C33 >= 0.1:
        assert (T_nm[defined] > 0).all()
    assert np.isfinite(T_mm[defined]).all()
    folded = defined & (a < 0)
    if C33 >= 0.1:
        assert (T_nn[folded] < 0).all()


@pytest.mark.parametrize("outside", ["fallback", "warn", "extrapolate"])
@pytest.mark.parametrize("name", ["neo-hookean/1", "neo-hookean/2", "neo-hookean-paper"])
def test_bonds_without_features_get_the_exact_force_under_every_policy(name, outside):
    """A point pushed through its neighbor to the far side: finite, restoring, and the same as
    the analytic bond force gives that bond.
    """
    body = sheet()
    middle = int(np.linalg.norm(body.points - [0.55, 0.45], axis=1).argmin())
    positions = body.points.copy()
    positions[middle, 0] += 0.18
    model = load_surrogate(SHIPPED / name)
    correction = "tensor" if model.gives_transverse else "scalar"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OutsideDomainWarning)
        force, out = forces(model, positions, body, outside=outside, correction=correction)
    exact, _ = forces(AnalyticBondForce(LAW), positions, body, correction=correction)
    assert np.isfinite(out).all()
    assert out[middle, 0] < 0
    folded = np.flatnonzero((body.bonds.first == middle) & (body.bonds.second == middle + 1))
    assert len(folded) == 1
    np.testing.assert_allclose(force.pair_forces()[folded], exact.pair_forces()[folded], rtol=1e-9)
    assert force.fraction_outside > 0
    with pytest.raises(OutsideDomain):
        forces(model, positions, body, outside="raise", correction=correction)


def test_a_point_on_a_single_bond_may_be_turned_over():
    """It has no gradient and keeps the rotation 0; the point it hangs on is turned by 180
    degrees: they have no mean, and give no NaN.
    """
    corner = sheet(width=0.8, height=0.8).points
    points = np.vstack([corner, corner.max(axis=0) + 0.29 / np.sqrt(2)])
    body = pds.Body(points, np.full(len(points), 0.01), 0.315, 0.1)
    assert body.bonds.pointers[-1] - body.bonds.pointers[-2] == 1
    for model in (
        AnalyticBondForce(LAW),
        PAPER,
        load_surrogate("neo-hookean"),
        load_surrogate("neo-hookean@1"),
    ):
        force, out = forces(model, points @ rotation(np.pi).T, body)
        assert np.count_nonzero(~force.supported) == 1
        assert np.isfinite(out).all()
        assert force.fraction_outside == 0


def test_warnings_on_the_command_line():
    done = commanded("run uniaxial --set spacing=0.1 --set stretches=4.5 --set outside=warn")
    warned = [
        line
        for line in done.stderr.splitlines()
        if "bonds are outside the domain of neo-hookean@2" in line
    ]
    assert len(warned) == 1
    assert "the surrogate was extrapolated" in done.stderr


def test_a_bond_beyond_the_laws_limit_is_named():
    """A point pulled out alone: its own horizon is fine, a bond of it is past the chains'
    greatest extension.
    """
    body, law = sheet(), Gent(1.0, 100.0, 3.0)
    middle = int(np.linalg.norm(body.points - [0.55, 0.45], axis=1).argmin())
    positions = body.points.copy()
    positions[middle] += [0.0, 0.13]
    with raising(r"point \d+ at \(.*\): its bond to \(.*\).*gent", InvalidState):
        forces(AnalyticBondForce(law), positions, body, law)


def test_bond_associated_stops_name_the_bond():
    body, model = sheet(), BANOSBForce()
    folded, lost = body.points.copy(), body.points.copy()
    folded[55] += [0.28, 0.0]
    lost[55] = np.nan
    for positions, law, reason in (
        (folded, LAW, "det F = .* of the bond: the material is turned inside out"),
        (lost, LAW, "not finite"),
        (
            body.points * [20.0, 1.0],
            Gent(1.0, 100.0, 3.0),
            "gent: no plane-stress state .* det F = ",
        ),
    ):
        with raising(
            rf"point \d+ at \(.*\): its bond to \(.*\) has no stress: .*{reason}", InvalidState
        ):
            model.bind(body, law, ForceSettings())(positions, np.empty_like(positions))


def test_the_papers_network_converges_where_its_force_used_to_jump():
    """Pure shear to 2 leaves the box of the paper's network at its corners: with a jump there
    8,000 evaluations were not enough.
    """
    result = pds.simulate(
        pds.load_scene(
            "pure-shear", ["spacing=0.1", "stretches=1.5,2", "solver.most_evaluations=400"]
        ),
        "neo-hookean-paper",
    )
    assert result.summary["converged"]
    assert result.summary["fallback_fraction"] > 0.005
