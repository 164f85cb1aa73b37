"""Two commits side by side: the same figures, and what force models, runs and commands cost.

python pipelines/compare_commits.py OLD NEW figures       sections 6.2 to 6.7, tears at a coarser spacing
python pipelines/compare_commits.py OLD NEW conformance   every required property of the exact force models and of two surrogates
python pipelines/compare_commits.py OLD NEW tear cube     costs, by the names that `--help` lists
python pipelines/compare_commits.py OLD NEW --docs        all rows of the documentation, into it (an hour and a half)

Each commit is checked out into a temporary folder and run there in processes of its own with this Python, so that both must run on what is
installed.  The commits take turns and each goes first in every other turn; what is printed are medians over the turns, and the median of
the ratios within a turn.  What a commit does not know, such as a key of a scene, is reported in the place of its figures.  Caches are
filled before the first turn except where they are what is measured.  `--docs` keeps the rows that are on the page and not measured this
time if they were measured with the same commits on the same processor.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from pages import block, markdown_table, replace_block

from pdsurrogate.results.provenance import processor

ROOT = Path(__file__).resolve().parents[1]

SHEETS = (
    "neo-hookean",
    "neo-hookean-paper",
    "neo-hookean-energy",
    "analytic",
    "nosb",
    "ba-nosb",
    "bond-energy",
    "gent",
    "ogden",
    "full-network",
)
SOLIDS = ("bond-energy", "nosb", "neo-hookean-isochoric", "ogden-isochoric", "full-network-isochoric", "arruda-boyce-isochoric")
WIDTHS = (10, 50, 163)
"""Points along the shorter side of the sheets of 3 by 1 in which costs are compared: 300, 7,500 and 79,707 points."""

STARTS = 2
"""How often the processes are started in which costs of all force models are compared, since where memory lies counts."""

RUNS = {
    "6.2": ("uniaxial", None, {}),
    "6.2, ba-nosb": ("uniaxial", "ba-nosb", {"spacing": 0.05}),
    "6.2, bond-energy": ("uniaxial", "bond-energy", {"spacing": 0.05}),
    "6.3": ("pure-shear", "analytic", {}),
    "6.4": ("hole", "analytic", {}),
    "6.5": ("tear", None, {"spacing": 0.1}),
    "6.6": ("voids", None, {"spacing": 0.05}),
    "6.7": ("gent", None, {}),
}
"""Scene, force and changes of each section's run."""

FIGURES = """
import json, sys
import pdsurrogate as pds
for line in sys.stdin:
    scene, force, changes = json.loads(line)
    result = pds.simulate(pds.load_scene(scene, changes), force)
    found = {}
    for level in result.levels:
        for key in ("nominal_stress", "nominal_stress_work_conjugate", "lateral_displacement", "greatest_lateral_displacement", "energy"):
            if key in level:
                found[f"{key} at {level['stretch']:g}"] = level[key]
    if "peak_nominal_stress" in result.summary:
        found["peak nominal stress"] = result.summary["peak_nominal_stress"]
    if result.summary.get("crack"):
        found["broken bonds"] = result.summary["crack"]["broken_bonds"]
    found["evaluations"] = result.summary["n_force_evaluations"]
    print(json.dumps(found), flush=True)
"""

CONFORMANCE = """
import json
from pdsurrogate.artifacts import load_surrogate
from pdsurrogate.forces import FORCES
from pdsurrogate.testing import FORCE_MODEL_PROPERTIES
from pdsurrogate.testing.checks import subject_of
found = {}
for name in (*FORCES, "neo-hookean", "neo-hookean-isochoric"):
    for plane in {"stress", "space"} & {*load_surrogate(name).honors["plane"]}:
        subject = subject_of(name, plane=plane)
        for one in FORCE_MODEL_PROPERTIES:
            finding = one(subject)
            verdict = "-" if finding.value is None else "pass" if finding.holds else "weak"
            found[f"{name}, {plane}: {one.name}"] = [verdict, finding.value, finding.tolerance]
print(json.dumps(found), flush=True)
"""

