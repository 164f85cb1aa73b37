"""Relaxation times as a table over the overstress: error of the stress by the number of points, and
what a step takes.

python pipelines/falling_times.py          runs all cases
python pipelines/falling_times.py --docs   puts the table into the documentation
"""

import time

import numpy as np
from cases import of_rows, report
from clock import waved_block

import pdsurrogate as pds
from pdsurrogate.engine.threads import thread_count
from pdsurrogate.materials import Branch, Memory, NeoHookean
from pdsurrogate.materials.histories import stress_history

SMOOTH = 0.1, 2.0
"""Overstress s_0 and power m of the time 1/(1 + (s/s_0)^m), which tables approximate."""

CYCLE = [0.0, 1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 2.0, 1.2, 1.2]
"""Times and stretches between which the homogeneous cycle runs."""

REFERENCE = 400
TURNS = 40


def branch(points):
    """Branch with a table of times at so many overstresses; of a constant time with one."""
    if points == 1:
        return Branch(1.0, 1.0)
    stress = np.geomspace(SMOOTH[0] / 10, 100 * SMOOTH[0], points)
    times = 1 / (1 + (stress / SMOOTH[0]) ** SMOOTH[1])
    return Branch(1.0, float(times[0]), tuple(zip(stress.tolist(), times.tolist(), strict=True)))


def law(points):
    """Neo-Hookean rubber with this branch."""
    return NeoHookean(bulk_modulus=100.0, memory=Memory((branch(points),)))


def branch_stress(points):
    """Stress of the branch in the cycle."""
    at = np.linspace(0, 4, 401)
    stretch = np.interp(at, *CYCLE)
    found = stress_history(law(points), "uniaxial", at, stretch, incompressible=True)
    return found.nominal_stress - (stretch - stretch**-2)


def of_points(points):
    """Error of the stress, and processor time of steps of bodies, long ones as in equilibrium and
    short ones as in dynamics, with that of evaluations.
    """
    error = "" if points == 1 else np.abs(branch_stress(points) - branch_stress(REFERENCE)).max()
    figures = []
    for plane, sides in (("strain", (60, 60)), ("stress", (60, 60)), ("space", (16, 16, 16))):
        body, first, last, waves = waved_block(sides)
        force = pds.BondEnergyForce().bind(body, law(points), pds.ForceSettings(plane=plane))
        out = np.empty_like(first)
        taken = np.empty((TURNS, 3))
        with thread_count(1):
            for turn in taken:
                for number, (end, duration) in enumerate(
                    ((last, 0.2), (first + 1e-4 * waves, 1e-4))
                ):
                    force.accept(first)
                    force.elapse(duration)
                    began = time.thread_time()
                    force(end, out)
                    turn[number] = time.thread_time() - began
                began = time.thread_time()
                force(end, out)
                turn[2] = time.thread_time() - began
        taken = 1e9 * np.median(taken, axis=0) / len(body.bonds.first)
        figures += [taken[2], *(taken[:2] - taken[2])]
    yield points, error, *figures


if __name__ == "__main__":
    columns = [
        f"{plane}, {what} (ns/pair): .0f"
        for plane in ("strain", "stress", "space")
        for what in ("evaluation", "long step", "short step")
    ]
    report(
        __doc__,
        of_rows(
            "falling-times",
            of_points,
            [(1,), (2,), (4,), (8,), (16,), (32,)],
            "points",
            "error of the branch's stress: .1e",
            *columns,
        ),
    )
