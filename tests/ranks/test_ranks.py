"""Runs on several ranks: who takes part, that they find, say and leave what one process does,
and how they end when something fails.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import scipy
from commands import words_of
from every_model import LONGEST
from force_models import TABLE
from refusals import raising
from several_ranks import HERE, TIMEOUT, Ranks, environment, on_ranks, several

import pdsurrogate as pds
from pdsurrogate.body import grid
from pdsurrogate.ranks import ALONE, NotUnderMPI, bisected, bond_counts, communicator
from pdsurrogate.ranks.share import connected
from pdsurrogate.results.states import StatesInFiles
from pdsurrogate.solvers.stability import PROBES


def summary_of(folder):
    return json.loads((folder / "summary.json").read_text())


@pytest.fixture(scope="module")
def ranks():
    """Three processes, in which cases run on one, two or three ranks."""
    with Ranks(3) as started:
        yield started


# Who takes part.


def test_one_process_is_alone_and_loads_nothing_of_mpi():
    assert communicator() is ALONE
    pds.simulate(pds.load_scene("uniaxial", spacing=0.25, stretches=1.05), "analytic")
    assert "mpi4py" not in sys.modules


@pytest.mark.parametrize("parts", [2, 3, 5, 8])
def test_parts_have_as_many_bonds_and_each_point_once(parts):
    points = grid((0, 0), (3, 2), 0.1)
    points = points[np.linalg.norm(points - [1.0, 1.0], axis=1) > 0.4]
    bonds = bond_counts(points, 0.315)
    part = bisected(points, bonds, parts)
    assert set(part) == set(range(parts))
    of_parts = np.bincount(part, bonds)
    # A cut goes between points: it may be off by one at each of the levels, and one has 30 of some
    # 400 bonds.
    assert of_parts.max() / of_parts.mean() < 1.1


@pytest.mark.parametrize("joined", [0, 60, 150, 1000])
def test_connected_components_are_those_of_scipy(random, joined):
    first, second = random.integers(0, 200, (2, joined))
    graph = scipy.sparse.coo_array((np.ones(joined), (first, second)), shape=(200, 200))
    expected, labels = scipy.sparse.csgraph.connected_components(graph, directed=False)
    count, found = connected(200, first, second)
    assert count == expected
    assert (found == labels).all()
    chain = random.permutation(200)  # the longest way from one end of a component to the other
    assert connected(200, chain[:-1], chain[1:])[0] == 1


def test_bonds_are_counted_with_the_point_itself():
    points = grid((0, 0), (1, 1), 0.1)
    assert bond_counts(points, 0.11).max() == 5
    np.testing.assert_array_equal(bond_counts(points, 0.11, slice(0, 3)), [3, 4, 4])


@several
def test_processes_that_do_not_know_of_each_other_are_refused(ranks, monkeypatch):
    """The launcher tells each of them that there are two, and the command says in one line what
    to start in its place.
    """
    asks = on_ranks(
        2, "-c", "from pdsurrogate.ranks import communicator; communicator()", mpi4py=False
    )
    done = subprocess.run(
        asks, capture_output=True, text=True, timeout=TIMEOUT, env=environment(), check=False
    )
    assert done.returncode != 0
    assert done.stderr.count("2 processes were started, but each") == 2, done.stderr
    (reply,) = ranks(1, "not_under_mpi", "run", "hole")
    assert reply["status"] == 2
    assert "mpiexec -n 2 python -m mpi4py -m pdsurrogate" in reply["err"]


@several
def test_worlds_of_one_rank_each_are_told_in_one_line():
    """The launcher of another MPI starts processes that mpi4py takes for one rank each: every
    one ran the whole scene.
    """
    asks = [sys.executable, "-m", "mpi4py", "-m", "pdsurrogate", "run", "hole"]
    others = environment() | {"OMPI_COMM_WORLD_SIZE": "2"}
    done = subprocess.run(
        asks, capture_output=True, text=True, timeout=TIMEOUT, env=others, check=False
    )
    assert done.returncode == 2
    (line,) = [
        line for line in done.stderr.splitlines() if line.startswith("pdsurrogate: ")
    ]  # mpi4py and MPI add lines of their own
    assert (
        "2 processes were started, but each would run the whole scene by itself: the launcher is"
        " not that of mpi4py" in line
    )


def test_where_mpi4py_is_missing_the_refusal_says_what_to_install(monkeypatch):
    monkeypatch.setenv("PMI_SIZE", "2")
    monkeypatch.setitem(sys.modules, "mpi4py", None)  # as where it is not installed
    with raising(r'pip install "pdsurrogate\[mpi\]" && mpiexec -n 2 python -m mpi4py', NotUnderMPI):
        communicator()


# The same bits, and equilibrium within the tolerance.

QUICK = "analytic", "bond-energy", "neo-hookean-energy"


@several
def test_forces_and_steps_have_the_same_bits(ranks):
    alone = ranks.alone("arrays", 30, QUICK, module="every_model")
    check_bits(alone, ranks.value(2, "arrays", 30, QUICK, module="every_model"), QUICK)


@several
def test_balanced_gradients_have_the_same_bits(ranks):
    models = "bond-energy", "nosb", "bond-energy of solids", "nosb of solids"
    found = [
        ranks.alone(*asked, module="every_model")
        for asked in (("arrays", 30, models), ("balanced", 30, models))
    ]
    torn = ranks.alone("balanced", 30, models, True, module="every_model")
    for one, other, what in ((*found, "forces"), (found[1], torn, "positions")):
        for model in models:
            assert np.abs(one[f"{model}: {what}"] - other[f"{model}: {what}"]).max() > 1e-6
    check_bits(found[1], ranks.value(2, "balanced", 30, models, module="every_model"), models)
    check_bits(torn, ranks.value(2, "balanced", 30, models, True, module="every_model"), models)


@several
def test_a_term_with_history_keeps_its_own_points(ranks):
    """Of a search for equilibrium, whose residuals ranks sum in another order."""
    alone, shared = (ranks.value(number, "softened", module="springs") for number in (1, 2))
    for name, values in alone.items():
        np.testing.assert_allclose(shared[name], values, rtol=0, atol=1e-5)


@several
def test_branches_and_softening_have_the_same_bits(ranks):
    alone = ranks.alone("remembered", module="every_model")
    for name, values in ranks.value(2, "remembered", module="every_model").items():
        tolerance = 1e-12 if "energies" in name else 0.0
        np.testing.assert_allclose(values, alone[name], rtol=tolerance, atol=0, err_msg=name)
        assert np.all(np.max(np.abs(values), axis=0) > 0)


@several
def test_balanced_pairs_have_the_same_bits(ranks):
    models = "analytic", "neo-hookean"
    alone = ranks.alone("balanced", 30, models, True, module="every_model")
    plain = ranks.alone("arrays", 30, models, module="every_model")
    for model in models:
        assert np.abs(alone[f"{model}: forces"] - plain[f"{model}: forces"]).max() > 1e-6
    check_bits(alone, ranks.value(2, "balanced", 30, models, True, module="every_model"), models)


@several
@pytest.mark.slow
def test_forces_and_steps_of_every_model_have_the_same_bits(ranks):
    alone = ranks.alone("arrays", 100, module="every_model")
    shared = ranks.value(3, "arrays", 100, module="every_model")
    check_bits(alone, shared, [row.name for row in TABLE])


def check_bits(alone, shared, models):
    kinds = "forces", "energy", "positions", "time step"
    assert list(alone) == list(shared) == [f"{model}: {what}" for model in models for what in kinds]
    for name, values in alone.items():
        model, what = name.split(": ")
        # `ba-nosb` takes bonds in blocks of a part's own, and the last of a block by other
        # instructions, which round differently.  Such forces of 0.6 a mass move points by 1e-14 in
        # a time of 2, and rounding of a hundred positions by as much.  The stable time step follows
        # from differences of forces over a strain of `PROBES`.
        close = {
            "forces": 1e-14 * np.abs(values).max(),
            "positions": 1e-13,
            "time step": np.finfo(float).eps / PROBES["float64"] * np.max(values),
        }
        if what == "energy":
            np.testing.assert_allclose(shared[name], values, rtol=1e-12, err_msg=name)
        else:
            np.testing.assert_allclose(
                shared[name],
                values,
                rtol=0,
                atol=close[what] if model == "ba-nosb" else 0,
                err_msg=name,
            )
    assert (
        "ba-nosb" not in models
        or min(found["ba-nosb: time step"] for found in (alone, shared)) > LONGEST
    )


@several
def test_forces_of_two_materials_have_the_same_bits(ranks):
    """Bond forces and energies, in sheets and space, beside a slanted interface that reaches over
    parts, whole and torn, and beside a disc.

    Two of them are balanced for loads. Energies but for rounding.
    """
    alone = ranks.alone("digests_of_cases", module="two_materials")
    shared = ranks.value(2, "digests_of_cases", module="two_materials")
    assert len(alone) == 11
    for one, other in zip(alone, shared, strict=True):
        assert one["beside"] == other["beside"] > 10
        energies = one.pop("energy"), other.pop("energy")
        assert one == other
        assert energies[0] is None or energies[1] == pytest.approx(energies[0], rel=1e-12)


@several
@pytest.mark.parametrize("remembering", [False, True])
def test_bodies_of_two_materials_tear_in_the_same_way(ranks, remembering):
    """The crack runs along their interface from the part of one rank, left of x1 = 2, into that
    of the other.
    """
    asked = "torn_layers", remembering
    alone = ranks.alone(*asked, module="two_materials")
    crack, displacement, number, steps = alone
    assert number is None
    assert crack["start"]["x"][0] < 1.9
    assert crack["tips"][-1]["tip"][0] > 2.1
    shared = ranks.value(2, *asked, module="two_materials")
    # Forces of supports are sums over ranks.
    forces = [one["peak"].pop("force") for one in (crack, shared[0])]
    assert forces[1] == pytest.approx(forces[0], rel=1e-9)
    assert shared == (crack, displacement, 2, steps)


@several
def test_forces_between_held_boundaries_have_the_same_bits(ranks):
    """A ring whose outline and hole mirrored points hold, clouds also with broken bonds; sums of
    bonds across them but for rounding.
    """
    alone = ranks.alone("digests_of_cases", module="held_ring")
    shared = ranks.value(2, "digests_of_cases", module="held_ring")
    for one, other in zip(alone, shared, strict=True):
        assert one["bonds"] > 1000
        assert one["broken"] != one["forces"]
        np.testing.assert_allclose(
            other.pop("reaction"), one.pop("reaction"), rtol=1e-10, atol=1e-10
        )
        assert one == other


@several
def test_steps_against_obstacles_have_the_same_bits(ranks):
    (level, alone), (_, shared) = (ranks.value(some, "pressed", True) for some in (1, 2))
    assert all(np.linalg.norm(level["forces"][name]) > 0.01 for name in ("plate", "disc"))
    np.testing.assert_array_equal(shared, alone)


@several
def test_equilibrium_with_obstacles_within_the_tolerance(ranks):
    (alone, _), (shared, _) = (ranks.value(some, "pressed", False) for some in (1, 2))
    assert shared["evaluations"] <= 1.6 * alone["evaluations"]
    for name in ("plate", "disc"):
        np.testing.assert_allclose(shared["forces"][name], alone["forces"][name], rtol=0, atol=1e-5)
        # it ends where the gap is 0.01 spacings, and the penetration that is left differs
        assert shared["contact"][name]["area"] == pytest.approx(
            alone["contact"][name]["area"], abs=1e-4
        )


SMALL = ("hole", "analytic", {"spacing": 0.1}, 2)

LARGER = [
    ("ring-pressure", "analytic", {}, 3),
    ("bimaterial", None, {"spacing": 0.05}, 3),
    ("bonded-block", None, {"spacing": 0.125, "material.bulk_modulus": 1000}, 2),
    ("torsion", None, {"spacing": 0.125}, 3),
]


@several
@pytest.mark.parametrize(
    "case",
    [SMALL, *(pytest.param(case, marks=pytest.mark.slow) for case in LARGER)],
    ids=lambda case: case[0],
)
def test_equilibrium_within_the_tolerance(ranks, case):
    """Results agree as well as residuals of 1e-6 let them, and several ranks take at most 1.6 times
    the evaluations of one factor.

    Three parts of a ring touch one another all around; little but its planes of symmetry holds it.
    The bulk modulus of blocks is 100 or 1000 times the shear modulus: without a preconditioner that
    knows it they take ten times the evaluations.
    """
    *scene, number = case
    levels = [ranks.value(some, "levels", *scene) for some in (1, number)]
    for alone, shared in zip(*levels, strict=True):
        assert shared["method"] == alone["method"]
        assert shared["evaluations"] <= 1.6 * alone["evaluations"]
        for key in ("nominal_stress", "energy", "greatest_lateral_displacement"):
            if key in alone:
                assert shared[key] == pytest.approx(alone[key], rel=1e-5)
        for name, probe in alone.get("probes", {}).items():
            # The ring is soft: with residuals of 1e-6 one rank's own displacements across a plane
            # of symmetry are 5e-5 of those along.
            moved = np.array(probe["displacement"])
            np.testing.assert_allclose(
                shared["probes"][name]["displacement"],
                moved,
                rtol=0,
                atol=1e-4 * np.abs(moved).max(),
            )


@several
def test_a_multigrid_cycle_is_that_of_one_process(ranks):
    """The cycle is in single precision, and its sums over ranks have another order: a few times
    1e-7 of the greatest displacement.
    """
    alone, shared = (ranks.value(some, "inverse_by_multigrid") for some in (1, 3))
    assert np.abs(alone).max() > 0.01
    np.testing.assert_allclose(shared, alone, rtol=0, atol=1e-5 * np.abs(alone).max())


# What a run says and leaves.

WAVE = """
name = "wave"
spacing = 0.1
stretches = []
[body]
shape = "rectangle"
size = [2.0, 1.4]
[[holes]]
shape = "circle"
center = [1.0, 0.7]
radius = 0.3
[material]
law = "neo-hookean"
shear_modulus = 720.0
bulk_modulus = 72000.0
[dynamics]
stretch = 1.03
stretch_rate = 10.0
density = 1e-4
damping = 300.0
viscosity = 5e-6
outputs = 2
[[grips]]
edge = "bottom"
[[grips]]
edge = "top"
travel = 1.0
"""

HOLE = "run hole --force analytic --set spacing=0.25 --set stretches=1.05 --threads 1"


@several
def test_a_run_writes_what_one_process_writes(ranks, tmp_path):
    scene = tmp_path / "wave.toml"
    scene.write_text(WAVE)
    for number in (1, 2):
        done = ranks(
            number, "command", "run", scene, "--force", "analytic", "--out", tmp_path / str(number)
        )
        assert all(reply["status"] == 0 for reply in done), done
    one, two = (files(tmp_path / name) for name in "12")
    assert one == two
    assert (tmp_path / "1" / "wave-001.vtu").read_bytes() == (
        tmp_path / "2" / "wave-001.vtu"
    ).read_bytes()
    alone, shared = (summary_of(tmp_path / name) for name in "12")
    assert shared.pop("ranks") == 2
    for key in (
        "n_points",
        "n_bonds",
        "n_directed_bonds",
        "n_ghost_points",
        "n_force_evaluations",
        "n_steps",
        "converged",
    ):
        assert shared[key] == alone[key], key
    assert shared["peak_nominal_stress"] == pytest.approx(alone["peak_nominal_stress"], rel=1e-12)


def files(home):
    return sorted(
        str(path.relative_to(home)) for path in home.rglob("*") if path.name != "checkpoint.npz"
    )


SAID = re.compile(
    r"[\d.]+ ns per|[\d.]+ s(?= in total| of it compilation)|\d+(?= force evaluations)"
)
"""Times, and evaluations, in what a run says."""

CASES = {
    "good": ([], 0),
    "setting that the scene does not take": ("--set spacing=-1", 2),
    "body that cannot be made": ("--set body.size=[0.3,0.3]", 2),
    "solver that fails": (
        "--set solver.method=relaxation --set solver.most_evaluations=10",
        1,
    ),
}


@several
@pytest.mark.parametrize(
    "case",
    [
        case if status != 1 else pytest.param(case, marks=pytest.mark.slow)
        for case, (_, status) in CASES.items()
    ],
)
def test_three_ranks_say_what_one_says(ranks, case, tmp_path):
    """Line by line but for times, counts of evaluations and of ranks, with one exit status, and
    with the same files left behind.
    """
    settings, expected = CASES[case]
    command, said = words_of((HOLE, "--out out/hole", settings)), []
    homes = tmp_path / "one", tmp_path / "three"
    for number, home in zip((1, 3), homes, strict=True):
        home.mkdir()
        if number == 3 and expected == 1:  # by the command that a user types
            command = on_ranks(3, "-m", "pdsurrogate", *command)
            done = subprocess.run(
                command,
                cwd=home,
                capture_output=True,
                text=True,
                timeout=TIMEOUT,
                env=environment(),
                check=False,
            )
            statuses, streams = {done.returncode}, (done.stdout, done.stderr)
        else:
            replies = ranks(number, "command", *command, folder=home)
            statuses, streams = (
                {reply["status"] for reply in replies},
                ("".join(reply[key] for reply in replies) for key in ("out", "err")),
            )
        said.append(
            [SAID.sub("*", stream.replace("3 ranks of ", "")).splitlines() for stream in streams]
        )
        assert statuses == {expected}, said
        # What one rank has no reason to say, and three only on fewer cores; and what whoever comes
        # first says of the cache.
        of_machine = "do not start more ranks than cores", "Compiling kernels"
        said[-1][1] = [text for text in said[-1][1] if not any(part in text for part in of_machine)]
    assert said[0] == said[1]
    assert files(homes[0]) == files(homes[1])
    assert bool(files(homes[0])) == (expected < 2), "a run that is refused leaves nothing"


@several
@pytest.mark.slow
def test_a_script_asks_who_takes_part(ranks, tmp_path):
    """The guide's own script."""
    block = re.search(
        r"^```python\n(.*?)^```",
        (HERE.parent / "docs" / "guide" / "ranks.md").read_text(),
        re.MULTILINE | re.DOTALL,
    )[1]
    (tmp_path / "script.py").write_text(block)
    stresses = []
    for number in (1, 2):
        printed = "".join(
            reply["out"] for reply in ranks(number, "script", "script.py", folder=tmp_path)
        )
        (found,) = re.findall(rf"^([\d.]+) on {number} ranks$", printed, re.MULTILINE)
        stresses.append(float(found))
        assert (tmp_path / "stress.png").stat().st_size > 5000
        (tmp_path / "stress.png").unlink()
    assert stresses[1] == pytest.approx(stresses[0], rel=1e-5)