BIND = """
import json, sys, time
from pathlib import Path
import numba, numpy as np
import pdsurrogate as pds
from pdsurrogate.reports.speed import bench_positions
def cube(width, ratio):
    middles = (np.arange(width) + 0.5) / width
    points = np.stack(np.meshgrid(middles, middles, middles, indexing="ij"), axis=-1).reshape(-1, 3)
    return pds.Body(points, np.full(len(points), width**-3.0), ratio / width)
def bind(name, body):
    model = pds.load_surrogate(name)
    card = next(Path().glob(f"art?facts/{name.partition('@')[0]}/1/card.json"), None)
    material = json.loads(card.read_text())["material"]["trained_with"] if card else {"law": "neo-hookean"}
    law = pds.materials.LAWS[material.pop("law")](**{key: tuple(v) if isinstance(v, list) else v for key, v in material.items()})
    settings = pds.ForceSettings(plane="stress" if body.points.shape[1] == 2 else "space")
    if settings.plane == "stress":
        positions = bench_positions(body, law)
    else:
        positions = body.points * [1.3, 0.9, 0.87] + 0.02 * np.sin(9 * body.points[:, [1, 2, 0]])
    force, out = model.bind(body, law, settings), np.empty_like(body.points)
    for _ in range(3):
        force(positions, out)
    return lambda: force(positions, out)
def cost(force, body, clock, seconds):
    count, began = 0, clock()
    while clock() - began < seconds:
        force()
        count += 1
    return 1e9 * (clock() - began) / count / body.bonds.n_directed
"""
"""Start of the scripts that time force models."""

SPEED = f"""{BIND}
bound, bodies = {{}}, {{}}
for line in sys.stdin:
    name, width, threads = json.loads(line)
    numba.set_num_threads(threads)
    if width not in bodies:
        bodies[width] = pds.Body.rectangle(3.0, 1.0, 1 / width, 3.15 / width) if width else cube(20, 2.2)
    if (name, width, threads) not in bound:
        bound[name, width, threads] = bind(name, bodies[width])
    print(json.dumps({{"ns": cost(bound[name, width, threads], bodies[width], time.perf_counter, 0.06)}}), flush=True)
"""

ENERGIES = f"""{BIND}
numba.set_num_threads(1)
solid, sheet = cube(20, 1.75), pds.Body.rectangle(3.0, 1.0, 0.02, 0.063)
cases = [("nosb", solid), ("neo-hookean-isochoric", solid), ("bond-energy", solid), ("nosb", sheet), ("neo-hookean@2", sheet)]
forces = [bind(*case) for case in cases]
found = [[cost(force, body, time.thread_time, 0.05) for force, (_, body) in zip(forces, cases)] for _ in range(10)]
nosb, learned, exact, plain, plane = map(min, zip(*found))
print(json.dumps({{
    "learned energy in space (ns)": learned, "learned energy in space / NOSB": learned / nosb,
    "exact energy in space (ns)": exact, "exact energy in space / NOSB": exact / nosb, "NOSB in space (ns)": nosb,
    "`neo-hookean@2` in the plane (ns)": plane, "`neo-hookean@2` in the plane / NOSB": plane / plain,
}}))
"""
"""Least cost of ten turns, on one thread; in space with the default horizon."""

MATERIALS = (
    ("neo-hookean", "stress", 20),
    ("neo-hookean", "stress", 50),
    ("analytic", "stress", 20),
    ("analytic", "stress", 50),
    ("bond-energy", "stress", 20),
    ("bond-energy", "stress", 50),
    ("bond-energy", "strain", 50),
    ("neo-hookean-isochoric", "strain", 50),
    ("bond-energy", "space", 8),
    ("bond-energy", "space", 16),
    ("bond-energy", "space", 24),
    ("neo-hookean-isochoric", "space", 16),
)
"""Force, plane, and points along each side of the square sheets and cubes whose two halves are of two materials, in the comparison with the
same body of one material."""

