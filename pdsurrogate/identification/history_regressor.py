"""Regressor that finds an elastic energy and viscoelastic branches from stresses over time."""

import warnings
from dataclasses import dataclass, replace
from numbers import Integral
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import check_is_fitted, validate_data
from threadpoolctl import threadpool_limits

from ..arguments import in_order
from ..forces import OutsideDomainWarning
from ..materials import Law
from ..materials.memory import untested_rates
from .branch_refinement import falling, linear, refine, restart, superfluous
from .branch_search import Curves, choose, constant
from .branch_start import Problem, parameters_of_softening, start_of
from .data import TestData
from .elastic_part import Elastic, elastic_of_law, elastic_without_law
from .energy import EnergyRegressor, half_planes, warn_of_few_modes
from .regressor import N_TERMS, LawRegressor, check_fitted
from .stress_regressor import BULK_CONSTRAINTS, BULK_RATIO, StressRegressor

FREE = "energy"
"""Name of the elastic energy without a law, a sum of terms of the dictionary."""

MOST_STATED = 6
"""Most branches that can be asked for."""


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
    n_terms : int, default=3
        Number of terms of Ogden's law; without effect for other laws.
    softening : bool, default=False
        Whether the elastic energy softens in unloading (Mullins), by the parameters of
        `pdsurrogate.materials.Softening`; beta is 0 if all curves unload from nearly one stretch.
        Each curve is that of a new specimen.
    falling_times : bool, default=False
        Whether relaxation times may fall with the overstress, all by the same powers of it: found
        for the upper decade of the overstresses of the data, from the fit of constant times. A fit
        takes several times as long.
    bulk_ratio : float, default=1000
        K over the shear modulus in fast motions, of elastic energy and branches together.
    bulk_modulus : float, optional
        K instead of this ratio, in the unit of the stresses.

    Attributes
    ----------
    law_ : Law
        Law with its memory.
    parameter_names_, parameters_, covariance_, standard_errors_, at_bound_
        Coefficients and parameters of the elastic energy, those of softening, then moduli and times
        of branches, and the powers by which times fall. Standard errors do not contain errors that
        rows of a curve have in common.
    cross_validation_ : list of dict
        Errors of left-out stresses by number of branches (`branch_search.Choice`).
    hull_, stretch_range_
        States of the data, as of `EnergyRegressor`.
    rates_ : tuple of float
        Least and greatest rate of stretch of the curves, in the inverse unit of time: the least one
        is the mean rate of a whole curve, to which holds belong.
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
    over_time: ClassVar[bool] = True

    _parameter_constraints: ClassVar = {
        "law": [str],
        "branches": [Interval(Integral, 0, MOST_STATED, closed="both"), None],
        "n_terms": [Interval(Integral, 1, 4, closed="both")],
        "softening": ["boolean"],
        "falling_times": ["boolean"],
        **BULK_CONSTRAINTS,
    }

    law: str = FREE
    branches: int | None = None
    n_terms: int = N_TERMS
    softening: bool = False
    falling_times: bool = False
    bulk_ratio: float = BULK_RATIO
    bulk_modulus: float | None = None

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.positive_only = False
        return tags

    @property
    def form(self) -> str:
        """Fitted form in words.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.identification.HistoryRegressor("gent", softening=True).form
        'gent with branches and softening'
        """
        falling = " of falling times" * self.falling_times
        parts = [f"branches{falling}"] * (self.branches != 0) + ["softening"] * self.softening
        law = "energy without a law" if self.law == FREE else self.law
        return f"{law} with {' and '.join(parts)}" if parts else law

    def rows_of(self, data: TestData) -> np.ndarray:
        """Return the rows of test data as `fit` and `predict` take them.

        Parameters
        ----------
        data : TestData

        Returns
        -------
        ndarray, shape (n_samples, 4)

        Raises
        ------
        ValueError
            If a row has no time, which branches need, or tests are biaxial.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> data = pds.load_test_data("treloar")
        >>> pds.identification.HistoryRegressor(branches=0).rows_of(data).shape[1]
        4
        """
        return data.histories(timed=self.branches != 0)

    # Its matrices are so small that threads would wait for each other.
    @threadpool_limits.wrap(limits=1, user_api="blas")
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
            If X has other columns, a stretch is not positive, times decrease or do not pass, no
            curve unloads but softening is asked for, or the law is unknown or cannot be fitted.

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
        if self.falling_times and self.branches == 0:
            raise ValueError("falling_times are those of branches: give branches")
        X, y, weight = self._checked(X, y, sample_weight)
        self._stretches(X)
        curves = Curves.of(X)
        if self.branches != 0 and not (np.diff(curves.time, axis=0) > 0).any():
            raise ValueError("no time passes in the data: branches need a column of times")
        numbers = curves.numbers
        peak = np.array([np.abs(y[numbers == one]).max() for one in range(numbers.max() + 1)])
        if not peak.all():
            raise ValueError("all stresses of a curve are zero")
        root = np.sqrt(weight) / peak[numbers]
        if self.law == FREE:
            warn_of_few_modes(X[:, :2])
        softening = parameters_of_softening(curves) if self.softening else ()
        problem = Problem(self._elastic(X[:, :2]), curves, y, root, softening)
        grid = curves.grid() if self.branches != 0 else np.ones(0)
        relaxing = curves.columns(constant(grid))
        start = start_of(self.law, problem, relaxing)
        parts = ((root * one.T).T for one in (start.columns, relaxing, y))
        times, self.cross_validation_ = choose(*parts, grid, numbers, self.branches)
        while True:
            form, values = linear(self.law, problem, start, times)
            found = refine(problem, form, values)
            left_out = superfluous(form, found, chosen=self.branches is None)
            if not len(left_out):
                break
            start = restart(problem, form, found.values)
            times = np.delete(form.parts(found.values)[3], left_out)
        if self.falling_times and form.branches:
            form, values = falling(curves, form, found.values)
            found = refine(problem, form, values)
        self.rates_ = rates_of(curves)
        self.hull_ = half_planes(X[:, :2])
        self.stretch_range_ = float(X[:, :2].min()), float(X[:, :2].max())
        self._form = form
        bounds = [name for name, one in zip(form.names, found.at_bound, strict=True) if one]
        law = self.law_of(found.values)
        self._store(law, form.names, found.values, found.covariance, bounds)
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

        Warns
        -----
        OutsideDomainWarning
            If a rate of stretch is outside of those of the data.

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
        curves = Curves.of(X)
        rates = rates_of(curves) if self.law_.memory.branches else None
        if rates and (words := untested_rates(self.rates_, *rates)):
            warnings.warn(words, OutsideDomainWarning, stacklevel=2)
        return curves.stress(self.law_)

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
        law = self._form.law(np.asarray(values, dtype=float))
        return replace(law, bulk_modulus=self._bulk(law.shear_modulus + law.memory.modulus))

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

    def _elastic(self, states: np.ndarray) -> Elastic:
        """Return the elastic energies of the regressor's law for stretches (n, 2)."""
        if self.law == FREE:
            return elastic_without_law(states)
        check_fitted(self.law)
        return elastic_of_law(LawRegressor(self.law, self.n_terms), states)


def rates_of(curves: Curves) -> tuple[float, float] | None:
    """Return the least and greatest rate of stretch of curves, None for curves without motion or
    time.

    The least one is the mean rate of a whole curve. The greatest one is the median, over a curve's
    rows, of the rates that are at least a hundredth of its greatest, so that holds do not count.
    """
    moved = np.abs(np.diff(np.sqrt(curves.squares[..., 0]), axis=0))
    steps = np.diff(curves.time, axis=0)
    rates = np.divide(moved, steps, out=np.zeros_like(moved), where=steps > 0)
    going = (rates > 0.01 * rates.max(axis=0)) & (rates > 0)
    found = [
        (one.sum() / time.sum(), float(np.median(rate[some])))
        for one, time, rate, some in zip(moved.T, steps.T, rates.T, going.T, strict=True)
        if some.any()
    ]
    return (float(min(found)[0]), max(fast for _, fast in found)) if found else None
