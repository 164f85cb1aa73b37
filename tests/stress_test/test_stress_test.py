"""The suite of hard cases: that it runs, that its cases can fail, and what each force model must pass."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from pdsurrogate.cli import app
from pdsurrogate.forces import InternalForce
from pdsurrogate.stress_test import report as report_module
from pdsurrogate.stress_test.bodies import of_simplices, regular
from pdsurrogate.stress_test.case import INAPPLICABLE, PASS, STOPS, WEAK, Outcome, Subject, spring_stiffness
from pdsurrogate.stress_test.report import CASES, all_models, cell, planes_of, stress_test, table
from pdsurrogate.stress_test.runs import sheared_layer
from pdsurrogate.stress_test.tangents import tangent

BOND_FORCES = {"symmetry", "undamped_steps", "angular_momentum", "slender"}
"""What a force made of averaged features does not pass (theory, section 10), nor with a bar of four points across."""

CONTRASTS = {"sheared_layer", "confined_layer"}
"""What bond forces do not pass at all; energies are beyond the limit in a confined layer, and in space in a sheared one."""

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


def weak(model) -> set[str]:
    return {name for name, result in model["results"].items() if result["verdict"] == WEAK}


QUICK_SHEETS = ("neo-hookean", "nosb")


def test_a_surrogate_passes_what_physics_allows_and_nosb_does_not():
    """The quick suite, two models: the shipped surrogate lacks conservation only; NOSB's zero-energy modes show wherever they can."""
    report = stress_test(list(QUICK_SHEETS), threads=1, planes=["stress"])
    surrogate, nosb = report["models"]
    assert weak(surrogate) <= BOND_FORCES | CONTRASTS
    assert "symmetry" in weak(surrogate)
    assert weak(nosb) >= MODES
    assert "symmetry" not in weak(nosb)
    for model in report["models"]:
        assert set(model["results"]) == {case.key for case in CASES if "stress" in case.planes}
        for result in model["results"].values():
            assert result["verdict"] in (PASS, STOPS, WEAK, INAPPLICABLE)
            assert (result["weakness"] is not None) == (result["verdict"] == WEAK)
    assert "zero-energy modes" in report["weaknesses"]
    json.dumps(report, allow_nan=False)
    assert planes_of(report) == ["stress"]
    header, rows = table(report, "stress")
    assert header[2:] == ["neo-hookean", "nosb"]
    assert len(rows) == sum("stress" in case.planes for case in CASES)


QUICK_IN_SPACE = ("single_point", "checkerboard", "least_eigenvalue", "rigid_motions", "symmetry", "simple_shear", "mesh", "loose_points")
"""Cases of a few seconds."""


@pytest.mark.slow  # the quick suite has these models among the properties of `test_conformance.py`
def test_in_space_a_learned_energy_passes_and_nosb_shows_its_modes(monkeypatch):
    keys = (*QUICK_IN_SPACE, "beyond_the_domain", "sudden_load", "time_step")
    monkeypatch.setattr(report_module, "CASES", tuple(case for case in CASES if case.key in keys))
    report = stress_test(["neo-hookean-isochoric", "nosb"], threads=1)
    learned, sheets, nosb = report["models"]
    assert [(model["force"], model["plane"]) for model in (learned, sheets, nosb)] == [
        ("neo-hookean-isochoric", "space"),
        ("nosb", "stress"),
        ("nosb", "space"),
    ]
    assert weak(learned) == set()
    # One point by itself, among 26 neighbors, is no such mode; NOSB stands at the limit there.
    assert weak(nosb) - {"single_point"} == MODES & set(keys) - {"single_point"}
    assert planes_of(report) == ["stress", "space"]
    assert table(report, "space")[0][2:] == ["neo-hookean-isochoric", "nosb"]


@pytest.mark.slow
@pytest.mark.parametrize("plane", ["stress", "space"])
def test_every_model_on_every_case(plane):
    """Surrogates on symmetric features and energies pass all that physics allows; the exact bond force does as well.

    With a fiftieth of the steps of dynamics; without the two models of sheets that the quick test above holds to the same, and in space
    without the two energies whose exact laws take as long as all others together; `pipelines/stress_report.py` takes them all.

    The error of the torque by Ogden's law changes by 2.2 % from 10 to 180 degrees, 9.0 to 6.8 %, by the exact energy too (allowed 2).
    """
    left_out = {"stress": QUICK_SHEETS, "space": ("arruda-boyce-isochoric", "full-network-isochoric")}[plane]
    models = [name for name in all_models(plane) if name not in left_out]
    for model in stress_test(models, threads=1, planes=[plane])["models"]:
        if model["force"] not in ("nosb", "ba-nosb", "neo-hookean-paper"):
            torsion = {"torsion"} if model["force"] == "ogden-isochoric" else set()
            assert weak(model) <= (BOND_FORCES | CONTRASTS if plane == "stress" else CONTRASTS | torsion), model["force"]


def test_a_sheared_layer_is_soft_for_an_energy_alone():
    """At a contrast of 10 the energy was 60 % too stiff, and 6000 times at 10^5, as bond forces still are; others refuse with a reason."""
    energy, bond_force, single = (sheared_layer(Subject(name)) for name in ("bond-energy", "analytic", "ba-nosb"))
    assert energy.verdict == PASS
    assert energy.value < 0.02
    assert bond_force.weakness == "stiff contrasts"
    assert bond_force.value > 100
    assert single.verdict == INAPPLICABLE
    assert "one material" in single.figure


