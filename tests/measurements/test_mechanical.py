"""Mechanical tests from files of machines: the law that made them is found again, and what is
ambiguous, contradictory or broken is named.
"""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from refusals import raising, refused

import pdsurrogate as pds
from pdsurrogate.identification import TestDataWarning
from pdsurrogate.measurements import read_tests

MACHINES = Path(__file__).parents[1] / "data" / "machines"
TRUTH = json.loads((MACHINES / "TRUTH.json").read_text("utf-8"))

GEOMETRY = {"mode": "uniaxial", "gauge_length": "25 mm", "area": "12 mm2"}
UNIAXIAL = {"mode": "uniaxial"}
STATED = {
    "bluehill-raw.csv": GEOMETRY,
    "bluehill-inch-pound.csv": GEOMETRY,
    "bluehill-chinese.csv": GEOMETRY,
    "cycle-in-kN.csv": GEOMETRY,
    "stretch-stress.csv": UNIAXIAL | {"units": {"stress": "MPa"}},
    "stress-first.txt": UNIAXIAL
    | {"columns": {"stress": 1, "stretch": 2}, "units": {"stress": "MPa"}},
    "decimal-comma.txt": {},
    "abaqus-test-data.inp": {},
    "workbook.xlsx": {},
}
"""What the truth says that a file needs."""


def gent(stretch, shear_modulus=0.6, limit=40.0):
    """Nominal stress of Gent's law in uniaxial tension at constant volume."""
    first = stretch**2 + 2 / stretch - 3
    return shear_modulus * limit / (limit - first) * (stretch - stretch**-2)


def table(folder, **columns):
    """Write columns to a file, whose path is returned; a heading has its unit after a blank."""
    heads = [name.replace("__", " ") for name in columns]
    rows = zip(*columns.values(), strict=True)
    path = folder / "test.csv"
    lines = [";".join(f"{value:.6g}" for value in row) for row in rows]
    path.write_text("\n".join([";".join(heads), *lines]) + "\n")
    return path


def machine(folder, stretch, stress, time=None):
    """Write a file with force and extension of a specimen of 25 mm and 12 mm2."""
    stretch = np.asarray(stretch, dtype=float)
    time = np.arange(len(stretch)) if time is None else time
    return table(folder, Time__s=time, Extension__mm=(stretch - 1) * 25, Load__N=stress * 12)


@pytest.mark.parametrize("name", TRUTH)
def test_the_law_of_every_file_is_found_again(name):
    if name.endswith("xlsx"):
        pytest.importorskip("python_calamine")
    warnings.simplefilter("ignore", TestDataWarning)
    data = pds.load_test_data(MACHINES / name, **STATED.get(name, UNIAXIAL))
    assert data.unit == (None if name.endswith("inp") else "MPa")
    modes = TRUTH[name].get("modes", TRUTH[name].get("mode")).split(", ")
    assert sorted(data.modes) == sorted(modes)
    model = pds.identification.LawRegressor("gent")
    model.fit(data.stretches, data.nominal_stress, data.balanced_weights())
    found = dict(zip(model.parameter_names_, model.parameters_, strict=True))
    assert found["shear_modulus"] == pytest.approx(TRUTH[name]["shear_modulus_MPa"], rel=0.01)
    assert found["chain_limit"] == pytest.approx(TRUTH[name]["chain_limit"], rel=0.03)


@refused("files of machines")
def test_what_is_stated_wrongly_is_refused_with_its_cause(name, stated, message):
    if name.endswith("xlsx"):
        pytest.importorskip("python_calamine")
    warnings.simplefilter("ignore", TestDataWarning)
    with raising(message):
        pds.load_test_data(MACHINES / name, **UNIAXIAL | stated)


def test_facts_that_do_not_exist_are_refused():
    with raising("no fact gauge; there are mode, gauge_length", TypeError):
        read_tests(MACHINES / "lambda-P.csv", gauge="25 mm")


@pytest.mark.parametrize(
    ("name", "stated", "needed"),
    [
        ("bluehill-raw.csv", {}, ["--mode", "--gauge-length", "--area"]),
        ("stress-first.txt", UNIAXIAL, ["--column stretch=2 --column stress=1", "stress=2"]),
        ("lambda-P.csv", {}, ["--mode uniaxial|equibiaxial|pure-shear"]),
    ],
)
def test_what_is_missing_is_asked_for_with_its_option(name, stated, needed):
    tests = read_tests(MACHINES / name, **stated)
    assert not tests.specimens
    for words in needed:
        assert words in "; ".join(tests.missing)


