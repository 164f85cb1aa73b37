"""A scikit-learn regressor whose model is a material law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from numbers import Integral, Real
from typing import ClassVar

import numpy as np
from scipy.optimize import least_squares, nnls
from sklearn.utils._param_validation import Interval, StrOptions

from ..materials import LAWS, Law, Ogden, Polyconvex
from .stress_regressor import BULK_RATIO, StressRegressor, incompressible_stress, nominal_stress

STARTS = 5
"""Best candidates of the search that are refined."""


@dataclass(frozen=True)
class Unknowns:
    """The unknowns of a law: their bounds, and the law that values of them make.

    Positive unknowns that range over decades are searched for in their logarithm.
    """

    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    logarithmic: np.ndarray
    law_of: Callable[[np.ndarray], Law]

    def search_value(self, values):
        """Values as they are searched for."""
        return np.where(self.logarithmic, np.log(np.where(self.logarithmic, values, 1.0)), values)

    def value(self, searched):
        """The inverse of `search_value`."""
        return np.where(self.logarithmic, np.exp(np.where(self.logarithmic, searched, 0.0)), searched)


def fitted_laws() -> list[str]:
    """Names of the laws whose parameters a `LawRegressor` finds; `EnergyRegressor` finds those of the other."""
    return [name for name in LAWS if name != Polyconvex.name]


class LawRegressor(StressRegressor):
    """Least-squares fit of a law's parameters to nominal stresses.

    The stresses fitted are those of the law that comes out, with its bulk modulus.  A coarse search over the law's dimensionless
    parameters, the shear modulus (for Ogden's law: all moduli) solved for linearly, gives the starts of a bounded trust-region iteration,
    both for rubber that keeps its volume; the best goes on with the law's own.  There is no random choice.

    Parameters
    ----------
    law : str, default="neo-hookean"
        Name of the law.
    n_terms : int, default=3
        Terms of Ogden's law; other laws do without.
    greatest_exponent : float, default=12
        Bound of the size of Ogden's exponents.
    bulk_ratio : float, default=1000
        K/mu of the law that is fitted and comes out: such tests do not tell it.  Rubber has some thousand; what a law is to have in a
        simulation, give here, as parameters that were found with another are off at large stretches.
    bulk_modulus : float, optional
        K itself instead, in the unit of the stresses.

    Attributes
    ----------
    law_ : Law
        With the parameters found.
    parameter_names_ : list of str
    parameters_ : ndarray, shape (n_parameters,)
    covariance_ : ndarray, shape (n_parameters, n_parameters)
        From the Jacobian at the solution and the scatter left over, to first order.
    standard_errors_ : ndarray, shape (n_parameters,)
        Infinite where the data do not tell a parameter.
    at_bound_ : list of str
        Parameters that ended at a bound; their standard errors mean nothing.
    n_features_in_ : int

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> data = pds.load_test_data("treloar").up_to(3.0)
    >>> found = pds.LawRegressor("gent").fit(data.stretches, data.nominal_stress)
    >>> found.law_.name, found.score(data.stretches, data.nominal_stress) > 0.99
    ('gent', False)
    """

    _parameter_constraints: ClassVar = {
        "law": [StrOptions(set(fitted_laws()))],
        "n_terms": [Interval(Integral, 1, 4, closed="both")],
        "greatest_exponent": [Interval(Real, 1, 50, closed="both")],
        "bulk_ratio": [Interval(Real, 0, None, closed="neither")],
        "bulk_modulus": [None, Interval(Real, 0, None, closed="neither")],
    }

    def __init__(self, law="neo-hookean", n_terms=3, greatest_exponent=12.0, bulk_ratio=BULK_RATIO, bulk_modulus=None):
        self.law = law
        self.n_terms = n_terms
        self.greatest_exponent = greatest_exponent
        self.bulk_ratio = bulk_ratio
        self.bulk_modulus = bulk_modulus

    def fit(self, X, y, sample_weight=None):
        """Fit the parameters.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2)
            Stretch in the direction of the stress, and across it; of a table (pandas) the columns ``stretch`` and ``lateral_stretch``, in
            any order.
        y : array-like, shape (n_samples,)
            Nominal stress.
        sample_weight : array-like, shape (n_samples,), optional

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If X has other columns or a stretch is not positive, or no parameters reach the data.
        """
        X, y, root, _ = self._checked(X, y, sample_weight)
        root = root / np.sqrt((root**2 * y**2).sum() or 1.0)
        best = None
        for unknowns, start in self._starts(X, y, root):
            found = self._refine(unknowns, start, X, y, root, incompressible_stress)
            if best is None or found.cost < best[1].cost:
                best = unknowns, found
        if best is None:
            raise ValueError(f"no parameters of {self.law} reach stretches of {X.max():g} with a positive stiffness")
        unknowns, found = best
        found = self._refine(unknowns, unknowns.value(found.x), X, y, root, nominal_stress)
        values = unknowns.value(found.x)
        at_bound = [name for name, active in zip(unknowns.names, found.active_mask, strict=True) if active]
        # The Jacobian by the parameters themselves, not by what was searched for.
        jacobian = found.jac / np.where(unknowns.logarithmic, values, 1.0)
        self._store(unknowns.law_of(values), unknowns.names, values, jacobian, 2 * found.cost, at_bound)
        return self

    def _refine(self, unknowns, start, X, y, root, stress):
        low, high = unknowns.search_value(unknowns.low), unknowns.search_value(unknowns.high)

        def residuals(searched):
            try:
                predicted = stress(unknowns.law_of(unknowns.value(searched)), X)
            except ValueError:  # parameters between the bounds that make no law
                return np.full(len(y), 1e3)
            # Past its limit a law has no stress: far from any data.
            return np.where(np.isfinite(predicted), root * (predicted - y), 1e3)

        searched = np.clip(unknowns.search_value(start), low + 1e-9 * (high - low), high - 1e-9 * (high - low))
        return least_squares(residuals, searched, bounds=(low, high), x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=400)

    def _starts(self, X, y, root):
        if self.law == Ogden.name:
            yield from self._ogden_starts(X, y, root)
            return
        law = LAWS[self.law]
        names = tuple(law.bounds)
        low, high = (np.array([law.bounds[name][side] for name in names]) for side in (0, 1))
        logarithmic = low > 0

        def law_of(values):
            modulus = float(values[0])
            return law(modulus, self.bulk_modulus or self.bulk_ratio * modulus, *(float(value) for value in values[1:]))

        scale = max(np.abs(y).max(), 1e-300)
        unknowns = Unknowns(
            ("shear_modulus", *names),
            np.array([1e-6 * scale, *low]),
            np.array([1e6 * scale, *high]),
            np.array([True, *logarithmic]),
            law_of,
        )
        candidates = []
        for shape in _grid(low, high, logarithmic):
            try:
                unit = incompressible_stress(law_of([1.0, *shape]), X)
            except ValueError:
                continue
            if not np.isfinite(unit).all():
                continue
            modulus = (root**2 * unit * y).sum() / max((root**2 * unit**2).sum(), 1e-300)
            modulus = max(modulus, unknowns.low[0])
            candidates.append((((root * (modulus * unit - y)) ** 2).sum(), np.array([modulus, *shape])))
        candidates.sort(key=lambda candidate: candidate[0])
        yield from ((unknowns, start) for _, start in candidates[:STARTS])

    def _ogden_starts(self, X, y, root):
        n, most = self.n_terms, self.greatest_exponent
        grid = [value for value in (-8.0, -5.0, -3.0, -2.0, -1.0, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 11.0) if abs(value) <= most]
        thickness = 1 / X.prod(axis=1)
        # Stress of a term of unit stiffness: modulus times exponent is 1.
        columns = {a: root * (X[:, 0] ** a - thickness**a) / X[:, 0] / a for a in grid}
        candidates = []
        for exponents in combinations(grid, n):
            matrix = np.stack([columns[a] for a in exponents], axis=1)
            if np.isfinite(matrix).all():
                stiffness, error = nnls(matrix, root * y)
                candidates.append((error, exponents, stiffness))
        candidates.sort(key=lambda candidate: candidate[0])
        scale = max(np.abs(y).max(), 1e-300)
        for _, exponents, stiffness in candidates[:STARTS]:
            signs = np.sign(exponents)

            def law_of(values, signs=signs):
                moduli = values[:n] * signs
                modulus = float((moduli * values[n:]).sum() / 2)
                return Ogden(modulus, self.bulk_modulus or self.bulk_ratio * modulus, tuple(moduli), tuple(values[n:]))

            # Moduli are searched for by their sizes, and have the signs of their exponents.
            moduli = np.maximum(stiffness / np.abs(exponents), 1e-7 * scale)
            names = tuple(f"{what}_{number}" for what in ("modulus", "exponent") for number in range(1, n + 1))
            low = np.concatenate([np.full(n, 1e-9 * scale), np.where(signs > 0, 0.1, -most)])
            high = np.concatenate([np.full(n, 1e6 * scale), np.where(signs > 0, most, -0.1)])
            logarithmic = np.repeat([True, False], n)
            yield Unknowns(names, low, high, logarithmic, law_of), np.concatenate([moduli, exponents])


def _grid(low, high, logarithmic) -> np.ndarray:
    """Candidates for the dimensionless parameters of a law, of shape (n, number of them)."""
    if not len(low):
        return np.zeros((1, 0))
    per_axis = 60 if len(low) == 1 else 25
    axes = []
    for least, greatest, in_logarithm in zip(low, high, logarithmic, strict=True):
        if in_logarithm:
            axes.append(np.geomspace(least, greatest, per_axis))
        else:
            # Dense about 0, where most of the dimensionless coefficients of rubber lie.
            spread = np.geomspace(1e-5, 1, per_axis // 2)
            axes.append(np.unique(np.concatenate([-spread * max(-least, 0), [0.0], spread * max(greatest, 0)])))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(low))
