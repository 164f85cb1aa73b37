"""Every force model of the table, and models that users bring, put to every property; every law
to those of laws.
"""

import re

import numpy as np
import pytest
from conftest import LAWS, SHIPPED
from force_models import LEARNED_THICKNESS, MOMENTS, TABLE
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
from pdsurrogate.testing import FORCE_MODEL_PROPERTIES, LAW_PROPERTIES, check_force_model, check_law
from pdsurrogate.testing.bodies import Deformation

PAIRS = [(row, one) for row in TABLE for one in FORCE_MODEL_PROPERTIES]

SINGLE = "neo-hookean-isochoric", "space", "single_precision"
"""Case that the quick suite leaves to the slow one: energies of sheets, and of solids in double
precision, have the same passes.
"""

SLOW = {
    "full-network",
    "ogden",
    "full-network-isochoric",
    "arruda-boyce-isochoric",
    "ogden-isochoric",
}
"""Models that the quick suite leaves to the slow one: they differ in law and weights alone from
gent, a polynomial for sheets, and from neo-hookean-isochoric, an energy for solids, which make
every case in both.
"""

deformations = st.builds(
    Deformation,
    *[st.floats(0.7, 2.0)] * 2,
    *[st.floats(-180, 180)] * 2,
    st.floats(0, 0.01),
    st.integers(0, 2**31),
)


def each(pairs):
    cases = [
        pytest.param(
            row,
            one,
            id=f"{row.name}-{one.name}",
            marks=[pytest.mark.slow]
            * (row.reference in SLOW or (row.reference, row.plane, one.name) == SINGLE),
        )
        for row, one in pairs
    ]
    return pytest.mark.parametrize(("row", "one"), cases)


@each([pair for pair in PAIRS if not pair[1].drawn])
def test_property(row, one):
    judge(one(row.subject, tolerance=row.departures.get(one.name)))


@each([pair for pair in PAIRS if pair[1].drawn])
@settings(max_examples=8)
@given(deformation=deformations)
def test_property_in_any_deformation(row, one, deformation):
    judge(one(row.subject, [deformation], tolerance=row.departures.get(one.name)))


def judge(finding):
    if finding.value is None:
        pytest.skip(finding.note)
    assert finding.holds, str(finding)


@each([pair for pair in PAIRS if pair[1].name in pair[0].departures])
def test_what_a_row_states_is_so(row, one):
    """A departure that the model no longer has is struck off the table."""
    assert not one(row.subject).holds


class OwnEnergy:
    """Neo-Hookean rubber as an energy of one's own."""

    def energy(self, I1bar, I2bar):
        return 0.5 * (I1bar - 3), 0.5, 0.0


BROUGHT = {"own-force": MyRubber, "own-energy": OwnEnergy, "spline": None}
"""What users bring: forces in Python as they are, and a regressor of another make, resampled and
stored.
"""


OF_FIT = dict.fromkeys(LEARNED_THICKNESS, 0.02)
"""Of the spline, whose error is 1.2 %."""


@pytest.fixture(scope="module")
def brought(tmp_path_factory):
    """What `BROUGHT` names, as a user gives it to the check."""
    law = pds.materials.Ogden()
    samples = pds.training_samples(law, 1500, (0.5, 4.0), random_state=0)
    model = pds.surrogate_pipeline(
        make_pipeline(PolynomialFeatures(6), Ridge(1e-4)), features="isochoric"
    ).fit(samples.X, samples.y)
    path = pds.store(
        model, samples, law, tmp_path_factory.mktemp("brought"), "polynomial", "1", "resampled"
    )
    assert isinstance(pds.load_surrogate(path), pds.forces.SplineForce)
    return {name: str(path) if own is None else own() for name, own in BROUGHT.items()}


@pytest.mark.filterwarnings(
    "ignore:.* encountered in:RuntimeWarning"
)  # of users' own arithmetic in impossible states
@pytest.mark.parametrize("name", BROUGHT)
def test_what_users_bring_has_the_properties_of_every_bond_force(brought, name):
    """Every one but that of moments, which no bond force has; forces in Python are in double
    precision alone, have no energy, and are not compiled.
    """
    findings = check_force_model(
        brought[name], tolerances=MOMENTS | (OF_FIT if name == "spline" else {})
    )
    left_out = {finding.name for finding in findings if finding.value is None} - {
        "threads"
    }  # of threads there may be but one
    in_python = {"single_precision", "kernel_and_numpy"}
    assert left_out == {"energy_account"} | (in_python if name != "spline" else set())
    with pytest.raises(
        AssertionError, match=r"lacks 1 of 1 properties:\n  angular_momentum: .*, tolerance 1e-09"
    ):
        check_force_model(brought[name], properties=["angular_momentum"])


