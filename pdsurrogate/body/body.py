"""Bodies: points with volumes, their horizons, and the bonds between them, in the reference
state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, combinations

import numpy as np
import scipy

from ..kernels.lists import add_to_ends
from ..kernels.weights import WEIGHT_FUNCTIONS
from ..ranks import Halo, Share
from .bonds import COINCIDING, Bonds, check_apart
from .cell_mesh import CellMesh
from .cut_cells import cut_cells
from .ghosts import WITH_ROUNDING, Ghosts, HeldBoundary, Mirror, ReflectionPlane
from .grid import Cells


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
        between materials, and those of NOSB and BA-NOSB, are then balanced, too.
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
            check_apart(scipy.spatial.cKDTree(points), COINCIDING * self.horizon)
        spacing = self.spacing or float(volumes.mean() ** (1 / points.shape[1]))
        sides = (spacing,) * points.shape[1] if self.cell is None else self.cell
        share = Share.whole(len(points)) if self.share is None else self.share
        found = {"points": points, "volumes": volumes, "spacing": spacing, "share": share}
        vars(self).update(found, cell=np.array(sides, dtype=float))
        _check_distance_of_planes(self)
        vars(self)["ghosts"] = Ghosts.reflected(points, self.planes, self.horizon, share)

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
        cell = np.asarray(self.cell)
        return Bonds.of(self.points, self.ghosts, self.horizon, self.spacing, cell, self.separates)

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
        source = self.ghosts.source
        image = self.ghosts.image
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
        owners = self.bond_owners
        share = self.share
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
    found = np.zeros((n, values[:1].size))
    ends = (end.astype(np.uint32, copy=False) for end in (first, second))
    add_to_ends(*ends, values.reshape(len(first), -1).astype(float, copy=False), sign, found)
    return found.reshape(n, *values.shape[1:])


def _check_distance_of_planes(body: Body) -> None:
    """Raise ValueError if parallel planes or held boundaries are so near that a horizon reaches
    images of images, which are not created.
    """
    for one, two in combinations(
        [plane for plane in body.planes if isinstance(plane, HeldBoundary)], 2
    ):
        wall = float((one.mirrored(body.points)[1] + two.mirrored(body.points)[1]).min())
        if wall <= body.horizon:
            walls = f"{one.name} and {two.name}"
            size = f"a spacing of {0.99 * wall * body.spacing / body.horizon:.3g} or less"
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
