"""What ranks cost and save, into the documentation: all tables, or those that are named.

    python pipelines/ranks.py [ranks] [parts] [weak] [against-threads] [--points 100000 1000000] [--ranks 1 2 4]
    python pipelines/ranks.py small-bodies [--sides 12x9x8 20x20x20]

`ranks`: processor time and memory of each, and its exchanges.  Not time on the wall: it may be measured beside other work, where ranks that
wait for one another tell nothing.  `parts`, `weak`: how evenly parts are cut.  `against-threads`: two ranks against two threads by
the clock, and the share of exchanges in it, which wants two cores that nobody else uses, for some four minutes.  `small-bodies`: one
rank against two by the clock, with threads as the package chooses them, on two cores that nobody else uses, for some five minutes.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from pages import markdown_table, replace_block
from scipy.spatial import cKDTree

from pdsurrogate.artifacts import default_force
from pdsurrogate.discretization import discretize
from pdsurrogate.engine.threads import thread_count
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.ranks import bisected, bond_counts, communicator
from pdsurrogate.run import waiting
from pdsurrogate.run.run import Run
from pdsurrogate.run.simulate import simulate
from pdsurrogate.scenes import load_scene

EVALUATIONS = 20
PARTS = 2, 4, 8, 16, 32, 64


TURNS = 3
"""Processes of each kind, one after the other, so that what else the machine does meets all alike."""

SMALL = "12x9x8", "20x20x20", "32x25x25", "31x31x31", "36x36x35"
"""Points along the sides of nearly incompressible blocks: 864, 8,000, 20,000, 29,791 and 45,360 points."""

REPEATED = 10_000
"""Number of points up to which runs of the table `small-bodies` are repeated `TURNS` times: they take seconds."""

POINTS_PER_PART = 4096
BODIES = "hole", "bonded-block"


def scene_of(points: int, name: str = "hole"):
    """A scene with about so many points."""
    scene = load_scene(name)
    lower, upper = map(np.array, scene.body.bounds())
    size = np.prod(upper - lower) - sum(np.pi * hole.radius**2 for hole in scene.holes)
    return load_scene(name, [f"spacing={(size / points) ** (1 / len(lower)):.5g}"])


def resident() -> float:
    """Memory of this process now, MB."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


class Timed:
    """What ranks say to each other during evaluations: the time it takes, on the wall and of the processor, and the bytes that come in."""

    SAYING = "fill", "fold", "agree", "any"

    def __init__(self, part) -> None:
        self.processor = self.wall = 0.0
        self.bytes = self.times = 0
        if part.divided:
            for name in self.SAYING:
                setattr(part, name, self._timed(getattr(part, name)))
            self._exchange, part.ranks.exchange = part.ranks.exchange, self._counted

    def _timed(self, say):
        def timed(*arguments):
            processor, wall = time.thread_time(), time.perf_counter()
            try:
                return say(*arguments)
            finally:
                self.processor += time.thread_time() - processor
                self.wall += time.perf_counter() - wall

        return timed

    def _counted(self, outgoing, incoming) -> None:
        self._exchange(outgoing, incoming)
        self.bytes += sum(rows.nbytes for rows in incoming.values())
        self.times += 1


def measure(name: str, points: int, threads: int) -> None:
    """One rank's figures, all of them printed by the first."""
    ranks, scene = communicator(), scene_of(points, name)
    models = checked_models(scene, default_force(scene))
    with thread_count(threads):
        bare, began = resident(), time.process_time()
        run = Run(scene, models, None, threads)
        set_up, held, part = time.process_time() - began, resident() - bare, run.body.share
        positions, forces = run.body.points.copy(), np.empty_like(run.body.points)
        if scene.stretched:
            run.loading.apply(1.05, run.force, positions)
        for _ in range(3):
            run.force(positions, forces)
        timed, walls, seconds = Timed(part), [], 0.0
        for _ in range(EVALUATIONS):
            ranks.barrier()
            began, clock = time.process_time(), time.perf_counter()
            run.force(positions, forces)
            walls.append(time.perf_counter() - clock)
            seconds += time.process_time() - began
        seconds -= timed.processor
    own = int(part.own.sum()) if part.divided else len(run.body)
    row = {
        "own": own,
        "halo": len(run.body) - own,
        "bonds": run.directed_bonds(),
        "ms": 1e3 * seconds / EVALUATIONS,
        "wall_ms": 1e3 * float(np.median(walls)),
        "share": timed.wall / sum(walls),
        "exchange_kB": timed.bytes / EVALUATIONS / 1e3,
        "exchanges": timed.times / EVALUATIONS,
        "set_up_s": set_up,
        "held_MB": held,
        "most_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3 - bare,
    }
    rows = ranks.everywhere(row) if ranks.size > 1 else [row]
    if ranks.rank == 0:
        found = {"ranks": ranks.size, "points": run.body.share.size, "model": run.model.name, "of": rows}
        print("FOUND " + json.dumps(found))