@several
def test_large_bodies_are_written_in_pieces(ranks, tmp_path):
    assert ranks(2, "command", HOLE, "--out", tmp_path / "whole")[0]["status"] == 0
    done = ranks(2, "in_pieces", HOLE, "--out", tmp_path / "pieces")[0]
    assert done["status"] == 0, done
    assert "no picture is drawn" in done["err"]
    states = sorted(path.name for path in (tmp_path / "pieces").glob("*vtu"))
    assert states == ["hole-000.piece0.vtu", "hole-000.piece1.vtu", "hole-000.pvtu"]
    whole, pieces = (
        StatesInFiles.saved(tmp_path / name, "hole")[0][1] for name in ("whole", "pieces")
    )
    assert list(whole) == list(pieces)
    for name, values in whole.items():
        np.testing.assert_array_equal(pieces[name], values)


# Checkpoints.


@several
def test_arrays_of_parts_come_in_the_order_of_the_whole_body_and_go_back(ranks):
    """Of points, images, directed bonds and pairs, in the plane and in space, between two planes
    of reflection and beside a cut.
    """
    assert [reply["error"] for reply in ranks(3, "check", module="orders")] == [None] * 3


TEAR = (
    "run tear --force analytic --threads 1 --set spacing=0.25 --set stretches=1.1",
    "--set 'body.size=[4.0, 3.0]' --set 'precuts=[{start=[0.0, 1.5], end=[1.5, 1.5]}]'",
    "--set dynamics.stretch=1.3 --set fracture.critical_stretch=1.5 --set dynamics.outputs=4",
    "--set dynamics.stretch_rate=40.0",
)
"""A sheet of 192 points, whose crack begins at step 39 and has run through half of it at step
75.
"""


