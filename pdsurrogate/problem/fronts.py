"""Fronts of cracks: where the precuts of a scene end in its body, where cracks have grown to,
and how far around them nothing else lies.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from ..body import Body
from ..discretization import contained
from ..discretization.cuts import Cuts
from ..ranks.share import connected
from ..scenes import Scene
from ..scenes.solids import AnyPrecut

MOST_REACH = 3.0
LEAST_REACH = 2.0
"""Greatest and least radius of the domain around a front, in horizons. In between the energy
release rate of a notched strip agrees within 1 % with differences of the energy, see theory (75).
"""

STEPS = 16
"""Number of radii in a horizon at which places around a front are tested for lying in the body."""

PITCH = 0.01
"""Distance of places along a front, in spacings, and so the resolution of its length."""

MOST_RINGS = 16
"""Number of places of a front around which room is looked for, and of directions around each:
enough for smooth outlines.
"""


@dataclass(frozen=True)
class Front:
    """Front of a crack: a tip in the plane, a line in three dimensions, along which the crack would
    grow.

    Attributes
    ----------
    cut : Precut, ParallelogramCut or DiscCut
        Precut from which the crack grows.
    places, outward : ndarray, shape (k, d)
        Places on the front, and unit vectors along which the crack would grow there; a tip has one
        place.
    normal : ndarray, shape (d,)
        Unit normal of the crack.
    extent : float
        Length of the front; 1 in the plane.
    length : float
        Length of the crack, from the front to its other end or to the boundary of the body, against
        the direction of growth.
    path : tuple of ndarray
        Places of the middle of the front so far, after one behind the first.
    """

    cut: AnyPrecut
    places: np.ndarray
    outward: np.ndarray
    normal: np.ndarray
    extent: float
    length: float
    path: tuple[np.ndarray, ...]

    @property
    def straight(self) -> bool:
        """Whether the crack grows in one direction along the whole front."""
        return bool(np.ptp(self.outward, axis=0).max() < 1e-6)

    def leads_to(self, tip: np.ndarray) -> bool:
        """Return whether a straight front may have grown to a tip: the tip lies within 60
        degrees of the direction of growth.
        """
        moved = tip - self.path[-1]
        return self.straight and bool(moved @ self.outward[0] > 0.5 * np.linalg.norm(moved))

    def grown(self, tip: np.ndarray, base: float) -> "Front":
        """Return the front moved to a new tip, with the direction of the path over the last `base`
        or more.

        A line moves normal to itself.
        """
        moved = tip - self.path[-1]
        if len(tip) == 3:
            line = np.cross(self.normal, self.outward[0])
            moved = moved - (moved @ line) * line
        tip = self.path[-1] + moved
        behind = next(
            (place for place in reversed(self.path) if np.linalg.norm(tip - place) >= base),
            self.path[0],
        )
        along = (tip - behind) / np.linalg.norm(tip - behind)
        normal = self.normal - (self.normal @ along) * along
        turned = {
            "outward": np.tile(along, (len(self.places), 1)),
            "normal": normal / np.linalg.norm(normal),
        }
        return replace(
            self,
            places=self.places + moved,
            length=self.length + np.linalg.norm(moved),
            path=(*self.path, tip),
            **turned,
        )

    def motion(self, points: np.ndarray, reach: float) -> np.ndarray:
        """Return the virtual motion of points (n, d) that lengthens the crack by 1: full within
        three quarters of `reach` of the front.

        From there to `reach` it decreases smoothly to zero, theory (75).
        """
        distance, nearest = scipy.spatial.cKDTree(self.places).query(
            points, distance_upper_bound=reach
        )
        # Gradients at the faces within 1.5 horizons of a tip are not accurate, and half of the
        # radius makes the rate at two horizons up to 4 % too great.
        share = np.clip((1 - distance / reach) / (1 - 0.75), 0, 1)
        return (share**2 * (3 - 2 * share))[:, None] * self.outward[
            np.minimum(nearest, len(self.places) - 1)
        ]


@dataclass(eq=False)
class Fronts:
    """Fronts of the cracks of a scene: at its precuts, and as these grow.

    Parameters
    ----------
    scene : Scene
    body : Body
        The whole body.
    cuts : Cuts
        Precuts of the scene.
    """

    scene: Scene
    body: Body
    cuts: Cuts

    def _inside(self, places: np.ndarray) -> np.ndarray:
        return contained(self.scene, self.body, places)

    @cached_property
    def first(self) -> list[Front]:
        """Fronts of the precuts."""
        return [
            front for number in range(len(self.scene.precuts)) for front in self._of_cut(number)
        ]

    def after(self, growth: Iterable[Sequence[Sequence[float]]]) -> list[Front]:
        """Return the fronts after tips were found in turn at the given places; each tip moves
        the nearest front ahead of which it lies.
        """
        fronts = list(self.first)
        base = 2 * self.body.horizon
        for tips in growth:
            still = set(range(len(fronts)))
            for tip in np.array(tips, dtype=float):
                ahead = [number for number in still if fronts[number].leads_to(tip)]
                if ahead:
                    nearest = min(
                        ahead,
                        key=lambda number: float(np.linalg.norm(tip - fronts[number].path[-1])),
                    )
                    fronts[nearest] = fronts[nearest].grown(tip, base)
                    still.remove(nearest)
        return fronts

    def reach(
        self, front: Front, fronts: Sequence[Front], nearest: Mapping[str, float]
    ) -> tuple[float | None, str | None]:
        """Return the radius of the domain around a front, at most `MOST_REACH`, in which nothing
        else lies; and None.

        `nearest` are the distances of points, such as held ones, of which the domain may contain no
        bond, by what they are; the boundary is another such place, except planes of symmetry, at
        which the domain may end. If the radius would be below `LEAST_REACH`, so that no energy
        release rate can be computed, it is None, and the second value says in words why.
        """
        horizon = self.body.horizon
        places, outward = (
            rows[:: -(-len(rows) // MOST_RINGS)] for rows in (front.places, front.outward)
        )
        angles = 2 * np.pi * np.arange(MOST_RINGS) / MOST_RINGS
        ring = np.cos(angles)[:, None] * outward[:, None] + np.sin(angles)[:, None] * front.normal
        radii = horizon * np.arange(1, (MOST_REACH + 1) * STEPS + 1) / STEPS
        symmetric = [plane for plane in self.body.planes if max(plane.parity) > 0]

        def within(around: np.ndarray) -> bool:
            for plane in symmetric:
                on_plane, depths = plane.mirrored(around)
                around = np.where(depths[:, None] < 0, 2 * on_plane - around, around)
            return bool(self._inside(around).all())

        free = np.array(
            [
                within((places[:, None] + radius * ring).reshape(-1, len(front.normal)))
                for radius in radii
            ]
        )
        room = float(radii[-1] if free.all() else radii[free.argmin()] - radii[0])
        apart = {"the boundary of the body": room, **nearest}
        depths = [float(plane.mirrored(front.places)[1].min()) for plane in symmetric]
        rooms = {"a plane of symmetry": min(depths, default=math.inf)}
        rooms["the other end of the crack"] = front.length if front.straight else front.length / 2
        for number, cut in enumerate(self.scene.precuts):
            if (
                cut is not front.cut
                and np.abs((cut.edge(horizon)[0] - front.places[0]) @ front.normal).max()
                > 1e-6 * horizon
            ):
                rooms[f"precuts.{number}"] = float(cut.distances(front.places).min())
        near = [
            float(scipy.spatial.cKDTree(front.places).query(one.places)[0].min())
            for one in fronts
            if one is not front
        ]
        rooms["the front of another crack"] = min(near, default=math.inf)
        rooms |= {what: distance - horizon for what, distance in apart.items()}
        first = min(rooms, key=lambda what: rooms[what])
        if rooms[first] >= LEAST_REACH * horizon:
            return min(rooms[first], MOST_REACH * horizon), None
        away, needed = (
            (apart[first], LEAST_REACH + 1) if first in apart else (rooms[first], LEAST_REACH)
        )
        # A finer lattice may have points that are nearer by a spacing.
        closer = self.body.spacing if first in nearest else 0.0
        finer = math.floor(100 * (away - closer) / (needed * horizon)) / 100 * self.body.spacing
        told = f"a spacing of {finer:.3g} or less would do" if finer > 0 else "no spacing would do"
        return (
            None,
            (
                f"{first} is {away:.3g} away, less than {needed:g} horizons,"
                f" {needed * horizon:.3g}; {told}"
            ),
        )

    def _of_cut(self, number: int) -> list[Front]:
        """Return the fronts of a precut: the connected parts of its edge that lie in the body
        and that nothing else touches.
        """
        body = self.body
        precut = self.scene.precuts[number]
        edge = precut.edge(PITCH * body.spacing)
        # an end at the boundary is no front
        within = self._inside(edge[0] + body.spacing / 4 * edge[1])
        within &= ~self.cuts.touched(number, edge[0])
        places, outward, lengths = (rows[within] for rows in edge)
        count, part = connected(
            len(places),
            *scipy.spatial.cKDTree(places)
            .query_pairs(1.5 * PITCH * body.spacing, output_type="ndarray")
            .T,
        )
        return [
            self._front(precut, places[part == one], outward[part == one], lengths[part == one])
            for one in range(count)
        ]

    def _front(
        self, precut: AnyPrecut, places: np.ndarray, outward: np.ndarray, lengths: np.ndarray
    ) -> Front:
        normal = (
            np.array([-outward[0, 1], outward[0, 0]]) if len(outward[0]) == 2 else precut.plane()[1]
        )
        middle = len(places) // 2
        start, along = (
            (places[middle], outward[middle])
            if np.ptp(outward, axis=0).max() > 1e-6
            else (places.mean(axis=0), outward[0])
        )
        pitch = PITCH * self.body.spacing
        behind = start - np.outer(
            pitch * (np.arange(int(self.body.extent * np.sqrt(len(start)) / pitch) + 1) + 0.5),
            along,
        )
        step = pitch * normal
        on_crack = self._inside(behind) & self.cuts.crosses(behind - step, behind + step)
        length = pitch * float(len(behind) if on_crack.all() else on_crack.argmin())
        front = Front(precut, places, outward, normal, float(lengths.sum()), length, ())
        return replace(front, path=(start - 2 * self.body.horizon * along, start))
