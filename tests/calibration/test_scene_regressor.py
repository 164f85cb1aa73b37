"""Laws from fields and forces: parameters come back with their standard errors, and bad tables
are refused.
"""

import json
import re
from functools import partial
from unittest.mock import patch

import numpy as np
import pytest
from commands import commanded, invoke
from refusals import raising
from sklearn.base import clone
from sklearn.utils.estimator_checks import parametrize_with_checks

import pdsurrogate as pds
from pdsurrogate.calibration.free import EnergyUnknowns
from pdsurrogate.calibration.measured import MeasuredScene
from pdsurrogate.calibration.reporting import report
from pdsurrogate.calibration.scatter import Rows
from pdsurrogate.forces.domain import Domain
from pdsurrogate.identification import MODES, nominal_stress
from pdsurrogate.materials.dictionary import OF_INVARIANTS, Term
from pdsurrogate.materials.polyconvex import law_of

STRETCHES = [1.15, 1.3, 1.45]
NOISE, FORCE_NOISE = 1e-3, 0.01


def sheet(material, spacing=0.5, **changes):
    return pds.load_scene(
        "hole",
        {
            "spacing": spacing,
            "stretches": STRETCHES,
            "material": material,
            "reference": None,
            **changes,
        },
    )


def table(places, steps):
    """Return rows for both components at places in all steps, then for the force in all steps."""
    rows = [(step, axis, *place) for step in steps for axis in (1, 2) for place in places]
    return np.array([*rows, *((step, 0, 0.0, 0.0) for step in steps)])


PLACES = np.array(
    [
        (x, y)
        for x in np.linspace(-1.35, 1.35, 10)
        for y in np.linspace(-1.8, 1.8, 13)
        if x * x + y * y > 0.5**2
    ]
)
X = table(PLACES, (1, 2, 3))
DEVIATION = np.where(X[:, 1] > 0, NOISE, FORCE_NOISE)


def measured(law, scene=None, rows=X):
    """Return what a simulation gives at rows of a table, without noise."""
    table = Rows(rows[:, 0].astype(int), rows[:, 1].astype(int), rows[:, 2:])
    return MeasuredScene(scene or sheet("neo-hookean"), table).simulate(law)[0]


def fitted(y, rows=X, law="gent", deviation=DEVIATION, scene=None, **settings):
    """A regressor of the sheet, or of another scene, on its own spacing, fitted to rows."""
    model = pds.SceneRegressor(scene or sheet("neo-hookean"), law, refine=1, **settings)
    return model.fit(rows, y, standard_deviation=deviation)


@pytest.fixture
def same_body():
    """Measurements simulated at the spacing of the scene have no discretization error: its
    estimate from twice the spacing vanishes.
    """
    with patch("pdsurrogate.calibration.fitting.ORDER", 60.0):
        yield


@pytest.fixture(scope="module")
def gent():
    return pds.materials.Gent(0.8, 80.0, 12.0)


@pytest.fixture(scope="module")
def exact(gent):
    return measured(gent)


def test_parameters_come_back_from_exact_measurements(gent, exact):
    """The same discrete body: what is left are the tolerances of the search and of the run that
    made the data, 1e-5 of the stresses.
    """
    found = fitted(exact)
    np.testing.assert_allclose(found.parameters_, [0.8, 12.0], rtol=1e-3)
    assert found.undetermined_ == found.at_bound_ == []
    assert found.law_.bulk_modulus == pytest.approx(100 * found.parameters_[0])


@pytest.mark.usefixtures("same_body")
def test_standard_errors_are_what_the_noise_of_each_measurement_moves(gent):
    """Each of four measurements by 0.3 of its standard deviation; the stresses bend over the
    chain limit by less than 5 % of that.
    """
    scene, deviations = (
        sheet("neo-hookean", stretches=[1.2, 1.45]),
        np.array([FORCE_NOISE, FORCE_NOISE, NOISE, NOISE]),
    )
    rows = np.array([[1, 0, 0, 0], [2, 0, 0, 0], [2, 1, 1.35, 0.6], [2, 2, 0.45, 1.2]])
    y = measured(gent, scene, rows)
    model = fitted(y, rows, deviation=deviations, scene=scene)
    moved = [
        clone(model).fit(rows, y + step, standard_deviation=deviations).parameters_
        for step in np.diag(0.3 * deviations)
    ]
    found = np.sqrt(((moved - model.parameters_) ** 2).sum(axis=0)) / 0.3
    np.testing.assert_allclose(model.standard_errors_, found, rtol=0.05)


