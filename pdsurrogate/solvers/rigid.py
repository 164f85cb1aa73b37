"""Regions that move as one body: their forces are resultants, their displacements three or six numbers (theory (63))."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy import sparse

from ..body import Body
from ..forces import InvalidState
from .loads import LoadedForce
from .multigrid import factor_of
from .nearest_bonds import Preconditioner, Springs, held_matrix
from .rigid_motions import moment_of, nearest_turn, rigid_motions, rotation_of, turn_by

MOST_STEPS = 30
"""Maximum number of Newton steps that bring a region to the places of its held components; from the last state two or three suffice."""

HELD = 1e-6
"""Distance of held components from every rigid placement of the region, relative to its size, beyond which they are rejected."""

INDEPENDENT = 1e-9
"""Singular value of the held components, over the greatest, below which a motion of the region is free."""


class RigidRegion:
    """Some points of a body that keep their distances.

    Parameters
    ----------
    name : str
        In results and messages.
    body : Body
    points : ndarray of int
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.

    Attributes
    ----------
    name, points
    size : float
        Radius of gyration, by which turns are measured.
    """

    def __init__(self, name: str, body: Body, points: np.ndarray, free: np.ndarray) -> None:
        self.name, self.points = name, points
        self._volumes = body.volumes[points]
        self._middle = self._volumes @ body.points[points] / self._volumes.sum()
        self._arms = body.points[points] - self._middle
        self.size = float(np.sqrt(self._volumes @ (self._arms**2).sum(axis=1) / self._volumes.sum()))
        self._held = np.nonzero(free[points] == 0)

    @property
    def n_motions(self) -> int:
        """Number of rigid translations and rotations: 3 in the plane, 6 in three dimensions."""
        return 3 if self._arms.shape[1] == 2 else 6

    @property
    def all_held(self) -> bool:
        """True if no motion of the region is free at rest."""
        return len(self._free_motions(self.motions(self._middle + self._arms)).T) == 0

    def snap(self, positions: np.ndarray) -> None:
        """Move the region to the nearest rigid placement in which held components have their given positions.

        Raises
        ------
        InvalidState
            If no such placement exists.
        """
        given = positions[self.points]
        goals = given[self._held]
        middle = self._volumes @ given / self._volumes.sum()
        turn = nearest_turn((given - middle).T @ (self._volumes[:, None] * self._arms))
        for _ in range(MOST_STEPS):
            placed = middle + self._arms @ turn.T
            left = goals - placed[self._held]
            if np.abs(left).max(initial=0.0) <= 1e-14 * self.size:
                break
            step = np.linalg.lstsq(self.motions(placed)[self._held], left, rcond=INDEPENDENT)[0]
            d = len(middle)
            middle, turn = middle + step[:d], turn_by(step[d:] / self.size) @ turn
        if np.abs(left).max(initial=0.0) > HELD * self.size:
            raise InvalidState(
                f"{self.name} is rigid, and what is prescribed moves its points apart: by {np.abs(left).max():.3g} from any place that it "
                "can take as one body"
            )
        positions[self.points] = placed
        positions[self.points[self._held[0]], self._held[1]] = goals

    def motions(self, placed: np.ndarray) -> np.ndarray:
        """Return displacements of points (k, d) by translations, then by turns about their middle over `size`, shape (k, d, motions)."""
        return rigid_motions((placed - self._volumes @ placed / self._volumes.sum()) / self.size)

    def _free_motions(self, motions: np.ndarray) -> np.ndarray:
        """Return the orthonormal motions that leave held components in place, as columns."""
        held = motions[self._held]
        if not len(held):
            return np.eye(self.n_motions)
        _, sizes, directions = np.linalg.svd(np.linalg.qr(held, mode="r"), full_matrices=True)
        sizes = np.concatenate([sizes, np.zeros(self.n_motions - len(sizes))])
        return directions[sizes <= INDEPENDENT * sizes.max()].T

    def describe(self, positions: np.ndarray, forces: np.ndarray) -> dict:
        """Return, for results, force and moment about the origin of forces (n, d) on the region, and its displacement and rotation.

        The displacement is that of its middle; the rotation is in degrees, in three dimensions a vector along the axis.
        """
        placed, forces = positions[self.points], forces[self.points]
        middle = self._volumes @ placed / self._volumes.sum()
        turn = nearest_turn((placed - middle).T @ (self._volumes[:, None] * self._arms))
        return {
            "force": forces.sum(axis=0).tolist(),
            "moment": moment_of(forces.T @ placed).tolist(),
            "displacement": (middle - self._middle).tolist(),
            "rotation": np.degrees(rotation_of(turn)).tolist(),
        }

    def take(self, placed: np.ndarray) -> None:
        """Set the places (k, d) at which later calls carry forces and expand displacements."""
        self._motions = self.motions(placed)
        free = self._free_motions(self._motions)
        self.projector = free @ free.T
        by_volume = np.einsum("kdm,k,kdn->mn", self._motions, self._volumes, self._motions)
        self._spread = free @ np.linalg.solve(free.T @ by_volume @ free, free.T)
        self._by_volume = by_volume

    def resultant(self, forces: np.ndarray) -> np.ndarray:
        """Return force, and moment about the middle over `size`, of forces (k, d) on the points."""
        return np.einsum("kdm,kd->m", self._motions, forces)

    def expand(self, motion: np.ndarray) -> np.ndarray:
        """Return the displacements of the points, shape (k, d), in a motion."""
        return self._motions @ motion

    def carry(self, positions: np.ndarray, forces: np.ndarray) -> None:
        """Replace forces on the region's points at given positions, both (n, d), in place.

        The new forces have the same resultant and accelerate all points as a rigid body. The part of the resultant that held components
        bear is on these components, as the least forces that balance it.
        """
        self.take(positions[self.points])
        resultant = self.resultant(forces[self.points])
        motion = self._spread @ resultant
        carried = self._volumes[:, None] * self.expand(motion)
        if len(self._held[0]):
            left = resultant - self._by_volume @ motion
            carried[self._held] += np.linalg.lstsq(self._motions[self._held].T, left, rcond=INDEPENDENT)[0]
        forces[self.points] = carried


class RigidStiffness(Preconditioner):
    """The stiffness of the springs along and across the nearest bonds, for the motions of rigid regions and the points of the rest.

    Parameters
    ----------
    force : LoadedForce
        With rigid regions.
    free : ndarray, shape (n, d)
        1 where a component may move.
    """

    def __init__(self, force: LoadedForce, free: np.ndarray) -> None:
        body, self._regions = force.body, force.rigid
        n, d = free.shape
        inside, kept = np.zeros(n, dtype=bool), free.copy()
        columns, motions_free = [], []
        for region in self._regions:
            inside[region.points], kept[region.points] = True, 0
            motions = np.zeros((n, d, region.n_motions))
            motions[region.points] = region.motions(body.points[region.points])
            columns.append(sparse.csr_array(motions.reshape(d * n, -1)))
            motions_free.append(np.full(region.n_motions, 0.0 if region.all_held else 1.0))
        by_motion = sparse.hstack([sparse.diags_array(np.repeat(1.0 - inside, d)), *columns], format="csr")
        ends = np.cumsum([d * n, *(region.n_motions for region in self._regions)])
        self._places = [slice(*span) for span in pairwise(ends)]
        self._free = np.concatenate([kept.ravel(), *motions_free])
        matrix = by_motion.T @ Springs(body, force.stiffness_moduli).matrix(inside) @ by_motion
        self._factor = factor_of(held_matrix(matrix.tocsc(), self._free))

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements under forces, shape (n, d)."""
        size = forces.size
        reduced = np.concatenate([forces.ravel(), *(r.projector @ r.resultant(forces[r.points]) for r in self._regions)])
        found = self._factor.solve(reduced * self._free) * self._free
        displacements = found[:size].reshape(forces.shape)
        for region, place in zip(self._regions, self._places, strict=True):
            displacements[region.points] = region.expand(region.projector @ found[place])
        return displacements
