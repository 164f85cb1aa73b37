"""Energy from test data without the choice of a law: an average of sums of few terms with
non-negative weights.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import check_is_fitted

from ..arguments import in_order
from ..materials import Law
from ..materials.dictionary import OF_TESTS, STABLE_TO, Term, wave_margin
from ..materials.polyconvex import law_of, stiffness_of
from .averaging import Average, average, columns_of, isochoric
from .data import BIAXIAL, MODES
from .stress_regressor import BULK_CONSTRAINTS, BULK_RATIO, StressRegressor, states

NEGLIGIBLE = 1e-7
"""Relative RMS error of stresses below which energies count as equally good, and share of the
stresses below which a term is left out: no test is as exact.
"""

SAME_MODE = 0.01
"""Greatest difference in log-stretch between the lateral stretch of a state and that of a mode of
loading at which the state counts as one of this mode. Chosen: modes differ by more from strains of
a few percent on.
"""


@dataclass(eq=False, repr=False)
class EnergyRegressor(StressRegressor):
    """Isochoric energy fitted to nominal stresses, without a law.

    W is an average of energies, each a sum of few terms with non-negative weights: of at most four
    among l1 + l2 + l3 - 3 and functions of I1bar (its root, and powers of I1bar - 3 up to the
    fourth), and at most one function of I2bar (its logarithm, its root, I2bar - 3). The weight of
    an energy in the average is a prior times the likelihood of the stresses, theory (87): of
    energies that describe the stresses equally well, those with fewer terms and with smaller
    stresses in equibiaxial tension are the more probable. All rows of a mode of loading count as
    one independent measurement, as errors of a specimen are common to them, and so does each
    biaxial state. No term is chosen, so that the stresses are continuous functions of the data.
    Energy and stress always vanish in the undeformed state, W grows without bound, and shear waves
    are stable in states with stretches up to 3, or up to those of the data if these are greater.
    Beyond the data W continues as these terms.

    In states of constant volume the stresses are linear in the weights, so that the weights of
    given terms are a non-negative least-squares fit, without a start or random choices. Volume
    ratios, which depend on the bulk modulus, and weights are found alternately.

    Parameters
    ----------
    margin : float, default=0.05
        Extension of the hull of the data, in log-stretch, within which the energy holds; a larger
        one includes states without data.
    bulk_ratio : float, default=1000
        K/mu of the law, which such tests do not determine, see `LawRegressor`.
    bulk_modulus : float, optional
        K instead of K/mu, in the unit of the stresses.

    Attributes
    ----------
    law_ : Ogden or Polyconvex
        Energy as a law for every force model; the latter if it has other terms than powers of
        stretches.
    terms_ : list of Term
        Terms of the energy: pairs of a kind and a number (`pdsurrogate.materials.dictionary.Term`).
    weights_ : ndarray, shape (n_terms,)
        Their weights, in the unit of the stresses.
    parameter_names_, parameters_, covariance_, standard_errors_, at_bound_
        Weights with their covariance and standard errors, for given volume ratios: those within the
        energies, and those among them.
    hull_ : ndarray, shape (n, 3)
        Half-planes (n1, n2, -d) of the convex hull of the data and the undeformed state: n . x <=
        d, where x are the logarithms of the greatest and of the middle one of the three stretches
        of a state, whose directions do not matter to an isotropic energy.
    stretch_range_ : tuple of float
        Least and greatest stretch of the data.
    n_features_in_ : int

    References
    ----------
    Hoeting, Madigan, Raftery, Volinsky, Stat. Sci. 14 (1999) 382, for averages of models; Hartmann,
    Neff, Int. J. Solids Struct. 40 (2003) 2767; Carroll, J. Elast. 103 (2011) 173; Gent, Thomas, J.
    Polym. Sci. 28 (1958) 625; Varga, Stress-strain behavior of elastic materials (1966), for the
    terms.

    See Also
    --------
    pdsurrogate.identification.LawRegressor : fits the parameters of a law.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> data = pds.load_test_data("treloar").up_to(3.0)
    >>> found = pds.identification.EnergyRegressor().fit(data.stretches, data.nominal_stress)
    >>> bool(found.score(data.stretches, data.nominal_stress) > 0.99)
    True
    """

    _parameter_constraints: ClassVar = {
        "margin": [Interval(Real, 0, 1, closed="both")],
        **BULK_CONSTRAINTS,
    }

    law: ClassVar[str] = "energy"
    """Name of the model in reports, where a `LawRegressor` has the name of its law."""

    margin: float = 0.05
    bulk_ratio: float = BULK_RATIO
    bulk_modulus: float | None = None

    def fit(self, X, y, sample_weight=None):
        """Fit the weights of the energy terms to nominal stresses.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2)
            Stretches along the stress and across it; a table (pandas) has the columns ``stretch``
            and ``lateral_stretch`` in any order.
        y : array-like, shape (n_samples,)
            Nominal stresses.
        sample_weight : array-like, shape (n_samples,), optional

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If X has other columns, or a stretch is not positive.

        Warns
        -----
        UserWarning
            If the stresses do not rise with the stretch, or the data are of one state or one mode
            of loading and so leave the energy undetermined.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> data = pds.load_test_data("treloar").up_to(3.0)
        >>> found = pds.identification.EnergyRegressor().fit(data.stretches, data.nominal_stress)
        >>> str(found.terms_[0])
        'root of I1bar'
        """
        terms = OF_TESTS
        X, y, root = self._used(X, y, sample_weight)
        warn_of_few_modes(X)
        margin = wave_margin(terms, max(STABLE_TO, X.max(), 1 / X.min()))
        volume = np.ones_like(y)
        right = root * y
        count = independent(X)
        # Rounds of the weights at given volume ratios, and of the volume ratios that follow from
        # them. At the bulk moduli of rubber a few suffice; sixty end one that does not converge.
        for _ in range(60):
            columns = root[:, None] * columns_of(isochoric(X, volume), X[:, 0], terms)
            try:
                found = average(
                    terms,
                    columns,
                    right,
                    lambda least: (least + NEGLIGIBLE**2 * right @ right) / count,
                    margin,
                )
            except ValueError:
                warnings.warn(
                    "the stresses do not rise with the stretch as in rubber; the fitted energy is"
                    " almost zero",
                    stacklevel=2,
                )
                linear = np.array([term == ("stretches", 2.0) for term in terms])
                least = 1e-6 * max(np.abs(y).max(), 1e-300) * linear
                found = Average(
                    least, np.full((len(terms), len(terms)), np.inf), np.empty((0, len(terms)))
                )
            before = volume
            reached = states(self._law(terms, found.mean), X)[1]
            volume = np.where(np.isfinite(reached), reached, volume)
            if np.abs(volume - before).max() < 1e-9:
                break
        shares = np.linalg.norm(columns, axis=0) * found.mean
        kept = shares > NEGLIGIBLE * shares.max()
        self.terms_ = [term for term, one in zip(terms, kept, strict=True) if one]
        self.weights_ = found.mean[kept]
        self._store(
            self._law(self.terms_, self.weights_),
            [f"weight of {term}" for term in self.terms_],
            self.weights_,
            found.covariance[np.ix_(kept, kept)],
        )
        self.stretch_range_ = float(X.min()), float(X.max())
        self.hull_ = half_planes(X)
        return self

    def standard_deviations(self, X) -> np.ndarray:
        """Return standard deviations of the stresses of the energy, which contain what the data
        leave open in states without measurements.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2)
            Stretches along the stress and across it, as for `fit`.

        Returns
        -------
        ndarray, shape (n_samples,)
            In the unit of the stresses: of the energies in the average and of their weights, theory
            (87), to first order.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> data = pds.load_test_data("treloar").of("uniaxial", "pure-shear")
        >>> found = pds.identification.EnergyRegressor().fit(data.stretches, data.nominal_stress)
        >>> uniaxial, equibiaxial = found.standard_deviations([[2.0, 2.0**-0.5], [2.0, 2.0]])
        >>> bool(equibiaxial > 2 * uniaxial)
        True
        """
        check_is_fitted(self)
        X = self._stretches(np.asarray(in_order(X, self.columns, "X"), dtype=float))
        columns = columns_of(isochoric(X, states(self.law_, X)[1]), X[:, 0], self.terms_)
        return np.sqrt(
            np.maximum(np.einsum("ij,jk,ik->i", columns, self.covariance_, columns), 0.0)
        )

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
            raise ValueError(
                f"values must have one weight for each of the {len(self.terms_)} terms, not the"
                f" shape {np.shape(values)}"
            )
        return self._law(self.terms_, np.asarray(values, dtype=float))

    def _law(self, terms: Sequence[Term], weights: np.ndarray) -> Law:
        return law_of(terms, weights, self._bulk(stiffness_of(terms, weights)))

    def beyond(self, X) -> np.ndarray:
        """Return how far states lie outside the domain of the energy: the convex hull of the data,
        extended by `margin`.

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
        logs = ordered_logs(
            self._stretches(np.asarray(in_order(X, self.columns, "X"), dtype=float))
        )
        return (logs @ self.hull_[:, :2].T + self.hull_[:, 2]).max(axis=1) - self.margin

    def domain_hull(self) -> list[list[float]]:
        """Return the half-planes that bound the domain of the fitted energy.

        They are the sides of the convex hull of the test data in logarithmic stretches, moved
        outwards by ``margin``.

        Returns
        -------
        list of list of float
            Half-planes (n1, n2, d), as in ``hull`` of `pdsurrogate.forces.domain.Domain`.

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


def ordered_logs(X: np.ndarray) -> np.ndarray:
    """Return the logarithms of the greatest and of the middle principal stretch of
    incompressible states X, shape (n, 2).
    """
    logs = np.log(X)
    return -np.sort(-np.column_stack([logs, -logs.sum(axis=1)]), axis=1)[:, :2]


def warn_of_few_modes(X: np.ndarray) -> None:
    """Warn of data of one state or one mode of loading, which leave most of an energy
    undetermined.
    """
    logs = ordered_logs(X)
    states = np.unique(logs[np.abs(logs).max(axis=1) > SAME_MODE].round(3), axis=0)
    if len(states) <= 1:
        warnings.warn(
            "the data contain a single state, which determines only a shear modulus; add other"
            " stretches and modes",
            stacklevel=3,
        )
    elif np.abs(logs @ line_through_rest(logs)[0]).max() < SAME_MODE:
        mode = str(mode_of(X)[np.abs(logs).max(axis=1).argmax()])
        warnings.warn(
            f"the data contain a single mode of loading ({mode}), which determines neither the"
            " stresses in other modes nor the share of the second invariant; add another mode,"
            " such as pure shear or equibiaxial tension",
            stacklevel=3,
        )


def half_planes(X: np.ndarray) -> np.ndarray:
    """Return the half-planes (`EnergyRegressor.hull_`) of the convex hull of states X and the
    undeformed state.

    The hull is a line segment if all states are of one mode of loading.
    """
    logs = ordered_logs(X)
    off, along = line_through_rest(logs)
    if np.abs(logs @ off).max() < SAME_MODE:
        reach = np.append(logs @ along, 0.0)
        thick = np.abs(logs @ off).max()
        return np.array(
            [[*off, -thick], [*-off, -thick], [*along, -reach.max()], [*-along, reach.min()]]
        )
    return ConvexHull(np.vstack([logs, np.zeros(2)])).equations


def line_through_rest(logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return unit vectors across and along the line through the origin, the undeformed state,
    that fits log-stretches, (n, 2), best.
    """
    along, off = np.linalg.svd(np.vstack([logs, np.zeros((2, 2))]), full_matrices=False)[2]
    return off, along


def mode_of(X: np.ndarray) -> np.ndarray:
    """Return for each row the name of its mode of loading, or `BIAXIAL` for a state of none of
    `MODES`.
    """
    first, second = X.T
    same = np.array(
        [np.abs(np.log(second / lateral(first))) < SAME_MODE for lateral in MODES.values()]
    )
    return np.where(same.any(axis=0), np.array(list(MODES))[same.argmax(axis=0)], BIAXIAL)


def independent(X: np.ndarray) -> int:
    """Return the number of independent measurements in states X: all states of a mode of loading
    are one, each biaxial state is one.
    """
    logs = ordered_logs(X)
    modes = mode_of(X)
    strained = np.abs(logs).max(axis=1) > SAME_MODE
    biaxial = modes == BIAXIAL
    return max(
        1,
        len(np.unique(modes[strained & ~biaxial]))
        + len(np.unique(logs[strained & biaxial].round(9), axis=0)),
    )
