"""Deviation of the members of a committee from the model in use, for the same deformation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..materials import Law
from .protocol import ForceModel

CHUNK = 65_536
"""Bonds or points evaluated at once, so that their features and outputs need little memory."""


def greatest_deviations(model: ForceModel, law: Law, answer: Callable[[Any, Law, slice], np.ndarray], count: int) -> np.ndarray:
    """Return the greatest deviation of the members from the model at each state, in units of the shear modulus, shape (count,).

    Beyond its domain every member is replaced by the exact force of its own law, as in a run by default.

    Parameters
    ----------
    model : ForceModel
        Model with its members.
    law : Law
        Law of the body.
    answer : callable
        ``answer(model, law, some)``: forces of a model at some of the states, shape (k, components), in units of its shear modulus.
    count : int
    """
    found = np.empty(count)
    for some in (slice(at, at + CHUNK) for at in range(0, count, CHUNK)):
        own = answer(model, law, some)
        others = (member.ratio * answer(member.model, member.law, some) for member in model.members)
        found[some] = np.max([np.linalg.norm(other - own, axis=1) for other in others], axis=0)
    return found