HALVES = """
import json, sys, time
import numba, numpy as np
import pdsurrogate as pds
from pdsurrogate.forces import Portion, bind_portions
numba.set_num_threads(1)
def forces(name, plane, width):
    d = 3 if plane == "space" else 2
    middles = (np.arange(width) + 0.5) / width
    points = np.stack(np.meshgrid(*[middles] * d, indexing="ij"), axis=-1).reshape(-1, d)
    body = pds.Body(points, np.full(len(points), width ** -float(d)), (2.2 if d == 3 else 3.15) / width)
    model = pds.forces.FORCES[name]() if name in pds.forces.FORCES else pds.load_surrogate(name)
    stiff = points[:, 0] > 0.5
    laws = [pds.materials.NeoHookean(mu, 100 * mu) for mu in (1.0, 3.0)]
    portions = [Portion(law, model, np.flatnonzero(where)) for law, where in zip(laws, (~stiff, stiff))]
    settings = pds.ForceSettings(plane=plane)
    yield body.bonds.n_directed, points * np.array([1.1, 0.97, 0.95][:d]), np.empty_like(points)
    yield bind_portions(body, portions, settings)
    yield model.bind(body, laws[0], settings)
"""
"""Start of the scripts about bodies of two materials."""

TWO = f"""{HALVES}
found, ratios = {{}}, []
for case in json.loads(sys.argv[1]):
    (bonds, positions, out), *both = forces(*case)
    least = [np.inf, np.inf]
    for turn in range(23):
        for number, force in enumerate(both):
            began = time.thread_time()
            force(positions, out)
            if turn > 2:
                least[number] = min(least[number], 1e9 * (time.thread_time() - began) / bonds)
    name = f"{{case[0]}}, {{case[1]}}, {{len(out):,}} points"
    ratios.append(least[0] / least[1])
    found |= {{f"{{name}}: one (ns)": least[1], f"{{name}}: two (ns)": least[0], f"{{name}}: two / one": ratios[-1]}}
print(json.dumps({{"least two / one": min(ratios), "greatest two / one": max(ratios)}} | found))
"""
"""Costs of bodies of one material and of two, each the least processor time of twenty evaluations in turns."""

MEMORY = f"""{HALVES}
of = forces(*json.loads(sys.argv[1]))
_, positions, out = next(of)
next(of)(positions, out)
"""

WHOLE = """
import json, sys
import pdsurrogate as pds
known = set()
for line in sys.stdin:
    scene, changes = json.loads(line)
    for _ in range(1 if line in known else 2):
        summary = pds.simulate(pds.load_scene(scene, changes)).summary
    known.add(line)
    print(json.dumps({"s": summary["seconds_total"] - summary["seconds_compile"]}), flush=True)
"""

RUN = """
import json, sys
import pdsurrogate as pds
scene, changes = json.loads(sys.argv[1])
summary = pds.simulate(pds.load_scene(scene, changes)).summary
mpi = sys.modules.get("mpi4py.MPI")
if mpi is None or mpi.COMM_WORLD.rank == 0:
    print(json.dumps({"evaluations": summary["n_force_evaluations"], "run (s)": summary["seconds_total"] - summary["seconds_compile"]}))
"""

LEFT_OUT = ": left out, "
"""In a line by which a script says what a commit does not know."""

FAILING = f"""
import json, sys
sys.path.append({str(ROOT / "pipelines")!r})
from failing_levels import FAILING, costs, run
ratios, evaluations = [], []
for name, case in FAILING.items():
    try:
        good, bad = costs(*run(*case))
    except Exception as error:
        print(f"{{name}}{LEFT_OUT}{{type(error).__name__}}: {{error}}", file=sys.stderr)
        continue
    evaluations.append(bad)
    if good:
        ratios.append(bad * len(good) / sum(good))
print(json.dumps({{
    "runs": len(evaluations),
    "failing output / mean of good, greatest": max(ratios),
    "evaluations of a failing output, greatest": max(evaluations),
}}))
"""

