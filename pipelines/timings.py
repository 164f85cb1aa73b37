"""What force evaluations, runs and commands cost: on this checkout, or on two commits side by side.

python pipelines/timings.py tear cube                       costs, by names that `--help` lists
python pipelines/timings.py tear cube --commits OLD NEW     of two commits in turns, and their ratio
python pipelines/timings.py 6.2 6.7 --commits OLD NEW       with the figures of sections 6.2 to 6.7
python pipelines/timings.py properties --commits OLD NEW    what differs in required properties
python pipelines/timings.py scaling threads ranks --docs    tables, into the documentation

Commits are checked out into a temporary folder and run in processes of their own with this Python,
so that both must run on what is installed. Each goes first in every other turn; medians over the
turns are printed, and the median of the ratios within a turn. Caches are filled before the first
turn except where they are what is measured. Tables by the clock want two cores that nobody else
uses.
"""

import argparse
import itertools
import json
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
from cases import LISTED, measure, of_rows, scene_of, write_tables
from processes import NotRun, environment, spent

import pdsurrogate as pds

ROOT = Path(__file__).resolve().parents[1]

BIND = """
import json, os, resource, sys, time
from pathlib import Path
import numpy as np
import pdsurrogate as pds
from pdsurrogate.engine.threads import thread_count
sys.path.append("PIPELINES")  # of this checkout: another commit may have none
from clock import bench_positions
def lattice(sides, d):
    places = np.meshgrid(*[(np.arange(sides) + 0.5) / sides] * d, indexing="ij")
    return np.stack(places, axis=-1).reshape(-1, d)
def bind(name, width, precision=None):
    if width:
        body = pds.Body.rectangle(3.0, 1.0, 1 / width, 3.15 / width)
    else:
        points = lattice(20, 3)
        body = pds.Body(points, np.full(len(points), 20.0**-3), 1.75 / 20, 1 / 20)
    name, _, law = name.partition(" of ")
    card = next(Path().glob(f"art?facts/{name.partition('@')[0]}/1/card.json"), None)
    material = {"law": law or "neo-hookean"}
    if card:
        material = json.loads(card.read_text())["material"]["trained_with"]
    numbers = {key: tuple(v) if isinstance(v, list) else v for key, v in material.items()}
    law = pds.materials.LAWS[numbers.pop("law")](**numbers)
    settings = pds.ForceSettings(plane="stress" if width else "space", precision=precision)
    waves = 0.02 * np.sin(9 * body.points[:, ::-1])
    positions = bench_positions(body, law) if width else body.points * [1.3, 0.9, 0.87] + waves
    force, out = pds.load_surrogate(name).bind(body, law, settings), np.empty_like(body.points)
    def evaluate():
        force(positions, out)
        return out
    return evaluate, body.bonds.n_directed
""".replace("PIPELINES", str(Path(__file__).parent))
"""Start of the scripts that time force models: on a sheet with so many points across, or on a
cube of 8,000 points.
"""

SERVE = f"""{BIND}
bound = {{}}
for line in sys.stdin:
    *case, threads, seconds = json.loads(line)
    with thread_count(threads):
        evaluate, bonds = bound.get(str(case)) or bound.setdefault(str(case), bind(*case))
        for _ in range(3):
            evaluate()
        clock = time.process_time if threads == 1 else time.perf_counter
        count, began = 0, clock()
        while clock() - began < seconds:
            evaluate()
            count += 1
        print(json.dumps(1e9 * (clock() - began) / count / bonds), flush=True)
"""
"""Answers questions (force, points across, precision, threads, seconds) with nanoseconds per
directed bond, on one thread those of the processor.
"""

SIZE = f"""{BIND}
began = time.perf_counter()
bind("neo-hookean@1", json.loads(sys.argv[1]))[0]()
print(json.dumps({{"setup (s)": time.perf_counter() - began}}))
"""

RUN = """
import json, sys
import pdsurrogate as pds
scene, changes, force = json.loads(sys.argv[1])
result = pds.simulate(pds.load_scene(scene, changes), force)
summary, found = result.summary, {}
for level in result.levels:
    for key in ("nominal_stress", "nominal_stress_work_conjugate", "energy",
                "lateral_displacement", "greatest_lateral_displacement"):
        if key in level:
            found[f"{key} at {level['stretch']:g}"] = level[key]
if summary.get("crack"):
    found["broken bonds"] = summary["crack"]["broken_bonds"]
mpi = sys.modules.get("mpi4py.MPI")
if mpi is None or mpi.COMM_WORLD.rank == 0:
    seconds = summary["seconds_total"] - summary["seconds_compile"]
    found |= {"evaluations": summary["n_force_evaluations"], "run (s)": seconds}
    print(json.dumps(found))
"""