def test_a_gauge_length_is_needed_as_soon_as_the_extension_has_a_unit(tmp_path):
    stretch = np.linspace(1, 4, 61)
    path = table(tmp_path, Extension=(stretch - 1) * 25, Load=gent(stretch) * 12)
    missing = "; ".join(read_tests(path, **GEOMETRY).missing)
    assert "--unit extension=" in missing
    assert "--unit force=" in missing
    (found,) = read_tests(path, **GEOMETRY, units={"extension": "mm", "force": "N"}).specimens
    np.testing.assert_allclose(found.stretch, stretch, rtol=1e-5)


def test_two_measures_of_extension_that_differ_are_chosen_by_the_user(tmp_path):
    """The crosshead moves further than the extensometer says."""
    stretch = np.linspace(1, 4, 61)
    columns = {"Extension__mm": (stretch - 1) * 30, "Strain": stretch - 1, "Load__N": gent(stretch)}
    path = table(tmp_path, **columns)
    facts = UNIAXIAL | {"area": "1 mm2", "gauge_length": "25 mm"}
    with raising(r"1 to 4\) contradicts .* 1 to 4.6\): .* --column extension"):
        read_tests(path, **facts)
    (found,) = read_tests(path, **facts, columns={"extension": "Extension"}).specimens
    assert found.stretch.max() == pytest.approx(4.6)
    (found,) = read_tests(path, **UNIAXIAL, area="1 mm2", columns={"strain": "Strain"}).specimens
    assert found.stretch.max() == pytest.approx(4.0)


STRETCH = np.linspace(1, 4, 61)


@pytest.mark.parametrize(
    ("columns", "asked", "answer"),
    [
        (
            {"Strain": STRETCH, "Stress__MPa": gent(STRETCH)},
            r"stretch 2 to 5\), or as a stretch of 1 to 4",
            {"columns": {"stretch": "Strain"}},
        ),
        (
            {"Stretch": STRETCH - 1, "Stress__MPa": gent(STRETCH)},
            "is 0 without stress; as a strain it gives a stretch of 1 to 4",
            {"columns": {"strain": "Stretch"}},
        ),
        (
            {"Strain": 100 * (STRETCH - 1), "Stress__MPa": gent(STRETCH)},
            r"stretch 1 to 301\), or in per cent to a stretch of 4",
            {"units": {"strain": "%"}},
        ),
        (
            {"True strain": np.log(STRETCH), "Stress__MPa": gent(STRETCH) * STRETCH},
            r"0 to 14.26\), or 'Stress' as true-stress \(nominal stress 0 to 3.566",
            {"stress": "true"},
        ),
    ],
)
def test_two_readings_are_shown_with_the_option_for_each(tmp_path, columns, asked, answer):
    path = table(tmp_path, **columns)
    with raising(asked):
        pds.load_test_data(path, **UNIAXIAL)
    with pytest.warns(TestDataWarning):
        data = pds.load_test_data(path, **UNIAXIAL, **answer)
    np.testing.assert_allclose(data.stretches[:, 0], STRETCH, rtol=1e-5)
    np.testing.assert_allclose(data.nominal_stress, gent(STRETCH), rtol=2e-5, atol=1e-6)


