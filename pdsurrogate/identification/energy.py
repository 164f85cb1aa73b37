"""Energy from test data without the choice of a law: a sparse sum of polyconvex terms with non-negative weights."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from numbers import Integral, Real
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import nnls
from scipy.spatial import ConvexHull
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import check_is_fitted

from ..arguments import in_order
from ..materials import Law
from ..materials.dictionary import (
    NEGATIVE,
    POSITIVE,
    STABLE_TO,
    STEP,
    Term,
    checked_dictionary,
    derivatives,
    powers_of_stretches,
    sets_of_invariants,
    wave_check,
)
from ..materials.polyconvex import law_of
from ..materials.stretch_laws import MOST_TERMS
from .data import BIAXIAL, MODES
from .stress_regressor import BULK_CONSTRAINTS, BULK_RATIO, StressRegressor, free_sides, states

AS_GOOD = 0.05
"""Relative difference of the errors of two dictionaries (sets of candidate energy terms) up to which the smaller one is chosen. Chosen:
errors of cross-validation over a few modes are not known to better than some percent; with 0 the choice would follow the scatter of
single tests."""

FOLDS = 5
"""Number of folds of cross-validation, where the folds are not the modes of loading: ranges of the greatest stretch in a biaxial grid
(`groups_of`), and states taken by turns (`fifths_of`). Chosen: the usual five, with which each fit keeps four fifths of the tests."""

ROUNDING = 1e-13
"""Relative improvement of a sum of squares that may be due to rounding."""

BEAM = 10
"""Number of sets of terms that a search extends by one term."""

NEGLIGIBLE = 1e-6
"""Relative RMS error of stresses that no further term shall reduce: no test is as exact."""

ROUNDS = 60
"""Most rounds of a fit, each of the weights at given volume ratios, and of the volume ratios that follow from these weights. At the bulk
moduli of rubber a few rounds suffice; sixty end a search that alternates between two sets of terms."""

SAME_MODE = 0.01
"""Greatest difference in log-stretch between the lateral stretch of a state and that of a mode of loading at which the state counts as one
of this mode. Chosen: modes differ by more from strains of a few percent on."""


@dataclass(eq=False, repr=False)
class EnergyRegressor(StressRegressor):
    """Isochoric energy fitted to nominal stresses, without a law.

    W is a sum of terms with non-negative weights. It has the fewest terms with which cross-validation predicts stresses as well as with
    more. The terms are (l1^a + l2^a + l3^a - 3)/a^2 with positive and negative exponents, |a| >= 1 (a separable energy, after Valanis and
    Landel), and, where cross-validation shows an improvement, powers up to the fourth of I1bar - 3 and of I2bar^1.5 - 3 sqrt 3, roots of
    the invariants and logarithms of I1bar - 3. Energy and stress always vanish in the undeformed state, and W grows without bound. Each
    term is polyconvex among deformations that keep the volume (`pdsurrogate.materials.Polyconvex`), so that W is polyconvex, too, and shear
    waves are stable in all states. Beyond the data W continues as these terms.

    In states of constant volume the stresses are linear in the weights, so that the weights of given terms are a non-negative
    least-squares fit, without a start or random choices. Volume ratios, which depend on the bulk modulus, and weights are found
    alternately. The range of the exponents and the terms of the invariants are chosen by cross-validation over modes of loading, or over
    parts of a biaxial grid; with at least three modes or parts, the terms of the invariants are chosen by the geometric mean of this error
    and the error of a second cross-validation, in five folds of interleaved states. The number of terms is the least whose squared errors
    in these folds exceed those of the best number by at most the standard error of the difference. Of each number of terms, a search that
    adds, exchanges and removes terms finds those that fit best.

    Parameters
    ----------
    max_terms : int, default=8
        Most terms; cross-validation chooses fewer where more do not predict better.
    margin : float, default=0.05
        Extension of the hull of the data, in log-stretch, within which the energy holds; a larger one includes states without data.
    bulk_ratio : float, default=1000
        K/mu of the law, which such tests do not determine, see `LawRegressor`.
    bulk_modulus : float, optional
        K instead of K/mu, in the unit of the stresses.
    offset : float, default=0.0
        Increase of the absolute values of all exponents of the default dictionary, less than their step of 0.25. The place of the grid of
        exponents is arbitrary: members of a committee have random offsets.
    dictionary : sequence of (str, float), optional
        Candidate terms, pairs of a kind and a number as in `pdsurrogate.materials.dictionary.Term`, such as ``("second_logarithm", 1)``. By
        default the sets named above, from which cross-validation chooses one. Of sums with a term that is not polyconvex, those are left
        out whose waves are unstable in states with stretches up to 3, or up to those of the data if these are greater.

    Attributes
    ----------
    law_ : Ogden or Polyconvex
        Energy as a law for every force model; the latter if it has other terms than powers of stretches.
    terms_ : list of Term
        Terms of the energy: pairs of a kind and a number (`pdsurrogate.materials.polyconvex.Term`).
    weights_ : ndarray, shape (n_terms,)
        Their weights, in the unit of the stresses.
    parameter_names_, parameters_, covariance_, standard_errors_, at_bound_
        Weights with their covariance and standard errors, for given terms and volume ratios.
    cross_validation_ : list of dict
        ``greatest`` and ``least`` exponent, number of ``invariants``, which are terms of the invariants, and ``relative_rms`` error of the
        data left out; empty for a given `dictionary`.
    errors_by_size_ : ndarray, shape (max_terms,)
        Relative RMS error of the data left out for 1, 2, ... terms; empty if the data have fewer than two states.
    hull_ : ndarray, shape (n, 3)
        Half-planes (n1, n2, -d) of the convex hull of the data and the undeformed state: n . x <= d, where x are the logarithms of the
        greatest and of the middle one of the three stretches of a state, whose directions do not matter to an isotropic energy.
    stretch_range_ : tuple of float
        Least and greatest stretch of the data.
    n_features_in_ : int

    References
    ----------
    Valanis, Landel, J. Appl. Phys. 38 (1967) 2997; Ball, Arch. Rat. Mech. Anal. 63 (1977) 337; Ogden 1972; Hartmann, Neff, Int. J. Solids
    Struct. 40 (2003) 2767.

    See Also
    --------
    pdsurrogate.identification.LawRegressor : fits the parameters of a law.
    pdsurrogate.identification.committee : fits members to random halves of the tests.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> data = pds.load_test_data("treloar").up_to(3.0)
    >>> found = pds.identification.EnergyRegressor().fit(data.stretches, data.nominal_stress)
    >>> bool(found.score(data.stretches, data.nominal_stress) > 0.99)
    True
    """

    _parameter_constraints: ClassVar = {
        "max_terms": [Interval(Integral, 1, MOST_TERMS, closed="both")],
        "margin": [Interval(Real, 0, 1, closed="both")],
        **BULK_CONSTRAINTS,
        "dictionary": "no_validation",  # checked with its terms
        "offset": [Interval(Real, 0, STEP, closed="left")],
    }

    law: ClassVar[str] = "energy"
    """Name of the model in reports, where a `LawRegressor` has the name of its law."""

    max_terms: int = 8
    margin: float = 0.05
    bulk_ratio: float = BULK_RATIO
    bulk_modulus: float | None = None
    offset: float = 0.0
    dictionary: Sequence[tuple[str, float]] | None = None

    def redrawn(self, random):
        return super().redrawn(random).set_params(offset=random.uniform(0, STEP))

    def fit(self, X, y, sample_weight=None, groups=None):
        """Fit the weights of the energy terms to nominal stresses.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2)
            Stretches along the stress and across it; a table (pandas) has the columns ``stretch`` and ``lateral_stretch`` in any order.
        y : array-like, shape (n_samples,)
            Nominal stresses.
        sample_weight : array-like, shape (n_samples,), optional
        groups : array-like, shape (n_samples,), optional
            Groups that are left out together in cross-validation; by default modes of loading (`groups_of`).

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If X has other columns or a stretch is not positive.

        Warns
        -----
        UserWarning
            If the stresses do not rise with the stretch, or the data are of one state or one mode of loading and so leave the energy
            undetermined.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> data = pds.load_test_data("treloar").up_to(3.0)
        >>> found = pds.identification.EnergyRegressor(max_terms=4).fit(data.stretches, data.nominal_stress)
        >>> len(found.weights_) <= 4
        True
        """
        given = None if self.dictionary is None else checked_dictionary(self.dictionary)
        X, y, root, used = self._checked(X, y, sample_weight)
        _warn_of_few_modes(X)
        if groups is not None and np.shape(groups) != used.shape:
            raise ValueError(f"groups must have one entry for each of the {len(used)} rows of X, not the shape {np.shape(groups)}")
        groups = groups_of(X) if groups is None else np.asarray(groups)[used]
        self.cross_validation_ = []
        chosen = self._chosen(X, y, root, groups) if given is None else given
        stable = wave_check(chosen, max(STABLE_TO, X.max(), 1 / X.min()))
        # The volume ratios of a first fit serve the choice of the number of terms, of which some would describe the change of volume.
        *_, stretches = self._alternately(X, y, root, chosen, stable, self.max_terms)
        count = self._count(columns_of(stretches, X[:, 0], chosen), y, root, chosen, stable, fifths_of(X))
        law, self.terms_, self.weights_, stretches = self._alternately(X, y, root, chosen, stable, count)
        columns = root[:, None] * columns_of(stretches, X[:, 0], self.terms_)
        squares = ((columns @ self.weights_ - root * y) ** 2).sum()
        self._store(law, [f"weight of {term}" for term in self.terms_], self.weights_, columns, squares)
        self.stretch_range_ = float(X.min()), float(X.max())
        self.hull_ = half_planes(X)
        return self

    def law_of(self, values: ArrayLike) -> Law:
        """Return the energy with given weights of the fitted terms as a law.

        Parameters
        ----------
        values : array-like, shape (n_terms,)
            Weights, none of which is negative.

        Returns
        -------
        Law

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> data = pds.load_test_data("treloar").up_to(3.0)
        >>> found = pds.identification.EnergyRegressor().fit(data.stretches, data.nominal_stress)
        >>> found.law_of(found.weights_) == found.law_
        True
        """
        check_is_fitted(self)
        if np.shape(values) != (len(self.terms_),):
            raise ValueError(f"values must have one weight for each of the {len(self.terms_)} terms, not the shape {np.shape(values)}")
        return law_of(self.terms_, values, self._bulk(stiffness_of(self.terms_, np.asarray(values, dtype=float))))

    def beyond(self, X) -> np.ndarray:
        """Return how far states lie outside the domain of the energy: the convex hull of the data, extended by `margin`.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2)
            Stretches along the stress and across it, as for `fit`.

        Returns
        -------
        ndarray, shape (n_samples,)
            Distance from the hull in log-stretch; at most 0 within it.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> data = pds.load_test_data("treloar").up_to(3.0)
        >>> found = pds.identification.EnergyRegressor().fit(data.stretches, data.nominal_stress)
        >>> (found.beyond([[2.0, 2.0**-0.5], [6.0, 6.0**-0.5]]) > 0).tolist()
        [False, True]
        """
        check_is_fitted(self)
        logs = ordered_logs(self._stretches(np.asarray(in_order(X, self.columns, "X"), dtype=float)))
        return (logs @ self.hull_[:, :2].T + self.hull_[:, 2]).max(axis=1) - self.margin

    def domain_hull(self) -> list[list[float]]:
        """Return the half-planes that bound the domain of the fitted energy.

        They are the sides of the convex hull of the test data in logarithmic stretches, moved outwards by ``margin``.

        Returns
        -------
        list of list of float
            Half-planes (n1, n2, d), as in ``hull`` of `pdsurrogate.forces.protocol.Domain`.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> data = pds.load_test_data("treloar").up_to(3.0)
        >>> found = pds.identification.EnergyRegressor().fit(data.stretches, data.nominal_stress)
        >>> len(found.domain_hull()) == len(found.hull_)
        True
        """
        check_is_fitted(self)
        return [[n1, n2, self.margin - offset] for n1, n2, offset in self.hull_.tolist()]

    def _alternately(self, X, y, root, chosen, stable, count) -> tuple[Law, list[Term], np.ndarray, np.ndarray]:
        """Fit at most `count` of the terms `chosen`, with `stable` waves, and volume ratios alternately.

        Return law, terms, weights and isochoric stretches.
        """
        volume = np.ones_like(y)
        for _ in range(ROUNDS):
            stretches = isochoric(X, volume)
            terms, weights = _fitted(columns_of(stretches, X[:, 0], chosen), y, root, chosen, stable, count)
            if not stiffness_of(terms, weights) > 0:
                if self.dictionary is not None:
                    raise no_sum_fits("stresses", "that they rise with the stretch")
                warnings.warn("the stresses do not rise with the stretch as in rubber; the fitted energy is almost zero", stacklevel=3)
                terms, weights = [Term("stretches", 2.0)], np.array([1e-6 * max(np.abs(y).max(), 1e-300)])
            law = law_of(terms, weights, self._bulk(stiffness_of(terms, weights)))
            before, found = volume, states(law, X)[1]
            volume = np.where(np.isfinite(found), found, volume)
            if np.abs(volume - before).max() < 1e-9:
                break
        return law, terms, weights, stretches

    def _chosen(self, X, y, root, groups) -> list[Term]:
        """Return the set of candidate energy terms with the least error of cross-validation over `groups`.

        The best range of exponents is chosen for each set of terms of the invariants, and then the best of these sets; a smaller set wins
        if its error is nearly as small (`AS_GOOD`). `root` holds square roots of row weights; `cross_validation_` records the errors.
        """
        candidates = []
        greatest_first = np.exp(2 * ordered_logs(X)).sum(axis=1) + np.exp(-2 * np.log(X).sum(axis=1)) - 3
        for invariants in sets_of_invariants(max(greatest_first.max(), SAME_MODE)):
            dictionaries = []
            for greatest, least in product(POSITIVE, NEGATIVE):
                terms = [*powers_of_stretches(greatest, least, self.offset), *invariants]
                error = self._left_out(X, y, root, groups, terms)
                dictionaries.append((terms, error))
                self.cross_validation_.append({"greatest": greatest, "least": -least, "invariants": len(invariants), "relative_rms": error})
            terms, error = _first_as_good(dictionaries)
            if len(np.unique(groups)) > 2:
                # Enough modes to judge interpolation between them as well as extrapolation.
                error = np.sqrt(error * self._left_out(X, y, root, fifths_of(X), terms))
            candidates.append((terms, error))
        return _first_as_good(candidates)[0]

    def _left_out(self, X, y, root, groups, terms) -> float:
        """Return one relative RMS error of cross-validation: each group of stresses is predicted by a fit to the other groups.

        It is the RMS over all groups divided by the RMS of the stresses; 0 if there is only one group. The fits have the candidate energy
        terms `terms` and constant volume; `root` holds square roots of row weights.
        """
        columns, size = columns_of(isochoric(X, np.ones_like(y)), X[:, 0], terms), ((root * y) ** 2).sum()
        squares = _squares_left_out(columns, y, root, groups, lambda *rows: [nonnegative(*rows)[0]])
        return float(np.sqrt(squares.sum() / size)) if size > 0 else 0.0

    def _count(self, columns, y, root, terms, stable, folds) -> int:
        """Return the least number of terms whose error of cross-validation exceeds the least error by at most its standard error.

        `columns` holds the stress of each candidate of `terms` with unit weight; waves are to be `stable`.
        """
        stiff = [term.shear_modulus > 0 for term in terms]

        def fits(columns, y, root):
            found = [_weights(columns, y, root, chosen) for chosen in best_sets(columns, y, root, stiff, stable, self.max_terms)]
            return [found[min(size, len(found) - 1)] if found else np.zeros(columns.shape[1]) for size in range(self.max_terms)]

        squares = _squares_left_out(columns, y, root, folds, fits)
        if not len(squares):
            self.errors_by_size_ = np.empty(0)
            return self.max_terms
        total = squares.sum(axis=0)
        self.errors_by_size_ = np.sqrt(total / max(((root * y) ** 2).sum(), 1e-300))
        excess = squares - squares[:, [total.argmin()]]
        most = np.sqrt(len(squares)) * excess.std(axis=0, ddof=1) + NEGLIGIBLE**2 * ((root * y) ** 2).sum()
        return 1 + int(np.argmax(excess.sum(axis=0) <= most))


def no_sum_fits(what: str, check: str) -> ValueError:
    """Return the error that no permitted sum of the terms of a dictionary describes the data `what`, with what the user may check first."""
    return ValueError(
        f"no sum of the terms with positive coefficients and stable waves describes the {what}: check {check}, and that a given dictionary "
        "has a polyconvex term, such as ('first', 1)"
    )


def _squares_left_out(columns, y, root, groups, fits) -> np.ndarray:
    """Return sums of squared errors of the stresses of each group by fits to the other groups, shape (groups, fits); none of one group.

    ``fits(columns, y, root)`` returns a list of weights of the columns.
    """
    kinds, squares = np.unique(groups), []
    for kind in kinds if len(kinds) > 1 else ():
        left = groups == kind
        found = np.array(fits(columns[~left], y[~left], root[~left]))
        squares.append(((root[left] * (found @ columns[left].T - y[left])) ** 2).sum(axis=1))
    return np.array(squares)


def _fitted(columns, y, root, terms, stable, count) -> tuple[list[Term], np.ndarray]:
    """Return the at most `count` energy terms that fit the stresses y best, and their weights.

    `columns` holds the stress of each term with unit weight, and `root` the square roots of the row weights.
    """
    sets = best_sets(columns, y, root, [term.shear_modulus > 0 for term in terms], stable, count)
    weights = _weights(columns, y, root, sets[-1]) if sets else np.zeros(len(terms))
    return [term for term, weight in zip(terms, weights, strict=True) if weight > 0], weights[weights > 0]


def _weights(columns, y, root, chosen) -> np.ndarray:
    """Return non-negative weights of all columns, zeros but for the `chosen` ones, that fit y best."""
    weights = np.zeros(columns.shape[1])
    weights[chosen] = nonnegative(columns[:, chosen], y, root)[0]
    return weights


def best_sets(
    columns: np.ndarray, y: np.ndarray, root: np.ndarray, stiff: Sequence[bool], stable: Callable[[np.ndarray], np.ndarray], most: int
) -> list[np.ndarray]:
    """Return sets of 1, 2, ... columns whose sums with positive coefficients fit y best, at most of `most` columns, as index arrays.

    Each set has a column that `stiff` flags: without one the undeformed material would have no stiffness. Its coefficients pass the check
    `stable` (`pdsurrogate.materials.dictionary.wave_check`).

    All pairs are compared. Each of the `BEAM` best sets of a size is extended by one column; in the best of these sets columns are
    exchanged, one at a time, as long as the fit improves; and if it, less one of its columns, fits better than the set before, it takes its
    place (floating search: Pudil, Novovicova, Kittler, Pattern Recognit. Lett. 15 (1994) 1119). The sum of two terms resembles a third
    one, so that neither adding single terms nor a lasso finds the two. The list ends where no column improves a fit. `root` holds square
    roots of the weights of the rows.
    """
    columns, y = root[:, None] * columns, root * y
    size = np.linalg.norm(columns, axis=0)
    columns, has_stiffness = columns / np.where(size > 0, size, 1.0), np.asarray(stiff)
    # The tiny number on the diagonal keeps sets of nearly equal columns from being singular.
    gram, right = columns.T @ columns + ROUNDING * np.eye(len(size)), columns.T @ y

    def gains(sets):
        """Return the decreases of the sum of squares by sets of columns; only stiff and stable ones with positive coefficients count."""
        found = np.linalg.solve(gram[sets[:, :, None], sets[:, None, :]], right[sets][..., None])[..., 0]
        permitted = (found > 0).all(axis=1) & has_stiffness[sets].any(axis=1)
        coefficients = np.zeros((permitted.sum(), len(size)))
        np.put_along_axis(coefficients, sets[permitted], found[permitted] / size[sets[permitted]], axis=1)
        permitted[permitted] = stable(coefficients)
        return np.where(permitted, (found * right[sets]).sum(axis=1), 0.0)

    def best(sets):
        values = gains(sets)
        return values.max(), sets[values.argmax()]

    def without_one(chosen):
        return np.array([np.delete(chosen, at) for at in range(len(chosen))])

    def exchanged(gain, chosen):
        """Exchange columns of a set, one at a time, as long as the fit improves."""
        while True:
            others = np.setdiff1d(every, chosen)
            better = best(np.array([[*rest, other] for rest in without_one(chosen) for other in others]))
            if not better[0] > gain * enough:
                return gain, chosen
            gain, chosen = better

    every, enough = np.arange(len(size)), 1 + ROUNDING
    found = [best(every[:, None])]
    if not found[0][0] > 0:
        return []
    beam = every[:, None]
    while len(found) < min(most, len(size) - 1):
        wide = np.unique(np.sort([[*one, other] for one in beam for other in np.setdiff1d(every, one)], axis=1), axis=0)
        beam = wide[np.argsort(-gains(wide))[:BEAM]]
        gain, chosen = exchanged(*best(beam))
        if not gain > found[-1][0] * enough:
            break
        found.append((gain, chosen))
        while len(found) > 2:
            fewer = exchanged(*best(without_one(found[-1][1])))
            if not fewer[0] > found[-2][0] * enough:
                break
            found[-2:] = [fewer]
    return [chosen for _, chosen in found]


def nonnegative(columns: np.ndarray, y: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit y by a sum of columns with non-negative coefficients; return these, and these times the norms of ``root * column``.

    `root` holds the square roots of the weights of the rows in the least-squares fit.
    """
    columns = root[:, None] * columns
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0  # data of the undeformed state have no stress
    shares = nnls(columns / size, root * y)[0]
    return shares / size, shares


