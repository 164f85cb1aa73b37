"""Random strengths: Weibull's distribution in cells of a correlation length, theory, section 32."""

import math
from collections.abc import Sequence

import numpy as np

from ..body import Body
from ..materials import Law
from ..materials.tearing import stretch_at_stress, tension_states
from ..scenes.strength import Scatter


def strength_factors(
    places: np.ndarray,
    lowest: np.ndarray,
    length: float,
    modulus: float,
    specimen: Sequence[float],
    seed: int,
) -> np.ndarray:
    """Return the factors by which strengths at places differ from the mean strength of specimens.

    All places within a cube (square in the plane) of the correlation length have one factor s, the
    others are independent of it:

        P(s < x) = 1 - exp(-(x Gamma(1 + 1/m))^m V / V0),

    with the modulus m, the volume V of a cube and V0 of the specimens. The least of the factors in
    V0 then has the mean 1, whatever the length, and the least in any other volume V1 of whole cubes
    has the mean (V0 / V1)^(1/m) (Weibull 1939).

    Parameters
    ----------
    places : ndarray, shape (n, d)
    lowest : ndarray, shape (d,)
        Corner of the cubes from which all places lie in positive directions. The factors of a cube
        depend on its place among the cubes and on the seed, not on the places that are asked for.
    length, modulus : float
    specimen : sequence of float, length d
        Sides of the uniformly stretched part of the specimens.
    seed : int

    Returns
    -------
    ndarray, shape (n,)

    References
    ----------
    Weibull, Ingeniörsvetenskapsakademiens Handlingar 151 (1939).
    """
    cells = np.floor((places - lowest) / length).astype(np.int64)
    rows, row_of = np.unique(cells[:, 1:], axis=0, return_inverse=True)
    drawn = np.empty(len(places))
    for number, row in enumerate(rows.tolist()):
        mine = np.flatnonzero(row_of.ravel() == number)
        random = np.random.default_rng([seed, *row])
        drawn[mine] = random.random(cells[mine, 0].max() + 1)[cells[mine, 0]]
    number_in_specimen = math.prod(specimen) / length ** len(specimen)
    mean = math.gamma(1 + 1 / modulus)
    return (-number_in_specimen * np.log1p(-drawn)) ** (1 / modulus) / mean


def random_works(
    scatter: Scatter, law: Law, stress: float, whole: Body, places: np.ndarray
) -> np.ndarray:
    """Return the works at break at places of a body, shape (n,), for a mean nominal stress at
    break; raise ValueError for a correlation length below the spacing, or above the specimens, and
    for stresses that the law does not reach.
    """
    if scatter.length < whole.spacing:
        raise ValueError(
            f"length must be at least the spacing, {whole.spacing:g}, not {scatter.length:g}"
        )
    if math.prod(scatter.specimen) < scatter.length**whole.dimension:
        raise ValueError(
            "specimen must be as large as one square or cube of the correlation length at least"
        )
    lowest = whole.points.min(axis=0) - whole.spacing / 2
    given = scatter.length, scatter.modulus, scatter.specimen, scatter.seed
    every = strength_factors(whole.points, lowest, *given)
    factors = strength_factors(places, lowest, *given)
    return works_at_break(law, stress, factors, float(every.max()))


def works_at_break(law: Law, stress: float, factors: np.ndarray, greatest: float) -> np.ndarray:
    """Return the energies per volume at which uniaxial tension reaches the nominal stress `stress`
    times each of the `factors`, shape (n,), of which none exceeds `greatest`.
    """
    top = stretch_at_stress(law, stress * greatest, "the greatest of the random strengths")
    return np.square(np.interp(stress * factors, *tension_states(law, top)[1:]))
