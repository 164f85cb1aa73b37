"""Stiffness of the nearest bonds of a body, for preconditioners and first guesses: its matrix and the inverse."""

from abc import ABC, abstractmethod
from collections.abc import Iterable

import numpy as np
from scipy import sparse

from ..body import Body
from ..body.body import sums_at_points
from ..kernels.steps import greatest_strain
from ..ranks import Share
from .multigrid import Multigrid, Operator, factor_of

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
    """Springs along the nearest bonds of a body and across them, scaled so that these bonds have the second moment of all bonds.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
        Shear modulus of all points, or around each.
    along, across : float
        Stiffness of a spring along its bond and across it, in units of mu w V_i V_j/kappa, before it is raised.

    Attributes
    ----------
    first, second : ndarray of int, shape (k,)
        Ends of the bonds; `second` may be a ghost.
    body
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, along: float, across: float) -> None:
        bonds, points, share = body.bonds, body.all_points, body.share
        vector = points[bonds.second] - points[bonds.first]
        length = np.linalg.norm(vector, axis=1)
        volumes = body.all_volumes[bonds.first] * body.all_volumes[bonds.second]
        if isinstance(shear_moduli, np.ndarray):
            ends = np.concatenate([shear_moduli, shear_moduli[body.ghosts.source]])
            # Two springs in series, computed with inverses, since the product of two moduli may overflow.
            shear_moduli = 2 / (1 / ends[bonds.first] + 1 / ends[bonds.second])
        stiffness = shear_moduli * body.weigh(length) * volumes / body.kappa
        near = length <= REACH * body.spacing
        if not share.any(near.any()):
            near[:] = True
        moment = stiffness * length**2
        of_all = moment * share.own[bonds.first]
        stiffness = stiffness[near] * share.total(of_all.sum()) / share.total(of_all[near].sum())
        self._across, self._excess, self._along = across * stiffness, (along - across) * stiffness, vector[near] / length[near, None]
        self.first, self.second = bonds.first[near].astype(np.int64), bonds.second[near].astype(np.int64)
        self.body = body

    def forces(self, moved: np.ndarray, of_images: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the forces on the points under displacements (n, d), whose halo is filled first.

        Images move with their points and by `of_images`, shape (m, d), besides.
        """
        ghosts = self.body.ghosts
        self.body.share.fill(moved)
        moved = np.vstack([moved, moved[ghosts.source] * ghosts.parity + of_images])
        changes = moved[self.second] - moved[self.first]
        forces = self._across[:, None] * changes
        if self._excess.any():
            forces += (self._excess * np.einsum("bi,bi->b", self._along, changes))[:, None] * self._along
        return sums_at_points(len(self.body), self.first, self.second, forces, -1)

    def matrix(self, rigid: np.ndarray | None = None) -> sparse.csc_array:
        """Return the stiffness as if no component were held, shape (d n, d n), with the components of a point in sequence.

        Springs between two points flagged in `rigid`, shape (n,), are omitted.
        """
        d = self.body.dimension
        blocks = np.einsum("b,bi,bj->bij", self._excess, self._along, self._along) + self._across[:, None, None] * np.eye(d)
        if rigid is not None:
            blocks *= ~(rigid[self.first] & rigid[self._sources()])[:, None, None]
        rows, columns, values = self._entries(blocks, self._parity()[:, None])
        rows, columns = d * rows[:, None, None] + np.arange(d)[:, None], d * columns[:, None, None] + np.arange(d)
        places = [np.broadcast_to(numbers, values.shape).ravel() for numbers in (rows, columns)]
        matrix = sparse.coo_array((values.ravel(), places), shape=(d * len(self.body),) * 2).tocsc()
        return (matrix + matrix.T) / 2

    def matrices(self) -> list[tuple[list[int], sparse.csr_array]]:
        """Return the stiffness of each component, shape (n, n), where springs are alike along and across.

        Components that ghosts continue with equal parity share one; each matrix comes with the numbers of its components.
        """
        found, shape = [], (len(self.body),) * 2
        for components in alike(self.body.ghosts.parity, range(self.body.dimension)):
            rows, columns, values = self._entries(self._across, self._parity()[:, components[0]])
            matrix = sparse.csr_array((values, (rows, columns)), shape=shape)
            found.append((components, (matrix + matrix.T) / 2))
        return found

    def _sources(self) -> np.ndarray:
        """Return the point at the second end of every bond, or the point of which that end is an image, shape (k,)."""
        return np.concatenate([np.arange(len(self.body)), self.body.ghosts.source.astype(np.int64)])[self.second]

    def _parity(self) -> np.ndarray:
        """Return the sign with which each component of the second end follows its source, shape (k, d)."""
        return np.concatenate([np.ones_like(self.body.points), self.body.ghosts.parity])[self.second]

    def _entries(self, values: np.ndarray, parity: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rows, columns and values of the stiffness of springs of given values (k, ...); forces on ghosts are not included."""
        within = self.second < len(self.body)
        first, second, ends = self.first, self.second[within], self.first[within]
        rows, columns = np.concatenate([first, first, second, second]), np.concatenate([first, self._sources(), second, ends])
        return rows, columns, np.concatenate([values, -values * parity, values[within], -values[within]])


def springs_of(body: Body, shear_moduli: float | np.ndarray) -> NearestBonds:
    """Return the network of springs scaled to the body's small-strain stiffness."""
    return NearestBonds(body, shear_moduli, ELONGATION, SHEAR_SHARE * ELONGATION)


def laplacian_of(body: Body, shear_moduli: float | np.ndarray) -> NearestBonds:
    """Return the vector Laplacian of the nearest bonds, times the shear modulus and `RAISED`, without coupling of components.

    Apart from the contribution of the pressures it is the tangent of an incompressible neo-Hookean body in every state. Over a full horizon
    the sum of w V l^2 is d kappa.
    """
    return NearestBonds(body, shear_moduli, RAISED, RAISED)


def alike(values: np.ndarray, components: Iterable[int]) -> list[list[int]]:
    """Return the given components of an array (n, d) in groups of equal ones."""
    groups: dict[bytes, list[int]] = {}
    for component in components:
        groups.setdefault(values[:, component].tobytes(), []).append(component)
    return list(groups.values())


def held_matrix(matrix: sparse.sparray, free: np.ndarray) -> sparse.sparray:
    """Return a stiffness with identity rows for held components, where `free` is 0, and with `SHIFT` added."""
    keep, mean = sparse.diags_array(free), matrix.diagonal().mean()
    return keep @ matrix @ keep + sparse.diags_array(SHIFT * mean * free + mean * (1 - free))


def by_components(operators: list[tuple[list[int], Operator]], values: np.ndarray) -> np.ndarray:
    """Apply operators to values (n, d), each to the components that it comes with."""
    found = np.empty_like(values)
    for components, operator in operators:
        found[:, components] = operator(values[:, components])
    return found


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
    """Factorised stiffness of `springs_of` a body.

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
        self._factor = factor_of(held_matrix(springs_of(body, shear_moduli).matrix(), self._free))

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements under forces, shape (n, d)."""
        displacements = self._factor.solve(forces.ravel() * self._free).reshape(forces.shape)
        remove_drift(displacements, self._drifting, self._share)
        return displacements


class NearestBondLaplacian(Preconditioner):
    """Inverse of `laplacian_of` a body, component by component: a factor, or a multigrid cycle for large bodies.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
    free : ndarray, shape (n, d)
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> None:
        self._free, self._drifting, self._share = free, drifting_axes(body, free), body.share
        self._inverses: list[tuple[list[int], Operator]] = []
        for components, matrix in laplacian_of(body, shear_moduli).matrices():
            for own in alike(free, components):
                held = free[:, own[0]]
                self._inverses.append((own, _inverse(body, held_matrix(matrix, held), held, len(own))))

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements under forces, shape (n, d)."""
        displacements = by_components(self._inverses, forces * self._free)
        remove_drift(displacements, self._drifting, self._share)
        return displacements * self._free


def _inverse(body: Body, matrix: sparse.sparray, free: np.ndarray, width: int) -> Operator:
    """Return an operator that solves with a Laplacian, for `width` right-hand sides at once."""
    if len(body) > MOST_FACTORISED[body.dimension]:
        return Multigrid(matrix.tocsr(), body.points, body.spacing, free > 0, width).cycle
    return factor_of(matrix).solve


def random_vector(share: Share, free: np.ndarray) -> np.ndarray:
    """Return normally distributed numbers in the free components, shape (n, d), the same for a point on any number of ranks."""
    whole = np.random.default_rng(0).standard_normal((share.size, free.shape[1]))
    return whole[share.numbers] * free


def greatest_bond_strain(body: Body, before: np.ndarray, after: np.ndarray) -> float:
    """Return the greatest change of length of a bond within the body between two states, over its length at rest."""
    bonds, n = body.bonds, len(body)
    within = bonds.second < n
    first, second = bonds.first[within], bonds.second[within]

    def lengths(positions: np.ndarray) -> np.ndarray:
        return np.linalg.norm(positions[second] - positions[first], axis=1)

    return float((np.abs(lengths(after) - lengths(before)) / lengths(body.points)).max())


def strain_of_step(body: Body, step: np.ndarray) -> float:
    """Return the greatest strain of a bond that displacements (n, d) make, whose halo is filled first."""
    body.share.fill(step)
    return body.share.greatest(greatest_strain[step.shape[1]](step, body.points, body.bonds.first, body.bonds.second))
