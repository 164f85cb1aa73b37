"""Bonds that break because a material's strength is reached in the mean over a disc, theory,
section 32.
"""

import heapq
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import scipy

from ..body import Body
from ..body.body import lengths_of
from ..forces import InternalForce, InvalidState
from ..forces.kinematics import entries_of
from ..materials.states import invariants
from ..problem.strength import Strengths, Zone
from .damage import Damage, Failing

SAMPLES = {2: 8, 3: 5}
"""Samples per radius of a disc in each direction, by dimension, from which its part in the hull is
found. Chosen: a circular hole of the disc's size counts within 2 % of the disc.
"""

TOGETHER = 64
"""Discs whose means are found at once, chosen: all would take gigabytes where spacings are fine and
most points near their strength.
"""

EQUAL = 1e-9
"""Relative difference up to which stretches count as equal, as those of a bond and of its image."""


class StrongDamage(Damage):
    """Damage of a body of materials with strengths: bonds break by strength, and beyond their
    critical stretch only at fronts, where an end has lost bonds or lies at a cut.

    Parameters
    ----------
    body, critical_stretch
        As of `Damage`.
    strengths : Strengths
    """

    def __init__(
        self, body: Body, critical_stretch: float | np.ndarray, strengths: Strengths
    ) -> None:
        super().__init__(body, critical_stretch)
        self._strengths = strengths
        self._own = np.flatnonzero(body.share.own)
        self._tree = scipy.spatial.cKDTree(body.points[self._own])
        self._mirrors = [plane for plane in body.planes if plane.symmetric]
        grid = np.arange(-SAMPLES[body.dimension], SAMPLES[body.dimension]) + 0.5
        unit = np.stack(np.meshgrid(*[grid] * body.dimension), axis=-1).reshape(-1, body.dimension)
        unit /= SAMPLES[body.dimension]
        self._samples = unit[lengths_of(unit) <= 1]
        self._shares: dict[tuple[float, int], float] = {}
        self._outer = np.flatnonzero(body.bonds.second >= len(body))
        self._at_fronts = np.zeros(len(body.all_points), dtype=bool)
        self._beyond = self.limits.copy()
        self.limits[:] = np.inf
        self._open_fronts(body.bonds.cut.ravel())

    def break_bonds(self, pairs: np.ndarray) -> None:
        super().break_bonds(pairs)
        bonds = self.body.bonds
        self._open_fronts(np.append(bonds.first[pairs], bonds.second[pairs]))

    def restore(self) -> None:
        super().restore()
        bonds = self.body.bonds
        self._open_fronts(np.append(bonds.first[self.broken], bonds.second[self.broken]))

    def _open_fronts(self, points: np.ndarray) -> None:
        """Let the critical stretch act on the bonds of points and images, given by number, that
        have lost bonds or lie at a cut, on all ranks.
        """
        body = self.body
        bonds = body.bonds
        before = self._at_fronts.copy()
        self._at_fronts[points] = True
        body.ghosts.fill(self._at_fronts)
        new = np.flatnonzero(self._at_fronts[: len(body)] & ~before[: len(body)])
        outer = self._outer[self._at_fronts[bonds.second[self._outer]]]
        pairs = np.append(bonds.pair_of[entries_of(bonds.pointers, new)], outer)
        pairs = pairs[~self.broken[pairs]]
        self.limits[pairs] = self._beyond[pairs]

    def failing(self, force: InternalForce, strength: bool = True, alone: bool = False) -> Failing:
        found = super().failing(force)
        if not strength:
            return found
        torn, loads = self.by_strength(force, alone)
        new = ~np.isin(torn, found.pairs)
        pairs = np.append(found.pairs, torn[new])
        order = np.argsort(pairs)
        loads = np.append(found.loads, loads[new])[order]
        return Failing(pairs[order], loads, order >= len(found.pairs))

    def greatest_load(self, force: InternalForce) -> float:
        load = super().greatest_load(force)
        ratio_of = self._ratio_of(force)
        for zone in self._strengths.zones:
            points = self._own[zone.centers[self._own]]
            value, _ = next(self._discs(zone, points, ratio_of), (0.0, None))
            load = max(load, float(np.sqrt(value)))
        return load

    def by_strength(
        self, force: InternalForce, alone: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers, rising, of the pairs that break by strength at the positions last
        set, and their loads (k,): the square roots of the mean energies over the works at break.

        One pair for each of the discs, which do not overlap, and its images; if `alone`, for the
        disc of the greatest load alone.
        """
        found = list[tuple[float, Zone, np.ndarray]]()
        ratio_of = self._ratio_of(force)
        may_break = self._may_break(force)
        for zone in self._strengths.zones:
            apart = np.empty((0, self.body.dimension))
            points = may_break[zone.centers[may_break]]
            points = points[ratio_of(zone, points) >= zone.least_at(points)]
            for value, center in self._discs(zone, points, ratio_of):
                if value < 1 or (alone and len(apart)):
                    break
                if (lengths_of(apart - center) >= 2 * zone.radius).all():
                    apart = np.append(apart, center[None], axis=0)
                    found.append((value, zone, center))
        if alone and found:
            found = [max(found, key=lambda one: one[0])]
        torn = [self._most_stretched(zone, center, force.positions) for _, zone, center in found]
        pairs = np.concatenate([np.empty(0, dtype=np.int64), *torn])
        loads = np.repeat([np.sqrt(value) for value, *_ in found], [len(one) for one in torn])
        numbers, first = np.unique(pairs, return_index=True)
        return numbers, loads[first]

    def _may_break(self, force: InternalForce) -> np.ndarray:
        """Return the own points whose energy may reach the work at break: of a sheet under plane
        stress those that are pressed together, or at which tr C is great enough.
        """
        if force.plane != "stress":
            return self._own
        trace, J = invariants(force.deformation_gradients()[self._own])
        return self._own[(trace >= self._strengths.least_trace) | ~(J >= 1)]

    def _ratio_of(self, force: InternalForce) -> Callable[[Zone, np.ndarray], np.ndarray]:
        """Return a function of a zone and points that gives the energy densities of the points by
        their laws, from their intact bonds, over their works at break.

        They are 0 if a point that has lost bonds has no state, which breaks its others.
        """
        F = force.deformation_gradients()
        try:
            J3 = force.volume_ratios()
        except InvalidState:
            return lambda zone, points: np.zeros(len(points))

        def ratio_of(zone: Zone, points: np.ndarray) -> np.ndarray:
            found = np.zeros(len(points))
            with np.errstate(all="ignore"):  # of points that have lost bonds
                for number, (law, _) in enumerate(force.laws):
                    of_law = np.ones(len(points), dtype=bool)
                    if force.portion_of is not None:
                        of_law = force.portion_of[points] == number
                    at = points[of_law]
                    found[of_law] = self._strengths.energies(zone, at, law, F[at], J3[at])
            works = self._strengths.works[points] if zone.of_points else zone.work
            return np.nan_to_num(found, posinf=0.0) / works

        return ratio_of

    def _discs(
        self, zone: Zone, points: np.ndarray, ratio_of: Callable[[Zone, np.ndarray], np.ndarray]
    ) -> Iterator[tuple[float, np.ndarray]]:
        """Yield the values of the discs of a zone around given own points and their centers, shape
        (d,), the greatest first: the mean over the hull, or the ratio of the point if that is
        smaller, over the share of the work at break that is needed there.
        """
        body = self.body
        share = body.share
        least = zone.least_at(points)
        by_own = ratio_of(zone, points) / least
        numbers, centers, own, least = (
            np.concatenate(share.everywhere(rows))
            for rows in (share.numbers[points], body.points[points], by_own, least)
        )
        following = np.lexsort((numbers, -own))
        means = np.empty(len(own))
        # No disc's value is greater than the ratio of its point. Means are found as long as a
        # following disc may come first, the part in the hull, which takes time, once it decides.
        waiting: list[tuple[float, int, int, bool]] = []
        while waiting or len(following):
            if len(following) and (not waiting or own[following[0]] >= -waiting[0][0]):
                some, following = following[:TOGETHER], following[TOGETHER:]
                means[some] = self.means(zone, centers[some], partial(ratio_of, zone)) / least[some]
                for index in some:
                    value = -min(means[index], own[index])
                    heapq.heappush(waiting, (value, numbers[index], index, False))
                continue
            value, number, index, whole = heapq.heappop(waiting)
            if whole:
                yield -value, centers[index]
            else:
                part = self.share_in_hull(zone, int(number), centers[index])
                value = -min(part * means[index], own[index])
                heapq.heappush(waiting, (value, number, index, True))

    def _images(self, places: np.ndarray) -> list[np.ndarray]:
        """Return places (k, d), and their images in the planes of symmetry."""
        found = [places]
        for plane in self._mirrors:
            found += [2 * plane.mirrored(each)[0] - each for each in found]
        return found

    def means(
        self, zone: Zone, centers: np.ndarray, ratio_of: Callable[[np.ndarray], np.ndarray]
    ) -> np.ndarray:
        """Return the means of `ratio_of`, a function of the numbers of points, over the intact part
        of the discs around `centers` (k, d), shape (k,).
        """
        body = self.body
        rim = body.spacing / 2
        discs, members, parts = [], [], []
        for places in self._images(centers):
            near = self._tree.query_ball_point(places, zone.radius + rim, return_sorted=True)
            counts = np.array([len(each) for each in near])
            disc = np.repeat(np.arange(len(centers)), counts)
            member = self._own[np.concatenate([*map(np.asarray, near)]).astype(np.int64)]
            distance = lengths_of(body.points[member] - places[disc])
            discs.append(disc)
            members.append(member)
            parts.append(np.clip((zone.radius - distance) / body.spacing + 0.5, 0, 1))
        disc, member, part = map(np.concatenate, (discs, members, parts))
        known = np.zeros(len(body), dtype=bool)
        known[member] = True
        every = np.flatnonzero(known)
        place = (np.cumsum(known) - 1)[member]
        volumes = body.volumes[every] * self._intact(every)
        if zone.of_points:  # materials without a strength do not count
            volumes *= np.isfinite(self._strengths.works[every])
        weight = part * volumes[place]
        number = body.share.numbers[member]
        value = weight * ratio_of(every)[place]
        disc, number, weight, value = (
            np.concatenate(body.share.everywhere(rows)) for rows in (disc, number, weight, value)
        )
        order = np.lexsort((number, disc))  # the same sums on any number of ranks
        total, weighted = (
            np.bincount(disc[order], rows[order], len(centers)) for rows in (weight, value)
        )
        return weighted / np.maximum(total, np.finfo(float).tiny)

    def _intact(self, points: np.ndarray) -> np.ndarray:
        """Return the share of the bonds of given points, shape (k,), that are neither cut nor
        broken, weighed as in `at_points`.
        """
        bonds = self.body.bonds
        entries = entries_of(bonds.pointers, points)
        pairs = bonds.pair_of[entries]
        weights = self._weights[pairs] * self.body.all_volumes[bonds.neighbors[entries]]
        counts = np.diff(bonds.pointers)[points].astype(np.int64)
        owners = np.repeat(np.arange(len(points)), counts)
        return np.bincount(owners, weights * ~self.broken[pairs], len(points)) / self._whole[points]

    def share_in_hull(self, zone: Zone, number: int, center: np.ndarray) -> float:
        """Return the part of the convex hull of a disc's part of the undeformed body that is in
        the body: holes count as empty.
        """
        key = zone.radius, number
        if key not in self._shares:
            samples = center + zone.radius * self._samples
            inside = np.zeros(len(samples), dtype=bool)
            for places in self._images(samples):
                inside |= self._strengths.inside(places)
            share = 1.0
            if not inside.all() and np.count_nonzero(inside) > 2 * len(center):
                hull = scipy.spatial.ConvexHull(samples[inside]).equations
                within = (samples @ hull[:, :-1].T + hull[:, -1] <= EQUAL * zone.radius).all(axis=1)
                share = np.count_nonzero(inside) / np.count_nonzero(within | inside)
            self._shares[key] = share
        return self._shares[key]

    def _most_stretched(self, zone: Zone, center: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """Return the numbers of the pair of a disc, and of its images, on this rank whose stretch
        is the greatest part of the stretch at break of its material; of equal ones it is the
        nearest to the center.
        """
        body = self.body
        share = body.share
        bonds = body.bonds
        points = body.all_points
        reach = zone.radius + body.horizon / 2
        members = self._own[self._tree.query_ball_point(center, reach, return_sorted=True)]
        pairs = np.unique(bonds.pair_of[entries_of(bonds.pointers, members)])
        limits = self._strengths.limits
        pairs = pairs[zone.pairs[pairs] & ~self.broken[pairs] & np.isfinite(limits[pairs])]
        first = bonds.first[pairs]
        second = bonds.second[pairs]
        away = lengths_of(self.middles(pairs) - center)
        within = away <= zone.radius
        pairs, first, second, away = (rows[within] for rows in (pairs, first, second, away))
        length = lengths_of(points[second] - points[first])
        stretch = lengths_of(positions[second] - positions[first]) / length / limits[pairs]
        numbers = self._rows.numbers[pairs]
        own = share.own[first]
        sources = np.concatenate([share.numbers, share.numbers[body.ghosts.source]])
        ends = np.sort(np.stack([sources[first], sources[second]], axis=1), axis=1)
        image = second >= len(body)
        rows = (numbers, stretch, away, length, image, ends)
        numbers, stretch, away, length, image, ends = (
            np.concatenate(share.everywhere(values[own])) for values in rows
        )
        if not len(numbers):
            return numbers
        most = np.flatnonzero(stretch >= (1 - EQUAL) * stretch.max())
        best = most[np.lexsort((numbers[most], away[most]))[0]]
        # A bond to an image has an image itself if both ends lie beside the plane.
        same = image & image[best] & (ends == ends[best]).all(axis=1)
        same &= np.abs(length - length[best]) <= EQUAL * body.horizon
        same[best] = True
        return np.flatnonzero(np.isin(self._rows.numbers, numbers[same]))
