"""Breaks of specimens: what is a strength and what is not, and the scatter of strengths."""

import numpy as np
import pytest
from refusals import raising

from pdsurrogate.measurements import read_tests
from pdsurrogate.measurements.breaks import WORDS, weibull_modulus
from pdsurrogate.measurements.quantities import found_in

STRETCH = np.linspace(1, 3, 81)


def stress_at(stretch):
    """Nominal stress of neo-Hookean rubber of 0.5 MPa."""
    return 0.5 * (stretch - stretch**-2)


def written(path, stretch, stress, above="", **columns):
    """Write a specimen of 25 mm and 12 mm2 as a machine does, and return its path."""
    heads = ["Extension (mm)", "Load (N)", *columns]
    cells = zip((stretch - 1) * 25, stress * 12, *columns.values(), strict=True)
    rows = [
        ";".join(f"{one:.5f}" if isinstance(one, float) else one for one in row) for row in cells
    ]
    path.write_text("\n".join([above + ";".join(heads), *rows]) + "\n")
    return path


def read(*paths, **stated):
    """Read specimens in tension."""
    return read_tests(*paths, mode="uniaxial", gauge_length="25 mm", area="12 mm2", **stated)


def curve(most, drop=True):
    """Stretches and stresses up to a break."""
    stretch = np.linspace(1, most, 81)
    stress = stress_at(stretch)
    return (np.append(stretch, most + 0.02), np.append(stress, 0.0)) if drop else (stretch, stress)


@pytest.mark.parametrize(
    ("above", "columns", "stated"),
    [
        ("Broke: yes\n", {}, {}),
        ("", {"Broke": ["no"] * 80 + ["yes"]}, {}),
        ("", {"broke": [0.0] * 80 + [1.0]}, {}),
        ("", {}, {"broke": True}),
    ],
)
def test_a_break_that_is_said_needs_no_drop_of_the_load(tmp_path, above, columns, stated):
    path = written(tmp_path / "0.csv", *curve(3.0, drop=False), above, **columns)
    broken = read(path, **stated).at_break["uniaxial"]
    assert broken["specimens"] == 1
    assert broken["stretch"][0] == pytest.approx(3.0, abs=1e-5)
    assert broken["nominal_stress"][0] == pytest.approx(stress_at(3.0), rel=1e-4)
    assert not read(written(tmp_path / "1.csv", *curve(3.0, drop=False))).at_break


@pytest.mark.parametrize(("mode", "directions"), [("equibiaxial", 2), ("pure-shear", 1)])
def test_the_work_at_break_is_that_in_all_directions(tmp_path, mode, directions):
    """Strain energy density of neo-Hookean rubber; held directions do no work."""
    stretch = np.linspace(1, 3, 401)
    power = {2: 5, 1: 3}[directions]
    stress = np.append(0.6 * (stretch - stretch**-power), 0.0)
    path = written(tmp_path / "0.csv", np.append(stretch, 3.02), stress)
    tests = read_tests(path, mode=mode, gauge_length="25 mm", area="12 mm2")
    energy = {2: 0.3 * (2 * 3**2 + 3**-4 - 3), 1: 0.3 * (3**2 + 3**-2 - 2)}[directions]
    assert tests.at_break[mode]["work"][0] == pytest.approx(energy, rel=1e-4)


@pytest.mark.parametrize(
    ("above", "stated", "why"),
    [
        ("Failure location: at the jaws\n", {}, "it broke at the grips"),
        ("Bruchort: Klemme\n", {}, "it broke at the grips"),
        ("End of test: travel limit\n", {}, "a limit of the machine"),
        ("", {"broke": "slipped"}, "it slipped"),
        ("", {"broke": False}, "it did not break"),
    ],
)
def test_what_is_said_to_be_no_strength_is_none(tmp_path, above, stated, why):
    tests = read(written(tmp_path / "0.csv", *curve(3.0), above), **stated)
    assert not tests.at_break
    assert tests.specimens[0].chosen.sum() == 81  # the rows before are good
    assert why in " ".join(tests.assumed)


@pytest.mark.parametrize(
    ("said", "kind"),
    [
        ("not at the jaw", "yes"),
        ("Between the grips", "yes"),
        ("nicht an der Klemme", "yes"),
        ("no jaw break", "yes"),
        ("no", "no"),
        ("did not break, slipped out of the grips", "grips"),
        ("jaw no. 2", "grips"),
    ],
)
def test_places_that_are_not_at_the_grips_are_none(said, kind):
    assert found_in(WORDS, said) == kind


