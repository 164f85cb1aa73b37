"""Studies: designs, bad input, runs in parallel that fail or are killed, and their table."""

import csv
import json
import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from commands import commanded
from meshes import write_plate
from refusals import raising, refused, saying
from scipy import stats

import pdsurrogate as pds
from pdsurrogate.results.folder import FolderTaken
from pdsurrogate.scenes import SceneError
from pdsurrogate.studies.description import load_study, parameters_of_runs
from pdsurrogate.studies.runs import tasks_of
from pdsurrogate.studies.table import (
    KEYS_OF_CRACKS,
    KEYS_OF_FITS,
    KEYS_OF_LEVELS,
    KEYS_OF_RUNS,
    quantities_in,
    study_figure,
)
from pdsurrogate.studies.workers import Workers

TINY = {"scene": "uniaxial", "force": "analytic", "set": {"stretches": 1.2, "spacing": 0.5}}
"""Two rows of six points: a run takes some hundredths of a second."""


def runs_of(**description):
    return parameters_of_runs(load_study({**TINY, **description})[0])


def test_a_grid_has_every_value_with_every_other_in_order():
    runs = runs_of(
        parameters={"spacing": [0.1, 0.2], "material": {"shear_modulus": [1, 2, 3]}}, set={}
    )
    assert [tuple(run.values()) for run in runs] == [
        (0.1, 1),
        (0.1, 2),
        (0.1, 3),
        (0.2, 1),
        (0.2, 2),
        (0.2, 3),
    ]
    assert list(runs[0]) == ["spacing", "material.shear_modulus"]


def test_lists_are_zipped():
    runs = runs_of(parameters={"a": range(3), "b": np.array([0.5, 1.0, 1.5])}, design="zip")
    assert [tuple(run.values()) for run in runs] == [(0, 0.5), (1, 1.0), (2, 1.5)]


def test_a_latin_hypercube_has_one_sample_in_every_stratum_of_every_parameter():
    given = {
        "a": {"distribution": "uniform", "loc": 2.0, "scale": 4.0},
        "b": {"distribution": "lognorm", "s": 0.3, "scale": 100.0},
        "c": ["x", "y"],
        "d": {"distribution": "randint", "low": 3, "high": 7},
    }
    runs = runs_of(parameters=given, design="latin-hypercube", samples=40, seed=3)
    strata = [
        np.floor(40 * stats.uniform(2, 4).cdf([run["a"] for run in runs])),
        np.floor(40 * stats.lognorm(0.3, scale=100).cdf([run["b"] for run in runs])),
    ]
    for found in strata:
        assert sorted(found) == list(range(40))
    assert [sum(run["c"] == entry for run in runs) for entry in "xy"] == [20, 20]
    assert [sum(run["d"] == number for run in runs) for number in range(3, 7)] == [10, 10, 10, 10]
    assert all(type(run["d"]) is int and type(run["a"]) is float for run in runs)
    assert runs == runs_of(parameters=given, design="latin-hypercube", samples=40, seed=3)
    assert runs != runs_of(parameters=given, design="latin-hypercube", samples=40, seed=4)


def test_random_samples_follow_their_distribution():
    runs = runs_of(
        parameters={"a": {"distribution": "norm", "loc": 1.0, "scale": 0.1}},
        design="random",
        samples=500,
    )
    assert stats.kstest([run["a"] for run in runs], stats.norm(1, 0.1).cdf).pvalue > 0.01


