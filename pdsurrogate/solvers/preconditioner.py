"""Preconditioners of quasi-Newton methods: the stiffness of the nearest bonds, and what a great bulk modulus adds to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from ..body import Body
from ..forces import InternalForce
from . import conjugate_gradients
from .multigrid import Multigrid

REACH = 1.3
"""Bonds up to this many spacings make the matrix: four to a point on a grid, and those of points that lie off it.

With the diagonals the factor has four times the entries and takes four times as long, for a tenth fewer steps.
"""

SHEAR_SHARE = 1 / 3
"""Stiffness across a bond over that along it; the true tangent has both."""

SHIFT = 1e-6
"""Share of the mean diagonal added to it, so that bodies free to drift have a factor too."""


MOST_FACTORISED = {2: 300_000, 3: 5_000}
"""Points up to which a Laplacian is factorised, in the plane and in space, whose factors fill up; beyond, a multigrid cycle is taken."""

RAISED = 4 / 3
"""Of the Laplacian that stands for the tangent of a nearly incompressible body, over that of rubber at rest.

Stretch and pressure stiffen the tangent.  Of 1, 1.25, 1.5 and 2 (bonded blocks of 12 to 20 points a side, K = 100 mu and 1000 mu) the
middle two take a fifth to a quarter fewer evaluations than 1, and 2 no fewer.
"""

NEARLY_SOLVED = 0.1
"""What may be left of a change of volume, over mu/K: the energy of what is left is then small against that of the shear."""

MOST_STEPS = 100
"""Steps for the pressures in one solution: some tens are taken at K = 1000 mu."""

EXPONENT_ERROR = 0.5
"""Greatest relative error of the polynomial that the pressures' system is preconditioned with."""


EXTENDED = 3e-4
"""What may be left of the forces of what is held, in the energy's own measure, in a first guess."""


