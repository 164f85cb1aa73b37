"""Starts of fits of branches and softening, from stresses that are linear in most parameters."""

from itertools import product
from typing import NamedTuple

import numpy as np

from ..materials import Softening
from .averaging import nonnegative
from .branch_search import Curves
from .elastic_part import Elastic
from .energy import NEGLIGIBLE

UNLOADED = 0.1
"""Least fall of I1bar - 3 below its greatest value, as a share of this value, in unloading."""

SPREAD = 1.5
"""Least ratio of the greatest values of I1bar - 3 from which curves unload that tells beta from m:
both are in m + beta W_max alone.
"""

STARTS = {"r": (1.2, 2.0, 5.0), "width": (0.03, 0.1, 0.3, 1.0), "share": (0.0, 0.5, 0.9)}
"""Softening from which a search starts: r, the greatest m + beta W_max in units of the greatest
energy W_max, and the share of beta.
"""


class Problem(NamedTuple):
    """Stresses to which elastic energies are fitted, with branches and softening.

    Attributes
    ----------
    elastic : Elastic
    curves : Curves
    y : ndarray, shape (n,)
    root : ndarray, shape (n,)
        Roots of the weights of rows.
    softening : tuple of str
        Parameters of softening that are fitted; none without softening.
    """

    elastic: Elastic
    curves: Curves
    y: np.ndarray
    root: np.ndarray
    softening: tuple[str, ...]

    def solved(self, columns: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the sizes of columns, none negative, that describe the stresses best, and the
        error.
        """
        sizes = nonnegative(columns, self.y, self.root)
        return sizes, float(np.linalg.norm(self.root * (columns @ sizes - self.y)))


class Start(NamedTuple):
    """Start of a fit.

    Attributes
    ----------
    shape : ndarray, shape (n_shape,)
    softening : ndarray, shape (n_softening,)
    columns : ndarray, shape (n, n_linear)
        Softened elastic stresses of unit parameters.
    """

    shape: np.ndarray
    softening: np.ndarray
    columns: np.ndarray


def parameters_of_softening(curves: Curves) -> tuple[str, ...]:
    """Return the parameters of softening that curves determine; raise ValueError for curves that
    do not unload.
    """
    strain = curves.strain
    peak = curves.peak(strain)
    unloaded = peak[strain < (1 - UNLOADED) * peak]
    if len(unloaded) <= len(STARTS):
        raise ValueError(
            "softening is seen in unloading and in loading again only, but no curve unloads: add"
            " whole cycles"
        )
    return ("r", "m", "beta") if unloaded.max() > SPREAD * unloaded.min() else ("r", "m")


def start_of(law: str, problem: Problem, relaxing: np.ndarray) -> Start:
    """Return the shape and the softening with which a law and all branches, `relaxing`, describe
    the stresses best.

    The shape is that of first loading, which is not softened, if there is softening.
    """
    elastic, curves, keys, root = problem.elastic, problem.curves, problem.softening, problem.root
    first = problem
    if keys:
        strain = curves.strain
        first = problem._replace(root=root * (strain >= curves.peak(strain)))
    best, least = None, np.inf
    for shape in elastic.shapes:
        try:
            table = np.column_stack([elastic.columns(shape), relaxing])
        except ValueError:  # parameters between the bounds that are not those of a law
            continue
        if not np.isfinite(table).all():
            continue
        sizes, error = first.solved(table)
        if error < least:
            best, least = (np.array(shape), sizes[: elastic.linear]), error
    if best is None:
        raise ValueError(f"{law} cannot be fitted: it does not reach the stretches")
    shape, sizes = best
    own = elastic.columns(shape)
    if not keys or not sizes.any():
        return Start(shape, np.empty(0), own)
    # No law has a term of size zero.
    sizes = np.maximum(sizes, NEGLIGIBLE * sizes.max())
    energy = curves.energy(elastic.law(np.r_[sizes, shape]))
    found, least = own, np.inf
    for r, width, share in product(*STARTS.values()):
        if share and "beta" not in keys:
            continue
        values = {"r": r, "m": (1 - share) * width * energy.max(), "beta": share * width}
        columns = curves.softened(Softening(**values), energy)[:, None] * own
        error = problem.solved(np.column_stack([columns, relaxing]))[1]
        if error < least:
            found, least = columns, error
            softening = np.array([values[key] for key in keys])
    return Start(shape, softening, found)
