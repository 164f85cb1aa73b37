"""Rigid motions: displacements of places, rotations, moments."""

import numpy as np
from scipy.spatial.transform import Rotation

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
