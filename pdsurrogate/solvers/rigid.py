"""Rigid motions, and regions that move as one body: their forces are resultants, their displacements three or six numbers (theory (63))."""

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

from ..body import Body
from ..forces import InvalidState
from .multigrid import factor_of
from .nearest_bonds import Preconditioner, held_matrix, springs_of

MOST_STEPS = 30
"""Maximum number of Newton steps that bring a region to the places of its held components; from the last state two or three suffice."""

HELD = 1e-6
"""Distance of held components from every rigid placement of the region, relative to its size, beyond which they are rejected."""

INDEPENDENT = 1e-9
"""Singular value of the held components, over the greatest, below which a motion of the region is free."""


TURNS = {2: ((0, 1),), 3: ((1, 2), (2, 0), (0, 1))}
"""Axes that each turn of a body moves along: from the first to the second."""


def displaced(motions: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the displacements of places (k, d) by one motion [Q - I, c], shape (d, d + 1), or by one for each place (k, d, d + 1)."""
    return (motions[..., :-1] @ places[..., None])[..., 0] + motions[..., -1]


def rigid_motions(arms: np.ndarray) -> np.ndarray:
    """Return the displacements of places at arms (k, d), shape (k, d, motions), by d translations and then the turns of `TURNS`."""
    count, d = arms.shape
    found = np.zeros((count, d, d + len(TURNS[d])))
    found[:, range(d), range(d)] = 1.0
    for number, (a, b) in enumerate(TURNS[d], d):
        found[:, a, number], found[:, b, number] = -arms[:, b], arms[:, a]
    return found


def moment_of(levers: np.ndarray) -> np.ndarray:
    """Return the moments of sums of f (x) y, shape (..., d, d): (...,) counter-clockwise in the plane, (..., 3) in three dimensions."""
    moments = np.stack([levers[..., b, a] - levers[..., a, b] for a, b in TURNS[levers.shape[-1]]], axis=-1)
    return moments[..., 0] if levers.shape[-1] == 2 else moments


def turn_by(vector: np.ndarray) -> np.ndarray:
    """Return the rotation by an angle in the plane (1,), or by a vector along its axis in three dimensions (3,)."""
    if len(vector) == 3:
        return Rotation.from_rotvec(vector).as_matrix()
    cosine, sine = np.cos(vector[0]), np.sin(vector[0])
    return np.array([[cosine, -sine], [sine, cosine]])


def rotation_of(turn: np.ndarray) -> np.ndarray:
    """Return the angle of a rotation in the plane; in three dimensions the vector of that length along its axis."""
    if len(turn) == 2:
        return np.arctan2(turn[1, 0], turn[0, 0])
    return Rotation.from_matrix(turn).as_rotvec()


def nearest_turn(matrix: np.ndarray) -> np.ndarray:
    """Return the rotation nearest to a matrix, shape (d, d)."""
    U, _, V = np.linalg.svd(matrix)
    U[:, -1] *= np.sign(np.linalg.det(U @ V))
    return U @ V


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

    def snap(self, positions: np.ndarray) -> None:
        """Move the region to the nearest rigid placement in which held components have their given positions.

        Raises
        ------
        InvalidState
            If no such placement exists.
        """
        given = positions[self.points]
        goals = given[self._held]
        middle, turn = self._placement(given)
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

    def _placement(self, placed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the middle of the region and its rotation, with its points at given places (k, d)."""
        middle = self._volumes @ placed / self._volumes.sum()
        return middle, nearest_turn((placed - middle).T @ (self._volumes[:, None] * self._arms))

    def free_motions(self, motions: np.ndarray) -> np.ndarray:
        """Return the orthonormal motions that leave held components in place, as columns."""
        held = motions[self._held]
        return null_space(np.linalg.qr(held, mode="r"), rcond=INDEPENDENT) if len(held) else np.eye(motions.shape[-1])

    def describe(self, positions: np.ndarray, forces: np.ndarray) -> dict:
        """Return, for results, force and moment about the origin of forces (n, d) on the region, and its displacement and rotation.

        The displacement is that of its middle; the rotation is in degrees, in three dimensions a vector along the axis.
        """
        placed, forces = positions[self.points], forces[self.points]
        middle, turn = self._placement(placed)
        return {
            "force": forces.sum(axis=0).tolist(),
            "moment": moment_of(forces.T @ placed).tolist(),
            "displacement": (middle - self._middle).tolist(),
            "rotation": np.degrees(rotation_of(turn)).tolist(),
        }

    def resultant(self, forces: np.ndarray) -> np.ndarray:
        """Return force, and moment about the middle over `size`, of forces (k, d) on the points."""
        return np.einsum("kdm,kd->m", self._motions, forces)

    def expand(self, motion: np.ndarray) -> np.ndarray:
        """Return the displacements of the points, shape (k, d), in a motion."""
        return self._motions @ motion

    def carry(self, positions: np.ndarray, forces: np.ndarray) -> None:
        """Replace forces on the region's points at given positions, both (n, d), in place.

        The new forces have the same resultant and accelerate all points as a rigid body. The part of the resultant that held components
        bear is on these components, as the least forces that balance it. Later calls of `resultant` and `expand` refer to these positions.
        """
        self._motions = self.motions(positions[self.points])
        free = self.free_motions(self._motions)
        self.projector = free @ free.T
        by_volume = np.einsum("kdm,k,kdn->mn", self._motions, self._volumes, self._motions)
        resultant = self.resultant(forces[self.points])
        motion = free @ np.linalg.solve(free.T @ by_volume @ free, free.T) @ resultant
        carried = self._volumes[:, None] * self.expand(motion)
        if len(self._held[0]):
            left = resultant - by_volume @ motion
            carried[self._held] += np.linalg.lstsq(self._motions[self._held].T, left, rcond=INDEPENDENT)[0]
        forces[self.points] = carried


def inverse_with_regions(body: Body, shear_moduli: float | np.ndarray, free: np.ndarray, regions: Sequence[RigidRegion]) -> Preconditioner:
    """Return the inverse of `springs_of` a body for the motions of rigid regions and the points of the rest.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
    free : ndarray, shape (n, d)
        1 where a component may move.
    regions : sequence of RigidRegion
    """
    n, d = free.shape
    inside, kept = np.zeros(n, dtype=bool), free.copy()
    columns, motions_free = [], []
    for region in regions:
        inside[region.points], kept[region.points] = True, 0
        own = region.motions(body.points[region.points])
        motions = np.zeros((n, *own.shape[1:]))
        motions[region.points] = own
        columns.append(sparse.csr_array(motions.reshape(d * n, -1)))
        motions_free.append(np.full(own.shape[-1], float(region.free_motions(own).any())))
    by_motion = sparse.hstack([sparse.diags_array(np.repeat(1.0 - inside, d)), *columns], format="csr")
    column = np.concatenate([kept.ravel(), *motions_free])
    matrix = by_motion.T @ springs_of(body, shear_moduli).matrix(inside) @ by_motion
    factor = factor_of(held_matrix(matrix.tocsc(), column))

    def solve(forces: np.ndarray) -> np.ndarray:
        motions = [region.projector @ region.resultant(forces[region.points]) for region in regions]
        found = factor.solve(np.concatenate([forces.ravel(), *motions]) * column) * column
        displacements, *of_regions = np.split(found, forces.size + np.cumsum([0, *map(len, motions)])[:-1])
        displacements = displacements.reshape(forces.shape)
        for region, motion in zip(regions, of_regions, strict=True):
            displacements[region.points] = region.expand(region.projector @ motion)
        return displacements

    return Preconditioner(solve)