COMPILE = """
import json
import pdsurrogate as pds
runs = {"first run": (None, {})}
for force, law in (("bond-energy", "neo-hookean"), ("ba-nosb", "neo-hookean"), ("analytic", "yeoh"), ("analytic", "ogden")):
    runs[f"then {force}, {law}"] = force, {"stretches": 1.2, "material": law}
print(json.dumps({
    f"{name}: compiling (s)": pds.simulate(pds.load_scene("uniaxial", {"spacing": 0.1, **changes}), force).summary["seconds_compile"]
    for name, (force, changes) in runs.items()
}))
"""


FIRST_FORCE = """
import os
import pdsurrogate as pds
from pdsurrogate.progress import listening
with listening(lambda stage, done, total, **numbers: os._exit(0) if "residual" in numbers else None):
    pds.simulate(pds.load_scene("uniaxial", spacing=0.1))
"""
"""A run that ends when the first force is known."""


@contextmanager
def checkouts(references: list[str]):
    """Context with a folder for each commit."""
    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for number, reference in enumerate(references):
            path = Path(folder) / str(number)
            added = ["git", "-C", str(ROOT), "worktree", "add", "--detach", str(path), reference]
            subprocess.run(added, check=True, capture_output=True)
            paths.append(path)
        try:
            yield paths
        finally:
            for path in paths:
                subprocess.run(["git", "-C", str(ROOT), "worktree", "remove", "--force", str(path)], check=False, capture_output=True)


class NotRun(SystemExit):
    """What a commit was asked is unknown to it or failed; the message is its own, with which the script ends where no row reports it."""


def environment(path: Path) -> dict[str, str]:
    """The variables of processes of a checkout."""
    # Threads that turn for milliseconds after their work would take the cores from the process whose turn is next.
    return {"GOMP_SPINCOUNT": "1000", **os.environ, "PYTHONPATH": str(path)}