@several
@pytest.mark.slow
def test_a_run_checkpointed_on_two_ranks_goes_on_on_three_and_on_one(ranks, tmp_path):
    # An uninterrupted run of as many ranks: its equilibrium before the tear is the same to the last
    # bit.
    folders = {number: tmp_path / str(number) for number in (1, 2, 3)}
    whole = ranks.loaded(2, "command", TEAR, "--out", tmp_path / "whole")[0]
    (told,) = [line for line in whole["out"].splitlines() if "bonds broken" in line]
    done = ranks(2, "disturbed", "interrupted", 49, TEAR, "--out", folders[2])[0]
    assert "interrupted; to resume from the checkpoint in" in done["err"], done
    arrays = np.load(folders[2] / "checkpoint.npz")
    assert arrays["positions"].shape == (192, 2)
    assert 0 < arrays["broken"].sum() < int(told.split()[0])
    for number in (1, 3):
        shutil.copytree(folders[2], folders[number])
    for number, folder in folders.items():
        done = ranks(number, "command", TEAR, "--out", folder, "--resume")[0]
        assert told in done["out"], done
    # Explicit steps are the same on any number of ranks to the last bit, and so are the pairs that
    # break.
    expected, *displacements = map(last_displacement, (tmp_path / "whole", *folders.values()))
    for displacement in displacements:
        assert np.array_equal(displacement, expected)
    cracks = [summary_of(folder)["crack"] for folder in (tmp_path / "whole", *folders.values())]
    # The forces of grips are summed rank by rank.
    stresses = [crack["peak"].pop("nominal_stress") for crack in cracks]
    assert stresses == pytest.approx(stresses[:1] * 4, rel=1e-12)
    assert cracks == cracks[:1] * 4


