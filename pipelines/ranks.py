"""What ranks cost and save: processor time and memory of each, its exchanges, and how evenly parts are cut, into the documentation.

    python pipelines/ranks.py [--points 100000 1000000] [--ranks 1 2 4]

Processor time, not time on the wall: it may be measured beside other work, where ranks that wait for one another tell nothing.
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
from pdsurrogate.discretisation import discretise
from pdsurrogate.kernels.threads import thread_count
from pdsurrogate.ranks import bisected, bond_counts, communicator
from pdsurrogate.run.run import Run, Silent
from pdsurrogate.scenes import load_scene

EVALUATIONS = 20
PARTS = 2, 4, 8, 16, 32, 64


def scene_of(points: int):
    """The hole scene with about so many points."""
    return load_scene("hole", [f"spacing={(12 - np.pi * 0.16) ** 0.5 / points**0.5:.5g}"])


def resident() -> float:
    """Memory of this process now, MB."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


class Timed:
    """Exchanges of a part, with the processor time and the bytes that they take."""

    def __init__(self, part) -> None:
        self.processor, self.bytes, self.times, self._fill = 0.0, 0, 0, part.fill
        self._rows = sum(map(len, getattr(part, "_receive", {}).values()))

    def __call__(self, values) -> None:
        began = time.thread_time()
        self._fill(values)
        self.processor += time.thread_time() - began
        self.bytes += self._rows * values[:1].nbytes
        self.times += 1


def measure(points: int, threads: int) -> None:
    """One rank's figures, all of them printed by the first."""
    ranks, scene = communicator(), scene_of(points)
    model = default_force(scene)
    with thread_count(threads):
        bare, began = resident(), time.process_time()
        run = Run(scene, model, Silent(), None, threads)
        set_up, held, part = time.process_time() - began, resident() - bare, run.body.part
        positions, forces = run.body.points.copy(), np.empty_like(run.body.points)
        run.loading.apply(1.05, run.force, positions)
        for _ in range(3):
            run.force(positions, forces)
        timed = Timed(part)
        if part.divided:
            part.fill = timed
        began, clock = time.process_time(), time.perf_counter()
        for _ in range(EVALUATIONS):
            run.force(positions, forces)
        seconds, wall = time.process_time() - began - timed.processor, time.perf_counter() - clock
    own = int(part.own.sum()) if part.divided else len(run.body)
    row = {
        "own": own,
        "halo": len(run.body) - own,
        "bonds": run.directed_bonds(),
        "ms": 1e3 * seconds / EVALUATIONS,
        "wall_ms": 1e3 * wall / EVALUATIONS,
        "exchange_kB": timed.bytes / EVALUATIONS / 1e3,
        "exchanges": timed.times / EVALUATIONS,
        "set_up_s": set_up,
        "held_MB": held,
        "most_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3 - bare,
    }
    rows = ranks.everywhere(row) if ranks.size > 1 else [row]
    if ranks.rank == 0:
        print(
            "FOUND "
            + json.dumps({"ranks": ranks.size, "points": run.reductions.total_size(len(run.body)), "model": model.name, "of": rows})
        )


def measured(points: int, ranks: int, threads: int = 1) -> dict:
    """The figures of a run on some ranks."""
    command = [sys.executable, "-m", "mpi4py", __file__, "--measure", str(points), "--threads", str(threads)]
    if ranks > 1:
        command = [str(Path(sys.executable).with_name("mpiexec")), "-n", str(ranks), *command]
    environment = {**os.environ, "NUMBA_NUM_THREADS": str(threads), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return json.loads(next(line for line in done.stdout.splitlines() if line.startswith("FOUND")).removeprefix("FOUND "))


def row_of(run: dict) -> list[str]:
    """The figures of a run, of its ranks the greatest."""
    greatest = {key: max(row[key] for row in run["of"]) for key in run["of"][0]}
    return [
        f"{run['points']:,}",
        f"{run['ranks']}",
        *(f"{greatest[key]:,}" for key in ("own", "halo")),
        f"{greatest['ms']:.1f}",
        f"{greatest['exchanges']:.0f}",
        f"{greatest['exchange_kB']:.0f}",
        *(f"{greatest[key]:.0f}" for key in ("set_up_s", "held_MB", "most_MB")),
    ]


def rows_of_parts(name: str, points: np.ndarray, horizon: float) -> list[list[str]]:
    """How evenly bisection cuts a body, and how large the halos are."""
    weights, rows = bond_counts(points, horizon), []
    for parts in PARTS:
        owners = bisected(points, weights, parts)
        bonds, own, halo = np.bincount(owners, weights), np.bincount(owners), []
        for part in range(parts):
            distance, _ = cKDTree(points[owners == part]).query(points, distance_upper_bound=horizon * (1 + 1e-9))
            halo.append(np.count_nonzero(np.isfinite(distance)) - own[part])
        halo = np.array(halo)
        share = halo.max() / own.mean()
        rows.append(
            [name, f"{parts}", f"{own.mean():,.0f}", f"{bonds.max() / bonds.mean():.3f}", f"{halo.max() / halo.mean():.2f}", f"{share:.3f}"]
        )
    return rows


def main(points: list[int], ranks: list[int]) -> None:
    """Measure all, and put it into the documentation."""
    rows = []
    for size in points:
        for number in ranks:
            rows.append(row_of(measured(size, number)))
            print(*rows[-1], flush=True)
    header = ["points", "ranks", "own points", "halo", "processor, ms", "exchanges", "kB", "set-up, s", "held, MB", "at most, MB"]
    replace_block("ranks", markdown_table(header, rows))
    sheet = discretise(scene_of(min(points)))[0]
    axes = np.arange(50) + 0.5
    cube = np.stack(np.meshgrid(axes, axes, axes, indexing="ij"), axis=-1).reshape(-1, 3)
    header = ["body", "parts", "own points, mean", "most bonds / mean", "largest halo / mean", "largest halo / own points"]
    rows = rows_of_parts(f"sheet with a hole, {len(sheet):,} points", sheet.points, sheet.horizon)
    rows += rows_of_parts(f"cube, {len(cube):,} points", cube, 1.75)
    replace_block("parts", markdown_table(header, rows))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, nargs="+", default=[100_000, 1_000_000])
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--measure", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--threads", type=int, default=1, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.measure:
        measure(given.measure, given.threads)
    else:
        main(given.points, given.ranks)
