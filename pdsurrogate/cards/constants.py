"""Constants of laws as other programs define them, and the energies of these programs."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from ..materials import ArrudaBoyce, Gent, Law, Ogden

NO_TERM = 1e20
"""Constant D of a volumetric term that is not there, in any unit: CalculiX 2.20 replaces a zero by
a number that depends on the unit.
"""

SERIES = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)
"""Factors of I1bar^i - 3^i, i from 1, in the series of the eight-chain law over powers of 1/N.
Arruda, Boyce, J. Mech. Phys. Solids 41 (1993) 389.
"""


POWERS: dict[str, Callable] = {"mu": lambda a: 1.0, "mu_1": lambda a: a, "mu_2": lambda a: a / 2}
"""Factors, as functions of the exponent a, between the mu of a term mu/a (l1^a + l2^a + l3^a - 3)
and the constant that a program has in its place, by the name of that constant in programs.toml.
"""


def _volume(U: Callable, slope: Callable, curvature: Callable) -> Callable:
    """Return the method of a law with U, U' and U'' of J at K = 1."""

    def volumetric(J3, parameters):
        return tuple(parameters[0] * part(J3) for part in (U, slope, curvature))

    return volumetric


VOLUMES = {
    "K/2 (J - 1)^2": _volume(lambda J: (J - 1) ** 2 / 2, lambda J: J - 1, lambda J: 1 + 0 * J),
    "K/2 ((J^2 - 1)/2 - ln J)": Gent.volumetric,
    "K/2 (ln J)^2": _volume(
        lambda J: np.log(J) ** 2 / 2,
        lambda J: np.log(J) / J,
        lambda J: (1 - np.log(J)) / J**2,
    ),
    "K/2 (J + 1/J - 2)": _volume(
        lambda J: (J + 1 / J) / 2 - 1, lambda J: (1 - J**-2) / 2, lambda J: J**-3
    ),
}
"""Volumetric energies U(J) of other programs, by their formulas."""


def series(links: float) -> Polynomial:
    """Return the series of the eight-chain law over its factor, a polynomial of I1bar."""
    return Polynomial([0, *(c / links**i for i, c in enumerate(SERIES))])


def series_modulus(links: float) -> float:
    """Return the initial shear modulus of the series over its factor."""
    return float(2 * series(links).deriv()(3.0))


class _SeriesOfChains(ArrudaBoyce):
    """The series in the place of the eight-chain law, with the same initial shear modulus."""

    @staticmethod
    def isochoric(I1, I2, parameters):
        energy = series(parameters[1]) / series_modulus(parameters[1])
        zero = 0 * I1
        W, W1, W11 = (energy.deriv(order)(I1) for order in range(3))
        return W - energy(3.0), W1, zero, W11, zero, zero


def as_read(law: Law, volume: str) -> Law:
    """Return the law that a program computes from the card of a law: with the series of the
    eight-chain law, and a volumetric energy of `VOLUMES`, or the law's own if it is not known.
    """
    base = _SeriesOfChains if isinstance(law, ArrudaBoyce) else type(law)
    volumetric = VOLUMES.get(volume, type(law).volumetric)
    kind = type("AsRead", (base,), {"volumetric": staticmethod(volumetric)})
    return kind(**{key: getattr(law, key) for key in law.defaults()})


