"""The hard cases: that they run, that they can fail, and what each force model must pass."""

import numpy as np
import pytest
from hard_cases import (
    CASES,
    INAPPLICABLE,
    PASS,
    STOPS,
    WEAK,
    WEAKNESSES,
    Outcome,
    all_models,
    cell,
    hard_cases,
    of_simplices,
    regular,
    results_of,
    sheared_layer,
    spring_stiffness,
    tangent,
    under_test,
)

from pdsurrogate.forces import InternalForce

BOND_FORCES = {"symmetry", "undamped_steps", "slender"}
"""What a force made of averaged features does not pass (theory, section 10), nor with a bar of
four points across.
"""

CONTRASTS = {"sheared_layer", "confined_layer"}
"""What bond forces do not pass at all; energies are beyond the limit in a confined layer, and in
space in a sheared one.
"""

MODES = {
    "single_point",
    "checkerboard",
    "least_eigenvalue",
    "equibiaxial",
    "simple_shear",
    "jitter",
    "mesh",
    "horizons",
    "slender",
    "notch_tip",
}
"""Where modes without energy show, in the plane and in space."""


def weak(results) -> set[str]:
    return {name for name, outcome in results.items() if outcome.verdict == WEAK}


QUICK_SHEETS = ("neo-hookean", "nosb")


def test_a_surrogate_passes_what_physics_allows_and_nosb_does_not():
    """The shipped surrogate lacks conservation only; NOSB's zero-energy modes show wherever they
    can.
    """
    surrogate, nosb = (results_of(under_test(name)) for name in QUICK_SHEETS)
    assert weak(surrogate) <= BOND_FORCES | CONTRASTS
    assert "symmetry" in weak(surrogate)
    assert weak(nosb) >= MODES
    assert "symmetry" not in weak(nosb)
    for results in (surrogate, nosb):
        assert set(results) == {case.key for case in CASES if "stress" in case.planes}
        for outcome in results.values():
            assert outcome.verdict in (PASS, STOPS, WEAK, INAPPLICABLE)
            assert (outcome.weakness in WEAKNESSES) == (outcome.verdict == WEAK)


QUICK_IN_SPACE = (
    "single_point",
    "checkerboard",
    "least_eigenvalue",
    "rigid_motions",
    "symmetry",
    "simple_shear",
    "mesh",
    "loose_points",
)
"""Cases of a few seconds."""


@pytest.mark.slow  # the quick suite has these models among the properties of `test_force_models.py`
def test_in_space_a_learned_energy_passes_and_nosb_shows_its_modes():
    keys = (*QUICK_IN_SPACE, "beyond_the_domain", "sudden_load", "time_step")
    cases = [case for case in CASES if case.key in keys]
    learned, nosb = (
        results_of(under_test(name, "space"), cases) for name in ("neo-hookean-isochoric", "nosb")
    )
    assert weak(learned) == set()
    # One point by itself, among 26 neighbors, is no such mode; NOSB stands at the limit there.
    assert weak(nosb) - {"single_point"} == MODES & set(keys) - {"single_point"}


@pytest.mark.slow
@pytest.mark.parametrize("plane", ["stress", "space"])
def test_every_model_on_every_case(plane):
    """Surrogates on symmetric features and energies pass all that physics allows; the exact bond
    force does as well.

    With a fiftieth of the steps of dynamics; without the two models of sheets that the quick test
    above holds to the same, and in space without the two energies whose exact laws take as long as
    all others together; `pipelines/hard_cases.py --full` takes them all.

    The error of the torque by Ogden's law changes by 2.2 % from 10 to 180 degrees, 9.0 to 6.8 %, by
    the exact energy too (allowed 2).
    """
    left_out = {
        "stress": QUICK_SHEETS,
        "space": ("arruda-boyce-isochoric", "full-network-isochoric"),
    }[plane]
    for name in all_models(plane):
        if name not in (*left_out, "nosb", "ba-nosb", "neo-hookean-paper"):
            torsion = {"torsion"} if name == "ogden-isochoric" else set()
            found = weak(results_of(under_test(name, plane)))
            assert found <= (
                BOND_FORCES | CONTRASTS if plane == "stress" else CONTRASTS | torsion
            ), name


def test_a_sheared_layer_is_soft_for_an_energy_alone():
    """At a contrast of 10 the energy was 60 % too stiff, and 6000 times at 10^5, as bond forces
    still are; others refuse with a reason.
    """
    energy, bond_force, single = (
        sheared_layer(under_test(name)) for name in ("bond-energy", "analytic", "ba-nosb")
    )
    assert energy.verdict == PASS
    assert energy.value < 0.02
    assert bond_force.weakness == "stiff contrasts"
    assert bond_force.value > 100
    assert single.verdict == INAPPLICABLE
    assert "one material" in single.figure


def test_every_force_model_takes_part():
    assert {"analytic", "nosb", "ba-nosb", "neo-hookean", "neo-hookean-paper", "gent"} <= set(
        all_models("stress")
    )
    assert {"bond-energy", "nosb", "neo-hookean-isochoric", "full-network-isochoric"} <= set(
        all_models("space")
    )
    assert "analytic" not in all_models("space")