def test_branches_cycles_and_holds_are_those_of_the_program(tmp_path):
    """Two cycles with a hold at the first peak, sampled finely, with noise of 0.01 mm."""
    program = [
        ("loading", 1, np.linspace(1, 2, 200, endpoint=False)),
        ("hold", 1, np.full(100, 2.0)),
        ("unloading", 1, np.linspace(2, 1, 200, endpoint=False)),
        ("loading", 2, np.linspace(1, 2.5, 300, endpoint=False)),
        ("unloading", 2, np.linspace(2.5, 1, 300)),
    ]
    branch = np.concatenate([[name] * len(part) for name, _, part in program])
    cycle = np.concatenate([[number] * len(part) for _, number, part in program])
    stretch = np.concatenate([part for *_, part in program])
    softer = np.where(branch == "unloading", 0.8, 1.0)
    noise = np.random.default_rng(0).normal(0, 0.0004, len(stretch))
    path = machine(tmp_path, stretch + noise, gent(stretch) * softer)
    (found,) = read_tests(path, **GEOMETRY).specimens
    # A turn is known to a few rows.
    assert (found.branch != branch).sum() <= 12
    assert (found.cycle != cycle).sum() <= 6
    assert found.time[-1] == len(stretch) - 1
    assert abs(int(found.chosen.sum()) - 200) <= 4
    assert ((branch == "loading") & (cycle == 1))[found.chosen].mean() > 0.98
    for wanted, rows in (("all", 1100), (2, 600), ("unloading", 200)):
        (part,) = read_tests(path, **GEOMETRY, branch=wanted).specimens
        assert abs(int(part.chosen.sum()) - rows) <= 12
    (said,) = [text for text in read_tests(path, **GEOMETRY).assumed if "hysteresis" in text]
    # 20 % less stress on the way back, over the same stretches
    assert float(said.split("hysteresis: ")[1].split(" %")[0]) == pytest.approx(20, abs=1)


def test_small_cycles_before_a_break_have_no_holds_at_their_turns(tmp_path):
    parts = [part for top in (1.5, 2.0, 2.5) for part in ((1.05, top), (top, 1.05))]
    parts = [np.linspace(*ends, 100) for ends in [*parts, (1.05, 4.0)]]
    parts[0] = np.linspace(1, 1.5, 100)
    branch = np.repeat(["loading", "unloading"] * 3 + ["loading"], 100)
    stretch = np.concatenate(parts)
    stress = gent(stretch) * np.where(branch == "unloading", 0.8, 1.0)
    path = machine(tmp_path, np.r_[stretch, 4.02, 4.03], np.r_[stress, 0.05, 0.02])
    (found,) = read_tests(path, **GEOMETRY).specimens
    assert (found.branch[:700] != branch).sum() <= 6  # rows at the turns that are given twice
    assert found.cycle.tolist() == np.repeat([1, 2, 3, 4], [200, 200, 200, 102]).tolist()
    assert found.chosen.sum() == 100
    assert found.at_break.stretch == 4.0


LONG = np.linspace(1, 5, 401)


@pytest.mark.parametrize(
    ("stretch", "stress"),
    [
        (np.linspace(5.01, 5.1, 10), np.full(10, 0.02)),  # the load drops
        (np.full(10, 1.2), np.full(10, 0.02)),  # the clip of the extensometer jumps back
        (np.linspace(5.01, 5.2, 20), gent(5.0) * np.linspace(0.98, 0.3, 20)),  # a slow tear
        (np.linspace(5.0, 5.002, 12), gent(5.0) * np.linspace(0.9, 0.0, 12)),  # falls in 12 rows
    ],
)
def test_the_break_is_recorded_and_what_follows_left_out(tmp_path, stretch, stress):
    path = machine(tmp_path, np.r_[LONG, stretch], np.r_[gent(LONG), stress])
    tests = read_tests(path, **GEOMETRY)
    (found,) = tests.specimens
    assert found.chosen.sum() == len(LONG)
    assert (found.branch == "broken").sum() == len(stretch)
    # Energy of Gent's law at a stretch of 5.
    energy = -0.3 * 40 * np.log(1 - (25 + 0.4 - 3) / 40)
    broken = found.at_break
    assert broken.stretch == pytest.approx(5.0, rel=1e-5)
    assert broken.nominal_stress == pytest.approx(gent(5.0), rel=1e-5)
    assert broken.work == pytest.approx(energy, rel=1e-3)
    assert "breaks at a stretch of 5" in " ".join(tests.assumed)


def test_elastic_unloading_and_lists_of_any_order_do_not_break(tmp_path):
    limited = np.linspace(1, 6.2, 80)  # near the limit of Gent's law, whose stress falls fast
    there_and_back = np.r_[limited, limited[-2::-1]]
    both_sides = np.linspace(0.5, 3.0, 60)
    shuffled = np.random.default_rng(1).permutation(both_sides)
    for stretch, rows in ((there_and_back, 80), (both_sides, 60), (shuffled, 60)):
        (found,) = read_tests(
            table(tmp_path, stretch=stretch, nominal_stress=gent(stretch)), **UNIAXIAL
        ).specimens
        assert found.at_break is None
        assert found.chosen.sum() == rows


