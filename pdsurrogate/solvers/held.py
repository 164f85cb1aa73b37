"""Held parts of a body, and supports at places between points, which prescribe the mean
displacement of the nearest points.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..body import Body
from .rigid import displaced


@dataclass(frozen=True)
class Held:
    """Held part of a body: points or a reflection plane, some components of which have a prescribed
    motion.

    Attributes
    ----------
    name : str
        Name of the condition in messages.
    holder : int or None
        Number of the holder, a support reported in results, for which the force on this part
        counts; None where it is not reported.
    components : tuple of int
        Held components.
    motion : callable
        ``motion(parameter)`` returns the matrix [Q - I, c] of a rotation Q and a translation c,
        shape (d, d + 1), at a value of the parameter, or one for each of several values: a place X
        moves by u(X) = (Q - I) X + c. Only held components are read.
    points : ndarray of int, shape (k,)
        The held points; for a plane the points that have images in it.
    places : ndarray, shape (k, d) or (1, d)
        Undeformed places to which `motion` applies: the held points, their projections onto the
        plane, or the held place between points.
    angle : callable, optional
        Angle in degrees by which the part has turned at a value of the parameter; only for a part
        that turns, all components of it held.
    plane : int, optional
        Number of the reflection plane.
    others : ndarray of int, optional
        For a held place between points: the points as near to it as the one in `points`, which
        moves so that the mean displacement of all of them is the prescribed one; on several ranks
        only local points.
    count : int
        Number of points around a held place, the one in `points` and the others, on all ranks; 1
        without `others`.
    """

    name: str
    holder: int | None
    components: tuple[int, ...]
    motion: Callable[[float | np.ndarray], np.ndarray]
    points: np.ndarray
    places: np.ndarray
    angle: Callable[[float], float] | None = None
    plane: int | None = None
    others: np.ndarray | None = None
    count: int = 1

    @property
    def every(self) -> np.ndarray:
        """Return the numbers of all held points, including those in `others`."""
        return self.points if self.others is None else np.concatenate([self.points, self.others])


class Support:
    """Support at a place between points: one point moves so that the mean displacement of the
    points around is the prescribed one.

    The force on that point is passed to the others: with the prescribed mean g its displacement is
    u_0 = count g - sum u_k, and the work per displacement u_k of another point is f_k - f_0, as for
    a body that is held by forces at the place itself.

    Parameters
    ----------
    body : Body
    part : Held
        Held part with `others`.

    Attributes
    ----------
    response : callable
        Function that returns the displacements of the body, shape (n, d), caused by displacements
        (n, d) of held components; set by the caller.
    """

    response: Callable[[np.ndarray], np.ndarray]

    def __init__(self, body: Body, part: Held) -> None:
        self._body = body
        self._part = part
        # with the components they index arrays (n, d)
        self._point = part.points[:, None]
        self._others = part.others[:, None]
        self.set(0.0)

    def set(self, parameter: float) -> None:
        """Set the mean displacement to prescribe to its value at a loading parameter."""
        self._goal = displaced(self._part.motion(parameter), self._part.places)[0]

    def place(self, positions: np.ndarray) -> None:
        """Move the held point, in `positions`, to where the mean displacement of it and the
        others is the prescribed one.
        """
        self._body.share.fill(positions)
        part = self._part
        at_rest = self._body.points
        if (
            len(part.others) == part.count - 1
        ):  # on another rank there may be fewer, and a copy of the held point
            moved = (positions[part.others] - at_rest[part.others]).sum(axis=0)
            placed = at_rest[part.points] + part.count * self._goal - moved
            positions[self._point, part.components] = placed[:, part.components]

    def fold(self, forces: np.ndarray) -> None:
        """Subtract the force on the held point from the force on each other point around the
        place, in `forces` (n, d), in place.
        """
        forces[self._others, self._part.components] -= self._at_point(forces)

    def spread(self, reactions: np.ndarray) -> None:
        """Copy the reaction at the held point to the other points around the place; `reactions`
        (n, d) is changed in place.
        """
        reactions[self._others, self._part.components] = self._at_point(reactions)

    def _at_point(self, values: np.ndarray) -> np.ndarray:
        """Return, on all ranks, the held components of the values (n, d) at the held point,
        which one rank owns.
        """
        own = self._part.points[self._body.share.own[self._part.points]]
        return self._body.share.total(values[own].sum(axis=0))[list(self._part.components)]

    def fields(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return, for each held component, the weights (n, d) of the mean displacement, and a
        displacement field (n, d) with the mean 1.

        The field is a multiple of the response of the body to a displacement of the held point.
        With weights w and field v, the map u - v (w . u) removes the mean displacement from
        displacements u, as the preconditioner `supported` needs.
        """
        found = []
        for component in self._part.components:
            moved, weights = np.zeros((2, *self._body.points.shape))
            moved[self._part.points, component] = 1.0
            weights[self._part.every, component] = 1 / self._part.count
            follows = self.response(moved)
            found.append((weights, follows / self._body.share.dot(weights, follows)))
        return found