def measured(points: int, ranks: int, threads: int = 1, name: str = "hole") -> dict:
    """The figures of a run on some ranks."""
    command = [sys.executable, "-m", "mpi4py", __file__, "--measure", name, "--points", str(points), "--threads", str(threads)]
    if ranks > 1:
        command = [str(Path(sys.executable).with_name("mpiexec")), "-n", str(ranks), *command]
    environment = {**os.environ, "NUMBA_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads)}
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment)
    return json.loads(next(line for line in done.stdout.splitlines() if line.startswith("FOUND")).removeprefix("FOUND "))


def greatest_of(run: dict) -> dict:
    """The figures of a run, of its ranks the greatest."""
    return {key: max(row[key] for row in run["of"]) for key in run["of"][0]}


def row_of(run: dict) -> list[str]:
    """The figures of a run, as a line of the table of ranks."""
    greatest = greatest_of(run)
    return [
        f"{run['points']:,}",
        f"{run['ranks']}",
        *(f"{greatest[key]:,}" for key in ("own", "halo")),
        f"{greatest['ms']:.1f}",
        f"{greatest['exchanges']:.0f}",
        f"{greatest['exchange_kB']:.0f}",
        *(f"{greatest[key]:.0f}" for key in ("set_up_s", "held_MB", "most_MB")),
    ]


def cut(points: np.ndarray, horizon: float, parts: int, weights: np.ndarray) -> list[str]:
    """How evenly bisection cuts a body, and how large the halos are."""
    owners, reach = bisected(points, weights, parts), horizon * (1 + 1e-9)
    bonds, own, halo = np.bincount(owners, weights), np.bincount(owners), []
    for part in range(parts):
        mine = points[owners == part]
        near = points[((points >= mine.min(axis=0) - reach) & (points <= mine.max(axis=0) + reach)).all(axis=1)]
        distance, _ = cKDTree(mine).query(near, distance_upper_bound=reach)
        halo.append(np.count_nonzero(np.isfinite(distance)) - own[part])
    halo = np.array(halo)
    return [
        *(f"{parts}", f"{own.mean():,.0f}", f"{bonds.max() / bonds.mean():.3f}"),
        *(f"{halo.max() / halo.mean():.2f}", f"{halo.max() / own.mean():.3f}"),
    ]


CUT = ["parts", "own points (mean)", "largest number of bonds / mean", "largest halo / mean", "largest halo / own points"]


