"""Interfaces between materials that are circles or spheres: volumes of both sides, energies, and
finite elements.
"""

import sys

import numpy as np
import pytest
from bodies import sheet
from probes import assert_slope

import pdsurrogate as pds
from pdsurrogate.body import Body, Round, grid
from pdsurrogate.discretization import discretize
from pdsurrogate.forces import FORCES, ForceSettings, MaterialPart, bind_portions
from pdsurrogate.materials import NeoHookean
from pdsurrogate.problem import compile_scene
from pdsurrogate.testing.bodies import wavy

RUBBER = {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 100.0}


def stiffer(ratio):
    return (
        "rigid"
        if ratio == np.inf
        else {**RUBBER, "shear_modulus": ratio, "bulk_modulus": 100 * ratio}
    )


def strip(ratio, spacing, middle=(1.0, 0.5), **changes):
    """A strip of 2 x 1 with a disc of radius 0.25, pulled to 1.5 between rollers."""
    keys = {
        "name": "strip",
        "spacing": spacing,
        "body": {"size": (2.0, 1.0)},
        "material": RUBBER,
        "materials": [
            {"region": {"disc": {"center": middle, "radius": 0.25}}, "material": stiffer(ratio)}
        ],
        "prescribed": [
            {"region": "left", "x1": 0.0},
            {"region": "right", "x1": 1.0},
            {"region": {"near": (0.0, 0.5)}, "x2": 0.0},
        ],
        "probes": [{"name": "edge", "at": (1.0, 1.0)}],
        "steps": (1.0,),
    }
    return pds.Scene(**keys | changes)


FINITE_ELEMENTS = {
    3.0: (1.13492, 0.06276),
    10.0: (1.17143, 0.04748),
    100.0: (1.18580, 0.04072),
    np.inf: (1.18738, 0.03994),
}
"""Force on the strip, and displacement of its edge beside the disc, by the ratio of the moduli:
nine-node quadrilaterals (FElupe 11.3), last change 0.001 and 0.08 %.
"""


@pytest.mark.parametrize("ratio", sorted(FINITE_ELEMENTS))
def test_a_disc_in_a_strip_against_finite_elements(ratio):
    """With 5 cells in its radius. With whole cells and interfaces from points, forces were 0.3,
    2.2, 2.4 and 2.4 % too small, and displacements 1, 9, 13 and 14 % too great.
    """
    (level,) = pds.simulate(strip(ratio, 0.05), "bond-energy").levels
    force, edge = FINITE_ELEMENTS[ratio]
    assert level["forces"]["right"][0] == pytest.approx(force, rel=0.004)
    assert level["probes"]["edge"]["displacement"][1] == pytest.approx(-edge, rel=0.015)


def test_where_the_grid_cuts_the_disc_matters_little():
    """The disc moved by parts of a cell; with whole cells the forces differed by 0.8 %."""
    forces = [
        pds.simulate(strip(10.0, 0.05, (1.0 + part * 0.05, 0.5)), "bond-energy").levels[-1][
            "forces"
        ]["right"][0]
        for part in (0, 0.25, 0.5)
    ]
    assert np.ptp(forces) < 0.004 * np.mean(forces)


@pytest.mark.parametrize(
    ("force", "divided"), [("bond-energy", True), ("analytic", False), ("nosb", False)]
)
def test_only_bond_energies_divide_cells(force, divided):
    """Others do not know where in a cell the interface lies: they keep the forces that they had
    with whole cells.
    """
    problem = compile_scene(strip(10.0, 0.05), [FORCES[force](), FORCES[force]()])
    assert (np.ptp(problem.body.volumes) > 0.1 * 0.05**2) == divided
    assert bool(problem.body.rounds) == divided


@pytest.mark.parametrize("dimension", [2, 3])
def test_either_side_has_its_whole_volume(dimension):
    """Within what the sampled places of a cell show; cells away from the interface are whole."""
    keys = (
        {"disc": {"center": (0.52, 0.47), "radius": 0.3}}
        if dimension == 2
        else {"ball": {"center": (0.52, 0.47, 0.5), "radius": 0.3}}
    )
    body = {"size": (1.0, 1.0)} if dimension == 2 else {"shape": "box", "size": (1.0, 1.0, 1.0)}
    found, _, _ = discretize(
        strip(
            3.0,
            0.05,
            body=body,
            materials=[{"region": keys, "material": stiffer(3.0)}],
            prescribed=[{"region": "left", "x1": 0.0}],
            probes=[],
        )
    )
    distances = found.rounds[0].distances(found.points)
    exact = np.pi * 0.3**2 if dimension == 2 else 4 / 3 * np.pi * 0.3**3
    assert found.volumes[distances < 0].sum() == pytest.approx(exact, rel=2e-3)
    assert found.volumes.sum() == pytest.approx(1.0, rel=1e-12)
    away = np.abs(distances) > 0.05 * (0.5 + dimension**0.5)
    np.testing.assert_allclose(found.volumes[away], 0.05**dimension, rtol=1e-12)
    assert found.volumes.min() > 0.2 * 0.05**dimension


