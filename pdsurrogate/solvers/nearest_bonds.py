"""Stiffness of the nearest bonds of a body, for preconditioners and first guesses: its matrix and the inverse."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np
from scipy import sparse

from ..body import Body
from ..body.body import sums_at_points
from ..ranks import Share
from .multigrid import Multigrid, factor_of

REACH = 1.3
"""Greatest length, in spacings, of the bonds in the matrix: four bonds per point on a grid, and those of points off the grid.

With the diagonals the factor has four times the entries and costs four times as much, for a tenth fewer steps.
"""

ELONGATION = 6.0
"""Stiffness of a spring along its bond, in units of mu w V_i V_j/kappa."""

SHEAR_SHARE = 1 / 3
"""Stiffness of a spring across its bond over that along it; the true tangent has both."""

SHIFT = 1e-6
"""Share of the mean diagonal that is added to the diagonal, so that the matrices of bodies that can drift have a factor too."""

MOST_FACTORISED = {2: 300_000, 3: 5_000}
"""Greatest number of points for which a Laplacian is factorised, by dimension. A multigrid cycle replaces larger factors, which fill in."""

RAISED = 4 / 3
"""Factor of the Laplacian that approximates the tangent of a nearly incompressible body, relative to that of rubber at rest.

Stretch and pressure stiffen the tangent. Of 1, 1.25, 1.5 and 2 (bonded blocks of 12 to 20 points a side, K = 100 mu and 1000 mu) the
middle two need a fifth to a quarter fewer evaluations than 1, and 2 no fewer.
"""


class Preconditioner(ABC):
    """Approximation of the tangent whose linear systems are cheap to solve."""

    def update(self) -> None:  # noqa: B027 - most preconditioners are the same in all states
        """Adapt the preconditioner to the state in which the force was last evaluated."""

    @abstractmethod
    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements under forces, shape (n, d)."""


class NearestBonds:
    """Nearest bonds of a body, with stiffnesses scaled so that these bonds have the second moment of all bonds.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
        Shear modulus of all points, or around each.
    factor : float
        Stiffness of a bond in units of mu w V_i V_j/kappa, before it is raised.

    Attributes
    ----------
    first, second : ndarray of int, shape (k,)
        Ends of the bonds; `second` may be a ghost.
    within : ndarray of bool, shape (k,)
        Whether `second` is a point.
    sources : ndarray of int, shape (k,)
        Point at `second`, or the point of which `second` is an image.
    stiffness : ndarray, shape (k,)
    along : ndarray, shape (k, d)
        Unit vectors from `first` to `second`.
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, factor: float = 1.0) -> None:
        bonds, points, share = body.bonds, body.all_points, body.share
        vector = points[bonds.second] - points[bonds.first]
        length = np.linalg.norm(vector, axis=1)
        volumes = body.all_volumes[bonds.first] * body.all_volumes[bonds.second]
        if isinstance(shear_moduli, np.ndarray):
            ends = np.concatenate([shear_moduli, shear_moduli[body.ghosts.source]])
            # Two springs in series, computed with inverses, since the product of two moduli may overflow.
            shear_moduli = 2 / (1 / ends[bonds.first] + 1 / ends[bonds.second])
        stiffness = factor * shear_moduli * body.weigh(length) * volumes / body.kappa
        near = length <= REACH * body.spacing
        if not share.any(near.any()):
            near[:] = True
        moment = stiffness * length**2
        of_all = moment * share.own[bonds.first]
        self.stiffness = stiffness[near] * share.total(of_all.sum()) / share.total(of_all[near].sum())
        self.along = vector[near] / length[near, None]
        self.first, self.second = bonds.first[near].astype(np.int64), bonds.second[near].astype(np.int64)
        self.body, self.within = body, self.second < len(body)
        self.sources = np.concatenate([np.arange(len(body)), body.ghosts.source.astype(np.int64)])[self.second]

    def parity(self) -> np.ndarray:
        """Return the sign with which each component of the second end follows its source, shape (k, d)."""
        return np.concatenate([np.ones_like(self.body.points), self.body.ghosts.parity])[self.second]

    def entries(self, values: np.ndarray, parity: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rows, columns and values of the stiffness of springs of given values (k,); forces on ghosts are not included."""
        first, second, within = self.first, self.second, self.within
        rows = np.concatenate([first, first, second[within], second[within]])
        columns = np.concatenate([first, self.sources, second[within], first[within]])
        return rows, columns, np.concatenate([values, -values * parity, values[within], -values[within]])

    def on_points(self, forces: np.ndarray) -> np.ndarray:
        """Return the forces on the points, shape (n, d), from those on the first ends (k, d)."""
        return sums_at_points(len(self.body), self.first, self.second, forces, -1)


