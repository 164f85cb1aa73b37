"""The suite of hard cases: that it runs, that its cases can fail, and what each force model must pass."""

import json

import pytest
from typer.testing import CliRunner

from pdsurrogate.cli import app
from pdsurrogate.stress_test import report as report_module
from pdsurrogate.stress_test.case import INAPPLICABLE, PASS, STOPS, WEAK, Outcome, Subject, spring_stiffness, square_sheet
from pdsurrogate.stress_test.report import CASES, all_models, cell, stress_test, table
from pdsurrogate.stress_test.tangents import tangent

CONSERVATIVE = {"symmetry", "undamped_steps", "angular_momentum"}
"""What a force made of averaged features does not pass (theory, section 10)."""


def weak(model) -> set[str]:
    return {name for name, result in model["results"].items() if result["verdict"] == WEAK}


def test_a_surrogate_passes_what_physics_allows_and_nosb_does_not():
    """The quick suite, two models: the shipped surrogate lacks conservation only; NOSB's zero-energy modes show wherever they can."""
    report = stress_test(["neo-hookean", "nosb"], quick=True)
    surrogate, nosb = report["models"]
    assert weak(surrogate) <= CONSERVATIVE
    assert "symmetry" in weak(surrogate)
    assert {"single_point", "checkerboard", "least_eigenvalue", "equibiaxial", "horizons", "notch_tip"} <= weak(nosb)
    assert "symmetry" not in weak(nosb)
    for model in report["models"]:
        assert set(model["results"]) == {case.key for case in CASES}
        for result in model["results"].values():
            assert result["verdict"] in (PASS, STOPS, WEAK, INAPPLICABLE)
            assert (result["weakness"] is not None) == (result["verdict"] == WEAK)
    assert "zero-energy modes" in report["weaknesses"]
    json.dumps(report, allow_nan=False)
    header, rows = table(report)
    assert header[2:] == ["neo-hookean", "nosb"]
    assert len(rows) == len(CASES)


@pytest.mark.slow
def test_every_model_on_every_case():
    """Surrogates on symmetric features and energies pass all that physics allows; the exact bond force does as well."""
    report = stress_test()
    for model in report["models"]:
        if model["force"] not in ("nosb", "ba-nosb", "neo-hookean-paper"):
            assert weak(model) <= CONSERVATIVE, model["force"]


def test_every_force_model_takes_part():
    assert {"analytic", "nosb", "ba-nosb", "neo-hookean", "neo-hookean-paper", "gent"} <= set(all_models())


def test_command(tmp_path, monkeypatch):
    fast = [case for case in CASES if case.key in ("rigid_rotation", "symmetry")]
    monkeypatch.setattr(report_module, "CASES", tuple(fast))
    done = CliRunner().invoke(app, ["stress-test", "--force", "analytic", "--force", "neo-hookean-paper", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "not conservative" in done.output
    assert "force at rest" in done.output
    written = json.loads((tmp_path / "stress-test.json").read_text())
    assert [model["force"] for model in written["models"]] == ["analytic", "neo-hookean-paper"]
    for arguments, message in (
        (["--force", "wizardry"], "unknown force"),
        (["--out", "/dev/null/x"], "Not a directory"),
        (["--force", "ogden-isochoric"], "sheets"),
    ):
        refused = CliRunner().invoke(app, ["stress-test", *arguments])
        assert refused.exit_code == 2
        assert message in refused.stderr


def test_the_tangent_of_springs_is_what_it_is():
    """Springs of one stiffness between all neighbours: their tangent at rest is the stiffness matrix, to differences."""
    body = square_sheet(5)

    class Springs:
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
    assert formed.least > 0
    # The diagonal of the middle point: sum of n (x) n over its 20 neighbours within 3.15 spacings in a 5 x 5 sheet.
    bonds = body.points - body.points[12]
    near = [k for k in range(25) if 0 < (bonds[k] ** 2).sum() ** 0.5 <= 0.315]
    block = sum(bonds[k][:, None] * bonds[k] / (bonds[k] ** 2).sum() for k in near)
    assert abs(formed.matrix[8:10, 8:10] - block).max() < 1e-8


def test_spring_stiffness_by_hand():
    """4 mu V^2 sum(w)/kappa with kappa = pi delta^4/3 and w = delta/l, over the 28 neighbours within 3.15 spacings."""
    distances = [1] * 4 + [2**0.5] * 4 + [2] * 4 + [5**0.5] * 8 + [8**0.5] * 4 + [3] * 4
    kappa = 3.141592653589793 / 3 * 3.15**4
    by_hand = 4 * 2.5 * sum(3.15 / distance for distance in distances) / kappa
    assert spring_stiffness(square_sheet(5), 2.5) == pytest.approx(by_hand)


def test_outcomes_and_cells():
    assert Outcome.below(1.0, 2.0, "accuracy").verdict == PASS
    assert Outcome.below(float("nan"), 2.0, "accuracy").verdict == WEAK
    assert Outcome.above(float("nan"), 2.0, "accuracy").verdict == WEAK
    assert Outcome.above(1.0, 2.0, "accuracy").weakness == "accuracy"
    assert cell(vars(Outcome.above(1.0, 2.0, "accuracy"))) == "WEAK 1: accuracy"
    assert cell(vars(Outcome(STOPS, "somewhere"))) == "stops somewhere"
    assert not Subject("neo-hookean").describes(Subject("gent").law)
    assert Subject("analytic").describes(Subject("gent").law)
