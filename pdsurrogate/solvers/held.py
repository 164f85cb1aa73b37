"""Held parts of a body, and those at places between points, where the points that are equally near move in the mean as is prescribed."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..body import Body
from .rigid import displaced


@dataclass(frozen=True)
class Held:
    """Points, or a plane of reflection, some components of which follow the loading parameter.

    Attributes
    ----------
    name : str
        Name of the condition in messages.
    holder : int or None
        Number of the holder that its force counts for; None where results do not report it.
    components : tuple of int
    motion : callable
        [Q - I, c] at a value of the parameter, shape (d, d + 1): a place X moves by u(X) = (Q - I) X + c. Only held components are read.
    points : ndarray of int, shape (k,)
        The points; of a plane those that have images in it.
    places : ndarray, shape (k, d) or (1, d)
        Places at rest that move so: those of the points, their feet on the plane, or the place between points that is held.
    angle : callable, optional
        Angle in degrees by which the part has turned at a value of the parameter, of one that turns; all its components are held.
    plane : int, optional
        Number of the plane.
    others : ndarray of int, optional
        For a place between points: those that are as near to it as the one in `points`, which moves so that the mean displacement of all
        is the prescribed one; on several ranks only the local ones.
    count : int
        Number of all these points on all ranks.
    """

    name: str
    holder: int | None
    components: tuple[int, ...]
    motion: Callable[[float], np.ndarray]
    points: np.ndarray
    places: np.ndarray
    angle: Callable[[float], float] | None = None
    plane: int | None = None
    others: np.ndarray | None = None
    count: int = 1

    @property
    def every(self) -> np.ndarray:
        """Return the points, and for a place between points also the others that are equally near."""
        return self.points if self.others is None else np.concatenate([self.points, self.others])


class Support:
    """A held place between points: it moves its held point in every state, and hands the force on this to the others.

    With u_0 = count g - sum u_k the energy's derivative by u_k is f_k - f_0, as of a body that is held by forces at the place itself.

    Parameters
    ----------
    body : Body
    part : Held

    Attributes
    ----------
    response : callable
        Displacements of the body, shape (n, d), about where held components are displaced by (n, d); set by the conditions of the body.
    """

    response: Callable[[np.ndarray], np.ndarray]

    def __init__(self, body: Body, part: Held) -> None:
        self._body, self._part = body, part
        self._point, self._others = part.points[:, None], part.others[:, None]  # with the components they index arrays (n, d)
        self.set(0.0)

    def set(self, parameter: float) -> None:
        """Set the prescribed displacement at a value of the loading parameter."""
        self._goal = displaced(self._part.motion(parameter), self._part.places)[0]

    def place(self, positions: np.ndarray) -> None:
        """Move the held point to where the others leave it."""
        self._body.share.fill(positions)
        part, at_rest = self._part, self._body.points
        if len(part.others) == part.count - 1:  # on another rank there may be fewer, and a copy of the held point
            moved = (positions[part.others] - at_rest[part.others]).sum(axis=0)
            placed = at_rest[part.points] + part.count * self._goal - moved
            positions[self._point, part.components] = placed[:, part.components]

    def fold(self, forces: np.ndarray) -> None:
        """Hand the force on the held point to the others."""
        self._body.share.fill(forces)
        if len(self._point):
            forces[self._others, self._part.components] -= forces[self._point, self._part.components]

    def spread(self, reactions: np.ndarray) -> None:
        """Copy the reaction at the held point to the others."""
        self._body.share.fill(reactions)
        if len(self._point):
            reactions[self._others, self._part.components] = reactions[self._point, self._part.components]

    def fields(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return weights (n, d) of the mean and response of the body to the held point, scaled to a mean of 1, by component."""
        found = []
        for component in self._part.components:
            moved, weights = np.zeros((2, *self._body.points.shape))
            moved[self._part.points, component] = 1.0
            weights[self._part.every, component] = 1 / self._part.count
            follows = self.response(moved)
            found.append((weights, follows / self._body.share.dot(weights, follows)))
        return found