@several
@pytest.mark.slow
def test_a_slow_tear_on_two_ranks_breaks_the_same_bonds(ranks, tmp_path):
    """Equilibria on several ranks are not the same to the last bit, but to their tolerance."""
    cracks = []
    for number in (1, 2):
        folder = tmp_path / str(number)
        ranks(number, "command", TEAR, "--set fracture.process=quasi-static --out", folder)
        cracks.append(summary_of(folder)["crack"])
    one, two = cracks
    assert one["broken_bonds"] == two["broken_bonds"] > 5
    assert one["through"] == two["through"]
    stresses = [crack["peak"]["nominal_stress"] for crack in cracks]
    assert stresses[1] == pytest.approx(stresses[0], rel=1e-3)


@several
@pytest.mark.slow
def test_strengths_break_the_same_bonds_with_the_same_bits(ranks, tmp_path):
    """Discs reach across ranks, and two numbers decide; without an equilibrium before, whose last
    bits depend on the number of ranks.
    """
    fracture = "'fracture={energy=500.0, strength={stretch=1.3, equibiaxial=400.0}}'"
    asked = TEAR, f"--set stretches=[] --set {fracture} --set dynamics.stretch=1.5"
    cracks, displacements = [], []
    for number in (1, 2, 3):
        ranks(number, "command", asked, "--out", tmp_path / str(number))
        cracks.append(summary_of(tmp_path / str(number))["crack"])
        displacements.append(last_displacement(tmp_path / str(number)))
        assert np.array_equal(displacements[-1], displacements[0])
    assert cracks[0]["start"]["cause"] == "strength"
    assert cracks[0]["broken_bonds"] > 5
    for event in ("start", "peak"):
        stresses = [crack[event].pop("nominal_stress") for crack in cracks]
        assert stresses == pytest.approx(stresses[:1] * 3, rel=1e-12)
    assert cracks == cracks[:1] * 3


