"""Elastic energies and branches from stresses over time: laws found again, and their refusals."""

import json
import time
import warnings
from dataclasses import replace

import numpy as np
import pytest
from commands import commanded, invoke
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.artifacts.material import with_material
from pdsurrogate.errors import OutsideDomainWarning
from pdsurrogate.identification import (
    HistoryRegressor,
    LawRegressor,
    TestData,
    fitted_laws,
)
from pdsurrogate.identification.examination import examine
from pdsurrogate.identification.history_report import report_of_history
from pdsurrogate.identification.reporting import fitted
from pdsurrogate.materials import Branch, Memory, Softening
from pdsurrogate.materials.histories import LOGS, stress_history

BRANCHES = Branch(0.5, 2.0), Branch(0.3, 40.0)
LAWS = [
    pds.materials.NeoHookean(memory=Memory(BRANCHES)),
    pds.materials.Gent(chain_limit=30.0, memory=Memory(BRANCHES[:1])),
    pds.materials.Yeoh(second=-0.05, third=0.01, memory=Memory(BRANCHES)),
    pds.materials.MooneyRivlin(second_share=0.3, memory=Memory(BRANCHES[1:])),
    pds.materials.ArrudaBoyce(chain_links=4.0, memory=Memory(BRANCHES)),
    pds.materials.FullNetwork(chain_links=9.0, memory=Memory(BRANCHES[:1])),
    pds.materials.Ogden(moduli=(-0.2, 0.3), exponents=(-2.0, 4.0), memory=Memory(BRANCHES)),
]


PATH = [1, 2, 2, 1.1]
SOFTENED = [1, 1.6, 1.1, 1.6, 1.1, 2.2, 1.1]
"""Stretches between which curves run, at a constant rate, or for as long as at this rate by 1."""


def cycles(law, scatter=0.0, rows=80, rates=(0.01, 0.1, 1.0), seed=0, path=PATH):
    """Return a path of stretches in two modes at several rates, with errors."""
    random = np.random.default_rng(seed)
    X, y = [], []
    for mode in ("uniaxial", "equibiaxial"):
        for rate in rates:
            knots = np.arange(len(path)) / rate
            at = np.linspace(0, knots[-1], rows)
            stretch = np.interp(at, knots, path)
            lateral = np.exp(LOGS[mode](np.log(stretch), 0 * at)[1])
            stress = stress_history(law, mode, at, stretch, incompressible=True).nominal_stress
            curve = np.full(rows, len(X))
            X.append(np.stack([stretch, lateral, at, curve], axis=1))
            y.append(stress + scatter * np.abs(stress).max() * random.standard_normal(rows))
    return np.concatenate(X), np.concatenate(y)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_a_law_is_found_again_within_two_standard_errors(law):
    """Of normal errors 5 % exceed two standard errors."""
    memory, regressor = law.memory.branches, LawRegressor(law.name, n_terms=2)
    elastic = [getattr(law, key) for key in regressor.unknowns() if key in law.defaults()]
    elastic = elastic or [*np.abs(law.moduli).tolist(), *law.exponents]
    wanted = [*elastic, *(one.modulus for one in memory), *(one.time for one in memory)]
    off = []
    for seed in range(3):
        found = HistoryRegressor(law.name, len(memory), n_terms=2).fit(
            *cycles(law, 0.01, seed=seed)
        )
        off.append(np.abs((found.parameters_ - wanted) / found.standard_errors_))
    assert (np.array(off) < 2).mean() > 0.85
    assert np.max(off) < 3.5
    glassy = found.law_.shear_modulus + found.law_.memory.modulus
    assert found.law_.bulk_modulus == pytest.approx(1000 * glassy)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
@pytest.mark.parametrize("number", [0, 2])
def test_softening_is_found_again_within_two_standard_errors(law, number):
    law = replace(law, memory=Memory(BRANCHES[:number], Softening(2.0, 0.1, 0.2)))
    off = []
    for seed in range(3):
        data = cycles(law, 0.01, seed=seed, path=SOFTENED, rates=(0.02, 0.5))
        found = HistoryRegressor(law.name, number, n_terms=2, softening=True).fit(*data)
        place = found.parameter_names_.index("softening_r") + np.arange(3)
        off.append((found.parameters_[place] - [2.0, 0.1, 0.2]) / found.standard_errors_[place])
    assert (np.abs(off) < 2).mean() > 0.75
    assert np.abs(off).max() < 3.5
    assert len(found.law_.memory.branches) == number


