"""Motion and deformation gradient at places of a body, from polynomials fitted to the points
around them.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
import scipy

from .body import Body
from .bonds import pointers_to
from .ghosts import WITH_ROUNDING, Ghosts
from .surface import Following

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

OUTSIDE = 1.25
"""Distance from the nearest point, in cells, beyond which a place lies outside: a corner of a cell
lies 0.71 away, and cells that absorb a cut neighbor extend half a cell farther.
"""


def fields_at(
    body: Body, places: np.ndarray, portion_of: np.ndarray | None = None
) -> tuple[Following, tuple[scipy.sparse.csr_array, ...]]:
    """Return maps that interpolate displacements and tensors of a body's points to given places.

    A quadratic field is fitted to the points around a place that no hole or cut separates from it,
    and to their images in planes of symmetry: quadratic motions are exact. The field is linear
    where the points are too few, lie on two lines, or would make a quadratic fit amplify errors.

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
    displacements : Following
    tensors : tuple of 9 csr_array, shape (k, n)
        Matrices for the components 11, 12, ... of tensors T in three dimensions, such as stresses
        and deformation gradients, whose mirror image is S T S with the reflection S.

    Raises
    ------
    ValueError
        If a place lies outside the body, or too few points are near it.
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
    images = _Images(body)
    rows = _Surroundings(body, images, places).of(portion_of, own).fit(2)
    rest = np.flatnonzero(empty_rows(rows))
    linear = (
        _Surroundings(body, images, places[rest])
        .of(portion_of, None if own is None else own[rest])
        .fit(1)
    )
    lost = empty_rows(linear)
    if lost.any():
        few = f"the points nearby, on this side of holes and cuts, are {too_few(body)}"
        raise ValueError(
            f"{text_of(places[rest[lost.argmax()]])}: the deformation is undefined here: {few}; use"
            f" {body.finer}"
        )
    rows = _filled(rows, linear, rest)
    signs = np.ones((len(images.source), 3))
    signs[:, : body.dimension] = images.signs
    # Components with the same signs at all images have one matrix.
    products = [one * other for one in signs.T for other in signs.T]
    different = {each.tobytes(): each for each in products}
    folded = {key: images.folded(rows, each) for key, each in different.items()}
    return images.followed(rows), tuple(folded[each.tobytes()] for each in products)


def boundary_rows(body: Body, nodes: np.ndarray, normals: np.ndarray) -> Following:
    """Return the map from the motion of points to the motion of nodes (k, d) on the boundary.

    A linear field is fitted to the points beside a node, and their images in planes of symmetry,
    along the normals of the sides that meet there. Where these are too few, as in a sharp corner,
    the field is fitted to all points within reach. The map reproduces affine motions exactly.
    `normals` (k, sides, d) are the unit normals of the sides, NaN where fewer meet. A row is empty
    where the points near a node are too few or on one line.
    """
    images = _Images(body)
    rows = _Surroundings(body, images, nodes, normals).fit(1)
    rest = np.flatnonzero(empty_rows(rows))
    return images.followed(_filled(rows, _Surroundings(body, images, nodes[rest]).fit(1), rest))


