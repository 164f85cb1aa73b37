"""Bodies: points with volumes, their horizons, and the bonds between them, in the reference
state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, combinations

import numpy as np
import scipy

from ..kernels.weights import WEIGHT_FUNCTIONS
from ..ranks import Halo, Share
from .cell_mesh import CellMesh
from .cut_cells import cut_cells
from .ghosts import WITH_ROUNDING, Ghosts, HeldBoundary, Mirror, ReflectionPlane


@dataclass(frozen=True)
class Round:
    """Circle or sphere on which the material of a body changes.

    Attributes
    ----------
    center : tuple of float
    radius : float
    """

    center: tuple[float, ...]
    radius: float

    def distances(self, places: np.ndarray) -> np.ndarray:
        """Return the distances of places, shape (k, d), from the circle or sphere, negative
        within it.
        """
        return np.linalg.norm(places - np.array(self.center), axis=1) - self.radius

    def divides(self, horizon: float) -> bool:
        """Return whether the circle or sphere is large enough, a horizon in radius, to divide
        cells and to count with its curvature.
        """
        return self.radius > horizon


MOST_POINTS, MOST_BONDS = 20_000_000, 500_000_000
"""Greatest numbers of points and bonds: at some 2 kB a point and 80 bytes a bond, more would
exceed the memory of a workstation.
"""


PADDED = 1024
"""The ends of pairs are stored filled up with zeros to a multiple of this number, which is a
multiple of the blocks of all kernels.
"""

SLAB = 500_000
"""Number of pairs of which `Bonds.slabs` makes a part. Chosen: a temporary array of doubles then
takes 4 MB, and calls of NumPy cost nothing beside the work on so many numbers.
"""

MOST_COMPARED = 1000
"""Greatest number of points and images whose pairs are found by comparing each with each other.
Chosen: this takes some 20 ms and 20 MB; to load SciPy's search trees, which larger bodies need,
takes 200 ms and 30 MB.
"""

COINCIDING = 1e-9
"""Distance of two points, divided by the horizon, below which the points are refused as coinciding:
a bond between them has no direction. Chosen far above the rounding of positions and far below any
spacing.
"""


@dataclass(frozen=True)
class Body:
    """Body in the reference state: points with volumes, a horizon and bonds; a solid, or a sheet of
    unit thickness.

    Parameters
    ----------
    points : ndarray, shape (n, 2) or (n, 3)
        Reference positions.
    volumes : ndarray, shape (n,)
        Volume of each point; in the plane its area times unit thickness.
    horizon : float
        Radius within which points interact.
    spacing : float, optional
        Mean distance of neighboring points; by default the side of a square or cube of the mean
        volume.
    weight : str, optional
        Name of the weight function, one of `WEIGHT_FUNCTIONS`.
    planes : sequence of ReflectionPlane or HeldBoundary, optional
        Planes, and before them boundaries of other shapes, beyond which ghosts continue the body.
    separates : callable, optional
        ``separates(start, end)`` takes the undeformed ends of bonds, arrays of shape (k, d), and
        returns flags, shape (k,), of the bonds that a cut or hole of the undeformed body separates;
        these are left out.
    cell : array_like, shape (d,), optional
        Sides of the cells of a grid of points along the axes; by default all equal the spacing.
    groups : mapping of str to ndarray of int, optional
        Numbers of the points in each group named in a mesh file.
    mesh_cells : CellMesh, optional
        Cells of the mesh from which the points were made, used for pictures; None for points of a
        lattice.
    faces : mapping of str to str, optional
        For each group that covers a whole edge or face of the bounding box, the name of that edge
        or face.
    inside : callable, optional
        ``inside(places)`` flags the places, shape (k, d), that lie in the body; cells in pictures
        and files then end at its boundary.
    tessellate : callable, optional
        ``tessellate(points, volumes)`` returns the cells, a `CellMesh`, around points that lie on
        no lattice and come from no mesh.
    rounds : sequence of Round, optional
        Circles or spheres on which the material changes; elsewhere interfaces between materials
        follow from the points.
    boundary : callable, optional
        ``boundary(body)`` returns `outward` of the body, None if it is unknown; called where a
        force first needs it.
    loaded : bool, optional
        Whether tractions, pressures or obstacles act on the boundary: gradients beside interfaces
        between materials are then balanced, too.
    share : Share
        Share of a larger body to which these points belong, if several ranks (parallel processes)
        divide a run; by default the points are the whole body.

    Raises
    ------
    ValueError
        For shapes that do not fit, non-finite numbers, coinciding points, or a horizon that reaches
        no neighbor.

    See Also
    --------
    pdsurrogate.forces.ForceModel.bind : makes a force model compute the forces of a body.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> body = pds.Body.rectangle(3.0, 1.0, 0.25, 0.7875)
    >>> len(body), body.dimension, body.points[0].tolist()
    (48, 2, [0.125, 0.125])
    """

    points: np.ndarray
    volumes: np.ndarray
    horizon: float
    spacing: float = 0.0
    weight: str = "inverse"
    planes: tuple[Mirror, ...] = ()
    separates: Callable | None = None
    cell: Sequence[float] | np.ndarray | None = None
    groups: Mapping[str, np.ndarray] = field(default_factory=dict)
    mesh_cells: CellMesh | None = None
    faces: Mapping[str, str] = field(default_factory=dict)
    inside: Callable | None = None
    tessellate: Callable[[np.ndarray, np.ndarray], CellMesh] | None = None
    rounds: Sequence[Round] = ()
    boundary: Callable[[Body], np.ndarray | None] | None = None
    loaded: bool = False
    share: Share = None  # type: ignore[assignment]  # of all points, once there are points
    ghosts: Ghosts = field(init=False)

    def __post_init__(self) -> None:
        points = np.ascontiguousarray(self.points, dtype=float)
        volumes = np.ascontiguousarray(self.volumes, dtype=float)
        if points.ndim != 2 or points.shape[1] not in (2, 3) or len(points) == 0:
            raise ValueError(
                f"points must have shape (n, 2) or (n, 3) with n > 0, not {points.shape}"
            )
        if volumes.shape != (len(points),):
            raise ValueError(
                f"volumes must have shape ({len(points)},), one for each point, not {volumes.shape}"
            )
        if not np.isfinite(points).all():
            raise ValueError(
                f"point {np.flatnonzero(~np.isfinite(points).all(axis=1))[0]} has a position that"
                " is not finite"
            )
        if not (np.isfinite(volumes).all() and (volumes > 0).all()):
            raise ValueError("volumes must be positive and finite")
        if not (np.isfinite(self.horizon) and self.horizon > 0):
            raise ValueError(f"the horizon must be positive and finite, not {self.horizon}")
        if self.weight not in WEIGHT_FUNCTIONS:
            raise ValueError(
                f"unknown weight function {self.weight!r}; there are {', '.join(WEIGHT_FUNCTIONS)}"
            )
        if self.cell is None and self.mesh_cells is None:  # those of a grid or a mesh lie apart
            _pairs_within(points, 0.0, 0, COINCIDING * self.horizon)
        object.__setattr__(self, "points", points)
        if self.share is None:
            object.__setattr__(self, "share", Share.whole(len(points)))
        object.__setattr__(self, "volumes", volumes)
        if not self.spacing:
            object.__setattr__(self, "spacing", float(volumes.mean() ** (1 / points.shape[1])))
        _check_distance_of_planes(self)
        object.__setattr__(
            self,
            "cell",
            (
                np.full(points.shape[1], self.spacing)
                if self.cell is None
                else np.array(self.cell, dtype=float)
            ),
        )
        object.__setattr__(
            self, "ghosts", Ghosts.reflected(points, self.planes, self.horizon, self.share)
        )

    def __len__(self) -> int:
        return len(self.points)

    @property
    def kappa(self) -> float:
        """Scalar kappa in the shape tensor kappa I of a point with a full horizon (theory (9)).

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> round(pds.Body.rectangle(1.0, 1.0, 0.25, 0.75).kappa, 4)
        0.3313
        """
        return WEIGHT_FUNCTIONS[self.weight].moments[self.dimension - 2] * self.horizon ** (
            self.dimension + 2
        )

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point, 2 or 3.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.Body.rectangle(1.0, 1.0, 0.25, 0.75).dimension
        2
        """
        return self.points.shape[1]

    @property
    def finer(self) -> str:
        """Advice for error messages about a body with too few points: a smaller spacing, or a finer
        mesh.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.Body.rectangle(1.0, 1.0, 0.25, 0.75).finer
        'a smaller spacing'
        """
        return (
            "a smaller spacing"
            if self.mesh_cells is None
            else "a finer mesh, of cells of about one size"
        )

    @property
    def relaxed(self) -> bool:
        """Whether the points form a relaxed cloud: they lie on no lattice and come from no mesh.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.Body.rectangle(1.0, 1.0, 0.25, 0.75).relaxed
        False
        """
        return self.tessellate is not None

    def weigh(self, length: np.ndarray) -> np.ndarray:
        """Return the values of the body's weight function.

        Parameters
        ----------
        length : ndarray
            Undeformed lengths of bonds.

        Returns
        -------
        ndarray
            Values w, of the shape of `length`.

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> pds.Body.rectangle(1.0, 1.0, 0.25, 0.75).weigh(np.array([0.25, 0.75])).tolist()
        [3.0, 1.0]
        """
        return WEIGHT_FUNCTIONS[self.weight].function(length, self.horizon)

    @cached_property
    def all_points(self) -> np.ndarray:
        """Reference positions of the points, then of the ghosts, shape (n + m, d).

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.Body.rectangle(1.0, 1.0, 0.25, 0.75).all_points.shape
        (16, 2)
        """
        return np.ascontiguousarray(np.vstack([self.points, self.ghosts.points]))

    @cached_property
    def all_volumes(self) -> np.ndarray:
        """Volumes of the points, then of the ghosts, shape (n + m,).

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> float(pds.Body.rectangle(1.0, 1.0, 0.25, 0.75).all_volumes.sum())
        1.0
        """
        return np.concatenate(
            [self.volumes, self.volumes[self.ghosts.source] * self.ghosts.volume_ratio]
        )

    @cached_property
    def outward(self) -> np.ndarray | None:
        """Outward normals times areas of the free boundary, distributed to the points as loads on
        it are; None without `boundary`.

        Shape (n, d), see `Surface.on_points`. Times the stress, bond energies exert these loads in
        homogeneous states (theory (78)).

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.Body.rectangle(1.0, 1.0, 0.25, 0.75).outward is None
        True
        """
        found = self.boundary and self.boundary(self)
        if found is not None:
            self.share.fill(found)
        return found

    @cached_property
    def cells(self) -> CellMesh:
        """Cell around each point, for pictures and files: the cell of the mesh, or one of a lattice
        or cloud, cut at the boundary.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> len(pds.Body.rectangle(1.0, 1.0, 0.25, 0.75).cells)
        16
        """
        if self.mesh_cells is not None:
            return self.mesh_cells
        if self.tessellate is not None:
            return self.tessellate(self.points, self.volumes)
        cell = np.asarray(self.cell)
        lattice = CellMesh.of_lattice(self.points, self.volumes, cell)
        return (
            lattice if self.inside is None else cut_cells(lattice, self.volumes, cell, self.inside)
        )

    @cached_property
    def bonds(self) -> Bonds:
        """Bonds of the body, computed on first use.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.Body.rectangle(1.0, 1.0, 0.25, 0.26).bonds.n_directed
        48
        """
        return Bonds.of(self)

    @cached_property
    def extent(self) -> float:
        """Longest side of the box around the points of the whole body.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> float(pds.Body.rectangle(3.0, 1.0, 0.25, 0.75).extent)
        2.75
        """
        greatest = self.share.greatest
        return max(greatest(column) + greatest(-column) for column in self.points.T)

    @cached_property
    def names(self) -> np.ndarray:
        """Integers that identify points and images on all ranks, shape (n + m,).

        A point has its number in the whole body; an image (a ghost) has the number of its source
        plus its plane mask `Ghosts.image` times the number of points of the whole body.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.Body.rectangle(1.0, 1.0, 0.25, 0.75).names[:3].tolist()
        [0, 1, 2]
        """
        source, image = self.ghosts.source, self.ghosts.image
        return np.concatenate(
            [self.share.numbers, self.share.numbers[source] + image * self.share.size]
        )

    @property
    def bond_owners(self) -> np.ndarray:
        """Number of the point at which each directed bond begins, shape (n_bonds,).

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.Body.rectangle(1.0, 1.0, 0.25, 0.26).bond_owners[:4].tolist()
        [0, 0, 1, 1]
        """
        return np.repeat(np.arange(len(self)), np.diff(self.bonds.pointers).astype(np.int64))

    @cached_property
    def bond_halo(self) -> Halo:
        """Exchange between ranks of arrays with a value for each directed bond, shape (n_bonds,).

        It copies the values of bonds that begin at a halo point (a point of another rank) from the
        rank that owns this point.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> len(
        ...     pds.Body.rectangle(1.0, 1.0, 0.25, 0.26).bond_halo.rows
        ... )  # a run on one rank has no halo
        0
        """
        owners, share = self.bond_owners, self.share
        names = (
            share.numbers[owners] * (share.size * 2 ** len(self.planes))
            + self.names[self.bonds.neighbors]
        )
        return Halo(share.ranks, names, share.owners[owners])

    @classmethod
    def rectangle(
        cls, width: float, height: float, spacing: float, horizon: float, **options
    ) -> Body:
        """Return a rectangular body with its lower left corner at the origin and a point at the
        center of every cell.

        Parameters
        ----------
        width, height : float
            Sides along x1 and x2.
        spacing : float
            Side of the cells. If it does not divide the sides of the body, the sides of the cells
            are the nearest lengths that do.
        horizon : float
            Radius within which points interact.
        **options
            Further arguments of `Body`.

        Returns
        -------
        Body

        Raises
        ------
        ValueError
            If no cells with sides within 10 % of the spacing divide the body.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> body = pds.Body.rectangle(3.0, 1.0, 0.25, 0.7875, weight="constant")
        >>> len(body), body.weight
        (48, 'constant')
        """
        cells = Cells.filling((0.0, 0.0), (width, height), spacing)
        points = cells.centers()
        return cls(
            points,
            np.full(len(points), cells.volume),
            horizon,
            cells.spacing,
            cell=cells.sides,
            **options,
        )


