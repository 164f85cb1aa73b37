"""Numbers of a law that was fitted to measurements, their derivatives by the fitted parameters,
and their covariance, theory (86).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import check_kind, check_names, check_numbers
from .law import Law
from .stretch_laws import Ogden

MOST_UNCERTAIN = 0.5
"""Relative standard error of the shear modulus beyond which first-order errors of results have
no meaning: all forces scale with it.
"""


@dataclass(frozen=True, eq=False)
class LawCovariance:
    """Covariance of the numbers of a law that was fitted to measurements.

    Parameters
    ----------
    law : Law
        Law with the numbers found.
    names : tuple of str
        Dotted keys of numbers of the law, as in a scene's ``material``: ``"chain_limit"``,
        ``"moduli.1"``.
    values : ndarray, shape (n, n)
        Covariance of these numbers; all others of the law are certain.

    Raises
    ------
    ValueError
        If the law has no such number, or the values are no covariance of them: of another shape,
        not finite, not symmetric, or with a negative variance of a number or a combination.

    See Also
    --------
    pdsurrogate.SceneRegressor.law_covariance : covariance of a law fitted to measurements on
        bodies.
    pdsurrogate.Result.standard_errors : standard errors of the results of a simulation with the
        law.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> law = pds.materials.NeoHookean(shear_modulus=0.4, bulk_modulus=40.0)
    >>> found = pds.materials.LawCovariance(
    ...     law, ("shear_modulus", "bulk_modulus"), [[1e-4, 1e-2], [1e-2, 1.0]]
    ... )
    >>> found.standard_errors
    {'shear_modulus': 0.01, 'bulk_modulus': 1.0}
    """

    law: Law
    names: tuple[str, ...]
    values: np.ndarray

    def __post_init__(self) -> None:
        check_kind(self.law, Law, "law", "a material law")
        check_names(
            [*self.names] if isinstance(self.names, tuple) else self.names,
            "names",
            "such as ['shear_modulus']",
        )
        check_numbers(
            self.values, "covariance", f"it must have {len(self.names)} x {len(self.names)} numbers"
        )
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "values", values := np.array(self.values, dtype=float))
        known = numbers_of(self.law)
        if unknown := [name for name in self.names if name not in known]:
            raise ValueError(
                f"covariance: {self.law.name} has no number {unknown[0]!r}; it has"
                f" {', '.join(known)}"
            )
        if values.shape != 2 * (len(self.names),) or not np.isfinite(values).all():
            wrong = "has others"
            if values.shape != 2 * (len(self.names),):
                wrong = f"has the shape {values.shape}"
            raise ValueError(
                f"covariance: it must have {len(self.names)} x {len(self.names)} finite numbers,"
                f" for {', '.join(self.names)}, but {wrong}"
            )
        sizes = np.sqrt(np.abs(np.diag(values)))
        products = np.outer(sizes, sizes)
        if (np.diag(values) < 0).any() or (np.abs(values - values.T) > 1e-9 * products).any():
            raise ValueError("covariance: it must be symmetric, with no negative variance")
        correlation = values / np.where(products > 0, products, 1.0)
        # A negative variance of less is due to the digits of a given covariance.
        if np.linalg.eigvalsh(correlation).min() < -1e-6:
            raise ValueError(
                "covariance: a combination of the numbers has a negative variance: correlations"
                " must lie between -1 and 1"
            )

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard errors of the numbers, by name.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.materials.LawCovariance(
        ...     pds.materials.NeoHookean(), ("shear_modulus",), [[0.01]]
        ... ).standard_errors
        {'shear_modulus': 0.1}
        """
        return dict(zip(self.names, np.sqrt(np.diag(self.values)).tolist(), strict=True))

    def describe(self) -> dict:
        """Return names and values as plain lists, in the form used by artifact cards.

        Returns
        -------
        dict

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.materials.LawCovariance(
        ...     pds.materials.NeoHookean(), ("shear_modulus",), [[0.01]]
        ... ).describe()
        {'names': ['shear_modulus'], 'values': [[0.01]]}
        """
        return {"names": list(self.names), "values": self.values.tolist()}

    def scaled_to(self, law: Law) -> np.ndarray | None:
        """Return the covariance of the numbers of a law in another unit of stress; None if it is
        not the same law apart from the unit.

        Parameters
        ----------
        law : Law

        Returns
        -------
        ndarray, shape (n, n), or None

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> rubber = pds.materials.NeoHookean(shear_modulus=0.4, bulk_modulus=40.0)
        >>> found = pds.materials.LawCovariance(rubber, ("shear_modulus",), [[1e-4]])
        >>> (
        ...     found.scaled_to(rubber.scaled(1000.0)).round(6).tolist(),
        ...     found.scaled_to(pds.materials.NeoHookean(0.4, 80.0)),
        ... )
        ([[100.0]], None)
        """
        if type(law) is not type(self.law):
            return None
        before, after = (
            numbers_of(one)
            for one in (self.law, self.law.scaled(law.shear_modulus / self.law.shear_modulus))
        )
        other = numbers_of(law)
        if set(other) != set(after) or not np.allclose(
            [other[name] for name in after], list(after.values()), rtol=1e-9, atol=0
        ):
            return None
        factors = [after[name] / before[name] if before[name] else 1.0 for name in self.names]
        return self.values * np.outer(factors, factors)