def lattice(sides: int, dimension: int) -> np.ndarray:
    """Points of a square or a cube, a spacing of 1 apart."""
    axes = np.arange(sides) + 0.5
    return np.stack(np.meshgrid(*[axes] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)


def table_of_parts(points: list[int]) -> list[list[str]]:
    """A body of one size in more and more parts."""
    sheet, cube = discretize(scene_of(min(points)))[0], lattice(50, 3)
    rows = []
    for name, body, horizon in (("sheet with a hole", sheet.points, sheet.horizon), ("cube", cube, 1.75)):
        weights = bond_counts(body, horizon)
        rows += [[f"{name}, {len(body):,} points", *cut(body, horizon, parts, weights)] for parts in PARTS]
    return [["body", *CUT], *rows]


def table_of_weak(points: list[int]) -> list[list[str]]:
    """Bodies that grow with the parts."""
    rows = []
    for name, dimension, horizon in (("sheet", 2, 3.15), ("cube", 3, 1.75)):
        for parts in PARTS:
            body = lattice(round((parts * POINTS_PER_PART) ** (1 / dimension)), dimension)
            rows.append([name, f"{len(body):,}", *cut(body, horizon, parts, bond_counts(body, horizon))])
    return [["body", "points", *CUT], *rows]


def table_of_ranks(points: list[int], ranks: list[int]) -> list[list[str]]:
    """Bodies of some sizes on some ranks."""
    rows = []
    for size in points:
        for number in ranks:
            rows.append(row_of(measured(size, number)))
            print(*rows[-1], flush=True)
    figures = "processor time (ms)", "exchanges", "received (kB)", "setup (s)", "held (MB)", "at most (MB)"
    return [["points", "ranks", "own points", "halo points", *figures], *rows]


def table_of_threads(points: list[int]) -> list[list[str]]:
    """One process of two threads against two ranks of one."""
    rows = []
    for name in BODIES:
        found = [[measured(min(points), *kind, name=name) for kind in ((1, 2), (2, 1))] for _ in range(TURNS)]
        (threads, ranks), shares = (
            [float(np.median([greatest_of(run)["wall_ms"] for run in kind])) for kind in zip(*found, strict=True)],
            [greatest_of(run)["share"] for _, run in found],
        )
        first = found[0][0]
        figures = f"{first['points']:,}", f"{threads:.1f}", f"{ranks:.1f}", f"{ranks / threads:.2f}", f"{np.median(shares):.1%}"
        rows.append([f"`{name}`, {first['model']}", *figures])
        print(*rows[-1], flush=True)
    return [
        ["scene and force", "points", "1 rank of 2 threads (ms)", "2 ranks of 1 thread (ms)", "ranks / threads", "share of exchange"],
        *rows,
    ]


def block(sides: str, bulk_modulus: float):
    """The scene `bonded-block` at stretch 1.05, with so many points along its sides."""
    spacing = 0.1
    size = spacing * np.array([int(side) for side in sides.split("x")])
    lower = [0.0, -size[1] / 2, -size[2] / 2]
    changes = {"body.size": size.tolist(), "body.lower": lower, "spacing": spacing, "probes": [], "stretches": 1.05}
    return load_scene("bonded-block", changes | {"material.bulk_modulus": bulk_modulus})


def measure_block(sides: str, bulk_modulus: float, all_work: bool) -> None:
    """Run a block once, and print the seconds without compilation; with `all_work`, no rank waits however small the body is."""
    if all_work:
        waiting.POINTS_PER_RANK = 0
    summary = simulate(block(sides, bulk_modulus)).summary
    if communicator().rank == 0:
        found = {
            "points": summary["n_points"],
            "seconds": summary["seconds_total"] - summary["seconds_compile"],
            "evaluations": summary["n_force_evaluations"],
            "working": summary.get("ranks", 1),
        }
        print("FOUND " + json.dumps(found))


def measured_block(sides: str, bulk_modulus: float, ranks: int, all_work: bool = False) -> dict:
    """What `measure_block` finds on some ranks."""
    command = [sys.executable, "-W", "ignore", "-m", "mpi4py", __file__, "--block", sides, "--bulk-modulus", str(bulk_modulus)]
    command += ["--all-work"] * all_work
    if ranks > 1:
        command = [str(Path(sys.executable).with_name("mpiexec")), "-n", str(ranks), *command]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(next(line for line in done.stdout.splitlines() if line.startswith("FOUND")).removeprefix("FOUND "))


def table_of_small_bodies(sides: list[str]) -> list[list[str]]:
    """One rank against two on small bodies, and two that both work however small the body is."""
    kinds, rows = ((1,), (2,), (2, True)), []
    for kind in kinds:  # compile
        measured_block("6x5x4", 100.0, *kind)
    for one in sides:
        for bulk_modulus in (100.0, 1000.0):
            turns = TURNS if np.prod([int(side) for side in one.split("x")]) <= REPEATED else 1
            found = [[measured_block(one, bulk_modulus, *kind) for kind in kinds] for _ in range(turns)]
            alone, two, both = (float(np.median([run["seconds"] for run in kind])) for kind in zip(*found, strict=True))
            first = found[0]
            evaluations = " / ".join(str(run["evaluations"]) for run in first)
            rows.append(
                [
                    *(f"{first[0]['points']:,}", f"{bulk_modulus:g}", f"{alone:.2f}", str(first[1]["working"])),
                    *(f"{two:.2f}", f"{two / alone:.2f}", f"{both:.2f}", f"{both / alone:.2f}", evaluations),
                ]
            )
            print(*rows[-1], sep=" | ", flush=True)
    figures = "two ranks (s)", "two ranks / one", "both at work (s)", "both at work / one", "evaluations"
    return [["points", "K / μ", "one rank (s)", "working of two", *figures], *rows]


def main(tables: list[str], points: list[int], ranks: list[int], sides: list[str], shown: bool) -> None:
    """Make tables, and put them into the documentation or only print them."""
    for name in tables:
        header, *rows = TABLES[name](points, ranks, sides)
        table = markdown_table(header, rows)
        print(table, flush=True)
        if not shown:
            replace_block(name, table)


TABLES = {
    "ranks": lambda points, ranks, sides: table_of_ranks(points, ranks),
    "parts": lambda points, ranks, sides: table_of_parts(points),
    "weak": lambda points, ranks, sides: table_of_weak(points),
    "against-threads": lambda points, ranks, sides: table_of_threads(points),
    "small-bodies": lambda points, ranks, sides: table_of_small_bodies(sides),
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tables", nargs="*", default=[], metavar="TABLE", help=f"of {', '.join(TABLES)}; by default all")
    parser.add_argument("--points", type=int, nargs="+", default=[100_000, 1_000_000])
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--sides", nargs="+", default=SMALL, help="points along the sides of the blocks of small-bodies")
    parser.add_argument("--block", help=argparse.SUPPRESS)
    parser.add_argument("--bulk-modulus", type=float, help=argparse.SUPPRESS)
    parser.add_argument("--all-work", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--shown", action="store_true", help="print the tables and leave the documentation as it is")
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    parser.add_argument("--threads", type=int, default=1, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if unknown := set(given.tables) - set(TABLES):
        parser.error(f"there is no table {', '.join(unknown)}; there are {', '.join(TABLES)}")
    if given.measure:
        measure(given.measure, given.points[0], given.threads)
    elif given.block:
        measure_block(given.block, given.bulk_modulus, given.all_work)
    else:
        main(given.tables or list(TABLES), given.points, given.ranks, given.sides, given.shown)