class _Images:
    """Points of a body and their images in planes of symmetry, to which polynomials are fitted.

    Attributes
    ----------
    points : ndarray, shape (m, d)
        Reference positions of the points, then of the images.
    tree : cKDTree
        Search tree of these.
    source : ndarray of int, shape (m,)
        Number of each point itself, or of the point that an image mirrors.
    signs : ndarray, shape (m, d)
        -1 along the axes along which an image is reflected, +1 along the others and for points.
    reach : float
        Distance from a place within which points contribute to a fit.
    """

    def __init__(self, body: Body) -> None:
        self.reach = max(REACH * body.horizon, LEAST_REACH * body.cell.max())
        planes = {number: plane for number, plane in enumerate(body.planes) if plane.symmetric}
        ghosts = Ghosts.reflected(body.points, tuple(planes.values()), self.reach, body.share)
        self._count = len(body)
        self.points = np.concatenate([body.points, ghosts.points])
        self.tree = scipy.spatial.cKDTree(self.points)
        self.source = np.concatenate([np.arange(len(body)), ghosts.source])
        self.signs = np.concatenate([np.ones(body.points.shape), ghosts.reflection])
        self._planes = [
            (number, plane, np.concatenate([np.zeros(len(body)), (ghosts.image >> bit) & 1]))
            for bit, (number, plane) in enumerate(planes.items())
        ]

    def followed(self, rows: scipy.sparse.csr_array) -> Following:
        """Return the map that follows points and images with given weights (k, m)."""
        across = (
            (number, plane.axis, self.folded(rows, 2 * seen))
            for number, plane, seen in self._planes
        )
        return Following(
            self.folded(rows, np.ones(len(self.source))),
            tuple(each for each in across if each[2].nnz),
        )

    def folded(self, rows: scipy.sparse.csr_array, factors: np.ndarray) -> scipy.sparse.csr_array:
        """Turn a map from points and images, `rows`, into a map from points: values of images are
        those of their sources, all times `factors` (m,).
        """
        some = np.flatnonzero(factors)
        where = some, self.source[some]
        sums = scipy.sparse.csr_array((factors[some], where), shape=(len(factors), self._count))
        return rows @ sums


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

    The weight of a point is its volume times 1 - (distance / reach)^2. If `normals` are given, the
    unit normals of the boundary at every place (k, sides, d), it is the volume times the sum over
    these normals of 1 - (depth / reach)^2 times a Gaussian of the sideways distance (`ALONG`),
    where depth is the distance along the normal. The weights are scaled to sum to 1 at each place.
    """

    def __init__(
        self,
        body: Body,
        images: _Images,
        places: np.ndarray,
        normals: np.ndarray | None = None,
    ) -> None:
        points = images.points
        self.source = images.source
        self.reach = images.reach
        self.shape = (len(places), len(points))
        self.cell = body.cell.max()
        # Points at exactly the reach count, as at 1.5 cells across an edge and 2 along it.
        near = scipy.spatial.cKDTree(places).sparse_distance_matrix(
            images.tree, self.reach * WITH_ROUNDING, output_type="ndarray"
        )
        near = near[np.lexsort((near["j"], near["i"]))]
        weights = np.maximum(0.0, 1 - (near["v"] / self.reach) ** 2)
        if normals is not None:
            offsets = points[near["j"]] - places[near["i"]]
            depths = np.einsum("pd,pnd->pn", offsets, normals[near["i"]])
            beside = near["v"][:, None] ** 2 - depths**2
            weights = np.nansum(
                (1 - (depths / self.reach) ** 2) * np.exp(-beside / (ALONG * self.cell) ** 2),
                axis=1,
            )
            near = near[weights > LEAST_WEIGHT]
            weights = weights[weights > LEAST_WEIGHT]
        if body.separates is not None and len(near):
            bound = ~body.separates(places[near["i"]], points[near["j"]])
            near = near[bound]
            weights = weights[bound]
        self.place = near["i"]
        self.point = near["j"]
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
            self.place = self.place[kept]
            self.point = self.point[kept]
            self.offsets = self.offsets[kept]
            weights = self.weights[kept]
            self.weights = weights / self._total(weights)[self.place]
        return self

    def _total(self, terms: np.ndarray) -> np.ndarray:
        return np.bincount(self.place, terms, self.shape[0])

    def fit(self, degree: int) -> scipy.sparse.csr_array:
        """Return the matrix from values at points and images to values at places, by a
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
        # The coefficients are M^-1 sum w p(x_j) y_j; the first is the value at the place.
        value = self.weights * (np.linalg.inv(normal)[self.place, 0] * terms).sum(axis=1)
        if degree > 1:
            told &= self._total(np.abs(value)) <= MOST_AMPLIFICATION
        kept = told[self.place]
        pointers = pointers_to(self.place[kept], self.shape[0]).astype(np.int64)
        return scipy.sparse.csr_array((value[kept], self.point[kept], pointers), shape=self.shape)


def text_of(place: np.ndarray) -> str:
    """Return the coordinates of a place as text for messages."""
    return f"({', '.join(f'{coordinate:.4g}' for coordinate in place)})"
