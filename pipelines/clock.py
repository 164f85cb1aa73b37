"""Cost of force evaluations, measured on a machine whose cores may be shared."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from pdsurrogate.body import Body
from pdsurrogate.engine.block_arrays import BLOCK, aligned_rows, block_rows
from pdsurrogate.engine.compile import widest_vectors
from pdsurrogate.engine.passes import Pass, share_of
from pdsurrogate.engine.threads import most_threads, thread_count
from pdsurrogate.forces import ForceModel, ForceSettings
from pdsurrogate.materials import Law, homogeneous
from pdsurrogate.progress import event

ENOUGH = 12
"""Number of undisturbed timings (see `UNDISTURBED`) required for every model and number of threads.
Chosen: the median of twelve hardly depends on single timings; more of them take longer to find on a
busy machine.
"""

UNDISTURBED = 1.1
"""Slowdown of a core up to which a timing counts as undisturbed by other processes.

The slowdown is that of reference arithmetic (a fixed loop, `arithmetic`), timed just before and
after every timing: its longer time there divided by its shortest time in the whole measurement.
Chosen: another process on the same core makes it 2; a limit nearer to 1 rejects timings for nothing
but noise.
"""

TIMINGS = 4
"""Number of timings of a model in each of its turns; models are timed in turns. Chosen: short turns
spread the timings of all models over the same quiet and busy moments, but each turn costs
`WARM_UP`.
"""

WARM_UP = 8e-3
"""Seconds for which a model runs untimed at the start of each turn, since the caches still hold
another model's data. Chosen: time for some evaluations; a longer warm-up leaves less time for
timings.
"""

PIECE = 5e-4
"""Seconds that the reference arithmetic before and after each timing takes on one thread of an
undisturbed core. Chosen: long against the resolution of the clock, short against the force
evaluation that is timed.
"""


ROWS = 2
"""Number of rows in the buffer of `arithmetic`: one of arguments, one of values."""


def sheet() -> Body:
    """Return the body on which the speed of models is measured: the sheet of the paper's section
    6.2, with 7,500 points.
    """
    return Body.rectangle(3.0, 1.0, 0.02, 0.063)


def bench_positions(body: Body, law: Law) -> np.ndarray:
    """Return positions of a body's points, shape (n, 2), in uniaxial tension to stretch 2, with
    waves that make bond states differ.
    """
    state = homogeneous.uniaxial(law, 2.0)
    x1, x2 = body.points.T
    wave = 0.2 * body.horizon
    phase = 2 * np.pi / (10 * body.horizon)
    return np.stack(
        [
            2 * x1 + wave * np.sin(phase * x2),
            state.lateral_stretch * x2 + wave * np.sin(phase * x1),
        ],
        axis=1,
    )


@dataclass(frozen=True)
class TimedModel:
    """Force model, in one precision and on one body, whose evaluations are timed.

    `compare` also uses its title, and changes (texts KEY=VALUE) to the scene of `measure_scene`.
    """

    model: ForceModel
    precision: str
    body: Body
    title: str = ""
    changes: tuple[str, ...] = ()


def measure_speed(cases: list[TimedModel], law: Law, patience: float) -> list[dict]:
    """Measure the nanoseconds per directed bond of the whole evaluation and of the bond pass, on
    one thread and on all.

    A directed bond is one end of a bond: each bond counts twice. The bond pass is the part of the
    evaluation that runs over bonds, from known states of the points. All cases are timed in turns
    of some milliseconds. A core may be shared with other work, which comes and goes; on a core that
    runs two threads at once, each then takes about 1.5 times as long. Therefore reference
    arithmetic that needs no memory is timed just before and after every timing, on as many threads.
    Only timings are used around which the arithmetic ran at full speed, and their medians are
    returned; the models' own times play no part in the selection.

    Parameters
    ----------
    cases : list of TimedModel
    law : Law
        Material of the bodies.
    patience : float
        Seconds after which the least disturbed timings are used, even if fewer than `ENOUGH` of
        them are undisturbed.

    Returns
    -------
    list of dict
        For each case ``ns_per_directed_bond_1`` and ``ns_per_directed_bond_all``,
        ``ns_bond_pass_1`` and ``ns_bond_pass_all``, ``thread_speedup``, ``arithmetic_speedup``
        (gain of the arithmetic from threads around these timings), ``disturbance_1`` and
        ``disturbance_all`` (time of the arithmetic around these timings divided by its shortest),
        and the medians of all timings, ``ns_per_directed_bond_1_at_any_time`` and
        ``ns_per_directed_bond_all_at_any_time``.
    """
    threads = sorted({1, most_threads()})
    yardsticks = {count: _arithmetic_on(count) for count in threads}
    trial = 1000
    with thread_count(1):
        rounds = max(1, int(trial * PIECE / min(yardsticks[1](trial) for _ in range(50))))
    turns = {
        (number, count): _turns_of(case, law, count, partial(yardsticks[count], rounds))
        for number, case in enumerate(cases)
        for count in threads
    }
    timings = {key: [] for key in turns}
    wanted = list(timings)
    began = time.perf_counter()
    with threadpool_limits(1):
        while wanted:
            settled, spent = (
                len(timings) - len(wanted),
                min((time.perf_counter() - began) / max(patience, 1e-9), 1.0),
            )
            event("timing", max(settled, spent * len(timings)), len(timings), settled=settled)
            for key in wanted:
                timings[key] += turns[key]()
            best = {
                count: min(
                    timing[2] for key in timings if key[1] == count for timing in timings[key]
                )
                for count in threads
            }
            if time.perf_counter() - began > patience:
                break
            wanted = [
                key
                for key in timings
                if sum(timing[2] < UNDISTURBED * best[key[1]] for timing in timings[key]) < ENOUGH
            ]

    rows = []
    for number, case in enumerate(cases):
        row, scale = {}, 1e9 / case.body.bonds.n_directed
        for label, count in (("1", threads[0]), ("all", threads[-1])):
            found = np.array(timings[number, count])
            evaluation, bond_pass, beside = np.median(
                found[np.argsort(found[:, 2])[:ENOUGH]], axis=0
            )
            row[f"ns_per_directed_bond_{label}"] = scale * evaluation
            row[f"ns_bond_pass_{label}"] = scale * bond_pass
            row[f"disturbance_{label}"] = beside / best[count]
            row[f"ns_per_directed_bond_{label}_at_any_time"] = scale * np.median(found[:, 0])
        row["thread_speedup"] = row["ns_per_directed_bond_1"] / row["ns_per_directed_bond_all"]
        row["arithmetic_speedup"] = (
            best[threads[0]] * row["disturbance_1"] / (best[threads[-1]] * row["disturbance_all"])
        )
        rows.append({key: float(value) for key, value in row.items()})
    return rows


def _turns_of(
    case: TimedModel, law: Law, count: int, yardstick: Callable[[], float]
) -> Callable[[], list[tuple[float, float, float]]]:
    """Return a function that times a force model `TIMINGS` times on `count` threads and returns the
    list of timings.

    A timing holds the seconds of the whole evaluation, of the bond pass, and of the reference
    arithmetic just before or just after them, whichever is longer; the function `yardstick` runs
    this arithmetic and returns its seconds.
    """
    positions, out = bench_positions(case.body, law), np.empty_like(case.body.points)
    with thread_count(count):
        force = case.model.bind(case.body, law, ForceSettings(precision=case.precision))
        whole, bonds = partial(force, positions, out), partial(force.pass_bonds, out)
        whole()
        bonds()
        calls = max(1, round(WARM_UP / _seconds(whole)))

    def turn() -> list[tuple[float, float, float]]:
        found = []
        with thread_count(count):
            for _ in range(calls):
                whole()
            before = yardstick()
            for _ in range(TIMINGS):
                times = _seconds(whole), _seconds(bonds)
                after = yardstick()
                found.append((*times, max(before, after)))
                before = after
        return found

    return turn


@Pass
def arithmetic(chunk, rounds, buffers):
    """Do reference arithmetic: evaluate a polynomial on a block of single-precision numbers
    `rounds` times, shared among the threads.

    The block of each thread, in `buffers`, stays in the first-level cache, so that memory does not
    limit the gain from threads.
    """
    widest_vectors()
    rows = block_rows(buffers[chunk.thread])
    for _ in share_of(rounds, chunk):
        for k in range(rows.shape[1]):
            x = rows[0, k]
            # Two chains depend on each other, so that the compiler cannot remove a part of them.
            even = x * x
            odd = even * x
            for _ in range(8):
                even = odd * x + even
                odd = even * x - odd
            rows[1, k] = np.float32(0.5) * (even + odd)


def _arithmetic_on(count: int) -> Callable[[int], float]:
    """Return a function that takes a number of rounds of `arithmetic` and returns their seconds;
    `count` threads must be in use.
    """
    buffer = aligned_rows((count, ROWS, BLOCK), np.float32, 0.5)

    def seconds(rounds: int) -> float:
        arithmetic(1, buffer)
        return _seconds(arithmetic.bind(rounds, buffer))

    return seconds


def _seconds(function: Callable[[], object]) -> float:
    began = time.perf_counter()
    function()
    return time.perf_counter() - began
