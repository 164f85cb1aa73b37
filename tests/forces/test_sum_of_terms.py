"""A force of two terms is their sum: two laws in one body, each a bond energy, against the law
that is their sum.
"""

from dataclasses import replace

import numpy as np
import pytest
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.body import ReflectionPlane
from pdsurrogate.forces import ForceSettings, MaterialPart, bind_portions, released_by
from pdsurrogate.forces.bond_force import BondForces
from pdsurrogate.forces.nosb import PointStress
from pdsurrogate.forces.pair_energy import PairEnergy
from pdsurrogate.materials import MooneyRivlin, NeoHookean
from pdsurrogate.testing.bodies import gripped, plain

LAW, SHEET_LAW = MooneyRivlin(1.0, 50.0, second_share=0.2), NeoHookean(1.0, 50.0)


def part_of(split):
    """Term of a bond energy of the law that `split` returns for that of a material."""

    class Part(PairEnergy):
        def __init__(self, binding):
            parts = [replace(portion, law=split(portion.law)) for portion in binding.portions]
            super().__init__(replace(binding, portions=parts))

    return Part


FIRST = part_of(lambda law: NeoHookean(0.6 * law.shear_modulus, 0.6 * law.bulk_modulus))
SECOND = part_of(
    lambda law: MooneyRivlin(0.4 * law.shear_modulus, 0.4 * law.bulk_modulus, second_share=0.5)
)
OF_SHEETS = part_of(lambda law: NeoHookean(0.4 * law.shear_modulus, 0.4 * law.bulk_modulus))


class Sum(pds.BondEnergyForce):
    """Forces of several terms."""

    name = family = "sum"

    def __init__(self, *kinds):
        self.kinds = kinds

    def terms(self, plane):
        return self.kinds


def clamped(dimension):
    """Body clamped at both ends by planes, of which one may turn, with a boundary that knows its
    loads.
    """
    ends = ((0.0, -1), (1.2, 1))
    body = plain(
        dimension,
        planes=tuple(ReflectionPlane(0, place, side, (-1,) * dimension) for place, side in ends),
    )
    places = body.points - body.points.mean(axis=0)
    outermost = np.abs(places[:, 1]) > np.abs(places[:, 1]).max() - 0.5 * body.spacing
    vars(body)["outward"] = (
        np.where(outermost, np.sign(places[:, 1]), 0.0)[:, None]
        * np.eye(dimension)[1]
        * 0.1 ** (dimension - 1)
    )
    return body


def both(plane, two_materials=False, body=None):
    """The sum of two terms and the force of the law that is their sum, on one body."""
    body = body or clamped(3 if plane == "space" else 2)
    law, kinds = (SHEET_LAW, (FIRST, OF_SHEETS)) if plane == "stress" else (LAW, (FIRST, SECOND))
    settings, models = (
        ForceSettings(plane=plane, precision="float64", breakable=True),
        (
            Sum(*kinds),
            pds.BondEnergyForce(),
        ),
    )
    if not two_materials:
        return body, *(model.bind(body, law, settings) for model in models)
    left = body.points[:, 0] < 0.6
    stiffer = replace(law, shear_modulus=4.0, bulk_modulus=200.0)
    parts = (law, np.flatnonzero(left)), (stiffer, np.flatnonzero(~left))
    return body, *(
        bind_portions(body, [MaterialPart(law, model, points) for law, points in parts], settings)
        for model in models
    )


def same(found, expected, scale=None):
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=1e-11 * np.abs(expected if scale is None else scale).max()
    )


def compare(one, other, positions):
    """All that solvers and results ask of the forces is the same."""
    out, expected = np.empty_like(positions), np.empty_like(positions)
    one(positions, out)
    other(positions, expected)
    same(out, expected)
    one.pass_bonds(out)
    same(out, expected)
    assert one.energy() == pytest.approx(other.energy(), rel=1e-12)
    for key in (
        "volume_ratios",
        "pair_forces",
        "forces_of_planes",
        "levers_on_planes",
        "mean_stress",
    ):
        same(getattr(one, key)(), getattr(other, key)())
    for found, right in zip(one.stress_and_energy(), other.stress_and_energy(), strict=True):
        same(found, right)
    if one.interfaces is None:
        motion = np.sin(3 * positions)
        same(released_by(one, motion), released_by(other, motion))
    if other.nearly_incompressible:
        stiffness, changes = zip(*(dilatation_of(force) for force in (one, other)), strict=True)
        same(*stiffness)
        np.testing.assert_array_equal(*changes)


def dilatation_of(force):
    """Stiffness against a change of dilatations, and changes of these."""
    found = force.linearized_dilatation()
    found.linearize()
    return found.stiffness, found.changes(np.sin(5 * force.body.points))


CASES = [("stress", False), ("stress", True), ("strain", False), ("strain", True), ("space", False)]


@pytest.mark.parametrize(("plane", "two_materials"), CASES)
def test_two_laws_are_the_law_that_is_their_sum(plane, two_materials):
    body, one, other = both(plane, two_materials)
    assert (one.has_energy, one.nearly_incompressible) == (
        other.has_energy,
        other.nearly_incompressible,
    )
    positions = body.points * 1.02 + 0.005 * np.sin(5 * body.points[:, ::-1])
    for force in (one, other):
        force.move_plane(1, np.full(body.dimension, 0.02), 0.02 * np.eye(body.dimension))
    compare(one, other, positions)
    direction = np.cos(4 * body.points).ravel()
    same(*(force.tangent(positions) @ direction for force in (one, other)), scale=1e4)
    if plane != "space":
        torn = np.flatnonzero((body.points[body.bonds.first] > 0.55).any(axis=1))[::7]
        for force in (one, other):
            force.break_bonds(torn)
        compare(one, other, positions)


def test_collapsed_pairs_are_those_of_either_term():
    body, one, other = both("stress")
    positions = body.points.copy()
    positions[30] = positions[31] + 1e-3
    for force in (one, other):
        with pytest.raises(pds.errors.InvalidState):
            force(positions, np.empty_like(positions))
    assert len(one.collapsed_pairs()) > 0
    np.testing.assert_array_equal(one.collapsed_pairs(), other.collapsed_pairs())


def test_what_does_not_add_up_is_refused_before_work_starts(monkeypatch):
    body, settings = gripped(2), ForceSettings(precision="float64")
    with raising("the thickness follows from the sum of all stresses; write one term for both"):
        Sum(FIRST, SECOND).bind(body, LAW, settings)
    learned = pds.load_surrogate("neo-hookean@1")
    monkeypatch.setattr(type(learned), "terms", lambda self, plane: (BondForces, BondForces))
    with raising("models with training data; only one may"):
        learned.bind(body, NeoHookean(), settings)


def test_an_energy_that_balances_gradients_comes_first():
    body, settings = clamped(2), ForceSettings(precision="float64")
    Sum(PairEnergy, PointStress).bind(body, LAW, settings)
    with raising("the first term of a force must be one with an energy"):
        Sum(PointStress, PairEnergy).bind(body, LAW, settings)
