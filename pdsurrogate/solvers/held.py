"""Held parts of a body, and those at places between points, where the points that are equally near move in the mean as is prescribed."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

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


class Supports:
    """The places between points that are held: they move their held points in every state, and hand the forces on these to the others.

    With u_0 = count g - sum u_k the energy's derivative by u_k is f_k - f_0, as of a body that is held by forces at the place itself.

    Parameters
    ----------
    body : Body
    parts : sequence of Held
        Those between points.

    Attributes
    ----------
    response : callable
        Displacements of the body, shape (n, d), about where held components are displaced by (n, d); set by the conditions of the body.
    """

    def __init__(self, body: Body, parts: list[Held]) -> None:
        self._body, self.share, self._parts = body, body.share, parts
        self.response: Callable[[np.ndarray], np.ndarray]
        self.set(0.0)

    def set(self, parameter: float) -> None:
        """Set the prescribed displacements at a value of the loading parameter."""
        self._goals = [displaced(part.motion(parameter), part.places)[0] for part in self._parts]

    def place(self, positions: np.ndarray) -> None:
        """Move the held points to where the others leave them."""
        self.share.fill(positions)
        for part, goal in zip(self._parts, self._goals, strict=True):
            if len(part.others) == part.count - 1:  # on another rank there may be fewer, and a copy of the held point
                moved = (positions[part.others] - self._body.points[part.others]).sum(axis=0)
                placed = self._body.points[part.points] + part.count * goal - moved
                positions[part.points[:, None], part.components] = placed[:, part.components]

    def fold(self, forces: np.ndarray) -> None:
        """Hand the forces on held points to the others."""
        self.share.fill(forces)
        for part in self._parts:
            if len(part.points):
                forces[part.others[:, None], part.components] -= forces[part.points[:, None], part.components]

    def spread(self, reactions: np.ndarray) -> None:
        """Copy the reactions at held points to the others."""
        self.share.fill(reactions)
        for part in self._parts:
            if len(part.points):
                reactions[part.others[:, None], part.components] = reactions[part.points[:, None], part.components]

    @cached_property
    def fields(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Weights (n, d) of the mean and response of the body to the held point, scaled to a mean of 1, by support and component."""
        found = []
        for part in self._parts:
            for component in part.components:
                moved, weights = np.zeros((2, *self._body.points.shape))
                moved[part.points, component] = 1.0
                weights[part.every, component] = 1 / part.count
                follows = self.response(moved)
                found.append((weights, follows / self.share.dot(weights, follows)))
        return found
