"""Affine map that follows the held parts of a body best, and strains of bonds between two states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..body import Body
from ..kernels.steps import greatest_strain

LEAST_SPREAD = 0.5
"""Least spread of places along a direction in which they determine a gradient, over that of the body: across a thin edge it is noise."""


@dataclass(frozen=True)
class Samples:
    """Held components of places before and after an increment.

    Attributes
    ----------
    places : ndarray, shape (k, d)
    components : ndarray of int, shape (k,)
        Component of each place that is held.
    goals : ndarray, shape (k,)
        Value of the component after the increment.
    """

    places: np.ndarray
    components: np.ndarray
    goals: np.ndarray


def affine_extension(samples: Samples, spread_along: Callable[[np.ndarray], float]) -> tuple[np.ndarray, np.ndarray]:
    """Return the affine map y -> A y + b that is nearest to the samples: the gradient A and the shift b.

    Along directions in which the samples do not determine the gradient it is that of the identity. Where all of them lie on one line, in
    space on one plane, as on a single clamped edge or face, the direction across it turns with them.

    Parameters
    ----------
    samples : Samples
    spread_along : callable
        Standard deviation of the positions of the body along a direction (d,).

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
    """Return the normal to one direction in the plane (1, 2), or to two in three dimensions (2, 3), which rotates with them."""
    return np.array([-directions[0, 1], directions[0, 0]]) if directions.shape[1] == 2 else np.cross(*directions)


def greatest_bond_strain(body: Body, before: np.ndarray, after: np.ndarray) -> float:
    """Return the greatest change of length of a bond within the body between two states, over its length at rest."""
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
