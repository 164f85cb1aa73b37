"""Dictionary of energies: terms with their names, energies, derivatives and convexity, and the sets
from which regressors choose.

A sum of polyconvex functions with positive coefficients is polyconvex. These are the reasons why
each term but the last is polyconvex:

- powers of I1bar - 3 and of I2bar^1.5 - 3 sqrt 3: I1bar and I2bar^1.5 are polyconvex (Hartmann,
  Neff, Int. J. Solids Struct. 40 (2003) 2767; I2bar itself is not), the differences are not
  negative, and powers of such numbers are convex and do not decrease;
- powers of the stretches, among deformations of constant volume: l1^a + l2^a + l3^a is a convex
  function of F for a >= 1, and of cof F, whose singular values are the inverses of the stretches,
  for a <= -1 (Ball, Arch. Rat. Mech. Anal. 63 (1977) 337);
- sqrt I1bar and sqrt I2bar, among deformations of constant volume: the norms of F and of cof F.

log(I2bar/3), as in the law of Gent and Thomas, is not polyconvex: along F + t a x n that keeps the
volume it is concave at large t. A sum with this term may still be convex along all such lines in
the states of a body, which `wave_margin` tells.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..kernels.elementary_in_numpy import exponential, logarithm, select

GREATEST_POWER = 4
"""Greatest power of I1bar - 3 and of I2bar^1.5 - 3 sqrt 3. Chosen: the third, as in Yeoh's law, and
the fourth, as in Carroll's, describe the rise of the stress at great stretches; higher ones would
act at the greatest stretches of the data alone.
"""

STATES = 13
DIRECTIONS = 6
LINE_STEP = 1e-3
"""Number of stretches of each axis and of angles in a quarter turn of `line_curvatures`, and the
step of its differences: the rounding is then some 1e-9, and the error of the difference a
millionth.
"""

STABLE_TO = 3.0
"""Greatest stretch of the states in which the waves of every fitted energy must be stable,
unless measurements exceed it.
"""


KINDS = {
    "stretches": "exponent {:g}",
    "first": "I1bar - 3 to the power {:g}",
    "second": "I2bar^1.5 - 3 sqrt 3 to the power {:g}",
    "roots": "root of I{:g}bar",
    "second_logarithm": "logarithm of I2bar",
}
"""Names of the terms in reports, with a place for their number, by their kind. The kinds are also
the names of the parameters of `Polyconvex`; ``stretches`` are its ``exponents``.
"""


class Term(NamedTuple):
    """One energy of the dictionary, with the coefficient 1.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    number : float
        Exponent a of ``stretches``, (l1^a + l2^a + l3^a - 3)/a^2; power k of ``first``, (I1bar -
        3)^k, and of ``second``, (I2bar^1.5 - 3 sqrt 3)^k; 1 or 2 of ``roots``, sqrt I1bar - sqrt 3
        or sqrt I2bar - sqrt 3; 1 of ``second_logarithm``, log(I2bar/3).
    """

    kind: str
    number: float

    def __str__(self) -> str:
        return KINDS[self.kind].format(self.number)

    @property
    def polyconvex(self) -> bool:
        """Whether the term is polyconvex, at least among deformations of constant volume."""
        return self.kind != "second_logarithm"

    @property
    def row(self) -> tuple[float, ...]:
        """Constants (a, r, c1, ..., c4) of c1 z + ... + c4 z^4, z = S^r - 3^r and S = l1^a + l2^a +
        l3^a.

        With r = 0, z = log(S/3).
        """
        kind, number = self
        if kind == "stretches":
            return (number, 1.0, number**-2.0, 0.0, 0.0, 0.0)
        if kind == "roots":
            return (2.0 if number == 1 else -2.0, 0.5, 1.0, 0.0, 0.0, 0.0)
        if kind == "second_logarithm":
            return (-2.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        return (
            *((2.0, 1.0) if kind == "first" else (-2.0, 1.5)),
            *(float(number == k) for k in range(1, GREATEST_POWER + 1)),
        )

    @property
    def shear_modulus(self) -> float:
        """Shear modulus of the undeformed material."""
        a, r, c1, *_ = self.row
        return a**2 / 2 * c1 * (r or 1.0) * 3 ** (r - 1)


OF_INVARIANTS = (
    *(
        Term("roots", 1.0),
        Term("stretches", 2.0),
        Term("first", 2.0),
        Term("first", 3.0),
        Term("first", 4.0),
    ),
    *(Term("second_logarithm", 1.0), Term("roots", 2.0), Term("stretches", -2.0)),
)
"""Terms of separate functions of the invariants: of I1bar its root, I1bar - 3 itself, which is the
exponent 2, and the powers of Yeoh's and Carroll's laws; of I2bar those of Gent and Thomas, of
Carroll, and of Mooney and Rivlin. Terms that rise faster with I2bar are left out: the stresses in
equibiaxial tension, which few tests of bodies contain, could be off by a factor.
"""

OF_TESTS = (*OF_INVARIANTS, Term("stretches", 1.0))
"""Terms for tests that visit all modes of loading: those of the invariants, and l1 + l2 + l3 of
Varga's law, a separate function of the stretches. Sums of functions of one invariant each do not
have the exponents between 1 and 2 of Ogden's law for natural rubber.
"""


def energy_of_row(x1, x2, x3, s1, s2, s3, coefficients):
    """Return the energy of constants, `Term.row`, and derivatives, as
    `pdsurrogate.materials.law.PrincipalStretchLaw.term` does.
    """
    exponent, power, c1, c2, c3, c4 = coefficients
    e1 = exponential(exponent * x1)
    e2 = exponential(exponent * x2)
    e3 = exponential(exponent * x3)
    S = e1 + e2 + e3
    root = np.sqrt(S)
    # z, its derivatives by S, and those of the energy by z.
    linear = power == 1.0
    rising = power == 1.5
    flat = power == 0.0
    z = select(rising, S * root - 3 * np.sqrt(3.0), root - np.sqrt(3.0))
    z = select(linear, S - 3, select(flat, logarithm(S / 3), z))
    z1 = select(linear, 1.0, select(rising, 1.5 * root, select(flat, 1 / S, 0.5 / root)))
    z2 = select(
        linear, 0.0, select(rising, 0.75 / root, select(flat, -1 / (S * S), -0.25 / (S * root)))
    )
    W = z * (c1 + z * (c2 + z * (c3 + z * c4)))
    W1 = c1 + z * (2 * c2 + z * (3 * c3 + z * 4 * c4))
    W2 = 2 * c2 + z * (6 * c3 + z * 12 * c4)
    slope = exponent * W1 * z1
    along = exponent * (2 * e3 - e1 - e2) / 3
    h = exponent * slope * (e1 + e2 + 4 * e3) / 9 + (W2 * z1 * z1 + W1 * z2) * along * along
    return W, slope * e1, slope * e2, slope * e3, h


def derivatives(terms: Sequence[Term], logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the energies of terms with the coefficient 1, and their derivatives by the logarithms
    of the isochoric principal stretches.

    Parameters
    ----------
    terms : sequence of Term
    logs : ndarray, shape (n, 3)
        Logarithms of the isochoric principal stretches; their sum is 0.

    Returns
    -------
    energies : ndarray, shape (n, n_terms)
    slopes : ndarray, shape (n, n_terms, 3)
        The deviators of these are the principal Kirchhoff stresses.

    Examples
    --------
    >>> import numpy as np
    >>> from pdsurrogate.materials.dictionary import Term, derivatives
    >>> energies, slopes = derivatives([Term("first", 1.0)], np.log([[2.0, 1.0, 0.5]]))
    >>> energies.tolist(), slopes.round(6).tolist()
    ([[2.25]], [[[8.0, 2.0, 0.5]]])
    """
    x = np.asarray(logs, dtype=float).T[:, :, None]
    x1, x2, x3 = x
    s1, s2, s3 = np.exp(2 * x)
    energy, *slopes, _ = energy_of_row(
        x1, x2, x3, s1, s2, s3, np.array([term.row for term in terms]).T
    )
    return energy, np.stack(slopes, axis=-1)