def test_the_guide_names_every_property_and_its_tolerance():
    listed = re.findall(
        r"^\| `(\w+)` \| (\S+) \|",
        (SHIPPED.parent / "docs" / "guide" / "testing.md").read_text(),
        re.MULTILINE,
    )
    assert listed == [
        (one.name, f"{one.tolerance:g}") for one in (*FORCE_MODEL_PROPERTIES, *LAW_PROPERTIES)
    ]


def test_models_that_are_left_to_the_slow_suite_are_in_the_table():
    assert {row.reference for row in TABLE} >= SLOW
    assert SINGLE in {(row.reference, row.plane, one.name) for row, one in PAIRS}


def test_every_shipped_model_is_in_the_table():
    shipped = {*FORCES, *(path.parent.parent.name for path in SHIPPED.glob("*/*/card.json"))}
    assert {row.reference.partition("@")[0] for row in TABLE} == shipped
    names = {one.name for one in FORCE_MODEL_PROPERTIES}
    assert all(set(row.departures) <= names for row in TABLE)


class Spoiled(NOSBForce):
    """Correspondence forces with something added to every point's, and settings that are taken
    in silence.
    """

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
    monkeypatch.setattr(Spoiled, "added", added)
    names = ["rigid_rotation", "objectivity", "linear_momentum", "cuts_that_touch"]
    with pytest.raises(AssertionError, match="lacks 4 of 4 properties"):
        check_force_model(Spoiled(), properties=names)


def test_settings_that_are_ignored_are_found():
    with pytest.raises(AssertionError, match="correction=scalar changes nothing"):
        check_force_model(Spoiled(), properties=["settings_refused"])


def lacks(*names):
    with pytest.raises(AssertionError, match=f"lacks {len(names)} of {len(names)} properties"):
        check_force_model("bond-energy", properties=names)


def test_loads_that_are_small_beside_the_tolerance_are_found(monkeypatch):
    """Without holding the forces left against the load, as solvers did not, there is no
    displacement, and the clamp carries too little.
    """
    monkeypatch.setattr(equilibrium, "UNBALANCED", np.inf)
    lacks("small_loads", "force_balance")


def test_energy_that_is_made_is_found(monkeypatch):
    """An energy that is stated a tenth too large leaves no account within 1 %."""
    stated = PairEnergy.stored
    monkeypatch.setattr(PairEnergy, "stored", lambda term: 1.1 * stated(term))
    lacks("energy_account")


def test_loads_that_are_not_balanced_are_found(monkeypatch):
    """As before gradients were balanced: points felt a uniform stress otherwise than loads act
    on them.
    """
    monkeypatch.setattr(pds.Body, "outward", None)
    lacks(
        "tractions_on_lattice", "tractions_on_relaxed", "tractions_on_mesh", "pressure_on_lattice"
    )


@pytest.mark.parametrize("one", LAW_PROPERTIES, ids=lambda one: one.name)
@pytest.mark.parametrize("law", LAWS, ids=lambda law: f"{law.name}-{law.shear_modulus:g}")
def test_property_of_a_law(law, one):
    judge(one(law))


class Unsound(pds.materials.NeoHookean):
    """Its volumetric stress is a thousandth too great, and its isochoric energy depends on the
    observer by nothing: only one is wrong.
    """

    name = "unsound"

    @staticmethod
    def volumetric(J3, parameters):
        U, slope, curvature = pds.materials.NeoHookean.volumetric(J3, parameters)
        return U, 1.001 * slope, curvature


def test_a_law_with_a_wrong_derivative_lacks_it():
    with pytest.raises(
        AssertionError, match=r"derivatives: inf.*U' is .* but by finite differences"
    ):
        check_law(Unsound(), properties=["derivatives"])
    (finding,) = check_law(Unsound(), properties=["description"])
    assert finding.value is None
    assert "LAWS" in finding.note


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (
            lambda: check_force_model("analytic", properties=["moments"]),
            ValueError,
            "unknown property 'moments'; the properties are r",
        ),
        (
            lambda: check_force_model("analytic", tolerances={"moments": 1.0}),
            ValueError,
            "unknown property",
        ),
        (
            lambda: check_force_model("analytic", plane="space"),
            ValueError,
            "analytic does not support plane=space",
        ),
        (
            lambda: check_force_model("analytic", plane="sky"),
            ValueError,
            "plane must be stress, strain, space, not 'sky'",
        ),
        (lambda: check_force_model(3.0), TypeError, "must be a force model, its name or path"),
        (lambda: check_force_model("wizardry"), pds.ArtifactError, "unknown force"),
        (
            lambda: check_force_model("neo-hookean", pds.materials.Gent()),
            ValueError,
            "describes the law neo-hookean, not gent",
        ),
        (lambda: check_law("gent"), TypeError, "law must be a material law"),
    ],
)
def test_what_cannot_be_checked_is_refused(call, error, message):
    with pytest.raises(error, match=message):
        call()
