"""Tables that are no rubber, or not as a fit takes them: the cause is named, not thirty bad
rows, and not nothing.
"""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from commands import commanded
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.identification import MODES, TestData, TestDataWarning, examine, nominal_stress
from pdsurrogate.identification.examination import suspicions

RUBBER = pds.materials.Gent(0.4, 400.0, 60.0)


def curve(stretches, mode="uniaxial", given=None, noise=0.01):
    """Return test data of Gent's rubber at some stretches, with the stretches `given` in their
    place if they are not None.
    """
    stretches = np.asarray(stretches, dtype=float)
    stress = nominal_stress(RUBBER, np.stack([stretches, MODES[mode](stretches)], axis=1))
    stress *= 1 + noise * np.random.default_rng(0).standard_normal(len(stress))
    given = stretches if given is None else np.asarray(given, dtype=float)
    return TestData(
        "made",
        np.array([mode] * len(given)),
        np.stack([given, MODES[mode](given)], axis=1),
        stress,
        np.ones(len(given)),
    )


@pytest.mark.parametrize(("least", "greatest"), [(1.5, 89.0), (7.0, 560.0)])
@pytest.mark.parametrize("mode", ["uniaxial", "pure-shear"])
def test_strains_in_per_cent_are_named(least, greatest, mode):
    """Yeoh's law fits them as stretches with an R^2 of 0.98 and more, and a shear modulus of
    almost nothing.
    """
    percent = np.linspace(least, greatest, 25)
    data = curve(1 + percent / 100, mode, percent)
    with pytest.warns(
        TestDataWarning,
        match=(
            rf"^all modes: the stretches, {least:g} to {greatest:g}, look like strains in per cent;"
            r" a stretch is 1 \+ strain/100$"
        ),
    ):
        pds.fit_to_tests(pds.identification.LawRegressor("yeoh"), data, force=True)


def test_strains_in_the_place_of_stretches_are_named():
    strain = np.linspace(0.05, 3.0, 25)
    said = suspicions(curve(1 + strain, given=strain))
    assert (
        said[0] == "all modes: the stretches, 0.05 to 3, look like strains; a stretch is 1 + strain"
    )
    assert len(said) == 1


def test_stretches_that_the_stress_confirms_are_let_alone():
    """A gel that is stretched twenty-fold: its stress at small stretches is that of stretches."""
    stretch = np.concatenate([np.linspace(1.1, 3.0, 10), np.linspace(4.0, 20.0, 15)])
    gel = pds.materials.Gent(0.01, 10.0, 900.0)
    X = np.stack([stretch, stretch**-0.5], axis=1)
    stress = nominal_stress(gel, X) * (1 + 0.005 * np.random.default_rng(0).standard_normal(25))
    assert not suspicions(TestData("gel", np.array(["uniaxial"] * 25), X, stress, np.ones(25)))


@pytest.fixture
def cycle():
    """Loading to a stretch of 3 and unloading, which is softer."""
    up = np.linspace(1.1, 3.0, 20)
    stretches = np.concatenate([up, up[-2::-1]])
    data = curve(stretches, noise=0.002)
    data.nominal_stress[20:] *= 0.55 + 0.4 * ((stretches[20:] - 1) / 2) ** 2
    return data


def test_hysteresis_is_named_and_the_loading_branch_taken(cycle, tmp_path):
    (said,) = suspicions(cycle)
    assert (
        said
        == "uniaxial: 19 of 39 rows are of unloading or of loading again, with other stresses than"
        " those of first loading (hysteresis), which no elastic law describes; take the loading"
        " branch alone (--branch loading)"
    )
    with pytest.warns(TestDataWarning, match=r"hysteresis: 2\d\.\d % of the work"):
        loading = pds.load_test_data(written(cycle, tmp_path))
    assert loading.row.tolist() == [*range(1, 21)]
    model = pds.identification.LawRegressor("gent").fit(loading.stretches, loading.nominal_stress)
    assert not examine(model, loading).remarks
    assert model.law_.shear_modulus == pytest.approx(0.4, rel=0.02)


def test_orders_that_are_no_unloading(tmp_path):
    """A table from the greatest stretch down, and two specimens one after the other that agree."""
    down = np.linspace(3.0, 1.1, 20)
    twice = curve(np.concatenate([down[::-1], down[::-1]]))
    for data in (curve(down), twice, curve(down[::-1], "pure-shear")):
        assert not suspicions(data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TestDataWarning)
            assert len(pds.load_test_data(written(data, tmp_path))) == len(data)


