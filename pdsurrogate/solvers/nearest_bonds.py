"""Stiffness of the nearest bonds of a body: the matrix that preconditioners and first guesses are made of, and its inverse."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from scipy import sparse

from ..body import Body
from . import conjugate_gradients
from .multigrid import Multigrid, factor_of

REACH = 1.3
"""Length, in spacings, up to which bonds make the matrix: four bonds to a point on a grid, and those of points that lie off it.

With the diagonals the factor has four times the entries and takes four times as long, for a tenth fewer steps.
"""

ELONGATION = 6.0
"""Stiffness of a spring along its bond, in units of mu w V_i V_j/kappa."""

SHEAR_SHARE = 1 / 3
"""Stiffness of a spring across its bond over that along it; the true tangent has both."""

SHIFT = 1e-6
"""Share of the mean diagonal added to it, so that bodies free to drift have a factor too."""

MOST_FACTORISED = {2: 300_000, 3: 5_000}
"""Points up to which a Laplacian is factorised, by dimension. The factor fills up; beyond, a multigrid cycle replaces it."""

RAISED = 4 / 3
"""Factor of the Laplacian that stands for the tangent of a nearly incompressible body, over that of rubber at rest.

Stretch and pressure stiffen the tangent. Of 1, 1.25, 1.5 and 2 (bonded blocks of 12 to 20 points a side, K = 100 mu and 1000 mu) the
middle two take a fifth to a quarter fewer evaluations than 1, and 2 no fewer.
"""

EXTENDED = 3e-4
"""Share of the forces of held components that a first guess may leave, in the norm of the energy."""

MOST_STEPS = 100
"""Most steps of conjugate gradients for a first guess; some tens are taken."""


class Preconditioner(Protocol):
    """An approximation of the tangent that is cheap to solve with."""

    def update(self) -> None:
        """Adapt to the state in which the force was last evaluated."""

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements under forces, shape (n, d)."""


