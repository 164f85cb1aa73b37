"""A run on several ranks against the same on one; processes of their own, for a test that hangs must end too."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest
from several_ranks import HERE, MPIEXEC, TIMEOUT, environment, run, several

from pdsurrogate.body import grid
from pdsurrogate.ranks import ALONE, NotUnderMPI, bisected, bond_counts, communicator

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


def test_one_process_is_alone():
    assert communicator() is ALONE
    assert "mpi4py" not in sys.modules


@pytest.mark.parametrize("parts", [2, 3, 5, 8])
def test_parts_have_as_many_bonds_and_each_point_once(parts):
    points = grid((0, 0), (3, 2), 0.1)
    points = points[np.linalg.norm(points - [1.0, 1.0], axis=1) > 0.4]
    bonds = bond_counts(points, 0.315)
    part = bisected(points, bonds, parts)
    assert set(part) == set(range(parts))
    of_parts = np.bincount(part, bonds)
    # A cut goes between points: it may be off by one at each of the levels, and one has 30 of some 400 bonds.
    assert of_parts.max() / of_parts.mean() < 1.1


def test_bonds_are_counted_with_the_point_itself():
    points = grid((0, 0), (1, 1), 0.1)
    assert bond_counts(points, 0.11).max() == 5
    np.testing.assert_array_equal(bond_counts(points, 0.11, slice(0, 3)), [3, 4, 4])


@several
def test_a_run_writes_what_one_process_writes(tmp_path):
    scene = tmp_path / "wave.toml"
    scene.write_text(WAVE)
    for ranks in (1, 2):
        run(ranks, "-m", "pdsurrogate", "run", scene, "--force", "analytic", "--out", tmp_path / str(ranks), mpi4py=ranks > 1)
    one, two = (sorted(path.name for path in (tmp_path / name).iterdir()) for name in "12")
    assert set(one) - {"checkpoint.npz"} == set(two) - {"checkpoint.npz"}
    assert (tmp_path / "1" / "wave-001.vtu").read_bytes() == (tmp_path / "2" / "wave-001.vtu").read_bytes()
    alone, shared = (json.loads((tmp_path / name / "summary.json").read_text()) for name in "12")
    assert shared.pop("ranks") == 2
    for key in ("n_points", "n_bonds", "n_directed_bonds", "n_ghost_points", "n_force_evaluations", "n_steps", "converged"):
        assert shared[key] == alone[key], key
    assert shared["peak_nominal_stress"] == pytest.approx(alone["peak_nominal_stress"], rel=1e-12)


SAID = re.compile(r"[\d.]+ ns per|[\d.]+ s(?= in all| compiling)|\d+(?= force evaluations)")
"""Times, and evaluations, in what a run says."""

CASES = {
    "good": ([], 0),
    "setting that the scene does not take": (["--set", "spacing=-1"], 2),
    "body that cannot be made": (["--set", "body.size=[0.3,0.3]"], 2),
    "solver that fails": (["--set", "solver.method=relaxation", "--set", "solver.most_evaluations=60"], 1),
}


@several
@pytest.mark.parametrize("case", CASES)
def test_three_ranks_say_what_one_says(case, tmp_path):
    """Line by line on either stream but for times and counts of evaluations, with one exit status, and with the same files left behind."""
    settings, expected = CASES[case]
    command = [sys.executable, "-m", "pdsurrogate", "run", "hole", "--force", "analytic", "--out", "out/hole", "--threads", "1"]
    command += ["--set", "spacing=0.25", "--set", "stretches=1.05", *settings]
    several = [str(MPIEXEC), "-n", "3", sys.executable, "-m", "mpi4py", *command[1:]]
    said = []
    for name, line in (("one", command), ("three", several)):
        home = tmp_path / name
        home.mkdir()
        done = subprocess.run(line, cwd=home, capture_output=True, text=True, timeout=TIMEOUT, env=environment(), check=False)
        assert done.returncode == expected, done.stderr
        streams = [SAID.sub("*", stream).splitlines() for stream in (done.stdout, done.stderr)]
        # What one rank has no reason to say, and three only on fewer cores; and what whoever comes first says of the cache.
        streams[1] = [text for text in streams[1] if "take as many ranks as cores" not in text and "Compiling kernels" not in text]
        said.append((streams, sorted(str(path.relative_to(home)) for path in home.rglob("*") if path.name != "checkpoint.npz")))
    assert said[0] == said[1]
    assert bool(said[0][1]) == (expected < 2), "a run that is refused leaves nothing"


def test_a_script_asks_who_takes_part(tmp_path):
    """The guide's own script, which in one process loads nothing of MPI."""
    block = re.search(r"^```python\n(.*?)^```", (HERE.parent / "docs" / "guide" / "ranks.md").read_text(), re.MULTILINE | re.DOTALL)[1]
    (tmp_path / "script.py").write_text(block + "import sys\nassert ranks.size > 1 or 'mpi4py' not in sys.modules\n")
    both = [1, 2] if several.args[0] is False else [1]
    stresses = []
    for ranks in both:
        printed = run(ranks, "script.py", mpi4py=ranks > 1, cwd=tmp_path)
        (found,) = re.findall(rf"^([\d.]+) on {ranks} ranks$", printed, re.MULTILINE)
        stresses.append(float(found))
        assert (tmp_path / "stress.png").stat().st_size > 5000
    assert stresses[-1] == pytest.approx(stresses[0], rel=1e-5)


REFUSED = """
import sys
import pdsurrogate as pds
from pdsurrogate.ranks import communicator

class Rubber:
    def __init__(self, limit):
        self.limit = limit

    def bond_force(self, stretch, rotation, length, C33, J):
        if communicator().rank == 1 and stretch.max() > self.limit:
            raise RuntimeError("boom")
        return pds.AnalyticBondForce().bond_force(stretch, rotation, length, C33, J)

for limit in (1.35, 1.25):  # on the way, and while it is tried before the run
    try:
        pds.simulate(pds.load_scene("uniaxial", spacing=0.25, stretches=[1.3, 1.5]), Rubber(limit))
    except (pds.SimulationFailed, pds.SceneError) as error:
        # Written at once: the lines of two ranks do not mix.
        sys.stdout.write(f"{limit} {communicator().rank} {'boom' in str(error)}\\n")
        sys.stdout.flush()
pds.simulate(pds.load_scene('uniaxial', spacing=0.25 - 0.05 * communicator().rank), 'analytic')
"""


@several
def test_what_one_rank_raises_reaches_all_and_different_scenes_are_refused():
    """One start of two ranks for three refusals, the last of which ends it."""
    printed = run(2, "-c", REFUSED, expected=1)
    told = [line for line in printed.splitlines() if line.endswith((" True", " False"))]
    assert sorted(told) == ["1.25 0 True", "1.25 1 True", "1.35 0 True", "1.35 1 True"], printed
    assert "the ranks were not given the same scene" in printed


@several
def test_processes_that_do_not_know_of_each_other_are_refused():
    assert "python -m mpi4py -m pdsurrogate" in run(2, "-m", "pdsurrogate", "run", "hole", mpi4py=False, expected=2)


def test_where_mpi4py_is_missing_the_refusal_says_what_to_install(monkeypatch):
    monkeypatch.setenv("PMI_SIZE", "2")
    monkeypatch.setitem(sys.modules, "mpi4py", None)  # as where it is not installed
    with pytest.raises(NotUnderMPI, match=r'pip install "pdsurrogate\[mpi\]" && mpiexec -n 2 python -m mpi4py'):
        communicator()
