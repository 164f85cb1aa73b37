"""Jumps of the deformation gradient at interfaces between materials, and the motion of each material continued beyond them."""

from __future__ import annotations

import weakref
from functools import partial
from typing import TypeAlias

import numpy as np
import scipy

from ..body import Body, Round
from ..body.ghosts import WITH_ROUNDING, symmetric
from ..kernels.ghosts import fill_matrices, fold_matrices, fold_vectors, place_points
from .kinematics import Kinematics, find_shapes
from .steps import Step, sparse_product

NEAREST = (1.6, 2.2, 3.0, 4.0, 6.0)
"""Trial radii, in point spacings, of the neighborhood from which the value at a place is interpolated: the first that contains enough
points is used. Chosen: a circle of radius 1.6 holds some eight points of a grid, each further radius about twice as many, and points beyond
6 spacings say little."""

WORST_SPREAD = 1e4
"""Greatest accepted condition number of the scaled normal equations of an interpolation; beyond it the points are not spread enough to
determine a linear function. Chosen: it costs four of sixteen digits; points on one line have an infinite condition number."""

CENTERINGS = 3
"""Number of fits of the straight interface next to a point, each centered on the place that the previous fit found. Chosen: the first fit
is one-sided, the second is centered, and the third corrects the place."""

REACH = 2
"""Radius, in horizons, about a place on an interface within which the motion of either side is fitted; nearer points have greater weights.

With one horizon the fit depends on the three nearest rows, and a point's continued place does not follow its own displacement: next to a
material thirty times as stiff, bond forces then have no equilibrium. With two, `bimaterial` is as accurate, and the solution
converges for a material a hundred times as stiff.
"""

TORN_REACH = 1.5
"""Radius in horizons, as `REACH`, of the fits on the two sides of an interface that is cut or torn nearby."""

ROUND_REACH = 1.5
"""Radius in horizons, as `REACH`, for interfaces that are circles or spheres. Chosen: the force on a strip around a disc of 5 cells'
radius, three times as stiff as the strip, has an error of 0.2 %; it was 0.5 % with `REACH`, since the function fitted is less accurate far
from the place."""

FARTHEST = 1.5
"""Greatest distance, in horizons, at which an interface is assigned to a point. The point is bonded to points beyond the interface, the
nearest within one horizon; half a horizon more is room for planes that are fitted obliquely."""

SIGHT = FARTHEST + REACH
"""Radius, in horizons, around a point of a body divided among ranks within which the rank must have all points to compute the jump of the
deformation gradient that belongs to the point."""

ASTRAY = 0.06
"""Greatest share of a horizon's volume on the wrong side of the plane fitted to an interface, for the interface to count as straight; at a
corner it is greater. Chosen: of some 30 points in a horizon (3.15 spacings in the plane, 1.75 in three dimensions) one may lie on the wrong
side and two may not."""

SECTOR = 0.5
"""Sine of the greatest angle by which a point, seen from the place on an interface, may lie on the other material's side of the fitted
plane and still be used in the fit of the motion. Chosen: 30 degrees admit interfaces that curve or turn a little, and exclude material
behind a thin layer."""

YIELDING = 4.001
"""Ratio of the shear moduli of two materials beyond which the energy of the stiffer one depends on its own points only.

Otherwise the error of the fitted motion of the softer material, times the stiffer modulus, acts as a force on the softer one: a layer of 4
cells moves 33 % too little between halves ten times as stiff, and 83 % between halves a hundred times as stiff. Below this ratio the
energies of both sides depend on each other's points. That is more accurate: homogeneous states are in equilibrium. Chosen below ten, where
the error is a third, and not round: a derivative by the modulus of one of two materials with a ratio of exactly four must not cross it.
"""

WORST_CONDITION = 1e6
"""Greatest accepted condition number of a fit of the motion at an interface, with lengths in units of the fit's radius. A layer of two rows
of points leads to 1e3."""

LEAST_RADIUS = 1.5
"""Least radius, in spacings, of a circle or sphere on which depths and normals follow from its center and not from the points."""

MOST_CURVED = 0.5
"""Greatest product of depth and curvature with which an image takes account of a curved interface. Chosen: theory (62a) holds for small
products; a disc of 5 cells' radius, whose products are up to 0.6, has the same error with all limits from 0.5 on."""

ROUNDED = 1e-11
"""Unit, in spacings, to whose multiples places on interfaces are rounded, as components of normals are to multiples of the number itself.
Points on one line across an interface then have exactly the same place and share one fit. Chosen: far above the rounding of coordinates,
and without effect on results."""

Near: TypeAlias = tuple[float, np.ndarray, int, float, Round | None]
"""Interface near a point: distance and unit normal from the point to it, number of the material beyond, share of the horizon's volume whose
points lie on the other material's side of it, and the circle or sphere that it is, None for a plane fitted between the points."""