class Preconditioner(Protocol):
    """An approximation of the tangent that is cheap to solve with."""

    def update(self) -> None:
        """Take the state that the force was last evaluated in."""

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Displacements under forces, shape (n, d)."""


class Extension(Protocol):
    """What carries displacements of held parts into a body."""

    def response(
        self, body: Body, shear_moduli: float | np.ndarray, held: np.ndarray, planes: np.ndarray, turns: np.ndarray | None = None
    ) -> np.ndarray:
        """See `NearestBondStiffness.response`."""


def preconditioner_of(force: InternalForce, free: np.ndarray) -> Preconditioner:
    """What suits the tangent of a force in which components (n, d) are free."""
    body, moduli = force.body, force.stiffness_moduli
    if getattr(force, "rigid", None):
        from .rigid import RigidStiffness  # of which a body without rigid regions has no need

        return RigidStiffness(force, free)
    if force.nearly_incompressible:
        return IncompressibleStiffness(force, _laplacian(body, moduli, free))
    return _of_springs(body, moduli, free)


def extension_of(body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> Extension:
    """What carries displacements of held parts into a body; a factor of all components is not to be had for many points in space."""
    return (_laplacian if body.dimension == 3 else _of_springs)(body, shear_moduli, free)


def _of_springs(body: Body, shear_moduli: float | np.ndarray, free: np.ndarray):
    """The stiffness of the network of springs, of a divided body by its parts."""
    if body.share.divided:
        from .schwarz import SchwarzStiffness  # of which a body that is all there has no need

        return SchwarzStiffness(body, shear_moduli, free)
    return NearestBondStiffness(body, shear_moduli, free)


def _laplacian(body: Body, shear_moduli: float | np.ndarray, free: np.ndarray):
    """The Laplacian of the nearest bonds, of a divided body by its parts."""
    if body.share.divided:
        from .schwarz import SchwarzLaplacian

        return SchwarzLaplacian(body, shear_moduli, free)
    return NearestBondLaplacian(body, shear_moduli, free)


class NearestBondStiffness:
    """The stiffness of a network of springs along and across the nearest bonds, scaled to the body's small-strain stiffness.

    Its low modes are those of the true tangent within a factor that does not grow with the number of points, and its
    factor takes seconds for 10^5 points.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
        Of all points, or about each.
    free : ndarray, shape (n, d)
        1 where a component may move; held ones get the identity.
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> None:
        matrix = spring_matrix(body, shear_moduli)
        self._free = free.ravel()
        self._factor = factorised(matrix, self._free)
        # Rigid translations that nothing holds: a uniform force has no place in equilibrium, and is left out rather
        # than divided by the shift.
        held = (body.ghosts.parity < 0).any(axis=0)
        self._drifting = [axis for axis in range(body.dimension) if not held[axis] and free[:, axis].all()]

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Displacements under forces, shape (n, d)."""
        displacements = self._factor.solve(forces.ravel() * self._free).reshape(forces.shape)
        for axis in self._drifting:
            displacements[:, axis] -= displacements[:, axis].mean()
        return displacements

    def update(self) -> None:
        """It is the same in all states."""

    def response(
        self, body: Body, shear_moduli: float | np.ndarray, held: np.ndarray, planes: np.ndarray, turns: np.ndarray | None = None
    ) -> np.ndarray:
        """Displacements of the body, shape (n, d), where held components and planes of reflection are displaced.

        Parameters
        ----------
        body : Body
        shear_moduli : float or ndarray, shape (n,)
            Both as given when the stiffness was made.
        held : ndarray, shape (n, d)
            Displacements in held components, 0 in free ones.
        planes : ndarray, shape (planes, d)
            Displacements of the planes.
        turns : ndarray, shape (planes, d, d), optional
            Of planes that turn too, see `pdsurrogate.body.Ghosts.shifts`.
        """
        return self.solve(forces_of_springs(body, shear_moduli, held, planes, turns)) + held


def spring_matrix(body: Body, shear_moduli: float | np.ndarray, rigid: np.ndarray | None = None) -> sparse.csc_array:
    """Stiffness of the nearest bonds with no component held, shape (d n, d n), the components of a point together.

    Between points (n,) that are `rigid` there are no springs.
    """
    n, d, ghosts = len(body), body.dimension, body.ghosts
    first, second, blocks = springs(body, shear_moduli)
    within = second < n
    # A ghost moves with the point behind it, each component with its parity.
    mirrored, parity = second.copy(), np.ones((len(second), d))
    mirrored[~within] = ghosts.source[second[~within] - n]
    parity[~within] = ghosts.parity[second[~within] - n]
    if rigid is not None:
        blocks = blocks * ~(rigid[first] & rigid[mirrored])[:, None, None]
    rows, columns, values = [], [], []
    for i in range(d):
        for j in range(d):
            block = blocks[:, i, j]
            rows += [d * first + i, d * first + i]
            columns += [d * first + j, d * mirrored + j]
            values += [block, -block * parity[:, j]]
            # The second end of a bond within the body; a ghost's force is not one of the unknowns.
            rows += [d * second[within] + i, d * second[within] + i]
            columns += [d * second[within] + j, d * first[within] + j]
            values += [block[within], -block[within]]
    matrix = sparse.coo_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(d * n, d * n)).tocsc()
    return (matrix + matrix.T) / 2


def factorised(matrix: sparse.csc_array, free: np.ndarray):
    """Factor of a stiffness with the rows of held components, where `free` is 0, made those of the identity."""
    keep, mean = sparse.diags_array(free), matrix.diagonal().mean()
    diagonal = SHIFT * mean * free + mean * (1 - free)
    matrix = (keep @ matrix @ keep + sparse.diags_array(diagonal)).tocsc()
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def forces_of_springs(
    body: Body, shear_moduli: float | np.ndarray, held: np.ndarray, planes: np.ndarray, turns: np.ndarray | None
) -> np.ndarray:
    """Forces on the points, shape (n, d), where held components and planes are displaced and all else stays, see `response`."""
    n, ghosts = len(body), body.ghosts
    first, second, blocks = springs(body, shear_moduli)
    moved = np.vstack([held, held[ghosts.source] * ghosts.parity + ghosts.moved_by_planes(body.points, planes, turns)])
    pulls, within = np.einsum("bij,bj->bi", blocks, moved[second] - moved[first]), second < n
    return np.stack([np.bincount(first, pull, n) - np.bincount(second[within], pull[within], n) for pull in pulls.T], axis=1)


def _nearest(body: Body, shear_moduli: float | np.ndarray, factor: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Nearest bonds: their ends, of which `second` may be a ghost, stiffness and direction, shape (k, d).

    The stiffness is a factor times mu w V_i V_j/kappa, so raised that these bonds have the moment of all.
    """
    bonds, points = body.bonds, body.all_points
    vector = points[bonds.second] - points[bonds.first]
    length = np.linalg.norm(vector, axis=1)
    volumes = body.all_volumes[bonds.first] * body.all_volumes[bonds.second]
    if isinstance(shear_moduli, np.ndarray):
        ends = np.concatenate([shear_moduli, shear_moduli[body.ghosts.source]])
        # Of two springs in series; the sum of inverses, since the product of two moduli may be out of range.
        shear_moduli = 2 / (1 / ends[bonds.first] + 1 / ends[bonds.second])
    stiffness = factor * shear_moduli * body.weigh(length) * volumes / body.kappa
    near = length <= REACH * body.spacing
    share = body.share
    if not share.any(near.any()):
        near[:] = True
    moment = stiffness * length**2
    counted = share.counted_pairs(bonds.first)
    of_all = moment if counted is None else moment * counted
    stiffness = stiffness[near] * share.total(of_all.sum()) / share.total(of_all[near].sum())
    along = vector[near] / length[near, None]
    return bonds.first[near].astype(np.int64), bonds.second[near].astype(np.int64), stiffness, along


