"""Into the body what its held parts do: the affine map that follows them best, and a network of springs for the rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..body import Body
from ..kernels.steps import greatest_strain

LEAST_SPREAD = 0.5
"""Spread of the places that tell a gradient along some direction, over that of the body: what a thin edge says across itself is noise."""


@dataclass(frozen=True)
class Samples:
    """Where held components are, and where they go.

    Attributes
    ----------
    places : ndarray, shape (k, d)
    components : ndarray of int, shape (k,)
        Which component of a place is held.
    goals : ndarray, shape (k,)
        Its value after.
    points : ndarray of int, shape (k,), optional
        The point of the body that each is of, or beside.
    """

    places: np.ndarray
    components: np.ndarray
    goals: np.ndarray
    points: np.ndarray | None = None


def affine_extension(samples: Samples, spread_along: Callable[[np.ndarray], float]) -> tuple[np.ndarray, np.ndarray]:
    """The affine map that is nearest to what samples do: a gradient A and a shift b, of which positions y of the body go to A y + b.

    Where samples do not tell the gradient along a direction it is taken to be that of the identity; where all of them lie on one line, in
    space on one plane, as those of a single clamped edge or face do, the direction across it turns with them.

    Parameters
    ----------
    samples : Samples
    spread_along : callable
        Standard deviation of the positions of the body along a direction (d,), which says what the samples tell.

    Returns
    -------
    gradient : ndarray, shape (d, d)
    shift : ndarray, shape (d,)
    """
    dimension = samples.places.shape[1]
    gradient, told = np.eye(dimension), [[] for _ in range(dimension)]
    shift = np.zeros(dimension)
    for component in range(dimension):
        own = samples.components == component
        if not own.any():
            continue
        places, goals = samples.places[own], samples.goals[own]
        middle = places.mean(axis=0)
        changes = goals - places[:, component]
        _, spreads, directions = np.linalg.svd(places - middle, full_matrices=False)
        row = np.zeros(dimension)
        for spread, direction in zip(spreads / np.sqrt(len(places)), directions, strict=True):
            if spread > LEAST_SPREAD * spread_along(direction) and spread > 0:
                arms = (places - middle) @ direction
                row += (arms @ changes) / (arms @ arms) * direction
                told[component].append(direction)
        gradient[component] += row
        shift[component] = middle[component] + changes.mean() - gradient[component] @ middle
    if all(len(directions) == dimension - 1 for directions in told):
        normals = [_normal(np.array(directions)) for directions in told]
        wanted = _normal(np.array(told[0]) @ gradient.T)
        length = np.linalg.norm(wanted)
        if all(abs(normals[0] @ normal) > 0.99 for normal in normals[1:]) and length > 0:
            change = np.outer(wanted / length - gradient @ normals[0], normals[0])
            for component in range(dimension):
                middle = samples.places[samples.components == component].mean(axis=0)
                shift[component] -= change[component] @ middle
            gradient += change
    return gradient, shift


def _normal(directions: np.ndarray) -> np.ndarray:
    """Normal to a direction in the plane, shape (1, 2), or to two in space, shape (2, 3), on the side that a turn of them keeps."""
    return np.array([-directions[0, 1], directions[0, 0]]) if directions.shape[1] == 2 else np.cross(*directions)


def greatest_bond_strain(body: Body, before: np.ndarray, after: np.ndarray) -> float:
    """Greatest change of length of a bond within the body between two states, over its length at rest; turning is no strain."""
    bonds, n = body.bonds, len(body)
    within = bonds.second < n
    first, second = bonds.first[within], bonds.second[within]

    def lengths(positions: np.ndarray) -> np.ndarray:
        return np.linalg.norm(positions[second] - positions[first], axis=1)

    return float((np.abs(lengths(after) - lengths(before)) / lengths(body.points)).max())


def strain_of_step(body: Body, step: np.ndarray) -> float:
    """Return the greatest strain of a bond that displacements (n, d) make, whose halo is filled first."""
    body.share.fill(step)
    return body.share.greatest(greatest_strain[step.shape[1]](step, body.points, body.bonds.first, body.bonds.second))