def test_slack_of_a_filled_rubber(tmp_path):
    """Its first stiffness is 2.5 times that of Mooney's law at larger strains."""
    stretch = np.linspace(1, 3, 101)
    first = stretch**2 + 2 / stretch - 3
    stress = 0.3 * (1 + 1.5 * np.exp(-first / 0.05)) * (stretch - stretch**-2)
    path = machine(tmp_path, np.r_[1, 1.02, 1.04, 1.06, stretch + 0.08], np.r_[np.zeros(4), stress])
    (said,) = [text for text in read_tests(path, **GEOMETRY).assumed if "zero force" in text]
    assert float(said.split(" is ")[1].split(" ")[0]) == pytest.approx(1.08, abs=0.015)
    unshifted = machine(tmp_path, stretch, stress)
    assert not any("zero force" in text for text in read_tests(unshifted, **GEOMETRY).assumed)


@pytest.mark.parametrize("seed", [0, 1])
def test_slack_and_preload_are_said_and_shifted(tmp_path, seed):
    noise = 1 + 0.003 * np.random.default_rng(seed).standard_normal(200)
    stretch = np.linspace(1, 4, 121)
    slack = np.r_[np.linspace(1, 1.04, 9)[:-1], stretch + 0.04]
    force = np.r_[np.zeros(8), gent(stretch) * noise[:121]]
    loaded = stretch[stretch > 1.03]
    for shown, stress, zero, word in (
        (slack, force, 1.04, "slack"),
        (loaded - loaded[0] + 1, gent(loaded) * noise[: len(loaded)], 2 - loaded[0], "preload"),
    ):
        path = machine(tmp_path, shown, stress)
        tests = read_tests(path, **GEOMETRY)
        (said,) = [text for text in tests.assumed if "zero force" in text]
        assert word in said
        assert float(said.split(" is ")[1].split(" ")[0]) == pytest.approx(zero, abs=0.003)
        (found,) = tests.specimens
        law = gent(found.stretch[found.chosen])
        assert np.abs(found.nominal_stress[found.chosen] - law).max() < 0.02 * law.max()
        (kept,) = read_tests(path, **GEOMETRY, zero="keep").specimens
        np.testing.assert_allclose(kept.stretch, shown, rtol=1e-5)


def test_numbers_that_are_positive_in_compression_are_turned(tmp_path):
    stretch = np.linspace(1, 0.5, 40)
    path = table(
        tmp_path,
        **{"Compressive strain": 1 - stretch, "Compressive stress__MPa": -gent(stretch)},
    )
    tests = read_tests(path, **UNIAXIAL)
    np.testing.assert_allclose(tests.specimens[0].stretch, stretch, rtol=1e-5)
    np.testing.assert_allclose(tests.specimens[0].nominal_stress, gent(stretch), atol=1e-5)
    assert "'Compressive stress' is positive in compression" in " ".join(tests.assumed)


def test_specimens_have_weights_by_their_scatter_and_means_at_break(tmp_path):
    stretch = np.linspace(1, 4, 61)
    shares = (0.95, 1.0, 1.05)
    paths = []
    for number, share in enumerate(shares):
        (folder := tmp_path / str(number)).mkdir()
        paths.append(machine(folder, np.r_[stretch, 4.01], np.r_[share * gent(stretch), 0.01]))
    tests = read_tests(*paths, **GEOMETRY)
    assert [len(one.stretch) for one in tests.specimens] == [62, 62, 62]
    broken = tests.at_break["uniaxial"]
    assert broken["specimens"] == 3
    mean, deviation = broken["nominal_stress"]
    assert mean == pytest.approx(gent(4.0), rel=1e-5)
    assert deviation == pytest.approx(0.05 * gent(4.0), rel=1e-4)
    with pytest.warns(TestDataWarning, match="the specimens scatter by 5 % at the greatest stress"):
        data = pds.load_test_data(*paths, **GEOMETRY)
    assert len(data) == 183
    last = np.isclose(data.stretches[:, 0], 4.0)
    np.testing.assert_allclose(
        data.weight[last], (0.05 * np.array(shares) * gent(4.0)) ** -2.0, rtol=1e-3
    )