@refused("studies")
def test_bad_input_is_told_before_anything_is_run(changes, without, message, tmp_path):
    description = {**TINY, "parameters": {"material.shear_modulus": [1.0]}, **changes}
    for key in without:
        del description[key]
    with saying(message, pds.SceneError):
        pds.study(description, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_grid_of_too_many_runs_is_refused(tmp_path):
    many = {name: list(range(400)) for name in "ab"}
    with raising("the grid has 160000 runs, more than the limit 100000", pds.SceneError):
        pds.study({**TINY, "parameters": many}, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (None, [], "cannot read study file"),
        ("scene = ", [], "not valid TOML"),
        (
            'scene = "uniaxial"\nparameters = {spcing = [1]}',
            [],
            "study.toml: run 1 of 1 (spcing=1): scene uniaxial: spcing: unknown key",
        ),
        (
            'scene = "uniaxial"\nparameters = {spacing = [0.5]}',
            "--jobs 2 --scheduler tcp://localhost:1",
            "jobs: with a scheduler",
        ),
    ],
)
def test_bad_input_is_one_line_and_status_2(text, options, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if text is not None:
        Path("study.toml").write_text(text)
    done = commanded("study study.toml", options, status=2)
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_one_failed_run_does_not_end_the_others(tmp_path):
    description = {
        **TINY,
        "set": {"stretches": 1.2},
        "parameters": {"spacing": [0.5, 5.0], "solver.most_evaluations": [1, 50]},
    }
    done = pds.study(description, tmp_path, jobs=1)
    failures = [row["failure"] for row in done.rows]
    assert failures[1] is None
    assert "solver.most_evaluations" in failures[0]
    assert "larger than the body" in failures[2]
    assert "larger than the body" in failures[3]
    assert [row.get("converged") for row in done.rows] == [False, True, None, None]
    rows = list(csv.DictReader((tmp_path / "study.csv").read_text().splitlines()))
    assert [row["failure"] for row in rows] == [failure or "" for failure in failures]
    assert rows[1]["converged"] == "true"
    assert rows[3]["converged"] == ""
    # Those that failed by themselves would fail again.
    written = (tmp_path / "runs" / done.rows[2]["run"] / "outcome.json").stat().st_mtime_ns
    pds.study(description, tmp_path, jobs=1)
    assert (tmp_path / "runs" / done.rows[2]["run"] / "outcome.json").stat().st_mtime_ns == written


def test_a_table_has_derivatives_by_the_parameters_that_have_them(tmp_path):
    """Those of the stress are differences of the rows beside, up to 0.01^2/6 of the third
    derivative over the first, some 4.5.
    """
    described = {
        **TINY,
        "set": {"spacing": 0.5, "solver.tolerance": 1e-9, "precision": "float64"},
        "quantities": "nominal_stress",
    }
    described["parameters"] = {
        "stretches": [1.19, 1.2, 1.21],
        "material.shear_modulus": [1.0, 1.01],
        "correction": ["none", "tensor"],
    }
    without = pds.study(described, tmp_path / "out", jobs=1)
    assert not any(key.startswith("d ") for row in without.rows for key in row)
    times = {
        file: file.stat().st_mtime_ns for file in (tmp_path / "out" / "runs").glob("*/summary.json")
    }
    done = pds.study({**described, "derivatives": ["nominal_stress"]}, tmp_path / "out", jobs=1)
    assert not done.failures
    assert {file: file.stat().st_mtime_ns for file in times} == times  # nothing was simulated again
    by_stretch, by_modulus = (
        "d nominal_stress / d stretches",
        "d nominal_stress / d material.shear_modulus",
    )
    for correction in ("none", "tensor"):
        rows = {
            (row["stretches"], row["material.shear_modulus"]): row
            for row in done.rows
            if row["correction"] == correction
        }
        stress = {key: row["nominal_stress"] for key, row in rows.items()}
        assert rows[1.2, 1.0][by_stretch] == pytest.approx(
            (stress[1.21, 1.0] - stress[1.19, 1.0]) / 0.02, rel=1e-3
        )
        middle = (rows[1.2, 1.0][by_modulus] + rows[1.2, 1.01][by_modulus]) / 2
        assert middle == pytest.approx((stress[1.2, 1.01] - stress[1.2, 1.0]) / 0.01, rel=1e-3)
    assert done.figure() is not None


def test_a_run_without_derivatives_says_why_and_keeps_its_quantities(tmp_path):
    """A learned force holds for one chain limit, so that it has no derivative by this."""
    described = {
        **TINY,
        "force": "gent",
        "derivatives": ["nominal_stress"],
        "set": {**TINY["set"], "material.law": "gent"},
    }
    described["parameters"] = {
        "material.chain_limit": [pds.load_surrogate("gent").shape["chain_limit"]]
    }
    (row,) = pds.study(described, tmp_path / "out", jobs=1).failures
    assert row["failure"].startswith("derivatives: ")
    assert "chain_limit" in row["failure"]
    assert row["nominal_stress"] > 0


def test_a_study_with_more_runs_does_those_that_are_new(tmp_path):
    first = pds.study(
        {**TINY, "parameters": {"material.shear_modulus": [1.0, 2.0]}}, tmp_path, jobs=1
    )
    outcomes = {path: path.stat().st_mtime_ns for path in tmp_path.glob("runs/*/outcome.json")}
    more = pds.study(
        {
            **TINY,
            "parameters": {"material.shear_modulus": [3.0, 2.0, 1.0, 2.0]},
            "quantities": ["nominal_stress"],
        },
        tmp_path,
        jobs=1,
    )
    assert len(list(tmp_path.glob("runs/*"))) == 3
    assert all(path.stat().st_mtime_ns == written for path, written in outcomes.items())
    assert more.rows[1]["nominal_stress"] == first.rows[1]["nominal_stress"]
    assert more.rows[1] == more.rows[3]
    # Neo-Hookean stresses are proportional to the shear modulus up to K/mu, which the last digits
    # see.
    assert [row["nominal_stress"] for row in more.rows] == pytest.approx(
        [1.4982, 1.0029, 0.5035, 1.0029], abs=2e-3
    )
    assert list(more.rows[0]) == ["run", "material.shear_modulus", "nominal_stress", "failure"]


def test_quantities_that_no_run_has_are_told(tmp_path):
    given = {
        "parameters": {"material.shear_modulus": [1.0]},
        "quantities": ["forces.rigth", "n_points"],
    }
    done = pds.study({**TINY, **given}, tmp_path, jobs=1)
    assert done.cautions() == ["quantities: no run has 'forces.rigth'"]
    assert done.rows[0]["n_points"] == 12


SHORT_TEAR = {
    "spacing": 0.25,
    "stretches": [1.1],
    "body.size": [4.0, 3.0],
    "precuts": [{"start": [0.0, 1.5], "end": [1.5, 1.5]}],
}
SHORT_TEAR |= {
    "fracture.critical_stretch": 1.2,
    "dynamics": {"stretch": 1.15, "outputs": 1, "stretch_rate": 40.0, "density": 1e-6},
}


@pytest.mark.parametrize(
    ("scene", "changes"),
    [
        ("uniaxial", {"spacing": 0.5, "stretches": 1.2}),
        ("hanging", {"spacing": 0.25, "steps": [0.1]}),
        ("tear", SHORT_TEAR),
    ],
)
def test_a_run_has_no_quantities_that_are_not_known_before(scene, changes):
    summary = pds.simulate(
        pds.load_scene(scene, changes), "analytic" if scene == "tear" else "bond-energy"
    ).summary
    assert set(summary) <= set(KEYS_OF_RUNS)
    assert {key for level in summary["levels"] for key in level} <= set(KEYS_OF_LEVELS)
    assert set(summary.get("crack", KEYS_OF_CRACKS)) == set(KEYS_OF_CRACKS)


def test_repeated_runs_have_a_table_of_means(tmp_path):
    """By hand: means and sample deviations over the moduli, for each spacing; the stress is
    proportional to the modulus.
    """
    parameters = {"spacing": [0.5, 0.25], "material.shear_modulus": [1.0, 2.0, 6.0]}
    done = pds.study(
        {
            **TINY,
            "set": {"stretches": 1.2},
            "parameters": parameters,
            "mean_over": "material.shear_modulus",
        },
        tmp_path,
        jobs=1,
    )
    stresses = np.reshape([row["nominal_stress"] for row in done.rows], (2, 3))
    means = done.means()
    assert [(row["spacing"], row["runs"]) for row in means] == [(0.5, 3), (0.25, 3)]
    np.testing.assert_allclose(
        [row["nominal_stress.mean"] for row in means], stresses.sum(axis=1) / 3, rtol=1e-12
    )
    expected = np.sqrt(((stresses - stresses.mean(axis=1, keepdims=True)) ** 2).sum(axis=1) / 2)
    np.testing.assert_allclose(
        [row["nominal_stress.deviation"] for row in means], expected, rtol=1e-12
    )
    assert "material.shear_modulus.mean" not in means[0]
    with (tmp_path / "study-means.csv").open() as file:
        assert [float(row["nominal_stress.mean"]) for row in csv.DictReader(file)] == [
            row["nominal_stress.mean"] for row in means
        ]


def test_seeds_are_repetitions_and_failed_runs_are_not_in_the_mean():
    study = pds.Study(
        scene="tear", parameters={"body.seed": [1, 2, 3, 4], "force": ["neo-hookean"]}
    )
    rows = [
        {
            "run": str(seed),
            "body.seed": seed,
            "force": "neo-hookean",
            "peak": 2.0 * seed,
            "failure": None,
        }
        for seed in (1, 2, 3)
    ]
    rows[0] |= {"crack.path.stray": 0.1}  # the others have no path
    rows += [{"run": "4", "body.seed": 4, "force": "neo-hookean", "peak": 100.0, "failure": "lost"}]
    (caution,) = pds.studies.StudyResult(study, Path(), rows).cautions()
    assert "peaks of the 1 runs (first 4) that failed are lower bounds" in caution
    found = pds.studies.StudyResult(study, Path(), rows).means()
    assert found == [{"force": "neo-hookean", "runs": 3, "peak.mean": 4.0, "peak.deviation": 2.0}]
    assert (
        pds.studies.StudyResult(
            pds.Study(scene="tear", parameters={"spacing": [0.1]}), Path(), rows[:1]
        ).means()
        == []
    )
    with raising(r"mean_over: 'body.seed' is not one of the parameters", SceneError):
        pds.Study(scene="tear", parameters={"spacing": [0.1]}, mean_over=["body.seed"])


def test_a_table_that_no_study_wrote_is_not_replaced(tmp_path):
    (tmp_path / "study.csv").write_text("mine")
    with raising("was not written by a study", FolderTaken):
        pds.study({**TINY, "parameters": {"spacing": [0.5]}, "set": {}}, tmp_path)
    assert (tmp_path / "study.csv").read_text() == "mine"


def test_quantities_by_dotted_keys_of_the_summary_or_its_last_level():
    level = {
        "t": 1.0,
        "forces": {"left": [1.0, 2.0], "top": [3.0, 4.0]},
        "probes": {"a": {"displacement": [5.0], "F": [[1.0]]}},
    }
    summary = {"converged": True, "crack": None, "levels": [{"t": 0.5}, level]}
    assert quantities_in(
        summary,
        ["converged", "forces.top", "probes.*.displacement", "levels.0.t", "nothing", "crack.x"],
    ) == {
        "converged": True,
        "forces.top.0": 3.0,
        "forces.top.1": 4.0,
        "probes.a.displacement.0": 5.0,
        "levels.0.t": 0.5,
    }


def test_a_run_is_told_by_what_its_mesh_holds_and_not_by_where_it_lies(tmp_path):
    digests = []
    for place, count in (("a", 12), ("b", 12), ("a", 16)):
        file = tmp_path / place / "plate.msh"
        file.parent.mkdir(exist_ok=True)
        write_plate(file, count)
        study, _, home = load_study(
            {**TINY, "parameters": {"body": [{"shape": "mesh", "file": str(file)}]}}
        )
        digests.append(tasks_of(study, home, parameters_of_runs(study), math.inf)[0].digest)
    assert digests[0] == digests[1] != digests[2]


def test_a_study_of_fits_has_their_scores(tmp_path):
    description = {
        "fit": {"samples": 300, "folds": 2, "greatest": 1.5, "least": 0.8},
        "parameters": {"degree": [4, "5,3"], "material": ["neo-hookean", "granite"][:1]},
    }
    done = pds.study(description, tmp_path, jobs=1)
    assert [row["failure"] for row in done.rows] == [None, None]
    for row in done.rows:
        place = tmp_path / "runs" / row["run"] / "fitted" / "1"
        assert pds.load_card(place).errors["box"]["on_surface"]["rms"] == row["on_surface.rms"]
        assert row["on_surface.rms"] < row["cross_validated_rms"] * 3
        assert set(
            json.loads((tmp_path / "runs" / row["run"] / "summary.json").read_text())
        ) <= set(KEYS_OF_FITS)
    assert pds.simulate(
        pds.load_scene("uniaxial", {"spacing": 0.5, "stretches": 1.1}), place
    ).summary["converged"]


@dataclass(frozen=True)
class Ended:
    """A task that ends its process, in so many of its lives."""

    digest: str
    times: int

    def carry_out(self, folder, threads, max_time):
        lives = len(list(folder.glob("life-*")))
        (folder / f"life-{lives}").touch()
        if lives < self.times:
            os.kill(os.getpid(), signal.SIGKILL)
        return None


@pytest.mark.slow  # workers are started three times
def test_a_run_that_loses_its_process_fails_and_the_others_go_on(tmp_path):
    tasks = {
        f"run-{number}": Ended(str(number), times) for number, times in enumerate([0, 1, 9, 0, 0])
    }
    outcomes = dict(Workers(2, 1).carry_out(tasks, tmp_path))
    assert sorted(outcomes) == sorted(tasks)
    assert outcomes["run-2"].startswith("a process was killed")
    assert len(list((tmp_path / "run-2").glob("life-*"))) == 1
    # A run that was under way beside one that ended its process is lost with it; which ones is up
    # to the scheduler.
    others = [failure for place, failure in outcomes.items() if place != "run-2"]
    assert None in others
    assert all(failure is None or failure.startswith("a process was killed") for failure in others)


STUDY = """
scene = "uniaxial"
force = "analytic"
set.stretches = 1.2

[parameters]
spacing = [0.5, 0.05]
material.shear_modulus = [1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7]
"""


def outcomes_in(folder):
    return {path: path.stat().st_mtime_ns for path in folder.glob("runs/*/outcome.json")}


def begin(file, folder):
    command = [
        sys.executable,
        "-m",
        "pdsurrogate",
        "study",
        str(file),
        "--out",
        str(folder),
        "--jobs",
        "2",
    ]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )


