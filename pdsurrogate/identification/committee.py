"""Uncertainty of an identification: one regressor fitted to many random halves of the test data."""

from __future__ import annotations

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import ArrayLike
from scipy.stats import norm, t
from sklearn.utils import check_X_y

from ..arguments import check_estimator, check_jobs, check_seed, check_whole_number, in_order, kind_of
from .stress_regressor import StressRegressor


def committee(
    regressor, X, y, n_members: int = 8, tests=None, random_state: int = 0, n_jobs: int = 1, sample_weight: np.ndarray | None = None
) -> list:
    """Return copies of a regressor, each fitted to a random half of the tests; settings that the data leave open are drawn as well.

    What is asked of the members, a stress or the result of a run with the ``law_`` of each, differs from that of the fit to all data by as
    much as the data leave open: the root mean square of the differences is an estimate of its standard deviation (the delete-half
    jackknife), which `committee_spread` corrects for few members.  Drawing with replacement, the bootstrap, is not consistent where
    parameters end at a bound, as weights at zero do.  An `EnergyRegressor` has its exponents drawn for every member as well (`redrawn`):
    which of them a fit can fall upon is no more than a choice, and decides on which side of the data it is off.  What all members have
    wrong, such as a law that rubber does not follow, they do not show.

    Parameters
    ----------
    regressor : estimator
        `LawRegressor` or `EnergyRegressor`.
    X : ndarray, shape (n_samples, 2)
        Stretches.
    y : ndarray, shape (n_samples,)
        Nominal stresses.
    n_members : int
    tests : ndarray, shape (n_samples,), optional
        Which test a row is of: rows of one are drawn together.  By default every row is a test.
    random_state : int
        Seed.
    n_jobs : int
        Of joblib.
    sample_weight : ndarray, shape (n_samples,), optional
        Of every row: one over the variance of its stress, as far as that is known; ``1 / y**2`` of stresses that are all measured to
        the same share.

    Returns
    -------
    list of estimator
        Fitted.

    Raises
    ------
    ValueError
        If there are fewer than two members, or tests.

    References
    ----------
    Shao, Wu, Ann. Statist. 17 (1989) 1176; Andrews, Econometrica 68 (2000) 399.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> data = pds.load_test_data("treloar").up_to(3.0)
    >>> members = pds.committee(pds.EnergyRegressor(), data.stretches, data.nominal_stress, n_members=2)
    >>> len(members)
    2
    """
    check_estimator(regressor, "regressor")
    if not isinstance(regressor, StressRegressor):
        raise TypeError(f"regressor must be a LawRegressor or an EnergyRegressor, not {kind_of(regressor)}")
    check_whole_number(n_members, "n_members", 2)
    check_seed(random_state)
    check_jobs(n_jobs)
    X, y = check_X_y(in_order(X, regressor.columns, "X"), y)
    tests = np.arange(len(y)) if tests is None else np.asarray(tests)
    for what, rows in (("tests", tests), ("sample_weight", sample_weight)):
        if rows is not None and np.shape(rows) != y.shape:
            raise ValueError(f"{what} must have one entry for each of the {len(y)} rows, not shape {np.shape(rows)}")
    kinds = np.unique(tests)
    if len(kinds) < 2:
        raise ValueError("a committee is drawn from at least two tests; there is one")
    random, members = np.random.default_rng(random_state), []
    for _ in range(n_members):
        drawn = np.concatenate([np.flatnonzero(tests == kind) for kind in random.choice(kinds, -(-len(kinds) // 2), replace=False)])
        weight = None if sample_weight is None else np.asarray(sample_weight)[drawn]
        members.append(delayed(_fitted)(regressor.redrawn(random), X[drawn], y[drawn], weight))
    return Parallel(n_jobs)(members)


def committee_spread(found: ArrayLike, members: ArrayLike) -> np.ndarray:
    """Return the spread of a result over the members: twice the spread holds 95 % of normal deviations for any number of members.

    Parameters
    ----------
    found : array-like
        Result of the fit to all data, of any shape.
    members : array-like, shape (n_members, ...)
        Those of the members.

    Returns
    -------
    ndarray
        Root mean square of the differences, times the quantile of Student's distribution of ``n_members`` degrees of freedom over that of
        the normal one, at two standard deviations: 1.18 for eight members, 1.08 for sixteen.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> float(pds.committee_spread(1.0, [0.9, 1.1, 0.9, 1.1, 0.9, 1.1, 0.9, 1.1])).__round__(3)
    0.118
    """
    members = np.asarray(members, dtype=float)
    rms = np.sqrt(((members - np.asarray(found, dtype=float)) ** 2).mean(axis=0))
    return rms * t.ppf(norm.cdf(2.0), len(members)) / 2.0


def _fitted(regressor, X, y, sample_weight):
    return regressor.fit(X, y, sample_weight)
