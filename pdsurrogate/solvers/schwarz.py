"""The preconditioner of a body in parts: factors of every part and what is beside it, and what the parts do as a whole (Schwarz)."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ..body import Body
from .preconditioner import factorised, forces_of_springs, spring_matrix, springs
from .reductions import LocalReductions

SOLVED, EXACTLY = 0.1, 1e-6
"""What is left of the forces by inner conjugate gradients, and by those that stand in the place of a factor.

Restricted Schwarz alone, which exchanges less, was tried for few parts: a ring under pressure then takes 173 evaluations on two
ranks and 273 on three, where one takes 76 and conjugate gradients 78 on two."""

MOST_STEPS = 200


class SchwarzStiffness:
    """The stiffness of `NearestBondStiffness` of a body in parts, solved by the factors of the parts.

    A part's factor is that of its own points and of those in its halo that have all their nearest bonds here; the others are held.
    Conjugate gradients are preconditioned by the sum of what the factors say, and by the best of the motions in which every part is rigid.

    Parameters
    ----------
    body : Body
        A part.
    shear_moduli : float or ndarray, shape (n,)
    free : ndarray, shape (n, d)
        Zero on the halo.
    reductions : LocalReductions

    References
    ----------
    Toselli and Widlund, Domain Decomposition Methods (2005), ch. 3.
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, free: np.ndarray, reductions: LocalReductions) -> None:
        part, n, d = body.part, len(body), body.dimension
        self._part, self._reductions, self._shape, self._moduli = part, reductions, (n, d), shear_moduli
        self._matrix, self._free = spring_matrix(body, shear_moduli), free
        around = free.copy()
        part.fill(around)
        first, second, _ = springs(body, shear_moduli)
        degrees = (np.bincount(first, minlength=n) + np.bincount(second[second < n], minlength=n)).astype(float)
        of_owners = degrees.copy()
        part.fill(of_owners)
        self._inside = around * (degrees == of_owners)[:, None]
        self._factor = factorised(self._matrix, self._inside.ravel())
        held = part.any_of((body.ghosts.parity < 0).any(axis=0))
        held |= part.any_of((around == 0).any(axis=0))
        self._drifting = [axis for axis in range(d) if not held[axis]]
        self._coarse: tuple[np.ndarray, np.ndarray] | None = None
        self._body = body

    def update(self) -> None:
        """It is the same in all states."""

    def solve(self, forces: np.ndarray, exactly: bool = False) -> np.ndarray:
        """Displacements under forces, shape (n, d), right on the points that are owned; exactly, as a factor of the whole body would."""
        # Of a body that drifts only balanced forces have an answer: others have conjugate gradients go on for ever.
        return self._balanced(self._iterated(self._balanced(forces * self._free), EXACTLY if exactly else SOLVED))

    def _balanced(self, values: np.ndarray) -> np.ndarray:
        """Values that are zero on the halo, less their mean along the axes along which nothing holds the body; changed in place."""
        for axis in self._drifting:
            values[:, axis] -= self._reductions.total(values[:, axis]) / self._reductions.total_size(len(values))
        self._part.clear(values)
        return values

    def response(
        self, body: Body, shear_moduli: float | np.ndarray, held: np.ndarray, planes: np.ndarray, turns: np.ndarray | None = None
    ) -> np.ndarray:
        """See `NearestBondStiffness.response`."""
        held = held.copy()
        self._part.fill(held)
        found = self.solve(forces_of_springs(body, shear_moduli, held, planes, turns), exactly=True) + held
        self._part.fill(found)
        return found

    def _local(self, forces: np.ndarray) -> np.ndarray:
        """What the factor of this part says of all its points."""
        forces = forces * self._free
        self._part.fill(forces)
        return self._factor.solve((forces * self._inside).ravel()).reshape(self._shape) * self._inside

    def _applied(self, displacements: np.ndarray) -> np.ndarray:
        """The stiffness times displacements."""
        self._part.fill(displacements)
        found = (self._matrix @ displacements.ravel()).reshape(self._shape) * self._free
        return found

    def _both_levels(self, forces: np.ndarray) -> np.ndarray:
        """Factors of all parts, and rigid motions of theirs."""
        found = self._local(forces)
        self._part.fold(found)
        modes, inverse = self._rigid()
        pulls = np.concatenate(self._part.everywhere(modes.T @ forces.ravel()))
        k = modes.shape[1]
        found += (modes @ (inverse @ pulls)[k * self._part.rank : k * (self._part.rank + 1)]).reshape(self._shape)
        return found * self._free

    def _rigid(self) -> tuple[np.ndarray, np.ndarray]:
        """Rigid motions of the own points as far as they are free, shape (d n, k), and the inverse stiffness of those of all parts."""
        if self._coarse is None:
            points, part, (n, d) = self._body.points, self._part, self._shape
            around = self._free.copy()
            part.fill(around)
            middle = np.stack(part.everywhere(points[part.own].mean(axis=0)))[part.owners]
            extent = self._reductions.extent(points)  # the same for all: each rank forms the motions of its neighbours as well
            arms = (points - middle) / extent
            motions = [np.broadcast_to(axis, (n, d)) for axis in np.eye(d)]
            for a, b in ((0, 1),) if d == 2 else ((0, 1), (1, 2), (2, 0)):
                turn = np.zeros((n, d))
                turn[:, a], turn[:, b] = -arms[:, b], arms[:, a]
                motions.append(turn)
            everyone = np.stack([(motion * around).ravel() for motion in motions], axis=1)
            k, count = len(motions), len(part.everywhere(0))
            own = everyone * np.repeat(part.own, d)[:, None]
            rows = np.zeros((k, k * count))
            for rank in np.unique(part.owners):
                theirs = sparse.csr_array(everyone * np.repeat(part.owners == rank, d)[:, None])
                rows[:, k * rank : k * (rank + 1)] = own.T @ (self._matrix @ theirs).toarray()
            stiffness = np.concatenate(part.everywhere(rows))
            self._coarse = own, np.linalg.pinv((stiffness + stiffness.T) / 2, rcond=1e-10, hermitian=True)
        return self._coarse

    def _iterated(self, forces: np.ndarray, left: float) -> np.ndarray:
        """Conjugate gradients, until no more than a share of the forces is left."""
        dot = self._reductions.dot
        found, rest = np.zeros(self._shape), forces.copy()
        better = self._both_levels(rest)
        direction, size = better.copy(), dot(rest, better)
        least = left * left * size
        for _ in range(MOST_STEPS):
            if not size > least:
                break
            image = self._applied(direction)
            share = size / dot(direction, image)
            found += share * direction
            rest -= share * image
            better = self._both_levels(rest)
            size, before = dot(rest, better), size
            direction = better + size / before * direction
        self._part.clear(found)
        return found