def last_displacement(folder):
    """Displacements of the last state, which are written in double precision."""
    return StatesInFiles.saved(folder, summary_of(folder)["scene"])[-1][1]["displacement"]


@several
def test_a_force_with_state_at_the_bonds_of_images_writes_checkpoints(ranks, tmp_path):
    """Two ranks ended in an error at the first checkpoint of `ba-nosb`; the residual is held to
    1e-6 of a shear modulus over a spacing.
    """
    scene = "run uniaxial --force ba-nosb --set spacing=0.25 --set stretches=1.05"
    stresses = []
    for number in (1, 2):
        done = ranks(number, "command", scene, "--out", tmp_path / str(number))
        assert all(reply["status"] == 0 for reply in done), done
        stresses.append(summary_of(tmp_path / str(number))["levels"][0]["nominal_stress"])
    assert stresses[1] == pytest.approx(stresses[0], rel=1e-5)


# How runs end.


@several
@pytest.mark.parametrize(
    ("limit", "error"),
    [(1.35, "SimulationFailed"), (1.25, "SceneError")],
    ids=["on the way", "tried before the run"],
)
def test_what_one_rank_raises_reaches_all(ranks, limit, error):
    for reply in ranks(2, "with_an_error", limit):
        assert reply["error"].startswith(error), reply
        assert "boom" in reply["error"]