class Extension(Protocol):
    """Map from displacements of held components to displacements of the whole body."""

    def response(
        self, body: Body, shear_moduli: float | np.ndarray, held: np.ndarray, planes: np.ndarray, turns: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the displacements of the body, shape (n, d), where held components and planes of reflection are displaced.

        Parameters
        ----------
        body : Body
        shear_moduli : float or ndarray, shape (n,)
            Both as given when the extension was made.
        held : ndarray, shape (n, d)
            Displacements in held components, 0 in free ones.
        planes : ndarray, shape (planes, d)
            Displacements of the planes.
        turns : ndarray, shape (planes, d, d), optional
            Turns of planes, see `pdsurrogate.body.Ghosts.shifts`.
        """


class NearestBonds:
    """Nearest bonds of a body, with stiffnesses so raised that these bonds have the second moment of all bonds.

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
        Ends; `second` may be a ghost.
    within : ndarray of bool, shape (k,)
        Whether `second` is a point.
    sources : ndarray of int, shape (k,)
        Point that `second` is or is an image of.
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
            # Two springs in series; the sum of inverses, since the product of two moduli may be out of range.
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

    def on_points(self, forces: np.ndarray) -> np.ndarray:
        """Return the forces on the points, shape (n, d), from those on the first ends (k, d)."""
        first, second, within, n = self.first, self.second, self.within, len(self.body)
        return np.stack([np.bincount(first, force, n) - np.bincount(second[within], force[within], n) for force in forces.T], axis=1)


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
        """Return the stiffness with no component held, shape (d n, d n), the components of a point together.

        Between points (n,) that are `rigid` there are no springs.
        """
        bonds, blocks, (n, d) = self.bonds, self.blocks, self.bonds.body.points.shape
        first, second, within, sources, parity = bonds.first, bonds.second, bonds.within, bonds.sources, bonds.parity()
        if rigid is not None:
            blocks = blocks * ~(rigid[first] & rigid[sources])[:, None, None]
        rows, columns, values = [], [], []
        for i in range(d):
            for j in range(d):
                block = blocks[:, i, j]
                rows += [d * first + i, d * first + i]
                columns += [d * first + j, d * sources + j]
                values += [block, -block * parity[:, j]]
                # The second end of a bond within the body; a ghost's force is not one of the unknowns.
                rows += [d * second[within] + i, d * second[within] + i]
                columns += [d * second[within] + j, d * first[within] + j]
                values += [block[within], -block[within]]
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        matrix = sparse.coo_matrix(entries, shape=(d * n, d * n)).tocsc()
        return (matrix + matrix.T) / 2


class Laplacian:
    """Vector Laplacian of the nearest bonds times the shear modulus, `RAISED`; components do not act on each other.

    It is the tangent of an incompressible neo-Hookean body in every state, apart from that of the pressures.

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
        """Return the matrix of each component, shape (n, n); one object serves components that ghosts continue with equal parity."""
        bonds, n = self.bonds, len(self.bonds.body)
        first, second, within, stiffness, made = bonds.first, bonds.second, bonds.within, bonds.stiffness, {}
        keys = [column.tobytes() for column in bonds.body.ghosts.parity.T]
        for key, parity in zip(keys, bonds.parity().T, strict=True):
            if key not in made:
                rows = np.concatenate([first, second[within], first, second[within]])
                columns = np.concatenate([first, second[within], bonds.sources, first[within]])
                values = np.concatenate([stiffness, stiffness[within], -stiffness * parity, -stiffness[within]])
                matrix = sparse.csr_array((values, (rows, columns)), shape=(n, n))
                made[key] = (matrix + matrix.T) / 2
        return [made[key] for key in keys]


def held_matrix(matrix: sparse.sparray, free: np.ndarray) -> sparse.sparray:
    """Return a stiffness with the rows of held components, where `free` is 0, made those of the identity, and `SHIFT` added."""
    keep, mean = sparse.diags_array(free), matrix.diagonal().mean()
    return keep @ matrix @ keep + sparse.diags_array(SHIFT * mean * free + mean * (1 - free))


def by_components(operators: list[Callable[[np.ndarray], np.ndarray]], values: np.ndarray) -> np.ndarray:
    """Return what one operator for each component makes of values (n, d); an operator for all components takes them at once."""
    if all(operator is operators[0] for operator in operators):
        return operators[0](values)
    return np.stack([operator(column) for operator, column in zip(operators, values.T, strict=True)], axis=1)


def drifting_axes(body: Body, free: np.ndarray) -> list[int]:
    """Return the axes along which nothing holds a body.

    A uniform force along them has no place in equilibrium, and is left out rather than divided by the shift.
    """
    held = (body.ghosts.parity < 0).any(axis=0)
    return [axis for axis in range(body.dimension) if not held[axis] and free[:, axis].all()]


def remove_drift(displacements: np.ndarray, axes: list[int]) -> None:
    """Subtract the mean along some axes, in place."""
    for axis in axes:
        displacements[:, axis] -= displacements[:, axis].mean()


def extended(
    network: Springs | Laplacian,
    solve: Callable[[np.ndarray], np.ndarray],
    held: np.ndarray,
    planes: np.ndarray,
    turns: np.ndarray | None,
) -> np.ndarray:
    """Return `Extension.response` for a network, with what solves for the displacements under its forces."""
    body = network.bonds.body
    ghosts, held = body.ghosts, held.copy()
    body.share.fill(held)
    images = held[ghosts.source] * ghosts.parity + ghosts.moved_by_planes(body.points, planes, turns)
    found = solve(network.forces(np.vstack([held, images]))) + held
    body.share.fill(found)
    return found


def extended_by_laplacian(
    laplacian: Laplacian,
    precondition: Callable[[np.ndarray], np.ndarray],
    free: np.ndarray,
    *changes: np.ndarray | None,
) -> np.ndarray:
    """Return `Extension.response` by conjugate gradients, which leave `EXTENDED` of the forces; `changes` are those of `extended`."""
    body = laplacian.bonds.body

    def image_of(direction: np.ndarray) -> np.ndarray:
        body.share.fill(direction)
        return -laplacian.forces(np.vstack([direction, direction[body.ghosts.source] * body.ghosts.parity])) * free

    def solve(forces: np.ndarray) -> np.ndarray:
        left, found = forces * free, np.zeros_like(forces)
        for length, direction, _ in conjugate_gradients.steps(left, precondition, image_of, body.share.dot, EXTENDED, MOST_STEPS):
            found += length * direction
        return found

    return extended(laplacian, solve, *changes)


class NearestBondStiffness:
    """The factorised stiffness of `Springs`.

    Its low modes are those of the true tangent within a factor that does not grow with the number of points, and its factor takes seconds
    for 10^5 points.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
        Shear modulus of all points, or around each.
    free : ndarray, shape (n, d)
        1 where a component may move; held ones get the identity.
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> None:
        self._free, self._drifting = free.ravel(), drifting_axes(body, free)
        self._factor = factor_of(held_matrix(Springs(body, shear_moduli).matrix(), self._free))

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements under forces, shape (n, d)."""
        displacements = self._factor.solve(forces.ravel() * self._free).reshape(forces.shape)
        remove_drift(displacements, self._drifting)
        return displacements

    def update(self) -> None:
        """Do nothing: it is the same in all states."""

    def response(
        self, body: Body, shear_moduli: float | np.ndarray, held: np.ndarray, planes: np.ndarray, turns: np.ndarray | None = None
    ) -> np.ndarray:
        """See `Extension`."""
        return extended(Springs(body, shear_moduli), self.solve, held, planes, turns)


class NearestBondLaplacian:
    """Inverse of `Laplacian`, each component by itself: a factor, or a cycle of multigrid for large bodies.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
    free : ndarray, shape (n, d)
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> None:
        self._free, self._drifting, made = free, drifting_axes(body, free), {}
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
        remove_drift(displacements, self._drifting)
        return displacements * self._free

    def response(
        self, body: Body, shear_moduli: float | np.ndarray, held: np.ndarray, planes: np.ndarray, turns: np.ndarray | None = None
    ) -> np.ndarray:
        """See `Extension`."""
        return extended_by_laplacian(Laplacian(body, shear_moduli), self.solve, self._free, held, planes, turns)


def _inverse(body: Body, matrix: sparse.sparray, free: np.ndarray, width: int) -> Callable[[np.ndarray], np.ndarray]:
    """Return what solves with a Laplacian, for so many right hand sides at once."""
    if len(body) > MOST_FACTORISED[body.dimension]:
        return Multigrid(matrix.tocsr(), body.points, body.spacing, free > 0, width).cycle
    return factor_of(matrix).solve