def numbers_of(law: Law) -> dict[str, float]:
    """Return the independent numbers of a law and its memory by dotted key; those of a law of sums
    of terms imply its shear modulus.
    """
    found = {key: getattr(law, key) for key in law.defaults()}
    if isinstance(law, Ogden):
        del found["shear_modulus"]
    flat: dict[str, float] = {}
    for key, value in found.items():
        flat |= (
            {f"{key}.{place}": each for place, each in enumerate(value)}
            if isinstance(value, tuple)
            else {key: value}
        )
    return flat | law.memory.numbers()


def with_numbers_of(law: Law, values: Mapping[str, float]) -> Law:
    """Return a law with other values of some of its `numbers_of`; raise ValueError if they are
    not those of a law.
    """
    changes: dict = {"shear_modulus": None} if isinstance(law, Ogden) else {}
    remembered = {name: values[name] for name in law.memory.numbers() if name in values}
    if remembered:
        changes["memory"] = law.memory.with_numbers(remembered)
    for name, value in values.items():
        if name in remembered:
            continue
        key, _, place = name.partition(".")
        if place:
            numbers = list(changes.get(key, getattr(law, key)))
            numbers[int(place)] = value
        changes[key] = tuple(numbers) if place else value
    return replace(law, **changes)


def slopes_of(
    values: Callable[[np.ndarray], ArrayLike], parameters: np.ndarray, steps: np.ndarray
) -> np.ndarray:
    """Return the derivatives (..., n_parameters) of values (...) by parameters, by central
    differences over `steps`.
    """
    columns = [
        (np.asarray(values(parameters + change)) - values(parameters - change)) / (2 * step)
        for step, change in zip(steps, np.diag(steps), strict=True)
    ]
    return np.stack(columns, axis=-1)


def derivatives_of_numbers(
    law_of: Callable[[np.ndarray], Law], parameters: np.ndarray, steps: np.ndarray
) -> tuple[list[str], np.ndarray]:
    """Return the names of the numbers of a law that depend on parameters, and their derivatives,
    shape (numbers, parameters).

    `law_of` gives the law for values of the parameters. The derivatives are central differences
    over `steps`.
    """
    names = list(numbers_of(law_of(parameters)))

    def numbers(at: np.ndarray) -> list[float]:
        found = numbers_of(law_of(at))
        return [found[name] for name in names]

    derivatives = slopes_of(numbers, parameters, steps)
    moving = np.flatnonzero(np.abs(derivatives).sum(axis=1))
    return [names[number] for number in moving], derivatives[moving]


def covariance_of_numbers(
    law_of: Callable[[np.ndarray], Law],
    names: Sequence[str],
    parameters: np.ndarray,
    covariance: np.ndarray,
    at_bound: Sequence[str],
) -> LawCovariance:
    """Return the covariance of the numbers of a fitted law, theory (86), from that of the fitted
    parameters.

    Raise ValueError if a parameter is at a bound of its search, or if the measurements do not
    determine it or the shear modulus.
    """
    if at_bound:
        raise ValueError(
            f"{', '.join(at_bound)}: at a bound of the search, so that the law has no covariance;"
            " another law may fit better"
        )
    unknown = [
        name
        for name, variance in zip(names, np.diag(covariance), strict=True)
        if not np.isfinite(variance)
    ]
    law = law_of(parameters)
    steps = 1e-6 * np.where(parameters, np.abs(parameters), 1.0)
    if not unknown:
        slopes = slopes_of(lambda at: law_of(at).shear_modulus, parameters, steps)
        unknown = (
            ["shear_modulus"]
            if slopes @ covariance @ slopes > (MOST_UNCERTAIN * law.shear_modulus) ** 2
            else []
        )
    if unknown:
        raise ValueError(
            f"{', '.join(unknown)}: not determined by the measurements, so that the law has no"
            " covariance; add other tests"
        )
    numbers, derivatives = derivatives_of_numbers(law_of, parameters, steps)
    values = derivatives @ covariance @ derivatives.T
    return LawCovariance(law, tuple(numbers), (values + values.T) / 2)