def test_the_noise_of_a_field_is_found_without_being_stated(exact, random):
    """The median of 600 differences has a standard deviation of 4 %; what the field bends
    between places adds a little.
    """
    y = exact + 5 * DEVIATION * random.standard_normal(len(X))
    found = pds.SceneRegressor(sheet("neo-hookean")).stated_deviations(X, y, {})
    field = X[:, 1] > 0
    assert found[field] == pytest.approx(5 * NOISE, rel=0.25)
    assert found[~field] == pytest.approx(0.005 * np.abs(y[~field]).max())


@pytest.mark.usefixtures("same_body")
def test_a_field_without_forces_does_not_determine_moduli(exact, random):
    """Equilibria of prescribed motions depend on ratios of moduli alone."""
    field = X[:, 1] > 0
    y = exact + DEVIATION * random.standard_normal(len(X))
    model = fitted(y[field], X[field], deviation=NOISE)
    assert model.undetermined_ == ["shear_modulus"]
    assert (model.parameters_[0], model.standard_errors_[0]) == (1.0, np.inf)  # at its start
    assert model.standard_errors_[1] < 0.2 * 12
    assert model.members_ == []
    with raising("shear_modulus: not determined by the measurements"):
        model.law_covariance()


@pytest.mark.usefixtures("same_body")
def test_fields_tell_more_than_forces(exact, random):
    y, forces = exact + DEVIATION * random.standard_normal(len(X)), X[:, 1] == 0
    both = fitted(y)
    alone = fitted(y[forces], X[forces], deviation=FORCE_NOISE)
    assert both.standard_errors_[1] < alone.standard_errors_[1]
    assert both.lack_of_fit_ == pytest.approx(1.0, abs=4 * (2 / len(X)) ** 0.5)


LAST = X[X[:, 0] == 3] * [0, 1, 1, 1] + [1, 0, 0, 0]
"""The rows of the last step, as those of a scene with its stretch alone."""

LAST_DEVIATION = DEVIATION[X[:, 0] == 3]


@pytest.fixture(scope="module")
def halved(gent):
    """A sheet of the spacing 0.4, data of half the spacing, and the law fitted to them without a
    correction.
    """
    scene, half = (
        sheet("neo-hookean", spacing, stretches=STRETCHES[-1:]) for spacing in (0.4, 0.2)
    )
    fine = measured(gent, half, LAST)
    with pytest.warns(
        UserWarning,
        match=(
            "refine=1: the discretization error that is not corrected is about .* standard"
            " deviations"
        ),
    ):
        return (
            scene,
            fine,
            fitted(fine, LAST, deviation=LAST_DEVIATION, scene=scene),
        )


def test_without_a_correction_the_standard_errors_contain_the_discretization_error(halved):
    """Data of half the spacing: the noise alone, a small part of the standard error, would state
    the wrong chain limit as certain.

    The error from twice the spacing is that of an order of 1.5; with the errors of this estimate,
    three of them contain the truth.
    """
    _, fine, model = halved
    with patch("pdsurrogate.calibration.fitting.ORDER", 60.0):
        noise = clone(model).fit(LAST, fine, standard_deviation=LAST_DEVIATION).standard_errors_
    off = np.abs(model.parameters_ - [0.8, 12.0])
    assert (off > 5 * noise).any()
    assert (off < 3 * model.standard_errors_).all()
    assert np.abs(model.discretization_).max() > 0


def test_a_discretization_error_that_cannot_be_estimated_is_named():
    """At twice the spacing the place beside the hole has no points near it."""
    scene = sheet(
        "neo-hookean", 0.4, stretches=[1.1], body={"size": [1.2, 2.4], "lower": [-0.6, -1.2]}
    )
    rows, u = np.array([[1, 1, 0.5, 0.0], [1, 0, 0, 0]]), [-0.01, 1.0]
    with pytest.warns(
        UserWarning,
        match=(
            "refine=1: the discretization error of scene hole is unknown and no part of the"
            " standard errors"
        ),
    ):
        fitted(u, rows, law="neo-hookean", deviation=[0.1, 0.1], scene=scene)


def test_a_finer_simulation_corrects_the_discretization_error(halved):
    """Data of a body with half the spacing: without the correction the modulus is off by the
    stiffness of a coarse sheet.
    """
    scene, fine, coarse = halved
    corrected = pds.SceneRegressor(scene, "gent", refine=2).fit(
        LAST, fine, standard_deviation=LAST_DEVIATION
    )
    off = [np.abs(fit.parameters_ / [0.8, 12.0] - 1).max() for fit in (coarse, corrected)]
    assert off[1] < 0.1 * off[0]
    assert coarse.lack_of_fit_ > 10 * corrected.lack_of_fit_
    assert (np.abs(corrected.parameters_ - [0.8, 12.0]) < 2 * corrected.standard_errors_).all()