class Interfaces:
    """Interfaces between the materials of a body, straight within a horizon, circles or spheres, and the jumps of F across them.

    Across the interface of two bonded materials F jumps by c (x) N, with its normal N: the displacement is continuous, its slope along N
    is not. For every point near an interface, c follows from a least-squares fit of the positions by a continuous function that is linear
    or quadratic on either side, theory (54), and is linear in the positions. With c the motion of one material is continued beyond the
    interface: points of the other material are placed where they would be if they moved with this one.

    A point with more than two materials in its horizon, or without such an interface, has c = 0, and all materials use its actual
    position. Beside a crack or a cut along the interface, where the displacement is not continuous, c follows from linear functions
    that are fitted to the two sides separately, within `TORN_REACH`. If that fit contains a point that has lost a bond within one
    material, c = 0.

    Parameters
    ----------
    kinematics : Kinematics
    portion_of : ndarray of int, shape (n + m,)
        Number of the material of every point and ghost (mirror image).
    moduli : ndarray, shape (n + m,)
        Shear modulus of every point and ghost; infinite for rigid ones.
    quadratic : bool
        Whether the fit on either side is quadratic, and the energy of a much stiffer material depends on its own points only. Linear fits
        leave an error of first order in c, which plane strain multiplies by K; quadratic fits give single points more weight, so that bond
        forces, which are not the gradient of an energy, find no equilibrium next to a material a hundred times as stiff.
    volumes_held : bool
        Whether the deformed place on the interface about which a stiff point is mirrored follows from the gradient of this point, and not
        from the nearest points: the force is then distributed like the stiff material's own stress. Otherwise it alternates from point to
        point, which only the shear modulus resists where volumes are constrained: a confined layer 4 cells thick was 57 % too soft next to
        one 10 times as stiff (K = 100 mu, plane strain), and is 14 % too soft with the gradient. In plane stress the nearest points are
        better, by 1 % in shear.
    breakable : bool
        Whether bonds may break, see `break_bonds`.

    Attributes
    ----------
    depths : ndarray, shape (n + m,)
        Distance of every point and ghost from its interface; 0 where there is none.
    normals : ndarray, shape (n, d)
        Direction from every point to its interface.
    left_out : ndarray of int
        Directed bonds across an interface that the gradient and the energy of their first point omit.
    one_sided_bonds : tuple or None
        For points that omit bonds: the directed bonds of these points, the point of each bond, and the changes of the bonds' weights in the
        deformation gradients; None if no point omits bonds.
    jumps, changes : ndarray, shapes (n + m, d) and (n + m, d d)
        Jumps of the slope along the normal of every point and ghost, and the changes of its gradient, by columns, to the other material.
    corrections, continuation : list of Step
        Steps that find the jumps and correct the gradients of the points for the other material's different motion; and steps that find
        `changes`, once the gradients of halo points are known.
    on_jumps : ndarray, shape (n, d)
        Forces on the points due to the dependence of the energy on the jumps, as last found by the steps of `steps_back`.
    pulls : ndarray, shape (n + m, d)
        Changes of the forces on the points where gradients omit bonds, as last found by these steps.
    """

    def __init__(
        self, kinematics: Kinematics, portion_of: np.ndarray, moduli: np.ndarray, quadratic: bool, volumes_held: bool, breakable: bool
    ) -> None:
        # With a circle of references the body would stay in memory until a collection of garbage.
        self._body, self._portion_of, self._kinematics = kinematics.body, portion_of, weakref.proxy(kinematics)
        body, share = self._body, self._body.share
        n, total, bonds, owners = len(body), len(body.all_points), body.bonds, body.bond_owners
        across = np.flatnonzero(portion_of[owners] != portion_of[bonds.neighbors])
        self.depths, self.normals = np.zeros(total), np.zeros((n, body.dimension))
        near = np.unique(kinematics.sources[np.concatenate([owners[across], bonds.neighbors[across]])])
        jumps, mirrored, torn = ({} for _ in range(3))  # rows of matrices, by point: columns and entries
        growth, self._watched = np.ones(n), breakable or share.any(len(bonds.cut) > 0)
        tree, everywhere = scipy.spatial.cKDTree(body.points), scipy.spatial.cKDTree(body.all_points)
        modulus_of, fits = np.zeros(portion_of.max() + 1), {}
        modulus_of[portion_of] = moduli
        for i in near[share.own[near]]:
            found = (quadratic and _round_beside(body, everywhere, portion_of, i)) or _interface_beside(body, everywhere, portion_of, i)
            if quadratic and (found is None or found[3] > ASTRAY):
                found = _nearest_softer(body, everywhere, portion_of, moduli, i) or found
            if found is None:
                continue
            depth, normal, other, _, shape = found
            normal, own = _rounded(normal, 1.0), int(portion_of[i])
            place = _rounded(body.points[i] + depth * normal, body.spacing)
            if quadratic and moduli[i] > YIELDING * modulus_of[other]:
                around, x, beyond, _, reach = _two_sides(body, tree, portion_of, place, normal, (own, other), shape)
                sizes = depth / reach, body.spacing / reach
                jump, at_image = _mirrored((x, body.volumes[around], beyond), normal, sizes, around == i, volumes_held)
                if jump is None:
                    continue
                # Toward the center of a circle or sphere of stiff material the jump of the slope grows, theory (62a).
                convex = shape is not None and (place - shape.center) @ normal > 0 and shape.divides(body.horizon)
                bent = min((body.dimension - 1) * depth / shape.radius, MOST_CURVED) if convex else 0.0
                growth[i] = 1 + bent
                mirrored[i] = np.append(around[beyond], i), np.append((1 + 2 * bent) * at_image, -1 - 2 * bent)
                jumps[i] = around, (1 + bent) * jump / reach
            else:
                # The jump of the slope is the same from either side: all fits at a place start from the material of the lower number.
                both, normal_up = (own, other) if own < other else (other, own), normal if own < other else -normal
                key = *place, *normal_up, *both, *(() if shape is None else shape.center)
                if key not in fits:
                    fits[key] = _fits_at((body, tree, portion_of, place, normal_up, both, shape), quadratic, self._watched)
                jump, apart = fits[key]
                if jump is None:
                    continue
                jumps[i] = jump
                if apart is not None:
                    torn[i] = apart
            self.depths[i], self.normals[i] = depth, normal
        jumps, mirrored, torn = (_matrix_of(rows, n) for rows in (jumps, mirrored, torn))
        of_all = share.with_rows_of_others(jumps)
        self._jump = _by_different_rows(jumps)
        self._jump_of_all = _by_different_rows(of_all) if share.divided else self._jump
        share.fill(self.normals)
        body.ghosts.fill(self.depths)
        d = body.dimension
        self.on_jumps, self.pulls = np.zeros((n, d)), np.zeros((total, d))
        self.one_sided_bonds: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self._one_sided, self._product = scipy.sparse.csr_array((n * d, total)), partial(sparse_product, kinematics.chunks)
        self._one_sided_back = self._one_sided.T.tocsr()
        self._kept = None
        weights = kinematics.gradient_weights(kinematics.weighted_bonds, kinematics.inverse_shape)
        self.left_out = self._unseen(owners, across, moduli) if quadratic else across[:0]
        if share.any(len(self.left_out) > 0):
            weights = self._leave_out(kinematics, owners, weights, breakable)
        self._across, self._breakable = (across, owners[across], bonds.neighbors[across]), breakable
        self._correct, self._correct_back = self._of_corrections(weights[across])
        self.jumps, self.changes = np.zeros((total, d)), np.zeros((total, d * d))
        # The matrix that spreads slopes along the normals to columns of gradients; the products with columns are its transpose.
        dyads = self._by_normals(scipy.sparse.diags_array((self.depths[:n] > 0).astype(float)))
        images, back = self._with_transpose(mirrored)
        is_image = (images.diagonal() != 0).astype(float)
        # Along the normal an image has the gradient of the softer material at the mirrored place, as a clamp's has.
        self._changes_by_jumps, by_columns = dyads @ scipy.sparse.diags_array(1 - is_image), dyads @ self._by_normals(images.T).T
        self._changes_back = self._by_normals(back) @ dyads.T
        self._jumps_by_columns = scipy.sparse.diags_array(-2.0 * volumes_held * is_image * growth) @ dyads.T
        self._changes_by_columns = by_columns
        self._intact, self._parted, self._is_image = np.ones((n, 1)), np.zeros((n, 1)), is_image > 0
        self._lost_across, self._lost_within = np.zeros((2, n), dtype=bool)
        if self._watched:
            self._torn, self._torn_back = self._with_transpose(torn)
            self._fitted, self._fitted_apart = abs(jumps) + abs(images), abs(self._torn)
            self._lose(*bonds.cut.T)
        self.corrections, self.continuation = self.steps(kinematics.positions, kinematics.gradients, self.jumps, self.changes)

    def steps(self, positions: np.ndarray, gradients: np.ndarray, jumps: np.ndarray, changes: np.ndarray) -> tuple[list[Step], list[Step]]:
        """Return the steps `corrections` and `continuation` for given positions, or displacements; they write `jumps` and `changes`.

        `gradients` (n + m, d d) are those of these positions, without and then with the corrections.
        """
        n, d, images, chunks = len(self._body), self._body.dimension, self._body.ghosts, self._kinematics.chunks
        columns, of_changes = gradients[:n].reshape(-1, d), changes[:n].reshape(-1, d)
        on_ghosts, at_rest = self._kinematics.gradient_ghosts.of_gradients, (np.zeros((len(images), d)), np.zeros((len(images), d * d)))
        return [
            *self._product(self._one_sided, positions, columns, add=True, variable=True),
            *self._products(self._jump, positions, jumps),
            *self._product(self._jumps_by_columns, columns, jumps, add=True),
            *self._chosen(positions, jumps),
            jumps,
            place_points.bind(jumps[:n], images.source, images.parity, at_rest[0], jumps, chunks=chunks),
            *self._product(self._correct, jumps, columns, add=True, variable=self._breakable),
        ], [
            *self._product(self._changes_by_jumps, jumps, of_changes),
            *self._product(self._changes_by_columns, columns, of_changes),
            *self._kept_rows(changes),
            changes,
            fill_matrices.bind(changes, *on_ghosts, 0.0, at_rest[1], chunks=chunks),
        ]

    def _chosen(self, positions: np.ndarray, jumps: np.ndarray) -> list[Step]:
        """Return the steps that replace jumps, where the sides are parted, by those of separate fits, and by zero where neither holds."""
        if not self._watched:
            return []
        rows, apart = jumps[: len(self._body)], np.zeros_like(self._body.points)
        scale, add = partial(_scale, rows, self._intact), partial(np.add, rows, apart, out=rows)
        return [*self._product(self._torn, positions, apart), partial(_scale, apart, self._parted), scale, add]

    def _kept_rows(self, values: np.ndarray) -> list[Step]:
        """Return the step that sets the first n rows of an array to zero where points have no jump because of a cut or a crack."""
        rows = values[: len(self._body)]
        return [lambda: _scale(rows, self._intact + self._parted)] if self._watched else []

    def _lose(self, first: np.ndarray, second: np.ndarray) -> None:
        """Choose the fits of the jumps after bonds between these points, or ghosts, were lost."""
        share, sources = self._body.share, self._kinematics.sources
        across = self._portion_of[first] != self._portion_of[second]
        for lost, chosen in ((self._lost_across, across), (self._lost_within, ~across)):
            lost[sources[np.concatenate([first[chosen], second[chosen]])]] = True
            share.fill(lost)
        within, any_lost = self._fitted @ self._lost_within > 0, self._fitted @ (self._lost_across | self._lost_within) > 0
        # An image is made from the points of each side alone.
        self._intact[:, 0] = ~np.where(self._is_image, within, any_lost)
        self._parted[:, 0] = ~self._is_image & any_lost & (self._fitted_apart @ self._lost_within == 0)
        share.fill(self._intact, self._parted)

    def break_bonds(self, pairs: np.ndarray) -> None:
        """Take account of broken pairs, after `Kinematics.weighted_bonds` and `Kinematics.inverse_shape` were updated."""
        bonds, kinematics = self._body.bonds, self._kinematics
        self._lose(bonds.first[pairs], bonds.second[pairs])
        numbers, owners, _ = self._across
        of_all = kinematics.weighted_bonds, kinematics.inverse_shape
        weights = _weights(*of_all, numbers, owners)
        if self._kept is not None:
            kept, inverse, supported = self._kept
            beside, points, changes = self.one_sided_bonds or (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 1)))
            kept[beside] = kinematics.weighted_bonds[beside]
            kept[self.left_out] = 0.0
            find_shapes(self._body, np.unique(points).astype(np.uint32), kept, inverse, supported)
            # A point whose other bonds no longer determine a gradient has that of all its bonds.
            weights = np.where(supported[owners, None] > 0, _weights(kept, inverse, numbers, owners), weights)
            if len(beside):
                changes[:] = _weights(kept, inverse, beside, points) - _weights(*of_all, beside, points)
                changes[supported[points] == 0] = 0.0
                _refill((self._one_sided, self._one_sided_back), self._of_changes())
        _refill((self._correct, self._correct_back), self._of_corrections(weights))

    def _of_corrections(self, weights: np.ndarray) -> tuple[scipy.sparse.csr_array, scipy.sparse.csr_array]:
        """Return the matrix that maps jumps to corrections of gradients, by the weights of the bonds across, and minus its transpose."""
        _, owners, neighbors = self._across
        return self._with_back(-weights * self.depths[neighbors, None], owners, neighbors)

    def _by_normals(self, matrix) -> scipy.sparse.csr_array:
        """Return the matrix (n d, n) that maps vectors at points to columns of gradients: v (x) normal, spread by a matrix (n, n)."""
        entries = scipy.sparse.coo_array(matrix)
        return self._on_columns(entries.data[:, None] * self.normals[entries.col], entries.row, entries.col)[:, : len(self._body)]

    def _products(self, matrices: list, values: np.ndarray, out: np.ndarray, every: bool = False) -> list[Step]:
        """Return the passes that write the product of matrices, the last one first, and `values` to rows of `out`, see `sparse_product`."""
        *further, first = matrices
        if not further:
            return self._product(first, values, out, every=every)
        between = np.zeros((first.shape[0], values.shape[1]))
        return [*self._product(first, values, between), *self._products(further, between, out, every)]

    def _with_transpose(self, matrix: scipy.sparse.csr_array) -> tuple[scipy.sparse.csr_array, scipy.sparse.csr_array]:
        """Return a matrix (n, n), filled in the rows of this rank's own points only, and a transpose.

        The transpose is that of the matrix with its rows of halo points (points of other ranks) filled in by their owners.
        """
        return matrix, self._body.share.with_rows_of_others(matrix).T.tocsr()

    def _on_columns(self, weights: np.ndarray, owners: np.ndarray, others: np.ndarray) -> scipy.sparse.csr_array:
        """Return the matrix (n d, n + m) that maps values at points and ghosts to columns of gradients at points.

        The k bonds from `owners` to `others` have the weights (k, d) in the gradients of `owners`.
        """
        d, n, total = self._body.dimension, len(self._body), len(self._body.all_points)
        rows = (d * owners.astype(np.int64)[:, None] + np.arange(d)).ravel()
        return scipy.sparse.csr_array((weights.ravel(), (rows, np.repeat(others, d))), shape=(n * d, total))

    def _with_back(self, *bonds: np.ndarray) -> tuple[scipy.sparse.csr_array, scipy.sparse.csr_array]:
        """Return the matrix of `_on_columns`, and minus its transpose."""
        found = self._on_columns(*bonds)
        found.sort_indices()
        return found, (-found).T.tocsr()

    def _unseen(self, owners: np.ndarray, across: np.ndarray, moduli: np.ndarray) -> np.ndarray:
        """Return those directed bonds `across` interfaces that the gradient and energy of their first point omit (`left_out`).

        `owners` are the first points of all directed bonds, and `moduli` the shear moduli of all points and ghosts.
        """
        body, neighbors = self._body, self._body.bonds.neighbors[across]
        normals = np.vstack([self.normals, body.ghosts.reflected_vectors(self.normals)])[neighbors]
        arms = body.all_points[owners[across]] - body.all_points[neighbors]
        # A bond along the interface counts as one behind it, whatever rounding says.
        behind = (self.depths[neighbors] > 0) & (np.einsum("bi,bi->b", arms, normals) <= 1e-9 * body.spacing)
        return across[(moduli[owners[across]] > YIELDING * moduli[neighbors]) | behind]

    def _leave_out(self, kinematics: Kinematics, owners: np.ndarray, weights: np.ndarray, breakable: bool) -> np.ndarray:
        """Remove the bonds `left_out` from the gradients of their first points; return new `Kinematics.gradient_weights` of all bonds.

        `owners` are the first points of all directed bonds, and `weights` their present weights. Bonds of points whose other bonds do not
        determine a gradient are removed from `left_out` instead.
        """
        for _ in range(2):
            kept = kinematics.weighted_bonds.copy()
            kept[self.left_out] = 0.0
            inverse, supported = np.zeros_like(kinematics.inverse_shape), np.zeros_like(kinematics.supported)
            rows = np.unique(owners[self.left_out]).astype(np.uint32)
            find_shapes(self._body, rows, kept, inverse, supported)
            self.left_out = self.left_out[supported[owners[self.left_out]] > 0]
        self._kept = (kept, inverse, supported) if breakable else None
        touched = np.flatnonzero(supported[owners])
        if not len(touched):
            return weights
        found = kinematics.gradient_weights(kept, inverse)
        changes = found[touched] - weights[touched]
        weights = weights.copy()
        weights[touched] = found[touched]
        self.one_sided_bonds = touched, owners[touched], changes
        self._one_sided, self._one_sided_back = self._of_changes()
        return weights

    def _of_changes(self) -> tuple[scipy.sparse.csr_array, scipy.sparse.csr_array]:
        """Return the matrix that maps positions to the changes of gradients by `one_sided_bonds`, and minus its transpose."""
        numbers, points, changes = self.one_sided_bonds
        ends = np.concatenate([self._body.bonds.neighbors[numbers], points])
        return self._with_back(np.concatenate([changes, -changes]), np.tile(points, 2), ends)

    def cells_across(self, number: int, most: int) -> float:
        """Return the median thickness, in spacings and at most `most`, of the layer of a material next to its interfaces; 0 if it has none.

        `number` is the number of the material in `portion_of`, or the number that stands for rigid parts there.
        """
        body, portion_of = self._body, self._portion_of
        beside = np.flatnonzero((portion_of[: len(body)] == number) & (self.depths[: len(body)] > 0))
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
        self, forces: np.ndarray, moments: np.ndarray, own_moments: np.ndarray, on_points: np.ndarray, pulls: np.ndarray
    ) -> list[Step]:
        """Return the steps that find forces such as `on_jumps` and `pulls`: the transpose of `corrections` and `continuation`.

        Parameters
        ----------
        forces, moments : ndarray, shapes (n + m, d) and (n + m, d d)
            Minus the derivative of the energy by positions in the continued motion of the other material, and its derivative by gradients
            in that motion; `moments` is overwritten.
        own_moments : ndarray, shape (n, d d)
            Derivative of the energy by the points' own gradients; terms of mirror images are added in place.
        on_points, pulls : ndarray, shapes (n, d) and (n + m, d)
            Receive the forces, see the attributes `on_jumps` and `pulls`.
        """
        n, d, ghosts, product, chunks = len(self._body), self._body.dimension, self._body.ghosts, self._product, self._kinematics.chunks
        on_jumps, theirs, columns = np.zeros_like(self.jumps), moments[:n].reshape(-1, d), own_moments.reshape(-1, d)
        fold = [fold_vectors.bind(each, ghosts.source, ghosts.parity, chunks=chunks) for each in (on_jumps, pulls)]
        apart, on_apart = [], []
        if self._watched:
            parted = np.zeros((n, d))
            apart = [partial(np.multiply, on_jumps[:n], self._parted, out=parted), parted, partial(_scale, on_jumps[:n], self._intact)]
            on_apart = [parted, *product(self._torn_back, parted, on_points, add=True)]
        return [
            fold_matrices.bind(moments, *self._kinematics.gradient_ghosts.of_gradients, chunks=chunks),
            moments,
            *self._kept_rows(moments),
            *product(scipy.sparse.diags_array(-self.depths), forces, on_jumps, every=True),
            *product(-self._changes_by_jumps.T, theirs, on_jumps, add=True),
            *product(self._changes_back, theirs, columns, add=True),
            own_moments,
            *product(self._correct_back, columns, on_jumps, add=True, variable=self._breakable),
            fold[0],
            *apart,
            *product(-self._jumps_by_columns.T, on_jumps, columns, add=True),
            on_jumps[:n],
            *self._products([each.T for each in reversed(self._jump_of_all)], on_jumps, on_points, every=self._watched),
            *on_apart,
            own_moments,
            *([*product(self._one_sided_back, columns, pulls, every=True, variable=True), fold[1]] if self._one_sided.nnz else []),
        ]