def line_curvatures(terms: Sequence[Term], greatest: float = 3.0) -> np.ndarray:
    """Return second derivatives of terms with the coefficient 1 along lines F + t a x n that keep
    the volume, shape (n_lines, n_terms).

    An energy is strongly elliptic in a state, that is, shear waves of all directions and
    polarizations are stable, if these are positive. The states F have principal stretches from
    1/`greatest` to `greatest`, and the lines the directions n of an octant.

    Examples
    --------
    >>> from pdsurrogate.materials.dictionary import Term, line_curvatures
    >>> curvatures = line_curvatures([Term("first", 1.0), Term("second_logarithm", 1.0)])
    >>> (
    ...     curvatures[:, 0].min().round(3).item(),
    ...     bool(curvatures[:, 1].min() < 0),
    ...     bool((2 * curvatures[:, 0] + curvatures[:, 1]).min() > 0),
    ... )
    (2.0, True, True)
    """
    logs = np.linspace(-1.0, 1.0, STATES) * np.log(greatest)
    first, second = (grid.ravel() for grid in np.meshgrid(logs, logs))
    kept = (first >= second) & (second >= -first - second) & (-first - second >= logs[0] - 1e-9)
    stretches = np.exp(np.column_stack([first, second, -first - second])[kept])
    angles = (np.arange(DIRECTIONS) + 0.5) * np.pi / 2 / DIRECTIONS
    polar, around, turn = (
        grid.ravel()
        for grid in np.meshgrid(angles, angles, np.arange(2 * DIRECTIONS) * np.pi / 2 / DIRECTIONS)
    )
    n = np.stack(
        [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=1
    )
    # a is perpendicular to the normal of the deformed surface, F^-T n.
    normal = n / stretches[:, None]
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    across = np.cross(normal, np.roll(normal, 1, axis=2) * [1.0, -1.0, 1.0])
    across /= np.linalg.norm(across, axis=2, keepdims=True)
    a = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * np.cross(normal, across)
    F = stretches[:, None, :, None] * np.eye(3)
    energies = []
    for step in (-LINE_STEP, 0.0, LINE_STEP):
        moved = (F + step * a[..., :, None] * n[:, None, :]).reshape(-1, 3, 3)
        energies.append(
            derivatives(terms, np.log(np.linalg.eigvalsh(np.swapaxes(moved, 1, 2) @ moved)) / 2)[0]
        )
    return (energies[0] - 2 * energies[1] + energies[2]) / LINE_STEP**2


def wave_margin(
    terms: Sequence[Term], greatest: float = STABLE_TO
) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that tells by how much shear waves are stable in sums of terms: from -1 to
    1, positive if they are.

    The function takes coefficients, shape (..., n_terms), and returns margins, shape (...). Sums of
    polyconvex terms have stable waves in all states, and the margin 1. The others have the least
    sum of the second derivatives of their terms among the lines of `line_curvatures`, divided by
    the sum of the absolute values of these.

    Examples
    --------
    >>> import numpy as np
    >>> from pdsurrogate.materials.dictionary import Term, wave_margin
    >>> wave_margin([Term("first", 1.0), Term("second_logarithm", 1.0)])(
    ...     np.array([[1.0, 0.0], [1.0, 2.0], [0.02, 1.0]])
    ... ).round(2).tolist()
    [1.0, 0.85, -0.43]
    """
    by_form = np.array([term.polyconvex for term in terms])
    curvatures = np.empty((0, len(terms))) if by_form.all() else line_curvatures(terms, greatest)

    def margin(coefficients: np.ndarray) -> np.ndarray:
        found = np.asarray(coefficients).reshape(-1, len(terms))
        margins = np.ones(len(found))
        doubtful = (found[:, ~by_form] != 0).any(axis=1)
        sums = found[doubtful] @ curvatures.T
        sizes = np.abs(found[doubtful]) @ np.abs(curvatures.T)
        margins[doubtful] = (sums / np.maximum(sizes, 1e-300)).min(axis=1, initial=1.0)
        return margins.reshape(np.shape(coefficients)[:-1])

    return margin
