"""Regressor that finds an elastic energy and viscoelastic branches from stresses over time."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from numbers import Integral
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import check_is_fitted, validate_data

from ..arguments import in_order
from ..materials import LAWS, Branch, Law, Memory, Ogden
from ..materials.dictionary import OF_TESTS
from ..materials.polyconvex import law_of, stiffness_of
from .averaging import columns_of, isochoric, nonnegative
from .branch_search import Choice, Curves, choose
from .energy import NEGLIGIBLE, EnergyRegressor, half_planes, mode_of, warn_of_few_modes
from .regressor import DIFFERENCE, FAILED, axes_of, check_fitted, covariance_at
from .stress_regressor import BULK_CONSTRAINTS, BULK_RATIO, StressRegressor, incompressible_stress

FREE = "energy"
"""Name of the elastic energy without a law, a sum of terms of the dictionary."""

BEYOND = 10.0
"""Factor by which times may lie beyond those of the grid: slower branches are elastic in the tests,
and faster ones are a viscosity.
"""

SAME_TIME = 0.2
"""Least difference of the logarithms of two relaxation times. Chosen: the stresses of two nearer
branches are those of one, to a percent.
"""

CERTAIN = 2.0
"""Least modulus of a branch, in its standard errors, in a choice of the number of branches."""

MOST_STATED = 6
"""Most branches that can be asked for."""

MOST_EVALUATIONS = 100
"""Most evaluations of a refinement; a few tens are usual."""


class Elastic(NamedTuple):
    """Elastic energies whose stress is linear in some coefficients.

    Attributes
    ----------
    names : list of str
        Names of the coefficients.
    shapes : dict of (float, float)
        Bounds of the parameters on which the stress depends otherwise, by name.
    columns : callable
        ``columns(shape)`` returns the nominal stresses (n, n_coefficients) of unit coefficients.
    law : callable
        ``law(coefficients, shape, added)`` returns the law; `added` is the modulus of branches.
    """

    names: list[str]
    shapes: dict[str, tuple[float, float]]
    columns: Callable[[np.ndarray], np.ndarray]
    law: Callable[[np.ndarray, np.ndarray, float], Law]


@dataclass(eq=False, repr=False)
class HistoryRegressor(StressRegressor):
    """Elastic energy and viscoelastic branches fitted to nominal stresses over time, by the
    histories of incompressible rubber (`pdsurrogate.materials.histories`).

    At a given history the stress is linear in the moduli of branches, so that coefficients of the
    energy and moduli of branches are one non-negative least-squares fit, without a start. Few
    relaxation times are chosen from a logarithmic grid by the errors of curves that are left out;
    all parameters are refined with free times after. Curves count by their greatest stress.

    Parameters
    ----------
    law : str, default="energy"
        Law of the elastic energy; "energy" is a sum of terms without a choice of a law: functions
        of I1bar, and of I2bar if the data have several modes of loading.
    branches : int, optional
        Number of branches; by default chosen by cross-validation.
    bulk_ratio : float, default=1000
        K over the shear modulus in fast motions, of elastic energy and branches together.
    bulk_modulus : float, optional
        K instead of this ratio, in the unit of the stresses.

    Attributes
    ----------
    law_ : Law
        Law with its memory.
    parameter_names_, parameters_, covariance_, standard_errors_, at_bound_
        Coefficients and parameters of the elastic energy, then moduli and times of branches.
        Standard errors do not contain errors that rows of a curve have in common.
    cross_validation_ : list of dict
        Errors of left-out stresses by number of branches (`branch_search.Choice`).
    hull_, stretch_range_
        States of the data, as of `EnergyRegressor`.
    rates_ : tuple of float
        Least and greatest rate of stretch of the curves, in the inverse unit of time.
    n_features_in_ : int

    References
    ----------
    Reese, Govindjee, Int. J. Solids Struct. 35 (1998) 3455, for the branches; Lawson, Hanson,
    Solving least squares problems (1974), for non-negative weights.

    See Also
    --------
    pdsurrogate.identification.EnergyRegressor : fits an elastic energy without a law.

    Examples
    --------
    >>> import numpy as np
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.materials.histories import stress_history
    >>> branch = pds.materials.Branch(0.5, 2.0)
    >>> law = pds.materials.NeoHookean(memory=pds.materials.Memory((branch,)))
    >>> time = np.linspace(0, 10, 101)
    >>> stretch = 1 + np.minimum(time, 10 - time) / 5
    >>> y = stress_history(law, "uniaxial", time, stretch, incompressible=True).nominal_stress
    >>> X = np.stack([stretch, stretch**-0.5, time, np.zeros(101)], axis=1)
    >>> found = pds.identification.HistoryRegressor("neo-hookean", branches=1).fit(X, y)
    >>> found.parameters_.round(6).tolist()
    [1.0, 0.5, 2.0]
    """

    columns = ("stretch", "lateral_stretch", "time", "curve")

    _parameter_constraints: ClassVar = {
        "law": [str],
        "branches": [Interval(Integral, 0, MOST_STATED, closed="both"), None],
        **BULK_CONSTRAINTS,
    }

    law: str = FREE
    branches: int | None = None
    bulk_ratio: float = BULK_RATIO
    bulk_modulus: float | None = None

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.positive_only = False
        return tags

    def fit(self, X, y, sample_weight=None):
        """Fit elastic energy and branches to nominal stresses.

        Parameters
        ----------
        X : array-like, shape (n_samples, 4)
            Stretches along the stress and across it, time, and number of the curve; the rows of a
            curve are in the order of their times.
        y : array-like, shape (n_samples,)
            Nominal stresses.
        sample_weight : array-like, shape (n_samples,), optional
            Weights of the squared residuals, each relative to the greatest stress of its curve.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If X has other columns, a stretch is not positive, times decrease or do not pass, or the
            law is unknown or cannot be fitted.

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> time = np.arange(20.0)
        >>> X = np.stack([1 + time / 10, (1 + time / 10) ** -0.5, time, 0 * time], axis=1)
        >>> found = pds.identification.HistoryRegressor("neo-hookean", branches=0).fit(
        ...     X, X[:, 0] - X[:, 0] ** -2
        ... )
        >>> found.law_.shear_modulus.round(9)
        np.float64(1.0)
        """
        self._begin_fit()
        X, y, weight = self._checked(X, y, sample_weight)
        self._stretches(X)
        curves = Curves.of(X)
        if not (np.diff(curves.time, axis=0) > 0).any():
            raise ValueError("no time passes in the data: branches need a column of times")
        numbers = curves.numbers
        peak = np.array([np.abs(y[numbers == one]).max() for one in range(numbers.max() + 1)])
        if not peak.all():
            raise ValueError("all stresses of a curve are zero")
        root = np.sqrt(weight) / peak[numbers]
        if self.law == FREE:
            warn_of_few_modes(X[:, :2])
        elastic = self._elastic(X)
        grid = curves.grid()
        relaxing = curves.columns(grid)
        shape = self._start(elastic, relaxing, y, root)
        chosen: Choice = choose(
            root[:, None] * elastic.columns(shape),
            grid,
            root[:, None] * relaxing,
            root * y,
            numbers,
            self.branches,
        )
        self.cross_validation_ = chosen.errors
        self.rates_ = rates_of(curves)
        self.hull_ = half_planes(X[:, :2])
        self.stretch_range_ = float(X[:, :2].min()), float(X[:, :2].max())
        self._refined(elastic, curves, y, root, shape, chosen.times)
        return self

    def predict(self, X: ArrayLike) -> np.ndarray:
        """Return nominal stresses of the fitted law over time, of constant volume.

        Parameters
        ----------
        X : array-like, shape (n_samples, 4)
            As for `fit`.

        Returns
        -------
        ndarray, shape (n_samples,)
            In the unit of the data; NaN past the limit of the law.

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> time = np.arange(20.0)
        >>> X = np.stack([1 + time / 10, (1 + time / 10) ** -0.5, time, 0 * time], axis=1)
        >>> y = X[:, 0] - X[:, 0] ** -2
        >>> found = pds.identification.HistoryRegressor("neo-hookean", branches=0).fit(X, y)
        >>> bool(np.abs(found.predict(X) - y).max() < 1e-9)
        True
        """
        check_is_fitted(self)
        X = validate_data(self, in_order(X, self.columns, "X"), dtype=np.float64, reset=False)
        self._stretches(X)
        branches = self.law_.memory.branches
        stress = incompressible_stress(self.law_, X[:, :2])
        relaxing = Curves.of(X).columns([one.time for one in branches])
        return stress + relaxing @ np.array([one.modulus for one in branches])

    def law_of(self, values: ArrayLike) -> Law:
        """Return the law with given values of the fitted parameters.

        Parameters
        ----------
        values : array-like, shape (n_parameters,)
            In the order of `parameter_names_`.

        Returns
        -------
        Law

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> time = np.arange(20.0)
        >>> X = np.stack([1 + time / 10, (1 + time / 10) ** -0.5, time, 0 * time], axis=1)
        >>> y = X[:, 0] - X[:, 0] ** -2
        >>> found = pds.identification.HistoryRegressor("neo-hookean", branches=0).fit(X, y)
        >>> found.law_of([2.0]).shear_modulus
        2.0
        """
        return self._law_from(np.asarray(values, dtype=float))

    def domain_hull(self) -> list[list[float]]:
        """Return the half-planes that bound the states of the data, as
        `EnergyRegressor.domain_hull` does.

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> time = np.arange(20.0)
        >>> X = np.stack([1 + time / 10, (1 + time / 10) ** -0.5, time, 0 * time], axis=1)
        >>> y = X[:, 0] - X[:, 0] ** -2
        >>> found = pds.identification.HistoryRegressor("neo-hookean", branches=0).fit(X, y)
        >>> len(found.domain_hull())
        4
        """
        check_is_fitted(self)
        margin = EnergyRegressor.margin
        return [[n1, n2, margin - offset] for n1, n2, offset in self.hull_.tolist()]

    def _stretches(self, X) -> np.ndarray:
        """Return X; raise ValueError unless it has four columns with positive stretches."""
        if X.shape[1] != 4:
            raise ValueError(
                "X must have four columns, the stretch along the stress and the one across it, time"
                f" and curve, but n_features = {X.shape[1]}"
            )
        super()._stretches(X[:, :2])
        return X

    def _elastic(self, X: np.ndarray) -> Elastic:
        """Return the elastic energies of the regressor's law for data X."""
        states = X[:, :2]
        if self.law == FREE:
            one_mode = len({*mode_of(states)[np.abs(np.log(states[:, 0])) > 0.05]}) < 2
            terms = [
                term for term in OF_TESTS if term.polyconvex and not (one_mode and term.row[0] < 2)
            ]
            table = columns_of(isochoric(states, np.ones(len(X))), X[:, 0], terms)

            def sum_of(sizes: np.ndarray, _: np.ndarray, added: float) -> Law:
                return law_of(terms, sizes, self._bulk(stiffness_of(terms, sizes) + added))

            return Elastic([f"weight of {one}" for one in terms], {}, lambda _: table, sum_of)
        check_fitted(self.law)
        if self.law == Ogden.name:
            raise ValueError(
                "ogden is not fitted with branches: leave the law out, which finds an energy"
                " without one, or name another law"
            )
        kind = LAWS[self.law]

        def unit(shape: np.ndarray) -> np.ndarray:
            return incompressible_stress(kind(1.0, 1.0, *map(float, shape)), states)[:, None]

        def with_shape(sizes: np.ndarray, shape: np.ndarray, added: float) -> Law:
            modulus = float(sizes[0])
            return kind(modulus, self._bulk(modulus + added), *map(float, shape))

        return Elastic(["shear_modulus"], dict(kind.bounds), unit, with_shape)

    def _start(self, elastic: Elastic, relaxing, y, root) -> np.ndarray:
        """Return the parameters of a grid with which energy and all branches describe y best."""
        if not elastic.shapes:
            return np.empty(0)
        low, high = np.array(list(elastic.shapes.values())).T
        best, least = None, np.inf
        for values in product(*axes_of(low, high)):
            shape = np.array(values)
            try:
                unit = elastic.columns(shape)
            except ValueError:
                continue
            if not np.isfinite(unit).all():
                continue
            columns = np.column_stack([unit, relaxing])
            error = ((root * (columns @ nonnegative(columns, y, root) - y)) ** 2).sum()
            if error < least:
                best, least = shape, error
        if best is None:
            raise ValueError(f"{self.law} cannot be fitted: it does not reach the stretches")
        return best

    def _refined(self, elastic: Elastic, curves: Curves, y, root, shape, times) -> None:
        """Fit all parameters from a start, with free times, and store them.

        The coefficients of a shape and times are a non-negative least-squares fit. Branches without
        a modulus are left out, and of two with nearly the same time one is; and, unless their
        number is given, those whose modulus is within its error.
        """
        low, high = np.array([*elastic.shapes.values()]).reshape(-1, 2).T
        logarithmic, s, count = low > 0, len(low), len(elastic.names)
        grid = curves.grid()
        ends = np.log([grid[0] / BEYOND, grid[-1] * BEYOND])

        def searched(values):
            return np.log(values, out=np.array(values, dtype=float), where=logarithmic)

        def shape_of(x):
            return np.exp(x[:s], out=np.array(x[:s]), where=logarithmic)

        def elastic_at(x):
            try:
                return elastic.columns(shape_of(x))
            except ValueError:  # parameters between the bounds that are not those of a law
                return np.full((len(y), count), np.nan)

        def solved(own, relaxing):
            """Return residuals and coefficients."""
            table = np.column_stack([own, relaxing])
            if not np.isfinite(table).all():
                return np.full(len(y), FAILED), np.zeros(table.shape[1])
            sizes = nonnegative(table, y, root)
            return root * (table @ sizes - y), sizes

        def residuals(x):
            return solved(elastic_at(x), curves.columns(np.exp(x[s:])))[0]

        def jacobian(x):
            own, k = elastic_at(x), len(x) - s
            relaxing = curves.columns(np.exp(np.r_[x[s:], x[s:] + DIFFERENCE]))
            here = solved(own, relaxing[:, :k])[0]
            columns = []
            for place in range(s):
                step = np.zeros(len(x))
                step[place] = DIFFERENCE * (1 if 2 * x[place] < lower[place] + upper[place] else -1)
                changed = solved(elastic_at(x + step), relaxing[:, :k])[0]
                columns.append((changed - here) / step[place])
            for place in range(k):
                moved = relaxing[:, :k].copy()
                moved[:, place] = relaxing[:, k + place]
                columns.append((solved(own, moved)[0] - here) / DIFFERENCE)
            return np.array(columns).T

        x = np.concatenate([searched(shape), np.log(times)])
        while True:
            k = len(x) - s
            lower = np.concatenate([searched(low), np.full(k, ends[0])])
            upper = np.concatenate([searched(high), np.full(k, ends[1])])
            at_bound = np.zeros(len(x), dtype=bool)
            if len(x):
                edge = 1e-9 * (upper - lower)
                found = least_squares(
                    residuals,
                    np.clip(x, lower + edge, upper - edge),
                    jacobian,
                    bounds=(lower, upper),
                    x_scale="jac",
                    xtol=1e-9,
                    ftol=1e-9,
                    gtol=1e-12,
                    max_nfev=MOST_EVALUATIONS,
                )
                x, at_bound = found.x, found.active_mask != 0
            order = np.argsort(x[s:])
            x[s:], at_bound[s:] = x[s:][order], at_bound[s:][order]
            times = np.exp(x[s:])
            own, relaxing = elastic_at(x), curves.columns(times)
            off, sizes = solved(own, relaxing)
            moduli = sizes[count:]
            idle = np.flatnonzero(moduli <= NEGLIGIBLE * moduli.max(initial=0.0))
            same = np.flatnonzero(np.diff(x[s:]) < SAME_TIME)
            if not len(idle) and not len(same):
                break
            x = np.delete(x, s + (idle if len(idle) else same[:1]))
        stress = np.linalg.norm(root[:, None] * own, axis=0) * sizes[:count]
        linear = np.flatnonzero(stress > NEGLIGIBLE * np.linalg.norm(root * y))
        if not len(linear):
            raise ValueError(
                f"{self.law}: no part of the stresses is elastic, so that the rubber would flow;"
                " add tests that are slower, or that are held for longer"
            )
        n, shape = len(linear), shape_of(x)
        columns = [root[:, None] * np.column_stack([own[:, linear], relaxing])]
        if len(x):  # by a shape and times at given coefficients
            steps = DIFFERENCE * np.eye(len(x))
            inward = np.where(2 * x < lower + upper, 1.0, -1.0)
            for step in steps * inward[:, None]:
                moved = np.column_stack(
                    [elastic_at(x + step), curves.columns(np.exp((x + step)[s:]))]
                )
                slope = (moved - np.column_stack([own, relaxing])) @ sizes / step.sum()
                columns.append((root * slope)[:, None])
        slopes = np.column_stack(columns)
        slopes[:, n + k :] /= np.r_[np.where(logarithmic, shape, 1.0), times]
        found = covariance_at(slopes, off @ off)
        if self.branches is None and k:
            certain = moduli / np.sqrt(np.diag(found)[n : n + k])
            if certain.min() < CERTAIN:
                fewer = np.delete(times, certain.argmin())
                self._refined(elastic, curves, y, root, shape, fewer)
                return
        ways = np.r_[np.arange(n), n + k + np.arange(s), n + np.arange(k), n + k + s + np.arange(k)]
        names = [elastic.names[one] for one in linear] + list(elastic.shapes)
        names += [f"{what}_{number}" for what in ("modulus", "time") for number in range(1, k + 1)]
        values = np.concatenate([sizes[:count][linear], shape, moduli, times])

        def law_from(values: np.ndarray) -> Law:
            sizes = np.zeros(count)
            sizes[linear] = values[:n]
            moduli, times = values[n + s : n + s + k].tolist(), values[n + s + k :].tolist()
            law = elastic.law(sizes, values[n : n + s], sum(moduli))
            memory = Memory(tuple(Branch(*one) for one in zip(moduli, times, strict=True)))
            return replace(law, memory=memory)

        self._law_from = law_from
        bounded = np.r_[np.zeros(n, dtype=bool), at_bound[:s], np.zeros(k, bool), at_bound[s:]]
        self._store(
            law_from(values),
            names,
            values,
            found[np.ix_(ways, ways)],
            [name for name, on in zip(names, bounded, strict=True) if on],
        )


def rates_of(curves: Curves) -> tuple[float, float]:
    """Return the least and greatest rate of stretch of curves: of each the median over its rows of
    the rates that are at least a hundredth of its greatest, so that holds do not count.
    """
    stretch = np.sqrt(curves.squares[..., 0])
    found = []
    for time, one in zip(curves.time.T, stretch.T, strict=True):
        passed = np.diff(time) > 0
        rates = np.abs(np.diff(one))[passed] / np.diff(time)[passed]
        moving = rates > 0.01 * rates.max(initial=0.0)
        if moving.any():
            found.append(float(np.median(rates[moving])))
    return (min(found), max(found)) if found else (0.0, 0.0)