def test_several_files_make_one_data_set_and_units_must_agree(tmp_path):
    files = [MACHINES / "lambda-P.csv", MACHINES / "strain-percent.csv"]
    with pytest.warns(TestDataWarning):
        data = pds.load_test_data(*files, **UNIAXIAL)
    assert (len(data), data.unit, data.row[-1]) == (122, "MPa", 122)
    with raising(r"units of stress differ .*stretch-stress.csv: none"):
        pds.load_test_data(MACHINES / "stretch-stress.csv", *files, **UNIAXIAL)
    with raising("treloar is complete"):
        pds.load_test_data("treloar", **UNIAXIAL)
    with pytest.warns(TestDataWarning):
        kilopascals = pds.load_test_data(*files, **UNIAXIAL, stress_unit="kPa")
    np.testing.assert_allclose(kilopascals.nominal_stress, 1000 * data.nominal_stress, rtol=1e-12)


def test_stresses_along_both_directions_have_units_and_are_divided_by_their_stretch(tmp_path):
    along, across = np.array([1.1, 1.3, 1.5]), np.array([1.05, 1.1, 1.2])
    columns = {"Stretch": along, "Lateral stretch": across, "Stress__kPa": 100 * along}
    path = table(tmp_path, **columns, **{"Lateral stress__MPa": 0.1 * across})
    with pytest.warns(TestDataWarning):
        data = pds.load_test_data(path, stress="true")
    np.testing.assert_allclose(data.nominal_stress, 0.1)
    path = table(tmp_path, **columns, **{"Lateral stress": 0.1 * across})
    with raising("the unit of all stresses"):
        pds.load_test_data(path)


def rubber(path, **stated):
    """Return the rows that are taken of a file, as stretches and stresses, and what is said."""
    tests = read_tests(path, **stated)
    assert not tests.missing, tests.missing
    (found,) = tests.specimens
    chosen = found.chosen
    return found.stretch[chosen], found.nominal_stress[chosen], " ".join(tests.assumed)


RAMP = np.linspace(1, 4, 121)


def test_a_hold_in_which_most_stress_relaxes_is_no_break_and_no_preload(tmp_path):
    ramp = np.linspace(1, 4, 61)
    relaxed = gent(4.0) * (0.3 + 0.7 * np.exp(-np.arange(240) / 20))
    stiff = gent(ramp) + 0.1 * gent(4.0) * (1 - np.exp(-(ramp - 1) / 0.01))  # viscous, at first
    path = machine(tmp_path, np.r_[ramp, np.full(240, 4.0)], np.r_[stiff, relaxed])
    stretch, _, said = rubber(path, **GEOMETRY)
    assert stretch == pytest.approx(ramp)
    assert "break" not in said
    assert "zero force" not in said
    # Without the first row the stress at a stretch of 1 is said, and nothing is moved.
    path = machine(tmp_path, ramp[1:] - ramp[1] + 1, stiff[1:])
    stretch, _, said = rubber(path, **GEOMETRY)
    assert "zero force" not in said
    assert "the nominal stress is" in said
    assert stretch.min() == 1


def test_rows_of_creep_are_a_hold(tmp_path):
    ramp, crept = np.linspace(1, 2, 40), 2 + 0.3 * (1 - np.exp(-np.arange(200) / 60))
    path = machine(tmp_path, np.r_[ramp, crept], gent(np.r_[ramp, np.full(200, 2.0)]))
    stretch, stress, said = rubber(path, **GEOMETRY)
    assert stress == pytest.approx(gent(stretch), abs=0.01)
    assert stretch.max() == pytest.approx(2)
    assert "of hold" in said


@pytest.mark.parametrize("slack", [0.1, 0.5, 1.5])
def test_slack_of_any_size_is_found(tmp_path, slack):
    shown = np.r_[np.linspace(1, 1 + slack, 20)[:-1], RAMP + slack]
    path = machine(tmp_path, shown, np.r_[np.full(19, 0.001), gent(RAMP)])
    stretch, stress, said = rubber(path, **GEOMETRY)
    assert np.abs(stress - gent(stretch)).max() < 0.01 * stress.max()
    assert "(slack)" in said


@pytest.mark.parametrize("start", [125.3, -60.0])
def test_positions_of_a_crosshead_count_from_the_row_without_force(tmp_path, start):
    path = table(tmp_path, Position__mm=(RAMP - 1) * 25 + start, Load__N=gent(RAMP) * 12)
    stretch, _, said = rubber(path, **GEOMETRY)
    assert stretch == pytest.approx(RAMP, abs=1e-4)
    assert f"begins at {start:g}" in said


