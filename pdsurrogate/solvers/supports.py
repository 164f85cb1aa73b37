"""Supports at places between points: the points that are equally near to a place move in the mean as is prescribed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..body import Body
from .nearest_bonds import Preconditioner
from .rigid_motions import displaced

if TYPE_CHECKING:
    from .conditions import Held


@dataclass(frozen=True)
class SupportAtPlace:
    """Support of the points equally near to a place, one of which moves so that their mean displacement is the prescribed one.

    Attributes
    ----------
    place : ndarray, shape (d,)
        Mean of their places at rest.
    count : int
        Number of these points.
    others : ndarray of int, shape (count - 1,)
        All points but the held one; on several ranks only the local ones.
    """

    place: np.ndarray
    count: int
    others: np.ndarray


class Supports:
    """The supports at places of a body: they move their held points in every state, and hand the forces on these to the others.

    With u_0 = count g - sum u_k the energy's derivative by u_k is f_k - f_0, as of a body that is held by forces at the place itself.

    Parameters
    ----------
    body : Body
    parts : sequence of Held
        Those with a support.

    Attributes
    ----------
    response : callable
        Displacements of the body, shape (n, d), about where held components are displaced by (n, d); set by the conditions of the body.
    """

    def __init__(self, body: Body, parts: tuple[Held, ...]) -> None:
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
            others = part.support.others
            if len(others) == part.support.count - 1:  # on another rank there may be fewer, and a copy of the held point
                for component in part.components:
                    moved = positions[others, component] - self._body.points[others, component]
                    target = part.support.count * goal[component] - moved.sum()
                    positions[part.points, component] = self._body.points[part.points, component] + target

    def fold(self, forces: np.ndarray) -> None:
        """Hand the forces on held points to the others."""
        self.share.fill(forces)
        for part in self._parts:
            for component in part.components if len(part.points) else ():
                forces[part.support.others, component] -= forces[part.points, component]

    def spread(self, forces: np.ndarray) -> None:
        """Copy the forces on held points to the others."""
        self.share.fill(forces)
        for part in self._parts:
            for component in part.components if len(part.points) else ():
                forces[part.support.others, component] = forces[part.points, component]

    @cached_property
    def fields(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Weights (n, d) of the mean and response of the body to the held point, scaled to a mean of 1, by support and component."""
        found = []
        for part in self._parts:
            for component in part.components:
                moved, weights = np.zeros((2, *self._body.points.shape))
                moved[part.points, component] = 1.0
                weights[part.every, component] = 1 / part.support.count
                follows = self.response(moved)
                found.append((weights, follows / self.share.dot(weights, follows)))
        return found


class SupportedPreconditioner(Preconditioner):
    """Preconditioner R M R^T of a body supported at places, from M of the same body held at points; R u removes motions of the places.

    Parameters
    ----------
    inner : Preconditioner
    supports : Supports
    """

    def __init__(self, inner: Preconditioner, supports: Supports) -> None:
        self._inner, self._fields, self._share = inner, supports.fields, supports.share

    def update(self) -> None:
        """Adapt the inner preconditioner to the state in which the force was last evaluated."""
        self._inner.update()

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements under forces, shape (n, d), which move no supported place."""
        balanced = forces.copy()
        for weights, follows in self._fields:
            balanced -= weights * self._share.dot(follows, balanced)
        moved = self._inner.solve(balanced)
        for weights, follows in reversed(self._fields):
            moved -= follows * self._share.dot(weights, moved)
        return moved
