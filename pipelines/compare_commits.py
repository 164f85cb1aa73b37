"""Two commits side by side: the same figures, the cost of every force model, and the time to compile it.

python pipelines/compare_commits.py OLD NEW --figures     sections 6.2 to 6.7, tears at a coarser spacing
python pipelines/compare_commits.py OLD NEW --conformance every property and hard case of every force model, with few explicit steps
python pipelines/compare_commits.py OLD NEW --speed       every force model in sheets and in a solid, on one thread and on two, in turns
python pipelines/compare_commits.py OLD NEW --materials   bodies of two materials, in sheets and in solids, in turns, and their memory
python pipelines/compare_commits.py OLD NEW --runs        whole runs of sections 6.2 and 6.5, in turns
python pipelines/compare_commits.py OLD NEW --compile     first evaluation and first run with an empty cache
python pipelines/compare_commits.py OLD NEW --start       processor time of the help, of a refused scene and of a small run, in turns

Each commit is checked out into a temporary folder and run there in processes of its own with this Python, so that both must run on what is
installed.  Costs are medians over turns in which both commits are timed one after the other.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path
from statistics import median

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

STARTS = 3
"""How often the processes are started in which costs are compared."""

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
from pdsurrogate.stress_test.report import stress_test
models = stress_test(quick=True)["models"]
print(json.dumps({
    f"{model['force']}{', space' if model.get('plane') == 'space' else ''}: {case}": [result["verdict"], result["value"], result["limit"]]
    for model in models for case, result in model["results"].items()
}), flush=True)
"""

SPEED = """
import json, sys, time
from pathlib import Path
import numba, numpy as np
import pdsurrogate as pds
from pdsurrogate.reports.speed import bench_positions
bound, bodies = {}, {}
def sheet(width):
    return pds.Body.rectangle(3.0, 1.0, 1 / width, 3.15 / width)
def solid():
    middles = (np.arange(20) + 0.5) / 20
    points = np.stack(np.meshgrid(middles, middles, middles, indexing="ij"), axis=-1).reshape(-1, 3)
    return pds.Body(points, np.full(len(points), 20.0**-3), 2.2 / 20)
for line in sys.stdin:
    name, width, threads = json.loads(line)
    numba.set_num_threads(threads)
    if (name, width, threads) not in bound:
        if width not in bodies:
            bodies[width] = sheet(width) if width else solid()
        body = bodies[width]
        model = pds.load_surrogate(name)
        card = Path("artifacts") / name / "1" / "card.json"
        material = json.loads(card.read_text())["material"]["trained_with"] if card.exists() else {"law": "neo-hookean"}
        law = pds.materials.LAWS[material.pop("law")](**{key: tuple(v) if isinstance(v, list) else v for key, v in material.items()})
        if width:
            settings, positions = pds.ForceSettings(), bench_positions(body, law)
        else:
            settings = pds.ForceSettings(plane="space")
            positions = body.points * [1.3, 0.9, 0.87] + 0.02 * np.sin(9 * body.points[:, [1, 2, 0]])
        force = model.bind(body, law, settings)
        bound[name, width, threads] = force, positions, np.empty_like(body.points), body.bonds.n_directed
        for _ in range(3):
            force(*bound[name, width, threads][1:3])
    force, positions, out, bonds = bound[name, width, threads]
    count, began = 0, time.perf_counter()
    while time.perf_counter() - began < 0.08:
        force(positions, out)
        count += 1
    print(json.dumps(1e9 * (time.perf_counter() - began) / count / bonds), flush=True)
"""

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

LARGEST = "bond-energy", "space", 24
"""Body of two materials whose memory is compared."""

HALVES = """
import json, resource, sys, time
import numba, numpy as np
import pdsurrogate as pds
from pdsurrogate.forces import Portion, bind_portions
numba.set_num_threads(1)
def forces(name, plane, width, which):
    d = 3 if plane == "space" else 2
    middles = (np.arange(width) + 0.5) / width
    points = np.stack(np.meshgrid(*[middles] * d, indexing="ij"), axis=-1).reshape(-1, d)
    body = pds.Body(points, np.full(len(points), width ** -float(d)), (2.2 if d == 3 else 3.15) / width)
    model = pds.forces.FORCES[name]() if name in pds.forces.FORCES else pds.load_surrogate(name)
    stiff = points[:, 0] > 0.5
    laws = [pds.materials.NeoHookean(mu, 100 * mu) for mu in (1.0, 3.0)]
    portions = [Portion(law, model, np.flatnonzero(where)) for law, where in zip(laws, (~stiff, stiff))]
    settings = pds.ForceSettings(plane=plane)
    positions = points * np.array([1.1, 0.97, 0.95][:d])
    bind = {"one": lambda: model.bind(body, laws[0], settings), "two": lambda: bind_portions(body, portions, settings)}
    return [bind[each]() for each in which], positions, np.empty_like(points), body.bonds.n_directed
"""
"""Start of the scripts about bodies of two materials."""

