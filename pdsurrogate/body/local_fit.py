"""Motion and deformation gradient at places of a body, from polynomials fitted to the points
around them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement

import numpy as np
import scipy

from .body import Body
from .ghosts import Ghosts, ReflectionPlane

REACH = 1.3
"""Distance, in horizons, within which points contribute to a fit.

A load on the boundary acts on the adjacent rows of points with the weights of the fit there. Where
these differ from the forces that a uniformly stressed body exerts on the rows, the rows are
displaced. At a straight edge under a uniform traction this displaces the edge by 1.7 (analytic bond
forces) and 0.7 (bond energies) cells times the strain if two rows carry the load, by 0.37 and 0.05
with one horizon, and by 0.04 with 1.3, near the minimum of both (horizons of 3.15 cells).
"""

LEAST_REACH = 2.5
"""Least distance, in cells, within which points contribute to a fit, however short the horizon:
it includes two rows at a straight edge.
"""

ALONG = 0.7
"""Distance along the boundary, in cells, at which the weight of a point in a fit is 1/e; across the
boundary weights extend to `REACH`.

Loads spread no farther than this along an edge. If they spread as far as across it, the row at a
corner has 1.6 times its share, and the middle of a square of 20 cells pulled at its edge is
displaced by 0.05 and 0.04 cells times the strain (in the two models of `REACH`); with this value,
by 0.019 and 0.005.
"""

LEAST_WEIGHT = 1e-6
"""Weight below which a point is left out of a fit on the boundary; a point at the place of the fit
itself has weight 1 for each normal. With `ALONG` this leaves out points more than 2.6 cells away
along the boundary. Chosen: the fit neglects weights of a millionth at most.
"""

THINNEST = 0.05
"""Least deviation of the points, in cells (weighted root mean square), from every straight line, or
from every parabola in a quadratic fit; the points of one row define no slope across it. Chosen: two
equal rows deviate by 0.5, one row by nothing or, on a mesh, by a small part of a cell.
"""

MOST_AMPLIFICATION = 6.0
"""Greatest sum of the absolute weights of points in a quadratic fit, above which the fit is linear;
errors of single points may be amplified by this sum. It is 1.8 inside a body, 2 to 4 at edges and
round holes, and 30 to 50 at the poles of a sphere, where few points lie in the outermost layers.
"""

MIRRORED = 2.5
"""Distance from a plane of symmetry, in cells, within which the fit of the motion on the boundary
uses mirror images of points; farther away the weights of images are below `LEAST_WEIGHT`.
"""

ROUNDING = 1e-6
"""Distance from a plane of symmetry, in cells, up to which a node lies in it, and deviation from 1
up to which a component of a unit normal is that of a facet in the plane. Chosen above the rounding
of coordinates in single precision that meshes may have, and far below a cell.
"""

OUTSIDE = 1.25
"""Distance from the nearest point, in cells, beyond which a place lies outside: a corner of a cell
lies 0.71 away, and cells that absorb a cut neighbor extend half a cell farther.
"""


def interpolation(
    body: Body, places: np.ndarray, portion_of: np.ndarray | None = None
) -> tuple[scipy.sparse.csr_array, tuple[scipy.sparse.csr_array, ...]]:
    """Return matrices that map positions of a body's points to positions and deformation gradients
    at given places.

    A quadratic field is fitted to the points around a place that no hole or cut separates from it:
    quadratic motions are exact, with their gradients. The field is linear where the points are too
    few, lie on two lines, or would make a quadratic fit amplify errors.

    Parameters
    ----------
    body : Body
    places : ndarray, shape (k, d)
        Places in the reference state, in the body or on its boundary.
    portion_of : ndarray of int, shape (n,), optional
        Number of the material of every point, in a body of several materials: the motion has a kink
        at an interface, so only points of the same material as the point nearest to a place are
        used.

    Returns
    -------
    values : csr_array, shape (k, n)
        ``values @ positions`` are the positions of the places; rows sum to 1.
    gradients : tuple of d csr_array, shape (k, n)
        ``gradients[b] @ positions`` are the derivatives of positions by X_b, columns of F; rows sum
        to 0.

    Raises
    ------
    ValueError
        If a place lies outside the body, or too few points are near it.
    """
    values, *gradients = _polynomials(body, places, portion_of)
    return values, tuple(gradients)


def fields_at(
    body: Body, places: np.ndarray, portion_of: np.ndarray | None = None
) -> tuple[tuple[scipy.sparse.csr_array, ...], tuple[scipy.sparse.csr_array, ...]]:
    """Return matrices that interpolate displacements and tensors of a body's points to given
    places, one matrix for every component.

    They are the ``values`` of `interpolation`, except near a plane of symmetry in three dimensions.
    There the fits of tensors and of the displacements along the plane include the mirror images of
    points. The fit of the displacement across the plane does not: the displacement of an image
    across the plane depends on the motion of the plane as well.

    Parameters
    ----------
    body, places, portion_of : see `interpolation`

    Returns
    -------
    displacements : tuple of d csr_array, shape (k, n)
    tensors : tuple of 9 csr_array, shape (k, n)
        Matrices for the components 11, 12, ... of tensors T in three dimensions, such as stresses
        and deformation gradients, whose mirror image is S T S with the reflection S.

    Raises
    ------
    ValueError
        See `interpolation`.
    """
    d, mirrors = body.dimension, _mirrors(body)
    rows, _ = interpolation(body, places, portion_of)
    reach = _reach(body)
    if not any((np.abs(places[:, plane.axis] - plane.position) < reach).any() for plane in mirrors):
        return (rows,) * d, (rows,) * 9
    displacements = []
    for component in range(d):
        even = [plane for plane in mirrors if plane.axis != component]
        displacements.append(
            _folded(_polynomials(body, places, portion_of, even)[0], _Images(body, even))
        )
    images = _Images(body, mirrors)
    rows = _polynomials(body, places, portion_of, mirrors)[0]
    signs = images.signs.T
    tensors = [
        _folded(rows, images, signs[one] * signs[other]) for one in range(d) for other in range(d)
    ]
    return tuple(displacements), tuple(tensors)


def _polynomials(
    body: Body,
    places: np.ndarray,
    portion_of: np.ndarray | None,
    mirrors: Sequence[ReflectionPlane] = (),
) -> list[scipy.sparse.csr_array]:
    """Return the matrices from fields at points and images to values, and derivatives along the
    axes, at places; see `interpolation`.

    `mirrors` are the reflection planes in which points have images.
    """
    distance, nearest = scipy.spatial.cKDTree(body.points).query(places)
    far = distance > OUTSIDE * body.cell.max()
    if far.any():
        place = int(np.argmax(distance))
        near = (
            f"its nearest point is {nearest[place]} at {text_of(body.points[nearest[place]])},"
            f" {distance[place]:.3g} away"
        )
        raise ValueError(f"{text_of(places[place])} lies outside the body; {near}")
    own = None if portion_of is None else portion_of[nearest]
    quadratic = _Surroundings(body, places, mirrors=mirrors).of(portion_of, own).fit(2)
    rest = np.flatnonzero(empty_rows(quadratic[0]))
    linear = (
        _Surroundings(body, places[rest], mirrors=mirrors)
        .of(portion_of, None if own is None else own[rest])
        .fit(1)
    )
    lost = empty_rows(linear[0])
    if lost.any():
        few = f"the points nearby, on this side of holes and cuts, are {too_few(body)}"
        raise ValueError(
            f"{text_of(places[rest[lost.argmax()]])}: the deformation is undefined here: {few}; use"
            f" {body.finer}"
        )
    return [_filled(rows, others, rest) for rows, others in zip(quadratic, linear, strict=True)]


def boundary_rows(
    body: Body, nodes: np.ndarray, normals: np.ndarray
) -> tuple[scipy.sparse.csr_array, ...]:
    """Return the maps from the motion of points to the motion of nodes (k, d) on the boundary, for
    `Following.rows`.

    A linear field is fitted to the points beside a node along the normals of the sides that meet
    there. Where these are too few, as in a sharp corner, the field is fitted to all points within
    reach. The maps reproduce affine motions exactly. `normals` (k, sides, d) are the unit normals
    of the sides, NaN where fewer meet. There is one map for all components, or one for each; a row
    is empty where the points near a node are too few or on one line.

    In three dimensions the fit of the motion along a plane of symmetry includes mirror images of
    the points, the fit of the motion across the plane does not, since an image moves with the
    plane. The normal of a face in such a plane is ignored.
    """
    rows = _on_boundary(body, nodes, normals)
    mirrors = _mirrors(body)
    near = [
        np.abs(nodes[:, plane.axis] - plane.position) < MIRRORED * body.cell.max()
        for plane in mirrors
    ]
    beside = np.flatnonzero(np.any(near, axis=0)) if mirrors else np.empty(0, dtype=int)
    if not len(beside):
        return (rows,)
    normals = normals[beside].copy()
    for plane in mirrors:
        on_plane = np.abs(nodes[beside, plane.axis] - plane.position) < ROUNDING * body.cell.max()
        flat = np.abs(normals[..., plane.axis]) > 1 - ROUNDING
        normals[on_plane[:, None] & flat] = np.nan
        normals[on_plane, :, plane.axis] *= 0.0
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    changed = (
        scipy.sparse.diags_array(
            np.isin(np.arange(len(nodes)), beside, invert=True).astype(float), format="csr"
        )
        @ rows
    )
    changed.eliminate_zeros()
    found = []
    for component in range(body.dimension):
        even = [plane for plane in mirrors if plane.axis != component]
        found.append(_filled(changed, _on_boundary(body, nodes[beside], normals, even), beside))
    return tuple(found)


def _on_boundary(
    body: Body, nodes: np.ndarray, normals: np.ndarray, mirrors: Sequence[ReflectionPlane] = ()
) -> scipy.sparse.csr_array:
    """Return the map from points to boundary nodes; see `boundary_rows`.

    It is fitted to points, and images in the planes `mirrors`, along the normals of a node, or
    around the node where that fails.
    """
    rows = _Surroundings(body, nodes, normals, mirrors).fit(1)[0]
    rest = np.flatnonzero(empty_rows(rows))
    return _folded(
        _filled(rows, _Surroundings(body, nodes[rest], mirrors=mirrors).fit(1)[0], rest),
        _Images(body, mirrors),
    )


def _mirrors(body: Body) -> list[ReflectionPlane]:
    """Return the planes of symmetry of a body in three dimensions (odd normal displacement,
    others even); none for a sheet.
    """
    if body.dimension == 2:
        return []
    return [
        plane
        for plane in body.planes
        if all((sign < 0) == (axis == plane.axis) for axis, sign in enumerate(plane.parity))
    ]


def _reach(body: Body) -> float:
    """Return the distance from a place within which points of a body contribute to a polynomial
    fit.
    """
    return max(REACH * body.horizon, LEAST_REACH * body.cell.max())


class _Images:
    """Points of a body and their images in reflection planes, used by polynomial fits near the
    planes.

    Attributes
    ----------
    points : ndarray, shape (m, d)
        Reference positions of the points, then of the images.
    source : ndarray of int, shape (m,)
        Number of each point itself, or of the point that an image mirrors.
    signs : ndarray, shape (m, d)
        -1 along the axes along which an image is reflected, +1 along the others and for points.
    """

    def __init__(self, body: Body, planes: Sequence[ReflectionPlane]) -> None:
        self.count, ghosts = (
            len(body),
            Ghosts.reflected(body.points, tuple(planes), _reach(body), body.share),
        )
        self.points = np.concatenate([body.points, ghosts.points])
        self.source = np.concatenate([np.arange(len(body)), ghosts.source])
        self.signs = np.concatenate([np.ones(body.points.shape), ghosts.reflection])


def _folded(
    rows: scipy.sparse.csr_array, images: _Images, signs: np.ndarray | None = None
) -> scipy.sparse.csr_array:
    """Turn a map from points and images, `rows`, into a map from points: an image has its
    source's value times `signs` (default 1).
    """
    if len(images.source) == images.count:
        return rows
    signs = np.ones(len(images.source)) if signs is None else signs
    return rows @ scipy.sparse.csr_array(
        (signs, (np.arange(len(signs)), images.source)), shape=(len(signs), images.count)
    )


def too_few(body: Body) -> str:
    """Return words for error messages: how few points, or in what arrangement, do not define a
    deformation gradient.
    """
    return (
        "fewer than three, or in one row"
        if body.dimension == 2
        else "fewer than four, or in one layer"
    )


def empty_rows(rows: scipy.sparse.csr_array) -> np.ndarray:
    """Return flags of the rows of a sparse matrix that have no entries."""
    return np.diff(rows.indptr) == 0


def _filled(
    rows: scipy.sparse.csr_array, others: scipy.sparse.csr_array, numbers: np.ndarray
) -> scipy.sparse.csr_array:
    """Return `rows` with ``others[k]`` added to row ``numbers[k]``, which must be empty in
    `rows`.
    """
    if not len(numbers):
        return rows
    into = scipy.sparse.csr_array(
        (np.ones(len(numbers)), (numbers, np.arange(len(numbers)))),
        shape=(rows.shape[0], len(numbers)),
    )
    return (rows + into @ others).tocsr()


class _Surroundings:
    """Points near each of several places, except those that a hole or cut separates from the place,
    and their weights in a polynomial fit.

    The weight of a point is its volume times 1 - (distance / reach)^2, where `_reach` gives the
    reach. If `normals` are given, the unit normals of the boundary at every place (k, sides, d), it
    is the volume times the sum over these normals of 1 - (depth / reach)^2 times a Gaussian of the
    sideways distance (`ALONG`), where depth is the distance along the normal. The weights are
    scaled to sum to 1 at each place. Images of points in the planes `mirrors` count as points.
    """

    def __init__(
        self,
        body: Body,
        places: np.ndarray,
        normals: np.ndarray | None = None,
        mirrors: Sequence[ReflectionPlane] = (),
    ) -> None:
        images = _Images(body, mirrors)
        points, self.source = images.points, images.source
        self.shape, self.cell, self.reach = (
            (len(places), len(points)),
            body.cell.max(),
            _reach(body),
        )
        near = scipy.spatial.cKDTree(places).sparse_distance_matrix(
            scipy.spatial.cKDTree(points), self.reach, output_type="ndarray"
        )
        near = near[np.lexsort((near["j"], near["i"]))]
        weights = 1 - (near["v"] / self.reach) ** 2
        if normals is not None:
            offsets = points[near["j"]] - places[near["i"]]
            depths = np.einsum("pd,pnd->pn", offsets, normals[near["i"]])
            beside = near["v"][:, None] ** 2 - depths**2
            weights = np.nansum(
                (1 - (depths / self.reach) ** 2) * np.exp(-beside / (ALONG * self.cell) ** 2),
                axis=1,
            )
            near, weights = near[weights > LEAST_WEIGHT], weights[weights > LEAST_WEIGHT]
        if body.separates is not None and len(near):
            bound = ~body.separates(places[near["i"]], points[near["j"]])
            near, weights = near[bound], weights[bound]
        self.place, self.point = near["i"], near["j"]
        weights = weights * body.volumes[self.source[self.point]]
        self.weights = weights / self._total(weights)[self.place]
        self.offsets = (points[self.point] - places[self.place]) / self.reach

    def of(self, portion_of: np.ndarray | None, own: np.ndarray | None) -> _Surroundings:
        """Keep only points of material ``own[k]`` around place k, scale their weights to sum to 1,
        and return self.

        `portion_of` is the material of every point of the body; if it is None all points are kept.
        """
        if portion_of is not None:
            kept = portion_of[self.source[self.point]] == own[self.place]
            self.place, self.point, self.offsets, weights = (
                self.place[kept],
                self.point[kept],
                self.offsets[kept],
                self.weights[kept],
            )
            self.weights = weights / self._total(weights)[self.place]
        return self

    def _total(self, terms: np.ndarray) -> np.ndarray:
        return np.bincount(self.place, terms, self.shape[0])

    def fit(self, degree: int) -> tuple[scipy.sparse.csr_array, ...]:
        """Return matrices from values at points to value and derivatives at places, by a
        least-squares polynomial of a degree.

        A place has an empty matrix row if the points near it are too few or lie on a line (in space
        also: in a plane), or, from degree 2, if the fit would amplify errors of the values at the
        points by more than `MOST_AMPLIFICATION`.
        """
        dimension = self.offsets.shape[1]
        powers = [
            chosen
            for order in range(degree + 1)
            for chosen in combinations_with_replacement(range(dimension), order)
        ]
        terms = np.stack([self.offsets[:, chosen].prod(axis=1) for chosen in powers], axis=1)
        normal = np.empty((self.shape[0], len(powers), len(powers)))
        for row in range(len(powers)):
            for column in range(row, len(powers)):
                normal[:, row, column] = normal[:, column, row] = self._total(
                    self.weights * terms[:, row] * terms[:, column]
                )
        told = np.linalg.eigvalsh(normal)[:, 0] > (THINNEST * self.cell / self.reach) ** (
            2 * degree
        )
        normal[~told] = np.eye(len(powers))
        # The coefficients are M^-1 sum w p(x_j) y_j; the first is the value at the place, the next
        # ones are the slopes.
        inverse = np.linalg.inv(normal)
        if degree > 1:
            value = self.weights * (inverse[self.place, 0] * terms).sum(axis=1)
            told &= self._total(np.abs(value)) <= MOST_AMPLIFICATION
        kept = told[self.place]
        pointers = np.concatenate(
            [[0], np.cumsum(np.bincount(self.place[kept], minlength=self.shape[0]))]
        )

        def rows(coefficient: int) -> scipy.sparse.csr_array:
            entries = self.weights * (inverse[self.place, coefficient] * terms).sum(axis=1)
            return scipy.sparse.csr_array(
                (entries[kept], self.point[kept], pointers), shape=self.shape
            )

        return rows(0), *(rows(1 + axis) / self.reach for axis in range(dimension))


def text_of(place: np.ndarray) -> str:
    """Return the coordinates of a place as text for messages."""
    return f"({', '.join(f'{coordinate:.4g}' for coordinate in place)})"