@several
def test_different_scenes_are_refused_on_all_ranks(ranks):
    for reply in ranks(2, "different_scenes"):
        assert "the ranks have different arguments (scene)" in reply["error"]


MOVING = (
    f"{HOLE} --set"
    " 'dynamics={stretch=1.2, stretch_rate=0.5, density=0.01, outputs=3, safety=0.1}'"
)
"""A sheet of 188 points in some hundred steps, with three outputs, to which something happens in
the second third.
"""


def check_soon(happened):
    """All ranks have ended within ten seconds of what happens to one."""
    # On a machine with more work than cores all takes longer.
    assert time.time() - happened.stat().st_mtime < 10 * max(
        1.0, os.getloadavg()[0] / os.cpu_count()
    )


@several
def test_an_invalid_state_on_one_rank_ends_all_with_its_message(ranks, tmp_path):
    done = ranks(2, "disturbed", "invalid", 60, MOVING, "--out", tmp_path / "out")
    check_soon(tmp_path / "out.happened")
    assert [reply["status"] for reply in done] == [1, 1], done
    assert done[0]["err"].count("the run failed") == 1
    assert "Traceback" not in done[0]["err"]
    assert not done[1]["err"]
    summary = summary_of(tmp_path / "out")
    assert summary["converged"] is False
    assert len(summary["levels"]) == 1
    assert len(list((tmp_path / "out").glob("*.vtu"))) >= 2