def test_several_scenes_share_a_law(gent, exact):
    """A sheet without a hole adds a row; its scene has the number 1."""
    other = sheet("neo-hookean", holes=[], stretches=[1.6])
    rows = np.vstack([np.column_stack([np.zeros(len(X)), X]), [[1, 1, 0, 0, 0]]])
    force = measured(gent, other, np.array([[1.0, 0, 0, 0]]))
    model = pds.SceneRegressor([sheet("neo-hookean"), other], "gent", refine=1)
    model.fit(rows, np.append(exact, force), standard_deviation=np.append(DEVIATION, FORCE_NOISE))
    np.testing.assert_allclose(model.parameters_, [0.8, 12.0], rtol=1e-3)
    assert model.predict(rows[-1:]) == pytest.approx(force, rel=1e-3)


@pytest.mark.usefixtures("same_body")
def test_stresses_have_the_errors_of_the_parameters():
    model = fitted([2.0], [[1, 0, 0, 0]], law="neo-hookean", deviation=0.1)
    states = np.stack([[1.5, 2.0], MODES["uniaxial"](np.array([1.5, 2.0]))], axis=1)
    stress, error = model.nominal_stress(states)
    np.testing.assert_allclose(stress, nominal_stress(model.law_, states))
    # a modulus is known as well as the force
    np.testing.assert_allclose(error / stress, 0.05, rtol=1e-2)


@pytest.mark.usefixtures("same_body")
def test_the_spread_of_members_is_the_standard_error_of_stresses(exact, random):
    """The spread of 400 members has an error of 4 %; the curvature of stresses over the chain
    limit adds a few percent.
    """
    y, model = (
        exact + DEVIATION * random.standard_normal(len(X)),
        pds.SceneRegressor(sheet("neo-hookean"), "gent", refine=1),
    )
    with patch("pdsurrogate.calibration.fitting.MEMBERS", 400):
        model.fit(X, y, standard_deviation=DEVIATION)
    states = np.array([[at, MODES[mode](at)] for mode in MODES for at in (1.2, 2.0)])
    stress, error = model.nominal_stress(states)
    off = np.array([nominal_stress(law, states) - stress for law in model.members_])
    np.testing.assert_allclose(np.sqrt((off**2).mean(axis=0)) / error, 1.0, atol=4 * 0.04)


def test_members_repeat_from_their_seed():
    model = pds.SceneRegressor(sheet("neo-hookean", stretches=[1.1]), refine=1)
    first, second, other = (
        model.set_params(random_state=seed)
        .fit([[1, 0, 0, 0]], [0.8], standard_deviation=FORCE_NOISE)
        .members_
        for seed in (0, 0, 1)
    )
    assert first == second
    assert not set(map(str, first)) & set(map(str, other))


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (
            [4, 0, 0, 0],
            "step 4: the outputs of scene hole are numbered from 1, the number of its stretches",
        ),
        ([0, 0, 0, 0], "step 0"),
        ([1, 3, 0, 1], "quantity 3: 1 to 2 are components"),
        ([1, -1, 0, 1], "quantity -1"),
        ([1.5, 0, 0, 0], "whole numbers, not 1.5"),
        ([1, 1, 0, 0], "outside|lies in|no points"),
    ],
)
def test_rows_that_the_scene_does_not_have_are_refused(row, message):
    with raising(message):
        fitted([1.0], [row], law="neo-hookean", deviation=0.1)