def test_regions_without_round_boundaries_divide_no_cells():
    half = {
        "region": {"half_plane": {"point": (1.03, 0.0), "normal": (1.0, 0.3)}},
        "material": stiffer(3.0),
    }
    body, _, _ = discretize(strip(3.0, 0.1, materials=[half]))
    assert not body.rounds
    assert np.ptp(body.volumes) == 0


def bodies():
    flat = sheet()
    disc = Round((0.7, 0.4), 0.33)
    points = grid((0, 0, 0), (0.8, 0.7, 0.6), 0.1)
    ball = Round((0.42, 0.33, 0.3), 0.24)
    return {
        "stress": Body(flat.points, flat.volumes, flat.horizon, flat.spacing, rounds=(disc,)),
        "strain": Body(flat.points, flat.volumes, flat.horizon, flat.spacing, rounds=(disc,)),
        "space": Body(points, np.full(len(points), 1e-3), 0.175, 0.1, rounds=(ball,)),
    }


def bound(plane, ratio, inside_is_stiff=True):
    body = bodies()[plane]
    stiff = (body.rounds[0].distances(body.points) < 0) == inside_is_stiff
    laws = NeoHookean(1.0, 100.0), NeoHookean(ratio, 100.0 * ratio)
    portions = [
        MaterialPart(law, FORCES["bond-energy"](), np.flatnonzero(stiff == number))
        for number, law in enumerate(laws)
    ]
    return (
        body,
        stiff,
        bind_portions(body, portions, ForceSettings(plane=plane, precision="float64")),
    )


@pytest.mark.parametrize("inside_is_stiff", [True, False])
@pytest.mark.parametrize("ratio", [3.0, 10.0])
@pytest.mark.parametrize("plane", ["stress", "strain", "space"])
def test_forces_are_the_gradient_of_an_energy_that_turning_does_not_change(
    plane, ratio, inside_is_stiff, random
):
    """Fourth-order differences to 1e-8; momentum and its moment to rounding."""
    body, _, force = bound(plane, ratio, inside_is_stiff)
    y = body.points + (
        0.003 * random.standard_normal(body.points.shape)
        if plane == "space"
        else 0.05 * (wavy(body.points) - body.points)
    )
    out = assert_slope(force, y, random.standard_normal((2, *y.shape)), 1e-5, 1e-8)
    scale = np.abs(out).max()
    assert np.abs(out.sum(axis=0)).max() < 1e-11 * scale
    assert np.abs(y.T @ out - out.T @ y).max() < 1e-11 * scale


@pytest.mark.parametrize("ratio", [3.0, 10.0])
@pytest.mark.parametrize("plane", ["stress", "strain", "space"])
def test_one_gradient_on_both_sides_has_the_energy_of_both_laws(plane, ratio, random):
    """F of every point to rounding, and the energy of both volumes."""
    body, stiff, force = bound(plane, ratio)
    d = body.dimension
    F = np.eye(d) + 0.1 * random.standard_normal((d, d))
    y = body.points @ F.T
    force(y, np.empty_like(y))
    np.testing.assert_allclose(
        force.deformation_gradients(), np.broadcast_to(F, (len(body), d, d)), atol=1e-11
    )
    density = bound(plane, 1.0)[2]  # of the same points, all of the softer law
    density(y, np.empty_like(y))
    share = body.volumes[stiff].sum() / body.volumes.sum()
    assert force.energy() == pytest.approx(density.energy() * (1 + (ratio - 1) * share), rel=1e-9)


def sheet_of_discs(count, radius, spacing=0.1, apart=1.0):
    """A square of count x count discs, each of the second material."""
    centers = [((i + 0.53) * apart, (j + 0.47) * apart) for i in range(count) for j in range(count)]
    discs = [
        {"region": {"disc": {"center": center, "radius": radius}}, "material": stiffer(10.0)}
        for center in centers
    ]
    size = {"size": (count * apart, count * apart)}
    return strip(
        10.0,
        spacing,
        body=size,
        materials=discs,
        prescribed=[{"region": "left", "x1": 0.0, "x2": 0.0}],
        probes=[],
    )


def test_the_work_of_many_inclusions_grows_with_the_points_alone():
    """Calls of Python functions for each point, from the scene to the force: one for each point
    and disc would be 100 here.
    """
    scene, calls = sheet_of_discs(10, 0.21), [0]

    def count(frame, event, argument):
        calls[0] += event == "call"

    problem = compile_scene(scene, [FORCES["bond-energy"]()] * 101)
    problem.bind()  # imports what is imported where it is first needed
    sys.setprofile(count)
    try:
        force, _ = problem.bind()
    finally:
        sys.setprofile(None)
    assert (force.interfaces.depths > 0).sum() > 0.5 * len(force.body)
    assert calls[0] < 2 * len(force.body)


def test_more_than_64_circles_divide_their_cells():
    """Each of 81 discs has its whole volume, as the first has; the sides had one bit of an
    integer for each circle.
    """
    body, _, _ = discretize(sheet_of_discs(9, 0.41))
    whole = [body.volumes[each.distances(body.points) < 0].sum() for each in body.rounds]
    assert len(whole) == 81
    np.testing.assert_allclose(whole, np.pi * 0.41**2, rtol=5e-3)
