"""Feature sets of learned bond forces: the features of a bond, and the traction that the two
outputs of a model represent.

All functions are elementwise: NumPy evaluates them where regressors are trained and checked, and
numba compiles them into the kernels. ``like`` converts constants to the precision of the kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..engine.block_arrays import BLOCK, put_column
from ..engine.compile import expanded, inlined
from .algebra import entries, state_at
from .elementary import inverse_cube_root, like, logarithm, quotient

N_OUTPUTS = 2
"""Number of outputs of a learned bond force. The feature set defines their meaning: two are enough,
since they determine the components T_nn and T_nm of the bond's traction along and across the bond,
from which the third component T_mm follows (theory (15)).
"""

MOST_SHARED = 2
"""Greatest number of values that `FeatureSet.shared` may return."""


@dataclass(frozen=True)
class FeatureSet:
    """Choice of features and outputs of a learned bond force.

    The state of a bond is the components a = U_nn, b = U_nm and U_mm of its stretch tensor U, n
    along the bond and m across, the area ratio J = det U and the squared thickness stretch C33. Its
    traction is the components T_nn, T_nm and T_mm of the stress T = R^T P.

    Attributes
    ----------
    names : tuple of str
        Names of the features.
    shared : callable
        ``shared(a, b, J, C33)`` returns a tuple of values that the functions below have in common
        and take as `shared`.
    inputs : callable
        ``inputs(shared, a, b, U_mm, J, C33, length)`` returns the features; the length of the bond
        is in horizons.
    traction : callable
        ``traction(shared, o1, o2, a, b, U_mm, J, C33)`` returns T_nn, T_nm, T_mm from the two
        outputs.
    outputs : callable
        ``outputs(shared, T_nn, T_nm, a, b, U_mm, J, C33)`` returns the two outputs that give a
        traction: the inverse of `traction`, for training (NumPy only).
    anchored : int, optional
        Index of the output that must vanish in the undeformed state for the force to vanish there.
    rest_factor : float
        T_nn in the undeformed state, divided by the output at index `anchored`.
    gives_transverse : bool
        Whether `traction` returns T_mm as well, and not 0 in its place.
    needs_length : bool
        Whether the bond's length is a feature, which is then stored for every pair.
    """

    names: tuple[str, ...]
    shared: Callable
    inputs: Callable
    traction: Callable
    outputs: Callable
    anchored: int | None = None
    rest_factor: float = 1.0
    gives_transverse: bool = True
    needs_length: bool = False


def symmetric_shared(a, b, J, C33):
    """Return the tuple of the ratio k = C33/J, which the functions of the symmetric feature set
    share.
    """
    return (quotient(C33, J),)


def symmetric_inputs(shared, a, b, U_mm, J, C33, length):
    """Return the features of the symmetric set: log U_nn, log U_mm, log J, log J3^2 (theory (15)),
    from a = U_nn, b = U_nm and U_mm.

    All are even in b, so that mirror symmetry is exact, and all vanish in the undeformed state.
    """
    return logarithm(a), logarithm(U_mm), logarithm(J), logarithm(C33 * J * J)


def symmetric_traction(shared, o1, o2, a, b, U_mm, J, C33):
    """Return the traction T_nn, T_nm, T_mm from the outputs o1 = T_nn/(U_nn + k U_mm) and o2 =
    T_nm/(b (1 + k)), k = C33/J.

    a = U_nn and b = U_nm are components of the stretch tensor U. T and U are coaxial for every
    isotropic law, T_nm (U_nn - U_mm) = U_nm (T_nn - T_mm), so T_mm needs no output.
    """
    k = shared[0]
    shear = o2 * (like(a, 1.0) + k)
    T_nn = o1 * (a + k * U_mm)
    return T_nn, shear * b, T_nn - shear * (a - U_mm)


def symmetric_outputs(shared, T_nn, T_nm, a, b, U_mm, J, C33):
    """Return the outputs T_nn/(a + k U_mm) and T_nm/(b (1 + k)), k = C33/J, that represent a
    traction; inverse of `symmetric_traction`.
    """
    k = shared[0]
    return T_nn / (a + k * U_mm), T_nm / (b * (1 + k))


def isochoric_shared(a, b, J, C33):
    """Return the tuple of J3^(-2/3) and 1/J, which the functions of the isochoric feature set
    share.
    """
    return inverse_cube_root(J * J * C33), quotient(like(a, 1.0), J)


def isochoric_inputs(shared, a, b, U_mm, J, C33, length):
    """Return the features log Jbar and tr Cbar/(2 Jbar) - 1 of the isochoric stretch in the plane,
    Ubar = J3^(-1/3) U.

    For a law W_iso + U(J3) the traction is J3^(-1/3) times a function of Ubar alone, and an
    isotropic function of Ubar has two arguments: these features lose nothing, and isotropy and the
    split into W_iso and U hold exactly. The second feature is cosh log(lambda_1/lambda_2)
    - 1; its numerator is tr C/2 - J, so that the feature is zero in the undeformed state also on
      processors whose quotient of one by one is not exactly one.
    """
    c, inverse = shared
    trace = a * a + like(a, 2.0) * b * b + U_mm * U_mm
    return logarithm(c * J), (like(a, 0.5) * trace - J) * inverse


def isochoric_traction(shared, o1, o2, a, b, U_mm, J, C33):
    """Return the traction T = p (U - C33 U^-1) + r U^-1 with p = J3^(-2/3) o1 and r = o2; U is the
    stretch tensor.

    T vanishes in the undeformed state if o2 does. For laws that depend on I1bar only, r vanishes
    and p is 2 J3^(-2/3) dW/dI1bar. The components of T J are computed, and divided by J last: in
    the undeformed state they are zero in exact arithmetic and in floating point, whatever the
    rounding of a quotient.
    """
    c, inverse = shared
    p = c * o1
    q = o2 - C33 * p
    p = p * J
    return (p * a + q * U_mm) * inverse, (p - q) * b * inverse, (p * U_mm + q * a) * inverse


def isochoric_outputs(shared, T_nn, T_nm, a, b, U_mm, J, C33):
    """Return the outputs o1 and o2 that represent a traction by the isochoric feature set; the
    inverse of `isochoric_traction`.
    """
    c = shared[0]
    q = (T_nn - a * T_nm / b) / (a + U_mm)
    p = T_nm / b + q
    return p / c, q * J + C33 * p


def write_tractions(features: FeatureSet):
    """Return the function that turns a model's two outputs for every bond of a block into
    tractions, in place.

    The returned function takes the outputs in the first two rows of `traction`, and subtracts
    `at_rest`, the outputs in the undeformed state, from them. Its argument `kept` holds the values
    of `FeatureSet.shared` for every bond.
    """
    traction_of = inlined(features.traction)
    shared_at = entries(
        "kept, k",
        [f"kept[{number}, k]" for number in range(len(features.shared(1.0, 0.0, 1.0, 1.0)))],
    )

    @expanded
    def write(states, kept, at_rest, traction):
        rest0 = at_rest[0]
        rest1 = at_rest[1]
        for k in range(BLOCK):
            a, b, U_mm, J, C33 = state_at(states, k)
            o1 = traction[0, k] - rest0
            o2 = traction[1, k] - rest1
            put_column(traction, k, traction_of(shared_at(kept, k), o1, o2, a, b, U_mm, J, C33))

    return write


FEATURE_SETS: dict[str, FeatureSet] = {
    "symmetric": FeatureSet(
        ("log U_nn", "log U_mm", "log J", "log J3^2"),
        symmetric_shared,
        symmetric_inputs,
        symmetric_traction,
        symmetric_outputs,
        anchored=0,
        rest_factor=2.0,
    ),
    "isochoric": FeatureSet(
        ("log Jbar", "tr Cbar/(2 Jbar) - 1"),
        isochoric_shared,
        isochoric_inputs,
        isochoric_traction,
        isochoric_outputs,
        anchored=1,
    ),
}
"""All feature sets by name. A module that defines another one registers it here:
``FEATURE_SETS[name] = FeatureSet(...)``.
"""