@pytest.mark.usefixtures("same_body")
def test_the_command_writes_artifact_report_and_figures(tmp_path, gent):
    coarse = partial(sheet, spacing=0.3)
    exact = measured(gent, coarse("neo-hookean"))
    field = X[:, 1] == 1
    fields = np.column_stack([X[field, 0], X[field, 2:], exact[field], exact[X[:, 1] == 2]])
    np.savetxt(tmp_path / "F.csv", fields, delimiter=",", header="step,x1,x2,u1,u2", comments="")
    forces = np.column_stack([[1, 2, 3], exact[X[:, 1] == 0]])
    np.savetxt(tmp_path / "G.csv", forces, delimiter=",", header="step,force", comments="")
    options = [
        f"--set spacing=0.3 --set 'stretches={STRETCHES}' --refine 1 --law gent --out",
        tmp_path / "out",
    ]
    files = "--fields", tmp_path / "F.csv", "--forces", tmp_path / "G.csv"
    with patch("pdsurrogate.cli.calibrate.Bar.event") as shown:
        done = invoke("calibrate hole sheet", files, options, "--json")
    assert done.exit_code == 0, done.output
    assert any("sum_of_squared_residuals" in call.kwargs for call in shown.call_args_list)
    found = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert found["parameters"]["chain_limit"] == pytest.approx(12.0, rel=2e-3)
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {
        "calibration-outputs.png",
        "calibration-residuals.png",
    }
    stored = pds.load_card(tmp_path / "out" / "sheet")
    assert stored.material.trained_with == found["law"]
    run = tmp_path / "out" / "calibration-run"  # for `show --html`, with the measured field
    assert pds.load_result(run).scene.material.chain_limit == found["parameters"]["chain_limit"]
    written = np.loadtxt(run / "measured.csv", delimiter=",", skiprows=1)
    assert sorted(map(tuple, written.round(6))) == sorted(map(tuple, fields.round(6)))
    biaxial = pds.load_scene("biaxial-hole", spacing=0.1)
    visited = [
        pds.simulate(one, tmp_path / "out" / "sheet").summary["beyond_data"]
        for one in (coarse(None, stretches=[1.2]), biaxial)
    ]
    # States of bonds differ a little from those of points, whose hull is the domain.
    assert visited[0][-1]["share"] < 0.01 < visited[1][-1]["share"]
    scene, models = (
        coarse(found["law"], stretches=[1.2]),
        (
            pds.load_surrogate(tmp_path / "out" / "sheet"),
            "analytic",
        ),
    )
    stored, of_the_law = (pds.simulate(scene, model) for model in models)
    assert stored.levels[-1]["nominal_stress"] == pytest.approx(
        of_the_law.levels[-1]["nominal_stress"], rel=1e-3
    )
    covariance = found["covariance"]
    exact = pds.materials.LawCovariance(scene.law(), covariance["names"], covariance["values"])
    errors = stored.standard_errors(["nominal_stress"])
    assert errors == pytest.approx(of_the_law.standard_errors(["nominal_stress"], exact), rel=1e-6)
    assert 0 < errors["nominal_stress"] < 0.1 * stored.levels[-1]["nominal_stress"]


def test_the_command_takes_probes_and_forces_of_any_region(tmp_path, gent):
    """Two displacements of a probe and the force of a region; an empty entry was not measured."""
    probe = [{"name": "tip", "at": [0.9, 0.3]}]
    scene = sheet(gent.describe(), probes=probe)
    result = pds.simulate(scene, "bond-energy")
    u = [level["probes"]["tip"]["displacement"] for level in result.levels]
    force = [level["forces"]["bottom"][1] for level in result.levels]
    lines = ["# a comment", "step, force_bottom_2 [N], tip_displacement_1, probe_tip_u2, note"]
    lines += [f"{n + 1},{force[n]:.9f},{u[n][0] if n else '':},{u[n][1]:.9f},x" for n in range(3)]
    (tmp_path / "G.csv").write_text("\n".join(lines))
    options = [
        f"--set spacing=0.5 --set 'stretches={STRETCHES}'",
        "--set",
        "probes=[{name='tip',at=[0.9,0.3]}]",
    ]
    command = [
        "calibrate hole tip --forces",
        tmp_path / "G.csv",
        options,
        "--refine 1 --law gent",
    ]
    commanded(command, "--field-noise 0.001 --out", tmp_path / "out")
    found = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert found["parameters"]["chain_limit"] == pytest.approx(12.0, rel=2e-3)
    assert {name: row["rows"] for name, row in found["measurements"].items()} == {
        "force_bottom_2": 3,
        "tip_displacement_1": 2,
        "probe_tip_u2": 3,
    }
    assert found["measurements"]["probe_tip_u2"]["standard_deviation"] == pytest.approx(0.001)
    assert found["measurements"]["force_bottom_2"]["standard_deviation"] == pytest.approx(
        0.005 * abs(force[-1])
    )
    assert found["outputs"]["force_bottom_2"][0]["fit"] == pytest.approx(force[0], rel=1e-3)
    assert (tmp_path / "out" / "calibration-outputs.png").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("step,load\n1,2.0\n", "there is no column force, nor another one with a measurement"),
        ("step,probe_end_u1\n1,2.0\n", "scene hole has no 'probes.end.displacement.0'"),
        ("step,force_left_1\n1,2.0\n", "scene hole has no 'forces.left.0'"),
        ("step,force,force\n1,2.0,1.0\n", "there are two columns force"),
        ("step,stretch,evaluations,force_top_2\n0,1.1,20,2.0\n", "this is the history of a run"),
        ("step,force\n0,2.0\n", "line 2: step 0, but the steps are whole numbers: 1 to"),
        ("step,force_top_2,force\n1,,\n2,,\n", "no line has two numbers"),
        ("step,force\n1,2.0\n,3.0\n", "line 3: step is not a number"),
        ("step,force\n1,2.0\n1,2.1\n1,2.0\n", "line 4: this row is a copy of an earlier one"),
    ],
)
def test_tables_of_outputs_that_make_no_sense_are_refused(text, message, tmp_path):
    (tmp_path / "G.csv").write_text(text)
    options = "--set spacing=0.5 --law neo-hookean --refine 1 --out", tmp_path / "out"
    done = commanded("calibrate hole sheet --forces", tmp_path / "G.csv", options, status=2)
    assert re.search(message, " ".join(done.stderr.split()))


