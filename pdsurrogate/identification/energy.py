"""Energy from test data without the choice of a law: a sum of powers of stretches and invariants with non-negative weights."""

import warnings
from dataclasses import dataclass
from itertools import product
from numbers import Integral, Real
from typing import ClassVar

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import ConvexHull
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import check_is_fitted

from ..arguments import in_order
from ..materials import Ogden, Polyconvex
from ..materials.stretch_laws import MOST_TERMS, SECOND_AT_REST
from .data import BIAXIAL, MODES
from .stress_regressor import BULK_CONSTRAINTS, BULK_RATIO, StressRegressor, free_sides, states

LEAST_EXPONENT = 1.0
"""Least absolute value of an exponent of the stretches: a sum of their powers is convex in F for exponents of 1 and more, and convex in the
cofactor of F for exponents of -1 and less."""

STEP = 0.25
"""Distance between candidate exponents: the stresses of neighbors are nearly proportional, so that a smaller one would gain nothing."""

POSITIVE, NEGATIVE = (3.0, 5.0, 8.0, 12.0), (1.0, 2.0, 4.0, 6.0)
"""Greatest exponents of the stretches, and of their inverses, among which cross-validation chooses. Chosen: about evenly spaced in the
logarithm; Ogden's exponents for rubber are 5 and -2, and above 12 a term acts only at the greatest stretch of the data."""

INVARIANTS = ((), ((1, 2), (1, 3)), ((1, 2), (1, 3), (2, 1), (2, 2), (2, 3)))
"""Sets of powers of invariants among which cross-validation chooses, as (invariant 1 or 2, power): none, those of I1bar - 3, and
those of I2bar^1.5 - 3 sqrt 3 as well, which may extrapolate badly to modes without data. I1bar - 3 itself is the exponent 2."""

AS_GOOD = 0.05
"""Relative difference of the errors of two dictionaries (sets of candidate energy terms) up to which the smaller one is chosen. Chosen:
errors of cross-validation over a few modes are not known to better than some percent; with 0 the choice would follow the scatter of
single tests."""

FOLDS = 5
"""Number of folds of cross-validation, where the folds are not the modes of loading: ranges of the greatest stretch in a biaxial grid
(`groups_of`), and states taken by turns (`fifths_of`). Chosen: the usual five, with which each fit keeps four fifths of the tests."""

ROUNDS = 60
"""Most rounds of a fit, each of the weights at given volume ratios, and of the volume ratios that follow from these weights. At the bulk
moduli of rubber a few rounds suffice; sixty end a search that alternates between two sets of terms."""

SAME_MODE = 0.01
"""Greatest difference in log-stretch between the lateral stretch of a state and that of a mode of loading at which the state counts as one
of this mode. Chosen: modes differ by more from strains of a few percent on."""


