"""The state of a bond, elementwise: its stretch tensor, and where that stands to the domain of a surrogate."""

import numpy as np

from ..engine.compile import inline, inlined
from .elementary import quotient
from .feature_sets import like

LEAST_NORMAL_STRETCH = 0.1
"""U_nn below which 1/U_nn is continued by its tangent: far below every stretch that rubber is compressed to."""


def lateral_stretch(a, b, J):
    """U_mm = (J + b^2)/a of theory (10), continued to bonds turned by a right angle and more, where a = U_nn <= 0.

    There (a, b, J) define no stretch tensor: U_mm would change sign through a pole, and the force would drive such a
    bond on instead of back.  So below `LEAST_NORMAL_STRETCH` 1/a goes on along its tangent.  With p > 0 and q < 0
    the traction T_nn = p a + q U_mm/J is then finite and rises with a through all turns: it pushes the bond back.
    """
    inverse = quotient(like(a, 1.0), np.maximum(a, like(a, LEAST_NORMAL_STRETCH)))
    return (J + b * b) * inverse * (like(a, 2.0) - a * inverse)


lateral_stretch = inlined(lateral_stretch)


@inline
def is_outside(a, b, U_mm, J, C33, limits):
    """1 for a state outside the domain, else 0.

    With J the product of the principal stretches, both lie within [low, high] exactly if J lies within [low**2, high**2] and
    tr C is at most high**2 + J**2/high**2 and low**2 + J**2/low**2: no eigenvalue is needed.  NaN is outside, and so is a
    bond that has no stretch tensor.

    `limits` is a tuple of low**2, high**2 and their inverses, the least and greatest J3**2 = J**2 C33, and the least a.
    """
    trace = a * a + b * b + b * b + U_mm * U_mm
    square = J * J
    bulk = square * C33
    inside = (
        (trace <= limits[1] + square * limits[3])
        & (trace <= limits[0] + square * limits[2])
        & (limits[0] <= J)
        & (limits[1] >= J)
        & (bulk >= limits[4])
        & (bulk <= limits[5])
        & (a > limits[6])
    )
    return like(a, 0.0) if inside else like(a, 1.0)


@inline
def share_inside(a, b, U_mm, J, C33, outer, inner):
    """Share of the surrogate in the force: 1 within the inner domain, 0 outside the outer one, rising smoothly between.

    Without such a band the force would jump at the domain's edge by the error that the surrogate has there, and a state
    of rest with bonds on the edge would not exist.
    """
    if is_outside(a, b, U_mm, J, C33, outer) > 0.0:
        return 0.0
    trace = a * a + b * b + b * b + U_mm * U_mm
    total = np.sqrt(trace + J + J)
    difference = np.sqrt(max(trace - J - J, 0.0))
    least, greatest, bulk = 0.5 * (total - difference), 0.5 * (total + difference), J * J * C33
    share = min(
        _rise(least, np.sqrt(outer[0]), np.sqrt(inner[0])),
        _rise(greatest, np.sqrt(outer[1]), np.sqrt(inner[1])),
        _rise(bulk, outer[4], inner[4]),
        _rise(bulk, outer[5], inner[5]),
    )
    return share * share * (3.0 - 2.0 * share)


@inline
def _rise(value, edge, full):
    """0 at the edge, 1 from `full` on."""
    return min(max((value - edge) / (full - edge), 0.0), 1.0) if full != edge else 1.0