def test_probes_alone_do_not_determine_moduli():
    """As displacements of fields, those of probes depend on ratios of moduli alone."""
    truth = {"law": "gent", "shear_modulus": 2.0, "bulk_modulus": 50.0, "chain_limit": 60.0}
    scene, truth = (
        sheet(law, probes=[{"name": "tip", "at": [0.9, 0.3]}]) for law in ("neo-hookean", truth)
    )
    _, second, third = (
        level["probes"]["tip"]["displacement"]
        for level in pds.simulate(truth, "bond-energy").levels
    )
    model = pds.SceneRegressor(
        scene, "gent", outputs=["probes.tip.displacement.0", "probes.tip.displacement.1"], refine=1
    )
    model.fit(
        [[2, 0, 0, 0], [3, 0, 0, 0], [3, -1, 0, 0]],
        [second[0], third[0], third[1]],
        standard_deviation=0.01,
    )
    assert "shear_modulus" in model.undetermined_
    assert model.parameters_[0] == 1.0  # at its start


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("step,x1,x2,u1\n1,0,0,0\n", "there is no u2 among step, x1, x2, u1"),
        ("x1;x2;u1;u2\n1;1;0;0\n", "the columns must be step, x1, x2, u1, u2"),
        ("step,x1,x2,u1,u2,u2\n1,1,0,0,0,0\n", "there are two columns u2"),
        (
            "step,x1,x2,u1,u2\n1,1,5,0,0,1,0,2\n",
            "line 2 has 8 values for 5 columns; decimals have points",
        ),
        (
            "step,x1,x2,u1,u2\n1,1,0,0,1\n1,1.5,0,0,1\n1,1,0,0,1\n",
            "line 4: this row is a copy of an earlier one",
        ),
    ],
)
def test_files_that_are_no_table_of_displacements_are_refused(text, message, tmp_path):
    (tmp_path / "F.csv").write_text(text)
    done = commanded(
        "calibrate hole sheet --fields",
        tmp_path / "F.csv",
        "--law gent --out",
        tmp_path,
        status=2,
    )
    assert message in " ".join(done.stderr.split())


def test_laws_of_the_users_own_are_fitted(tmp_path):
    """They are defined after the command was loaded."""
    lines = (
        "from pdsurrogate.materials import NeoHookean\n\n\nclass Own(NeoHookean):\n    name ="
        " 'own-law'\n"
    )
    (tmp_path / "own_law_file.py").write_text(lines)
    (tmp_path / "G.csv").write_text("step,force\n1,0.86\n")
    options = "--set spacing=0.5 --set stretches=[1.1] --refine 1 --law own-law --out"
    files = "--import", tmp_path / "own_law_file.py", "--forces", tmp_path / "G.csv"
    with patch.dict(pds.materials.LAWS):
        commanded("calibrate hole sheet", files, options, tmp_path / "out")
    assert (
        json.loads((tmp_path / "out" / "calibration.json").read_text())["law"]["law"] == "own-law"
    )


@pytest.mark.parametrize("law", ["gnet", "polyconvex"])
def test_laws_that_cannot_be_fitted_are_refused(law):
    with raising(f"unknown law '{law}'; laws that can be fitted to tests are neo-hookean"):
        fitted([0.86], [[1, 0, 0, 0]], law=law, deviation=None)


def test_a_parameter_at_zero_stays_within_its_bounds(exact):
    """Gent's rubber has no second invariant: the share of it in Mooney's and Rivlin's law ends
    at zero.
    """
    model = fitted(exact, law="mooney-rivlin")
    assert model.at_bound_ == ["second_share"]
    assert 0 <= model.law_.second_share < 1e-5
    assert len({law.shear_modulus for law in model.members_}) == 8
    assert all(0 <= law.second_share <= 1 for law in model.members_)


def test_fields_under_loads_determine_moduli(gent):
    """A scene with loads alone pulls no region whose force could be asked for."""
    hung = {
        "stretches": [],
        "grips": [],
        "steps": [0.5, 1.0],
        "prescribed": [{"region": "bottom", "x1": 0.0, "x2": 0.0}],
    }
    scene = sheet("neo-hookean", **hung, loads=[{"region": "top", "traction": [0.0, 0.3]}])
    rows = X[(X[:, 1] > 0) & (X[:, 0] < 3)]
    model = pds.SceneRegressor(scene, "neo-hookean", refine=1)
    model.fit(
        rows, measured(pds.materials.NeoHookean(0.7, 70.0), scene, rows), standard_deviation=NOISE
    )
    assert model.parameters_ == pytest.approx([0.7], rel=1e-4)