def test_where_a_specimen_broke_is_not_said_of_the_next_one(tmp_path):
    """Sizes that are stated once are those of all."""
    entries = ["Width,6,mm\nThickness,2,mm\nFailure location,jaw\n", "", "Broke,yes\n", ""]
    tables = []
    for number, above in enumerate(entries):
        stretch, stress = curve(2.6 + 0.1 * number)
        rows = zip((stretch - 1) * 25, stress * 12, strict=True)
        table = "".join(f"{a:.5f},{b:.5f}\n" for a, b in rows)
        heads = "Extension,Load\n(mm),(N)\n"
        tables.append(f"Specimen label,T{number}\n{above}\n{heads}{table}\n")
    path = tmp_path / "0.csv"
    path.write_text("".join(tables))
    tests = read_tests(path, mode="uniaxial", gauge_length="25 mm")
    assert [one.at_break.no_strength for one in tests.specimens] == [
        "it broke at the grips",
        *[None] * 3,
    ]


def test_a_specimen_that_slips_has_no_strength(tmp_path):
    stretch, stress = curve(3.0)
    slipped = stress.copy()
    slipped[40:81] = stress_at(stretch[40:81] - 0.2)  # lost length in the grips, then pulls again
    slipped[41:44] = stress[40] * np.array([0.7, 0.6, 0.65])
    after = np.append(stretch, stretch[-1] + np.array([0.1, 0.2]))
    again = np.append(stress, stress[80] * np.array([0.4, 0.7]))
    again[81] = 0.3 * stress[80]
    for number, rows in enumerate(((stretch, slipped), (after, again))):
        tests = read(written(tmp_path / f"{number}.csv", *rows))
        assert not tests.at_break
        assert "as if it slipped" in " ".join(tests.assumed)
    noise = 1 + 0.01 * np.random.default_rng(1).standard_normal(82)
    assert read(written(tmp_path / "2.csv", stretch, stress * noise)).at_break


def test_several_ends_at_one_stretch_are_a_limit(tmp_path):
    paths = []
    for number, share in enumerate((0.9, 1.0, 1.1)):
        stretch, stress = curve(3.0, drop=False)
        paths.append(written(tmp_path / f"{number}.csv", stretch, share * stress))
    tests = read(*paths, broke=True)
    assert not tests.at_break
    assert "3 specimens end at the same stretch" in " ".join(tests.assumed)


def test_what_is_said_of_a_break_must_be_so(tmp_path):
    stretch = np.r_[STRETCH, STRETCH[-2::-1]]
    there_and_back = written(tmp_path / "0.csv", stretch, stress_at(stretch))
    with raising("broke as is said, but the load neither drops"):
        read(there_and_back, broke=True)
    with raising("broke must be true, false, or grips"):
        read(there_and_back, broke="perhaps")
    path = written(tmp_path / "1.csv", *curve(3.0), "Broke: yes\n")
    with raising("--broke grips, but the file says yes"):
        read(path, broke="grips")


def test_the_modulus_of_simulated_strengths_is_theirs():
    """In the mean over samples, which the estimate of greatest likelihood exceeds by 44 % and 8 %;
    and its standard error is their deviation.
    """
    for number, samples in ((5, 150), (20, 60)):
        random = np.random.default_rng(number)
        found = np.array(
            [weibull_modulus(4.0 * random.weibull(10.0, number)) for _ in range(samples)]
        )
        mean, error = found.mean(axis=0)
        assert mean == pytest.approx(10.0, abs=4 * found[:, 0].std() / np.sqrt(samples))
        assert error == pytest.approx(found[:, 0].std(), rel=0.25)
    assert weibull_modulus(np.array([1.0, 2.0, 3.0, 4.0])) is None
    assert weibull_modulus(np.full(6, 2.0)) is None


def test_means_at_break_have_the_modulus_from_five_specimens_on(tmp_path):
    most = (2.8, 2.9, 3.0, 3.1, 3.2)
    paths = [written(tmp_path / f"{number}.csv", *curve(one)) for number, one in enumerate(most)]
    assert "weibull_modulus" not in read(*paths[:4]).at_break["uniaxial"]
    broken = read(*paths).at_break["uniaxial"]
    assert broken["weibull_modulus"] == pytest.approx(
        weibull_modulus(stress_at(np.array(most))), rel=1e-3
    )