def test_softening_of_an_energy_without_a_law_and_of_one_stretch():
    law = pds.materials.NeoHookean(memory=Memory((), Softening(3.0, 0.2)))
    X, y = (one[:80] for one in cycles(law, 0.003, path=[1, 2, 1.1, 2, 1.2], rates=(1.0,)))
    found = HistoryRegressor(branches=0, softening=True).fit(X * [1, 1, 0, 1], y)
    r, m = found.parameters_[-2:]
    assert found.parameter_names_[-2:] == ["softening_r", "softening_m"]
    assert (r, m) == pytest.approx((3.0, 0.2), rel=0.05)
    assert found.rates_ is None
    exact = cycles(law, path=[1, 2, 1.1, 2, 1.2], rates=(1.0,))[1][:80]
    assert found.predict(X) == pytest.approx(exact, abs=0.01 * exact.max())
    with raising("no curve unloads"):
        HistoryRegressor(softening=True).fit(*cycles(law, path=[1, 2, 2], rates=(1.0,)))


@pytest.mark.parametrize("law", [LAWS[0], pytest.param(LAWS[-1], marks=pytest.mark.slow)])
def test_the_number_of_branches_is_chosen(law):
    """A choice may take a branch for an error."""
    fits = [HistoryRegressor(law.name, n_terms=3).fit(*cycles(law, 0.01, seed=s)) for s in range(3)]
    numbers = [len(found.law_.memory.branches) for found in fits]
    assert numbers.count(len(law.memory.branches)) >= 2


def test_a_viscosity_is_not_chosen_as_a_branch():
    """Its modulus, which is not told from its time, would be that of fast motions."""
    law = pds.materials.NeoHookean(memory=Memory((*BRANCHES, Branch(30.0, 0.001))))
    found = HistoryRegressor("neo-hookean").fit(*cycles(law, 0.002))
    assert [one.time > 1.0 for one in found.law_.memory.branches] == [True, True]


def test_every_law_is_among_those_that_are_found_again():
    assert {law.name for law in LAWS} == {*fitted_laws()}


def test_exact_stresses_give_the_law_and_no_further_branch():
    law = LAWS[0]
    X, y = cycles(law)
    found = HistoryRegressor("neo-hookean", branches=3).fit(X, y)
    assert found.parameters_ == pytest.approx([1.0, 0.5, 0.3, 2.0, 40.0], rel=1e-5)
    assert found.predict(X) == pytest.approx(y, abs=1e-6)
    assert found.rates_ == pytest.approx((0.01 * 1.9 / 3, 0.9), rel=0.02)