def _rounded(values: np.ndarray | float, unit: float) -> np.ndarray:
    """Return values rounded to multiples of `ROUNDED` units."""
    return np.round(values / (ROUNDED * unit)) * (ROUNDED * unit)


def _matrix_of(rows: dict[int, tuple[np.ndarray, np.ndarray]], n: int) -> scipy.sparse.csr_array:
    """Return the matrix (n, n) with the given rows, the columns and entries of each, and no entries in other rows."""
    lengths, (columns, entries) = np.zeros(n, dtype=np.int64), zip(*rows.values(), strict=True) if rows else ((), ())
    lengths[list(rows)] = [len(of_row) for of_row in columns]
    arrays = np.concatenate([np.zeros(0), *entries]), np.concatenate([np.zeros(0, np.int64), *columns])
    found = scipy.sparse.csr_array((*arrays, np.append(0, np.cumsum(lengths))), shape=(n, n))
    found.sort_indices()
    return found


def _by_different_rows(matrix: scipy.sparse.csr_array) -> list[scipy.sparse.csr_array]:
    """Return matrices whose product is `matrix`: a selection of rows, and these rows; only `matrix` itself if all its rows differ."""
    filled, different = np.flatnonzero(np.diff(matrix.indptr)), {}
    ends = zip(matrix.indptr[filled], matrix.indptr[filled + 1], strict=True)
    keys = [matrix.indices[begin:end].tobytes() + matrix.data[begin:end].tobytes() for begin, end in ends]
    which = [different.setdefault(key, len(different)) for key in keys]
    if len(different) == len(filled):
        return [matrix]
    first = filled[np.unique(which, return_index=True)[1]]
    return [scipy.sparse.csr_array((np.ones(len(filled)), (filled, which)), shape=(matrix.shape[0], len(first))), matrix[first]]