def wait_for(number, folder, process):
    until = time.monotonic() + 600
    while len(outcomes_in(folder)) < number:
        assert process.poll() is None, process.communicate()[0]
        assert time.monotonic() < until
        time.sleep(0.02)


@pytest.mark.slow  # workers are started
@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_a_study_that_is_killed_half_way_and_started_again_does_the_rest_only(tmp_path):
    file, folder = tmp_path / "study.toml", tmp_path / "out"
    file.write_text(STUDY)
    process = begin(file, folder)
    wait_for(4, folder, process)
    process.kill()  # the study alone: its workers notice
    process.communicate(timeout=120)
    reached = outcomes_in(folder)
    assert len(reached) < 16
    done = pds.study(file, folder, jobs=1)
    assert [row["failure"] for row in done.rows] == [None] * 16
    final = outcomes_in(folder)
    assert len(final) == 16
    assert all(final[path] == written for path, written in reached.items())
    assert not list(folder.glob("runs/*/.pdsurrogate-run"))
    direct = pds.simulate(
        pds.load_scene(
            "uniaxial", {"stretches": 1.2, "spacing": 0.05, "material.shear_modulus": 1.7}
        ),
        "analytic",
    )
    assert done.rows[-1]["nominal_stress"] == direct.levels[-1]["nominal_stress"]