def test_rates_that_were_not_measured_are_said():
    law = LAWS[0]
    found = HistoryRegressor("neo-hookean", 2).fit(*cycles(law, 0.01, rates=(0.05, 0.1, 0.2)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found.predict(cycles(law, rates=(0.04, 0.1, 0.25))[0])
    for rate, words in (
        (2.0, "up to 1.8, where those of the tests end at 0.18"),
        (0.005, "down to"),
    ):
        with pytest.warns(OutsideDomainWarning, match=words):
            found.predict(cycles(law, rates=(rate,))[0])


def test_an_energy_without_a_law_predicts_a_rate_that_is_left_out():
    X, y = cycles(LAWS[0], 0.01)
    known = X[:, 3] % 3 != 1
    found = HistoryRegressor().fit(X[known], y[known])
    exact = cycles(LAWS[0])[1]
    assert np.abs(found.predict(X[~known]) - exact[~known]).max() < 0.02 * exact[~known].max()
    assert found.domain_hull()


def test_rows_without_weight_are_part_of_histories_alone():
    X, y = cycles(LAWS[0])
    weight = np.tile([1.0, 0.0], len(y) // 2)
    found = HistoryRegressor("neo-hookean", 2).fit(X, np.where(weight, y, 2 * y), weight)
    assert found.parameters_ == pytest.approx([1.0, 0.5, 0.3, 2.0, 40.0], rel=1e-4)


def test_elastic_stresses_have_no_branches():
    law = pds.materials.NeoHookean()
    found = HistoryRegressor("neo-hookean").fit(*cycles(law, 0.01))
    assert not found.law_.memory


def test_what_cannot_be_fitted_is_refused():
    X, y = cycles(LAWS[0])
    for changed, words in (
        (X[:, :3], "four columns"),
        (X * [1, 1, 0, 1], "no time passes"),
        (X * [1, 1, -1, 1], "must not decrease"),
        (X * [-1, 1, 1, 1], "positive"),
    ):
        with raising(words):
            HistoryRegressor("neo-hookean").fit(changed, y)
    fluid = cycles(pds.materials.NeoHookean(1e-12, 1.0, memory=Memory(BRANCHES[:1])))
    with raising("would flow"):
        HistoryRegressor("neo-hookean").fit(*fluid)


def table(path, heading, columns):
    """Write a table of a cycle of one specimen or more."""
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=heading, comments="")
    return path


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    X, y = cycles(LAWS[0], 0.002)
    one = X[:, 3] < 3
    columns = X[one, 3] + 1, X[one, 2], X[one, 0], y[one]
    path = tmp_path_factory.mktemp("cycles") / "cycles.csv"
    return table(path, "specimen,time (s),stretch,nominal stress (MPa)", columns)


def test_a_file_with_times_is_taken_whole(file):
    assert len(pds.load_test_data(file, mode="uniaxial")) < 120
    data = pds.load_test_data(file, history=True, mode="uniaxial")
    assert len(data) == 240
    assert data.histories()[:, 3].max() == 2
    assert (data.weight == 1).all()
    model = fitted(data, "neo-hookean", 3, {}, branches=None)
    report = report_of_history(model, data)
    assert [round(one["greatest_stretch"], 1) for one in report["curves"]] == [2.0] * 3
    assert max(one["relative_rms"] for one in report["curves"]) < 0.004
    assert not report["refusals"]
    assert data.where(data.curve == 1).time.max() == pytest.approx(30, rel=0.01)


def test_a_rate_stands_for_times(tmp_path):
    stretch = np.r_[np.linspace(1, 2, 30), np.linspace(2, 1.2, 30)[1:]]
    path = table(tmp_path / "a.csv", "stretch,nominal stress (MPa)", (stretch, stretch - 1))
    data = pds.load_test_data(path, history=True, mode="uniaxial", rate="0.1", zero="keep")
    assert data.time[-1] == pytest.approx(18)
    plain = pds.load_test_data(path, history=True, mode="uniaxial", zero="keep")
    with raising("has no time"):
        plain.histories()
    with raising("rate must be a positive number"):
        pds.load_test_data(path, mode="uniaxial", rate="-1")


def test_bad_rows_are_named_as_in_tests_without_times():
    X, y = cycles(LAWS[0], 0.002)
    mode = np.where(X[:, 3] < 3, "uniaxial", "equibiaxial")
    data = TestData("cycles", mode, X[:, :2], y, np.ones(len(y)), time=X[:, 2], curve=X[:, 3])
    regressor = HistoryRegressor("neo-hookean", 2)
    found = examine(regressor.fit_tests(data), data)
    assert not found.refusals
    assert not found.remarks
    psi = replace(data, nominal_stress=np.where(mode == "uniaxial", 145 * y, y))
    assert "check their unit" in examine(regressor.fit_tests(psi), psi).remarks[0]
    y = y.copy()
    y[20] *= -1
    wrong = replace(data, nominal_stress=y)
    with raising("tension is positive"):
        pds.fit_to_tests(regressor, wrong)


@pytest.mark.slow
@pytest.mark.parametrize("law", [None, "ogden", "full-network"])
def test_two_thousand_rows_take_less_than_five_seconds(law):
    """With softening if there is a law."""
    rubber = replace(LAWS[0], memory=Memory(BRANCHES, law and Softening(2.0, 0.1, 0.2)))
    X, y = cycles(rubber, 0.01, rows=334, path=SOFTENED if law else PATH)
    began = time.process_time()
    HistoryRegressor(law or "energy", softening=bool(law)).fit(X, y)
    assert time.process_time() - began < 5


def test_a_start_may_leave_out_terms_of_a_law():
    """Neo-Hookean rubber that softens, by three terms of Ogden's law."""
    rubber = replace(LAWS[0], memory=Memory((), Softening(2.0, 0.1, 0.2)))
    X, y = cycles(rubber, 0.01, rows=40, path=SOFTENED)
    found = HistoryRegressor("ogden", 0, softening=True).fit(X, y)
    assert np.abs(found.predict(X) - y).max() < 0.05 * np.abs(y).max()


def test_the_command_reports_branches_and_refuses_what_does_not_go_with_them(file):
    told = [file, "--mode", "uniaxial", "--law", "neo-hookean", "--branches"]
    done = commanded("identify", told, "auto --json")
    found = json.loads(done.stdout)["laws"][0]
    assert [one["time"] for one in found["law"]["branches"]] == pytest.approx([2, 40], rel=0.1)
    assert found["rates"] == pytest.approx([0.01 * 1.9 / 3, 0.9], rel=0.02)
    for wrong, words in (
        (["some"], "auto, or a number"),
        (["1", "--hold-out"], "do not go"),
        (["1", "--terms", 2], "needs --law ogden"),
    ):
        done = invoke("identify", told, wrong)
        assert done.exit_code
        assert words in " ".join(done.output.split())


def test_the_command_fits_softening_without_times(tmp_path):
    law = pds.materials.NeoHookean(memory=Memory((), Softening(3.0, 0.2)))
    X, y = (one[:80] for one in cycles(law, 0.003, path=[1, 2, 1.1, 2, 1.2], rates=(1.0,)))
    file = table(tmp_path / "a.csv", "stretch,nominal stress (MPa)", (X[:, 0], y))
    told = [file, "--mode", "uniaxial", "--law", "neo-hookean", "--softening", "--json"]
    done = commanded("identify", told)
    found = json.loads(done.stdout)["laws"][0]
    assert found["form"] == "neo-hookean with softening"
    assert found["law"]["softening"]["r"] == pytest.approx(3.0, rel=0.05)
    assert found["rates"] is None
    assert "beta of softening is not told from m" in found["remarks"][0]
    assert len(found["remarks"]) == 1


@pytest.mark.slow
def test_an_artifact_gives_its_branches_to_a_scene(file, tmp_path):
    told = ["--mode uniaxial --branches 2 --samples 2000 --out", tmp_path]
    commanded("fit relaxing --data", file, told)
    scene = pds.load_scene("uniaxial", {"plane": "strain", "reference": None})
    minutes = scene.model_copy(update={"units": scene.units.model_copy(update={"time": "min"})})
    for given, minute in ((scene, 1), (minutes, 60)):
        found, model = with_material(given, tmp_path / "relaxing" / "1")
        times = [one.time * minute for one in found.law().memory.branches]
        assert times == pytest.approx([2, 40], rel=0.1)
        assert model.domain.rates == pytest.approx([0.01 * 1.9 / 3, 0.9], rel=0.02)
    timed = {"stretches": [1.2, 1.5], "times": [2.0, 5.0]}
    with warnings.catch_warnings():
        warnings.simplefilter("error", OutsideDomainWarning)
        sheet = pds.load_scene("uniaxial", timed, spacing=0.25)
        with pytest.warns(UserWarning, match="the exact energy of its material is used"):
            found, model = with_material(sheet, tmp_path / "relaxing" / "1")
    assert found.reference is None  # of elastic sheets
    levels = pds.simulate(found, model).levels
    knots = [0.0, 2.0, 5.0], [1.0, 1.2, 1.5]
    at = np.linspace(0, 5, 501)
    expected = stress_history(found.law(), "uniaxial", at, np.interp(at, *knots))
    for level, row in zip(levels, (200, 500), strict=True):
        assert level["nominal_stress"] == pytest.approx(expected.nominal_stress[row], rel=0.01)
    for times, words in (
        ([0.01, 5.0], "up to 20"),
        ([0.0, 5.0], "up to inf"),
        ([500, 999], "down"),
    ):
        slow = pds.load_scene("uniaxial", timed | {"times": times})
        with pytest.warns(OutsideDomainWarning, match=words):
            with_material(slow, tmp_path / "relaxing" / "1")


FALLING = Branch(0.8, 40.0, ((0.1, 40.0), (2.0, 0.2)))
"""Time that falls by a power of 1.77 of the overstress."""


def test_times_that_fall_with_the_overstress_are_learned_from_cycles():
    """Rates that are kept back, one of them faster than all others, are predicted."""
    rubber = replace(LAWS[0], memory=Memory((FALLING,)))
    one_mode = {"rows": 80, "path": [1, 2, 2, 1.1]}
    X, y = cycles(rubber, 0.003, rates=(0.003, 0.03, 0.3), **one_mode)
    constant = HistoryRegressor("neo-hookean", 3).fit(X, y)
    found = HistoryRegressor("neo-hookean", 1, falling_times=True).fit(X, y)
    for rate in (0.1, 0.4):
        kept, stress = cycles(rubber, rates=(rate,), **one_mode)
        off = [np.abs(one.predict(kept) - stress).max() / stress.max() for one in (found, constant)]
        assert off[0] < 0.01
        assert off[1] > 4 * off[0]
    branch = found.law_.memory.branches[0]
    places = np.geomspace(0.2, 0.6, 5)
    times = [[one.time_at(place) for place in places] for one in (branch, FALLING)]
    assert times[0] == pytest.approx(times[1], rel=0.15)
    assert "time_power_2" in found.parameter_names_
    assert np.isfinite(found.standard_errors_).all()


def test_falling_times_need_branches():
    with raising("give branches"):
        HistoryRegressor(branches=0, falling_times=True).fit(*cycles(LAWS[0], rows=20))
