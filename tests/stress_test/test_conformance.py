"""Every force model of the table, put to every property: `pdsurrogate.stress_test.conformance` holds both."""

from functools import cache, partial

import numpy as np
import pytest
from conftest import SHIPPED
from hypothesis import given, settings
from hypothesis import strategies as st
from own_forces import MyRubber
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures

import pdsurrogate as pds
from pdsurrogate.forces import FORCES, ForceSettings
from pdsurrogate.forces.nosb import NOSBForce, PointStress
from pdsurrogate.forces.pair_energy import PairEnergy
from pdsurrogate.solvers import equilibrium
from pdsurrogate.stress_test.case import INAPPLICABLE, PASS, WEAK, WEAKNESSES, Subject
from pdsurrogate.stress_test.conformance import (
    MOMENTS,
    PROPERTIES,
    TABLE,
    Deformation,
    Row,
    energy_account,
    force_balance,
    linear_momentum,
    objectivity,
    rigid_rotation,
    settings_refused,
    small_loads,
)

subject_of = cache(Subject)
"""What is measured on the way is shared by the properties of a model."""

PAIRS = [(row, case) for row in TABLE for case in PROPERTIES]

SINGLE = "neo-hookean-isochoric", "space", "single_precision"
"""Case that the quick suite leaves to the slow one: energies of sheets, and of solids in double precision, have the same passes."""

SLOW = {"full-network", "ogden", "full-network-isochoric", "arruda-boyce-isochoric", "ogden-isochoric"}
"""Models that the quick suite leaves to the slow one: they differ in law and weights alone from gent, a polynomial for sheets, and from
neo-hookean-isochoric, an energy for solids, which make every case in both."""

deformations = st.builds(Deformation, *[st.floats(0.7, 2.0)] * 2, *[st.floats(-180, 180)] * 2, st.floats(0, 0.01), st.integers(0, 2**31))


def each(pairs):
    cases = [
        pytest.param(
            row,
            case,
            id=f"{row.name}-{case.key}",
            marks=[pytest.mark.slow] * (row.reference in SLOW or (row.reference, row.plane, case.key) == SINGLE),
        )
        for row, case in pairs
    ]
    return pytest.mark.parametrize(("row", "case"), cases)


@each([pair for pair in PAIRS if not pair[1].drawn])
def test_property(row, case):
    judge(row, case, case(subject_of(row.reference, plane=row.plane)))


@each([pair for pair in PAIRS if pair[1].drawn])
@settings(max_examples=8)
@given(deformation=deformations)
def test_property_in_any_deformation(row, case, deformation):
    judge(row, case, case(subject_of(row.reference, plane=row.plane), [deformation]))


def judge(row, case, outcome):
    """A model has the property, or keeps the bound that its row states."""
    if outcome.verdict == INAPPLICABLE:
        pytest.skip(outcome.figure)
    departure = row.departures.get(case.key)
    if departure is None:
        assert outcome.verdict == PASS, f"{outcome.figure}: {outcome.weakness}"
    elif departure.bound is not None:
        assert outcome.value <= departure.bound, outcome.figure


@each([pair for pair in PAIRS if pair[1].key in pair[0].departures])
def test_what_a_row_states_is_so(row, case):
    """A departure that the model no longer has is struck off the table."""
    outcome = case(subject_of(row.reference, plane=row.plane))
    assert outcome.verdict == WEAK
    assert outcome.weakness == row.departures[case.key].weakness


class OwnEnergy:
    """Neo-Hookean rubber as an energy of one's own."""

    def energy(self, I1bar, I2bar):
        return 0.5 * (I1bar - 3), 0.5, 0.0


BROUGHT = {"own-force": MyRubber, "own-energy": OwnEnergy, "spline": None}
"""What users bring, put to the suite: forces in Python as they are, and a regressor of another make, resampled and stored."""


