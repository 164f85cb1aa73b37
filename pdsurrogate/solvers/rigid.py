"""Rigid motions, and regions of a body that move as one, with three or six degrees of freedom
each (theory (63)).
"""

from collections.abc import Sequence

import numpy as np
import scipy

from ..body import Body
from ..forces import InvalidState
from .multigrid import factor_of
from .nearest_bonds import NearestBonds, Preconditioner, held_matrix

MOST_STEPS = 30
"""Maximum number of Newton steps to place a rigid region by its held components; from the last
state two or three suffice.
"""

HELD = 1e-6
"""Distance between prescribed positions and a rigid placement, divided by the size of the region,
above which an error is raised. Chosen: values that a user writes with seven digits still count as a
rigid motion; Newton's method ends at 1e-14.
"""

INDEPENDENT = 1e-9
"""Singular value of the rigid motions at held components, divided by the greatest, below which a
motion of a region counts as free. Chosen between rounding, 1e-16, and the value of two points a
thousandth of the region apart, 1e-3.
"""


TURNS = {2: ((0, 1),), 3: ((1, 2), (2, 0), (0, 1))}
"""Rotations of a body, by dimension: each as the axes (a, b) of a turn from a toward b."""


def displaced(motions: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the displacements u(X) = (Q - I) X + c of places X (k, d) in a motion [Q - I, c] of
    rotation Q and translation c.

    The shape of `motions` is (d, d + 1) for one motion of all places, or (k, d, d + 1) for one of
    each place.
    """
    return (motions[..., :-1] @ places[..., None])[..., 0] + motions[..., -1]


def rigid_motions(arms: np.ndarray) -> np.ndarray:
    """Return the displacements, shape (k, d, motions), in each infinitesimal rigid motion, of
    places at `arms` (k, d) from the center.

    The motions are d translations along the axes, and then the rotations `TURNS` by a unit angle.
    """
    count, d = arms.shape
    found = np.zeros((count, d, d + len(TURNS[d])))
    found[:, range(d), range(d)] = 1.0
    for number, (a, b) in enumerate(TURNS[d], d):
        found[:, a, number], found[:, b, number] = -arms[:, b], arms[:, a]
    return found


def moment_of(levers: np.ndarray) -> np.ndarray:
    """Return the moments of forces f at places y from the sums of their outer products f (x) y,
    shape (..., d, d).

    The shape is (...,) in the plane, where moments are counter-clockwise, and (..., 3) in three
    dimensions.
    """
    moments = np.stack(
        [levers[..., b, a] - levers[..., a, b] for a, b in TURNS[levers.shape[-1]]], axis=-1
    )
    return moments[..., 0] if levers.shape[-1] == 2 else moments


def turn_by(vector: np.ndarray) -> np.ndarray:
    """Return the rotation matrix for an angle in the plane, shape (1,), or for a rotation vector
    in three dimensions, shape (3,).
    """
    if len(vector) == 3:
        return scipy.spatial.transform.Rotation.from_rotvec(vector).as_matrix()
    cosine = np.cos(vector[0])
    sine = np.sin(vector[0])
    return np.array([[cosine, -sine], [sine, cosine]])


def rotation_of(turn: np.ndarray) -> np.ndarray:
    """Return the angle of a rotation matrix in the plane, or its rotation vector (3,) in three
    dimensions, in radians.
    """
    if len(turn) == 2:
        return np.arctan2(turn[1, 0], turn[0, 0])
    return scipy.spatial.transform.Rotation.from_matrix(turn).as_rotvec()


def nearest_turn(matrix: np.ndarray) -> np.ndarray:
    """Return the rotation matrix nearest to a given matrix, shape (d, d)."""
    U, _, V = np.linalg.svd(matrix)
    U[:, -1] *= np.sign(np.linalg.det(U @ V))
    return U @ V


def rigid_placement(
    arms: np.ndarray,
    held: tuple[np.ndarray, ...],
    goals: np.ndarray,
    middle: np.ndarray,
    turn: np.ndarray,
    size: float,
) -> tuple[np.ndarray, float]:
    """Return the rigid placement in which `held` components are nearest to their `goals`, and the
    greatest distance left between both.

    The placement is that of `arms` (k, d) from a center; the search begins with the center at
    `middle` (d,) and the rotation `turn` (d, d). `size` is the extent of the arms.
    """
    for _ in range(MOST_STEPS):
        turned = arms @ turn.T
        left = goals - (middle + turned)[held]
        if np.abs(left).max(initial=0.0) <= 1e-14 * size:
            break
        step = np.linalg.lstsq(rigid_motions(turned / size)[held], left, rcond=INDEPENDENT)[0]
        d = len(middle)
        middle = middle + step[:d]
        turn = turn_by(step[d:] / size) @ turn
    return middle + turned, float(np.abs(left).max(initial=0.0))


class RigidRegion:
    """Rigid region of a body: points that keep their mutual distances.

    Parameters
    ----------
    name : str
        Name of the region in results and messages.
    body : Body
    points : ndarray of int
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.

    Attributes
    ----------
    name, points
    size : float
        Radius of gyration; rotations are measured as angle times this length.
    """

    def __init__(self, name: str, body: Body, points: np.ndarray, free: np.ndarray) -> None:
        self.name = name
        self.points = points
        self._volumes = body.volumes[points]
        self._middle = self._volumes @ body.points[points] / self._volumes.sum()
        self._arms = body.points[points] - self._middle
        self.size = float(
            np.sqrt(self._volumes @ (self._arms**2).sum(axis=1) / self._volumes.sum())
        )
        self._held = np.nonzero(free[points] == 0)

    def snap(self, positions: np.ndarray) -> None:
        """Move the region's points, in `positions`, to the nearest rigid placement in which held
        components keep their positions.

        Raises
        ------
        InvalidState
            If no such placement exists.
        """
        given = positions[self.points]
        goals = given[self._held]
        placed, left = rigid_placement(
            self._arms, self._held, goals, *self._placement(given), self.size
        )
        if left > HELD * self.size:
            raise InvalidState(
                f"{self.name} is rigid, but is prescribed to deform: its points move by {left:.3g}"
                " apart"
            )
        positions[self.points] = placed
        positions[self.points[self._held[0]], self._held[1]] = goals

    def motions(self, placed: np.ndarray) -> np.ndarray:
        """Return the displacements, shape (k, d, motions), of the region's points at places (k, d)
        in each linear rigid motion.

        The motions are unit translations, then rotations about the center of volume by the angle
        1/`size`.
        """
        return rigid_motions((placed - self._volumes @ placed / self._volumes.sum()) / self.size)

    def _placement(self, placed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the center of volume (d,) and the rotation (d, d) of the region, from the
        places (k, d) of its points.
        """
        middle = self._volumes @ placed / self._volumes.sum()
        return middle, nearest_turn((placed - middle).T @ (self._volumes[:, None] * self._arms))

    def free_motions(self, motions: np.ndarray) -> np.ndarray:
        """Return, as columns, orthonormal vectors of amplitudes of the `motions` (k, d, motions)
        that do not move held components.
        """
        held = motions[self._held]
        return (
            scipy.linalg.null_space(np.linalg.qr(held, mode="r"), rcond=INDEPENDENT)
            if len(held)
            else np.eye(motions.shape[-1])
        )

    def describe(self, positions: np.ndarray, forces: np.ndarray) -> dict:
        """Return, for results, the total force and moment about the origin of forces (n, d) on the
        region, and how the region has moved.

        The displacement is that of the center of volume; the rotation is in degrees, in three
        dimensions a rotation vector.
        """
        placed = positions[self.points]
        forces = forces[self.points]
        middle, turn = self._placement(placed)
        return {
            "force": forces.sum(axis=0).tolist(),
            "moment": moment_of(forces.T @ placed).tolist(),
            "displacement": (middle - self._middle).tolist(),
            "rotation": np.degrees(rotation_of(turn)).tolist(),
        }

    def resultant(self, forces: np.ndarray) -> np.ndarray:
        """Return the resultant of forces (k, d) on the region's points: force, and moment about
        the center of volume divided by `size`.
        """
        return np.einsum("kdm,kd->m", self._motions, forces)

    def expand(self, motion: np.ndarray) -> np.ndarray:
        """Return the displacements of the region's points, shape (k, d), from the amplitudes of
        its rigid motions.
        """
        return self._motions @ motion

    def carry(self, positions: np.ndarray, forces: np.ndarray) -> None:
        """Replace the forces on the region's points, in place, by forces of equal resultant that
        accelerate it as a rigid body.

        The part of the resultant that held components bear is put on these components, as the
        forces of least sum of squares with this resultant. Later calls of `resultant` and `expand`
        use the rigid motions at these positions. Both arguments have the shape (n, d).
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
            carried[self._held] += np.linalg.lstsq(
                self._motions[self._held].T, left, rcond=INDEPENDENT
            )[0]
        forces[self.points] = carried


def inverse_with_regions(
    network: NearestBonds, free: np.ndarray, regions: Sequence[RigidRegion]
) -> Preconditioner:
    """Return the preconditioner of a body with rigid regions: the inverse of a network of springs,
    with regions that move rigidly.

    Parameters
    ----------
    network : NearestBonds
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.
    regions : sequence of RigidRegion
    """
    n, d = free.shape
    inside = np.zeros(n, dtype=bool)
    kept = free.copy()
    columns = []
    motions_free = []
    for region in regions:
        inside[region.points] = True
        kept[region.points] = 0
        own = region.motions(network.body.points[region.points])
        motions = np.zeros((n, *own.shape[1:]))
        motions[region.points] = own
        columns.append(scipy.sparse.csr_array(motions.reshape(d * n, -1)))
        motions_free.append(np.full(own.shape[-1], float(region.free_motions(own).any())))
    by_motion = scipy.sparse.hstack(
        [scipy.sparse.diags_array(np.repeat(1.0 - inside, d)), *columns], format="csr"
    )
    column = np.concatenate([kept.ravel(), *motions_free])
    matrix = by_motion.T @ scipy.sparse.csc_array(network.matrix(inside)) @ by_motion
    factor = factor_of(held_matrix(matrix.tocsc(), column))

    def solve(forces: np.ndarray) -> np.ndarray:
        motions = [region.projector @ region.resultant(forces[region.points]) for region in regions]
        found = factor.solve(np.concatenate([forces.ravel(), *motions]) * column) * column
        displacements, *of_regions = np.split(
            found, forces.size + np.cumsum([0, *map(len, motions)])[:-1]
        )
        displacements = displacements.reshape(forces.shape)
        for region, motion in zip(regions, of_regions, strict=True):
            displacements[region.points] = region.expand(region.projector @ motion)
        return displacements

    return Preconditioner(solve)