def test_a_field_beside_an_interface_is_that_of_its_own_material():
    """Runs and derivatives interpolate to the same places; across the interface, gradients jump."""
    other = {"law": "neo-hookean", "shear_modulus": 2.5, "bulk_modulus": 250.0}
    scene = sheet(
        "neo-hookean",
        materials=[{"region": {"box": [[-2.0, -2.0], [2.0, -0.6]]}, "material": other}],
    )
    law = pds.materials.NeoHookean(0.7, 70.0)
    model = fitted(measured(law, scene), law="neo-hookean", scene=scene)
    assert model.parameters_ == pytest.approx([0.7], rel=1e-4)
    assert model.lack_of_fit_ < 1e-3


def test_repeated_measurements_do_not_hide_their_noise(exact, random):
    """A place measured twice is not its own neighbor: all rows copied, the standard errors fall
    by the root of two.
    """
    y = exact + DEVIATION * random.standard_normal(len(exact))
    model = pds.SceneRegressor(sheet("neo-hookean"), "gent", refine=1)
    once, twice = (
        model.stated_deviations(np.vstack([X] * n), np.concatenate([y] * n), {}) for n in (1, 2)
    )
    np.testing.assert_array_equal(twice, np.concatenate([once, once]))


def test_copies_of_rows_are_told():
    """Places of outputs have no meaning; a second value is a second measurement."""
    model = pds.SceneRegressor(sheet("neo-hookean", stretches=[1.1]), refine=1)
    with pytest.warns(
        UserWarning,
        match=(
            "X: 2 rows of scene hole are copies of others, such as forces.*[01] = 0.8 in step 1;"
            " each counts"
        ),
    ):
        model.fit(
            [[1, 0, 0, 0], [1, 0, 1, 1], [1, 0, 0, 0], [1, 0, 0, 0]],
            [0.8, 0.8, 0.8, 0.82],
            standard_deviation=0.1,
        )


def test_a_fit_tells_its_progress(caplog):
    model = pds.SceneRegressor(sheet("neo-hookean", stretches=[1.1]), refine=2)
    with caplog.at_level("INFO", "pdsurrogate.calibration"):
        model.fit([[1, 0, 0, 0]], [0.8], standard_deviation=0.1)
    told = [
        record.getMessage()
        for record in caplog.records
        if record.name.startswith("pdsurrogate.calibration")
    ]
    assert told[-1].startswith(f"{model.n_simulations_} equilibria, sum of squared residuals ")
    assert "hole: finer simulation, spacing 0.25" in told


def test_a_bulk_modulus_and_its_ratio_exclude_each_other():
    with raising("bulk_modulus and bulk_ratio exclude each other"):
        fitted(
            [0.86],
            [[1, 0, 0, 0]],
            law="neo-hookean",
            deviation=None,
            bulk_ratio=100.0,
            bulk_modulus=80.0,
        )


def test_an_energy_without_a_law_gives_the_stresses_of_a_law_in_other_states(gent, exact):
    """Stresses up to the stretches in the sheet; the terms follow the logarithm of the law there
    within 1 %, and the rest is a margin.
    """
    model = fitted(exact, law=None)
    stretches = np.linspace(1.1, 1.5, 5)
    states = np.vstack(
        [
            np.stack([stretches, MODES[mode](stretches)], axis=1)
            for mode in ("uniaxial", "pure-shear")
        ]
    )
    stress, error = model.nominal_stress(states)
    assert np.sqrt(((stress / nominal_stress(gent, states) - 1) ** 2).mean()) < 0.02
    assert (error > 0).all()
    assert (model.parameters_ > 0).all()
    assert len(model.parameters_) <= len(OF_INVARIANTS)
    visited, log = (
        Domain(*model.stretch_range_, 0.9, 1.1, tuple(map(tuple, model.domain_hull_))),
        np.log(1.3),
    )
    assert visited.beyond_data(np.exp([[log, -log / 2]])) < 0  # the sheet is in tension
    assert visited.beyond_data(np.exp([[log, log]])) > 0


GENT_THOMAS = [Term("stretches", 2.0), Term("second_logarithm", 1.0)]


@pytest.fixture(scope="module")
def gent_thomas():
    return measured(law_of(GENT_THOMAS, [1.0, 1.0], 100.0))


