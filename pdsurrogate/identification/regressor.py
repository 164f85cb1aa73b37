"""Regressor that finds the parameters of a material law from test data."""

from dataclasses import dataclass
from heapq import nsmallest
from itertools import combinations, product
from numbers import Integral, Real
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import minimum_filter
from scipy.optimize import least_squares
from sklearn.utils._param_validation import Interval

from ..arguments import check_known
from ..materials import LAWS, Law, Ogden, Polyconvex, homogeneous
from .averaging import nonnegative
from .stress_regressor import (
    BULK_CONSTRAINTS,
    BULK_RATIO,
    StressRegressor,
    incompressible_stress,
    sheet_of,
    states,
)

N_TERMS = 3
"""Number of terms of Ogden's law by default, as many as Ogden (1972) took for Treloar's rubber."""


PER_AXIS = 25
"""Number of points on an axis of the coarse search. Chosen: each basin of the squared error then
has one.
"""

DIFFERENCE = 1e-7
"""Relative change of a parameter or a volume ratio over which differences give derivatives, near
the square root of rounding.
"""

FAILED = 1e3
"""Residual where a law has no stress; those of the data are shares of their size, whose squares
sum to 1.
"""

EXPONENTS = -8.0, -5.0, -3.0, -2.0, -1.0, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 11.0
"""Exponents of Ogden's law in the coarse search, about evenly spaced in the logarithm of their
size. Chosen: the refinement moves them, so that they need only be denser than its basins.
"""


def fitted_laws() -> list[str]:
    """Return the names of the laws that a `LawRegressor` fits: all but the polyconvex law, which
    an `EnergyRegressor` finds.
    """
    return [name for name in LAWS if name != Polyconvex.name]


def check_fitted(law: str) -> None:
    """Raise ValueError unless a `LawRegressor` fits the law of this name."""
    known = "laws that can be fitted to tests are"
    check_known(law, fitted_laws(), f"unknown law {law!r}", known)


def covariance_at(jacobian: np.ndarray, squares: float) -> np.ndarray:
    """Return the first-order covariance of parameters at a solution, infinite if they are not
    determined, from the derivatives of the residuals and the sum of the squares of these.
    """
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0] = 1.0
    information = (jacobian / size).T @ (jacobian / size)
    free = len(jacobian) - len(size)
    # Above this condition number the inverse has no digits left.
    if free <= 0 or not np.linalg.cond(information) < 1e14:
        return np.full(information.shape, np.inf)
    return squares / free * np.linalg.inv(information) / np.outer(size, size)