MOST_MISFIT = 0.1
"""Greatest relative deviation of the side of a cell from the spacing.

Any side of a box that is five spacings or longer can be divided within it. In pure shear at 20
cells, cells whose sides differ by a fifth have the same errors as squares of the same area (-0.04
to -0.05 % in stress).
"""


@dataclass(frozen=True)
class Cells:
    """Equal cells that fill a box.

    Attributes
    ----------
    lower : tuple of float
        Corner of the box where all coordinates are least.
    counts : tuple of int
        Cells along each axis, two numbers in the plane and three in three dimensions.
    sides : tuple of float
        Sides of a cell along the axes.
    """

    lower: tuple[float, ...]
    counts: tuple[int, ...]
    sides: tuple[float, ...]

    @classmethod
    def filling(cls, lower: Sequence[float], upper: Sequence[float], spacing: float) -> Cells:
        """Return equal cells that fill a box; they are squares or cubes of the given spacing where
        it divides the box (to 1e-9).

        Otherwise their sides are as near to the spacing as possible. Raise ValueError if the box is
        smaller than a cell or holds too many cells, or if the sides deviate from the spacing by
        more than `MOST_MISFIT`.
        """
        if not (np.isfinite(spacing) and spacing > 0):
            raise ValueError(f"the spacing must be positive and finite, not {spacing}")
        number = math.prod(
            float(high - low) / spacing for low, high in zip(lower, upper, strict=True)
        )
        if not number <= MOST_POINTS:
            raise ValueError(
                f"spacing {spacing:g} makes {number:.3g} points, more than the limit"
                f" {MOST_POINTS:.3g}; use a larger spacing"
            )
        counts, sides = [], []
        for low, high, axis in zip(
            lower, upper, (f"x{number + 1}" for number in range(len(lower))), strict=True
        ):
            length = float(high - low)
            cells = length / spacing
            count = _count(length, spacing)
            if abs(cells / count - 1) > MOST_MISFIT:
                if cells < 1:
                    raise ValueError(
                        f"spacing {spacing:g} is larger than the body, {length:g} along {axis}"
                    )
                fewer, more = length / math.ceil(cells), length / math.floor(cells)
                raise ValueError(
                    f"spacing {spacing:g} does not divide the length {length:g} along {axis}; use"
                    f" {fewer:.6g} or {more:.6g}"
                )
            counts.append(count)
            sides.append(spacing if abs(cells - count) <= 1e-9 * count else length / count)
        return cls(tuple(lower), tuple(counts), tuple(sides))

    @classmethod
    def near(cls, lower: Sequence[float], upper: Sequence[float], spacing: float) -> Cells:
        """Return equal cells that fill a box, however much their sides deviate from the spacing;
        see `filling`.
        """
        lengths = [float(high - low) for low, high in zip(lower, upper, strict=True)]
        counts = [_count(length, spacing) for length in lengths]
        return cls(
            tuple(lower),
            tuple(counts),
            tuple(length / count for length, count in zip(lengths, counts, strict=True)),
        )

    @property
    def volume(self) -> float:
        """Volume of a cell; in the plane its area."""
        return math.prod(self.sides)

    @property
    def spacing(self) -> float:
        """Side of a square or cube with the cell's volume; exact to the last bit for squares and
        cubes.
        """
        if min(self.sides) == max(self.sides):
            return self.sides[0]
        return math.sqrt(self.volume) if len(self.sides) == 2 else math.cbrt(self.volume)

    def centers(self) -> np.ndarray:
        """Return the centers of the cells, shape (n, d); x1 varies fastest, the last coordinate
        slowest.
        """
        centers = np.empty((*self.counts[::-1], len(self.counts)))
        for axis, (low, count, side) in enumerate(
            zip(self.lower, self.counts, self.sides, strict=True)
        ):
            shape = np.ones(len(self.counts), dtype=int)
            shape[-1 - axis] = count
            centers[..., axis] = (low + (np.arange(count) + 0.5) * side).reshape(shape)
        return centers.reshape(-1, len(self.counts))


