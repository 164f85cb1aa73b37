"""Stretches and strains of bonds, and those that are no more than rounding."""

from __future__ import annotations

import numpy as np

from ..body import Body
from ..body.body import lengths_of
from ..forces import InternalForce
from ..kernels.steps import greatest_change_of_length, greatest_strain

RESOLVED = 1000
"""Greatest bond strain, divided by the strain that rounding of positions causes, at which a body
counts as undeformed: such strains have errors above 0.1 %.
"""

NONE = np.zeros(0, dtype=bool)
"""Flags of broken pairs where no pair is broken."""


def bond_stretches(body: Body, positions: np.ndarray, pairs: slice = slice(None)) -> np.ndarray:
    """Return the stretches, deformed length divided by undeformed length, of bonds between local
    points at positions (n, d).

    `pairs` chooses among all pairs of the body, of which those with a ghost are omitted.
    """
    first = body.bonds.first[pairs]
    second = body.bonds.second[pairs]
    within = second < len(body)
    first = first[within]
    second = second[within]
    deformed, at_rest = (lengths_of(at[second] - at[first]) for at in (positions, body.points))
    return deformed / at_rest


def greatest_bond_strain(body: Body, before: np.ndarray, after: np.ndarray) -> float:
    """Return the greatest change of length of a local bond from positions `before` to `after`,
    divided by its undeformed length.
    """
    ends = body.bonds.first, body.bonds.second
    return greatest_change_of_length(before, after, body.points, *ends)


def strain_of_step(body: Body, step: np.ndarray, broken: np.ndarray = NONE) -> float:
    """Return the greatest relative displacement of two bonded points, in any component, divided by
    the length of their undeformed bond.

    The halo (points of other ranks) of the displacements `step` (n, d) is filled in place. Pairs
    with a flag in `broken` do not count.
    """
    body.share.fill(step)
    return body.share.greatest(
        greatest_strain(step, body.points, body.bonds.first, body.bonds.second, broken)
    )


def strain_rounding(body: Body, positions: np.ndarray) -> float:
    """Return the strain that rounding of `positions` (n, d) in double precision causes in a bond
    as long as the spacing.
    """
    return float(np.finfo(float).eps) * body.share.greatest(np.abs(positions)) / body.spacing


def is_rigid(force: InternalForce) -> bool:
    """Return whether the body has moved without deformation, up to rounding, in the state last
    evaluated.
    """
    return strain_of(force) <= RESOLVED * strain_rounding(force.body, force.positions)


def strain_of(force: InternalForce) -> float:
    """Return the greatest strain of a bond in the state last evaluated: absolute change of
    length divided by undeformed length.
    """
    return force.body.share.greatest(
        greatest_bond_strain(force.body, force.body.points, force.positions)
    )