PROPERTIES = """
import json
from pdsurrogate.artifacts import load_surrogate
from pdsurrogate.forces import FORCES
from pdsurrogate.testing import FORCE_MODEL_PROPERTIES
from pdsurrogate.testing.checks import subject_of
found = {}
for name in (*FORCES, "neo-hookean", "neo-hookean-isochoric"):
    for plane in sorted({"stress", "space"} & {*load_surrogate(name).honors["plane"]}):
        subject = subject_of(name, plane=plane)
        for one in FORCE_MODEL_PROPERTIES:
            found[f"{name}, {plane}: {one.name}"] = one(subject).value
print(json.dumps(found))
"""

COMPILE = """
import json
import pdsurrogate as pds
runs = {"first run": (None, {})}
for force, law in (("bond-energy", "neo-hookean"), ("ba-nosb", "neo-hookean"),
                   ("analytic", "yeoh"), ("analytic", "ogden")):
    runs[f"then {force}, {law}"] = force, {"stretches": 1.2, "material": law}
found = {}
for name, (force, changes) in runs.items():
    result = pds.simulate(pds.load_scene("uniaxial", {"spacing": 0.1, **changes}), force)
    found[f"{name}: compiling (s)"] = result.summary["seconds_compile"]
print(json.dumps(found))
"""

RANK = """
import json, os, resource, sys, time
from pathlib import Path
import numpy as np
import pdsurrogate as pds
from pdsurrogate.artifacts import default_force
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.ranks import communicator
from pdsurrogate.run.run import Run
name, spacing, threads, evaluations = json.loads(sys.argv[1])
page = os.sysconf("SC_PAGE_SIZE") / 1e6
resident = lambda: int(Path("/proc/self/statm").read_text().split()[1]) * page
ranks, scene = communicator(), pds.load_scene(name, spacing=spacing)
bare, began = resident(), time.process_time()
run = Run(scene, checked_models(scene, default_force(scene)), None, threads)
set_up, held, part = time.process_time() - began, resident() - bare, run.body.share
positions, said = run.body.points.copy(), np.zeros(4)
forces = np.empty_like(positions)
if scene.stretched:
    run.loading.apply(1.05, run.force, positions)
for _ in range(3):
    run.force(positions, forces)
def timed(say):
    def and_timed(*arguments):
        began = time.thread_time(), time.perf_counter()
        try:
            return say(*arguments)
        finally:
            said[:2] += time.thread_time() - began[0], time.perf_counter() - began[1]
    return and_timed
def counted(exchange):
    def and_counted(outgoing, incoming):
        exchange(outgoing, incoming)
        said[2:] += 1, sum(rows.nbytes for rows in incoming.values())
    return and_counted
if part.divided:
    for way in ("fill", "fold", "agree", "any"):
        setattr(part, way, timed(getattr(part, way)))
    part.ranks.exchange = counted(part.ranks.exchange)
walls, worked = [], 0.0
for _ in range(evaluations):
    ranks.barrier()
    began, clock = time.process_time(), time.perf_counter()
    run.force(positions, forces)
    walls.append(time.perf_counter() - clock)
    worked += time.process_time() - began
own = int(part.own.sum()) if part.divided else len(run.body)
most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
row = [own, len(run.body) - own, 1e3 * (worked - said[0]) / evaluations]
row += [*said[2:] / evaluations, set_up, held, most - bare]
row += [1e3 * float(np.median(walls)), said[1] / sum(walls)]
rows = ranks.everywhere(row) if ranks.size > 1 else [row]
if ranks.rank == 0:
    print(json.dumps({"points": part.size, "of": np.max(rows, axis=0).tolist()}))
"""
"""Greatest figures of the ranks: own and halo points, processor time (ms) without what ranks say,
exchanges, bytes, setup (s), memory held and at most (MB), wall time (ms), share of what ranks say.
"""


