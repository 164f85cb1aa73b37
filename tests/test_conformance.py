"""Every force model of the table, put to every property: `pdsurrogate.stress_test.conformance` holds both."""

from functools import cache

import numpy as np
import pytest
from conftest import SHIPPED
from hypothesis import given, settings
from hypothesis import strategies as st

from pdsurrogate.forces import FORCES, ForceSettings
from pdsurrogate.forces.nosb import NOSBEvaluation, NOSBForce
from pdsurrogate.stress_test.case import INAPPLICABLE, PASS, WEAK, WEAKNESSES, Subject
from pdsurrogate.stress_test.conformance import (
    PROPERTIES,
    TABLE,
    Deformation,
    linear_momentum,
    objectivity,
    rigid_rotation,
    settings_refused,
)

subject_of = cache(Subject)
"""What is measured on the way is shared by the properties of a model."""

PAIRS = [(row, case) for row in TABLE for case in PROPERTIES]

deformations = st.builds(Deformation, *[st.floats(0.7, 2.0)] * 2, *[st.floats(-180, 180)] * 2, st.floats(0, 0.01), st.integers(0, 2**31))


def each(pairs):
    return pytest.mark.parametrize(("row", "case"), pairs, ids=[f"{row.name}-{case.key}" for row, case in pairs])


@each([pair for pair in PAIRS if not pair[1].drawn])
def test_property(row, case):
    judge(row, case, case.function(subject_of(row.reference, plane=row.plane)))


@each([pair for pair in PAIRS if pair[1].drawn])
@settings(max_examples=15)
@given(deformation=deformations)
def test_property_in_any_deformation(row, case, deformation):
    judge(row, case, case.function(subject_of(row.reference, plane=row.plane), [deformation]))


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
    outcome = case.function(subject_of(row.reference, plane=row.plane))
    assert outcome.verdict == WEAK
    assert outcome.weakness == row.departures[case.key].weakness


def test_every_shipped_model_is_in_the_table():
    """gent, ogden and full-network were in none of the three lists that were kept before."""
    shipped = {*FORCES, *(path.parent.parent.name for path in SHIPPED.glob("*/*/card.json"))}
    assert {row.reference.partition("@")[0] for row in TABLE} == shipped
    keys = {case.key for case in PROPERTIES}
    for row in TABLE:
        assert set(row.departures) <= keys
        assert {departure.weakness for departure in row.departures.values()} <= set(WEAKNESSES)


class Spoilt(NOSBForce):
    """Correspondence forces with something added to every point's, and settings that are taken in silence."""

    added = 1e-6

    def bind(self, body, law, settings):
        return SpoiltEvaluation(body, law, ForceSettings(breakable=True))


class SpoiltEvaluation(NOSBEvaluation):
    def evaluate(self, positions, out):
        super().evaluate(positions, out)
        out += [0.0, Spoilt.added]


@pytest.mark.parametrize("added", [1e-6, np.nan])
def test_properties_can_fail(monkeypatch, added):
    """A weight on every point is found, and so are forces that are no numbers."""
    monkeypatch.setitem(FORCES, "nosb", Spoilt)
    monkeypatch.setattr(Spoilt, "added", added)
    for function in (rigid_rotation, objectivity, linear_momentum):
        assert function(Subject("nosb")).verdict == WEAK


def test_settings_that_are_ignored_are_found(monkeypatch):
    monkeypatch.setitem(FORCES, "nosb", Spoilt)
    silent = settings_refused(Subject("nosb"))
    assert silent.weakness == "settings ignored"
    assert "correction=scalar changes nothing" in silent.figure
