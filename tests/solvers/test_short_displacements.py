"""Displacements that differ from point to point, in the preconditioner of relaxed sheets."""

import numpy as np

import pdsurrogate as pds
from pdsurrogate.forces import FORCES
from pdsurrogate.problem import compile_scene
from pdsurrogate.solvers import preconditioner
from pdsurrogate.solvers.nearest_bonds import Preconditioner
from pdsurrogate.solvers.preconditioner import SHORT_INSIDE, search_preconditioner, stiffness_of_nearest_bonds

RELAXED = {"body.arrangement": "relaxed", "body.seed": 1}


def added(scene):
    """Return the displacements that a search adds under unit forces, in units of those that the nearest bonds permit, and the body."""
    problem = compile_scene(scene, [FORCES["bond-energy"]()])
    force, _ = problem.bind()
    nothing = Preconditioner(np.zeros_like)
    found = search_preconditioner(nothing, force, problem.loading.free).solve(np.ones_like(problem.body.points))
    return found * stiffness_of_nearest_bonds(force), problem.body


def test_short_displacements_are_added_inside_relaxed_sheets_alone():
    moved, body = added(pds.load_scene("uniaxial", {"spacing": 0.1, **RELAXED}))
    to_free_edge = np.minimum(body.points[:, 1], 1.0 - body.points[:, 1]) / body.spacing
    assert np.allclose(moved[to_free_edge > body.horizon / body.spacing], SHORT_INSIDE)
    assert (moved[to_free_edge < 1] == 0).all()
    assert set(np.unique(moved.round(12))) == {0.0, SHORT_INSIDE}

    for other in ({}, RELAXED | {"plane": "strain", "material.bulk_modulus": 1e3}):
        assert not added(pds.load_scene("uniaxial", {"spacing": 0.1, **other}))[0].any()


def test_a_relaxed_sheet_in_tension_needs_fewer_evaluations_for_the_same_stress(monkeypatch):
    scene = pds.load_scene("uniaxial", {"spacing": 0.05, "horizon_ratio": 2.2, "stretches": [1.5], **RELAXED})
    found = []
    for amount in (SHORT_INSIDE, 0.0):
        monkeypatch.setattr(preconditioner, "SHORT_INSIDE", amount)
        found.append(pds.simulate(scene, "bond-energy", threads=1).levels[-1])
    with_them, without = found
    assert with_them["evaluations"] <= 0.95 * without["evaluations"]
    assert np.isclose(with_them["nominal_stress"], without["nominal_stress"], rtol=1e-5)