def test_a_break_to_no_force_is_not_taken_for_the_start(tmp_path):
    path = machine(tmp_path, np.r_[RAMP, 4.1], np.r_[gent(RAMP) + 0.002, 0.0])
    assert rubber(path, **GEOMETRY)[0].max() == pytest.approx(4)


def test_columns_that_agree_settle_what_one_of_them_leaves_open(tmp_path):
    stretch = np.linspace(1.07, 17.07, 60)
    columns = {"True Strain": np.log(stretch), "Engineering Strain": stretch - 1}
    path = table(tmp_path, **columns, **{"Engineering Stress (MPa)": 0.05 * (stretch - 1)})
    assert rubber(path, **UNIAXIAL)[0] == pytest.approx(stretch, rel=1e-4)


def test_signs_of_compression_are_asked_or_follow_words(tmp_path):
    shown = np.linspace(1, 0.5, 60)
    for title, extension in (("", -1), ("Compression test\n\n", 1)):
        path = table(tmp_path, Travel__mm=extension * (1 - shown) * 25, Load__N=-gent(shown) * 12)
        path.write_text(title + path.read_text())
        if title:
            assert rubber(path, **GEOMETRY)[0] == pytest.approx(shown, rel=1e-4)
        else:
            (missing,) = read_tests(path, **GEOMETRY).missing
            assert "against their strains, which are of compression" in missing


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"AVE2 (%)": 100 * (RAMP - 1)}, "'AVE2' in %: not understood"),
        ({"Crosshead absolute (mm)": RAMP * 25 - 800}, "is a position, and is not used"),
    ],
)
def test_columns_that_are_not_used_are_named(tmp_path, columns, said):
    more = {"Standard travel (mm)": (RAMP - 1) * 25, "Load (N)": gent(RAMP) * 12}
    assert said in rubber(table(tmp_path, **more, **columns), **GEOMETRY)[2]


def test_strains_in_per_cent_without_a_unit_are_a_warning(tmp_path):
    few = RAMP[:5]
    path = table(tmp_path, Strain=100 * (few - 1), **{"Stress (MPa)": gent(few)})
    assert "not in per cent (--unit strain=%)" in rubber(path, **UNIAXIAL)[2]


def test_what_is_missing_comes_before_what_is_not_needed(tmp_path):
    path = table(tmp_path, **{"Siła (N)": gent(RAMP) * 12, "Droga (mm)": (RAMP - 1) * 25})
    (missing,) = read_tests(path, **GEOMETRY).missing
    assert missing.endswith(": --column extension=2 --column force=1")


def test_other_measures_of_stress_are_not_taken_as_nominal(tmp_path):
    path = table(tmp_path, stretch=RAMP, **{"2nd Piola-Kirchhoff stress (MPa)": gent(RAMP) / RAMP})
    assert "'2nd Piola-Kirchhoff stress': neither" in read_tests(path, **UNIAXIAL).missing[0]


def test_a_file_that_is_given_twice_and_what_no_rubber_bears_are_said(tmp_path):
    path = machine(tmp_path, RAMP, gent(RAMP))
    said = read_tests(path, path, **GEOMETRY).assumed
    assert "test.csv has the same rows as test.csv, and counts twice" in said
    wrong = GEOMETRY | {"gauge_length": "2.5 mm", "area": "0.12 mm2"}
    said = " ".join(read_tests(path, **wrong).assumed)
    assert "correct the unit or length" in said
    assert "correct unit or area" in said


def test_wrong_facts_are_refused_with_the_name_of_the_file(tmp_path):
    path = machine(tmp_path, RAMP, gent(RAMP))
    for wrong in ({"mode": "shear"}, {"gauge_length": "25"}):
        with raising(r"test\.csv: "):
            read_tests(path, **GEOMETRY | wrong)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("mode,stretch,nominal_stress\nUniaxial,1.5,1\n,2,2\n", "line 3: unknown mode ''"),
        ("mode,stretch,nominal_stress,weight\nuniaxial,1.5,1,2\nuniaxial,2,2,\n", "no weight"),
    ],
)
def test_rows_without_a_mode_or_a_weight_are_refused(tmp_path, text, said):
    path = tmp_path / "test.csv"
    path.write_text(text)
    with raising(said):
        pds.load_test_data(path)
