"""Uncertainty of an identification: a regressor is fitted to many random halves of the test data."""

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

    A stress, or the result of a run with the ``law_`` of each member, varies among the members as far as the data leave it open. The root
    mean square of the differences from the fit to all data estimates the standard deviation of the result (the delete-half jackknife);
    `committee_spread` corrects it for few members. The bootstrap, which draws with replacement, is not consistent for parameters at a
    bound, such as weights at zero. For an `EnergyRegressor` the offset of the exponents is drawn for each member as well: it is arbitrary,
    and decides on which side of the data a fit is off. The members do not show errors that all of them share, such as those of a law that
    rubber does not follow.

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
        Number or name of the test of each row: rows of a test are drawn together. By default each row is a test.
    random_state : int
        Seed.
    n_jobs : int
        Number of jobs of joblib.
    sample_weight : ndarray, shape (n_samples,), optional
        Weights: the inverse of the variance of each stress, if known; ``1 / y**2`` for stresses with the same relative error.

    Returns
    -------
    list of estimator
        Fitted members.

    Raises
    ------
    ValueError
        If there are fewer than two members, or fewer than two tests.

    References
    ----------
    Shao, Wu, Ann. Statist. 17 (1989) 1176; Andrews, Econometrica 68 (2000) 399.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> data = pds.load_test_data("treloar").up_to(3.0)
    >>> members = pds.identification.committee(pds.identification.EnergyRegressor(), data.stretches, data.nominal_stress, n_members=2)
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
        members.append(delayed(regressor.redrawn(random).fit)(X[drawn], y[drawn], weight))
    return Parallel(n_jobs)(members)


def committee_spread(found: ArrayLike, members: ArrayLike) -> np.ndarray:
    """Return the spread of a result over the members; twice the spread covers 95 % of normal deviations for any number of members.

    Parameters
    ----------
    found : array-like
        Result of the fit to all data, of any shape.
    members : array-like, shape (n_members, ...)
        Results of the members.

    Returns
    -------
    ndarray
        Root mean square of the differences, times the ratio of the quantiles of Student's distribution with ``n_members`` degrees of
        freedom and of the normal distribution at two standard deviations: 1.18 for eight members, 1.08 for sixteen.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> float(pds.identification.committee_spread(1.0, [0.9, 1.1, 0.9, 1.1, 0.9, 1.1, 0.9, 1.1])).__round__(3)
    0.118
    """
    members = np.asarray(members, dtype=float)
    rms = np.sqrt(((members - np.asarray(found, dtype=float)) ** 2).mean(axis=0))
    return rms * t.ppf(norm.cdf(2.0), len(members)) / 2.0
