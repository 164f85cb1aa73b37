"""Ghosts: images of points beyond reflection planes, whose values follow from those of the points
by a linear map.

Images follow the points in arrays of n + m rows. A method that fills such an array first brings the
rows of halo points from the ranks that own them, since an image may mirror a halo point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from ..ranks import Share

WITH_ROUNDING = 1 + 1e-9
"""Factor on a horizon wherever points within it are found: points at exactly the horizon, whose
computed distance may exceed it by rounding, are then included everywhere, so that bonds, images and
halo agree.
"""

MOST_BENT = 0.5
"""Greatest relative change of the displacement of an image by the curvature of a held boundary.
Chosen as in theory (62a).
"""

APART = 1.05
"""Factor on the depths of a place and of its image up to which a held boundary must have no point
nearer to them than their foot.

Otherwise the place has no image: images from several sides would meet. Chosen: a small margin,
since volumes of images are infinite or 0 where they meet, at a center of curvature.
"""


@dataclass(frozen=True)
class ReflectionPlane:
    """Reflection plane at an edge or face of a body, beyond which mirror images of points (ghosts)
    continue the body.

    Parameters
    ----------
    axis : int
        Coordinate that is constant on the plane: 0 for x1, 1 for x2, 2 for x3.
    position : float
        Value of that coordinate.
    side : int
        -1 where the body lies at larger values (a left or lower edge), +1 where it lies at smaller
        ones.
    parity : tuple of int
        Reflection of each displacement component: even (+1) or odd (-1). All odd is a clamped grip;
        only the normal one odd is a symmetry plane or a roller (theory (22)).
    """

    axis: int
    position: float
    side: int
    parity: tuple[int, ...]

    @property
    def symmetric(self) -> bool:
        """Whether the body continues symmetrically: normal displacements are odd, others even."""
        return all((sign < 0) == (axis == self.axis) for axis, sign in enumerate(self.parity))

    def mirrored(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the points of the plane nearest to `places` (k, d), and the depths (k,) of the
        places inside it, negative outside.
        """
        feet = places.copy()
        feet[:, self.axis] = self.position
        return feet, -self.side * (places[:, self.axis] - self.position)