EVALUATION = f"""{HALVES}
bound = {{}}
for line in sys.stdin:
    case = tuple(json.loads(line))
    if case not in bound:
        bound[case] = forces(*case, ("one", "two"))
        for force in bound[case][0]:
            for _ in range(3):
                force(*bound[case][1:3])
    both, positions, out, bonds = bound[case]
    least = [np.inf, np.inf]
    for _ in range(20):
        for number, force in enumerate(both):
            began = time.thread_time()
            force(positions, out)
            least[number] = min(least[number], time.thread_time() - began)
    print(json.dumps([1e9 * seconds / bonds for seconds in least]), flush=True)
"""

MEMORY = f"""{HALVES}
for line in sys.stdin:
    (force,), positions, out, _ = forces(*json.loads(line), ("two",))
    force(positions, out)
    print(json.dumps(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024), flush=True)
"""

WHOLE = """
import json, sys
import pdsurrogate as pds
for line in sys.stdin:
    scene, changes = json.loads(line)
    summary = pds.simulate(pds.load_scene(scene, changes)).summary
    print(json.dumps(summary["seconds_total"] - summary["seconds_compile"]), flush=True)
"""

COMPILE = """
import json, sys, time
import pdsurrogate as pds
result = pds.simulate(pds.load_scene("uniaxial", {"spacing": 0.1}), None)
print(json.dumps(result.summary["seconds_compile"]), flush=True)
for name, law in (("bond-energy", "neo-hookean"), ("ba-nosb", "neo-hookean"), ("analytic", "yeoh"), ("analytic", "ogden")):
    result = pds.simulate(pds.load_scene("uniaxial", {"spacing": 0.1, "stretches": 1.2, "material": law}), name)
    print(json.dumps(result.summary["seconds_compile"]), flush=True)
"""

COMPILED = ("default run", "then bond-energy", "then ba-nosb", "then analytic, yeoh", "then analytic, ogden")


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


