"""Springs along the nearest bonds of a body, for preconditioners and first guesses: their stiffness
matrix and its inverse.

For a body divided among ranks the inverse is approximate: it combines overlapping parts of the body
and affine motions of each part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy
from functools import cached_property

import numpy as np
import scipy

from ..body import Body
from ..body.body import lengths_of, sums_at_points
from ..body.bonds import SLAB
from ..kernels.nearest_bonds import add_unspanned
from ..ranks import Share
from .lattice_multigrid import cycles_of
from .multigrid import Multigrid, Operator, conjugate_gradients, factor_of

REACH = 1.3
"""Greatest length, in spacings, of the bonds in the stiffness matrix: four bonds per point on a
plane grid, and about as many off a grid.

Longer bonds belong to it if no two shorter ones span them (`add_unspanned`), as between the layers
of cells that are longer than wide. With the diagonal bonds too, a factorization has four times the
entries and costs four times as much, for a tenth fewer steps.
"""

WIDE_REACH = 1.8
MOST_WIDE = 200_000
"""Greatest length, in spacings, of the bonds in the stiffness matrix of a relaxed sheet, and the
greatest number of points of such a sheet.

Within `REACH` a point of a cloud has three to six bonds, and few bonds on one side make the network
softer there than the sheet. Chosen: with 1.8 sheets in uniaxial tension, in pure shear and with a
hole need a fifth to a third fewer force evaluations, with 2.0 a little fewer still; the factor has
1.7 and 2.5 times the entries. Solids need no fewer, and use `REACH`, as do sheets of more points,
whose factor has to fit into memory.
"""

TOUCHING = 1e-6
"""Deviation from a right angle that may be rounding: on a grid, two sides of a cell span its
diagonal at exactly 90 degrees.
"""

ELONGATION = 6.0
"""Stiffness of a spring along its bond, in units of mu w V_i V_j/kappa: shear modulus mu, weight
function w, volumes V_i and V_j of the bond's points, and kappa from the shape tensor kappa I of a
full horizon. With `SHEAR_SHARE`, in the mean over all directions of bonds, the network has the
stiffness of rubber in pure shear in the plane, and 0.9 of it in three dimensions.
"""

SHEAR_SHARE = 1 / 3
"""Stiffness of a spring across its bond, divided by that along it. Chosen: without stiffness across
bonds, the network of a square grid has no stiffness against shear; with equal ones it is a
Laplacian, which does not couple the components.
"""

STRUTS = {2: 8.0, 3: 10.0}
"""Stiffness of springs along bonds, by dimension, in the units of `ELONGATION`, if there are none
across bonds. In the mean over all directions of bonds, the network has the stiffness of rubber in
pure shear.
"""

SHIFT = 1e-6
"""Fraction of the mean diagonal entry of a stiffness matrix that is added to its diagonal, so that
the matrix can be factorized even if the body can drift. Chosen: ten digits above rounding; the
slowest mode of a sheet a thousand points across, held all around, becomes some 20 % stiffer, which
does not harm a preconditioner.
"""

MOST_FACTORIZED = 5_000
"""Greatest number of points for which a Laplacian is factorized; multigrid replaces larger factors,
which fill in. Chosen: with multigrid blocks in plane strain need 143 in place of 178 evaluations
with 10,000 points, and 246 in place of 270 with 80,000.
"""

MOST_SOLVED = {2: 20_000, 3: 5_000}
"""Greatest number of points, by dimension, of a lattice whose springs are factorized; multigrid
cycles replace larger factors. Chosen: in homogeneous tension cycles need up to a fifth more
evaluations, elsewhere as many. The factor of so many points takes as long as 40 evaluations of the
default force of a sheet, or eight of exact energies, and each solution as long as three cycles.
"""

MOST_SCATTERED = 300_000
"""Greatest number of points on no lattice whose springs are factorized, at some 3 kB a point.
Larger bodies have springs of equal stiffness along and across bonds, a Laplacian.
"""

MOST_DENSE = 800
"""Greatest number of rows of a stiffness matrix that is stored and inverted as a dense array.
Chosen: this takes some 20 ms and 10 MB; to load SciPy's sparse solvers, which larger matrices need,
takes 200 ms and 30 MB.
"""

RAISED = 4 / 3
"""Stiffness of the springs of a Laplacian that approximates the tangent of a nearly incompressible
body, in the units of `ELONGATION`.

