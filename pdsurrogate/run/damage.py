"""Damage: bonds break irreversibly beyond a critical stretch (paper, Eqs. (29)-(31))."""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..body import Body, rows_of
from ..body.body import lengths_of
from ..engine.block_arrays import BLOCK
from ..engine.passes import Chain
from ..engine.threads import chunks_of
from ..forces import InternalForce
from ..kernels.damage import find_overstretched
from ..ranks import Rows
from ..solvers.bond_strains import bond_stretches


class Failing(NamedTuple):
    """Pairs that break in a state of the body."""

    pairs: np.ndarray
    """Numbers of the pairs, shape (k,), rising."""

    loads: np.ndarray
    """Stretches over the critical ones; for pairs that break by strength, square roots of the mean
    energy over the work at break.
    """

    by_strength: np.ndarray
    """Flags of the pairs that break by strength, and not beyond the critical stretch."""

    @property
    def cause(self) -> str:
        """Name of what breaks the pairs: "strength", or "energy" if it breaks one of them."""
        return "strength" if self.by_strength.all() else "energy"


class Damage:
    """Damage of a body: its broken bonds, and the search for overstretched bonds.

    Parameters
    ----------
    body : Body
    critical_stretch : float or ndarray, shape (n_pairs,)
        Greatest ratio of deformed to undeformed length that a bond bears, greater than 1, of all
        pairs or of each: a bond with a greater one breaks.

    Attributes
    ----------
    broken : ndarray of bool, shape (n_pairs,)
        True for pairs (undirected bonds) that have broken.
    search : BoundPass
        Pass that returns the number of overstretched pairs.
    limits : ndarray, shape (n_pairs padded to blocks,)
        Squares of the lengths at which pairs break; infinite for broken ones.
    recent : ndarray of int, shape (n_pairs,)
        For pairs that broke since the last output, the number of the event (call of `break_bonds`)
        in which they broke, rising with time; 0 for other pairs.
    """

    def __init__(self, body: Body, critical_stretch: float | np.ndarray) -> None:
        if not (np.isfinite(critical_stretch) & (np.asarray(critical_stretch) > 1)).all():
            raise ValueError(
                f"the critical stretch must be finite and greater than 1, not {critical_stretch}"
            )
        self.body = body
        bonds = body.bonds
        self.broken = np.zeros(len(bonds.first), dtype=bool)
        self.recent = np.zeros(len(bonds.first), dtype=np.int32)
        self._events = 0
        first, second = bonds.ends_in_blocks(BLOCK)
        length = _lengths(body, bonds.first, bonds.second)
        self._weights = body.weigh(length)
        self.limits = np.full(len(first), np.inf)
        self.limits[: len(length)] = (critical_stretch * length) ** 2
        self._found = np.empty(len(first), dtype=np.uint32)
        chunks = chunks_of(len(bonds.first))
        self._counts = np.zeros(chunks.number, dtype=np.int64)
        scratch = np.zeros((chunks.threads, body.dimension, BLOCK))
        arrays = (
            body.all_points,
            first,
            second,
            self.limits.reshape(-1, BLOCK),
            scratch,
            self._found,
            self._counts,
        )
        self.search = find_overstretched[body.dimension].bind(*arrays, chunks=chunks)
        self._run_search = Chain(self.search)
        one, other = body.bonds.cut.T
        self._whole = _by_points(body, bonds.first, bonds.second, self._weights)
        self._whole += _by_points(body, one, other, body.weigh(_lengths(body, one, other)))

    def overstretched(self, positions: np.ndarray) -> np.ndarray:
        """Return the numbers of the intact pairs whose stretch exceeds the critical one, in
        ascending order.

        Parameters
        ----------
        positions : ndarray, shape (n + m, d)
            Positions of the points and of their images in reflection planes (ghosts).
        """
        self.search.give("positions", positions)
        if not any(self._run_search()):
            return self._found[:0]
        chunks = len(self._counts)
        blocks = len(self.limits) // BLOCK
        starts = [chunk * blocks // chunks * BLOCK for chunk in range(chunks)]
        return np.concatenate(
            [
                self._found[start : start + count]
                for start, count in zip(starts, self._counts, strict=True)
            ]
        )

    def overloaded(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers of the overstretched pairs as `overstretched` does, and their loads
        (k,): stretch divided by critical stretch, greater than 1.
        """
        pairs = self.overstretched(positions)
        if not len(pairs):
            return pairs, np.empty(0)
        bonds = self.body.bonds
        length = lengths_of(positions[bonds.second[pairs]] - positions[bonds.first[pairs]])
        return pairs, length / np.sqrt(self.limits[pairs])

    def failing(self, force: InternalForce, strength: bool = True, alone: bool = False) -> Failing:
        """Return the pairs that break at the positions at which a force was last placed; those that
        break by `strength` only if that is asked for, or `alone` those of one disc.
        """
        pairs, loads = self.overloaded(force.positions)
        return Failing(pairs, loads, np.zeros(len(pairs), dtype=bool))

    def greatest_load(self, force: InternalForce) -> float:
        """Return the greatest load, as of `Failing`, of a bond of the body at the positions at
        which a force was last placed.
        """
        bonds = self.body.bonds
        positions = force.positions
        square = np.square(positions[bonds.second] - positions[bonds.first]).sum(axis=1)
        load = np.sqrt((square / self.limits[: len(square)]).max(initial=0.0))
        return self.body.share.greatest(float(load))

    def middles(self, pairs: np.ndarray) -> np.ndarray:
        """Return the undeformed middles (k, d) of pairs."""
        points = self.body.all_points
        bonds = self.body.bonds
        return (points[bonds.first[pairs]] + points[bonds.second[pairs]]) / 2

    def foremost(self, pairs: np.ndarray, loads: np.ndarray, alike: float) -> np.ndarray:
        """Return those overloaded pairs of this rank that break first: of each place of the body
        the one of the greatest load, and those around it whose loads are the same within a
        difference `alike`.

        A pair waits while another one, of a greater load, breaks within a horizon of its middle.

        Parameters
        ----------
        pairs : ndarray of int, shape (k,)
        loads : ndarray, shape (k,)
            As from `overloaded`.
        alike : float
        """
        body = self.body
        share = self.body.share
        own = self._rows.own[pairs]
        numbers, loads, places = (
            np.concatenate(share.everywhere(rows))
            for rows in (
                self._rows.numbers[pairs[own]],
                loads[own],
                self.middles(pairs[own]),
            )
        )
        waiting = np.lexsort((numbers, -loads))
        chosen = []
        while len(waiting):
            first = waiting[0]
            near = np.square(places[waiting] - places[first]).sum(axis=1) <= body.horizon**2
            chosen.append(waiting[near & (loads[waiting] >= loads[first] - alike)])
            waiting = waiting[~near]
        return pairs[np.isin(self._rows.numbers[pairs], numbers[np.concatenate(chosen)])]

    def break_bonds(self, pairs: np.ndarray) -> None:
        """Mark pairs, given by number, as broken in one event."""
        self._events += 1
        self.broken[pairs], self.recent[pairs] = True, self._events
        self.limits[pairs] = np.inf

    def restore(self) -> None:
        """Update the search for overstretched bonds and the number of events after `broken` and
        `recent` were read from a checkpoint.
        """
        self.limits[: len(self.broken)][self.broken] = np.inf
        self._events = int(self.body.share.greatest(float(self.recent.max(initial=0))))

    @cached_property
    def _rows(self) -> Rows:
        """Correspondence of the pairs of this rank to the pairs of the whole body."""
        return rows_of(self.body, "pairs")

    def take_recent(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the middles (k, d) of all pairs that broke since the last call, and the numbers
        (k,) of their events, and clear `recent`.

        Both arrays are in the order in which the pairs broke.
        """
        found = self.in_order(np.flatnonzero(self.recent))
        self.recent[:] = 0
        return found

    def in_order(self, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the middles (k, d) of the given pairs of all ranks in the order in which they
        broke, and the numbers (k,) of their events.

        `pairs` are numbers of pairs of this rank that are in `recent`. Within an event the order is
        that of the pairs in the whole body, the same on any number of ranks.
        """
        share = self.body.share
        pairs = pairs[self._rows.own[pairs]]
        numbers = self._rows.numbers[pairs]
        events = self.recent[pairs]
        places = self.middles(pairs)
        places, events, numbers = (
            np.concatenate(share.everywhere(rows)) for rows in (places, events, numbers)
        )
        order = np.lexsort((numbers, events))
        return places[order], events[order]

    def at_points(self) -> np.ndarray:
        """Return the damage of every point, shape (n,): the fraction of its bonds that are cut or
        broken (paper, Eq. (31)).

        A bond counts in proportion to its weight function times the volume of its other end.
        """
        return (
            1
            - _by_points(
                self.body,
                self.body.bonds.first,
                self.body.bonds.second,
                self._weights * ~self.broken,
            )
            / self._whole
        )


def _lengths(body: Body, first, second) -> np.ndarray:
    return lengths_of(body.all_points[second] - body.all_points[first])


def _by_points(
    body: Body, first: np.ndarray, second: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Return for every point, shape (n,), the sum over its bonds of weight times volume of the
    other end.

    The bonds are given by their ends `first` and `second` and their weights, shape (k,) each.
    """
    n = len(body)
    volumes = body.all_volumes
    within = second < len(body)
    return np.bincount(first, weights * volumes[second], n) + np.bincount(
        second[within], (weights * volumes[first])[within], n
    )


def greatest_bond_stretch(body: Body, positions: np.ndarray) -> float:
    """Return the greatest stretch of the bonds between points of a body.

    For the equilibrium of a precut body at the loading at which its crack starts in experiment,
    this is the critical stretch with which the simulated crack starts there: the paper's
    calibration from a loading curve.

    Parameters
    ----------
    body : Body
    positions : array_like, shape (n, d)
        Deformed positions of the body's points.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        If the positions are not those of the body's points.

    See Also
    --------
    pdsurrogate.critical_stretch_of : critical stretch for a fracture energy.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> body = pds.Body.rectangle(1.0, 1.0, 0.25, 0.7875)
    >>> print(round(pds.greatest_bond_stretch(body, body.points * [1.5, 1.0]), 6))
    1.5
    """
    positions = np.asarray(positions, dtype=float)
    if positions.shape != body.points.shape:
        raise ValueError(
            f"positions must be those of the body's points, of shape {body.points.shape}, not"
            f" {positions.shape}"
        )
    return float(bond_stretches(body, positions).max())
