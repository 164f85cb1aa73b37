"""How sure an identification is: the same regressor fitted to many drawings from the test data."""

from __future__ import annotations

import numpy as np
from joblib import Parallel, delayed
from sklearn.base import clone


def committee(
    regressor, X, y, n_members: int = 8, tests=None, random_state: int = 0, n_jobs: int = 1, sample_weight: np.ndarray | None = None
) -> list:
    """Clones of a regressor, each fitted to test data drawn with replacement (bootstrap).

    What is asked of the members, a stress or the result of a run with the ``law_`` of each, differs among them by as much as the data leave
    open; what all of them have wrong, such as a law that rubber does not follow, it does not show.

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
        Of every row, however often it is drawn.

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
    Efron, Ann. Statist. 7 (1979) 1.

    Examples
    --------
    >>> import pdsurrogate as pd
    >>> data = pd.load_test_data("treloar").up_to(3.0)
    >>> members = pd.committee(pd.EnergyRegressor(), data.stretches, data.nominal_stress, n_members=2)
    >>> len(members)
    2
    """
    X, y = np.asarray(X, dtype=float), np.asarray(y, dtype=float)
    if n_members < 2:
        raise ValueError(f"a committee has at least two members, not {n_members}")
    tests = np.arange(len(y)) if tests is None else np.asarray(tests)
    kinds = np.unique(tests)
    if len(kinds) < 2:
        raise ValueError("a committee is drawn from at least two tests; there is one")
    random, members = np.random.default_rng(random_state), []
    for _ in range(n_members):
        drawn = np.concatenate([np.flatnonzero(tests == kind) for kind in random.choice(kinds, len(kinds))])
        members.append(drawn)
    weights = [None if sample_weight is None else np.asarray(sample_weight)[drawn] for drawn in members]
    rows = zip(members, weights, strict=True)
    return Parallel(n_jobs)(delayed(_fitted)(clone(regressor), X[drawn], y[drawn], weight) for drawn, weight in rows)


def _fitted(regressor, X, y, sample_weight):
    return regressor.fit(X, y, sample_weight)