def test_every_force_model_takes_part():
    assert {"analytic", "nosb", "ba-nosb", "neo-hookean", "neo-hookean-paper", "gent"} <= set(all_models("stress"))
    assert {"bond-energy", "nosb", "neo-hookean-isochoric", "full-network-isochoric"} <= set(all_models("space"))
    assert "analytic" not in all_models("space")


def test_command(tmp_path, monkeypatch):
    fast = [case for case in CASES if case.key in ("rigid_rotation", "symmetry")]
    monkeypatch.setattr(report_module, "CASES", tuple(fast))
    done = CliRunner().invoke(app, ["stress-test", "--force", "analytic", "--force", "neo-hookean-paper", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "not conservative" in done.output
    assert "force at rest" in done.output
    written = json.loads((tmp_path / "stress-test.json").read_text())
    assert [(model["force"], model["plane"]) for model in written["models"]] == [("analytic", "stress"), ("neo-hookean-paper", "stress")]
    assert "sheets under plane stress" in done.output
    for arguments, message in (
        (["--force", "wizardry"], "unknown force"),
        (["--out", "/dev/null/x"], "this is a file, but a folder is needed"),
        (["--force", "ogden-isochoric", "--plane", "stress"], "supports plane=strain and space"),
        (["--force", "analytic", "--plane", "space"], "solids"),
        (["--plane", "strain"], "Invalid value for '--plane'"),
    ):
        refused = CliRunner().invoke(app, ["stress-test", *arguments])
        assert refused.exit_code == 2
        assert message in refused.stderr


def test_without_options_a_few_models_are_tested_and_what_is_left_out_is_told(monkeypatch):
    """All models in all time steps took twelve minutes."""
    fast = [case for case in CASES if case.key == "rigid_rotation"]
    monkeypatch.setattr(report_module, "CASES", tuple(fast))
    brief, full = (CliRunner().invoke(app, ["stress-test", "--json", *options]) for options in ([], ["--full"]))
    tested = [{(model["force"], model["plane"]) for model in json.loads(done.stdout)["models"]} for done in (brief, full)]
    assert {("analytic", "stress"), ("bond-energy", "space"), ("neo-hookean", "stress"), ("neo-hookean-isochoric", "space")} <= tested[0]
    assert tested[1] == {(name, plane) for plane in ("stress", "space") for name in all_models(plane)} > tested[0]
    assert "dynamic cases for a fiftieth of their time steps; --full runs all models and steps" in brief.stderr
    assert "--full" not in full.stderr


def test_the_tangent_of_springs_is_what_it_is():
    """Springs of one stiffness between all neighbors: their tangent at rest is the stiffness matrix, to differences."""
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
    # The diagonal of the middle point: sum of n (x) n over its 20 neighbors within 3.15 spacings in a 5 x 5 sheet.
    bonds = body.points - body.points[12]
    near = [k for k in range(25) if 0 < (bonds[k] ** 2).sum() ** 0.5 <= 0.315]
    block = sum(bonds[k][:, None] * bonds[k] / (bonds[k] ** 2).sum() for k in near)
    assert abs(formed.matrix[8:10, 8:10] - block).max() < 1e-8


def test_spring_stiffness_by_hand():
    """4 mu V^2 sum(w)/kappa with kappa = pi delta^4/3 and w = delta/l, over the 28 neighbors within 3.15 spacings."""
    distances = [1] * 4 + [2**0.5] * 4 + [2] * 4 + [5**0.5] * 8 + [8**0.5] * 4 + [3] * 4
    kappa = 3.141592653589793 / 3 * 3.15**4
    by_hand = 4 * 2.5 * sum(3.15 / distance for distance in distances) / kappa
    assert spring_stiffness(regular(2, 5), 2.5) == pytest.approx(by_hand)


def test_springs_in_space_by_hand():
    """4 mu V^2 sum(w)/kappa with kappa = pi delta^5/3 and w = delta/l, over the 18 neighbors within 1.5 spacings."""
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
    subject = Subject("bond-energy", plane="space")
    F = subject.gradient(np.array([[1.5, 0.3], [0.0, 0.9]]))
    assert np.abs(subject.exact_stress(F)[2]).max() < 1e-9
    plane = Subject("bond-energy")
    np.testing.assert_allclose(subject.exact_stress(F)[:2, :2], plane.exact_stress(F[:2, :2]), rtol=1e-9)


def test_outcomes_and_cells():
    assert Outcome.below(1.0, 2.0, "accuracy").verdict == PASS
    assert Outcome.below(float("nan"), 2.0, "accuracy").verdict == WEAK
    assert Outcome.above(float("nan"), 2.0, "accuracy").verdict == WEAK
    assert Outcome.above(1.0, 2.0, "accuracy").weakness == "accuracy"
    assert cell(vars(Outcome.above(1.0, 2.0, "accuracy"))) == "WEAK 1: accuracy"
    assert cell(vars(Outcome(STOPS, "somewhere"))) == "stops somewhere"
    assert not Subject("neo-hookean").describes(Subject("gent").law)
    assert Subject("analytic").describes(Subject("gent").law)
