"""Reactions of supports on a body, at points and planes, and their moments."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

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
    loading : Loading
    at_held : ndarray, shape (k,)
        Reactions in the held components of points, `Loading.there`.
    on_planes : ndarray, shape (planes, d), or None
        Force of each reflection plane; None if it was not asked for.
    levers : ndarray, shape (planes, d, d), or None
        First moments of the forces: the sum of the outer products f (x) y over the forces f that
        each plane exerts at the places y; None if no plane turns.
    """

    loading: Loading
    at_held: np.ndarray
    on_planes: np.ndarray | None = None
    levers: np.ndarray | None = None

    @cached_property
    def at_points(self) -> np.ndarray | None:
        """Forces on held points, shape (n, d), 0 in free components; None where no points are
        held.
        """
        loading = self.loading
        if not loading.of_points:
            return None
        found = np.zeros_like(loading.free)
        found[loading.there] = self.at_held
        for support in loading.supports:
            support.spread(found)
        return found

    @cached_property
    def forces(self) -> np.ndarray:
        """Total force of each holder, shape (holders, d); a holder is a named support in the
        results, which may consist of several held parts.
        """
        assert self.on_planes is not None  # of reactions of all supports
        loading = self.loading
        found = np.zeros((len(loading.names), loading.body.dimension))
        if self.at_points is not None:
            holder, *there = loading.counted
            np.add.at(found, (holder, there[1]), self.at_points[tuple(there)])
            found = loading.body.share.total(found)
        _add_planes(loading, found, self.on_planes)
        return found


def support_reactions(
    loading: Loading,
    force: LoadedForce,
    on_points: np.ndarray | None = None,
    of_planes: bool = True,
) -> Reactions:
    """Return the reaction forces of all supports on the body in the state last evaluated.

    The reaction at a held point balances the internal force and the loads there, that of a
    reflection plane (`InternalForce.forces_of_planes`) the parts of loads that images carry, too.

    Parameters
    ----------
    force : LoadedForce
    on_points : ndarray, shape (n, d), optional
        Internal force and loads on every point in that state; by default computed anew.
    of_planes : bool
        Whether the reactions of planes are computed.
    """
    share = loading.body.share
    on_planes = levers = None
    if of_planes:
        on_planes = share.total(force.forces_of_planes()) - _loads_on_planes(loading, force)[..., 0]
        levers = share.total(force.levers_on_planes()) if loading.turning else None
    if on_points is None and loading.of_points:
        on_points = _on_points(loading, force)
    at_held = -on_points[loading.there] if loading.of_points else np.empty(0)
    if share.divided:
        at_held *= share.own[loading.there[0]]
    return Reactions(loading, at_held, on_planes, levers)


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
    if loading.of_planes:
        _add_planes(loading, levers, force.levers_on_planes())
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
    found = np.empty_like(force.body.points)
    force.pass_bonds(found)
    force.body.share.clear(found)
    return found