def start(path: Path, script: str) -> subprocess.Popen:
    """A process that runs a script on one of the checkouts."""
    command = [sys.executable, "-c", script]
    return subprocess.Popen(command, cwd=path, env=environment(path), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def ask(process: subprocess.Popen, question=None):
    """One answer of a process, as JSON."""
    if question is not None:
        process.stdin.write(json.dumps(question) + "\n")
        process.stdin.flush()
    answer = process.stdout.readline()
    if not answer:
        raise NotRun("a process ended without an answer; what it said is above")
    return json.loads(answer)


def compare_figures(paths: list[Path]) -> None:
    """Every figure of every section, and by how much it differs."""
    both = [start(path, FIGURES) for path in paths]
    for section, question in RUNS.items():
        old, new = (ask(process, question) for process in both)
        for key, value in old.items():
            change = new[key] / value - 1 if value else new[key]
            print(f"{section:18} {key:42} {value:14.8g} {new[key]:14.8g} {change:+.1e}", flush=True)


def compare_conformance(paths: list[Path]) -> None:
    """Verdicts that differ, and values that differ by more than a thousandth of what they are held to."""
    old, new = (ask(start(path, CONFORMANCE)) for path in paths)
    for what in sorted({*old, *new}):
        if what not in old or what not in new:
            print(f"{what:70} only in the {'old' if what in old else 'new'}")
            continue
        (before, a, limit), (after, b, _) = old[what], new[what]
        apart = a is not None and b is not None and not abs(a - b) <= 1e-3 * abs(limit or a)
        if before != after or apart:
            print(f"{what:70} {before:12} {a} -> {after:12} {b} (held to {limit})", flush=True)
    print(f"{len({*old} & {*new})} cases compared")


Measure = Callable[[Path], dict[str, float]]


def spent(path: Path, *words: str, launcher: tuple[str, ...] = (), together: int = 1, status: int = 0) -> dict[str, float]:
    """Cost of processes of Python that start at once on a checkout, and the figures that the last one prints as JSON.

    Processor time counts user and system, of all processes and those that they start; memory is the greatest of one process.
    """
    began, processes, seconds, memory = time.perf_counter(), [], 0.0, 0.0
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as errors:
        for _ in range(together):
            command = [*launcher, sys.executable, *words]
            processes.append(subprocess.Popen(command, cwd=path, env=environment(path), stdout=out, stderr=errors))
        for process in processes:
            _, ended, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(ended)
            seconds += usage.ru_utime + usage.ru_stime
            memory = max(memory, usage.ru_maxrss / 1024)
        wall = time.perf_counter() - began
        printed, said = (file.seek(0) or file.read().strip().splitlines() for file in (out, errors))
    for line in said:
        if LEFT_OUT in line:
            print(f"    {'new' if path.name == '1' else 'old'}: {line}")
    if any(process.returncode != status for process in processes):
        raise NotRun(next((line for line in reversed(said) if line), f"status {[process.returncode for process in processes]}"))
    figures = json.loads(printed[-1]) if printed and printed[-1].startswith("{") else {}
    return {"processor time (s)": seconds, "wall time (s)": wall, "memory (MB)": memory, **figures}


def script(text: str, *question) -> Measure:
    """The cost of a script of a question, with the figures that it prints."""
    return lambda path: spent(path, "-c", text, *map(json.dumps, question))


def command(*words: str, together: int = 1, status: int = 0) -> Measure:
    """The cost of a command of the package."""
    return lambda path: spent(path, "-m", "pdsurrogate", *words, together=together, status=status)


def with_empty_cache(measure: Measure) -> Measure:
    """The same, each time without anything that was compiled before."""

    def emptied(path: Path) -> dict[str, float]:
        for cache in path.rglob("__pycache__"):
            shutil.rmtree(cache)
        return measure(path)

    return emptied


def ranks(path: Path) -> dict[str, float]:
    """Seconds of a run on one rank and on two, without what comes before and after it."""
    mpiexec = str(Path(sys.executable).with_name("mpiexec"))
    words = "-W", "ignore", "-m", "mpi4py", "-c", RUN, json.dumps(SMALL)
    one, two = spent(path, *words), spent(path, *words, launcher=(mpiexec, "-n", "2"))
    found = {f"{which}: {key}": run[key] for which, run in (("one", one), ("two", two)) for key in ("run (s)", "evaluations")}
    return {"two ranks / one": two["run (s)"] / one["run (s)"], **found}


@dataclass(frozen=True)
class Row:
    """Costs that are compared.

    Attributes
    ----------
    what : str
    measure : callable
        Of a checkout; gives figures by quantity.
    wanted : dict of str
        What is wanted of the quantities that the documentation shows.
    turns : int
    first : callable, optional
        Fills the caches before the first turn.
    """

    what: str
    measure: Measure
    wanted: dict[str, str] = field(default_factory=dict)
    turns: int = 3
    first: Measure | None = None

    def compare(self, paths: list[Path], turns: int | None) -> tuple[dict[str, list], dict[str, list]]:
        """Figures of all turns by quantity, of the old commit and of the new one."""
        figures, gone = ({}, {}), set()
        for turn in range(turns or self.turns):
            for which in (0, 1) if turn % 2 else (1, 0):
                try:
                    if turn == 0 and self.first:
                        self.first(paths[which])
                    if which not in gone:
                        for quantity, value in self.measure(paths[which]).items():
                            figures[which].setdefault(quantity, []).append(value)
                except NotRun as error:
                    gone.add(which)
                    print(f"    {self.what}: the {'new' if which else 'old'} commit did not run: {error}", flush=True)
        return figures


@dataclass(frozen=True)
class Answers(Row):
    """Costs that two processes, which stay alive, tell when they are asked one after the other; `measure` gives their script."""

    questions: dict[str, tuple] = field(default_factory=dict)

    def compare(self, paths: list[Path], turns: int | None) -> tuple[dict[str, list], dict[str, list]]:
        """As of other rows."""
        figures = ({}, {})
        for _ in range(STARTS):
            both = [start(path, self.measure) for path in paths]
            for name, question in self.questions.items():
                for turn in range(turns or self.turns):
                    for which in (0, 1) if turn % 2 else (1, 0):
                        for unit, value in ask(both[which], question).items():
                            figures[which].setdefault(f"{name} ({unit})", []).append(value)
            for process in both:
                process.kill()
                process.wait()
        return figures


def scene(name: str, changes: dict, coarse: dict) -> dict[str, Measure]:
    """Run of a scene, and one with other changes that fills the caches."""
    return {"measure": script(RUN, [name, changes]), "first": script(RUN, [name, changes | coarse])}


LENGTHS = {"body.size": [1.2, 0.9, 0.8], "body.lower": [0.0, -0.45, -0.4], "spacing": 0.1, "probes": [], "stretches": 1.05}
SMALL = "bonded-block", LENGTHS | {"material.bulk_modulus": 1000.0}
"""A nearly incompressible block of 864 points."""

MOTION = {"duration": 16.0, "density": 1e-3, "damping": 0.1, "viscosity": 0.002}
TROUSERS = {"spacing": 0.5, "horizon_ratio": 2.2, "fracture": {"critical_stretch": 2.667}}
"""The same tear in both commits: fracture energies are calibrated anew from time to time."""

SECONDS = "processor time (s)"


def rows(points: int) -> dict[str, Row]:
    """Costs by name; the large body has so many points a side."""
    small_run, refused = ["run", "uniaxial", "--set", "spacing=0.1"], ["run", "uniaxial", "--set", "spacings=0.1"]
    saved = [*small_run, "--out", "small-run", "--overwrite"]
    wanted = {SECONDS: "must 0.6, aim 0.4"}
    stiff = {"material.bulk_modulus": 1000.0, "stretches": 1.3, "spacing": 1 / 24}
    large = {"spacing": 1 / points, "solver.tolerance": 1e-5}
    whole = {"6.2": ("uniaxial", {}), "6.5": ("tear", {"spacing": 0.1})}
    forces = {
        f"{name}, {3 * width * width if width else 8000:,} points, {threads} threads": (name, width, threads)
        for names, widths in ((SHEETS, WIDTHS), (SOLIDS, [0]))
        for width in widths
        for name in names
        for threads in (1, 2)
    }
    halves = script(MEMORY, ("bond-energy", "space", 24))
    space = "must 34, aim 26"
    energies = {
        "learned energy in space (ns)": space,
        "learned energy in space / NOSB": "aim 3.2",
        "exact energy in space (ns)": space,
        "exact energy in space / NOSB": "aim 3.2",
        "`neo-hookean@2` in the plane / NOSB": "aim 1.5",
    }
    fails = {"failing output / mean of good, greatest": "must 10", "evaluations of a failing output, greatest": ""}
    return {
        "forces": Answers("cost of a directed bond", SPEED, turns=4, questions=forces),
        "runs": Answers("whole run of a section", WHOLE, turns=5, questions=whole),
        "energies": Row("force on one thread, per directed bond", script(ENERGIES), energies, 5),
        "materials": Row("body of two materials", script(TWO, MATERIALS), {"greatest two / one": "must 1.5, aim 1.2"}),
        "memory": Row("cube of 13,824 points of two materials", halves, {"memory (MB)": "not more"}, first=halves),
        "ranks": Row(
            "block of 864 points, K = 1000, to 1.05",
            ranks,
            {"two ranks / one": "must 1.2", "one: run (s)": "", "two: run (s)": ""},
            first=ranks,
        ),
        "cube": Row(
            "bonded cube, 24 points a side, K = 1000, to 1.3",
            **scene("bonded-block", stiff, {"spacing": 1 / 12}),
            wanted={SECONDS: "must 25, aim 16", "memory (MB)": ""},
        ),
        "tear": Row(
            "tear in the plane, 8,084 points",
            **scene("tear", {"spacing": 0.064, "reference": None}, {"spacing": 0.2}),
            wanted={SECONDS: "", "evaluations": ""},
        ),
        "trousers": Row(
            "tear in space (`trousers`), 7,168 points",
            **scene("trousers", TROUSERS, {"steps": [{"to": 0.2}, {"to": 0.3, "dynamics": {**MOTION, "duration": 0.1}}]}),
            wanted={SECONDS: "aim 60", "evaluations": ""},
        ),
        "failing": Row("outputs that do not exist", script(FAILING), fails, 1),
        "help": Row("`pdsurrogate --help`", command("--help"), wanted, 9, command("--help")),
        "refused": Row("scene that is refused", command(*refused, status=2), wanted, 9, command(*refused, status=2)),
        "first-force": Row("run of 300 points, up to the first force", script(FIRST_FORCE), {SECONDS: ""}, 9, script(FIRST_FORCE)),
        "small-run": Row("run of 300 points", command(*small_run), wanted, 9, command(*small_run)),
        "pictures": Row("run of 300 points, with files and a picture", command(*saved), {SECONDS: ""}, 9, command(*saved)),
        "compile": Row("empty cache", with_empty_cache(script(COMPILE)), {"first run: compiling (s)": "aim 6"}),
        "three": Row(
            "three runs at once on an empty cache",
            with_empty_cache(command(*small_run, together=3)),
            {SECONDS: "one compiles, others wait", "wall time (s)": ""},
        ),
        "compare": Row(
            "`compare --quick`",
            command("compare", "--quick"),
            {SECONDS: "", "wall time (s)": "aim 30"},
            first=command("compare", "--quick"),
        ),
        "large-body": Row(
            f"equilibrium of {points**3:,} points, K = 100",
            **scene("bonded-block", large, {"spacing": 1 / 18, "solver.tolerance": 1e-2}),
            wanted={SECONDS: "aim 700", "memory (MB)": "not more", "evaluations": ""},
            turns=1,
        ),
    }


def table(row: Row, figures: tuple[dict[str, list], dict[str, list]]) -> list[list[str]]:
    """A line for each quantity: what, quantity, median of the old and of the new commit, median of the ratio, and what is wanted."""
    found = []
    for quantity in {**figures[0], **figures[1]}:
        both = [of.get(quantity, []) for of in figures]
        medians = [f"{median(values):.4g}" if values else "-" for values in both]
        ratios = [new / old for old, new in zip(*both, strict=False) if old]
        found.append([row.what, quantity, *medians, f"{median(ratios):.3f}" if ratios else "-", row.wanted.get(quantity, "")])
    return found


def put(commits: list[str], lines: list[list[str]]) -> None:
    """Put lines into the documentation, beside those of the same commits and processor that are there."""
    named = [
        subprocess.run(["git", "-C", str(ROOT), "rev-parse", "--short=8", one], check=True, capture_output=True, text=True).stdout.strip()
        for one in commits
    ]
    head = f"Processor: {processor()}, {os.cpu_count()} cores. Old: {named[0]}, new: {named[1]}."
    there = block("compare-commits")
    kept = [line[2:-2].split(" | ") for line in there.splitlines()[4:]] if there.startswith(head) else []
    measured = {(what, quantity): line for line in [*kept, *lines] for what, quantity in [line[:2]]}
    header = ["what", "quantity", "old", "new", "new / old", "wanted"]
    replace_block("compare-commits", f"{head}\n\n{markdown_table(header, list(measured.values()))}")


def main() -> None:
    known = rows(100)
    names = [*CHECKS, *known]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commits", nargs=2, metavar="COMMIT")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(names)}")
    parser.add_argument("--turns", type=int, help="of each commit, in the place of the usual number of each row")
    parser.add_argument("--points", type=int, default=100, help="points a side of large-body (100)")
    parser.add_argument("--docs", action="store_true", help="put the rows into the documentation")
    arguments = parser.parse_args()
    wanted = arguments.names or [name for name, row in known.items() if row.wanted and arguments.docs]
    if not wanted or set(wanted) - set(names):
        parser.error(f"name what to compare, of {', '.join(names)}")
    with checkouts(arguments.commits) as paths:
        for name in wanted:
            if name in CHECKS:
                CHECKS[name](paths)
                continue
            row = rows(arguments.points)[name]
            lines = table(row, row.compare(paths, arguments.turns))
            for what, quantity, old, new, ratio, goal in lines:
                print(f"{what:48} {quantity:46} {old:>10} {new:>10}   new/old {ratio:>6}   {goal}", flush=True)
            if arguments.docs:
                put(arguments.commits, [line for line in lines if line[1] in row.wanted])


CHECKS = {"figures": compare_figures, "conformance": compare_conformance}

if __name__ == "__main__":
    main()