def _two_sides(
    body: Body, tree: scipy.spatial.cKDTree, portion_of: np.ndarray, place: np.ndarray, normal: np.ndarray, both: tuple[int, int], shape
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """Return the points to which the motion is fitted at a place on an interface, and the radius of the fit.

    The points, of the two materials `both`, are given by their numbers, their positions relative to the place in units of the radius, flags
    of those of the second material, toward which `normal` points, and heights above the interface. `tree` holds the points, not the ghosts.
    """
    reach = (REACH if shape is None else ROUND_REACH) * body.horizon
    around = np.array(tree.query_ball_point(place, reach * WITH_ROUNDING, return_sorted=True), dtype=np.int64)
    around = around[(portion_of[around] == both[0]) | (portion_of[around] == both[1])]
    x, beyond = (body.points[around] - place) / reach, portion_of[around] == both[1]
    outwards = 0.0 if shape is None else np.sign((place - shape.center) @ normal)
    heights = x @ normal if shape is None else outwards * shape.distances(body.points[around]) / reach
    # Beyond a thin layer or a gap there may be more of the same material, which does not belong to this interface.
    # A point at the place itself is on the interface, whatever rounding says.
    near = np.where(beyond, -1.0, 1.0) * heights <= SECTOR * np.linalg.norm(x, axis=1) + ROUNDED
    return around[near], x[near], beyond[near], heights[near], reach


def _fits_at(at: tuple, quadratic: bool, watched: bool) -> tuple:
    """Return the numbers and weights of points whose values give the jump of the slope at a place on an interface.

    `at` holds the arguments of `_two_sides`. The second item returned holds those of fits to each side alone, if `watched`. Both items may
    be None, see `_jump_of_slopes`.
    """
    (around, x, beyond, heights, reach), (body, *_, normal, _, _) = _two_sides(*at), at
    volumes, apart_reach = body.volumes[around], TORN_REACH * body.horizon
    jump = _jump_of_slopes(x, volumes, heights * beyond, quadratic)
    apart = _jump_of_sides(x * reach / apart_reach, volumes, normal, beyond) if watched else None
    return jump if jump is None else (around, jump / reach), apart if apart is None else (around, apart / apart_reach)


def _round_beside(body: Body, tree: scipy.spatial.cKDTree, portion_of: np.ndarray, i: int) -> Near | None:
    """Return the circle or sphere next to point i on which the material changes, None if there is none; `tree` holds points and ghosts."""
    rounds = [each for each in body.rounds if each.radius > LEAST_RADIUS * body.spacing]
    if not rounds:
        return None
    distances = [float(_rounded(each.distances(body.points[i : i + 1])[0], body.spacing)) for each in rounds]
    nearest = int(np.abs(distances).argmin())
    depth, arm = abs(distances[nearest]), body.points[i] - rounds[nearest].center
    normal = -np.sign(distances[nearest]) * arm / np.linalg.norm(arm)
    # Of points equally near to the place beyond the interface, those on the interface may be of the own material.
    place = body.points[i] + (depth + body.spacing / 2) * normal
    beyond = portion_of[tree.query_ball_point(place, tree.query(place)[0] * (1 + 1e-6), return_sorted=True)]
    others = beyond[beyond != portion_of[i]]
    return (depth, normal, int(others[0]), 0.0, rounds[nearest]) if 0 < depth <= FARTHEST * body.horizon and len(others) else None


def _interface_beside(body: Body, tree: scipy.spatial.cKDTree, portion_of: np.ndarray, i: int) -> Near | None:
    """Return the interface near point i as the plane that divides the volume around the point as the two materials there do.

    `tree` holds all points and ghosts. Return None if there are not exactly two materials, or no such plane lies in front of the point.
    """
    points, volumes, own = body.all_points, body.all_volumes, portion_of[i]
    place = points[i]
    for _ in range(CENTERINGS):
        around = np.array(tree.query_ball_point(place, body.horizon * WITH_ROUNDING, return_sorted=True), dtype=np.int64)
        others = portion_of[around] != own
        kinds = np.unique(portion_of[around[others]])
        if len(kinds) != 1 or others.all():
            return None
        V = volumes[around]
        x = points[around] - V @ points[around] / V.sum()
        second = np.einsum("k,ka,kb->ab", V, x, x)
        if np.linalg.eigvalsh(second)[0] < 1e-3 * np.trace(second):
            return None
        normal = np.linalg.solve(second, (V * (others - V @ others / V.sum())) @ x)
        normal /= np.linalg.norm(normal)
        # The plane has as much of the volume beyond it as the other material has.
        along = points[around] @ normal
        order = np.argsort(along, kind="stable")
        behind = np.searchsorted(np.cumsum(V[order]), V[~others].sum() * (1 + 1e-9))
        if not 0 < behind < len(order):
            return None
        depth = (along[order[behind - 1]] + along[order[behind]]) / 2 - points[i] @ normal
        if abs(depth) > FARTHEST * body.horizon:
            return None
        place = points[i] + depth * normal
    astray = V[others != (along > along[order[behind - 1]] + 1e-9 * body.spacing)].sum() / V.sum()
    return (float(depth), normal, int(kinds[0]), float(astray), None) if depth > 0 else None


def _nearest_softer(body: Body, tree: scipy.spatial.cKDTree, portion_of: np.ndarray, moduli: np.ndarray, i: int) -> Near | None:
    """Return the interface near point i, placed half a spacing before the nearest points of a much softer material.

    `tree` holds all points and ghosts. Return None if no much softer material (`YIELDING`) lies within the horizon of the point.
    """
    around = np.array(tree.query_ball_point(body.points[i], body.horizon * WITH_ROUNDING, return_sorted=True), dtype=np.int64)
    softer = around[moduli[around] * YIELDING < moduli[i]]
    if not len(softer):
        return None
    arms = body.all_points[softer] - body.points[i]
    distance = np.linalg.norm(arms, axis=1)
    nearest = distance < distance.min() * (1 + 1e-6)
    normal = arms[nearest].mean(axis=0)
    length = np.linalg.norm(normal)
    depth = length - body.spacing / 2 if length > 0 else 0.0
    return (float(depth), normal / length, int(portion_of[softer[nearest][0]]), 0.0, None) if depth > 0 else None


def _scale(rows: np.ndarray, factors: np.ndarray) -> None:
    """Multiply rows by factors in place."""
    np.multiply(rows, factors, out=rows)


def _weights(weighted_bonds: np.ndarray, inverse_shape: np.ndarray, numbers: np.ndarray, owners: np.ndarray) -> np.ndarray:
    """Return `Kinematics.gradient_weights` of some bonds, given by their numbers and their first points."""
    return np.einsum("bij,bj->bi", symmetric(inverse_shape[owners]), weighted_bonds[numbers])


def _refill(matrices: tuple, found: tuple) -> None:
    """Replace the entries of matrices by those of others with the same pattern."""
    for matrix, other in zip(matrices, found, strict=True):
        matrix.data[:] = other.data


def _jump_of_sides(x: np.ndarray, volumes: np.ndarray, normal: np.ndarray, beyond: np.ndarray) -> np.ndarray | None:
    """Return weights as `_jump_of_slopes` does, of linear functions that are fitted to the two sides separately.

    Return None if the points of either side do not determine a linear function. `beyond` flags the points of the other side.
    """
    weights, found = volumes * np.maximum(1 - (x * x).sum(axis=1), 0.0), np.zeros(len(x))
    for side, sign in ((beyond, 1.0), (~beyond, -1.0)):
        values = np.column_stack([np.ones(side.sum()), x[side]])
        second = values.T @ (weights[side, None] * values) / weights.sum()
        if not np.linalg.cond(second) < WORST_CONDITION:
            return None
        found[side] = sign * weights[side] * (values @ np.linalg.solve(second, np.append(0.0, normal))) / weights.sum()
    return found


def _jump_of_slopes(x: np.ndarray, volumes: np.ndarray, beyond: np.ndarray, quadratic: bool) -> np.ndarray | None:
    """Return the weights (k,) with which values at points give the jump of their slope along a normal across an interface.

    The jump belongs to the continuous function that fits the values best. On either side this function is quadratic if `quadratic` is True
    and the points determine it, or else linear. Return None if the points do not determine a linear function.

    Parameters
    ----------
    x : ndarray, shape (k, d)
        Positions of the points relative to a place on the interface, in units of the radius of the fit.
    volumes : ndarray, shape (k,)
    beyond : ndarray, shape (k,)
        Distances from the interface of points beyond it, zero for others.
    quadratic : bool
    """
    linear = [beyond, np.ones(len(x)), *x.T]
    curved = [x[:, a] * x[:, b] for a in range(x.shape[1]) for b in range(a + 1)] + [beyond * along for along in x.T]
    weights = volumes * np.maximum(1 - (x * x).sum(axis=1), 0.0)
    for functions in ([*linear, *curved], linear) if quadratic else (linear,):
        values = np.stack(functions, axis=1)
        second = values.T @ (weights[:, None] * values) / weights.sum()
        if np.linalg.cond(second) < WORST_CONDITION:
            return weights * (values @ np.linalg.solve(second, np.eye(len(functions))[0])) / weights.sum()
    return None


def _mirrored(
    at: tuple[np.ndarray, np.ndarray, np.ndarray], normal: np.ndarray, sizes: tuple[float, float], own: np.ndarray, by_gradient: bool
) -> tuple[np.ndarray, np.ndarray] | tuple[None, None]:
    """Return the weights (k,) with which values at points give the jump that makes a stiff point an odd mirror image of softer material.

    Like the images of a clamp, theory (22), such images continue the stress of the softer material undisturbed up to a nearly undeformed
    stiff material. The second array returned holds the weights with which values at the softer points give the value at the mirrored place.
    Both are None if the points determine no value at the interface or at the mirrored place.

    Parameters
    ----------
    at : tuple of ndarray
        Positions of the points relative to the place on the interface, shape (k, d), their volumes (k,), and flags of the softer ones.
    normal : ndarray, shape (d,)
    sizes : tuple of float
        Distance of the stiff point to the interface, and spacing, in the unit of the positions.
    own : ndarray of bool, shape (k,)
        True at the stiff point itself.
    by_gradient : bool
        Whether the deformed place on the interface follows from the stiff point and its gradient; the weights then omit the gradient's
        term.
    """
    (x, volumes, beyond), (depth, spacing) = at, sizes
    mirrored = _interpolation(x[beyond], volumes[beyond], depth * normal, spacing)
    at_interface = None if by_gradient else _interpolation(x[~beyond], volumes[~beyond], np.zeros_like(normal), spacing)
    if mirrored is None or (at_interface is None and not by_gradient):
        return None, None
    jump = own / -depth if by_gradient else own / depth
    if not by_gradient:
        jump[~beyond] -= 2 * at_interface / depth
    jump[beyond] += mirrored / depth
    return jump, mirrored


def _interpolation(x: np.ndarray, volumes: np.ndarray, place: np.ndarray, spacing: float) -> np.ndarray | None:
    """Return weights (k,) that interpolate values at points `x` (k, d) to a place, exactly for linear functions, from the nearest points.

    Return None if the points within the greatest radius of `NEAREST` spacings do not determine a linear function.
    """
    arms = x - place
    distance = np.linalg.norm(arms, axis=1) / spacing
    values = np.column_stack([np.ones(len(x)), arms / spacing])
    for reach in NEAREST:
        # A point at the place itself has all the weight.
        weights = volumes * np.maximum(1 - distance / reach, 0.0) ** 2 / (distance**2 + 1e-8)
        if np.count_nonzero(weights) <= len(place):
            continue
        second = values.T @ (weights[:, None] * values) / weights.sum()
        scale = 1 / np.sqrt(np.maximum(np.diag(second), 1e-300))
        if np.linalg.cond(second * scale[:, None] * scale) < WORST_SPREAD:
            return weights * (values @ np.linalg.solve(second, np.eye(len(second))[0])) / weights.sum()
    return None
