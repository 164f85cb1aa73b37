"""Into the body what its held parts do: the affine map that follows them best, and a network of springs for the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body import Body

LEAST_SPREAD = 0.5
"""Spread of the places that tell a gradient along some direction, over that of the body: what a thin edge says across itself is noise."""


@dataclass(frozen=True)
class Samples:
    """Where held components are, and where they go.

    Attributes
    ----------
    places : ndarray, shape (k, 2)
    components : ndarray of int, shape (k,)
        Which component of a place is held.
    goals : ndarray, shape (k,)
        Its value after.
    """

    places: np.ndarray
    components: np.ndarray
    goals: np.ndarray


def affine_extension(samples: Samples, positions: np.ndarray) -> np.ndarray:
    """Positions (n, 2) mapped as the samples are, by the affine map that is nearest to them.

    Where samples do not tell the gradient along a direction it is taken to be that of the identity; where all of them lie on one line, as
    those of a single clamped edge do, the direction across it turns with the line.
    """
    gradient, told, lines = np.eye(2), [0, 0], [None, None]
    shift = np.zeros(2)
    for component in (0, 1):
        own = samples.components == component
        if not own.any():
            continue
        places, goals = samples.places[own], samples.goals[own]
        middle = places.mean(axis=0)
        changes = goals - places[:, component]
        _, spreads, directions = np.linalg.svd(places - middle, full_matrices=False)
        row = np.zeros(2)
        for spread, direction in zip(spreads / np.sqrt(len(places)), directions, strict=True):
            along = positions @ direction
            if spread > LEAST_SPREAD * along.std() and spread > 0:
                arms = (places - middle) @ direction
                row += (arms @ changes) / (arms @ arms) * direction
                told[component], lines[component] = told[component] + 1, direction
        gradient[component] += row
        shift[component] = middle[component] + changes.mean() - gradient[component] @ middle
    if told == [1, 1] and abs(lines[0] @ lines[1]) > 0.99:
        line = lines[0]
        turned = gradient @ line
        length = np.linalg.norm(turned)
        if length > 0:
            across, wanted = np.array([-line[1], line[0]]), np.array([-turned[1], turned[0]]) / length
            change = np.outer(wanted - gradient @ across, across)
            for component in (0, 1):
                middle = samples.places[samples.components == component].mean(axis=0)
                shift[component] -= change[component] @ middle
            gradient += change
    return positions @ gradient.T + shift


def greatest_bond_strain(body: Body, before: np.ndarray, after: np.ndarray) -> float:
    """Greatest change of length of a bond within the body between two states, over its length at rest; turning is no strain."""
    bonds, n = body.bonds, len(body)
    within = bonds.second < n
    first, second = bonds.first[within], bonds.second[within]

    def lengths(positions: np.ndarray) -> np.ndarray:
        return np.linalg.norm(positions[second] - positions[first], axis=1)

    return float((np.abs(lengths(after) - lengths(before)) / lengths(body.points)).max())
