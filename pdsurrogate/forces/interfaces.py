"""Jumps of the deformation gradient at interfaces between materials, and the motion of each
material continued beyond them.
"""

from __future__ import annotations

import weakref
from functools import partial

import numpy as np
import scipy

from ..body.ghosts import symmetric
from ..kernels.ghosts import fill_matrices, fold_matrices, fold_vectors, place_points
from .changed_weights import ChangedWeights
from .interface_fits import fitted_jumps
from .interface_search import YIELDING
from .kinematics import Kinematics, find_shapes
from .steps import Step, sparse_product
from .tears import Tears


class Interfaces:
    """Interfaces between the materials of a body, straight within a horizon, circles or spheres,
    and the jumps of F across them.

    Across the interface of two bonded materials F jumps by c (x) N, with its normal N: the
    displacement is continuous, its slope along N is not. For every point near an interface, c
    follows from a least-squares fit of the positions by a continuous function that is linear or
    quadratic on either side, theory (54), and is linear in the positions. With c the motion of one
    material is continued beyond the interface: points of the other material are placed where they
    would be if they moved with this one.

    A point with more than two materials in its horizon, or without such an interface, has c = 0,
    and all materials use its actual position. Beside a crack or a cut along the interface, where
    the displacement is not continuous, c follows from linear functions that are fitted to the two
    sides separately, within `TORN_REACH`. If that fit contains a point that has lost a bond within
    one material, c = 0.

    Parameters
    ----------
    kinematics : Kinematics
    portion_of : ndarray of int, shape (n + m,)
        Number of the material of every point and ghost (mirror image).
    moduli : ndarray, shape (n + m,)
        Shear modulus of every point and ghost; infinite for rigid ones.
    quadratic : bool
        Whether the fit on either side is quadratic, and the energy of a much stiffer material
        depends on its own points only. Linear fits leave an error of first order in c, which plane
        strain multiplies by K; quadratic fits give single points more weight, so that bond forces,
        which are not the gradient of an energy, find no equilibrium next to a material a hundred
        times as stiff.
    volumes_held : bool
        Whether the deformed place on the interface about which a stiff point is mirrored follows
        from the gradient of this point, and not from the nearest points: the force is then
        distributed like the stiff material's own stress. Otherwise it alternates from point to
        point, which only the shear modulus resists where volumes are constrained: a confined layer
        4 cells thick was 57 % too soft next to one 10 times as stiff (K = 100 mu, plane strain),
        and is 14 % too soft with the gradient. In plane stress the nearest points are better, by 1
        % in shear.
    breakable : bool
        Whether bonds may break, see `break_bonds`.

    Attributes
    ----------
    depths : ndarray, shape (n + m,)
        Distance of every point and ghost from its interface; 0 where there is none.
    normals : ndarray, shape (n, d)
        Direction from every point to its interface.
    left_out : ndarray of int
        Directed bonds across an interface that the gradient and the energy of their first point
        omit.
    jumps, changes : ndarray, shapes (n + m, d) and (n + m, d d)
        Jumps of the slope along the normal of every point and ghost, and the changes of its
        gradient, by columns, to the other material.
    corrections, continuation : list of Step
        Steps that find the jumps and correct the gradients of the points for the other material's
        different motion; and steps that find `changes`, once the gradients of halo points are
        known.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        portion_of: np.ndarray,
        moduli: np.ndarray,
        quadratic: bool,
        volumes_held: bool,
        breakable: bool,
    ) -> None:
        # With a circle of references the body would stay in memory until a collection of garbage.
        self._body = kinematics.body
        self._portion_of = portion_of
        self._kinematics = weakref.proxy(kinematics)
        body = self._body
        share = self._body.share
        n = len(body)
        total = len(body.all_points)
        bonds = body.bonds
        owners = body.bond_owners
        across = np.flatnonzero(portion_of[owners] != portion_of[bonds.neighbors])
        self.depths = np.zeros(total)
        self.normals = np.zeros((n, body.dimension))
        near = np.unique(
            kinematics.sources[np.concatenate([owners[across], bonds.neighbors[across]])]
        )
        watched = breakable or share.any(len(bonds.cut) > 0)
        fits = fitted_jumps(
            body, portion_of, moduli, near[share.own[near]], quadratic, volumes_held, watched
        )
        self.depths[:n] = fits.depths
        self.normals[:] = fits.normals
        of_all = share.with_rows_of_others(fits.jumps)
        self._jump = _by_different_rows(fits.jumps)
        self._jump_of_all = _by_different_rows(of_all) if share.divided else self._jump
        share.fill(self.normals)
        body.ghosts.fill(self.depths)
        d = body.dimension
        self._product = partial(sparse_product, kinematics.chunks)
        self._kept: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self._one_sided: ChangedWeights | None = None
        self.left_out = self._unseen(owners, across, moduli) if quadratic else across[:0]
        if share.any(len(self.left_out) > 0):
            self._leave_out(kinematics, owners)
        self._across = (across, owners[across], bonds.neighbors[across])
        self._breakable = breakable
        self._correct, self._correct_back = self._of_corrections()
        self._kept = self._kept if breakable else None
        self.jumps = np.zeros((total, d))
        self.changes = np.zeros((total, d * d))
        # The matrix that spreads slopes along the normals to columns of gradients; the products
        # with columns are its transpose.
        dyads = self._by_normals(scipy.sparse.diags_array((self.depths[:n] > 0).astype(float)))
        images = fits.images
        is_image = (fits.images.diagonal() != 0).astype(float)
        back = share.with_rows_of_others(images).T.tocsr()
        # Along the normal an image has the gradient of the softer material at the mirrored place,
        # as a clamp's has.
        self._changes_by_jumps, by_columns = (
            dyads @ scipy.sparse.diags_array(1 - is_image),
            dyads @ self._by_normals(images.T).T,
        )
        self._changes_back = self._by_normals(back) @ dyads.T
        self._jumps_by_columns = (
            scipy.sparse.diags_array(-2.0 * volumes_held * is_image * fits.growth) @ dyads.T
        )
        self._changes_by_columns = by_columns
        self._tears = None
        if watched:
            self._tears = Tears(
                kinematics, portion_of, fits, share.with_rows_of_others(fits.apart).T.tocsr()
            )
            self._tears.lose(*bonds.cut.T)
        self.corrections, self.continuation = self.steps(
            kinematics.positions, kinematics.gradients, self.jumps, self.changes
        )

    def steps(
        self, positions: np.ndarray, gradients: np.ndarray, jumps: np.ndarray, changes: np.ndarray
    ) -> tuple[list[Step], list[Step]]:
        """Return the steps `corrections` and `continuation` for given positions, or displacements;
        they write `jumps` and `changes`.

        `gradients` (n + m, d d) are those of these positions, without and then with the
        corrections.
        """
        n = len(self._body)
        d = self._body.dimension
        images = self._body.ghosts
        columns = gradients[:n].reshape(-1, d)
        of_changes = changes[:n].reshape(-1, d)
        on_ghosts = self._kinematics.gradient_ghosts.of_gradients
        at_rest = (
            np.zeros((len(images), d)),
            np.zeros((len(images), d * d)),
        )
        return [
            *self._products(self._jump, positions, jumps),
            *self._product(self._jumps_by_columns, columns, jumps, add=True),
            *(self._tears.steps(positions, jumps) if self._tears else []),
            jumps,
            self._kinematics.bind(
                place_points, jumps[:n], images.source, images.parity, at_rest[0], jumps
            ),
            *self._product(self._correct, jumps, columns, add=True, variable=self._breakable),
        ], [
            *self._product(self._changes_by_jumps, jumps, of_changes),
            *self._product(self._changes_by_columns, columns, of_changes),
            *(self._tears.kept_rows(changes) if self._tears else []),
            changes,
            self._kinematics.bind(fill_matrices, changes, *on_ghosts, 0.0, at_rest[1]),
        ]

    def break_bonds(self, pairs: np.ndarray) -> None:
        """Take account of broken pairs, after `Kinematics.weighted_bonds` and
        `Kinematics.inverse_shape` were updated.
        """
        bonds = self._body.bonds
        kinematics = self._kinematics
        self._tears.lose(bonds.first[pairs], bonds.second[pairs])
        if self._one_sided is not None:
            kept, *shapes = self._kept
            numbers = self._one_sided.numbers
            owners = self._one_sided.owners
            kept[numbers] = kinematics.weighted_bonds[numbers]
            kept[self.left_out] = 0.0
            rows = np.unique(owners).astype(np.uint32)
            find_shapes(self._body, rows, kinematics.starts, kept, *shapes)
            self._one_sided.put(self._changes_of(numbers, owners))
        refilled = zip((self._correct, self._correct_back), self._of_corrections(), strict=True)
        for matrix, other in refilled:
            matrix.data[:] = other.data

    def _of_corrections(self) -> tuple[scipy.sparse.csr_array, scipy.sparse.csr_array]:
        """Return the matrix that maps jumps to corrections of gradients, by the weights of the
        bonds across, and minus its transpose.
        """
        numbers, owners, neighbors = self._across
        kinematics = self._kinematics
        weights = _weights(kinematics.weighted_bonds, kinematics.inverse_shape, numbers, owners)
        if self._kept is not None:
            weights = weights + self._changes_of(numbers, owners)
        found = self._on_columns(-weights * self.depths[neighbors, None], owners, neighbors)
        found.sort_indices()
        return found, (-found).T.tocsr()

    def _changes_of(self, numbers: np.ndarray, owners: np.ndarray) -> np.ndarray:
        """Return the changes (k, d) of the weights of directed bonds, with these first points, in
        gradients that omit the bonds `left_out`.

        A point whose other bonds do not determine a gradient has that of all its bonds.
        """
        kept, inverse, supported = self._kept
        kinematics = self._kinematics
        changes = _weights(kept, inverse, numbers, owners) - _weights(
            kinematics.weighted_bonds, kinematics.inverse_shape, numbers, owners
        )
        return np.where(supported[owners, None] > 0, changes, 0.0)

    def _by_normals(self, matrix) -> scipy.sparse.csr_array:
        """Return the matrix (n d, n) that maps vectors at points to columns of gradients: v (x)
        normal, spread by a matrix (n, n).
        """
        entries = scipy.sparse.coo_array(matrix)
        return self._on_columns(
            entries.data[:, None] * self.normals[entries.col], entries.row, entries.col
        )[:, : len(self._body)]

    def _products(
        self, matrices: list, values: np.ndarray, out: np.ndarray, every: bool = False
    ) -> list[Step]:
        """Return the passes that write the product of matrices, the last one first, and `values`
        to rows of `out`, see `sparse_product`.
        """
        *further, first = matrices
        if not further:
            return self._product(first, values, out, every=every)
        between = np.zeros((first.shape[0], values.shape[1]))
        return [
            *self._product(first, values, between),
            *self._products(further, between, out, every),
        ]

    def _on_columns(
        self, weights: np.ndarray, owners: np.ndarray, others: np.ndarray
    ) -> scipy.sparse.csr_array:
        """Return the matrix (n d, n + m) that maps values at points and ghosts to columns of
        gradients at points.

        The k bonds from `owners` to `others` have the weights (k, d) in the gradients of `owners`.
        """
        d = self._body.dimension
        n = len(self._body)
        total = len(self._body.all_points)
        rows = (d * owners.astype(np.int64)[:, None] + np.arange(d)).ravel()
        return scipy.sparse.csr_array(
            (weights.ravel(), (rows, np.repeat(others, d))), shape=(n * d, total)
        )

    def _unseen(self, owners: np.ndarray, across: np.ndarray, moduli: np.ndarray) -> np.ndarray:
        """Return those directed bonds `across` interfaces that the gradient and energy of their
        first point omit (`left_out`).

        `owners` are the first points of all directed bonds, and `moduli` the shear moduli of all
        points and ghosts.
        """
        body = self._body
        neighbors = self._body.bonds.neighbors[across]
        normals = np.vstack([self.normals, body.ghosts.reflected_vectors(self.normals)])[neighbors]
        arms = body.all_points[owners[across]] - body.all_points[neighbors]
        # A bond along the interface counts as one behind it, whatever rounding says.
        behind = (self.depths[neighbors] > 0) & (
            np.einsum("bi,bi->b", arms, normals) <= 1e-9 * body.spacing
        )
        return across[(moduli[owners[across]] > YIELDING * moduli[neighbors]) | behind]

    def _leave_out(self, kinematics: Kinematics, owners: np.ndarray) -> None:
        """Remove the bonds `left_out` from the gradients of their first points.

        `owners` are the first points of all directed bonds. Bonds of points whose other bonds do
        not determine a gradient are removed from `left_out` instead.
        """
        for _ in range(2):
            kept = kinematics.weighted_bonds.copy()
            kept[self.left_out] = 0.0
            inverse = np.zeros_like(kinematics.inverse_shape)
            supported = np.zeros_like(kinematics.supported)
            rows = np.unique(owners[self.left_out]).astype(np.uint32)
            find_shapes(self._body, rows, kinematics.starts, kept, inverse, supported)
            self.left_out = self.left_out[supported[owners[self.left_out]] > 0]
        self._kept = kept, inverse, supported
        # A rank may have none of these bonds.
        touched = np.flatnonzero(supported[owners])
        self._one_sided = ChangedWeights(
            self._body, kinematics.chunks, touched, self._changes_of(touched, owners[touched])
        )
        kinematics.changed.append(self._one_sided)

    def cells_across(self, number: int, most: int) -> float:
        """Return the median thickness, in spacings and at most `most`, of the layer of a material
        next to its interfaces; 0 if it has none.

        `number` is the number of the material in `portion_of`, or the number that stands for rigid
        parts there.
        """
        body = self._body
        portion_of = self._portion_of
        beside = np.flatnonzero(
            (portion_of[: len(body)] == number) & (self.depths[: len(body)] > 0)
        )
        beside = beside[self.depths[beside] < body.spacing]
        if not len(beside):
            return 0.0
        inwards = (np.arange(most) + 0.5) * body.spacing
        faces = body.points[beside] + self.depths[beside, None] * self.normals[beside]
        places = faces[:, None] - inwards[:, None] * self.normals[beside, None]
        distance, nearest = scipy.spatial.cKDTree(body.all_points).query(places)
        within = (distance < body.spacing) & (portion_of[nearest] == number)
        return float(np.median(np.where(within.all(axis=1), most, within.argmin(axis=1))))

    def steps_back(
        self,
        forces: np.ndarray,
        moments: np.ndarray,
        own_moments: np.ndarray,
        on_points: np.ndarray,
    ) -> list[Step]:
        """Return the steps that find the forces of an energy that depends on the jumps: the
        transpose of `corrections` and `continuation`.

        Parameters
        ----------
        forces, moments : ndarray, shapes (n + m, d) and (n + m, d d)
            Minus the derivative of the energy by positions in the continued motion of the other
            material, and its derivative by gradients in that motion; `moments` is overwritten.
        own_moments : ndarray, shape (n, d d)
            Derivative of the energy by the points' own gradients; terms of mirror images are added
            in place.
        on_points : ndarray, shape (n, d)
            Receives the forces on the points that determine the jumps.
        """
        n = len(self._body)
        d = self._body.dimension
        ghosts = self._body.ghosts
        product = self._product
        on_jumps = np.zeros_like(self.jumps)
        theirs = moments[:n].reshape(-1, d)
        columns = own_moments.reshape(-1, d)
        apart, on_apart = self._tears.steps_back(on_jumps, on_points) if self._tears else ([], [])
        return [
            self._kinematics.bind(
                fold_matrices,
                moments,
                *self._kinematics.gradient_ghosts.of_gradients,
                np.zeros((len(ghosts), d * d)),
            ),
            moments,
            *(self._tears.kept_rows(moments) if self._tears else []),
            *product(scipy.sparse.diags_array(-self.depths), forces, on_jumps, every=True),
            *product(-self._changes_by_jumps.T, theirs, on_jumps, add=True),
            *product(self._changes_back, theirs, columns, add=True),
            own_moments,
            *product(self._correct_back, columns, on_jumps, add=True, variable=self._breakable),
            self._kinematics.bind(fold_vectors, on_jumps, ghosts.source, ghosts.parity),
            *apart,
            *product(-self._jumps_by_columns.T, on_jumps, columns, add=True),
            on_jumps[:n],
            *self._products(
                [each.T for each in reversed(self._jump_of_all)],
                on_jumps,
                on_points,
                every=self._tears is not None,
            ),
            *on_apart,
            own_moments,
        ]


def _by_different_rows(matrix: scipy.sparse.csr_array) -> list[scipy.sparse.csr_array]:
    """Return matrices whose product is `matrix`: a selection of rows, and these rows; only
    `matrix` itself if all its rows differ.
    """
    filled = np.flatnonzero(np.diff(matrix.indptr))
    different = {}
    ends = zip(matrix.indptr[filled], matrix.indptr[filled + 1], strict=True)
    keys = [
        matrix.indices[begin:end].tobytes() + matrix.data[begin:end].tobytes()
        for begin, end in ends
    ]
    which = [different.setdefault(key, len(different)) for key in keys]
    if len(different) == len(filled):
        return [matrix]
    first = filled[np.unique(which, return_index=True)[1]]
    return [
        scipy.sparse.csr_array(
            (np.ones(len(filled)), (filled, which)), shape=(matrix.shape[0], len(first))
        ),
        matrix[first],
    ]


def _weights(
    weighted_bonds: np.ndarray, inverse_shape: np.ndarray, numbers: np.ndarray, owners: np.ndarray
) -> np.ndarray:
    """Return the weights K^-1 w x V_j (k, d) of directed bonds in the gradients of their first
    points, given by both numbers.
    """
    return np.einsum("bij,bj->bi", symmetric(inverse_shape[owners]), weighted_bonds[numbers])
