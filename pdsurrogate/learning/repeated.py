"""Samples that are given more than once, as samples of as much weight."""

from __future__ import annotations

import numpy as np


def distinct_samples(X, y, weights=None) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return which samples to keep so that none repeats and none has weight 0, and their weights.

    Copies of a sample and a sample of as much weight give the same training data.  Both results are None where nothing repeats and all
    weights are 1; elsewhere the samples kept are sorted, and the weights are None where all are 1.

    Parameters
    ----------
    X : ndarray, shape (n, n_features)
    y : ndarray, shape (n,) or (n, n_outputs)
    weights : ndarray, shape (n,), optional
        At least 0.

    Raises
    ------
    ValueError
        If all weights are 0.
    """
    _, first, inverse = np.unique(np.column_stack([X, y]), axis=0, return_index=True, return_inverse=True)
    if len(first) == len(X) and (weights is None or (weights == 1).all()):
        return None, None
    summed = np.bincount(inverse.ravel(), weights, len(first)).astype(float)
    if not summed.any():
        raise ValueError("all sample weights are zero")
    kept, summed = first[summed > 0], summed[summed > 0]
    return kept, None if (summed == 1).all() else summed