Springs of stiffness k in a full horizon have the energy k mu/4 |grad u|^2; without the pressures
undeformed rubber has mu/2 |grad u|^2, which is k = 2. In an earlier version k = 1.25 and 1.5 needed
a fifth to a quarter fewer force evaluations than k = 1, and k = 2 no fewer (bonded blocks of 12 to
20 points a side, K = 100 mu and 1000 mu). Now k = 2 needs the fewest: with 1, 4/3 and 2 the scene
`bonded-block`, 8 points a side, needs 31, 30 and 28 (K = 100 mu), and 79, 57 and 37 (K = 1000 mu).
"""


ADDED = 0.6
"""Factor on the approximate displacements of a body divided among ranks, sums of the solutions of
overlapping parts and of affine motions.

Without it the sums would be too large, since they contain several solutions for a point: with 1
nearly incompressible bodies need half as many force evaluations more on two ranks; 0.5 and 0.65
need as many as 0.6. Steps of Chebyshev's method with this operator save a fifth of the evaluations
at most, in general none, and take twice the time.
"""

MOST_STEPS = 200
"""Maximum number of conjugate-gradient steps in a solution for the displacements of a network of
springs; some tens are usual.
"""


class Preconditioner:
    """Preconditioner of a solver for equilibrium: an approximation of the tangent stiffness whose
    inverse is cheap to apply.

    Parameters
    ----------
    solve : callable
        Returns the displacements (n, d) under given forces (n, d).
    update : callable, optional
        Adapts the preconditioner to the state in which the force was last evaluated, and returns
        whether the tangent has changed abruptly, so that curvature gathered before is no longer
        valid; by default it does nothing.
    """

    def __init__(self, solve: Operator, update: Callable[[], bool] = lambda: False) -> None:
        self.solve = solve
        self.update = update


class NearestBonds:
    """Network of springs at the nearest bonds of a body, which resist displacements along the bonds
    and across them.

    Stiffnesses are scaled so that these springs replace springs at all bonds: the scale makes the
    sum of stiffness times squared length over the nearest bonds equal to the sum that all bonds
    would have.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
        Shear modulus: one for all points, or one for each.
    along, across : float
        Stiffness of a spring against displacements along its bond and across it, in the units
        stated at `ELONGATION`, before scaling.
    diagonal : bool
        Whether bonds up to `WIDE_REACH` have springs in any body, which holds a lattice together
        without stiffness across bonds.

    Attributes
    ----------
    first, second : ndarray of int, shape (k,)
        Ends of the bonds; `second` may be a ghost, the image of a point beyond a reflection plane.
    sources : ndarray of int, shape (k,)
        The point at the second end, or the point of which that end is an image.
    wide : bool
        Whether bonds up to `WIDE_REACH` have springs.
    coupled : bool
        Whether the displacements of a component cause forces on others.
    unit_stiffness : ndarray, shape (k,)
        Stiffness of the springs for `along` and `across` of 1.
    body
    """

    def __init__(
        self,
        body: Body,
        shear_moduli: float | np.ndarray,
        along: float,
        across: float,
        diagonal: bool = False,
    ) -> None:
        share = body.share
        bonds = body.bonds
        self.body = body
        self.coupled = along != across
        self.wide = diagonal or (body.relaxed and body.dimension == 2 and share.size <= MOST_WIDE)
        if isinstance(shear_moduli, np.ndarray):
            shear_moduli = np.concatenate([shear_moduli, shear_moduli[body.ghosts.source]])
        owners = np.append(np.arange(len(body), dtype=np.uint32), body.ghosts.source)
        moments = np.zeros(2)  # of all bonds and of the nearest ones
        kept = []
        for slab in bonds.slabs():
            first, second = bonds.first[slab], bonds.second[slab]
            vector = body.all_points[second] - body.all_points[first]
            length = lengths_of(vector)
            near = length <= (WIDE_REACH if self.wide else REACH) * body.spacing
            add_unspanned(
                body.all_points,
                *bonds.pairs_of_points,
                bonds.ends,
                first,
                second,
                owners[second],
                TOUCHING,
                near,
            )
            modulus = shear_moduli
            if isinstance(modulus, np.ndarray):
                # Two springs in series, computed with inverses, since the product of two moduli
                # may overflow.
                modulus = 2 / (1 / modulus[first] + 1 / modulus[second])
            volumes = body.all_volumes[first] * body.all_volumes[second]
            stiffness = modulus * body.weigh(length) * volumes / body.kappa
            moment = stiffness * length**2 * share.own[first]
            moments += moment.sum(), moment[near].sum()
            ends = first[near], second[near], owners[second[near]]
            kept.append((*ends, stiffness[near], vector[near] / length[near, None]))
        self.first, self.second, self.sources, self.unit_stiffness, self._along = map(
            np.concatenate, zip(*kept, strict=True)
        )
        of_all, of_near = share.total(moments)
        self.unit_stiffness *= of_all / of_near
        self._factors = across, along - across

    @property
    def _across(self) -> np.ndarray:
        """Stiffness of the springs across their bonds, shape (k,)."""
        return self._factors[0] * self.unit_stiffness

    @property
    def _excess(self) -> np.ndarray:
        """Excess of the stiffness of the springs along their bonds over that across, shape (k,)."""
        return self._factors[1] * self.unit_stiffness

    def on_axis(self, axis: int) -> Iterator[tuple[np.ndarray, ...]]:
        """Yield `first`, `second` and `sources` of the springs, part by part, with their
        stiffnesses against displacements along an axis, and the signs with which second ends follow
        `sources`.
        """
        across, excess = self._factors
        signs = np.append(np.ones(len(self.body)), self.body.ghosts.parity[:, axis])
        for start in range(0, len(self.first), SLAB):
            part = slice(start, start + SLAB)
            second = self.second[part]
            stiffness = across + excess * self._along[part, axis] ** 2
            stiffness *= self.unit_stiffness[part]
            yield self.first[part], second, self.sources[part], stiffness, signs[second]

    @property
    def oblique(self) -> np.ndarray:
        """Flags (k,) of the springs that couple components, as beside curved boundaries."""
        found = np.ones(len(self.first), dtype=bool) & self.coupled
        for direction in self._along.T:
            found &= np.abs(direction) < 1 - TOUCHING
        return found

    def beside(self, points: np.ndarray) -> NearestBonds:
        """Return the network of the springs with an end at one of the `points`, flags (n,)."""
        found = copy(self)
        near = points[self.first] | points[self.sources]
        for name in ("first", "second", "sources", "unit_stiffness", "_along"):
            setattr(found, name, getattr(self, name)[near])
        return found

    @cached_property
    def pairs(self) -> np.ndarray:
        """Numbers of the bonds of the springs among the pairs of the body, shape (k,), rising."""
        bonds = self.body.bonds
        names = (
            first.astype(np.int64) * len(self.body.all_points) + second
            for first, second in ((bonds.first, bonds.second), (self.first, self.second))
        )
        return np.flatnonzero(np.isin(*names))

    def weakened(self, broken: np.ndarray, left: float) -> NearestBonds:
        """Return the network with the part `left` of the stiffness of springs, flags (k,), whose
        bonds are `broken`.
        """
        found = copy(self)
        found.unit_stiffness = np.where(broken, left * self.unit_stiffness, self.unit_stiffness)
        return found

    def forces(self, moved: np.ndarray, of_images: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the restoring forces (n, d) of the springs on the points, minus stiffness times
        displacement, for displacements `moved`.

        Displacements of the halo (points of other ranks) are filled in place. The displacements of
        images follow from those of their points, plus `of_images`, shape (m, d).
        """
        ghosts = self.body.ghosts
        self.body.share.fill(moved)
        moved = np.vstack([moved, moved[ghosts.source] * ghosts.parity + of_images])
        changes = moved[self.second] - moved[self.first]
        forces = self._across[:, None] * changes
        if self.coupled:
            forces += (self._excess * np.einsum("bi,bi->b", self._along, changes))[
                :, None
            ] * self._along
        return sums_at_points(len(self.body), self.first, self.second, forces, -1)

    def matrix(self, rigid: np.ndarray | None = None) -> np.ndarray | scipy.sparse.sparray:
        """Return the stiffness matrix of all components, held or free, shape (d n, d n), with the
        components of a point in sequence.

        It is a dense array for at most `MOST_DENSE` rows, and sparse for more, as are the matrices
        of `systems`. Springs between two points that are True in `rigid`, shape (n,), are omitted.
        """
        d = self.body.dimension
        blocks = np.einsum("b,bi,bj->bij", self._excess, self._along, self._along) + self._across[
            :, None, None
        ] * np.eye(d)
        if rigid is not None:
            blocks *= ~(rigid[self.first] & rigid[self.sources])[:, None, None]
        rows, columns, values = self._entries(blocks, self._parity()[:, None])
        rows = d * rows[:, None, None] + np.arange(d)[:, None]
        columns = d * columns[:, None, None] + np.arange(d)
        places = [np.broadcast_to(numbers, values.shape).ravel() for numbers in (rows, columns)]
        return _symmetric(d * len(self.body), *places, values.ravel())

    def systems(
        self, free: np.ndarray
    ) -> list[tuple[list[int], np.ndarray | scipy.sparse.sparray]]:
        """Return the stiffness matrix in parts that are not coupled, as pairs of component numbers
        and the matrix of these components.

        A network with `coupled` components has one part, with all components in one `matrix`.
        Otherwise a part consists of the components whose displacements all images repeat with the
        same sign, and that are held at the same points (where `free` (n, d) is 0); its matrix,
        shape (n, n), is that of each of these components.
        """
        found = []
        if self.coupled:
            return [(list(range(self.body.dimension)), self.matrix())]
        for components in self._alike(free):
            entries = self._entries(self._across, self._parity()[:, components[0]])
            found.append((components, _symmetric(len(self.body), *entries)))
        return found

    def _alike(self, free: np.ndarray) -> list[list[int]]:
        """Return the components in groups that images repeat and boundaries hold alike on all
        ranks, where `free` (n, d) is 0.
        """
        columns = np.vstack([self.body.ghosts.parity, free]).T
        share = self.body.share
        unlike = share.any((columns[:, None] != columns[None]).any(axis=2))
        return [
            np.flatnonzero(~row).tolist()
            for number, row in enumerate(unlike)
            if (~row).argmax() == number
        ]

    def _parity(self) -> np.ndarray:
        """Return the signs with which the second end of each bond follows the point that it
        mirrors, shape (k, d); 1 if it is no image.
        """
        return np.concatenate([np.ones_like(self.body.points), self.body.ghosts.parity])[
            self.second
        ]

    def _entries(
        self, values: np.ndarray, parity: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rows, columns and values of the stiffness matrix of springs with stiffnesses
        `values` (k, ...), without rows of ghosts.

        `parity` (k, ...) are the signs from `_parity`.
        """
        within = self.second < len(self.body)
        first = self.first
        second = self.second[within]
        ends = self.first[within]
        rows = np.concatenate([first, first, second, second])
        columns = np.concatenate([first, self.sources, second, ends])
        return (
            rows,
            columns,
            np.concatenate([values, -values * parity, values[within], -values[within]]),
        )


def springs_of(body: Body, shear_moduli: float | np.ndarray) -> NearestBonds:
    """Return the network of springs of a body, along bonds and across them, that approximates
    its small-strain stiffness.
    """
    along, across = ELONGATION, SHEAR_SHARE * ELONGATION
    if body.share.size > MOST_SCATTERED and (body.relaxed or body.mesh_cells is not None):
        along = across = (along + across) / 2
    return NearestBonds(body, shear_moduli, along, across)


def laplacian_of(body: Body, shear_moduli: float | np.ndarray) -> NearestBonds:
    """Return the network of springs with the same stiffness, the constant `RAISED`, along and
    across bonds: a Laplacian per component.

    The tangent of an incompressible neo-Hookean body in any state is such a Laplacian plus a
    contribution of the pressures.
    """
    return NearestBonds(body, shear_moduli, RAISED, RAISED)


def network_of(body: Body, shear_moduli: float | np.ndarray) -> NearestBonds:
    """Return `springs_of` a sheet, and in three dimensions `laplacian_of` the body, since a
    factorization of all components would need too much memory.
    """
    return (springs_of if body.dimension == 2 else laplacian_of)(body, shear_moduli)


def struts_of(body: Body, shear_moduli: float | np.ndarray) -> NearestBonds:
    """Return the network of springs along bonds alone, which resists no rotation: slender bodies
    bend as easily as those of rubber.

    Springs across bonds resist the rotation of the sections, so that a bar of the length L and the
    thickness h with them is stiffer against bending by some (L/h)^2.
    """
    return NearestBonds(body, shear_moduli, STRUTS[body.dimension], 0.0, diagonal=True)


def _symmetric(
    size: int, rows: np.ndarray, columns: np.ndarray, values: np.ndarray
) -> np.ndarray | scipy.sparse.sparray:
    """Return the symmetric part of the square matrix that is the sum of the given entries."""
    if size <= MOST_DENSE:
        matrix = np.bincount(rows * size + columns, values, size * size).reshape(size, size)
    else:
        matrix = scipy.sparse.csr_array((values, (rows, columns)), shape=(size, size))
    return (matrix + matrix.T) / 2


def held_matrix(
    matrix: np.ndarray | scipy.sparse.sparray, free: np.ndarray, mean: float | None = None
) -> np.ndarray | scipy.sparse.sparray:
    """Return a stiffness matrix with held components, where `free` is 0, decoupled, and with
    `SHIFT` added to the diagonal.

    `mean` is the mean of the diagonal in the whole body, by default that of the matrix.
    """
    mean = mean or matrix.diagonal().mean()
    diagonal = SHIFT * mean * free + mean * (1 - free)
    if isinstance(matrix, np.ndarray):
        return matrix * free * free[:, None] + np.diag(diagonal)
    keep = scipy.sparse.diags_array(free)
    return keep @ matrix @ keep + scipy.sparse.diags_array(diagonal)


def by_systems(systems: list[tuple[list[int], int, Operator]], values: np.ndarray) -> np.ndarray:
    """Return the result (n, d) of applying operators to values (n, d).

    `systems` are tuples of the component numbers to which an operator applies, the number of rows
    of its argument, and the operator.
    """
    found = np.empty_like(values)
    for components, rows, operator in systems:
        found[:, components] = operator(values[:, components].reshape(rows, -1)).reshape(
            len(values), -1
        )
    return found


def drift_remover(body: Body, free: np.ndarray) -> Operator:
    """Return a function that subtracts from values (n, d), in place, their means along the axes in
    which a body is not held.

    No equilibrium exists under a uniform force along such an axis; the stiffness against it is only
    `SHIFT`, which stands for none, so that the mean is removed before the system is solved.
    """
    share = body.share
    drifting = ~share.any((body.ghosts.parity < 0).any(axis=0) | (free == 0).any(axis=0))

    def balanced(values: np.ndarray) -> np.ndarray:
        for axis in np.flatnonzero(drifting):
            values[:, axis] -= share.sum(values[:, axis]) / share.size
        return values

    return balanced


def _inverse_here(network: NearestBonds, free: np.ndarray) -> tuple[Operator, bool]:
    """Return the inverse of the stiffness of a network in one process, and whether it is exact: by
    factorization, and not by cycles on a large lattice.

    In smooth, long-wave displacements the ratio of the network's stiffness to that of the true
    tangent does not grow with the number of points. The factorization takes seconds for 10^5
    points.
    """
    body = network.body
    inverses = []
    balanced = drift_remover(body, free)
    if network.coupled and not network.wide and len(body) > MOST_SOLVED[body.dimension]:
        cycles = cycles_of(body, network.on_axis, free, SHIFT)
        if cycles:
            corrected = _corrected(network, free, cycles)
            return lambda forces: balanced(corrected(forces * free)) * free, False
    for components, matrix in network.systems(free):
        count = matrix.shape[0]
        column = free[:, components].reshape(count, -1)[:, 0]
        system = held_matrix(matrix, column)
        if isinstance(system, np.ndarray):
            inverted = np.linalg.inv(system)
            inverse = ((inverted + inverted.T) / 2).__matmul__
        else:
            inverse = factor_of(system).solve
        inverses.append((components, count, inverse))
    return lambda forces: balanced(by_systems(inverses, forces * free)) * free, True


def _corrected(network: NearestBonds, free: np.ndarray, inverse: Operator) -> Operator:
    """Return an approximate inverse that follows and is followed by exact solutions for the points
    at bonds that couple components, and their neighbors: a multiplicative Schwarz method.
    """
    zone = np.zeros(len(network.body), dtype=bool)
    oblique = network.oblique
    if not oblique.any():
        return inverse
    ends = np.stack([network.first, network.sources])
    zone[ends[:, oblique]] = True
    zone[ends[:, zone[ends].any(axis=0)]] = True
    numbers = np.flatnonzero(np.repeat(zone[:, None], free.shape[1], axis=1) * free)
    rows = network.beside(zone).matrix()[numbers]
    factor = factor_of(
        rows[:, numbers] + SHIFT * scipy.sparse.diags_array(rows[:, numbers].diagonal())
    )

    def solve(forces: np.ndarray) -> np.ndarray:
        first = factor.solve(forces.ravel()[numbers])
        found = inverse(forces - (rows.T @ first).reshape(forces.shape) * free)
        found.ravel()[numbers] += first
        found.ravel()[numbers] += factor.solve(forces.ravel()[numbers] - rows @ found.ravel())
        return found

    return solve


def _inverse_in_parts(network: NearestBonds, free: np.ndarray) -> Operator:
    """Return an approximate inverse of the stiffness of a network divided among ranks: an additive
    two-level Schwarz method.

    The part of a rank inverts the stiffness of its own points and of those halo points that have
    all their nearest bonds on this rank; other points are held. The solutions of all parts are
    added, and with them the best combination of motions affine in every part.

    References
    ----------
    Toselli and Widlund, Domain Decomposition Methods (2005), ch. 3.
    """
    body = network.body
    share = network.body.share
    around = free.copy()
    degrees = sums_at_points(
        len(body), network.first, network.second, np.ones(len(network.first)), 1
    )
    of_owners = degrees.copy()
    share.fill(around, of_owners)
    invert, _ = _inverse_here(network, around * (degrees == of_owners)[:, None])
    balanced = drift_remover(body, around)
    modes, coarse = _affine_motions(network, around)
    k = modes.shape[1]
    own = slice(k * share.ranks.rank, k * (share.ranks.rank + 1))

    def solve(forces: np.ndarray) -> np.ndarray:
        rest = balanced(forces * free)
        share.fill(rest)
        found = invert(rest)
        share.fold(found)
        pulls = np.concatenate(share.everywhere(modes.T @ rest.ravel()))
        found += (modes @ (coarse @ pulls)[own]).reshape(forces.shape)
        return balanced(found * (ADDED * free)) * free

    return solve


def _inverse_by_multigrid(network: NearestBonds, free: np.ndarray) -> Operator:
    """Return the approximate inverse of the stiffness of a Laplacian by a multigrid cycle, the
    same on any number of ranks.
    """
    body = network.body
    share = network.body.share
    around = free.copy()
    inverses = []
    share.fill(around)
    balanced = drift_remover(body, around)
    for components, matrix in network.systems(around):
        column = around[:, components[0]]
        system = scipy.sparse.csr_array(
            held_matrix(matrix, column, share.sum(matrix.diagonal()) / share.size)
        )
        cycle = Multigrid(
            system, body.points, body.spacing, column > 0, len(components), share
        ).cycle
        inverses.append((components, len(body), cycle))
    return lambda forces: balanced(by_systems(inverses, balanced(forces * free))) * free


def _affine_motions(network: NearestBonds, around: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the k affine motions of this rank's own points, shape (d n, k), and the coarse inverse
    for the affine motions of all ranks.

    The coarse inverse is the pseudo-inverse of the network's stiffness projected onto the k motions
    of every rank, k times the number of ranks in all. Only free components move, where `around` (n,
    d), which includes the halo, is 1.
    """
    body = network.body
    share = network.body.share
    n, d = around.shape
    middle = np.stack(share.everywhere(body.points[share.own].mean(axis=0)))[share.owners]
    # All ranks use the same unit, since each forms the motions of its neighbors as well.
    functions = np.column_stack([np.ones(n), (body.points - middle) / body.extent])
    motions = np.zeros((d, d + 1, n, d))
    for axis in range(d):
        motions[axis, :, :, axis] = functions.T * around[:, axis]
    motions = motions.reshape(-1, n, d)
    k = len(motions)
    count = share.ranks.size
    own = (motions * share.own[:, None]).reshape(k, -1).T.copy()
    products = [
        (part, matrix.shape[0], matrix.__matmul__) for part, matrix in network.systems(around)
    ]
    rows = np.zeros((k, k * count))
    for rank in np.unique(share.owners):
        theirs = (share.owners == rank)[:, None]
        for number, motion in enumerate(motions):
            rows[:, k * rank + number] = own.T @ by_systems(products, motion * theirs).ravel()
    stiffness = np.concatenate(share.everywhere(rows))
    return own, np.linalg.pinv((stiffness + stiffness.T) / 2, rcond=1e-10, hermitian=True)


def inverse_of(network: NearestBonds, free: np.ndarray) -> Operator:
    """Return the inverse of the stiffness of a network of springs, or an approximate one, see
    `_inverse_of`.

    The inverse is a linear operator on forces (n, d), symmetric and positive definite.

    Parameters
    ----------
    network : NearestBonds
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held and on the halo.
    """
    return _inverse_of(network, free)[0]


def _inverse_of(network: NearestBonds, free: np.ndarray) -> tuple[Operator, bool]:
    """Return the inverse of the stiffness of a network of springs, and whether it is exact: it is
    not for a large Laplacian, on a large lattice, or for a body divided among ranks.
    """
    if not network.coupled and network.body.share.size > MOST_FACTORIZED:
        return _inverse_by_multigrid(network, free), False
    if network.body.share.divided:
        return _inverse_in_parts(network, free), False
    return _inverse_here(network, free)


def spring_solver_of(network: NearestBonds, free: np.ndarray, left: float) -> Operator:
    """Return a function that solves for the displacements of a network under forces (n, d).

    Where the inverse is approximate, conjugate gradients correct it until the norm of the residual,
    in the energy norm, is at most `left` times that of the forces.
    """
    inverse, exact = _inverse_of(network, free)
    if exact:
        return inverse
    share = network.body.share

    def solve(forces: np.ndarray) -> np.ndarray:
        return conjugate_gradients(
            forces * free,
            inverse,
            lambda moved: -network.forces(moved) * free,
            share.dot,
            left,
            MOST_STEPS,
        )

    return solve


def random_vector(share: Share, free: np.ndarray) -> np.ndarray:
    """Return random, normally distributed numbers in the free components, shape (n, d), which do
    not depend on the number of ranks.
    """
    whole = np.random.default_rng(0).standard_normal((share.size, free.shape[1]))
    return whole[share.numbers] * free
