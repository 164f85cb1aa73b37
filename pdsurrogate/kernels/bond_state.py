"""The stretch tensor of a bond, elementwise."""

import numpy as np

from ..engine.compile import inlined
from .elementary import quotient
from .feature_sets import like

LEAST_NORMAL_STRETCH = 0.1
"""Value of U_nn below which the tangent of 1/U_nn replaces 1/U_nn: rubber is never compressed so far."""


def lateral_stretch(a, b, J):
    """Return U_mm = (J + b^2)/a of theory (10), continued to bonds turned by a right angle and more, where a = U_nn <= 0.

    There no stretch tensor exists: U_mm would change sign through a pole, and the force would turn such a bond further instead of back.
    Below `LEAST_NORMAL_STRETCH` 1/a therefore continues along its tangent. With p > 0 and q < 0 the traction T_nn = p a + q U_mm/J is then
    finite and rises with a through all rotations: it pushes the bond back.
    """
    inverse = quotient(like(a, 1.0), np.maximum(a, like(a, LEAST_NORMAL_STRETCH)))
    return (J + b * b) * inverse * (like(a, 2.0) - a * inverse)


lateral_stretch = inlined(lateral_stretch)


def along_and_across(T_nn, T_nm, a, b, stretch):
    """Return (t_n, t_tau), components along and across the deformed bond, shape (n, 2), from those along and across the bond at rest."""
    return np.stack([(T_nn * a + T_nm * b) / stretch, (T_nm * a - T_nn * b) / stretch], axis=1)