@contextmanager
def server(path, **variables):
    """Context with a function that asks a process of a checkout, which stays alive, for the cost
    of a force.
    """
    command = [sys.executable, "-c", SERVE]
    process = subprocess.Popen(
        command, cwd=path, env=environment(path, **variables), stdin=-1, stdout=-1, text=True
    )

    def ask(*question):
        print(json.dumps(question), file=process.stdin, flush=True)
        if not (answer := process.stdout.readline()):
            raise NotRun("a process ended without an answer; what it said is above")
        return json.loads(answer)

    try:
        yield ask
    finally:
        process.kill()
        process.wait()


@dataclass(frozen=True)
class Cost:
    """Cost of a process: words after ``python``, arguments of `spent`, turns, and what to do
    before (run once, or empty the caches).
    """

    words: tuple[str, ...]
    turns: int = 3
    first: tuple[str, ...] | None = None
    empty: bool = False
    together: int = 1
    status: int = 0
    ranks: int = 0

    def __call__(self, path):
        if self.empty:
            for cache in path.rglob("__pycache__"):
                shutil.rmtree(cache)
        return spent(
            path, *self.words, ranks=self.ranks, together=self.together, status=self.status
        )

    def prepare(self, path):
        """Fill the caches."""
        if not self.empty:
            spent(path, *(self.first or self.words), ranks=self.ranks, status=self.status)


def run(scene, changes=None, coarse=None, force=None, without=(), **more):
    """Cost of a run, of a scene without some of its keys; one with `coarse` changes fills the
    caches.
    """
    usual = {**(changes or {}), **dict.fromkeys(without)}
    words = [
        ("-c", RUN, json.dumps([scene, {**usual, **other}, force])) for other in ({}, coarse or {})
    ]
    return Cost(words[0], first=words[1], **more)


def command(*words, **more):
    """Cost of a command of the package."""
    return Cost(("-m", "pdsurrogate", *words), **{"turns": 9, **more})


SMALL_RUN = "run", "uniaxial", "--set", "spacing=0.1"
COSTS = {name: run(**case) for name, case in LISTED["costs"].items()} | {
    "help": command("--help"),
    "refused": command("run", "uniaxial", "--set", "spacings=0.1", status=2),
    "small-run": command(*SMALL_RUN),
    "pictures": command(*SMALL_RUN, "--out", "small-run", "--overwrite"),
    "compile": Cost(("-c", COMPILE), empty=True),
    "properties": Cost(("-c", PROPERTIES), turns=1),
    "three": command(*SMALL_RUN, together=3, empty=True, turns=3),
}
"""Costs by name. Blocks on ranks are nearly incompressible, of 864 points; the trouser tear has its
critical stretch, since fracture energies are calibrated anew from time to time.
"""

FORCES = [
    (name, width, None, threads)
    for names, widths in (
        (
            (
                "neo-hookean neo-hookean-paper neo-hookean-energy analytic nosb ba-nosb bond-energy"
                " gent ogden full-network"
            ),
            (10, 50, 163),
        ),
        (
            (
                "bond-energy nosb neo-hookean-isochoric ogden-isochoric full-network-isochoric"
                " arruda-boyce-isochoric"
            ),
            (0,),
        ),
    )
    for width in widths
    for name in names.split()
    for threads in (1, 2)
]
"""Force models on sheets of 300, 7,500 and 79,707 points and on a cube, on one thread and on
two; `forces` times them.
"""