class Springs:
    """Network of springs along and across the nearest bonds, scaled to the body's small-strain stiffness.

    Attributes
    ----------
    bonds : NearestBonds
    blocks : ndarray, shape (k, d, d)
        Stiffness of each spring.
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray) -> None:
        self.bonds = NearestBonds(body, shear_moduli, ELONGATION)
        stiffness, along = self.bonds.stiffness, self.bonds.along
        blocks = np.einsum("b,bi,bj->bij", stiffness, along, along)
        if body.dimension == 2:
            across = np.stack([-along[:, 1], along[:, 0]], axis=1)
            self.blocks = blocks + SHEAR_SHARE * np.einsum("b,bi,bj->bij", stiffness, across, across)
        else:
            self.blocks = (1 - SHEAR_SHARE) * blocks + SHEAR_SHARE * stiffness[:, None, None] * np.eye(3)

    def forces(self, moved: np.ndarray) -> np.ndarray:
        """Return the forces on the points, shape (n, d), under displacements of points and ghosts (n + m, d)."""
        changes = moved[self.bonds.second] - moved[self.bonds.first]
        return self.bonds.on_points(np.einsum("bij,bj->bi", self.blocks, changes))

    def matrix(self, rigid: np.ndarray | None = None) -> sparse.csc_array:
        """Return the stiffness as if no component were held, shape (d n, d n), with the components of a point in sequence.

        Springs between two points flagged in `rigid`, shape (n,), are omitted.
        """
        bonds, blocks, (n, d) = self.bonds, self.blocks, self.bonds.body.points.shape
        if rigid is not None:
            blocks = blocks * ~(rigid[bonds.first] & rigid[bonds.sources])[:, None, None]
        rows, columns, values = [], [], []
        for i in range(d):
            for j, parity in enumerate(bonds.parity().T):
                row, column, value = bonds.entries(blocks[:, i, j], parity)
                rows.append(d * row + i)
                columns.append(d * column + j)
                values.append(value)
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        matrix = sparse.coo_matrix(entries, shape=(d * n, d * n)).tocsc()
        return (matrix + matrix.T) / 2


class Laplacian:
    """Vector Laplacian of the nearest bonds, times the shear modulus and `RAISED`, without coupling of components.

    Apart from the contribution of the pressures it is the tangent of an incompressible neo-Hookean body in every state.

    Attributes
    ----------
    bonds : NearestBonds
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray) -> None:
        # Over a full horizon the sum of w V l^2 is d kappa.
        self.bonds = NearestBonds(body, shear_moduli, RAISED)

    def forces(self, moved: np.ndarray) -> np.ndarray:
        """Return the forces on the points, shape (n, d), under displacements of points and ghosts (n + m, d)."""
        return self.bonds.on_points(self.bonds.stiffness[:, None] * (moved[self.bonds.second] - moved[self.bonds.first]))

    def matrices(self) -> list[sparse.csr_array]:
        """Return the matrix of each component, shape (n, n); components that ghosts continue with equal parity share one object."""
        bonds, n, made = self.bonds, len(self.bonds.body), {}
        keys = [column.tobytes() for column in bonds.body.ghosts.parity.T]
        for key, parity in zip(keys, bonds.parity().T, strict=True):
            if key not in made:
                rows, columns, values = bonds.entries(bonds.stiffness, parity)
                matrix = sparse.csr_array((values, (rows, columns)), shape=(n, n))
                made[key] = (matrix + matrix.T) / 2
        return [made[key] for key in keys]