@pytest.fixture(scope="module")
def brought(tmp_path_factory):
    """The subjects of `BROUGHT`: forces in Python stand in the table of force models for as long, as one of the package would."""
    law = pds.materials.Ogden()
    samples = pds.training_samples(law, 1500, (0.5, 4.0), random_state=0)
    model = pds.surrogate_pipeline(make_pipeline(PolynomialFeatures(6), Ridge(1e-4)), features="isochoric").fit(samples.X, samples.y)
    path = pds.store(model, samples, law, tmp_path_factory.mktemp("brought"), "polynomial", "1", "resampled")
    assert isinstance(pds.load_surrogate(path), pds.forces.SplineForce)
    with pytest.MonkeyPatch.context() as patch:
        for name, own in BROUGHT.items():
            if own is not None:
                patch.setitem(FORCES, name, partial(pds.forces.OwnBondForce, own()))
        yield {name: Subject(str(path) if own is None else name) for name, own in BROUGHT.items()}


@pytest.mark.filterwarnings("ignore:.* encountered in:RuntimeWarning")  # of users' own arithmetic in impossible states
@pytest.mark.parametrize("case", PROPERTIES, ids=lambda case: case.key)
@pytest.mark.parametrize("name", BROUGHT)
def test_what_users_bring_has_the_properties_of_every_bond_force(brought, name, case):
    """Every one but that of moments, which no bond force has; forces in Python are in double precision alone."""
    row = Row(name, MOMENTS)
    outcome = case(brought[name])
    if case.key == "single_precision":
        assert (outcome.verdict == INAPPLICABLE) == (name != "spline")
    elif case.key not in ("threads", "energy_account"):  # of threads there may be but one, and bond forces have no energy
        assert outcome.verdict != INAPPLICABLE
    if case.key in row.departures:
        assert outcome.weakness == "moments"
    judge(row, case, outcome)


def test_models_that_are_left_to_the_slow_suite_are_in_the_table():
    assert {row.reference for row in TABLE} >= SLOW
    assert SINGLE in {(row.reference, row.plane, case.key) for row, case in PAIRS}


def test_every_shipped_model_is_in_the_table():
    """gent, ogden and full-network were in none of the three lists that were kept before."""
    # Forces that tests bring are among FORCES while this module runs.
    shipped = {*FORCES, *(path.parent.parent.name for path in SHIPPED.glob("*/*/card.json"))} - set(BROUGHT)
    assert {row.reference.partition("@")[0] for row in TABLE} == shipped
    keys = {case.key for case in PROPERTIES}
    for row in TABLE:
        assert set(row.departures) <= keys
        assert {departure.weakness for departure in row.departures.values()} <= set(WEAKNESSES)


class Spoiled(NOSBForce):
    """Correspondence forces with something added to every point's, and settings that are taken in silence."""

    added = 1e-6

    def bind(self, body, law, settings):
        return super().bind(body, law, ForceSettings(breakable=True))

    def terms(self, plane):
        return (SpoiledStress,)


class SpoiledStress(PointStress):
    def find(self, out):
        super().find(out)
        out += [0.0, Spoiled.added]


@pytest.mark.parametrize("added", [1e-6, np.nan])
def test_properties_can_fail(monkeypatch, added):
    """A weight on every point is found, and so are forces that are no numbers."""
    monkeypatch.setitem(FORCES, "nosb", Spoiled)
    monkeypatch.setattr(Spoiled, "added", added)
    for function in (rigid_rotation, objectivity, linear_momentum):
        assert function(Subject("nosb")).verdict == WEAK


def test_settings_that_are_ignored_are_found(monkeypatch):
    monkeypatch.setitem(FORCES, "nosb", Spoiled)
    silent = settings_refused(Subject("nosb"))
    assert silent.weakness == "settings ignored"
    assert "correction=scalar changes nothing" in silent.figure


def test_loads_that_are_small_beside_the_tolerance_are_found(monkeypatch):
    """Without holding the forces left against the load, as solvers did not, there is no displacement, and the clamp carries too little."""
    monkeypatch.setattr(equilibrium, "UNBALANCED", np.inf)
    assert small_loads(Subject("bond-energy")).verdict == WEAK
    assert force_balance(Subject("bond-energy")).verdict == WEAK


def test_energy_that_is_made_is_found(monkeypatch):
    """An energy that is stated a tenth too large leaves no account within 1 %."""
    stated = PairEnergy.energy
    monkeypatch.setattr(PairEnergy, "energy", lambda term: 1.1 * stated(term))
    assert energy_account(Subject("bond-energy")).verdict == WEAK
