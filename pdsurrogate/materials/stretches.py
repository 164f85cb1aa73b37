"""Principal stretches of deformation gradients in two and three dimensions."""

from __future__ import annotations

import numpy as np


def principal_stretches(F: np.ndarray) -> np.ndarray:
    """Return the principal stretches, the square roots of the eigenvalues of F^T F, the greatest first.

    Parameters
    ----------
    F : ndarray, shape (n, 2, 2) or (n, 3, 3)

    Returns
    -------
    ndarray, shape (n, 2) or (n, 3)

    Examples
    --------
    >>> principal_stretches(np.array([[[2.0, 0.0], [0.0, 0.5]]])).tolist()
    [[2.0, 0.5]]
    """
    if F.shape[-1] == 3:
        return np.linalg.svd(F, compute_uv=False)
    # A plane F is the sum of a turned stretch and a reflected one, of sizes p and q: p + q and |p - q| are its stretches.
    p = np.hypot(F[:, 0, 0] + F[:, 1, 1], F[:, 1, 0] - F[:, 0, 1]) / 2
    q = np.hypot(F[:, 0, 0] - F[:, 1, 1], F[:, 1, 0] + F[:, 0, 1]) / 2
    return np.stack([p + q, np.abs(p - q)], axis=1)