def held_matrix(matrix: sparse.sparray, free: np.ndarray) -> sparse.sparray:
    """Return a stiffness with identity rows for held components, where `free` is 0, and with `SHIFT` added."""
    keep, mean = sparse.diags_array(free), matrix.diagonal().mean()
    return keep @ matrix @ keep + sparse.diags_array(SHIFT * mean * free + mean * (1 - free))


def by_components(operators: list[Callable[[np.ndarray], np.ndarray]], values: np.ndarray) -> np.ndarray:
    """Apply one operator to each component of values (n, d), or a common operator to all components at once."""
    if all(operator is operators[0] for operator in operators):
        return operators[0](values)
    return np.stack([operator(column) for operator, column in zip(operators, values.T, strict=True)], axis=1)


def drifting_axes(body: Body, free: np.ndarray) -> np.ndarray:
    """Return the axes along which a body is not held.

    No equilibrium exists under a uniform force along them, so it is removed rather than divided by the shift.
    """
    return np.flatnonzero(~body.share.any((body.ghosts.parity < 0).any(axis=0) | (free == 0).any(axis=0)))


def remove_drift(values: np.ndarray, axes: np.ndarray, share: Share) -> None:
    """Subtract the mean along some axes, in place."""
    for axis in axes:
        values[:, axis] -= share.sum(values[:, axis]) / share.size


class NearestBondStiffness(Preconditioner):
    """Factorised stiffness of `Springs`.

    Its low modes agree with those of the true tangent within a factor that does not grow with the number of points, and its factorisation
    needs seconds for 10^5 points.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
        Shear modulus of all points, or around each.
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> None:
        self._free, self._drifting, self._share = free.ravel(), drifting_axes(body, free), body.share
        self._factor = factor_of(held_matrix(Springs(body, shear_moduli).matrix(), self._free))

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements under forces, shape (n, d)."""
        displacements = self._factor.solve(forces.ravel() * self._free).reshape(forces.shape)
        remove_drift(displacements, self._drifting, self._share)
        return displacements


class NearestBondLaplacian(Preconditioner):
    """Inverse of `Laplacian`, component by component: a factor, or a multigrid cycle for large bodies.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
    free : ndarray, shape (n, d)
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> None:
        self._free, self._drifting, self._share, made = free, drifting_axes(body, free), body.share, {}
        matrices = Laplacian(body, shear_moduli).matrices()
        keys = [(id(matrix), column.tobytes()) for matrix, column in zip(matrices, free.T, strict=True)]
        width = body.dimension if len(set(keys)) == 1 else 1
        for key, matrix, column in zip(keys, matrices, free.T, strict=True):
            if key not in made:
                made[key] = _inverse(body, held_matrix(matrix, column), column, width)
        self._inverses = [made[key] for key in keys]

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements under forces, shape (n, d)."""
        displacements = by_components(self._inverses, forces * self._free)
        remove_drift(displacements, self._drifting, self._share)
        return displacements * self._free


def _inverse(body: Body, matrix: sparse.sparray, free: np.ndarray, width: int) -> Callable[[np.ndarray], np.ndarray]:
    """Return an operator that solves with a Laplacian, for `width` right-hand sides at once."""
    if len(body) > MOST_FACTORISED[body.dimension]:
        return Multigrid(matrix.tocsr(), body.points, body.spacing, free > 0, width).cycle
    return factor_of(matrix).solve