def _count(length: float, spacing: float) -> int:
    """Return the number of cells nearest to a spacing that fill a length; rounding does not
    decide between two that are equally near.
    """
    return max(1, round(round(length / spacing, 6)))


def grid(lower: Sequence[float], upper: Sequence[float], spacing: float) -> np.ndarray:
    """Return the centers of the cells that fill a box, shape (n, d), in the order of
    `Cells.centers`; see `Cells.filling`.
    """
    return Cells.filling(lower, upper, spacing).centers()


def lengths_of(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths (k,) of vectors (k, d): those of NumPy's ``norm``, bit for bit, in a
    sixth of its time or less.
    """
    squares = np.square(vectors[:, 0])
    for component in vectors.T[1:]:
        squares += component * component
    return np.sqrt(squares, out=squares)


def owners_and_items(lists: Sequence[Sequence[int]]) -> tuple[np.ndarray, np.ndarray]:
    """Return, for every number in several lists, the index of its list, and the number itself;
    list by list.
    """
    return np.repeat(np.arange(len(lists)), [len(each) for each in lists]), np.array(
        [*chain(*lists)], dtype=np.int64
    )


def sums_at_points(
    n: int, first: np.ndarray, second: np.ndarray, values: np.ndarray, sign: float
) -> np.ndarray:
    """Return, for each of n points, the sum of values of the bonds that begin there plus `sign`
    times the sum of those that end there.

    `values` (k,) or (k, c) belong to k bonds from the points `first` to the points `second`; ends
    from n on are ghosts, which have no sum.
    """
    if values.ndim == 2:
        return np.stack(
            [sums_at_points(n, first, second, column, sign) for column in values.T], axis=1
        )
    within = second < n
    return np.bincount(first, values, n) + sign * np.bincount(second[within], values[within], n)


@dataclass(frozen=True)
class Bonds:
    """Bonds of a body: neighbor lists of all points (directed bonds), and a list of pairs.

    A *pair* is an undirected bond. A pair of two points of the body appears in the neighbor lists
    of both; a pair of a point and an image appears in the list of the point only.

    Attributes
    ----------
    pointers : ndarray of uint64, shape (n + 1,)
        Index at which the neighbors of each point begin.
    neighbors : ndarray of uint32
        Neighbors of all points; numbers from n on are ghosts.
    ends : ndarray of uint32, shape (2, k)
        Ends of the pairs, filled up with zeros to a multiple k of `PADDED`.
    n_pairs : int
    pair_pointers : ndarray of uint64, shape (n + 1,)
        Index at which the pairs with each point as `first` begin.
    incidence_pointers : ndarray of uint64, shape (n + 1,)
        Index at which the entries of each point in `incidence` begin.
    incidence : ndarray of uint32
        Pairs in which each point is `second`.
    pair_of : ndarray of uint32
        Pair of each entry of `neighbors`.
    cut : ndarray, shape (k, 2)
        Ends of the pairs that cuts or holes of the undeformed body separate; these pairs are in
        none of the lists.
    n_directed : int
        Number of directed bonds within the body, without ghosts.
    first, second : ndarray of uint32, shape (n_pairs,)
        Ends of the pairs, ordered by `first`, which is a point of the body; `second` is a later
        point or an image.
    """

    pointers: np.ndarray
    neighbors: np.ndarray
    ends: np.ndarray
    n_pairs: int
    pair_pointers: np.ndarray
    incidence_pointers: np.ndarray
    incidence: np.ndarray
    pair_of: np.ndarray
    cut: np.ndarray
    n_directed: int

    @cached_property
    def first(self) -> np.ndarray:
        return self.ends[0, : self.n_pairs]

    @cached_property
    def second(self) -> np.ndarray:
        return self.ends[1, : self.n_pairs]

    def ends_in_blocks(self, block: int) -> tuple[np.ndarray, np.ndarray]:
        """Return `first` and `second` filled up with zeros to a multiple of `block`, which divides
        `PADDED`.

        Kernels ignore the results of the zeros.
        """
        first, second = self.ends[:, : -(-self.n_pairs // block) * block]
        return first, second

    def slabs(self) -> Iterator[slice]:
        """Yield the pairs in parts, whose temporary arrays are small beside those that the pairs
        of a large body hold.
        """
        for start in range(0, self.n_pairs, SLAB):
            yield slice(start, min(start + SLAB, self.n_pairs))

    @classmethod
    def of(cls, body: Body) -> Bonds:
        n = len(body)
        points = body.all_points
        reach = body.horizon / body.spacing
        estimate = (
            n
            / 2
            * min(
                len(points), np.pi * reach**2 if body.dimension == 2 else 4 / 3 * np.pi * reach**3
            )
        )
        if estimate > MOST_BONDS:
            raise ValueError(
                f"a horizon of {reach:.3g} spacings makes {estimate:.1g} bonds, more than"
                f" {MOST_BONDS:.1g}; reduce it"
            )
        # The tolerance includes points at exactly the horizon, whose computed distance may exceed
        # it by rounding.
        first, second = _pairs_within(
            points, body.horizon * WITH_ROUNDING, n, COINCIDING * body.horizon
        )
        first, second = _with_partners(body, first, second)
        cut = np.empty((0, 2), dtype=np.uint32)
        if body.separates is not None and len(first):
            # Empty space beyond a held boundary does not separate images there: the bond to the
            # source decides.
            separated = body.separates(
                points[first], np.concatenate([body.points, body.ghosts.unfolded])[second]
            )
            cut = np.stack([first[separated], second[separated]], axis=1)
            first, second = first[~separated], second[~separated]
        if len(first) == 0:
            raise ValueError(
                f"the horizon {body.horizon:g} is too small: it contains no neighbor at the spacing"
                f" {body.spacing:g}"
            )
        numbers = np.arange(len(first), dtype=np.uint32)
        ends = np.stack([np.pad(end, (0, -len(end) % PADDED)) for end in (first, second)])

        within = np.flatnonzero(second < n).astype(np.uint32)
        incidence = within[np.argsort(second[within], kind="stable")]
        # The neighbors of a point are in rising order: first those of pairs in which it is second,
        # then those in which it is first.
        owner = np.concatenate([second[incidence], first])
        order = np.argsort(owner, kind="stable")
        neighbors = np.concatenate([first[incidence], second])[order]
        pair_of = np.concatenate([incidence, numbers])[order]
        return cls(
            pointers_to(owner, n),
            np.ascontiguousarray(neighbors),
            ends,
            len(first),
            pointers_to(first, n),
            pointers_to(second[within], n),
            incidence,
            pair_of,
            cut,
            2 * len(within),
        )


def pointers_to(numbers: np.ndarray, count: int) -> np.ndarray:
    """Return row pointers, shape (count + 1,): where the entries of each number from 0 to count
    - 1 begin in the sorted `numbers`.
    """
    return np.concatenate([[0], np.cumsum(np.bincount(numbers, minlength=count))]).astype(np.uint64)


def _with_partners(
    body: Body, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs without those across a held boundary whose ends' sources, or whose mirrored
    pair, are farther apart than a horizon.

    For a pair of i and an image of k, the mirrored pair is that of k and the same boundary's image
    of i. Beyond planes it has the same length; beyond a round boundary it need not, and forces of
    ghosts on their sources are reported as forces of mirrored pairs.
    """
    n, ghosts = len(body), body.ghosts
    outer = np.flatnonzero(second >= n)
    outer = outer[(ghosts.points != ghosts.unfolded).any(axis=1)[second[outer] - n]]
    if not len(outer):
        return first, second
    one, ghost = first[outer].astype(np.int64), second[outer].astype(np.int64) - n
    mirrored, source, reach = (
        ghosts.mirrored(one, ghost),
        ghosts.source[ghost],
        body.horizon * WITH_ROUNDING,
    )
    apart = np.linalg.norm(body.points[one] - ghosts.unfolded[ghost], axis=1) > reach
    apart |= (mirrored < 0) | (
        np.linalg.norm(body.points[source] - ghosts.points[mirrored], axis=1) > reach
    )
    kept = np.delete(np.arange(len(first)), outer[apart])
    return first[kept], second[kept]


def _pairs_within(
    points: np.ndarray, reach: float, count: int, least: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs i < j of points (n, d) within `reach` of each other, with i < `count`, as
    sorted arrays of i and of j.

    Raise ValueError if two points are nearer to each other than `least`.
    """
    total = len(points)
    if total <= MOST_COMPARED:
        squared = sum((column[:, None] - column) ** 2 for column in points.T)
        near = np.argwhere(np.triu(squared < least**2, 1)).tolist()
        keys = np.flatnonzero(np.triu(squared <= reach**2, 1)[:count])
    else:
        tree = scipy.spatial.cKDTree(points)
        distances, numbers = tree.query(points, k=2, distance_upper_bound=least)
        near = [
            [one, *{*numbers[one].tolist()} - {one}]
            for one in np.flatnonzero(np.isfinite(distances[:, 1])).tolist()
        ]
        # Sorting one number per pair is five times as fast as sorting two.
        one, other = tree.query_pairs(reach, output_type="ndarray").T
        keys = np.minimum(one, other) * total + np.maximum(one, other)
        del one, other
        keys = keys[keys < count * total]
        keys.sort()
    if len(near):
        raise ValueError(f"points {near[0][0]} and {near[0][1]} coincide at {points[near[0][0]]}")
    first, second = np.divmod(keys, total)
    return first.astype(np.uint32), second.astype(np.uint32)


def _check_distance_of_planes(body: Body) -> None:
    """Raise ValueError if parallel planes or held boundaries are so near that a horizon reaches
    images of images, which are not created.
    """
    for one, two in combinations(
        [plane for plane in body.planes if isinstance(plane, HeldBoundary)], 2
    ):
        wall = float((one.mirrored(body.points)[1] + two.mirrored(body.points)[1]).min())
        if wall <= body.horizon:
            walls, size = (
                f"{one.name} and {two.name}",
                f"a spacing of {0.99 * wall * body.spacing / body.horizon:.3g} or less",
            )
            raise ValueError(
                f"the wall between {walls}, all held, is thinner than the horizon; use {size}, or"
                " support=points, which is less accurate"
            )
    planes = [plane for plane in body.planes if isinstance(plane, ReflectionPlane)]
    for number, plane in enumerate(planes):
        for other in planes[:number]:
            distance = abs(plane.position - other.position)
            # Reflected in one plane and then in the other, a point has moved by twice their
            # distance.
            nearest = 2 * distance - np.ptp(body.points[:, plane.axis])
            if plane.axis == other.axis and nearest <= body.horizon * WITH_ROUNDING:
                enough = (
                    f"a spacing of {distance * body.spacing / body.horizon:.3g} or less"
                    if body.mesh_cells is None
                    else body.finer
                )
                raise ValueError(
                    f"the body is too short for reflection: its horizon is {body.horizon:g}; use"
                    f" {enough}, or support=points"
                )
