"""Cost of force evaluations, measured on a machine whose cores may be shared."""

import itertools
import time
from dataclasses import dataclass
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from pdsurrogate.body import Body
from pdsurrogate.engine.threads import most_threads, thread_count
from pdsurrogate.forces import ForceModel, ForceSettings
from pdsurrogate.materials import homogeneous


def sheet():
    """Return the body on which the speed of models is measured: the sheet of the paper's section
    6.2, with 7,500 points.
    """
    return Body.rectangle(3.0, 1.0, 0.02, 0.063)


def waved_block(sides):
    """Return a block (or square) of side 1 with so many points along its sides, two states of it,
    and the waves in both, shape (n, d) each.
    """
    d = len(sides)
    places = np.meshgrid(*[(np.arange(n) + 0.5) / n for n in sides], indexing="ij")
    points = np.stack(places, axis=-1).reshape(-1, d)
    width, reach = 1 / sides[0], 1.75 if d == 3 else 3.15
    body = Body(points, np.full(len(points), width**d), reach * width, width)
    waves = 0.02 * np.sin(9 * points[:, ::-1])
    first, last = (points * np.array(a)[:d] + waves for a in ([1.4, 0.9, 0.8], [1.3, 0.9, 0.9]))
    return body, first, last, waves


def bench_positions(body, law):
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


def spent_by(action, *arguments):
    """Processor time of a call, on this thread, in nanoseconds."""
    began = time.thread_time_ns()
    action(*arguments)
    return time.thread_time_ns() - began


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


def measure_speed(cases, law, turns=40):
    """Nanoseconds per directed bond of an evaluation, on one thread and on all, of bodies of a law:
    ``ns_per_directed_bond_1`` and ``ns_per_directed_bond_all``.

    A directed bond is one end of a bond: each bond counts twice. Cores may be shared with other
    work, which comes and goes: all models are timed in turns, and the least of their turns counts.
    """
    least = np.full((len(cases), 2), np.inf)
    with threadpool_limits(1):
        for column, count in enumerate((1, most_threads())):
            with thread_count(count):
                evaluations = [_bound(case, law) for case in cases]
                for _, (row, evaluate) in itertools.product(range(turns), enumerate(evaluations)):
                    evaluate()  # the caches hold another model's data
                    for _ in range(4):
                        began = time.perf_counter()
                        evaluate()
                        seconds = time.perf_counter() - began
                        least[row, column] = min(least[row, column], seconds)
    least *= 1e9 / np.array([[case.body.bonds.n_directed] for case in cases])
    keys = "ns_per_directed_bond_1", "ns_per_directed_bond_all"
    return [dict(zip(keys, row, strict=True)) for row in least.tolist()]


def _bound(case, law):
    """An evaluation of a force model."""
    force = case.model.bind(case.body, law, ForceSettings(precision=case.precision))
    return partial(force, bench_positions(case.body, law), np.empty_like(case.body.points))