def test_the_weak_form_holds_for_the_energy_in_equilibrium(gent_thomas):
    """At the displacements of a law its forces are in balance.

    What is left are the smoothing of the displacements and the preconditioner, whose forces are
    those of another law: of the distance of the law from the start a tenth at most.
    """
    test = MeasuredScene(
        sheet("neo-hookean"), Rows(X[:, 0].astype(int), X[:, 1].astype(int), X[:, 2:])
    )
    unknown, start = (
        EnergyUnknowns(bulk_ratio=100.0, terms=tuple(GENT_THOMAS)),
        np.array([4.0, 1e-3]),
    )
    test.begin(unknown.law_of(start))
    jacobian, right = test.weak_form(unknown.law_of, start, gent_thomas)
    left = [np.linalg.norm((jacobian @ x - right) / DEVIATION) for x in (np.ones(2), start)]
    assert left[0] < 0.1 * left[1]


@pytest.mark.usefixtures("same_body")
def test_the_weak_form_gives_the_start(gent_thomas):
    model = fitted(gent_thomas, law=None)
    start = model.start_
    assert start["taken"] == "weak form"
    assert start["chi_squared"]["weak form"] < 0.5 * start["chi_squared"]["default"]
    assert set(model.parameter_names_) <= set(start["terms"])
    states = np.array(
        [[at, MODES[mode](at)] for mode in ("uniaxial", "pure-shear") for at in (1.2, 1.5)]
    )
    exact = nominal_stress(law_of(GENT_THOMAS, [1.0, 1.0], 100.0), states)
    np.testing.assert_allclose(model.nominal_stress(states)[0], exact, rtol=0.02)


@pytest.mark.parametrize(
    ("parameters", "given", "error", "message"),
    [
        ({"outputs": []}, {}, ValueError, "outputs: the list is empty; give names, such as"),
        ({"outputs": ["crack.peak.force"]}, {}, ValueError, "what a body bears at break has no"),
        (
            {"outputs": "force"},
            {},
            TypeError,
            "outputs must be a list of names, such as .*, not 'force'",
        ),
        ({"refine": True}, {}, TypeError, "refine must be a number, not True"),
        ({}, {"X": []}, ValueError, "X: it is empty; .* the columns step, quantity, x1, x2"),
        ({}, {"X": [[1, "force", 0, 0]]}, ValueError, "X: 'force' is no number"),
        (
            {},
            {"y": ["much"]},
            ValueError,
            "y: 'much' is no number; give a measured value for each row of X",
        ),
        (
            {},
            {"standard_deviation": [[0.1, 0.0]]},
            ValueError,
            r"standard_deviation: its shape is \(1, 2\); give one positive number, or one",
        ),
        ({}, {"standard_deviation": "0.1"}, ValueError, "standard_deviation: '0.1' is no number"),
        (
            {},
            {"standard_deviation": [0.0]},
            ValueError,
            "standard_deviation: 0 is no standard deviation; give one positive number",
        ),
        (
            {},
            {"sample_weight": ["a"]},
            ValueError,
            "sample_weight: 'a' is no number; give a number for each row of X",
        ),
    ],
)
def test_values_of_another_kind_are_named(parameters, given, error, message):
    arguments = {"X": [[1, 0, 0, 0]], "y": [0.8], "standard_deviation": 0.1} | given
    with raising(message, error):
        pds.SceneRegressor(sheet("neo-hookean"), "gent", **parameters).fit(**arguments)


def test_an_energy_that_the_measurements_cannot_determine_is_refused(exact):
    field, model = X[:, 1] > 0, pds.SceneRegressor(sheet("neo-hookean"), None, refine=1)
    with raising("up to a factor alone: add rows of forces"):
        model.fit(X[field], exact[field], standard_deviation=NOISE)
    with raising("at least as many measurements, not 3"):
        model.fit(X[~field], exact[~field], standard_deviation=FORCE_NOISE)
    with raising("opposite sign"):
        model.fit(X, np.where(field, exact, -exact), standard_deviation=DEVIATION)


@pytest.mark.parametrize("options", [[], "--free --law gent"])
def test_a_calibration_of_neither_or_both_a_law_and_an_energy_is_refused(options, tmp_path):
    done = commanded("calibrate hole sheet --forces G.csv", options, "--out", tmp_path, status=2)
    assert "choose one: --law LAW" in " ".join(done.stderr.split())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            "--law gent --field-noise 0",
            "--field-noise 0: a standard deviation must be positive",
        ),
        (
            "--law polyconvex",
            "--law polyconvex: this law is a sum of terms, which --free chooses and fits",
        ),
        (
            "--law gent",
            (
                "G.csv, line 3: step 4, but the steps are whole numbers: 1 to 3, the stretches of"
                " scene hole"
            ),
        ),
    ],
)
def test_options_and_steps_that_make_no_sense_are_refused(options, message, tmp_path):
    (tmp_path / "G.csv").write_text("step,force\n1,1.0\n4,2.0\n")
    files = "--forces", tmp_path / "G.csv", f"--set 'stretches={STRETCHES}'"
    done = commanded("calibrate hole sheet", files, options, "--out", tmp_path, status=2)
    assert message in " ".join(done.stderr.split()).replace(str(tmp_path) + "/", "")


