"""Feature set "paper": the paper's five features of a bond as inputs, the bond force along and
across the deformed bond as outputs.
"""

import numpy as np
from numba import types
from numba.extending import overload

from ..engine.compile import INLINE_OPTIONS
from ..kernels.elementary import like
from ..kernels.feature_sets import FEATURE_SETS, FeatureSet


def arctangent(y, x):
    """Return atan2(y, x) for x > 0 (a bond turned by less than a right angle). Absolute error
    below 4e-7 (float32) and 1e-15 (float64).
    """
    return np.arctan2(y, x)


@overload(arctangent, jit_options=INLINE_OPTIONS)
def _arctangent(y, x):
    # Half-angle steps, tan(t/2) = tan t / (1 + sqrt(1 + tan**2 t)), bring the angle below pi/8
    # (float64: pi/16); then the odd series.
    halvings, last = (1, 15) if x == types.float32 else (2, 21)

    def implementation(y, x):
        one = like(x, 1.0)
        t = y / (x + np.sqrt(x * x + y * y))
        for _ in range(halvings):
            t = t / (one + np.sqrt(one + t * t))
        s = t * t
        series = like(x, 1.0 / last)
        for k in range(last - 2, 1, -2):
            series = like(x, 1.0 / k) - s * series
        return like(x, 2.0 * 2**halvings) * (t - t * s * series)

    return implementation


def shared(a, b, J, C33):
    """Return the bond stretch lambda_b and its inverse, which `inputs`, `traction` and `outputs`
    use, from a = U_nn and b = U_nm.

    U is the stretch tensor in the axes n and m along and across the undeformed bond, in all
    functions of this feature set.
    """
    stretch = np.sqrt(a * a + b * b)
    return stretch, like(a, 1.0) / stretch


def inputs(shared, a, b, U_mm, J, C33, length):
    """Return the paper's five features of a bond: stretch, rotation relative to its horizon, length
    divided by the horizon, C33, and J.

    `shared` is the result of the function of this name; a = U_nn and b = U_nm are components of the
    stretch tensor (theory (10)).
    """
    return shared[0], arctangent(b, a), length, C33, J


def traction(shared, o1, o2, a, b, U_mm, J, C33):
    """Return the stress components T_nn, T_nm and T_mm in the axes n, m along and across the
    undeformed bond (theory (11)).

    `shared` is the result of the function of this name: the bond stretch and its inverse. `o1` and
    `o2` are the components of the force along and across the deformed bond, and a = U_nn and b =
    U_nm those of the stretch tensor. The force does not determine T_mm, which is set to 0.
    """
    inverse = shared[1]
    return (o1 * a - o2 * b) * inverse, (o1 * b + o2 * a) * inverse, like(a, 0.0) * o1


def outputs(shared, T_nn, T_nm, a, b, U_mm, J, C33):
    """Return the force components along and across the deformed bond from the stress components
    T_nn and T_nm: the inverse of `traction`.

    The stress is in the axes n, m along and across the undeformed bond; a = U_nn and b = U_nm are
    components of the stretch tensor.
    """
    inverse = shared[1]
    return (T_nn * a + T_nm * b) * inverse, (T_nm * a - T_nn * b) * inverse


NAMES = ("stretch", "rotation", "length", "C33", "J")

FEATURE_SETS["paper"] = FeatureSet(
    NAMES, shared, inputs, traction, outputs, gives_transverse=False, needs_length=True
)