@pytest.mark.slow  # workers are started
@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_keeps_what_was_reached(tmp_path):
    file, folder = tmp_path / "study.toml", tmp_path / "out"
    # eight runs of 7,500 points outlast the signal on a loaded machine
    file.write_text(STUDY.replace("0.05", "0.02"))
    process = begin(file, folder)
    wait_for(4, folder, process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does, to all processes of the study
    told = process.communicate(timeout=120)[0]
    assert process.returncode == 130, told
    assert "repeat the command to run them" in told
    assert "Traceback" not in told
    reached = outcomes_in(folder)
    table = list(csv.DictReader((folder / "study.csv").read_text().splitlines()))
    assert len(table) == 16
    assert sum(row["failure"] == "" for row in table) == len(reached) < 16
    assert {row["failure"] for row in table} == {"", "not done yet"}


@pytest.mark.slow  # starts workers of two makes
def test_the_table_is_the_same_by_joblib_and_by_dask(tmp_path):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    description = {
        **TINY,
        "parameters": {"material.shear_modulus": [1.0, 2.0], "solver.most_evaluations": [1, 50]},
    }
    with distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster:
        by_dask = pds.study(description, tmp_path / "dask", scheduler=cluster.scheduler_address)
    by_joblib = pds.study(description, tmp_path / "joblib", jobs=2)

    def without_seconds(folder):
        return [
            {key: value for key, value in row.items() if key != "seconds_total"}
            for row in csv.DictReader((folder / "study.csv").read_text().splitlines())
        ]

    assert without_seconds(by_dask.folder) == without_seconds(by_joblib.folder)
    assert sum(row["failure"] is None for row in by_dask.rows) == 2
    assert (by_dask.folder / "study.png").exists()


def test_dask_is_asked_for_before_any_work(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)  # as where it is not installed
    with raising(
        r'^scheduler: Dask is not installed; pip install "pdsurrogate\[dask\]"$', pds.SceneError
    ):
        pds.study(
            {**TINY, "parameters": {"material.shear_modulus": [1.0]}},
            tmp_path / "new",
            scheduler="tcp://127.0.0.1:1",
        )
    assert not (tmp_path / "new").exists()


@pytest.mark.slow  # waits for the answer
def test_a_scheduler_that_does_not_answer_is_told(tmp_path):
    pytest.importorskip("distributed", reason="Dask is not installed")
    with raising("no Dask scheduler answers at tcp:", pds.SceneError):
        pds.study(
            {**TINY, "parameters": {"spacing": [0.5]}, "set": {}},
            tmp_path,
            scheduler="tcp://127.0.0.1:1",
        )


def test_the_table_of_another_study_is_not_replaced_unasked(tmp_path):
    """A study with other runs took the place of the table in its folder without a word."""
    pds.study({**TINY, "parameters": {"material.shear_modulus": [1.0, 2.0]}}, tmp_path, jobs=1)
    before = (tmp_path / "study.csv").read_text()
    other = {**TINY, "parameters": {"material.shear_modulus": [1.0, 3.0]}}
    told = "1 runs that are not in this study; use another folder, or --overwrite"
    with raising(told, FolderTaken):
        pds.study(other, tmp_path, jobs=1)
    assert (tmp_path / "study.csv").read_text() == before
    assert len(pds.study(other, tmp_path, jobs=1, overwrite=True).rows) == 2
    assert len(list(tmp_path.glob("runs/*"))) == 3
    for text in ("{}", "[1]", '{"runs": 3}', "no JSON"):
        (tmp_path / "study.json").write_text(text)
        with raising(told, FolderTaken):
            pds.study(other, tmp_path, jobs=1)


def test_the_figure_names_what_it_draws():
    rows = [
        {"run": "a", "spacing": 0.1, "force": "nosb", "nominal_stress": 1.0},
        {"run": "b", "spacing": 0.2, "force": "analytic", "nominal_stress": 1.1},
    ]
    by_spacing, by_force = study_figure(rows, ["spacing", "force"]).axes
    assert (by_spacing.get_xlabel(), by_spacing.get_ylabel()) == ("spacing", "nominal_stress")
    (points,) = by_force.lines
    assert list(points.get_xdata(orig=True)) == ["nosb", "analytic"]
    np.testing.assert_array_equal(points.get_ydata(), [1.0, 1.1])
    for row, name in zip(rows, ("small", "great"), strict=True):
        row["force"] = f"own-artifacts/a-rubber-of-two-terms/{name}"
    _, by_force = study_figure(rows, ["spacing", "force"]).axes
    (points,) = by_force.lines
    np.testing.assert_array_equal(points.get_xdata(orig=False), [0, 1])
    labels = [label.get_text() for label in by_force.get_xticklabels()]
    assert labels == 2 * ["own-artifacts/a-rubber-o"]
