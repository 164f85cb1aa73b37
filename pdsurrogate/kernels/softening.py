"""Softening of an isochoric energy by the factor of Ogden and Roxburgh, theory (97).

`softening` are the parameters (r, m, beta). All functions take reals, or arrays from Python, and
contain no branch, so that loops over pairs are vectorized.
"""

import math

from ..engine.compile import inlined
from .elementary import error_function, exponential, select

AT_REST = 1 / math.sqrt(math.pi)
"""Value at 0 of G(z) = z erf z + exp(-z^2)/sqrt(pi), an integral of erf."""

LEAST = 1e-300
"""Least scale of softening, by which a difference of zero is divided at rest if m = 0."""

FULL = 30.0
"""Argument from which on erf is 1 in double precision."""


@inlined
def _erf_at(difference, greatest, softening):
    """Return erf z, exp(-z^2) and s, for z = `difference`/s and the scale s at a `greatest`
    energy.
    """
    scale = softening[1] + softening[2] * greatest
    scale = select(scale > LEAST, scale, LEAST)
    z = difference / scale
    z = select(z < FULL, z, FULL)
    decay = exponential(-z * z)
    return error_function(z, decay), decay, scale


@inlined
def _softened(difference, greatest, softening):
    """Return erf z and the energy (s/r) times the integral of erf from 0 to z, see `_erf_at`."""
    erf, decay, scale = _erf_at(difference, greatest, softening)
    return erf, (difference * erf + scale * ((decay - 1.0) * AT_REST)) / softening[0]


@inlined
def softening_loss(greatest, softening):
    """Return the energy that softening has dissipated once the greatest energy was `greatest`."""
    return _softened(greatest, greatest, softening)[1]


@inlined
def softening_factor(energy, greatest, softening):
    """Return the factor eta at an energy W, and its derivative by W."""
    below = select(energy < greatest, greatest - energy, 0.0)
    erf, decay, scale = _erf_at(below, greatest, softening)
    slope = 2.0 * AT_REST / (softening[0] * scale) * decay
    return 1.0 - erf / softening[0], select(below > 0.0, slope, 0.0)


@inlined
def soften(energy, greatest, loss, softening):
    """Return the factor eta at an energy W, its integral over W at the greatest energy before, and
    the stored energy.

    `loss` is the `softening_loss` at the greatest energy before. Beyond that energy the integral is
    W plus a constant, a potential of the step; the energy stored is then less.
    """
    beyond = energy > greatest
    difference = select(beyond, energy, greatest - energy)
    erf, part = _softened(difference, select(beyond, energy, greatest), softening)
    potential = energy - loss + select(beyond, 0.0, part)
    return (
        select(beyond, 1.0, 1.0 - erf / softening[0]),
        potential,
        select(beyond, energy - part, potential),
    )
