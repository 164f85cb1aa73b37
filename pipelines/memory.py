"""Steps in time of branches: errors against an integration by SciPy.

python pipelines/memory.py                 all cases, a minute
python pipelines/memory.py --docs          the table of all stored figures
"""

from itertools import pairwise

import numpy as np
from cases import of_rows, report
from clock import spent_by, waved_block
from scipy.integrate import solve_ivp

import pdsurrogate as pds
from pdsurrogate.engine.threads import thread_count
from pdsurrogate.materials import Branch, Memory, NeoHookean
from pdsurrogate.materials.histories import LOGS, stress_history

CYCLE = (0, 1, 3, 4), (1.0, 2.0, 2.0, 1.2)
"""Times, in relaxation times, and stretches of a ramp, a hold and a return."""
RAMPS = np.array([0, 60, 80, 140]), (1.0, 2.0, 2.0, 1.0)
"""Numbers of the steps, and stretches."""


def overstress(mode, knots, stretches, time):
    """Nominal stresses at times of a branch of modulus 1 and relaxation time 1, of the package and
    by SciPy at 1e-10.
    """

    def squares(t):
        return np.exp(2 * np.array(LOGS[mode](np.log(np.interp(t, knots, stretches)), 0.0)))

    def rate(t, logs):
        ratios = squares(t) / np.exp(logs)
        return ratios - ratios.mean()

    logs = [np.zeros(3)]
    for first, last in pairwise(knots):
        at = time[(time > first + 1e-9 * last) & (time <= last * (1 + 1e-9))]
        at[-1] = last
        found = solve_ivp(rate, (first, last), logs[-1], "LSODA", t_eval=at, rtol=1e-10, atol=1e-12)
        logs.extend(found.y.T)
    expected = []
    for t, log in zip(time, logs, strict=True):
        s = squares(t) / np.exp(log)
        expected.append((s[0] - s[2]) / np.interp(t, knots, stretches))
    stretch = np.interp(time, knots, stretches)
    stress = [
        stress_history(NeoHookean(memory=memory), mode, time, stretch, True).nominal_stress
        for memory in (Memory((Branch(1.0, 1.0),)), Memory())
    ]
    return stress[0] - stress[1], np.array(expected)


def of_steps(mode):
    """Greatest errors of the overstress over the greatest overstress: of a cycle by its steps a
    relaxation time, and of ramps of 60 steps by their duration.
    """
    programs = [(*CYCLE, np.linspace(0, 4, 4 * n + 1)) for n in (1, 160)]
    programs += [(h * RAMPS[0], RAMPS[1], h * np.arange(141)) for h in (0.03, 1.0, 30.0)]
    errors = []
    for knots, stretches, time in programs:
        found, expected = overstress(mode, knots, stretches, time)
        errors.append(np.abs(found - expected).max() / np.abs(expected).max())
    yield mode, *errors


SMOOTH = 0.1, 2.0
"""Overstress s_0 and power m of the time 1/(1 + (s/s_0)^m), which tables approximate."""

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
        out, steps = np.empty_like(first), ((last, 0.2), (first + 1e-4 * waves, 1e-4))
        taken = np.empty((TURNS, 3))
        with thread_count(1):
            for turn in taken:
                for number, (end, duration) in enumerate(steps):
                    force.accept(first)
                    force.elapse(duration)
                    turn[number] = spent_by(force, end, out)
                turn[2] = spent_by(force, end, out)
        taken = np.median(taken, axis=0) / len(body.bonds.first)
        figures += [taken[2], *(taken[:2] - taken[2])]
    yield points, error, *figures


if __name__ == "__main__":
    points = (1, 2, 4, 8, 16, 32)
    report(
        __doc__,
        of_rows("branch-steps", of_steps, LOGS),
        of_rows("falling-times", of_points, points),
    )