def start(path: Path, script: str) -> subprocess.Popen:
    """A process that runs a script on one of the checkouts."""
    # Threads that turn for milliseconds after their work would take the cores from the process whose turn is next.
    environment = {"GOMP_SPINCOUNT": "1000", **os.environ, "PYTHONPATH": str(path)}
    command = [sys.executable, "-c", script]
    return subprocess.Popen(command, cwd=path, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def ask(process: subprocess.Popen, question=None):
    """One answer of a process, as JSON."""
    if question is not None:
        process.stdin.write(json.dumps(question) + "\n")
        process.stdin.flush()
    answer = process.stdout.readline()
    if not answer:
        raise SystemExit("a process ended without an answer; what it said is above")
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


def compare_speed(paths: list[Path], turns: int) -> None:
    """Medians of the cost of a directed bond, and of the ratio within a turn.

    Both processes are started anew a few times, since where memory lies counts, and each goes first in every other turn.
    """
    cases = [(name, width, threads) for width in WIDTHS for name in SHEETS for threads in (1, 2)]
    cases += [(name, 0, threads) for name in SOLIDS for threads in (1, 2)]
    pairs = {case: [] for case in cases}
    for _ in range(STARTS):
        both = [start(path, SPEED) for path in paths]
        for case in cases:
            for turn in range(turns):
                order = (0, 1) if turn % 2 else (1, 0)
                costs = {which: ask(both[which], case) for which in order}
                pairs[case].append((costs[0], costs[1]))
        for process in both:
            process.kill()
            process.wait()
    print(f"{'model':24} {'points':>7} {'threads':>7} {'old':>8} {'new':>8} {'new/old':>8}   ns per directed bond")
    for (name, width, threads), found in pairs.items():
        ratio = median(new / old for old, new in found)
        old, new = (median(values) for values in zip(*found, strict=True))
        points = 3 * width * width if width else 8000
        print(f"{name:24} {points:7} {threads:7} {old:8.2f} {new:8.2f} {ratio:8.3f}", flush=True)


def compare_materials(paths: list[Path], turns: int) -> None:
    """Medians of the cost of a directed bond in bodies of two materials on one thread, and of the ratio to the same body of one material.

    The bodies take turns in one process; each cost is the least processor time of twenty evaluations. The greatest memory of a process that
    binds and evaluates the force of one body of two materials is compared as well.
    """
    both = [start(path, EVALUATION) for path in paths]
    columns = f"{'old, one':>8} {'two':>8} {'ratio':>6} {'new, one':>10} {'two':>8} {'ratio':>6}"
    print(f"{'model':24} {'plane':8} {'points':>7} {columns}   ns per directed bond")
    for case in MATERIALS:
        found = ([], [])
        for turn in range(turns):
            for which in (0, 1) if turn % 2 else (1, 0):
                found[which].append(ask(both[which], case))
        text = f"{case[0]:24} {case[1]:8} {case[2] ** (3 if case[1] == 'space' else 2):7}"
        for costs, gap in zip(found, ("", "  "), strict=True):
            one, two = (median(values) for values in zip(*costs, strict=True))
            text += f"{gap} {one:8.2f} {two:8.2f} {median(b / a for a, b in costs):6.2f}"
        print(text, flush=True)
    old, new = (median(ask(start(path, MEMORY), LARGEST) for _ in range(STARTS)) for path in paths)
    print(f"greatest memory of {LARGEST[0]} with {LARGEST[2] ** 3} points of two materials: {old:.0f} MB, {new:.0f} MB", flush=True)


def compare_runs(paths: list[Path], turns: int) -> None:
    """Medians of the seconds that whole runs take, and of the ratio within a turn; each process goes first in every other turn."""
    both = [start(path, WHOLE) for path in paths]
    for section, question in {"6.2": ("uniaxial", {}), "6.5": ("tear", {"spacing": 0.1})}.items():
        for process in both:
            ask(process, question)
        found = []
        for turn in range(turns):
            order = (0, 1) if turn % 2 else (1, 0)
            seconds = {which: ask(both[which], question) for which in order}
            found.append((seconds[0], seconds[1]))
        old, new = (median(values) for values in zip(*found, strict=True))
        print(f"{section:6} {old:8.3f} {new:8.3f} s   new/old {median(b / a for a, b in found):.3f}", flush=True)


def compare_compile(paths: list[Path], turns: int) -> None:
    """Medians of the seconds spent compiling in a process that finds no cache."""
    found = {path: [] for path in paths}
    for _ in range(turns):
        for path in paths:
            for cache in path.rglob("__pycache__"):
                shutil.rmtree(cache)
            process = start(path, COMPILE)
            found[path].append([ask(process) for _ in COMPILED])
    for number, what in enumerate(COMPILED):
        old, new = (median(row[number] for row in found[path]) for path in paths)
        print(f"{what:24} {old:8.1f} {new:8.1f} s")


STARTED = {
    "help": ["--help"],
    "scene that is refused": ["run", "uniaxial", "--set", "spacings=0.1"],
    "run of 300 points": ["run", "uniaxial", "--set", "spacing=0.1"],
}
"""Arguments of the command whose processor time is compared."""


def compare_start(paths: list[Path], turns: int) -> None:
    """Medians of the processor seconds of whole commands, in the user's and in the system's time, with warm caches.

    The bytecode of both checkouts is written first, as an installation writes it.
    """
    for path in paths:
        written = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
        subprocess.run([sys.executable, "-m", "compileall", "-q", "pdsurrogate"], cwd=path, env=written, check=True)
    for what, words in STARTED.items():
        found = {path: [] for path in paths}
        for turn in range(turns + 1):
            for path in paths:
                before = resource.getrusage(resource.RUSAGE_CHILDREN)
                environment = {**os.environ, "PYTHONPATH": str(path)}
                subprocess.run([sys.executable, "-m", "pdsurrogate", *words], cwd=path, env=environment, capture_output=True, check=False)
                after = resource.getrusage(resource.RUSAGE_CHILDREN)
                if turn:  # the first one fills the caches
                    found[path].append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        old, new = (median(found[path]) for path in paths)
        ratio = median(b / a for a, b in zip(*(found[path] for path in paths), strict=True))
        print(f"{what:24} {old:8.2f} {new:8.2f} s   new/old {ratio:.3f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("commits", nargs=2, metavar="COMMIT")
    parser.add_argument("--figures", action="store_true")
    parser.add_argument("--conformance", action="store_true")
    parser.add_argument("--speed", action="store_true")
    parser.add_argument("--materials", action="store_true")
    parser.add_argument("--runs", action="store_true")
    parser.add_argument("--compile", action="store_true")
    parser.add_argument("--start", action="store_true")
    parser.add_argument("--turns", type=int, default=15)
    arguments = parser.parse_args()
    with checkouts(arguments.commits) as paths:
        if arguments.figures:
            compare_figures(paths)
        if arguments.conformance:
            compare_conformance(paths)
        if arguments.speed:
            compare_speed(paths, arguments.turns)
        if arguments.materials:
            compare_materials(paths, arguments.turns)
        if arguments.runs:
            compare_runs(paths, arguments.turns)
        if arguments.compile:
            compare_compile(paths, min(arguments.turns, 5))
        if arguments.start:
            compare_start(paths, arguments.turns)


if __name__ == "__main__":
    main()