class Curve(Protocol):
    """Closed curve in the plane, or closed surface in three dimensions."""

    def nearest(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the points nearest to places (k, d), and the curvatures there (k, d - 1),
        positive where it is convex.
        """

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Return whether points (k, d) lie inside."""


@dataclass(frozen=True)
class HeldBoundary:
    """Closed boundary of any shape, all of it held, beyond which ghosts continue the body by point
    reflections in it (theory, section 21).

    The image of a place X is 2 X_b - X, where X_b is the nearest point of the boundary, and moves
    so that X_b has the boundary's motion.

    Attributes
    ----------
    name : str
        Name of this part of the boundary: "outline" or "holes.0", ...
    curve : Curve
    hole : bool
        Whether the body lies outside the curve.
    parity : tuple of int
        Reflection of each displacement component, all odd.
    """

    name: str
    curve: Curve
    hole: bool
    parity: tuple[int, ...] = (-1, -1)
    axis: None = None  # unlike a plane, it has no single normal
    symmetric = False

    def mirrored(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the points of the boundary nearest to `places` (k, d), and the depths (k,) of
        the places inside it, negative outside.
        """
        feet, _ = self.curve.nearest(places)
        return feet, np.linalg.norm(places - feet, axis=1) * np.where(
            self.curve.contains(places) != self.hole, 1.0, -1.0
        )

    def bent(self, places: np.ndarray) -> np.ndarray:
        """Return the depths of places times the sum of the curvatures, positive around a hole,
        at most `MOST_BENT` (theory (67)).
        """
        feet, curvature = self.curve.nearest(places)
        bent = np.linalg.norm(places - feet, axis=1) * curvature.sum(axis=1)
        return np.clip(bent if self.hole else -bent, -MOST_BENT, MOST_BENT)

    def ratios(self, places: np.ndarray) -> np.ndarray:
        """Return the volumes of small cells' images divided by those of the cells, at places (k,
        d); 0 where there are none (`APART`).
        """
        feet, curvature = self.curve.nearest(places)
        arms = places - feet
        depths = np.linalg.norm(arms, axis=1, keepdims=True)
        bent = depths * (-curvature if self.hole else curvature)
        alone = [
            np.linalg.norm(self.curve.nearest(feet + way * arms)[0] - feet, axis=1)
            < 1e-6 * depths[:, 0]
            for way in (APART, -APART)
        ]
        with np.errstate(divide="ignore"):
            return np.where(alone[0] & alone[1], ((1 + bent) / (1 - bent)).prod(axis=1), 0.0)


Mirror = ReflectionPlane | HeldBoundary


@dataclass(frozen=True)
class Ghosts:
    """Ghosts of a body, stored after the body's points in every array that holds both.

    The motion of a ghost follows from that of the point that it mirrors: relative to the plane,
    each displacement component of the ghost is that of the point times the parity, +1 (even) or -1
    (odd), of the plane. The neighborhood of the ghost is that of the point, reflected. An image of
    an image has the products of the signs of both reflections.

    Attributes
    ----------
    source : ndarray of uint32, shape (m,)
        The body's point that each ghost is an image of.
    points : ndarray, shape (m, d)
        Reference positions.
    parity : ndarray, shape (m, d)
        +1 or -1 for each displacement component; beyond held boundaries of other shapes a negative
        factor (theory (67)).
    reflection : ndarray, shape (m, d)
        +1 or -1 for each direction of the neighborhood.
    volume_ratio : ndarray, shape (m,)
        Volume of each ghost divided by that of its source; 1 beyond planes.
    unfolded : ndarray, shape (m, d)
        Reference positions of the ghosts if held boundaries did not reflect: of the source, or of
        its image in planes alone.
    normal : ndarray, shape (m, d)
        Unit normal of the held boundary in which each ghost is reflected, at its foot; 0 beyond
        planes alone.
    plane : ndarray of int64, shape (m,)
        Number in `planes` of the plane beyond which the ghost lies; for an image of an image, of
        the plane of the last reflection.
    image : ndarray of int64, shape (m,)
        Bit mask of the planes in which the ghost is reflected.
    lever : ndarray, shape (m, planes, d)
        Factor by which the displacement of each plane displaces each ghost, component by component.
    feet : ndarray, shape (m, planes, d)
        Points of the planes about which each ghost was mirrored; meaningful only for the planes in
        the ghost's mask `image`.
    gradient_parity, gradient_reflection : ndarray, shape (m, d)
        Parity and reflection for deformation gradients; they differ where gradients are not
        continued as displacements are, see `held_by_clamps`.
    parent : ndarray of int64, shape (m,)
        Number of the point or ghost that the ghost mirrors in `plane`: its source, or for an image
        of an image another ghost.
    planes : tuple of ReflectionPlane or HeldBoundary
        Boundaries first.
    share : Share
        Points that this rank works on, of which these are the images.
    share_along : float or None
        The argument `share` of `held_by_clamps`; None if deformation gradients are continued as
        displacements are.
    """

    source: np.ndarray
    points: np.ndarray
    parity: np.ndarray
    reflection: np.ndarray
    volume_ratio: np.ndarray
    unfolded: np.ndarray
    normal: np.ndarray
    plane: np.ndarray
    image: np.ndarray
    lever: np.ndarray
    feet: np.ndarray
    parent: np.ndarray
    gradient_parity: np.ndarray
    gradient_reflection: np.ndarray
    planes: tuple[Mirror, ...]
    share: Share
    share_along: float | None = None

    @classmethod
    def reflected(
        cls, points: np.ndarray, planes: tuple[Mirror, ...], horizon: float, share: Share
    ) -> Ghosts:
        """Return the ghosts of the points of a share: their images within a horizon beyond planes,
        and images of images where planes meet.

        Raise ValueError if points lie beyond a plane, or if the parity of a plane is of another
        dimension than the points.
        """
        n, dimension = points.shape
        reach = horizon * WITH_ROUNDING
        # The others have no images: an image of an image is one of a point that has another, too.
        close = np.zeros(n, dtype=bool)
        for plane in planes:
            if len(plane.parity) != dimension:
                raise ValueError(
                    f"the parity of a plane must have {dimension} components, not {plane.parity}"
                )
            depth = plane.mirrored(points)[1]
            if isinstance(plane, ReflectionPlane) and depth.min() < 0:
                raise ValueError(
                    f"points lie beyond the reflection plane x{plane.axis + 1} = {plane.position:g}"
                )
            close |= depth <= reach
        rows = np.flatnonzero(close)
        k = len(rows)
        each = np.zeros((k, len(planes), dimension))
        made = {
            "source": rows,
            "parent": rows,
            "plane": np.full(k, -1),
            "image": np.zeros(k, dtype=np.int64),
            "points": points[rows],
            "unfolded": points[rows],
            "parity": np.ones((k, dimension)),
            "reflection": np.ones((k, dimension)),
            "normal": np.zeros((k, dimension)),
            "volume_ratio": np.ones(k),
            "lever": each,
            "feet": each,
        }
        # of the plane of each image; -1 for the points
        axes = np.array([*(plane.axis for plane in planes), -1])
        for added, plane in enumerate(planes):
            flat = isinstance(plane, ReflectionPlane)
            places = made["points"]
            nearest, inward = plane.mirrored(places)
            # Images of images in two parallel planes are farther away than a horizon, as the body
            # is at least that long. The centroid of a cell at a reentrant corner may lie outside a
            # boundary.
            beyond = made["plane"]
            able = axes[beyond] != plane.axis if flat else (beyond < 0) & (inward > 0)
            near = np.flatnonzero((inward <= reach) & able)
            ratios = np.ones(len(near)) if flat else plane.ratios(places[near])
            near = near[ratios > 0]
            ratios = ratios[ratios > 0]
            images = {name: values[near] for name, values in made.items()}
            own = np.asarray(plane.parity, float)
            feet = nearest[near]
            images["points"] = 2 * feet - places[near]
            if flat:
                flip = np.where(np.arange(dimension) == plane.axis, -1.0, 1.0)
                images["reflection"] *= flip
                images["unfolded"] *= flip
                images["unfolded"][:, plane.axis] += 2 * plane.position
                images["lever"] *= own
            else:
                arms = places[near] - feet
                images["normal"] = arms / np.linalg.norm(arms, axis=1, keepdims=True)
                own = own * (1 + plane.bent(places[near]))[:, None]
                # moves as the image does if the point rests
                feet = (2 * feet - (1 + own) * places[near]) / (1 - own)
                images["lever"] *= own[:, None]
            images["parent"] = np.append(rows, np.arange(n, n + len(places) - k))[near]
            images["plane"] = np.full(len(near), added)
            images["image"] += 2**added
            images["parity"] *= own
            images["volume_ratio"] *= ratios
            images["lever"][:, added] += 1 - own
            images["feet"][:, added] = feet
            made = {name: np.concatenate([made[name], values]) for name, values in images.items()}
        found = {name: values[k:].copy() for name, values in made.items()}
        found["source"] = found["source"].astype(np.uint32)
        found |= {"gradient_parity": found["parity"], "gradient_reflection": found["reflection"]}
        return cls(**found, planes=planes, share=share).continued(None)

    def __len__(self) -> int:
        return len(self.source)

    def held_by_clamps(self, share: float) -> Ghosts:
        """Return these ghosts with another continuation of deformation gradients, for a material
        that hardly changes its volume.

        The image of an incompressible source should keep its volume too. But if all displacement
        components are odd, as beyond a clamped plane, the strain along the plane has opposite signs
        in source and image, and the strain across the plane the same sign: the image of a source
        that keeps its volume changes its own, and bonded edges are too stiff. The ghosts returned
        here have other gradients beyond clamped planes: the column of F for the normal direction is
        that of the source, and the columns for the directions along the plane are `share` times
        those of the source plus 1 - `share` times those of the plane's known motion (theory (53)).
        Beyond held boundaries of other shapes all of the gradient along the boundary is that of its
        motion.
        """
        return self.continued(share)

    def continued(self, share: float | None) -> Ghosts:
        """Return these ghosts with gradients continued as displacements are or, with a `share`,
        as in `held_by_clamps`.
        """
        dimension = self.points.shape[1]
        parity = np.ones(self.parity.shape)
        reflection = np.tile(np.eye(dimension), (len(self), 1, 1))
        for number, plane in enumerate(self.planes):
            images = (self.image >> number) & 1 == 1
            of_rows, of_columns, _, _ = self._continuation(plane, share, images)
            parity[images] *= of_rows
            reflection[images] = reflection[images] @ of_columns
        return replace(
            self, gradient_parity=parity, gradient_reflection=reflection, share_along=share
        )

    def _continuation(
        self, plane: Mirror, share: float | None, chosen: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """Return how F - I continues beyond a plane to k `chosen` ghosts: as P (F - I) S + w (Q -
        I) T, with the turn Q of the plane.

        P (a diagonal) and w (weights of rows) have shape (d,), S and the projections T onto the
        plane (k, d, d). `share` is the argument of `continued`.
        """
        parity = np.array(plane.parity, dtype=float)
        normals = self.normal[chosen]
        if isinstance(plane, ReflectionPlane):
            normals = np.tile(np.eye(len(parity))[plane.axis], (len(normals), 1))
        across = normals[:, :, None] * normals[:, None]
        share = _share_of(plane, share)
        along = np.eye(len(parity)) - across
        if share is None or (parity > 0).any():
            return parity, along - across, 1 - parity, along
        return np.ones_like(parity), across + share * along, np.full_like(parity, 1 - share), along

    def mirrored(self, points: np.ndarray, ghosts: np.ndarray) -> np.ndarray:
        """Return, for pairs of points i and ghosts of points k, the numbers of the ghosts of i
        in the same planes; -1 if there are none.
        """
        number = np.full((int(self.image.max(initial=0)) + 1, len(self.share.numbers)), -1)
        number[self.image, self.source] = np.arange(len(self))
        return number[self.image[ghosts], points]

    def shifts(
        self, points: np.ndarray, displacements: np.ndarray, turns: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the shifts of the ghosts, shape (m, d), if every plane is displaced by u(X) =
        displacement + turn X.

        The ghost of a source at y is at shift + P y with the parity P. `points` (n, d) are the
        reference positions of the body's points. `displacements` have shape (planes, d). `turns`
        (planes, d, d) belong to planes that are odd in all components; a rotation Q has turn Q - I.
        """
        at_rest = self.points - self.parity * points[self.source]
        return at_rest + self.moved_by_planes(displacements, turns)

    def moved_by_planes(
        self, displacements: np.ndarray, turns: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the displacements (..., m, d) of the ghosts due to the planes alone, while the
        body's points do not move; see `shifts`.
        """
        moved = np.zeros(displacements.shape[:-2] + self.points.shape)
        for plane in np.flatnonzero(displacements.any(axis=(*range(displacements.ndim - 2), -1))):
            moved += self.lever[:, plane] * displacements[..., None, plane, :]
        if turns is not None:
            moved += np.einsum("mpr,prc,mpc->mr", self.lever, turns, self.feet)
        return moved

    def gradient_shifts(self, turns: np.ndarray) -> np.ndarray:
        """Return the changes of the ghosts' gradients by turns Q - I (planes, d, d) of the planes;
        shape (m, d d), column after column.

        Only the columns of F for directions along a plane change, as the body is bonded to the
        plane and turns with it. They do not change if `share_along` is 1: a ghost then has the
        gradient of its source, however its plane turns.
        """
        shifts = np.zeros((len(self), turns.shape[1], turns.shape[1]))
        # The planes are processed in order, since images of images copy the values of the images
        # that they mirror.
        for number, plane in enumerate(self.planes):
            images = (self.image >> number) & 1 == 1
            of_rows, of_columns, of_plane, along = self._continuation(
                plane, self.share_along, images
            )
            shifts[images] = of_rows[:, None] * (shifts[images] @ of_columns) + of_plane[
                :, None
            ] * (turns[number] @ along)
        # a rank may have no images
        return shifts.transpose(0, 2, 1).reshape(len(self), turns.shape[1] ** 2)

    def levers_on_planes(
        self, positions: np.ndarray, gradients: np.ndarray, forces: np.ndarray, moments: np.ndarray
    ) -> np.ndarray:
        """Return the first moments of the forces of every plane on the body, sums of f (x) y, shape
        (planes, d, d).

        f is the force that the plane exerts on the body at the place y. The sums follow from
        virtual work. A virtual displacement W y of the space beyond a plane displaces an image by
        W (y - P y'), with the places y of the image and y' of the point or ghost that it mirrors
        and the parity P of each row of W, and changes its gradient; the energy changes by W : (f
        (x) y). Even rows, along a roller or a plane of symmetry, are the couples of forces on
        images that lie across the plane from their points. `forces` (m, d) are minus the
        derivatives of an energy by the positions of the ghosts, `moments` (m, d, d) its derivatives
        by their gradients, and `gradients` (n + m, d, d) include those of the ghosts. The planes
        are taken from the last to the first, since contributions of images of images are passed on
        to the images.
        """
        n = len(positions) - len(self)
        dimension = positions.shape[1]
        forces = forces.copy()
        moments = moments.copy()
        levers = np.zeros((len(self.planes), dimension, dimension))
        for number, own, above, parity, rows, columns in self._mirrored_last_first:
            pulls = forces[own]
            levers[number] += np.einsum("gr,gc->rc", parity * pulls, positions[above])
            levers[number] -= np.einsum("gr,gc->rc", pulls, positions[n + own])
            turned, continued = (
                np.einsum("grb,gcb->rc", moments[own], one)
                for one in (gradients[n + own], gradients[above] @ columns)
            )
            levers[number] += turned - rows[:, None] * continued
            again = np.flatnonzero(above >= n)
            if len(again):
                np.add.at(forces, above[again] - n, (parity * forces[own])[again])
                passed = rows[:, None] * (moments[own[again]] @ columns[again])
                np.add.at(moments, above[again] - n, passed)
        return levers

    @cached_property
    def _mirrored_last_first(self) -> list[tuple]:
        """Planes from the last to the first, each with its number, those of its images and of what
        these mirror, their parities, and what continues their gradients.
        """
        found = []
        for number in reversed(range(len(self.planes))):
            own = np.flatnonzero(self.plane == number)
            plane = self.planes[number]
            curved = isinstance(plane, HeldBoundary)
            parity = self.parity[own] if curved else np.array(plane.parity, float)[None]
            continued = self._continuation(plane, self.share_along, own)[:2]
            found.append((number, own, self.parent[own], parity, *continued))
        return found

    @property
    def of_gradients(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Source, parity and reflection of every ghost for deformation gradients, as the passes of
        `kernels.ghosts` take them.

        On a body that is symmetric about the plane, the gradients of ghosts equal F as summed over
        their own horizons (theory (1)).
        """
        return self.source, self.gradient_parity, self.gradient_reflection

    def fill_shapes(self, shapes: np.ndarray, images: np.ndarray | slice = slice(None)) -> None:
        """Write shape tensors (or their inverses), S K_source S with the reflection S, of all
        ghosts or some `images` into `shapes`.
        """
        self.share.fill(shapes)
        normal = self.normal[images]
        reflection = self.reflection[images]
        if not len(normal):
            return
        one, other = np.triu_indices(reflection.shape[1])
        flips = np.eye(normal.shape[1]) - 2 * normal[:, :, None] * normal[:, None]
        found = flips @ symmetric(shapes[self.source[images]]) @ flips
        shapes[len(shapes) - len(self) :][images] = (
            found[:, one, other] * reflection[:, one] * reflection[:, other]
        )

    def reflected_vectors(self, vectors: np.ndarray) -> np.ndarray:
        """Return vectors (n, d) at the points, such as normals of an interface, as the ghosts'
        neighborhoods have them, shape (m, d).
        """
        of_sources = vectors[self.source]
        across = np.einsum("gi,gi->g", of_sources, self.normal)
        return self.reflection * (of_sources - 2 * across[:, None] * self.normal)

    def fill(self, values: np.ndarray) -> None:
        """Copy values from the sources to the ghosts, in place."""
        self.share.fill(values)
        values[len(values) - len(self) :] = values[self.source]


def symmetric(triangles: np.ndarray) -> np.ndarray:
    """Return symmetric matrices, shape (k, d, d), from their upper triangles row by row, shape
    (k, d (d + 1)/2).
    """
    d = math.isqrt(2 * triangles.shape[1])
    place = np.zeros((d, d), dtype=np.int64)
    place[np.triu_indices(d)] = np.arange(triangles.shape[1])
    return triangles[:, np.maximum(place, place.T)]


def _share_of(plane: Mirror, share: float | None) -> float | None:
    """Return the argument of `Ghosts.continued` for a plane, and 0 for held boundaries of other
    shapes (theory (68)).
    """
    return 0.0 if isinstance(plane, HeldBoundary) else share
