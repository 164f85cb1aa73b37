"""Guards: the edge of a surrogate's domain, and the blend of its force or energy into the exact one near that edge.

A bond force, the energy of a sheet and an isochoric energy depend on different invariants, so each has its own test of the edge. Both
energies blend with a polynomial of two continuous derivatives; the force, with one of a single continuous derivative (theory (18)).
"""

import numpy as np

from ..engine.compile import inline
from .elementary import select
from .feature_sets import like


@inline
def blend(t):
    """Return the polynomial that rises from 0 at t = 0 to 1 at t = 1 with two continuous derivatives, and its derivative; t is clipped."""
    t = select(t > 0.0, t, 0.0)
    t = select(t < 1.0, t, 1.0)
    return t * t * t * (10.0 + t * (6.0 * t - 15.0)), 30.0 * t * t * (1.0 - t) * (1.0 - t)


@inline
def is_outside(a, b, U_mm, J, C33, limits):
    """Return 1 for a bond outside the domain, else 0; NaN counts as outside, and so does a bond without a stretch tensor.

    With J the product of the principal stretches, both lie within [low, high] exactly if J lies within [low**2, high**2] and tr C is at
    most high**2 + J**2/high**2 and low**2 + J**2/low**2: no eigenvalue is needed. `limits` is a tuple of low**2, high**2, their inverses,
    the least and greatest J3**2 = J**2 C33, and the least a.
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
    """Return the share of the surrogate in the force: 1 within the interior of the domain, 0 outside the domain, rising smoothly between.

    Without this band the force would jump at the edge by the error of the surrogate, and an equilibrium with bonds on the edge need not
    exist.
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
    """Return 0 at `edge`, 1 from `full` on, linear between."""
    return min(max((value - edge) / (full - edge), 0.0), 1.0) if full != edge else 1.0


DOMAIN_SIZE = 7
"""Number of constants of `edge_distances` and `exact_share`."""


@inline
def edge_distances(trace, J, domain):
    """Return how far a state of a sheet lies beyond the four edges of the domain: positive outside, all negative inside.

    With L and H the squares of the least and the greatest stretch, both stretches lie within unless tr C > H + J^2/H (one above), J > H
    (both above), tr C > L + J^2/L (one below) or J < L (both below). Each distance is about the relative change of the offending squared
    stretch.
    """
    low, high, inverse_low, inverse_high = domain[0], domain[1], domain[2], domain[3]
    square = J * J
    one = domain[4]
    return (
        trace / (high + square * inverse_high) - one,
        one - (low + square * inverse_low) / trace,
        J * inverse_high - one,
        one - J * inverse_low,
    )


@inline
def exact_share(trace, J, domain):
    """Return the share of the exact energy, 0 well inside the domain and 1 outside, and its derivatives by tr C and J.

    A switch at the edge itself would make the energy jump by the error of the fit.
    """
    low, high, inverse_low, inverse_high, width = domain[0], domain[1], domain[2], domain[3], domain[6]
    square = J * J
    above = high + square * inverse_high
    below = low + square * inverse_low
    s1, d1 = blend((trace / above - 1.0) / width + 1.0)
    s2, d2 = blend((1.0 - below / trace) / width + 1.0)
    s3, d3 = blend((J * inverse_high - 1.0) / width + 1.0)
    s4, d4 = blend((1.0 - J * inverse_low) / width + 1.0)
    d1, d2, d3, d4 = d1 / width, d2 / width, d3 / width, d4 / width
    r1, r2, r3, r4 = 1.0 - s1, 1.0 - s2, 1.0 - s3, 1.0 - s4
    by_trace = d1 / above * r2 * r3 * r4 + d2 * below / (trace * trace) * r1 * r3 * r4
    by_J = -d1 * trace * 2.0 * J * inverse_high / (above * above) * r2 * r3 * r4
    by_J += -d2 * 2.0 * J * inverse_low / trace * r1 * r3 * r4
    by_J += d3 * inverse_high * r1 * r2 * r4 - d4 * inverse_low * r1 * r2 * r3
    return 1.0 - r1 * r2 * r3 * r4, by_trace, by_J


def distance_coefficients(low, high):
    """Return the coefficients by (1, I1bar, I2bar) of the distances from both bounds of the isochoric stretches, shape (2, 3)."""
    low, high = max(low, high**-2), min(high, low**-2)
    a, b = low**2, high**2
    return np.array([[1 - a**3, a * a, -a], [1 - b**-3, -1 / b, b**-2]])


@inline
def exact_share_at(distance, band):
    """Return the share of the exact energy, 0 inside the band and 1 at the edge, and its derivative by the distance."""
    share, slope = blend(1.0 - distance / band)
    return share, -slope / band
