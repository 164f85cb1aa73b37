"""How the kernels' threads wait, and when a second one pays: cost of an evaluation on free cores and beside other processes.

python pipelines/threads.py            print the table (about ten minutes)
python pipelines/threads.py --docs   and put it into the documentation

Each setting has processes of its own, since threads read how to wait when they start. On free cores the processes of all settings live
side by side and take turns of a tenth of a second, body by body, so that a machine that slows down slows all of them; the first setting
takes part twice, which shows what chance does. Their costs are lower quartiles over turns: what a turn takes while nobody outside disturbs
it. Beside other work each process runs alone, since threads that wake together after a pause would also be given their cores together,
which hides what happens in a long run; those costs are medians.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager

import numpy as np
from pages import markdown_table, replace_block
from rich.console import Console

import pdsurrogate as pds
from pdsurrogate.engine.threads import SPIN_COUNT, thread_count
from pdsurrogate.reports.speed import bench_positions

console = Console()

WIDTHS = (10, 20, 50, 163)
"""Points across a sheet of 3 x 1: 300, 1,200, 7,500 and some 80,000 of them."""

SETTINGS = {
    "two threads, default of GNU OpenMP": (2, {"GOMP_SPINCOUNT": "300000"}),
    "the same, repeated": (2, {"GOMP_SPINCOUNT": "300000"}),
    f"two threads, {SPIN_COUNT:,} loops (pdsurrogate)": (2, {}),
    "two threads, 2,000 loops": (2, {"GOMP_SPINCOUNT": "2000"}),
    "two threads, 10,000 loops": (2, {"GOMP_SPINCOUNT": "10000"}),
    "two threads, 100 loops": (2, {"GOMP_SPINCOUNT": "100"}),
    "two threads that sleep immediately": (2, {"OMP_WAIT_POLICY": "passive"}),
    "one thread": (1, {}),
}
"""Number of threads, and the variables that progress how they wait."""

BUSY = (1, 2)
"""Other processes that take all they can get."""

STARTS, TURNS = 4, 20
"""How often all processes are started anew, since where memory lies also counts, and the turns each takes on free cores after a start."""
SECONDS_FREE, SECONDS_BUSY = 0.1, 0.4
"""Of a measurement."""


def serve(threads: int) -> None:
    """Answer every width that is asked for with nanoseconds per directed bond, on so many threads."""
    model, law = pds.load_surrogate("neo-hookean"), pds.materials.NeoHookean()
    forces = {}
    with thread_count(threads):
        for width in WIDTHS:
            body = pds.Body.rectangle(3.0, 1.0, 1 / width, 3.15 / width)
            forces[width] = (
                model.bind(body, law, pds.ForceSettings()),
                bench_positions(body, law),
                np.empty_like(body.points),
                body.bonds.n_directed,
            )
        for question in sys.stdin:
            width, seconds = json.loads(question)
            force, positions, out, n_directed = forces[width]
            for _ in range(3):
                force(positions, out)
            began, count = time.perf_counter(), 0
            while time.perf_counter() - began < seconds:
                force(positions, out)
                count += 1
            print(json.dumps(1e9 * (time.perf_counter() - began) / count / n_directed), flush=True)


@contextmanager
def busy(count: int):
    """Context in which other processes work without a pause."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


@contextmanager
def server(setting: str):
    """Context with a waiting process of one setting."""
    threads, variables = SETTINGS[setting]
    inherited = {key: value for key, value in os.environ.items() if key not in ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")}
    environment = {**inherited, **variables, "NUMBA_NUM_THREADS": "2"}
    command = [sys.executable, __file__, "--serve", str(threads)]
    process = subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def ask(process: subprocess.Popen, widths: tuple[int, ...], seconds: float) -> list[float]:
    """Costs of a directed bond of some bodies in one process, one straight after the other."""
    print(*([width, seconds] for width in widths), sep="\n", file=process.stdin, flush=True)
    answers = [process.stdout.readline() for _ in widths]
    if not all(answers):
        raise RuntimeError("a process that measures ended early")
    return [json.loads(answer) for answer in answers]


def measure_free() -> list[dict[str, list[float]]]:
    """Costs on free cores for one start of the processes: for every turn the bodies' costs by setting."""
    found = []
    with ExitStack() as stack:
        started = {setting: stack.enter_context(server(setting)) for setting in SETTINGS}
        for process in started.values():
            ask(process, WIDTHS[:1], SECONDS_FREE)
        for turn in range(TURNS):
            costs = {setting: [] for setting in SETTINGS}
            for width in WIDTHS:
                # The order alternates, so that no setting always follows the same one.
                for setting in list(SETTINGS)[:: 1 if turn % 2 else -1]:
                    costs[setting] += ask(started[setting], (width,), SECONDS_FREE)
            found.append(costs)
    return found


def measure_busy(others: int) -> dict[str, list[float]]:
    """Costs of the bodies by setting beside other processes, each setting in a fresh process."""
    found = {}
    with busy(others):
        for setting in SETTINGS:
            with server(setting) as process:
                found[setting] = ask(process, WIDTHS, SECONDS_BUSY)
    return found


def measure_all(starts: int, progress) -> dict[tuple[str, int], np.ndarray]:
    """Costs by setting and number of other processes: an array of turns and bodies."""
    found = {(setting, others): [] for setting in SETTINGS for others in (0, *BUSY)}
    for start in range(starts):
        progress(f"start {start + 1} of {starts}, free cores")
        turns = {0: measure_free()}
        for others in BUSY:
            progress(f"start {start + 1} of {starts}, {others} other processes")
            turns[others] = [measure_busy(others)]
        for others, measured in turns.items():
            for costs in measured:
                for setting, values in costs.items():
                    found[setting, others].append(values)
    return {key: np.array(values) for key, values in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", action="store_true", help="put the table into the documentation")
    parser.add_argument("--starts", type=int, default=STARTS)
    parser.add_argument("--serve", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve(arguments.serve)
        return
    with console.status("Measuring") as status:
        costs = measure_all(arguments.starts, status.update)
    points = " / ".join(f"{3 * width * width:,}" for width in WIDTHS)
    header = [
        f"ns per directed bond with {points} points",
        *(f"{others} other processes" for others in (0, *BUSY)),
        "free cores, divided by the first row",
    ]
    typical = {key: np.quantile(values, 0.5 if key[1] else 0.25, axis=0) for key, values in costs.items()}
    rows, spinning = [], typical[next(iter(SETTINGS)), 0]
    for setting in SETTINGS:
        entries = [" / ".join(f"{cost:.3g}" for cost in typical[setting, others]) for others in (0, *BUSY)]
        rows.append([setting, *entries, " / ".join(f"{ratio:.2f}" for ratio in typical[setting, 0] / spinning)])
    table = markdown_table(header, rows)
    console.print(table, soft_wrap=True)
    if arguments.docs:
        replace_block("threads", table)


if __name__ == "__main__":
    main()