def check_kept(folder):
    assert sorted(path.name for path in folder.glob("*.vtu")) == ["hole-000.vtu", "hole-001.vtu"]
    with np.load(folder / "checkpoint.npz") as arrays:
        assert np.isfinite(arrays["positions"]).all()


def ends(command, status, happened, interrupt=False):
    """Output of processes of their own that have to end, all of them and with a status, soon
    after what happens to them.
    """
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment()
    )
    try:
        if interrupt:
            until = time.monotonic() + TIMEOUT
            while not happened.exists() and process.poll() is None and time.monotonic() < until:
                time.sleep(0.02)
            process.send_signal(signal.SIGINT)
        told = process.communicate(timeout=TIMEOUT)[0]
    finally:
        process.kill()
    check_soon(happened)
    assert process.returncode == status, told
    assert "Traceback" not in told
    return told


@several
def test_a_full_disk_ends_all_with_its_message(tmp_path):
    told = ends(
        on_ranks(2, HERE / "ranks" / "cases.py", "full", 60, MOVING, "--out", tmp_path / "out"),
        1,
        tmp_path / "out.happened",
    )
    assert "could not write" in told
    assert "File too large" in told
    check_kept(tmp_path / "out")


@several
@pytest.mark.slow
def test_a_rank_that_is_killed_ends_all_and_leaves_a_checkpoint(tmp_path):
    ends(
        on_ranks(2, HERE / "ranks" / "cases.py", "killed", 60, MOVING, "--out", tmp_path / "out"),
        9,
        tmp_path / "out.happened",
    )
    check_kept(tmp_path / "out")


@several
def test_ctrl_c_ends_all_with_results_and_a_checkpoint(tmp_path):
    slower = MOVING.replace("safety=0.1", "safety=0.01")
    command = on_ranks(
        2, HERE / "ranks" / "cases.py", "told", 60, slower, "--out", tmp_path / "out"
    )
    told = ends(command, 130, tmp_path / "out.happened", interrupt=True)
    assert "interrupted; to resume from the checkpoint in" in told, told
    assert (tmp_path / "out" / "checkpoint.npz").exists()
    assert summary_of(tmp_path / "out")["failure"].endswith("interrupted")