def test_displacements_in_another_unit_are_refused(exact):
    """Ten times the displacements of the scene, as in millimetres instead of centimetres."""
    field = X[:, 1] > 0
    with raising(
        r"y: the displacements of step 1 differ by 90% from those of scene hole.*with"
        r" displacements times (0\.1|0\.099\d) .* different units of length"
    ):
        fitted(np.where(field, 10 * exact, exact))


def test_a_single_displacement_far_from_all_others_is_named(exact):
    number = np.flatnonzero(X[:, 1] == 1)[0]
    wrong = exact + 20.0 * (np.arange(len(X)) == number)
    with raising(
        "one displacement of step 1 is far from all others: along x1 at .* it is"
        f" {wrong[number]:.4g}"
    ):
        fitted(wrong)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            lambda rows, y: (np.column_stack([4 - rows[:, 0], rows[:, 1:]]), y),
            "displacements of step 1 differ by .* and the steps in its order",
        ),
        (
            lambda rows, y: (np.where(np.arange(4) == 3, -rows, rows), y),
            r"with v \(u2\) of the opposite sign the residuals .* fall",
        ),
        (
            lambda rows, y: (rows, np.where(rows[:, 1] == 1, -y, y)),
            r"with u \(u1\) of the opposite sign the residuals .* fall",
        ),
    ],
    ids=["steps in another order", "x2 downwards", "u1 mirrored"],
)
def test_displacements_along_other_axes_or_of_other_steps_are_refused(
    changed, message, exact, random
):
    """Before a search for a law that they cannot give."""
    rows, y = changed(X, exact + DEVIATION * random.standard_normal(len(exact)))
    with raising(message):
        fitted(y, rows)


class AnyTable(pds.SceneRegressor):
    """Before the rows of a scene: columns of any number and value are made into numbers of
    outputs, each row on its own.
    """

    columns = None

    def _tests_of(self, X):
        step = 1 + (np.sin(X @ np.linspace(1, 2, X.shape[1])) > 0)
        rows = np.column_stack([step, np.zeros((len(X), 3))])
        with patch.object(AnyTable, "columns", pds.SceneRegressor.columns):
            return super()._tests_of(rows)


@parametrize_with_checks(
    [
        AnyTable(
            pds.load_scene("uniaxial", spacing=0.5, stretches=[1.1, 1.2]),
            outputs=["energy"],
            refine=1,
        )
    ]
)
def test_it_keeps_scikit_learns_conventions_with_tables_of_any_columns(estimator, check):
    """With its own table, whole numbers stand in two columns; the energy may have any sign,
    unlike the force of the region pulled.
    """
    check(estimator)


def test_fewer_measurements_than_parameters_are_refused():
    """One force cannot determine two parameters: the standard errors would be those of a
    pseudo-inverse.
    """
    with raising(r"1 measurements do not determine 2 parameters \(shear_modulus, chain_limit\)"):
        fitted([3.0], [[1, 0, 0, 0]], deviation=0.03, scene=pds.load_scene("hole", spacing=0.25))


@pytest.mark.parametrize(
    ("force", "what"),
    [(-3.0, "have the opposite sign of the simulated ones"), (0.0, "are all zero")],
)
def test_forces_of_the_wrong_sign_are_refused(force, what):
    with raising(f"the measured forces {what}"):
        fitted(
            [force],
            [[1, 0, 0, 0]],
            law="neo-hookean",
            deviation=0.03,
            scene=pds.load_scene("hole", spacing=0.25),
        )


def test_places_outside_the_body_are_named():
    with raising(r"a place of the displacements: \(99, 0\) lies outside the body"):
        fitted(
            [3.0, 0.1],
            [[1, 0, 0, 0], [1, 1, 99.0, 0]],
            law="neo-hookean",
            deviation=0.03,
            scene=pds.load_scene("hole", spacing=0.25),
        )


def test_an_outlier_is_named(gent, exact):
    y = exact.copy()
    y[7] += 0.5
    model = fitted(y)
    worst = report(model, X, y, ["force"])["worst"]
    assert (worst["step"], worst["measured"]) == (1, f"u1 at ({PLACES[7][0]:g}, {PLACES[7][1]:g})")
    assert worst["standard_deviations"] == pytest.approx(0.5 / NOISE, rel=0.05)
