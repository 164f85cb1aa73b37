"""Precision and threads."""

from __future__ import annotations

import numba
import numpy as np

from ..kernels.threads import thread_count
from .case import INAPPLICABLE, PASS, SPACING, WEAK, Body, Case, Outcome, Subject
from .deformations import force_densities, wavy


def single_precision(subject: Subject) -> Outcome:
    """Difference of the forces in float32 and in float64 on a deformed sheet, over the greatest.

    A few roundings of 6e-8 on each of some thirty bond forces, which are larger than their sum: 2e-5 is asked.
    """
    body = Body.rectangle(12 * SPACING, 10 * SPACING, SPACING, 3.15 * SPACING)
    double = force_densities(subject.bind(body), wavy(body.points))
    try:
        force = subject.bind(body, precision="float32")
    except ValueError:
        return Outcome(INAPPLICABLE, "double only")
    return Outcome.below(np.abs(force_densities(force, wavy(body.points)) - double).max() / np.abs(double).max(), 2e-5, "accuracy")


def threads(subject: Subject) -> Outcome:
    """Bits by which forces on one thread and on two differ: none may."""
    if numba.config.NUMBA_NUM_THREADS < 2:
        return Outcome(INAPPLICABLE, "one thread only")
    body = Body.rectangle(2.4, 2.0, SPACING / 2, 3.15 * SPACING / 2)
    found = []
    for count in (1, 2):
        with thread_count(count):
            found.append(force_densities(subject.bind(body), wavy(body.points)))
    same = bool((found[0] == found[1]).all())
    return Outcome(PASS if same else WEAK, "bitwise the same" if same else "differ", float(not same), 0.0, None if same else "accuracy")


CASES = (
    Case("float32 against float64", "forces within 2e-5", single_precision),
    Case("1 thread against 2", "bitwise the same", threads),
)
