"""Steps in time of branches: errors against an integration by SciPy.

python pipelines/memory.py                 all cases, a minute
python pipelines/memory.py --docs          the table of all stored figures
"""

from itertools import pairwise

import numpy as np
from cases import of_rows, report
from scipy.integrate import solve_ivp

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


if __name__ == "__main__":
    report(
        __doc__,
        of_rows(
            "branch-steps",
            of_steps,
            [(mode,) for mode in LOGS],
            "mode",
            "1 step a τ: .1e",
            "160 steps a τ: .1e",
            *(f"Δt = {h:g} τ: .1e" for h in (0.03, 1, 30)),
        ),
    )