@dataclass(eq=False, repr=False)
class EnergyRegressor(StressRegressor):
    """Isochoric energy fitted to nominal stresses, without a law.

    W is the sum of c_a/a^2 (l1^a + l2^a + l3^a - 3) over a dictionary of positive and negative exponents with |a| >= 1 and with c_a >= 0
    (a separable energy, after Valanis and Landel). Where cross-validation shows an improvement, W also has powers up to the third of
    I1bar - 3 and of I2bar^1.5 - 3 sqrt 3, with non-negative weights. Energy and stress always vanish in the undeformed state, and W
    grows without bound; sums of l^a are convex functions of F for a >= 1 and of its cofactor for a <= -1, and the powers of invariants are
    polyconvex, so that W is polyconvex among deformations that keep the volume, and shear waves are stable in all states. Beyond the data
    W continues as these powers.

    In states of constant volume the stresses are linear in the weights, so that the weights are a non-negative least-squares fit, without
    a start or random choices, and few terms remain. Volume ratios, which depend on the bulk modulus, and weights are found alternately.
    The range of the exponents and the powers of invariants are chosen by cross-validation over modes of loading, or over parts of a
    biaxial grid; with at least three modes or parts, the powers of invariants are chosen by the geometric mean of this error and the
    error of a second cross-validation, in five folds of interleaved states.

    Parameters
    ----------
    max_terms : int, default=8
        Most terms; those with the least contribution to the stress are left out.
    margin : float, default=0.05
        Extension of the hull of the data, in log-stretch, within which the energy holds; a larger one trusts it where no data support it.
    bulk_ratio : float, default=1000
        K/mu of the law, which such tests do not determine, see `LawRegressor`.
    bulk_modulus : float, optional
        K instead of K/mu, in the unit of the stresses.
    offset : float, default=0.0
        Increase of the absolute values of all exponents, less than their step of 0.25. The place of the grid of exponents is arbitrary:
        members of a committee have random offsets.

    Attributes
    ----------
    law_ : Ogden or Polyconvex
        Energy as a law for every force model; the latter if it has powers of invariants.
    exponents_, weights_ : ndarray, shape (n_terms,)
        a, and c_a in the unit of the stresses. Half of the sum of c_a, with the part of the invariants, is the shear modulus.
    invariant_weights_ : dict
        Weights of the powers of the invariants by (1 or 2, power), in the unit of the stresses; empty if there are none.
    parameter_names_, parameters_, covariance_, standard_errors_, at_bound_
        Weights with their covariance and standard errors, for given exponents and volume ratios.
    cross_validation_ : list of dict
        ``greatest`` and ``least`` exponent, number of ``invariants``, and ``relative_rms`` error of the data left out.
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
        "offset": [Interval(Real, 0, STEP, closed="left")],
    }

    law: ClassVar[str] = "energy"
    """Name of the model in reports, where a `LawRegressor` has the name of its law."""

    max_terms: int = 8
    margin: float = 0.05
    bulk_ratio: float = BULK_RATIO
    bulk_modulus: float | None = None
    offset: float = 0.0

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
        X, y, root, used = self._checked(X, y, sample_weight)
        _warn_of_few_modes(X)
        groups = groups_of(X) if groups is None else np.asarray(groups)[used]
        chosen = self._chosen(X, y, root, groups)
        volume = np.ones_like(y)
        for _ in range(ROUNDS):
            stretches = isochoric(X, volume)
            terms, weights = self._fitted(columns_of(stretches, X[:, 0], chosen), y, root, chosen)
            if not stiffness_of(terms, weights) > 0:
                warnings.warn("the stresses do not rise with the stretch as in rubber; the fitted energy is almost zero", stacklevel=2)
                terms, weights = np.array([[0, 2.0]]), np.array([1e-6 * max(np.abs(y).max(), 1e-300)])
            before, (law, volume) = volume, self._law_and_volume(terms, weights, X, volume)
            if np.abs(volume - before).max() < 1e-9:
                break
        columns = root[:, None] * columns_of(stretches, X[:, 0], terms)
        squares = ((columns @ weights - root * y) ** 2).sum()
        self._store(law, [_name_of(term) for term in terms], weights, columns, squares)
        self.exponents_, self.weights_, self.invariant_weights_ = parted(terms, weights)
        self.stretch_range_ = float(X.min()), float(X.max())
        self.hull_ = half_planes(X)
        return self

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

    def _chosen(self, X, y, root, groups) -> np.ndarray:
        """Return the set of candidate energy terms, as rows of `terms_of`, with the least error of cross-validation over `groups` of rows.

        The best range of exponents is chosen for each set of powers of invariants, and then the best of these sets; a smaller set wins if
        its error is nearly as small (`AS_GOOD`). `root` holds square roots of row weights. The errors are recorded in `cross_validation_`.
        """
        self.cross_validation_, candidates = [], []
        for invariants in INVARIANTS:
            dictionaries = []
            for greatest, least in product(POSITIVE, NEGATIVE):
                terms = terms_of(dictionary(greatest, least, self.offset), invariants)
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
        columns, error, size, kinds = columns_of(isochoric(X, np.ones_like(y)), X[:, 0], terms), 0.0, 0.0, np.unique(groups)
        for kind in kinds if len(kinds) > 1 else ():
            left = groups == kind
            kept, weights = self._fitted(columns[~left], y[~left], root[~left], np.arange(len(terms)))
            error += ((root[left] * (columns[left][:, kept] @ weights - y[left])) ** 2).sum()
            size += ((root[left] * y[left]) ** 2).sum()
        return float(np.sqrt(error / size)) if size > 0 else 0.0

    def _fitted(self, columns, y, root, terms) -> tuple[np.ndarray, np.ndarray]:
        """Fit weights of energy terms to the stresses y; return the terms with a positive weight, at most `max_terms`, and the weights.

        `columns` holds the stress of each term with unit weight, and `root` the square roots of the row weights.
        """
        kept = np.arange(len(terms))
        while True:
            weights, shares = nonnegative(columns[:, kept], y, root)
            some = shares > 1e-9 * max(shares.max(), 1e-300)
            if some.sum() <= self.max_terms:
                return terms[kept[some]], weights[some]
            # Without the term of the least contribution to the stress.
            kept = np.delete(kept[some], shares[some].argmin())

    def _law_and_volume(self, terms, weights, X, volume) -> tuple[Ogden, np.ndarray]:
        """Return the law with given weights of terms, and its volume ratios in the states X, or `volume` where the law has no stress."""
        exponents, powers, invariants = parted(terms, weights)
        # A term of Ogden's law is mu_k/alpha_k (...): mu_k alpha_k is the weight.
        moduli, alphas = tuple((powers / exponents).tolist()), tuple(exponents.tolist())
        bulk = self._bulk(stiffness_of(terms, weights))
        if not invariants:
            law = Ogden(bulk_modulus=bulk, moduli=moduli, exponents=alphas)
        else:
            first, second = (tuple(invariants.get((which, power), 0.0) for power in (1, 2, 3)) for which in (1, 2))
            law = Polyconvex(bulk_modulus=bulk, moduli=moduli, exponents=alphas, first=first, second=second)
        found = states(law, X)[1]
        return law, np.where(np.isfinite(found), found, volume)


def nonnegative(columns: np.ndarray, y: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit y by a sum of columns with non-negative coefficients; return these, and these times the norms of ``root * column``.

    `root` holds the square roots of the weights of the rows in the least-squares fit.
    """
    columns = root[:, None] * columns
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0  # data of the undeformed state have no stress
    shares = nnls(columns / size, root * y)[0]
    return shares / size, shares


