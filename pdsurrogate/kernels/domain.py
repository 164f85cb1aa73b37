"""Edge of the domain in which a surrogate holds, and the blend of its force or energy into the
exact one near that edge.

A bond force, the energy of a sheet and an isochoric energy depend on different invariants, so each
has its own distances from the edges. All three blend with one polynomial of two continuous
derivatives (theory (18)), since the stiffness of an energy needs both. The limits of a domain are
low^2, high^2, their inverses, the least and greatest J3^2 = J^2 C33, and the least a = U_nn, where
low and high bound the principal stretches. NumPy evaluates the functions of an energy, too.
"""

import numpy as np

from ..engine.compile import inline, inlined
from .elementary import like, select

N_LIMITS = 7
"""Number of values that bound a domain: low^2, high^2, their inverses, the least and the greatest
J3^2, and the least U_nn, where low and high bound the principal stretches and J3 is the volume
ratio.
"""

BLEND = 0.1
"""Relative width, in squared stretch, of the band inside an edge in which the exact energy is
blended in.

The slope of the share of the exact energy is at most 1.9/BLEND: the blend changes the stress by 19
times the error of the learned energy at the edge, which is less than the error of the stress of a
fit whose energy and stress have been learned together.
"""


@inlined
def blend(t):
    """Return the polynomial that rises from 0 at t = 0 to 1 at t = 1, and its derivative; t is
    clipped to [0, 1].
    """
    t = select(t > 0.0, t, 0.0)
    t = select(t < 1.0, t, 1.0)
    return t * t * t * (10.0 + t * (6.0 * t - 15.0)), 30.0 * t * t * (1.0 - t) * (1.0 - t)


@inline
def is_outside(a, b, U_mm, J, C33, limits):
    """Return 1 for a bond whose state lies outside a surrogate's domain, else 0; NaN and a bond
    without a stretch tensor are outside.

    `a`, `b` and `U_mm` are the components U_nn, U_nm and U_mm of the stretch tensor, n along the
    bond and m across. With J the product of the principal stretches in the plane, both stretches
    lie within [low, high] exactly if J lies within [low^2, high^2] and tr C exceeds neither high^2
    + J^2/high^2 nor low^2 + J^2/low^2: no eigenvalue is needed.
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
    """Return the share of the surrogate in the force of a bond: 1 within the interior of its
    domain, 0 outside, rising smoothly between.

    The state has the components a = U_nn, b = U_nm and U_mm of the stretch tensor, n along the bond
    and m across, the area ratio J and the squared thickness stretch C33. `outer` and `inner` are
    the limits of the domain and of its interior. Without the band between both limits the force
    would jump at the edge by the error of the surrogate, and a body with bonds on the edge might
    have no equilibrium.
    """
    if is_outside(a, b, U_mm, J, C33, outer) > 0.0:
        return 0.0
    trace = a * a + b * b + b * b + U_mm * U_mm
    total = np.sqrt(trace + J + J)
    difference = np.sqrt(max(trace - J - J, 0.0))
    least = 0.5 * (total - difference)
    greatest = 0.5 * (total + difference)
    bulk = J * J * C33
    share = min(
        _rise(least, np.sqrt(outer[0]), np.sqrt(inner[0])),
        _rise(greatest, np.sqrt(outer[1]), np.sqrt(inner[1])),
        _rise(bulk, outer[4], inner[4]),
        _rise(bulk, outer[5], inner[5]),
    )
    return blend(share)[0]


@inline
def _rise(value, edge, full):
    """Return (value - edge)/(full - edge) clipped to [0, 1], where `full` may be above or below
    `edge`; 1 if they are equal.
    """
    return min(max((value - edge) / (full - edge), 0.0), 1.0) if full != edge else 1.0


@inlined
def edge_distances(trace, J, limits):
    """Return how far a state of a sheet lies beyond each of the four edges of the domain: positive
    outside, all negative inside.

    `trace` is tr C and J is det F, both in the plane. With L and H the squares of the least and the
    greatest stretch of the domain, both principal stretches lie within the domain unless tr C > H +
    J^2/H (one is above), tr C > L + J^2/L (one is below), J > H (both are above) or J < L (both are
    below). Each distance is about the relative change of the offending squared stretch.
    """
    low = limits[0]
    high = limits[1]
    inverse_low = limits[2]
    inverse_high = limits[3]
    square = J * J
    one = like(J, 1.0)
    return (
        trace / (high + square * inverse_high) - one,
        one - (low + square * inverse_low) / trace,
        J * inverse_high - one,
        one - J * inverse_low,
    )


@inlined
def exact_share(trace, J, limits):
    """Return the share of the exact energy, 0 well inside the domain and 1 outside, and its
    derivatives by tr C (`trace`) and J.

    A switch at the edge itself would make the energy jump by the error of the fit.
    """
    low = limits[0]
    high = limits[1]
    inverse_low = limits[2]
    inverse_high = limits[3]
    above = high + J * J * inverse_high
    below = low + J * J * inverse_low
    by_above = 2.0 * J * inverse_high
    by_below = 2.0 * J * inverse_low
    zero = 0.0 * J
    d1, d2, d3, d4 = edge_distances(trace, J, limits)
    one_above = _share_within(d1, 1.0 / above, -trace * by_above / (above * above))
    one_below = _share_within(d2, below / (trace * trace), -by_below / trace)
    both_above = _share_within(d3, zero, zero + inverse_high)
    both_below = _share_within(d4, zero, zero - inverse_low)
    rest = _product(_product(one_above, one_below), _product(both_above, both_below))
    return 1.0 - rest[0], -rest[1], -rest[2]


@inlined
def _share_within(distance, by_trace, by_J):
    """Return the share of the surrogate near one edge of its domain, 1 deep inside and 0 at the
    edge, and its derivatives by tr C and J.

    `distance` is the distance beyond the edge, `by_trace` and `by_J` are its derivatives.
    """
    share, slope = blend(distance / BLEND + 1.0)
    slope = slope / BLEND
    return 1.0 - share, -slope * by_trace, -slope * by_J


@inlined
def _product(f, g):
    """Return the product of two functions of tr C and J with its derivatives; each is a tuple
    (value, by tr C, by J).
    """
    return f[0] * g[0], f[1] * g[0] + f[0] * g[1], f[2] * g[0] + f[0] * g[2]


def distance_coefficients(low, high):
    """Return the coefficients of the distances of a state from the lower and the upper bound of the
    isochoric stretches, shape (2, 3).

    A distance is linear in the isochoric invariants; its coefficients are those of (1, I1bar,
    I2bar).
    """
    low, high = max(low, high**-2), min(high, low**-2)
    a = low**2
    b = high**2
    return np.array([[1 - a**3, a * a, -a], [1 - b**-3, -1 / b, b**-2]])


@inlined
def exact_share_at(distance):
    """Return the share of the exact energy at a distance from the edge, positive inside the domain,
    and its derivative by the distance.

    The share is 1 at the edge and outside, and 0 from the distance `BLEND` on.
    """
    share, slope = blend(1.0 - distance / BLEND)
    return share, -slope / BLEND
