"""Bad rows, modes of other units and laws that do not describe the data: named, and refused
where nothing good can come of them.
"""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from commands import commanded, invoke
from refusals import raising
from sklearn.exceptions import NotFittedError

import pdsurrogate as pds
from pdsurrogate.identification import (
    MODES,
    TestData,
    TestDataWarning,
    examine,
    load_test_data,
    nominal_stress,
)
from pdsurrogate.identification.examination import suspicions

LAW = pds.materials.MooneyRivlin(0.4, 400.0, 0.2)


def made_of(law, modes=tuple(MODES), n=8, greatest=3.0):
    """Stresses of a law in some modes of loading, without noise."""
    stretch = np.linspace(1.1, greatest, n)
    X = np.vstack([np.stack([stretch, MODES[mode](stretch)], axis=1) for mode in modes])
    return TestData("made", np.repeat(modes, n), X, nominal_stress(law, X), np.ones(len(X)))


def changed(data, rows, stress):
    values = data.nominal_stress.copy()
    values[rows] = stress
    return replace(data, nominal_stress=values)


def examined(data, law="mooney-rivlin"):
    model = pds.identification.LawRegressor(law).fit(
        data.stretches, data.nominal_stress, data.balanced_weights()
    )
    return examine(model, data)


@pytest.fixture(scope="module")
def good():
    return made_of(LAW)


PURE_SHEAR = np.arange(24) >= 16

CHANGES = {
    "one stress times 5": (
        4,
        lambda stress, stretch: 5 * stress,
        ["row 5 (uniaxial, stretch 2.18571", "poorly: R^2 is 0.0"],
    ),
    "Cauchy stresses": (
        PURE_SHEAR,
        lambda stress, stretch: stress * stretch,
        ["pure-shear: the stresses look like Cauchy"],
    ),
    "Cauchy stresses everywhere": (
        slice(None),
        lambda stress, stretch: stress * stretch,
        ["all modes: the stresses look like Cauchy"],
    ),
    "another unit": (
        PURE_SHEAR,
        lambda stress, stretch: 9.81 * stress,
        ["pure-shear: the stresses look 9.8 times too large"],
    ),
}


def test_good_data_are_let_alone(good):
    assert examined(good) == examine(
        pds.identification.EnergyRegressor().fit(good.stretches, good.nominal_stress), good
    )
    assert not examined(good).refusals
    assert not examined(good).remarks


@pytest.mark.parametrize("name", CHANGES)
def test_what_is_wrong_with_data_is_told(good, name):
    rows, change, told = CHANGES[name]
    found = examined(
        changed(good, rows, change(good.nominal_stress[rows], good.stretches[rows, 0]))
    )
    said = " ".join([*found.remarks, *found.refusals])
    for words in told:
        assert words in said
    # No row or mode but those that were changed is accused.
    assert said.count("standard deviations") == said.count("row 5 (")
    # R^2 of -0.2 and -3.7
    assert bool(found.refusals) == (name in ("Cauchy stresses", "another unit"))


def test_cauchy_stresses_of_one_mode_accuse_no_row_of_another():
    """They draw the energy with them, and a sound row of another mode stands out until they are
    set right.
    """
    common = [1.1, 1.3, 1.6, 2, 2.5, 3]
    stretch = {
        "uniaxial": [*common, 4, 5],
        "equibiaxial": [*common, 3.5],
        "pure-shear": [*common, 4],
    }
    mode = np.repeat(list(stretch), [len(values) for values in stretch.values()])
    X = np.vstack(
        [
            np.stack([np.array(values), MODES[name](np.array(values))], axis=1)
            for name, values in stretch.items()
        ]
    )
    data = TestData(
        "made", mode, X, nominal_stress(pds.materials.Gent(0.4, 400.0, 60.0), X), np.ones(len(X))
    )
    assert not suspicions(data)
    uniaxial = mode == "uniaxial"
    (said,) = suspicions(changed(data, uniaxial, data.nominal_stress[uniaxial] * X[uniaxial, 0]))
    assert said.startswith("uniaxial: the stresses look like Cauchy")