def nearest_ends(body: Body, shear_moduli: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the nearest bonds, of which the second may be a ghost."""
    return _nearest(body, shear_moduli, 1.0)[:2]


def springs(body: Body, shear_moduli: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ends of the nearest bonds and the stiffness of each, shape (k, d, d); `second` may be a ghost."""
    first, second, stiffness, along = _nearest(body, shear_moduli, 6.0)
    blocks = np.einsum("b,bi,bj->bij", stiffness, along, along)
    if body.dimension == 2:
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        return first, second, blocks + SHEAR_SHARE * np.einsum("b,bi,bj->bij", stiffness, across, across)
    return first, second, (1 - SHEAR_SHARE) * blocks + SHEAR_SHARE * stiffness[:, None, None] * np.eye(3)


class NearestBondLaplacian:
    """The vector Laplacian of the nearest bonds times the shear modulus, `RAISED`, every component by itself.

    Of an incompressible neo-Hookean body it is the tangent itself, in every state, but for that of the pressures.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
    free : ndarray, shape (n, d)
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> None:
        self._free, self._inverses, made = free, [], {}
        self._drifting, ghosts = [], body.ghosts
        matrix_of = component_laplacians(body, shear_moduli)
        keys = [(ghosts.parity[:, axis].tobytes(), free[:, axis].tobytes()) for axis in range(body.dimension)]
        self._alike = len(set(keys)) == 1
        for axis, key in enumerate(keys):
            if key not in made:
                made[key] = _inverse(body, matrix_of(axis), free[:, axis], body.dimension if self._alike else 1)
            self._inverses.append(made[key])
            if free[:, axis].all() and (ghosts.parity[:, axis] > 0).all():
                self._drifting.append(axis)

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Displacements under forces, shape (n, d)."""
        forces = forces * self._free
        if self._alike:
            displacements = self._inverses[0](forces)
        else:
            displacements = np.stack([inverse(column) for inverse, column in zip(self._inverses, forces.T, strict=True)], axis=1)
        for axis in self._drifting:
            displacements[:, axis] -= displacements[:, axis].mean()
        return displacements * self._free

    def response(
        self, body: Body, shear_moduli: float | np.ndarray, held: np.ndarray, planes: np.ndarray, turns: np.ndarray | None = None
    ) -> np.ndarray:
        """See `NearestBondStiffness.response`; by conjugate gradients, to a part `EXTENDED` of the forces of what is held."""
        return laplacian_response(self, self._free, body, shear_moduli, held, planes, turns)


def component_laplacians(body: Body, shear_moduli: float | np.ndarray) -> Callable[[int], sparse.csr_array]:
    """What forms the Laplacian of the nearest bonds for a component, shape (n, n): an image moves with its source, or against it."""
    n, ghosts = len(body), body.ghosts
    # Over a full horizon the sum of w V l^2 is d kappa.
    first, second, stiffness, _ = _nearest(body, shear_moduli, RAISED)
    within = second < n
    sources = np.concatenate([np.arange(n), ghosts.source.astype(np.int64)])[second]

    def matrix_of(axis: int) -> sparse.csr_array:
        parity = np.concatenate([np.ones(n), ghosts.parity[:, axis]])[second]
        rows = np.concatenate([first, second[within], first, second[within]])
        columns = np.concatenate([first, second[within], sources, first[within]])
        values = np.concatenate([stiffness, stiffness[within], -stiffness * parity, -stiffness[within]])
        matrix = sparse.csr_array((values, (rows, columns)), shape=(n, n))
        return (matrix + matrix.T) / 2

    return matrix_of


def laplacian_response(
    laplacian: Preconditioner,
    free: np.ndarray,
    body: Body,
    shear_moduli: float | np.ndarray,
    held: np.ndarray,
    planes: np.ndarray,
    turns: np.ndarray | None,
) -> np.ndarray:
    """`NearestBondStiffness.response` by conjugate gradients on the Laplacian of the nearest bonds, from what nearly solves with it."""
    n, ghosts, share = len(body), body.ghosts, body.share
    first, second, stiffness, _ = _nearest(body, shear_moduli, RAISED)
    within = second < n

    def pulls(moved: np.ndarray) -> np.ndarray:
        """Forces on the points, shape (n, d), from displacements of points and ghosts."""
        along = stiffness[:, None] * (moved[second] - moved[first])
        return np.stack([np.bincount(first, pull, n) - np.bincount(second[within], pull[within], n) for pull in along.T], axis=1)

    def with_images(moved: np.ndarray) -> np.ndarray:
        share.fill(moved)
        return np.vstack([moved, moved[ghosts.source] * ghosts.parity])

    held = held.copy()
    moved = with_images(held)
    moved[n:] += ghosts.moved_by_planes(body.points, planes, turns)
    left, found = pulls(moved) * free, np.zeros_like(held)

    def image_of(direction: np.ndarray) -> np.ndarray:
        return -pulls(with_images(direction)) * free

    for length, direction, _ in conjugate_gradients.steps(left, laplacian.solve, image_of, share.dot, EXTENDED, MOST_STEPS):
        found += length * direction
    share.fill(found)
    return found + held


class IncompressibleStiffness:
    """An approximation of the tangent of a nearly incompressible body, A + D^T C D, that is solved for displacements (theory (58), (59)).

    A is the Laplacian of the nearest bonds, D the derivative of the points' dilatation in the present state and C their stiffness against
    it.  D is not approximated: what is over of a change of volume costs K.  With pressures p for the unknowns the system has the size
    of the bulk compliance and not of K, (C^-1 + D A^-1 D^T) p = D A^-1 f, and a few steps of conjugate gradients solve it.

    Parameters
    ----------
    force : InternalForce
        Nearly incompressible.
    laplacian : Preconditioner
        What solves with A, or nearly: a fixed operator, symmetric and positive definite.

    Attributes
    ----------
    steps : int
        Taken for the pressures so far; each costs about as much as two thirds of a force evaluation and a solution with A.
    """

    def __init__(self, force: InternalForce, laplacian: Preconditioner) -> None:
        self._laplacian, self._share = laplacian, force.body.share
        self._dilatation = force.linearised_dilatation()
        self._volumes, self._modulus = force.body.volumes, force.law.shear_modulus
        self._compliance = force.law.shear_modulus / force.law.bulk_modulus
        self._inverse = self._dilatation.polynomial(_inverse_polynomial(self._compliance))
        self.steps = 0

    def update(self) -> None:
        """Take the state that the force was last evaluated in."""
        self._dilatation.take()

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Displacements under forces, shape (n, d)."""
        laplacian, dilatation = self._laplacian, self._dilatation
        compliance = 1 / dilatation.stiffness
        displacements = laplacian.solve(forces)
        moved = displacements

        def image_of(pressures: np.ndarray) -> np.ndarray:
            nonlocal moved
            moved = laplacian.solve(dilatation.forces(pressures))
            return compliance * pressures + dilatation.changes(moved)

        asked = self._precondition, image_of, self._dot, NEARLY_SOLVED * self._compliance, MOST_STEPS
        for share, _, _ in conjugate_gradients.steps(dilatation.changes(displacements), *asked):
            displacements -= share * moved
            self.steps += 1
        return displacements

    def _precondition(self, left: np.ndarray) -> np.ndarray:
        """V mu (mu/K + W^4)^-1 nearly: D has the smoothing W, and the bonds' means smooth about as much again."""
        return self._modulus * self._volumes * self._inverse(left)

    def _dot(self, first: np.ndarray, second: np.ndarray) -> float:
        """Inner product of values at the points, shape (n,)."""
        return self._share.dot(first[:, None], second[:, None])


def _inverse_polynomial(compliance: float) -> np.ndarray:
    """Chebyshev coefficients on [0, 1] of a polynomial near 1/(compliance + s^2), of the least degree that keeps to `EXPONENT_ERROR`."""
    s = (1 - np.cos(np.pi * (np.arange(400) + 0.5) / 400)) / 2
    for degree in range(2, 64):
        table = np.polynomial.chebyshev.chebvander(2 * s - 1, degree) * (compliance + s * s)[:, None]
        coefficients = np.linalg.lstsq(table, np.ones_like(s), rcond=None)[0]
        if np.abs(table @ coefficients - 1).max() <= EXPONENT_ERROR:
            break
    return coefficients


def _inverse(body: Body, matrix: sparse.csr_array, free: np.ndarray, width: int):
    """The inverse of a Laplacian with the held rows made those of the identity, or a multigrid cycle in its place."""
    keep, mean = sparse.diags_array(free), matrix.diagonal().mean()
    matrix = keep @ matrix @ keep + sparse.diags_array(SHIFT * mean * free + mean * (1 - free))
    if len(body) > MOST_FACTORISED[body.dimension]:
        return Multigrid(matrix.tocsr(), body.points, body.spacing, free > 0, width).cycle
    return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}).solve