@dataclass(eq=False, repr=False)
class LawRegressor(StressRegressor):
    """Least-squares fit of the parameters of a law to nominal stresses.

    A coarse search over the dimensionless parameters of the law, in which the shear modulus (for
    Ogden's law all moduli) is solved for linearly, gives the starts of a bounded trust-region
    iteration, both with an incompressible law. From the best solution the iteration goes on with
    the bulk modulus of the law. There are no random choices.

    Parameters
    ----------
    law : str, default="neo-hookean"
        Name of the law.
    n_terms : int, default=3
        Number of terms of Ogden's law; without effect for other laws.
    greatest_exponent : float, default=12
        Bound of the absolute value of Ogden's exponents; the default is just above the 11 of the
        coarse search.
    bulk_ratio : float, default=1000
        K/mu of the law, which such tests do not determine. Rubber has about one thousand. Give the
        ratio of the simulation: parameters that are fitted with another ratio are off at large
        stretches.
    bulk_modulus : float, optional
        K instead of K/mu, in the unit of the stresses.

    Attributes
    ----------
    law_ : Law
        Law with the parameters found.
    parameter_names_ : list of str
    parameters_ : ndarray, shape (n_parameters,)
    covariance_ : ndarray, shape (n_parameters, n_parameters)
        First-order covariance, from the Jacobian at the solution and the remaining residuals.
    standard_errors_ : ndarray, shape (n_parameters,)
        Standard errors, infinite for parameters that the data do not determine.
    at_bound_ : list of str
        Parameters at a bound, whose standard errors have no meaning.
    n_features_in_ : int

    See Also
    --------
    pdsurrogate.load_test_data : reads test data.
    pdsurrogate.identification.EnergyRegressor : fits an energy without a law.
    pdsurrogate.fit_to_tests : fits a regressor, and examines data and fit.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> data = pds.load_test_data("treloar").up_to(3.0)
    >>> found = pds.identification.LawRegressor("gent").fit(data.stretches, data.nominal_stress)
    >>> found.law_.name, found.score(data.stretches, data.nominal_stress) > 0.99
    ('gent', False)
    """

    _parameter_constraints: ClassVar = {
        "law": [str],  # laws are added while the program runs
        "n_terms": [Interval(Integral, 1, 4, closed="both")],
        "greatest_exponent": [Interval(Real, 1, 50, closed="both")],
        **BULK_CONSTRAINTS,
    }

    law: str = "neo-hookean"
    n_terms: int = N_TERMS
    greatest_exponent: float = 12.0
    bulk_ratio: float = BULK_RATIO
    bulk_modulus: float | None = None

    def fit(self, X, y, sample_weight=None):
        """Fit the parameters of the law to nominal stresses.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2)
            Stretches along the stress and across it; a table (pandas) has the columns ``stretch``
            and ``lateral_stretch`` in any order.
        y : array-like, shape (n_samples,)
            Nominal stresses.
        sample_weight : array-like, shape (n_samples,), optional
            Weights of the squared residuals.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If the law is unknown, X has other columns or a stretch is not positive, or no
            parameters tried give a finite stress in all states.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> data = pds.load_test_data("treloar").up_to(3.0)
        >>> pds.identification.LawRegressor("gent").fit(
        ...     data.stretches, data.nominal_stress
        ... ).parameter_names_
        ['shear_modulus', 'chain_limit']
        """
        X, y, root = self._used(X, y, sample_weight)
        check_fitted(self.law)
        root = root / np.sqrt((root**2 * y**2).sum() or 1.0)
        # Every so many rows, from the one with the greatest stretch on, which not every law
        # reaches: more than 250 change the starts by less than the refinement does.
        few = np.argsort(X.max(axis=1), kind="stable")[:: -int(np.ceil(len(y) / 250))]
        coarse = X[few], y[few], root[few]
        # The best point of a coarse grid need not lie in the basin of the least error.
        best_few = nsmallest(5, self._candidates(*coarse), key=lambda candidate: candidate[0])
        starts = [start for _, start in best_few]
        if not starts:
            raise ValueError(
                f"{self.law} cannot be fitted: it does not reach the stretch {X.max():g} with a"
                " positive stiffness"
            )
        fits = [self._refined(start, *coarse, _incompressible, 1e-6) for start in starts]
        best, *_ = min(fits, key=lambda one: one[-1].cost)
        best, *_ = self._refined(best, X, y, root, _incompressible)
        values, jacobian, found = self._refined(best, X, y, root, states)
        names = self.unknowns()
        at_bound = [name for name, active in zip(names, found.active_mask, strict=True) if active]
        covariance = covariance_at(jacobian, 2 * found.cost)
        self._store(self.law_of(values), names, values, covariance, at_bound)
        return self

    def unknowns(self) -> list[str]:
        """Return the names of the unknown parameters of the law.

        Returns
        -------
        list of str
            Names in the order of the values in `law_of`.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.identification.LawRegressor("yeoh").unknowns()
        ['shear_modulus', 'second', 'third']
        """
        if self.law != Ogden.name:
            return ["shear_modulus", *LAWS[self.law].bounds]
        return [
            f"{what}_{number}"
            for what in ("modulus", "exponent")
            for number in range(1, self.n_terms + 1)
        ]

    def law_of(self, values: ArrayLike) -> Law:
        """Return the law with given values of its unknown parameters.

        Parameters
        ----------
        values : array-like, shape (n_parameters,)
            Values in the order of `unknowns`; moduli of Ogden's law are given by their absolute
            values.

        Returns
        -------
        Law

        Raises
        ------
        ValueError
            If the values are not those of a law.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.identification.LawRegressor("gent").law_of([0.4, 80.0]).bulk_modulus
        400.0
        """
        values = np.asarray(values, dtype=float)
        if self.law != Ogden.name:
            return LAWS[self.law](
                float(values[0]), self._bulk(float(values[0])), *map(float, values[1:])
            )
        sizes, exponents = np.split(values, 2)
        moduli = sizes * np.sign(exponents)
        modulus = float((moduli * exponents).sum() / 2)
        return Ogden(modulus, self._bulk(modulus), tuple(moduli), tuple(exponents))

    def search_range(
        self, start: ArrayLike, scale: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the bounds of the unknown parameters, and which of them are searched for by their
        logarithm.

        The logarithm serves for positive parameters that range over decades. Ogden's exponents keep
        the signs that they have in `start`.

        Parameters
        ----------
        start : array-like, shape (n_parameters,)
            Values from which the search starts; laws other than Ogden's do not need them.
        scale : float
            Greatest stress of the data, which sets the bounds of the moduli.

        Returns
        -------
        low, high : ndarray, shape (n_parameters,)
        logarithmic : ndarray of bool, shape (n_parameters,)

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.identification.LawRegressor("gent").search_range([], 1.0)[2].tolist()
        [True, True]
        """
        if self.law != Ogden.name:
            low, high = np.array([(1e-6 * scale, 1e6 * scale), *LAWS[self.law].bounds.values()]).T
            return low, high, low > 0
        n = self.n_terms
        most = self.greatest_exponent
        positive = np.asarray(start)[self.n_terms :] > 0
        low = np.concatenate([np.full(n, 1e-9 * scale), np.where(positive, 0.1, -most)])
        high = np.concatenate([np.full(n, 1e6 * scale), np.where(positive, most, -0.1)])
        return low, high, np.repeat([True, False], n)

    def _refined(self, start, X, y, root, states_of, close=1e-12):
        """Fit the parameters from `start` to relative changes `close`; return them, the residuals'
        Jacobian by them, and scipy's result.

        ``states_of(law, X)`` gives the nominal stresses of a law and volume ratios, and `root`
        holds square roots of row weights.
        """
        *bounds, logarithmic = self.search_range(start, max(np.abs(y).max(), 1e-300))
        sheet = sheet_of(X)

        volumes: dict[bytes, np.ndarray] = {}

        def value(searched):
            return np.exp(searched, out=searched.copy(), where=logarithmic)

        def residuals(searched):
            volumes.clear()
            try:
                predicted, volumes[searched.tobytes()] = states_of(self.law_of(value(searched)), X)
            except ValueError:  # parameters between the bounds that are not those of a law
                return np.full(len(y), FAILED)
            # Past its limit a law has no stress: a large residual.
            return np.where(np.isfinite(predicted), root * (predicted - y), FAILED)

        def jacobian(searched):
            """Return the derivatives of the residuals: those at a given volume, and those
            through the volume, by its implicit equation.
            """
            if searched.tobytes() not in volumes:
                residuals(searched)
            if searched.tobytes() not in volumes:  # parameters that are not those of a law
                return np.zeros((len(y), len(searched)))
            volume = volumes[searched.tobytes()]
            columns = []
            at = homogeneous.sheet_response(self.law_of(value(searched)), *sheet)
            stress, free = at(volume)
            swollen, pulled = at((1 + DIFFERENCE) * volume)
            softening = (
                0.0 if states_of is _incompressible else (swollen - stress) / (pulled - free)
            )
            for number in range(len(searched)):
                moved = searched.copy()
                # Towards the farther bound, so that the law exists.
                moved[number] += (
                    DIFFERENCE
                    * max(1.0, abs(searched[number]))
                    * (1 if 2 * searched[number] < low[number] + high[number] else -1)
                )
                changed, unbalanced = homogeneous.sheet_response(self.law_of(value(moved)), *sheet)(
                    volume
                )
                columns.append(
                    (changed - stress - softening * (unbalanced - free))
                    / (moved[number] - searched[number])
                )
            return root[:, None] * np.nan_to_num(np.array(columns).T, posinf=0.0, neginf=0.0)

        start, low, high = (
            np.log(values, out=values.copy(), where=logarithmic) for values in (start, *bounds)
        )
        start = np.clip(start, low + 1e-9 * (high - low), high - 1e-9 * (high - low))
        found = least_squares(
            residuals,
            start,
            jacobian,
            bounds=(low, high),
            x_scale="jac",
            xtol=close,
            ftol=close,
            gtol=close,
            max_nfev=400,
        )
        values = value(found.x)
        # By the chain rule: the Jacobian by the parameters, where the logarithm was searched for.
        return values, found.jac / np.where(logarithmic, values, 1.0), found

    def shapes(self) -> list[tuple[float, ...]]:
        """Return the points of the coarse search: values of the parameters other than moduli.

        Returns
        -------
        list of tuple of float

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> len(pds.identification.LawRegressor("gent").shapes())
        25
        """
        if self.law != Ogden.name:
            low, high, _ = self.search_range(np.empty(0), 1.0)
            return list(product(*axes_of(low[1:], high[1:])))
        grid = [value for value in EXPONENTS if abs(value) <= self.greatest_exponent]
        return list(combinations(grid, self.n_terms))

    def unit_stresses(self, shape: ArrayLike, X: ArrayLike) -> np.ndarray:
        """Return the nominal stress of each modulus of size 1 at constant volume.

        Parameters
        ----------
        shape : array-like, shape (n_shape,)
            Values of the parameters other than moduli.
        X : array-like, shape (n_samples, 2)
            Stretches along the stress and across it.

        Returns
        -------
        ndarray, shape (n_samples, n_moduli)
            NaN past the limit of the law.

        Raises
        ------
        ValueError
            If the values are not those of a law.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> law = pds.identification.LawRegressor("ogden", n_terms=2)
        >>> law.unit_stresses([2.0, -2.0], [[2.0, 2.0**-0.5]]).round(3).tolist()
        [[1.75, 0.875]]
        """
        X, shape = np.asarray(X, dtype=float), np.asarray(shape, dtype=float)
        if self.law != Ogden.name:
            return incompressible_stress(self.law_of([1.0, *shape]), X)[:, None]
        thickness = 1 / X.prod(axis=1, keepdims=True)
        return np.sign(shape) * (X[:, :1] ** shape - thickness**shape) / X[:, :1]

    def _candidates(self, X, y, root):
        """Return (squared error, parameters) at points of the coarse search, with the best moduli:
        of a law but Ogden's, those that no neighbor excels.
        """
        shapes = self.shapes()
        least = 1e-7 * max(np.abs(y).max(), 1e-300)
        moduli = [np.empty(0)] * len(shapes)
        errors = np.full(len(shapes), np.inf)
        for number, shape in enumerate(shapes):
            try:
                unit = self.unit_stresses(shape, X)
            except ValueError:
                continue
            if np.isfinite(unit).all():
                moduli[number] = np.maximum(nonnegative(unit, y, root), least)
                errors[number] = ((root * (unit @ moduli[number] - y)) ** 2).sum()
        lowest = errors
        if self.law != Ogden.name and shapes[0]:
            axes = [len({*values}) for values in zip(*shapes, strict=True)]
            lowest = minimum_filter(errors.reshape(axes), 3, mode="nearest").ravel()
        return [
            (errors[n], np.array([*moduli[n], *shapes[n]]))
            for n in np.flatnonzero((errors == lowest) & np.isfinite(errors))
        ]


def _incompressible(law: Law, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nominal stresses of a law without a change of volume, and volume ratios, 1, as
    `states` does with one.
    """
    return incompressible_stress(law, X), np.ones(len(X))


def axes_of(low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """Return the axes of a grid of candidates, between bounds, for the dimensionless parameters
    of a law.
    """
    # Dense about 0 where bounds contain it: most dimensionless coefficients of rubber lie there.
    spread = np.geomspace(1e-5, 1, PER_AXIS // 2)
    return [
        (
            np.geomspace(least, greatest, PER_AXIS)
            if least > 0
            else np.unique([*least * spread, 0.0, *greatest * spread])
        )
        for least, greatest in zip(low, high, strict=True)
    ]