def parted(terms: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray, dict]:
    """Split terms: return exponents of stretches, their entries in `weights`, and a dictionary of the others by (invariant, power)."""
    plain = terms[:, 0] == 0
    invariants = {(int(which), int(power)): float(weight) for (which, power), weight in zip(terms[~plain], weights[~plain], strict=True)}
    return terms[plain, 1], weights[plain], invariants


def _first_as_good(choices: list[tuple]) -> tuple:
    """Return the first pair (terms, error) of `choices`, ordered by size, whose error exceeds the least by at most 5 % (`AS_GOOD`)."""
    most = (1 + AS_GOOD) * min(error for _, error in choices) + 1e-9
    return next(choice for choice in choices if choice[1] <= most)


def _name_of(term) -> str:
    """Return the name in reports of the weight of an energy term, a row of `terms_of`."""
    which, power = term
    return f"weight of {('exponent', 'I1bar - 3 to the power', 'I2bar^1.5 - 3 sqrt 3 to the power')[int(which)]} {power:g}"


def stiffness_of(terms: np.ndarray, weights: np.ndarray) -> float:
    """Return the shear modulus of an energy when undeformed; of the powers of invariants only the first of I2bar^1.5 - 3 sqrt 3 counts."""
    return float(weights[terms[:, 0] == 0].sum() / 2 + SECOND_AT_REST * weights[(terms == (2, 1)).all(axis=1)].sum())


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


def dictionary(greatest: float, least: float, offset: float = 0.0) -> np.ndarray:
    """Return candidate exponents as an array, from -`least` to -1 and from 1 to `greatest`, with `offset` added to absolute values."""
    sizes = np.arange(LEAST_EXPONENT, max(greatest, least) + STEP / 2, STEP)
    return np.concatenate([-sizes[sizes <= least][::-1] - offset, sizes[sizes <= greatest] + offset])


def terms_of(exponents, invariants=()) -> np.ndarray:
    """Return energy terms, one for each of `exponents`, then the pairs `invariants`, as rows of two numbers, shape (n_terms, 2).

    A row is (0, exponent of the stretches), (1, power of I1bar - 3) or (2, power of I2bar^1.5 - 3 sqrt 3).
    """
    return np.array([*((0.0, exponent) for exponent in exponents), *invariants])


def columns_of(stretches: np.ndarray, first: np.ndarray, terms) -> np.ndarray:
    """Return the nominal stress along the first stretch of each energy term with unit weight, shape (n_samples, n_terms).

    `stretches` are the isochoric principal stretches, shape (n_samples, 3), with the stress-free thickness last; `first` are the full
    stretches along the stress, which include the change of volume. `terms` are rows of `terms_of`.
    """
    (which, powers), squares = terms.T, stretches**2
    (along, _, across), I1, I2 = squares.T[:, :, None], squares.sum(axis=1)[:, None], (1 / squares).sum(axis=1)[:, None]
    # The measures of the invariants of which terms are powers, and their slopes along the first stretch.
    measures = {1: (I1 - 3, 2 * (along - across)), 2: (I2**1.5 - SECOND_AT_REST, 3 * np.sqrt(I2) * (1 / across - 1 / along))}
    columns = (stretches[:, :1] ** powers - stretches[:, 2:] ** powers) / powers
    for kind, (measure, slope) in measures.items():
        columns[:, which == kind] = powers[which == kind] * measure ** (powers[which == kind] - 1) * slope
    return columns / first[:, None]


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