@contextmanager
def checkouts(references):
    """Context with a folder for each commit."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / str(number) for number in range(len(references))]
        for path, reference in zip(paths, references, strict=True):
            subprocess.run(
                ["git", "-C", ROOT, "worktree", "add", "--detach", path, reference],
                check=True,
                capture_output=True,
            )
        try:
            yield paths
        finally:
            for path in paths:
                subprocess.run(
                    ["git", "-C", ROOT, "worktree", "remove", "--force", path],
                    check=False,
                    capture_output=True,
                )


def in_turns(paths, turns, measure):
    """Figures of all turns by quantity, of each checkout; each goes first in every other turn."""
    figures, gone = [{} for _ in paths], set()
    for turn in range(turns):
        for which in list(range(len(paths)))[:: 1 if turn % 2 else -1]:
            try:
                for quantity, value in (measure(which) if which not in gone else {}).items():
                    figures[which].setdefault(quantity, []).append(value)
            except NotRun as error:
                gone.add(which)
                print(f"    {paths[which]} did not run: {error}", flush=True)
    return figures


def show(name, figures):
    """Print the medians of each quantity, and the median of the ratios of two commits."""
    for quantity in dict.fromkeys(key for of in figures for key in of):
        values = [of.get(quantity, []) for of in figures]
        medians = "".join(f"{median(one):>12.5g}" if one else f"{'-':>12}" for one in values)
        ratios = (
            [new / old for old, new in zip(*values, strict=False) if old]
            if len(values) == 2
            else []
        )
        print(
            f"{name:20} {quantity:50} {medians}"
            + (f"   new/old {median(ratios):.3f}" if ratios else ""),
            flush=True,
        )


def costs(names, paths, turns):
    """Costs by name, of one checkout or of two."""
    for name in names:
        if name == "forces":
            for _ in range(2):  # where memory lies counts
                with ExitStack() as servers:
                    asks = [servers.enter_context(server(path)) for path in paths]
                    for case in FORCES:
                        found = in_turns(
                            paths,
                            turns or 4,
                            lambda which, case=case, asks=asks: {
                                str(case): asks[which](*case, 0.06)
                            },
                        )
                        show(name, found)
        else:
            cost = COSTS[name]
            for path in paths:
                cost.prepare(path)
            show(
                name,
                in_turns(paths, turns or cost.turns, lambda which, cost=cost: cost(paths[which])),
            )


def of_sizes():
    """Cost per directed bond, setup and memory of the default surrogate by the size of a sheet."""
    from clock import TimedModel, measure_speed

    widths = (18, 58, 183, 577)
    bodies = [pds.Body.rectangle(3.0, 1.0, 1 / width, 3.15 / width) for width in widths]
    model = pds.load_surrogate("neo-hookean@1")
    measured = measure_speed(
        [TimedModel(model, "float32", body) for body in bodies], pds.materials.NeoHookean()
    )
    for width, body, cost in zip(widths, bodies, measured, strict=True):
        found = spent(ROOT, "-c", SIZE, str(width))
        ns = (cost[f"ns_per_directed_bond_{on}"] for on in ("1", "all"))
        memory = found["memory (MB)"] / 1024
        yield len(body), body.bonds.n_directed, *ns, found["setup (s)"], memory


def of_runs():
    """Whole runs of `uniaxial` to 1.05 with the default force, on one thread."""
    for spacing in (0.02, 0.00707, 0.00346, 0.00173):
        words = json.dumps(["uniaxial", {"spacing": spacing, "stretches": 1.05}, None])
        found = spent(ROOT, "-c", RUN, words, NUMBA_NUM_THREADS="1", OMP_NUM_THREADS="1")
        points = round(1 / spacing) * round(3 / spacing)
        seconds = found["processor time (s)"]
        yield points, found["evaluations"], seconds, 1e6 * seconds / points, found["memory (MB)"]


def of_space():
    """Force models of solids on one thread: exact energies of all laws, learned ones, and NOSB;
    the least of twenty turns.
    """
    from pdsurrogate.artifacts import list_artifacts, load_card
    from pdsurrogate.forces.settings import PRECISIONS

    cases = {"NOSB": ("nosb", 0, None)} | {
        f"exact, {law}": (f"bond-energy of {law}", 0, None) for law in pds.materials.LAWS
    }
    for folder in list_artifacts():
        if load_card(folder).kind == pds.forces.IsochoricNetwork.kind:
            cases |= {
                f"learned, {load_card(folder).material.law}, {one}": (folder.parent.name, 0, one)
                for one in PRECISIONS
            }
    with server(ROOT) as ask:
        least = {name: min(ask(*case, 1, 0.1) for _ in range(20)) for name, case in cases.items()}
    learned = least["learned, neo-hookean, float32"]
    for name, ns in least.items():
        yield name, ns, ns / least["NOSB"], ns / learned


def of_memory():
    """Branches and softening: evaluations and steps of bodies with up to four branches, in turns on
    one thread; medians of processor time, and what each takes of memory.
    """
    import tracemalloc

    from clock import spent_by, waved_block

    from pdsurrogate.engine.threads import thread_count
    from pdsurrogate.materials import Branch, Memory, NeoHookean, Softening

    memories = [Memory(tuple(Branch(1.0, 4.0**k) for k in range(n))) for n in (0, 1, 4)]
    memories += [Memory(softening=Softening(1.5, 0.1, 0.1)), memories[1]]
    for plane, sides in (("strain", (90, 90)), ("stress", (90, 90)), ("space", (20, 20, 20))):
        body, first, last, _ = waved_block(sides)
        out, forces, held = np.empty_like(first), [], []
        for number, memory in enumerate(memories):
            tracemalloc.start()
            settings = pds.ForceSettings(plane=plane, paths=number == 4)
            law = NeoHookean(bulk_modulus=100.0, memory=memory)
            force = pds.BondEnergyForce().bind(body, law, settings)
            held.append(tracemalloc.get_traced_memory()[0] / len(body) / 1e3)
            tracemalloc.stop()
            force.elapse(0.3)
            force(first, out)
            force.accept(first)
            forces.append(force)
        evaluations, steps = np.empty((2, 60, len(memories)))
        with thread_count(1):
            for turn, (number, force) in itertools.product(range(60), enumerate(forces)):
                force.elapse(0.2)
                force(last, out)
                evaluations[turn, number] = spent_by(force, last, out)
                began = time.thread_time_ns()
                force.accept(last)
                force.elapse(0.2, 0.2)
                force(last, out)
                steps[turn, number] = time.thread_time_ns() - began
        evaluation, step = (np.median(one, axis=0) for one in (evaluations, steps))
        ratio = evaluation / evaluation[0]
        yield (
            plane,
            evaluation[0] / len(body.bonds.first),
            *(ratio[1] - 1, (ratio[2] - ratio[1]) / 3, ratio[3] - 1),
            *((step - evaluation)[1:] / evaluation[1:]),
            *(held[1] - held[0], (held[2] - held[1]) / 3, held[3] - held[0], held[4] - held[1]),
        )


def of_steps():
    """Steps of dynamics of a sheet with a hole and a cut, in plane strain and `bond-energy`, and
    evaluations of their force, in turns on one thread; medians of processor time.
    """
    from pdsurrogate.engine.threads import thread_count
    from pdsurrogate.problem.materials import checked_models
    from pdsurrogate.run.interruption import Interrupted
    from pdsurrogate.run.run import Run
    from pdsurrogate.run.stages import ready
    from pdsurrogate.run.transient import Transient

    low, high = {"x1": 0.0, "x2": 0.0}, {"x1": 0.0, "x2": 0.003}
    supports = {
        "points": {"low": low, "high": high},
        "planes of symmetry": {"left": {"x1": 0.0}, "bottom": {"x2": 0.0}, "top": {"x2": 0.003}},
        "grips": {"bottom": low, "top": high},
    }

    class Until:
        """The interruption of a run after so many steps."""

        asked = property(lambda self: stage.integrator.steps >= self.last)

    for spacing, steps in ((0.0512, 200), (0.0155, 40), (0.0049, 20)):
        for name, held in supports.items():
            prescribed = [{"region": region, **values} for region, values in held.items()]
            scene = scene_of("held-sheet", {"spacing": spacing, "prescribed": prescribed})
            run = Run(scene, checked_models(scene, pds.load_surrogate("bond-energy")), threads=1)
            stage = Transient(run, run.stages[0], ready(run, False)[1])
            run.interruption = Until()
            found, out = [], np.empty_like(run.positions)
            with thread_count(1):
                stage.begin()
                for _ in range(10):
                    run.interruption.last = stage.integrator.steps + steps
                    began, before = time.process_time(), run.force.evaluations
                    with suppress(Interrupted):
                        stage.go()
                    took = (time.process_time() - began) / steps
                    count = (run.force.evaluations - before) / steps
                    began = time.process_time()
                    for _ in range(steps // 4):
                        run.force(run.positions, out)
                    found.append((took, (time.process_time() - began) / (steps // 4), count))
            step, force, _ = np.median(found[1:], axis=0)
            evaluations = np.mean(found[1:], axis=0)[2]
            yield name, len(run.body), 1e6 * force, 1e6 * step, step / force, evaluations


WAITING = {
    "two threads, default of GNU OpenMP": (2, {"GOMP_SPINCOUNT": "300000"}),
    "two threads, 1,000 loops (pdsurrogate)": (2, {"GOMP_SPINCOUNT": "1000"}),
    "two threads, 100 loops": (2, {"GOMP_SPINCOUNT": "100"}),
    "two threads that sleep immediately": (2, {"OMP_WAIT_POLICY": "passive"}),
    "one thread": (1, {}),
}
"""Number of threads, and the variables that say how they wait."""

WIDTHS = (10, 20, 50, 163)


def of_threads():
    """Cost of an evaluation by how threads wait, on free cores and beside other processes;
    medians of fresh processes.
    """
    found = {(setting, others): [] for setting in WAITING for others in (0, 1, 2)}
    for setting, others in [*found] * 4:
        threads, variables = WAITING[setting]
        busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(others)]
        try:
            with server(ROOT, NUMBA_NUM_THREADS="2", **variables) as ask:
                found[setting, others].append(
                    [ask("neo-hookean", width, None, threads, 0.4) for width in WIDTHS]
                )
        finally:
            for process in busy:
                process.kill()
                process.wait()
    for setting in WAITING:
        medians = (np.median(found[setting, others], axis=0).tolist() for others in (0, 1, 2))
        yield setting, *medians


def on_ranks(name, points, ranks, threads=1):
    """The figures of `RANK` for a scene with about so many points."""
    scene = pds.load_scene(name)
    lower, upper = map(np.array, scene.body.bounds())
    spacing = (
        (np.prod(upper - lower) - sum(np.pi * hole.radius**2 for hole in scene.holes)) / points
    ) ** (1 / len(lower))
    variables = {"NUMBA_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads)}
    words = json.dumps([name, float(f"{spacing:.5g}"), threads, 20])
    return spent(ROOT, "-c", RANK, words, ranks=ranks, **variables)


def of_ranks():
    """Bodies of two sizes on one, two and four ranks."""
    for points in (100_000, 1_000_000):
        for ranks in (1, 2, 4):
            found = on_ranks("hole", points, ranks)
            own, halo, ms, exchanges, received, *memory = found["of"][:8]
            yield found["points"], ranks, own, halo, ms, exchanges, received / 1e3, *memory


def against_threads():
    """One process of two threads against two ranks of one, by the clock."""
    for name in ("hole", "bonded-block"):
        found = [[on_ranks(name, 100_000, *kind) for kind in ((1, 2), (2, 1))] for _ in range(3)]
        threads, ranks = (median(run["of"][8] for run in kind) for kind in zip(*found, strict=True))
        share = median(run["of"][9] for _, run in found)
        yield f"`{name}`", found[0][0]["points"], threads, ranks, ranks / threads, share


def small_bodies():
    """One rank against two on small bodies."""
    for sides in ((12, 9, 8), (20, 20, 20), (32, 25, 25), (31, 31, 31), (36, 36, 35)):
        for bulk_modulus in (100.0, 1000.0):
            size = [0.1 * side for side in sides]
            changes = LISTED["costs"]["one-rank"]["changes"] | {
                "body.size": size,
                "body.lower": [0.0, -size[1] / 2, -size[2] / 2],
                "material.bulk_modulus": bulk_modulus,
            }
            words = json.dumps(["bonded-block", changes, None])
            found = [
                [spent(ROOT, "-c", RUN, words, ranks=ranks) for ranks in (1, 2)]
                for _ in range(3 if np.prod(sides) < 1e4 else 1)
            ]
            alone, two = (
                median(run["run (s)"] for run in kind) for kind in zip(*found, strict=True)
            )
            evaluations = [run["evaluations"] for run in found[0]]
            yield int(np.prod(sides)), bulk_modulus, alone, two, two / alone, evaluations


def of_parts():
    """How evenly bisection cuts bodies into parts, and how large the halos are."""
    from scipy.spatial import cKDTree

    from pdsurrogate.discretization import discretize
    from pdsurrogate.ranks import bisected, bond_counts

    sheet = discretize(pds.load_scene("hole", spacing=0.0107))[0]
    cube = np.stack(np.meshgrid(*[np.arange(50) + 0.5] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for name, points, horizon in (
        ("sheet with a hole", sheet.points, sheet.horizon),
        ("cube", cube, 1.75),
    ):
        weights, reach = bond_counts(points, horizon), horizon * (1 + 1e-9)
        for parts in (2, 4, 8, 16, 32, 64):
            owners = bisected(points, weights, parts)
            bonds, own, halo = np.bincount(owners, weights), np.bincount(owners), []
            for part in range(parts):
                distance, _ = cKDTree(points[owners == part]).query(
                    points, distance_upper_bound=reach
                )
                halo.append(int(np.count_nonzero(np.isfinite(distance)) - own[part]))
            shares = bonds.max() / bonds.mean(), max(halo) / np.mean(halo), max(halo) / own.mean()
            yield f"{name}, {len(points):,} points", parts, own.mean(), *shares


FORMS = """
import importlib.util, json, resource, sys, time
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
spec = importlib.util.spec_from_file_location("law", sys.argv[1])
spec.loader.exec_module(law := importlib.util.module_from_spec(spec))
d = 3 if hasattr(law, "volumetric") else 2
body = (mesh.create_unit_cube if d == 3 else mesh.create_unit_square)(MPI.COMM_WORLD, *[1] * d)
V = fem.functionspace(body, ("Lagrange", 2, (d,)))
u, v, du = fem.Function(V), ufl.TestFunction(V), ufl.TrialFunction(V)
F, dx = ufl.Identity(d) + ufl.grad(u), ufl.dx(metadata={"quadrature_degree": 4})
began = time.process_time()
fem.form(ufl.inner(law.stress(F), ufl.grad(v)) * dx)
fem.form(ufl.inner(law.tangent(F, ufl.grad(du)), ufl.grad(v)) * dx)
code = time.process_time() - began
own, C = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
memory = max(own.ru_maxrss, C.ru_maxrss) / 1024
print(json.dumps({"of": [code, C.ru_utime + C.ru_stime, memory]}))
"""
"""Compiles stress and tangent of an exported file for quadratic tetrahedra or triangles: seconds of
DOLFINx and of the C compiler, and MB.
"""


def of_forms():
    """Exported UFL in DOLFINx, which `.ci/solvers` installs."""
    from pdsurrogate.artifacts.places import SHIPPED
    from pdsurrogate.export import exported, file_name, source_of_artifact, source_of_law

    place = ROOT / "build" / "dolfinx"
    learned = (source_of_artifact(path.name) for path in sorted(SHIPPED[1].iterdir()))
    laws = (source_of_law(law()) for law in pds.materials.LAWS.values())
    for source in (*laws, *(one for one in learned if one.network is not None)):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / file_name(source, "ufl")
            path.write_text(exported(source, "ufl"))
            variables = {"XDG_CACHE_HOME": folder, "LD_LIBRARY_PATH": str(place / "lib")}
            python = (str(place / "bin" / "python"),)
            run = spent(ROOT, "-c", FORMS, str(path), python=python, **variables)
        yield f"`{source.title}`", *run["of"]


TABLES = {
    name: of_rows(name, measure)
    for name, measure in {
        "scaling": of_sizes,
        "speed-in-space": of_space,
        "memory": of_memory,
        "forms": of_forms,
        "steps": of_steps,
        "threads": of_threads,
        "runs": of_runs,
        "ranks": of_ranks,
        "against-threads": against_threads,
        "small-bodies": small_bodies,
        "parts": of_parts,
    }.items()
}
"""Tables of this checkout, by the names of their blocks in the documentation."""


def main():
    others = ["forces", *COSTS]
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "names",
        nargs="+",
        metavar="NAME",
        help=f"costs: {', '.join(others)}; tables: {', '.join(TABLES)}",
    )
    parser.add_argument(
        "--commits",
        nargs=2,
        metavar=("OLD", "NEW"),
        help="compare two commits; by default this checkout is measured",
    )
    parser.add_argument("--turns", type=int, help="in the place of the usual number")
    parser.add_argument("--docs", action="store_true", help="put tables into the documentation")
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - {*others, *TABLES}:
        parser.error(
            f"unknown: {', '.join(sorted(unknown))}; there are {', '.join([*others, *TABLES])}"
        )
    names = [name for name in arguments.names if name not in TABLES]
    if names and arguments.commits:
        with checkouts(arguments.commits) as paths:
            costs(names, paths, arguments.turns)
    elif names:
        costs(names, [ROOT], arguments.turns)
    for name in [name for name in arguments.names if name in TABLES]:
        measure(TABLES[name], "")
        if arguments.docs:
            write_tables(TABLES[name])


if __name__ == "__main__":
    main()