def written(data, folder):
    """Write test data to a file, whose path is returned."""
    rows = [
        f"{mode},{x[0]:.6g},{y:.6g}"
        for mode, x, y in zip(data.mode, data.stretches, data.nominal_stress, strict=True)
    ]
    path = folder / "tests.csv"
    path.write_text("\n".join(["mode,stretch,nominal_stress", *rows]) + "\n")
    return path


def test_commands_take_the_loading_branch(cycle, tmp_path):
    done = commanded("identify", written(cycle, tmp_path), "--law gent")
    assert "20 of 39 rows are taken (the first loading)" in " ".join(done.stderr.split())
    assert "20 rows" in " ".join(done.output.split())


def foam(stretch, lateral):
    """Return a table of a uniaxial test with its lateral stretches, and stresses across it of
    zero, as `load_test_data` reads it.
    """
    stress = 0.05 * (stretch - stretch**-3.0)
    X = np.stack(
        [np.stack([stretch, lateral], axis=1), np.stack([lateral, stretch], axis=1)], axis=1
    ).reshape(-1, 2)
    values = np.stack([stress, np.zeros_like(stress)], axis=1).ravel()
    return TestData(
        "foam",
        np.array(["biaxial"] * len(X)),
        X,
        values,
        np.ones(len(X)),
        np.repeat(np.arange(1, len(stretch) + 1), 2),
    )


def test_a_foam_is_named_where_its_lateral_stretches_are_known():
    stretch = np.linspace(0.4, 0.95, 12)
    regressor = pds.identification.LawRegressor("mooney-rivlin")
    with raising(
        r"row 1 \(biaxial, stretches 0.4 and 1.02, .*: the stretches along and across a"
        r" uniaxial load change the volume by -58 %: "
        "the material is compressible, such as a foam, and these are laws of rubber"
    ):
        pds.fit_to_tests(regressor, foam(stretch, np.full(12, 1.02)))
    rubber = foam(stretch, stretch**-0.5 * 1.01)
    assert not any(
        "volume" in text
        for text in examine(regressor.fit(rubber.stretches, rubber.nominal_stress), rubber).refusals
    )


@pytest.mark.parametrize("alpha", [2.0, 8.0])
def test_a_foam_is_named_in_compression_alone(alpha):
    """Hill's foam of Poisson's ratio 0; no law of rubber follows it, and rubber is let alone."""
    stretch = np.linspace(0.98, 0.4, 25)
    data = curve(stretch)
    assert not suspicions(data)
    noise = 1 + 0.005 * np.random.default_rng(0).standard_normal(25)
    stress = 0.1 / alpha * (stretch ** (alpha - 1) - 1 / stretch) * noise
    (said,) = suspicions(replace(data, nominal_stress=stress))
    assert "it is compressible, such as a foam, and these are laws of rubber" in said


@pytest.mark.parametrize(
    ("column", "values"),
    [("lateral_stretch", lambda stretch: stretch**-0.1), ("volume ratio", lambda x: x**0.8)],
)
def test_a_foam_is_named_where_its_file_has_lateral_stretches(tmp_path, column, values):
    stretch = np.linspace(1.05, 2.0, 12)
    rows = zip(stretch, values(stretch), 0.05 * (stretch - 1 / stretch), strict=True)
    lines = [",".join(f"{one:.5g}" for one in row) for row in rows]
    path = tmp_path / "foam.csv"
    path.write_text("\n".join([f"stretch,{column},nominal_stress", *lines]) + "\n")
    data = pds.load_test_data(path, mode="uniaxial")
    with raising("change the volume by 74 %: the material is compressible"):
        pds.fit_to_tests(pds.identification.LawRegressor("mooney-rivlin"), data)


def test_a_row_of_unloading_alone_and_a_peak_that_is_twice(cycle, tmp_path):
    up = cycle.where(np.arange(len(cycle)) < 20)
    both = np.r_[np.arange(20), 19, np.arange(20, 39)]  # the row of the peak twice
    (said,) = suspicions(cycle.where(both))
    assert "20 of 40 rows are of unloading" in said
    alone = cycle.where(np.r_[np.arange(20), 30])  # one row of unloading
    (said,) = suspicions(alone)
    assert said.endswith("from the other rows, and is not of first loading")
    for data in (cycle.where(both), alone):
        with pytest.warns(TestDataWarning, match=r"20 of \d+ rows are taken"):
            loading = pds.load_test_data(written(data, tmp_path))
        np.testing.assert_allclose(loading.stretches, up.stretches, rtol=1e-5)


def test_a_mode_of_one_row_is_named():
    one = curve([1.5])
    assert suspicions(one)[0] == "uniaxial: there is one row only, which shows no curve"