def _first_as_good(choices: list[tuple]) -> tuple:
    """Return the first pair (terms, error) of `choices`, ordered by size, whose error exceeds the least by at most 5 % (`AS_GOOD`)."""
    most = (1 + AS_GOOD) * min(error for _, error in choices) + 1e-9
    return next(choice for choice in choices if choice[1] <= most)


def stiffness_of(terms: Sequence[Term], weights: np.ndarray) -> float:
    """Return the shear modulus of an energy in the undeformed state."""
    return float(sum(weight * term.shear_modulus for term, weight in zip(terms, weights, strict=True)))


def isochoric(X: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """Return the three isochoric principal stretches, shape (n, 3), of states X (two stretches) with given volume ratios.

    In states with free sides the lateral stretch is that of the thickness, whatever X states.
    """
    first, second = X.T
    lateral = np.where(free_sides(first, second), np.sqrt(volume / first), second)
    l1, l2 = first * volume ** (-1 / 3), lateral * volume ** (-1 / 3)
    return np.stack([l1, l2, 1 / (l1 * l2)], axis=1)


def ordered_logs(X: np.ndarray) -> np.ndarray:
    """Return the logarithms of the greatest and of the middle principal stretch of incompressible states X, shape (n, 2)."""
    logs = np.log(X)
    return -np.sort(-np.column_stack([logs, -logs.sum(axis=1)]), axis=1)[:, :2]


def _warn_of_few_modes(X: np.ndarray) -> None:
    """Warn of data of one state or one mode of loading, which leave most of an energy undetermined."""
    logs = ordered_logs(X)
    states = np.unique(logs[np.abs(logs).max(axis=1) > SAME_MODE].round(3), axis=0)
    if len(states) <= 1:
        warnings.warn("the data contain a single state, which determines only a shear modulus; add other stretches and modes", stacklevel=3)
    elif np.abs(logs @ line_through_rest(logs)[0]).max() < SAME_MODE:
        mode = str(groups_of(X)[np.abs(logs).max(axis=1).argmax()])
        warnings.warn(
            f"the data contain a single mode of loading ({mode if mode in MODES else BIAXIAL}), which determines neither the stresses in "
            "other modes nor the share of the second invariant; add another mode, such as pure shear or equibiaxial tension",
            stacklevel=3,
        )


def half_planes(X: np.ndarray) -> np.ndarray:
    """Return the half-planes (`EnergyRegressor.hull_`) of the convex hull of states X and the undeformed state.

    The hull is a line segment if all states are of one mode of loading.
    """
    logs = ordered_logs(X)
    off, along = line_through_rest(logs)
    if np.abs(logs @ off).max() < SAME_MODE:
        reach = np.append(logs @ along, 0.0)
        thick = np.abs(logs @ off).max()
        return np.array([[*off, -thick], [*-off, -thick], [*along, -reach.max()], [*-along, reach.min()]])
    return ConvexHull(np.vstack([logs, np.zeros(2)])).equations


def line_through_rest(logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return unit vectors across and along the line through the origin, the undeformed state, that fits log-stretches, (n, 2), best."""
    along, off = np.linalg.svd(np.vstack([logs, np.zeros((2, 2))]), full_matrices=False)[2]
    return off, along


def columns_of(stretches: np.ndarray, first: np.ndarray, terms: Sequence[Term]) -> np.ndarray:
    """Return the nominal stress along the first stretch of each energy term with unit weight, shape (n_samples, n_terms).

    `stretches` are the isochoric principal stretches, shape (n_samples, 3), with the stress-free thickness last; `first` are the full
    stretches along the stress, which include the change of volume.
    """
    slopes = derivatives(terms, np.log(stretches))[1]
    return (slopes[..., 0] - slopes[..., 2]) / first[:, None]


def fifths_of(X) -> np.ndarray:
    """Return a fold for each row: states sorted by greatest stretch have the folds 0, 1, 2, 3, 4, 0, 1, ...; equal states the same."""
    return np.unique(ordered_logs(X).round(9), axis=0, return_inverse=True)[1].ravel() % FOLDS


def groups_of(X) -> np.ndarray:
    """Return a group for each row: the name of its mode of loading, or `BIAXIAL` for a state of none of `MODES`.

    If most rows are of no mode, the groups are instead fifths of the rows, contiguous in the greater stretch.
    """
    first, second = X.T
    same = np.array([np.abs(np.log(second / lateral(first))) < SAME_MODE for lateral in MODES.values()])
    groups = np.where(same.any(axis=0), np.array(list(MODES))[same.argmax(axis=0)], BIAXIAL)
    if (groups == BIAXIAL).sum() > len(X) / 2:
        greater = X.max(axis=1)
        bounds = np.quantile(greater, np.arange(1, FOLDS) / FOLDS)
        return np.searchsorted(bounds, greater).astype(str)
    return groups
