"""Reactions of supports on a body, at points and planes, and their moments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.body import sums_at_points
from ..forces import InternalForce
from .conditions import Loading
from .loaded_force import LoadedForce
from .rigid import moment_of


@dataclass(frozen=True)
class Reactions:
    """Reaction forces that supports exert on the body in the state last evaluated, in two
    dimensions per unit thickness.

    Attributes
    ----------
    forces : ndarray, shape (holders, d)
        Total force of each holder; a holder is a named support in the results, which may consist of
        several held parts.
    on_planes : ndarray, shape (planes, d)
        Force of each reflection plane.
    at_points : ndarray, shape (n, d), or None
        Forces on held points, 0 in free components; None where no points are held.
    levers : ndarray, shape (planes, d, d), or None
        First moments of the forces: the sum of the outer products f (x) y over the forces f that
        each plane exerts at the places y; None if no plane turns.
    """

    forces: np.ndarray
    on_planes: np.ndarray
    at_points: np.ndarray | None
    levers: np.ndarray | None = None


def support_reactions(
    loading: Loading,
    force: LoadedForce,
    on_points: np.ndarray | None = None,
    of_planes: bool = True,
) -> Reactions:
    """Return the reaction forces of all supports on the body in the state last evaluated.

    The reaction at a held point balances the internal force and the loads there.  The reaction
    of a reflection plane is the force that does work on the displacement of the plane: the sum
    over bonds to images (mirrored points) of half the bond force, times the displacement of the
    image per displacement of the plane.  The factor is a half since half the energy of such a
    bond belongs to the mirrored body.  For a single plane the reaction is the sum of the forces
    of all bonds that cross it. It balances the parts of loads that images carry, too.

    Parameters
    ----------
    force : LoadedForce
    on_points : ndarray, shape (n, d), optional
        Internal force and loads on every point in that state; by default summed from the forces
        of all pairs.
    of_planes : bool
        Whether the reactions of planes are computed; otherwise they are 0.
    """
    on_planes = np.zeros(loading.plane_components.shape)
    levers = None
    if of_planes:
        bonds, planes, shares = loading.crossing
        crossing = force.pair_forces(bonds)
        np.add.at(on_planes, planes, crossing * shares)
        on_planes = loading.body.share.total(on_planes) - _loads_on_planes(loading, force)[:, :, 0]
        levers = _levers_on_planes(loading, force, crossing) if loading.turning else None
        levers = None if levers is None else loading.body.share.total(levers)
    if on_points is None and loading.of_points:
        on_points = _on_points(loading, force)
    return reactions_of(loading, on_planes, levers, on_points)


def reactions_of(
    loading: Loading, on_planes: np.ndarray, levers: np.ndarray | None, on_points: np.ndarray | None
) -> Reactions:
    """Return the reactions from the forces and levers of planes (see `Reactions`), and
    internal force plus loads on points (n, d).
    """
    forces = np.zeros((len(loading.names), loading.body.dimension))
    at_points = None
    if loading.of_points:
        at_points = -on_points * (1 - loading.free)
        for support in loading.supports:
            support.spread(at_points)
        holder, *there = loading.counted
        np.add.at(forces, (holder, there[1]), at_points[tuple(there)])
        forces = loading.body.share.total(forces)
    _add_planes(loading, forces, on_planes)
    return Reactions(forces, on_planes, at_points, levers)


def support_moments(loading: Loading, force: LoadedForce, reactions: Reactions) -> np.ndarray:
    """Return the moments of the holders' forces about the origin of the coordinates.

    Moments on planes follow from virtual work if the force has an energy; otherwise a bond that
    crosses a plane acts on it at the middle of the bond.

    Returns
    -------
    ndarray
        Counter-clockwise moments per unit thickness in two dimensions, shape (holders,);
        vectors in three, shape (holders, 3).
    """
    levers = np.zeros((len(loading.names), loading.body.dimension, loading.body.dimension))
    if len(loading.crossing[0]):
        _add_planes(loading, levers, _levers_on_planes(loading, force))
    _add_planes(
        loading, levers, -loading.body.share.is_first * _loads_on_planes(loading, force)[:, :, 1:]
    )
    if reactions.at_points is not None:
        holder, point, component = loading.counted
        np.add.at(
            levers,
            (holder, component),
            reactions.at_points[point, component, None] * force.positions[point],
        )
    return moment_of(loading.body.share.total(levers))


def _add_planes(loading: Loading, of_holders: np.ndarray, of_planes: np.ndarray) -> None:
    """Add the values of planes, `of_planes` (planes, d, ...), in place to `of_holders`
    (holders, d, ...).
    """
    for holder, plane, rows in loading.rows_of_planes:
        of_holders[holder, rows] += of_planes[plane, rows]


def _levers_on_planes(
    loading: Loading, force: InternalForce, crossing: np.ndarray | None = None
) -> np.ndarray:
    """Return the first moments of the forces of planes (`Reactions.levers`), sums of outer
    products f (x) y, shape (planes, d, d).

    If `force` has an energy, it provides these sums. Otherwise f are the forces of the k bonds
    that cross planes, `crossing` (k, d), by default computed here, and y the middles of these
    bonds.
    """
    levers = force.levers_on_planes()
    if levers is not None:
        return levers
    bonds, planes, shares = loading.crossing
    pulls = (force.pair_forces(bonds) if crossing is None else crossing) * shares
    ends = loading.body.bonds
    middles = (force.positions[ends.first[bonds]] + force.positions[ends.second[bonds]]) / 2
    levers = np.zeros((len(loading.planes), loading.body.dimension, loading.body.dimension))
    np.add.at(levers, planes, pulls[:, :, None] * middles[:, None])
    return levers


def _loads_on_planes(loading: Loading, force: LoadedForce) -> np.ndarray:
    """Return what reaches the planes from the loads, see `Loads.on_planes`."""
    if not loading.loads:
        return np.zeros((*loading.plane_components.shape, 1 + loading.body.dimension))
    return loading.loads.on_planes(force.positions[: len(loading.body)], force.thickness())


def _on_points(loading: Loading, force: LoadedForce) -> np.ndarray:
    """Return internal force plus loads on every point in the state last evaluated, shape (n,
    d).

    In each rigid region forces of equal resultant replace them, see `RigidRegion.carry`.
    """
    total = internal_forces(force)
    if loading.loads:
        loading.loads.forces(force.positions[: len(loading.body)], force.thickness(), total)
    for region in force.rigid:
        region.carry(force.positions, total)
    return total


def internal_forces(force: InternalForce) -> np.ndarray:
    """Return the internal force on every point in the state last evaluated, shape (n, d)."""
    bonds = force.body.bonds
    total = sums_at_points(len(force.body), bonds.first, bonds.second, force.pair_forces(), -1)
    beside = force.forces_beside_pairs()
    return total if beside is None else total + beside
