"""Every force model of the table, put to every property: `pdsurrogate.stress_test.conformance` holds both."""

from functools import cache

import numpy as np
import pytest
from conftest import SHIPPED
from hypothesis import given, settings
from hypothesis import strategies as st

from pdsurrogate.forces import FORCES, ForceSettings
from pdsurrogate.forces.nosb import CorrespondenceForce
from pdsurrogate.stress_test.case import INAPPLICABLE, PASS, WEAK, WEAKNESSES, Subject
from pdsurrogate.stress_test.conformance import PROPERTIES, TABLE, Deformation, linear_momentum, objectivity, settings_refused

subject_of = cache(Subject)
"""What is measured on the way is shared by the properties of a model."""

PAIRS = [(row, case) for row in TABLE for case in PROPERTIES]

deformations = st.builds(Deformation, *[st.floats(0.7, 2.0)] * 2, *[st.floats(-180, 180)] * 2, st.floats(0, 0.01), st.integers(0, 2**31))


def each(pairs):
    return pytest.mark.parametrize(("row", "case"), pairs, ids=[f"{row.reference}-{case.key}" for row, case in pairs])


@each([pair for pair in PAIRS if not pair[1].drawn])
def test_property(row, case):
    judge(row, case, case.function(subject_of(row.reference)))


@each([pair for pair in PAIRS if pair[1].drawn])
@settings(max_examples=15)
@given(deformation=deformations)
def test_property_in_any_deformation(row, case, deformation):
    judge(row, case, case.function(subject_of(row.reference), [deformation]))


def judge(row, case, outcome):
    """A model has the property, or keeps the bound that its row states."""
    if outcome.verdict == INAPPLICABLE:
        pytest.skip(outcome.figure)
    departure = row.departures.get(case.key)
    if departure is None:
        assert outcome.verdict == PASS, f"{outcome.figure}: {outcome.weakness}"
    else:
        assert outcome.value <= departure.limit(row.reference), outcome.figure


@each([pair for pair in PAIRS if pair[1].key in pair[0].departures])
def test_what_a_row_states_is_so(row, case):
    """A departure that the model no longer has is struck off the table."""
    outcome = case.function(subject_of(row.reference))
    assert outcome.verdict == WEAK
    assert outcome.weakness == row.departures[case.key].weakness


def test_every_shipped_model_is_in_the_table():
    """gent, ogden and full-network were in none of the three lists that were kept before."""
    shipped = {*FORCES, *(path.parent.parent.name for path in SHIPPED.glob("*/*/card.json"))}
    assert {row.reference for row in TABLE} == shipped
    keys = {case.key for case in PROPERTIES}
    for row in TABLE:
        assert set(row.departures) <= keys
        assert {departure.weakness for departure in row.departures.values()} <= set(WEAKNESSES)


class Spoilt(CorrespondenceForce):
    """Correspondence forces with a weight on every point, and a setting that is taken in silence."""

    name = "spoilt"

    def bind(self, body, law, settings):
        force = super().bind(body, law, ForceSettings(breakable=True))

        class Evaluation:
            def __getattr__(self, name):
                return getattr(force, name)

            def __call__(self, positions, out):
                force(positions, out)
                out -= [0.0, 1e-6]

        return Evaluation()


def test_properties_can_fail(monkeypatch):
    monkeypatch.setitem(FORCES, "nosb", Spoilt)
    spoilt = Subject("nosb")
    for found in (objectivity(spoilt), linear_momentum(spoilt)):
        assert found.verdict == WEAK
    silent = settings_refused(spoilt)
    assert silent.weakness == "settings ignored"
    assert "correction=scalar changes nothing" in silent.figure
    assert np.isfinite(silent.value)