def test_tables_have_a_row_for_every_case_and_a_column_for_every_model():
    fast = [case for case in CASES if case.key in ("rigid_motions", "symmetry")]
    text = hard_cases("stress", ["analytic", "nosb", "ogden-isochoric"], False, fast)
    header, _, *rows, counts = [line for line in text.splitlines() if line.startswith("|")]
    assert header == "| case | asked | analytic | nosb |"
    assert len(rows) == 2
    assert "**weak**" in rows[1]
    assert counts == "| passed / weak / does not apply |  | 1 / 1 / 0 | 2 / 0 / 0 |"
    assert "*not conservative*: the force has no energy" in text


def test_the_tangent_of_springs_is_what_it_is():
    """Springs of one stiffness between all neighbors: their tangent at rest is the stiffness
    matrix, to differences.
    """
    body = regular(2, 5)

    class Springs:
        precision, has_energy, tangent = "float64", True, InternalForce.tangent

        def __init__(self):
            self.body = body

        def __call__(self, positions, out):
            out[:] = 0
            bonds = body.bonds
            rest = body.points[bonds.second] - body.points[bonds.first]
            direction = rest / ((rest**2).sum(axis=1) ** 0.5)[:, None]
            moved = positions[bonds.second] - positions[bonds.first] - rest
            pull = direction * (moved * direction).sum(axis=1)[:, None]
            for end, sign in ((bonds.first, 1), (bonds.second, -1)):
                for k, point in enumerate(end):
                    out[point] += sign * pull[k]

    formed = tangent(Springs(), body.points.copy())
    assert formed.matrix.shape == (18, 18)
    assert formed.asymmetry < 1e-8
    assert np.linalg.eigvalsh(formed.symmetric)[0] > 0
    # The diagonal of the middle point: sum of n (x) n over its 20 neighbors within 3.15 spacings in
    # a 5 x 5 sheet.
    bonds = body.points - body.points[12]
    near = [k for k in range(25) if 0 < (bonds[k] ** 2).sum() ** 0.5 <= 0.315]
    block = sum(bonds[k][:, None] * bonds[k] / (bonds[k] ** 2).sum() for k in near)
    assert abs(formed.matrix[8:10, 8:10] - block).max() < 1e-8


def test_spring_stiffness_by_hand():
    """4 mu V^2 sum(w)/kappa with kappa = pi delta^4/3 and w = delta/l, over the 28 neighbors
    within 3.15 spacings.
    """
    distances = [1] * 4 + [2**0.5] * 4 + [2] * 4 + [5**0.5] * 8 + [8**0.5] * 4 + [3] * 4
    kappa = 3.141592653589793 / 3 * 3.15**4
    by_hand = 4 * 2.5 * sum(3.15 / distance for distance in distances) / kappa
    assert spring_stiffness(regular(2, 5), 2.5) == pytest.approx(by_hand)


def test_springs_in_space_by_hand():
    """4 mu V^2 sum(w)/kappa with kappa = pi delta^5/3 and w = delta/l, over the 18 neighbors
    within 1.5 spacings.
    """
    by_hand = 4 * 2.5 * 1.5 * (6 + 12 / 2**0.5) / (3.141592653589793 / 3 * 1.5**5) * 0.1
    assert spring_stiffness(regular(3, 3, 1.5), 2.5) == pytest.approx(by_hand)


@pytest.mark.parametrize("dimension", [2, 3])
def test_triangles_and_tetrahedra_fill_the_body(dimension):
    """They leave no gap and do not overlap: volume and middle of the square or cube."""
    body = of_simplices(np.random.default_rng(0), dimension, 4)
    assert len(body) == 4**dimension * (2 if dimension == 2 else 6)
    assert body.volumes.sum() == pytest.approx(0.4**dimension, rel=1e-12)
    np.testing.assert_allclose(body.volumes @ body.points / body.volumes.sum(), 0.2, rtol=1e-12)
    assert body.volumes.std() > 0.05 * body.volumes.mean()


def test_a_sheet_in_space_has_no_stress_across():
    subject = under_test("bond-energy", "space")
    F = subject.gradient(np.array([[1.5, 0.3], [0.0, 0.9]]))
    assert np.abs(subject.exact_stress(F)[2]).max() < 1e-9
    plane = under_test("bond-energy")
    np.testing.assert_allclose(
        subject.exact_stress(F)[:2, :2], plane.exact_stress(F[:2, :2]), rtol=1e-9
    )


def test_outcomes_and_cells():
    assert Outcome.below(1.0, 2.0, "accuracy").verdict == PASS
    assert Outcome.below(float("nan"), 2.0, "accuracy").verdict == WEAK
    assert Outcome.above(float("nan"), 2.0, "accuracy").verdict == WEAK
    assert Outcome.above(1.0, 2.0, "accuracy").weakness == "accuracy"
    assert cell(Outcome.above(1.0, 2.0, "accuracy")) == "**weak** 1: accuracy"
    assert cell(Outcome(STOPS, "somewhere")) == "stops somewhere"
    assert not under_test("neo-hookean").describes(under_test("gent").law)
    assert under_test("analytic").describes(under_test("gent").law)