def constants_of(law: Law) -> dict[str, tuple[float, ...]]:
    """Return the constants of a law under all names of programs.toml.

    mu0 and K are the initial moduli, nu Poisson's ratio, D = 2/K with `NO_TERM` for further terms,
    C the Ci0 of powers of I1bar - 3. Of powers of stretches, mu and alpha are those of the law,
    mu_1 and mu_2 those of `POWERS`. Of the series of the eight-chain law, chains is the factor,
    links N and lock its root.
    """
    mu, K = law.shear_modulus, law.bulk_modulus
    found = {"mu0": (mu,), "K": (K,), "nu": (law.poisson_ratio,)}
    shape = law.shape
    terms = 1
    moduli: Sequence[float] = ()
    exponents = (2.0, -2.0)
    if isinstance(law, Ogden):
        moduli, exponents = law.moduli, law.exponents
        terms = len(moduli)
    elif N := shape.get("chain_links"):
        found |= {"chains": (mu / series_modulus(N),), "links": (N,), "lock": (N**0.5,)}
    elif limit := shape.get("chain_limit"):
        found["Jm"] = (limit,)
    else:
        C01 = mu / 2 * shape.get("second_share", 0.0)
        C10 = mu / 2 - C01
        terms = 3 if "third" in shape else 1
        C = (C10, C10 * shape.get("second", 0.0), C10 * shape.get("third", 0.0))
        found |= {"C10": C[:1], "C20": C[1:2], "C30": C[2:], "C01": (C01,), "C": C[:terms]}
        moduli = (2 * C10, -2 * C01)[: 1 + (C01 > 0)]
    found["D"] = (2 / K, *[NO_TERM] * (terms - 1))
    found["alpha"] = tuple(exponents)[: len(moduli)]
    for name, over in POWERS.items():
        found[name] = tuple(m * over(a) for m, a in zip(moduli, found["alpha"], strict=True))
    return found


def law_keys(found: Mapping[str, Sequence[float]]) -> dict[str, Any]:
    """Return the keys of the material in a scene whose constants are given under some of the names
    of `constants_of`; without bulk_modulus if K, D and nu are 0.

    Raises
    ------
    ValueError
        If no law has all the constants that are not 0.
    """
    first = {key: values[0] for key, values in found.items()}
    modulus = first.get("mu0", 0.0)
    C = [*found.get("C", [first.get(key, 0.0) for key in ("C10", "C20", "C30")]), 0.0, 0.0]
    C01 = first.get("C01", 0.0)
    keys: dict[str, Any] = {}
    if "chains" in first:
        links = first.get("links") or max(first.get("lock", 0.0), 0.0) ** 2
        if not links > 0:
            raise ValueError("its locking stretch or number of links must be positive")
        keys = {"law": "arruda-boyce", "chain_links": links}
        modulus = first["chains"] * series_modulus(keys["chain_links"])
    elif "Jm" in first:
        keys = {"law": "gent", "chain_limit": first["Jm"]}
    elif alphas := found.get("alpha"):
        name = next(name for name in POWERS if name in found)
        terms = zip(found[name], alphas, strict=False)
        pairs = [(m / (POWERS[name](a) or 1.0), a) for m, a in terms if m]
        modulus = sum(m * a for m, a in pairs) / 2
        moduli, exponents = ([pair[k] for pair in pairs] for k in range(2))
        if exponents in ([2], [-2], [2, -2]):
            of = dict(zip(exponents, moduli, strict=True))
            C[0], C01 = of.get(2, 0.0) / 2, -of.get(-2, 0.0) / 2
        else:
            keys = {"law": "ogden", "moduli": moduli, "exponents": exponents}
    if any(C[3:]) or (C01 and any(C[1:])):
        raise ValueError("no law here has all of its constants")
    modulus = modulus or 2 * (C[0] + C01)
    if not modulus > 0:
        raise ValueError(f"its initial shear modulus is {modulus:g}, which must be positive")
    if not keys:
        keys = {"law": "neo-hookean"}
        if C01:
            if min(C[0], C01) < 0:
                raise ValueError(
                    f"no law here has a negative one of C10 = {C[0]:g} and C01 = {C01:g}"
                )
            keys = {"law": "mooney-rivlin", "second_share": 2 * C01 / modulus}
        elif any(C[1:]):
            keys = {"law": "yeoh", "second": 2 * C[1] / modulus, "third": 2 * C[2] / modulus}
    if keys["law"] != "ogden":
        keys["shear_modulus"] = modulus
    K = first.get("K", 0.0)
    if D := first.get("D"):
        K = 2 / D
    if nu := first.get("nu"):
        if not 0 < nu < 0.5:
            raise ValueError(
                f"Poisson's ratio is {nu:g}, which must be between 0 and 0.5; LS-DYNA takes a"
                " negative one as |PR| with damage, which no law here has"
            )
        K = 2 * modulus * (1 + nu) / (3 * (1 - 2 * nu))
    return keys | ({"bulk_modulus": K} if K else {})
