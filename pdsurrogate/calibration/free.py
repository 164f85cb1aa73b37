"""Energy without a law for calibrations: a sum of few terms, whose coefficients, of which none
is negative, are the unknowns.
"""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
from scipy.spatial import cKDTree

from ..identification.averaging import nonnegative
from ..materials import Law
from ..materials.dictionary import OF_INVARIANTS, Term
from ..materials.polyconvex import law_of, stiffness_of

FLOOR = 3e-6
"""Least coefficient in the search, relative to the greatest: differences over a millionth of the
greatest do not make it negative.
"""

HALVINGS = 6
"""Most halvings of a step that does not reduce the residuals."""


@dataclass(frozen=True)
class EnergyUnknowns:
    """Terms of an energy, whose coefficients are the unknowns of a calibration.

    Attributes
    ----------
    bulk_ratio, bulk_modulus : float or None
        Of these, one is given.
    terms : tuple of Term
    """

    bulk_ratio: float | None = None
    bulk_modulus: float | None = None
    terms: tuple[Term, ...] = OF_INVARIANTS

    def of(self, kept: np.ndarray) -> "EnergyUnknowns":
        """Return the unknowns of some of the terms, given by a mask."""
        return replace(
            self, terms=tuple(term for term, one in zip(self.terms, kept, strict=True) if one)
        )

    def unknowns(self) -> list[str]:
        """Return the names of the coefficients."""
        return [f"weight of {term}" for term in self.terms]

    def law_of(self, values: np.ndarray) -> Law:
        """Return the law with given coefficients."""
        return law_of(
            self.terms,
            values,
            self.bulk_modulus or (self.bulk_ratio or 1.0) * stiffness_of(self.terms, values),
        )

    def start(self) -> np.ndarray:
        """Return the coefficients of a law with the shear modulus 1 near the Neo-Hookean one, none
        below its least value.
        """
        return floored(np.array([2.0 * (term == ("stretches", 2.0)) for term in self.terms]))


def floored(values: np.ndarray) -> np.ndarray:
    """Return coefficients that are at least `FLOOR` of the greatest."""
    return np.maximum(values, FLOOR * values.max())


def solved(jacobian: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the least-squares solution of J x = right without negative numbers, after an
    orthogonal reduction to a square matrix.
    """
    q, r = np.linalg.qr(jacobian)
    return nonnegative(r, q.T @ right, np.ones(len(r)))


def scaled(
    jacobian: np.ndarray, right: np.ndarray, forces: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the equations of the weak form with one more, which fits the sum of the measured
    forces, chosen by a mask.

    Without it an energy of almost zero would fit best where the simulation has errors, since its
    forces are in balance in every field.
    """
    if not forces.any():
        return jacobian, right
    row = np.append(right[forces] @ jacobian[forces], right[forces] @ right[forces])
    # A norm a hundred times that of all other equations: the sum is then fitted to 1e-4.
    row *= 100.0 * np.linalg.norm(jacobian) / np.linalg.norm(row[:-1])
    return np.vstack([jacobian, row[:-1]]), np.append(right, row[-1])


def minimized(search, x: np.ndarray, close: float, most: int) -> SimpleNamespace:
    """Minimize the residuals of a search over coefficients, none negative, by at most `most`
    Gauss-Newton steps.

    The search ends when a step reduces the sum of squares by a smaller share than `close`. Return
    the coefficients ``x``, of which none is less than `FLOOR` of the greatest, and the Jacobian
    ``jac``, as `scipy.optimize.least_squares` does.
    """
    x = floored(x)
    cost = (search.residuals(x) ** 2).sum()
    for _ in range(most):
        jacobian = search.jacobian(x)
        target = solved(jacobian, jacobian @ x - search.residuals(x))
        for halving in range(HALVINGS):
            new = floored(x + (target - x) / 2**halving)
            reached = (search.residuals(new) ** 2).sum()
            if reached < cost:
                break
        else:
            break
        before = cost
        cost = reached
        x = new
        if cost > (1 - close) * before:
            break
    return SimpleNamespace(x=x, jac=jacobian if most == 1 else search.jacobian(x))


def grouping(residuals: np.ndarray, places: np.ndarray, component: np.ndarray) -> tuple[float, int]:
    """Return the sum over groups of the squared sums of residuals of displacements, and the sum of
    the numbers of residuals in the groups.

    A group consists of the residuals of all steps, of one component, at a place and its `GROUP` - 1
    nearest. The quotient of both sums, divided by the mean square, is 1 for independent residuals.
    For residuals with smooth sources, such as the discretization error, it is about the number of
    residuals that contain as much information as one independent residual.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
    places : ndarray, shape (n, d)
    component : ndarray of int, shape (n,)
    """
    total = 0.0
    count = 0
    for axis in np.unique(component):
        here = component == axis
        where, at = np.unique(places[here], axis=0, return_inverse=True)
        # Enough neighbors to show whether residuals of all steps are independent.
        near = cKDTree(where).query(where, min(13, len(where)))[1].reshape(len(where), -1)
        sums = np.bincount(at.ravel(), residuals[here], len(where))[near].sum(axis=1)
        total += float((sums**2).sum())
        count += int(np.bincount(at.ravel(), minlength=len(where))[near].sum())
    return total, count