def test_the_sign_of_a_stress_is_that_of_rubber(good):
    for stress, words in ((-0.5, "is compressive where rubber is in tension"), (0.3, "")):
        refusals = examined(changed(good, 4, stress)).refusals
        assert words in " ".join(refusals) if words else not refusals
        assert all(
            "row 5 (uniaxial, stretch 2.18571, nominal stress -0.5)" in text for text in refusals
        )
    # In compression, which many laboratories give as positive.
    states = np.array([[value, value**-0.5] for value in (0.6, 0.8, 1.5)])
    squeezed = TestData("made", np.array(["uniaxial"] * 3), states, np.ones(3), np.ones(3))
    said = examined(squeezed).refusals[0]
    assert (
        "row 1 (uniaxial, stretch 0.6, nominal stress 1) is tensile where rubber is in compression,"
        " row 2" in said
    )
    assert "row 3" not in said


def test_shipped_data_are_let_alone():
    for name in ("treloar", "kawabata"):
        data = load_test_data(name)
        found = examined(data, "ogden")
        assert not found.refusals
        assert not found.remarks


def test_fits_are_refused_unless_forced(good):
    wrong = changed(good, 4, -0.5)
    with raising(r"row 5 \(uniaxial, stretch 2.18571, nominal stress -0.5\)"):
        pds.fit_to_tests(pds.identification.LawRegressor("gent"), wrong)
    with pytest.warns(TestDataWarning, match="row 5"):
        pds.fit_to_tests(pds.identification.LawRegressor("gent"), wrong, force=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert pds.fit_to_tests(
            pds.identification.LawRegressor("mooney-rivlin"), good
        ).law_.second_share == pytest.approx(0.2, rel=1e-3)


@pytest.mark.parametrize(
    "regressor", [pds.identification.LawRegressor("gent"), pds.identification.EnergyRegressor()]
)
def test_a_regressor_whose_fit_is_refused_or_fails_is_not_fitted(good, regressor):
    wrong = changed(good, 4, -0.5)

    def left_by(attempt, message):
        regressor.fit(good.stretches, good.nominal_stress)
        with raising(message):
            attempt()
        assert not [key for key in vars(regressor) if key.endswith("_") and key != "n_features_in_"]
        with pytest.raises(NotFittedError):
            regressor.predict(good.stretches)

    left_by(lambda: pds.fit_to_tests(regressor, wrong), "row 5")
    left_by(
        lambda: pds.fit_to_tests(regressor, replace(good, nominal_stress=np.zeros(24))), "all zero"
    )
    left_by(lambda: regressor.fit(-good.stretches, good.nominal_stress), "must be positive")
    left_by(lambda: regressor.fit(good.stretches, np.full(24, np.nan)), "NaN")


def test_rows_are_numbered_as_in_the_file(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text(
        "# a note\nmode,stretch,nominal_stress\nuniaxial,1.5,0.4\n\n"
        "uniaxial,2,0.7\nuniaxial,2.5,1\nequibiaxial,2,1\n"
    )
    data = load_test_data(path)
    assert data.row.tolist() == [1, 2, 3, 4]
    assert (
        data.of("equibiaxial").row_in_words(0) == "row 4 (equibiaxial, stretch 2, nominal stress 1)"
    )
    path.write_text(
        "stretch,lateral_stretch,nominal_stress,lateral_stress\n1.5,1.2,0.4,0.3\n2,1,0.7,0.2\n"
    )
    assert load_test_data(path).row.tolist() == [1, 1, 2, 2]
    assert (
        load_test_data(path).row_in_words(3)
        == "row 2 (biaxial, stretches 1 and 2, nominal stress 0.2)"
    )


@pytest.fixture
def written(tmp_path):
    """A file of test data, and what writes other stresses into it."""

    def write(data):
        rows = [
            f"{m},{x[0]},{y}"
            for m, x, y in zip(data.mode, data.stretches, data.nominal_stress, strict=True)
        ]
        (tmp_path / "tests.csv").write_text(
            "\n".join(["mode,stretch,nominal_stress", *rows]) + "\n"
        )
        return tmp_path / "tests.csv"

    return write


def test_commands_tell_and_refuse(good, written, tmp_path):
    def fit(data, *more):
        settings = "--law mooney-rivlin --samples 500 --folds 0 --degree 8,4"
        limits = "--least 0.6 --greatest 3 --out", tmp_path / "artifacts"
        return invoke("fit x --data", written(data), settings, limits, more)

    wrong = changed(good, 4, -0.5)
    refused = fit(wrong)
    assert refused.exit_code == 2
    assert "row 5 (uniaxial" in refused.stderr
    assert "--force-fit continues anyway" in refused.stderr
    assert not (tmp_path / "artifacts").exists() or not list((tmp_path / "artifacts").glob("x/*"))
    assert fit(changed(good, PURE_SHEAR, 9.81 * good.nominal_stress[PURE_SHEAR])).exit_code == 2
    forced = fit(wrong, "--force-fit")
    assert forced.exit_code == 0, forced.output
    assert "row 5 (uniaxial" in forced.stderr
    printed = " ".join(forced.output.replace("─", "").split())
    assert (
        "Tests simulated with the artifact, compared with the data mode difference stretch uniaxial"
        in printed
    )
    identification = pds.load_card(tmp_path / "artifacts" / "x").training["identification"]
    assert "row 5" in identification["refusals"][0]
    assert identification["residuals"][0]["row"] == 5
    told = invoke(
        "identify",
        written(changed(good, 4, 5 * good.nominal_stress[4])),
        "--law mooney-rivlin --json",
    )
    assert "row 5 (uniaxial, stretch 2.18571" in told.stderr
    assert "row 5" in json.loads(told.stdout[told.stdout.index("{") :])["laws"][0]["remarks"][0]


def test_fit_simulates_the_tests_with_its_artifact(good, written, tmp_path):
    options = [
        "--samples 500 --folds 0 --degree 12,6 --least 0.55 --greatest 3.2 --out",
        tmp_path / "artifacts",
    ]
    done = commanded(
        "fit x --data",
        written(good),
        "--law mooney-rivlin --bulk-modulus 80",
        options,
        "--json",
    )
    assert "the volume grows by 8 % in the tests" in done.stderr
    assert (tmp_path / "artifacts" / "x" / "1.png").stat().st_size > 5000
    found = json.loads(done.stdout[done.stdout.index("{\n") : done.stdout.rindex("\n}") + 2])
    assert found["training"]["identification"]["law"]["bulk_modulus"] == 80
    # The data are of K = 400: what the other modulus makes of them, which the law's other
    # parameters nearly make up for.
    assert all(
        abs(row["difference"]) < 0.02 for row in found["simulated"]["against_measured"].values()
    )
    # Equibiaxial stretches end at 3 too, and free sides of uniaxial tension at 1/sqrt 3 = 0.58.
    assert found["simulated"]["rows_outside_domain"] == 0
    assert "outside the artifact's domain" not in done.stderr
    law = pds.load_card(tmp_path / "artifacts" / "x").material.trained_with
    exact = nominal_stress(
        pds.materials.MooneyRivlin(
            *(law[key] for key in ("shear_modulus", "bulk_modulus", "second_share"))
        ),
        good.stretches,
    )
    # the surrogate's own error
    np.testing.assert_allclose(found["simulated"]["nominal_stress"], exact, atol=2e-3 * exact.max())


def test_fit_tells_how_many_tests_lie_outside_the_domain_of_its_artifact(good, written, tmp_path):
    """There the exact force is compared with itself, and the difference of 1e-14 says nothing of
    the artifact.
    """
    options = [
        "--samples 500 --folds 0 --degree 8,4 --least 0.4 --greatest 2.0 --out",
        tmp_path / "artifacts",
    ]
    done = commanded("fit x --data", written(good), "--law mooney-rivlin", options, "--json")
    found = json.loads(done.stdout[done.stdout.index("{\n") : done.stdout.rindex("\n}") + 2])
    # Of the eight stretches of each mode from 1.1 to 3 four are greater than 2; 0.4 is less than
    # the inverse root of all.
    assert found["simulated"]["rows_outside_domain"] == 12
    assert (
        "12 of 24 rows lie outside the artifact's domain (stretches from 0.4 to 2), where"
        " simulations use the exact force" in done.stderr
    )
    assert (
        "have stretches from 0.5774 to 3: set the domain with --least and --greatest" in done.stderr
    )
