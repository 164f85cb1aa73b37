"""What a network sees of a bond and what its outputs mean, as elementwise expressions.

Each feature set is a pair of functions that work on NumPy arrays (where regressors are trained and checked) and,
compiled, on the lanes of a block. ``like`` gives constants the precision of the lane.
"""

import numpy as np
from numba import types
from numba.extending import overload

from .compile import INLINE_OPTIONS
from .elementary import arctangent, logarithm


def like(x, value):
    """`value` in the precision of `x`."""
    return value


@overload(like, jit_options=INLINE_OPTIONS)
def _like(x, value):
    if x == types.float32:
        return lambda x, value: np.float32(value)
    return lambda x, value: value


def symmetric_inputs(a, b, U_mm, J, C33, length):
    """Log U_nn, log U_mm, log J, log J3^2 (THEORY section 4): even in b, so mirror symmetry is exact; all zero at rest."""
    return logarithm(a), logarithm(U_mm), logarithm(J), logarithm(C33 * J * J)


def symmetric_traction(o1, o2, a, b, U_mm, J, C33):
    """T_nn, T_nm, T_mm from T_nn/(U_nn + k U_mm) and T_nm/(b (1 + k)), k = C33/J.

    T and U are coaxial for every isotropic law, T_nm (U_nn - U_mm) = U_nm (T_nn - T_mm), so T_mm needs no output of its own.
    """
    k = C33 / J
    shear = o2 * (like(a, 1.0) + k)
    T_nn = o1 * (a + k * U_mm)
    return T_nn, shear * b, T_nn - shear * (a - U_mm)


def symmetric_outputs(T_nn, T_nm, a, b, U_mm, J, C33):
    """The inverse of `symmetric_traction`, for training (NumPy only)."""
    k = C33 / J
    return T_nn / (a + k * U_mm), T_nm / (b * (1 + k))


def paper_inputs(a, b, U_mm, J, C33, length):
    """The paper's five: lambda_b, dtheta, l_b/delta, C33, det F."""
    return np.sqrt(a * a + b * b), arctangent(b, a), length, C33, J


def paper_traction(o1, o2, a, b, U_mm, J, C33):
    """T_nn, T_nm from t_n and t_tau, the components along and across the deformed bond; T_mm is not known and given as 0."""
    norm = like(a, 1.0) / np.sqrt(a * a + b * b)
    return (o1 * a - o2 * b) * norm, (o1 * b + o2 * a) * norm, like(a, 0.0) * o1


def paper_outputs(T_nn, T_nm, a, b, U_mm, J, C33):
    """The inverse of `paper_traction`, for training (NumPy only)."""
    norm = 1 / np.sqrt(a * a + b * b)
    return (T_nn * a + T_nm * b) * norm, (T_nm * a - T_nn * b) * norm


FEATURE_SETS = {
    "symmetric": (symmetric_inputs, symmetric_traction, symmetric_outputs),
    "paper": (paper_inputs, paper_traction, paper_outputs),
}

FEATURE_NAMES = {
    "symmetric": ("log U_nn", "log U_mm", "log J", "log J3^2"),
    "paper": ("stretch", "rotation", "length", "C33", "J"),
}
