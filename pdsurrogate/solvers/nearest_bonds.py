"""Springs along the nearest bonds of a body, for preconditioners and first guesses: their stiffness matrix and its inverse.

For a body divided among ranks the inverse is approximate: it combines overlapping parts of the body and affine motions of each part.
"""

from collections.abc import Callable, Iterable
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.linalg import eigh_tridiagonal

from ..body import Body
from ..body.body import sums_at_points
from ..forces import InternalForce
from ..kernels.steps import greatest_strain
from ..ranks import Share
from .multigrid import Multigrid, Operator, conjugate_gradient_steps, conjugate_gradients, factor_of

REACH = 1.3
"""Greatest length, in spacings, of the bonds in the stiffness matrix: four bonds per point on a grid, and similar ones off a grid.

With the diagonal bonds too, a factorisation has four times the entries and costs four times as much, for a tenth fewer steps.
"""

ELONGATION = 6.0
"""Stiffness of a spring along its bond, in units of mu w V_i V_j/kappa. With `SHEAR_SHARE`, in the mean over all directions of bonds, the
network has the stiffness of rubber in pure shear in the plane, and 0.9 of it in three dimensions."""

SHEAR_SHARE = 1 / 3
"""Stiffness of a spring across its bond over that along it; the true tangent has both. Chosen: without springs across, the network of a
square grid has no stiffness against shear; with equal ones it is a Laplacian, which does not couple the components."""

SHIFT = 1e-6
"""Fraction of its mean that is added to a matrix's diagonal, so that the matrix of a body that can drift can be factorised too. Chosen: ten
digits above rounding; the slowest mode of a sheet a thousand points across, held all around, becomes some 20 % stiffer, which does not
harm a preconditioner."""

MOST_FACTORISED = {2: 300_000, 3: 5_000}
"""Greatest number of points, by dimension, for which a Laplacian is factorised; multigrid replaces larger factors, which fill in. Chosen:
entries grow as n log n in the plane, and as n^(4/3) in three dimensions."""

RAISED = 4 / 3
"""Stiffness of the springs of the Laplacian with which it approximates the tangent of a nearly incompressible body, in units of
mu w V_i V_j/kappa.

Springs of stiffness k in a full horizon have the energy k mu/4 |grad u|^2; without the pressures rubber at rest has mu/2 |grad u|^2,
which is k = 2. Of 1, 1.25, 1.5 and 2 (bonded blocks of 12 to 20 points a side, K = 100 mu and 1000 mu) the middle two once needed a fifth
to a quarter fewer evaluations than 1, and 2 no fewer. Now 2 needs the fewest: with 1, 4/3 and 2 the scene `bonded-block`, 8 points a side,
needs 31, 30 and 28 (K = 100 mu), and 79, 57 and 37 (K = 1000 mu).
"""


SOLVED, EXACTLY = 0.05, 1e-6
"""Residual over the given forces at which inner conjugate gradients end: in general, and where they replace a factorisation. Chosen: a
preconditioner may be off by a twentieth, and each further digit costs inner steps; first guesses, which the second serves, follow held
parts.

Restricted Schwarz alone, which exchanges less, was tried for few parts: a ring under pressure then needs 173 evaluations on two
ranks and 273 on three, while one rank needs 76, and two with conjugate gradients 78."""

MOST_STEPS_IN_PARTS = 200
"""Maximum number of conjugate-gradient steps for a body divided among ranks: it ends a solution that rounding keeps from its residual."""

LEFT_BY_CHEBYSHEV = 0.2
"""Fraction of any component of an error that Chebyshev's method may leave. A multigrid cycle, which replaces a factorisation of large
bodies on one rank, leaves as much."""

LANCZOS_STEPS = 20
"""Number of Lanczos steps that determine the ends of a spectrum accurately enough for Chebyshev's method. Chosen: the preconditioned
spectrum is short; what is missing at its upper end `MARGIN` covers."""

MARGIN = 1.1
"""Safety factor on the greatest Ritz value, since Chebyshev's method magnifies components beyond the end of its interval. Chosen: Ritz
values are less than the eigenvalues; a greater factor costs steps in proportion to its root."""


RESOLVED = 1000
"""Greatest bond strain, over the strain that rounding of positions causes, at which a body counts as not deformed: smaller strains would
have errors above 0.1 %."""


class Preconditioner:
    """Preconditioner of a solver for equilibrium: an approximation of the tangent stiffness whose inverse is cheap to apply.

    Parameters
    ----------
    solve : callable
        Returns the displacements (n, d) under given forces (n, d).
    update : callable, optional
        Adapts the preconditioner to the state in which the force was last evaluated; by default it does nothing.
    """

    def __init__(self, solve: Operator, update: Callable[[], None] = lambda: None) -> None:
        self.solve, self.update = solve, update


class NearestBonds:
    """Network of springs along the nearest bonds of a body and across them, scaled to the second moment of the stiffness of all bonds.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
        Shear modulus: one for all points, or one for each.
    along, across : float
        Stiffness of a spring along its bond and across it, in units of mu w V_i V_j/kappa, before scaling.

    Attributes
    ----------
    first, second : ndarray of int, shape (k,)
        Ends of the bonds; `second` may be a ghost.
    body
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, along: float, across: float) -> None:
        bonds, points, share = body.bonds, body.all_points, body.share
        vector = points[bonds.second] - points[bonds.first]
        length = np.linalg.norm(vector, axis=1)
        volumes = body.all_volumes[bonds.first] * body.all_volumes[bonds.second]
        if isinstance(shear_moduli, np.ndarray):
            ends = np.concatenate([shear_moduli, shear_moduli[body.ghosts.source]])
            # Two springs in series, computed with inverses, since the product of two moduli may overflow.
            shear_moduli = 2 / (1 / ends[bonds.first] + 1 / ends[bonds.second])
        stiffness = shear_moduli * body.weigh(length) * volumes / body.kappa
        near = length <= REACH * body.spacing
        if not share.any(near.any()):
            near[:] = True
        moment = stiffness * length**2
        of_all = moment * share.own[bonds.first]
        stiffness = stiffness[near] * share.total(of_all.sum()) / share.total(of_all[near].sum())
        self._across, self._excess, self._along = across * stiffness, (along - across) * stiffness, vector[near] / length[near, None]
        self.first, self.second = bonds.first[near].astype(np.int64), bonds.second[near].astype(np.int64)
        # The point at the second end of every bond, or the point of which that end is an image.
        self.body, self._sources = body, np.concatenate([np.arange(len(body)), body.ghosts.source.astype(np.int64)])[self.second]

    def forces(self, moved: np.ndarray, of_images: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the forces (n, d) of the springs on the points under displacements (n, d), the halo of which is filled in place.

        The displacements of images follow from those of their points, plus `of_images`, shape (m, d).
        """
        ghosts = self.body.ghosts
        self.body.share.fill(moved)
        moved = np.vstack([moved, moved[ghosts.source] * ghosts.parity + of_images])
        changes = moved[self.second] - moved[self.first]
        forces = self._across[:, None] * changes
        if self._excess.any():
            forces += (self._excess * np.einsum("bi,bi->b", self._along, changes))[:, None] * self._along
        return sums_at_points(len(self.body), self.first, self.second, forces, -1)

    def matrix(self, rigid: np.ndarray | None = None) -> sparse.csc_array:
        """Return the stiffness matrix of all components, held or free, shape (d n, d n), with the components of a point in sequence.

        Springs between two points that are True in `rigid`, shape (n,), are omitted.
        """
        d = self.body.dimension
        blocks = np.einsum("b,bi,bj->bij", self._excess, self._along, self._along) + self._across[:, None, None] * np.eye(d)
        if rigid is not None:
            blocks *= ~(rigid[self.first] & rigid[self._sources])[:, None, None]
        rows, columns, values = self._entries(blocks, self._parity()[:, None])
        rows, columns = d * rows[:, None, None] + np.arange(d)[:, None], d * columns[:, None, None] + np.arange(d)
        places = [np.broadcast_to(numbers, values.shape).ravel() for numbers in (rows, columns)]
        matrix = sparse.coo_array((values.ravel(), places), shape=(d * len(self.body),) * 2).tocsc()
        return (matrix + matrix.T) / 2

    def matrices(self) -> list[tuple[list[int], sparse.csr_array]]:
        """Return pairs of component numbers and their common stiffness matrix (n, n), for springs as stiff across as along bonds.

        Components do not couple then; those that ghosts continue with equal signs have a matrix in common.
        """
        found, shape = [], (len(self.body),) * 2
        for components in alike(self.body.ghosts.parity, range(self.body.dimension)):
            rows, columns, values = self._entries(self._across, self._parity()[:, components[0]])
            matrix = sparse.csr_array((values, (rows, columns)), shape=shape)
            found.append((components, (matrix + matrix.T) / 2))
        return found

    def _parity(self) -> np.ndarray:
        """Return the sign with which displacements of the second end of each bond follow its source point, shape (k, d); 1 if no image."""
        return np.concatenate([np.ones_like(self.body.points), self.body.ghosts.parity])[self.second]

    def _entries(self, values: np.ndarray, parity: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rows, columns and values of the stiffness matrix of springs with stiffnesses `values` (k, ...), without rows of ghosts."""
        within = self.second < len(self.body)
        first, second, ends = self.first, self.second[within], self.first[within]
        rows, columns = np.concatenate([first, first, second, second]), np.concatenate([first, self._sources, second, ends])
        return rows, columns, np.concatenate([values, -values * parity, values[within], -values[within]])


def springs_of(body: Body, shear_moduli: float | np.ndarray) -> NearestBonds:
    """Return the network of springs of a body, along bonds and across them, that approximates its small-strain stiffness."""
    return NearestBonds(body, shear_moduli, ELONGATION, SHEAR_SHARE * ELONGATION)


def laplacian_of(body: Body, shear_moduli: float | np.ndarray) -> NearestBonds:
    """Return the network of springs whose stiffness is a Laplacian for each component, times the shear modulus and `RAISED`.

    Apart from the contribution of the pressures the tangent of an incompressible neo-Hookean body is such a Laplacian in every state. Over
    a full horizon the sum of w V l^2 is d kappa.
    """
    return NearestBonds(body, shear_moduli, RAISED, RAISED)


def alike(values: np.ndarray, components: Iterable[int]) -> list[list[int]]:
    """Group given columns of an array (n, d): return lists of the numbers of columns that are equal."""
    groups: dict[bytes, list[int]] = {}
    for component in components:
        groups.setdefault(values[:, component].tobytes(), []).append(component)
    return list(groups.values())


def held_matrix(matrix: sparse.sparray, free: np.ndarray) -> sparse.sparray:
    """Return a stiffness matrix with held components, where `free` is 0, decoupled, and with `SHIFT` added to the diagonal."""
    keep, mean = sparse.diags_array(free), matrix.diagonal().mean()
    return keep @ matrix @ keep + sparse.diags_array(SHIFT * mean * free + mean * (1 - free))


def by_components(operators: list[tuple[list[int], Operator]], values: np.ndarray) -> np.ndarray:
    """Return the result (n, d) of applying operators to the columns of values (n, d); each operator comes with its column numbers."""
    found = np.empty_like(values)
    for components, operator in operators:
        found[:, components] = operator(values[:, components])
    return found


def drift_remover(body: Body, free: np.ndarray) -> Operator:
    """Return a function that subtracts from values (n, d), in place, their means along the axes in which a body is not held.

    No equilibrium exists under a uniform force along such an axis, so that the mean is removed, rather than divided by `SHIFT`.
    """
    share = body.share
    drifting = ~share.any((body.ghosts.parity < 0).any(axis=0) | (free == 0).any(axis=0))

    def balanced(values: np.ndarray) -> np.ndarray:
        for axis in np.flatnonzero(drifting):
            values[:, axis] -= share.sum(values[:, axis]) / share.size
        return values

    return balanced


def _factorised_springs(body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> Operator:
    """Return a function that solves for the displacements (n, d) of the network `springs_of` under forces, by factorisation in one process.

    The low modes of the network agree with those of the true tangent up to a ratio that does not grow with the number of points. The
    factorisation takes seconds for 10^5 points.
    """
    balanced, column = drift_remover(body, free), free.ravel()
    factor = factor_of(held_matrix(springs_of(body, shear_moduli).matrix(), column))
    return lambda forces: balanced(factor.solve(forces.ravel() * column).reshape(forces.shape))


def _inverted_laplacian(body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> Operator:
    """Return the inverse of `laplacian_of` for a body in one process, by factorisation or, for a large body, by a multigrid cycle."""
    balanced, inverses = drift_remover(body, free), []
    for components, matrix in laplacian_of(body, shear_moduli).matrices():
        for own in alike(free, components):
            column = free[:, own[0]]
            system = held_matrix(matrix, column)
            if len(body) > MOST_FACTORISED[body.dimension]:
                inverses.append((own, Multigrid(system.tocsr(), body.points, body.spacing, column > 0, len(own)).cycle))
            else:
                inverses.append((own, factor_of(system).solve))
    return lambda forces: balanced(by_components(inverses, forces * free)) * free


class TwoLevels:
    """Two-level Schwarz preconditioner for a body divided among ranks: overlapping parts, and affine motions of each part.

    The part of a rank inverts the stiffness of its own points and of those halo points that have all their nearest bonds on this rank;
    other points are held. The solutions of all parts are added, and with them the best combination of motions affine in every part.

    Parameters
    ----------
    bonds : NearestBonds
        Springs of this rank's part.
    multiply : callable
        Product of the stiffness and displacements (n, d); with valid displacements on all local points it is valid on the owned points.
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held and on the halo.

    Attributes
    ----------
    inside : ndarray, shape (n, d)
        1 for the components whose stiffness this part inverts.
    invert : callable
        Inverse of the stiffness of these components, set by the caller.

    References
    ----------
    Toselli and Widlund, Domain Decomposition Methods (2005), ch. 3.
    """

    invert: Operator

    def __init__(self, bonds: NearestBonds, multiply: Operator, free: np.ndarray) -> None:
        body, share = bonds.body, bonds.body.share
        self._share, self._multiply, self._free, self._body = share, multiply, free, body
        self._around = free.copy()
        share.fill(self._around)
        degrees = sums_at_points(len(body), bonds.first, bonds.second, np.ones(len(bonds.first)), 1)
        of_owners = degrees.copy()
        share.fill(of_owners)
        self.inside = self._around * (degrees == of_owners)[:, None]
        self._without_drift = drift_remover(body, self._around)

    def balanced(self, values: np.ndarray) -> np.ndarray:
        """Subtract in place the mean of values (n, d) along axes in which the body is not held, zero the halo, and return the values.

        For a body that can drift only balanced forces have a solution; with other forces conjugate gradients would not end.
        """
        self._share.clear(self._without_drift(values))
        return values

    def applied(self, displacements: np.ndarray) -> np.ndarray:
        """Fill the halo of displacements (n, d) in place, and return the product of the stiffness with them on free components."""
        self._share.fill(displacements)
        return self._multiply(displacements) * self._free

    def both(self, forces: np.ndarray) -> np.ndarray:
        """Apply the preconditioner: return the sum of the displacements of both levels under forces (n, d) that are zero on the halo."""
        around = forces.copy()
        self._share.fill(around)
        found = self.invert(around * self.inside) * self.inside
        self._share.fold(found)
        modes, inverse = self._affine
        pulls = np.concatenate(self._share.everywhere(modes.T @ forces.ravel()))
        k = modes.shape[1]
        found += (modes @ (inverse @ pulls)[k * self._share.ranks.rank : k * (self._share.ranks.rank + 1)]).reshape(forces.shape)
        return found * self._free

    @cached_property
    def _affine(self) -> tuple[np.ndarray, np.ndarray]:
        """Affine motions of this part's own free components, shape (d n, k), and the inverse of the stiffness of all parts' motions."""
        points, share, (n, d) = self._body.points, self._share, self._free.shape
        middle = np.stack(share.everywhere(points[share.own].mean(axis=0)))[share.owners]
        # All ranks use the same unit, since each forms the motions of its neighbours as well.
        functions = np.column_stack([np.ones(n), (points - middle) / self._body.extent])
        motions = np.zeros((d, d + 1, n, d))
        for axis in range(d):
            motions[axis, :, :, axis] = functions.T * self._around[:, axis]
        motions = motions.reshape(-1, n, d)
        k, count = len(motions), share.ranks.size
        own = (motions * share.own[:, None]).reshape(k, -1).T.copy()
        rows = np.zeros((k, k * count))
        for rank in np.unique(share.owners):
            theirs = (share.owners == rank)[:, None]
            for number, motion in enumerate(motions):
                rows[:, k * rank + number] = own.T @ self._multiply(motion * theirs).ravel()
        stiffness = np.concatenate(share.everywhere(rows))
        return own, np.linalg.pinv((stiffness + stiffness.T) / 2, rcond=1e-10, hermitian=True)

    def iterated(self, forces: np.ndarray, left: float) -> np.ndarray:
        """Return the displacements under forces (n, d) by preconditioned conjugate gradients, to a residual of `left` times the forces."""
        rest = self.balanced(forces * self._free)
        return self.balanced(conjugate_gradients(rest, self.both, self.applied, self._share.dot, left, MOST_STEPS_IN_PARTS))

    def spectrum(self) -> tuple[float, float]:
        """Return the least and greatest Ritz value of the preconditioned stiffness, by conjugate gradients on random forces."""
        rest = self.balanced(random_vector(self._share, self._free))
        steps = conjugate_gradient_steps(rest, self.both, self.applied, self._share.dot, EXACTLY, LANCZOS_STEPS)
        shares, sizes = np.array([(1 / length, size) for length, _, size in steps]).T
        growths, diagonal = sizes[1:] / sizes[:-1], shares.copy()
        diagonal[1:] += growths * shares[:-1]
        values = eigh_tridiagonal(diagonal, np.sqrt(growths) * shares[:-1], eigvals_only=True)
        return float(values[0]), float(values[-1])


def _springs_in_parts(body: Body, shear_moduli: float | np.ndarray, free: np.ndarray, left: float) -> Operator:
    """Return the inverse of `springs_of` for a body divided among ranks, by conjugate gradients to a residual `left` over the forces."""
    springs = springs_of(body, shear_moduli)
    matrix = springs.matrix()
    levels = TwoLevels(springs, lambda moved: (matrix @ moved.ravel()).reshape(moved.shape), free)
    factor = factor_of(held_matrix(matrix, levels.inside.ravel()))
    levels.invert = lambda forces: factor.solve(forces.ravel()).reshape(forces.shape)
    return lambda forces: levels.iterated(forces, left)


def _laplacian_in_parts(body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> Operator:
    """Return an approximate inverse of `laplacian_of` for a body divided among ranks, by a fixed number of steps of Chebyshev's method.

    Unlike conjugate gradients these steps are one symmetric positive definite operator for all forces, and need no sums over all ranks.

    References
    ----------
    Saad, Iterative Methods for Sparse Linear Systems (2003), algorithm 12.1.
    """
    laplacian = laplacian_of(body, shear_moduli)
    products = [(components, matrix.__matmul__) for components, matrix in laplacian.matrices()]
    levels = TwoLevels(laplacian, lambda moved: by_components(products, moved), free)
    levels.invert = _inverted_laplacian(body, shear_moduli, levels.inside)
    least, greatest = levels.spectrum()
    middle, half = (MARGIN * greatest + least) / 2, (MARGIN * greatest - least) / 2
    # So many steps reduce errors between the ends of the spectrum to `LEFT_BY_CHEBYSHEV`.
    steps = int(np.ceil(np.arccosh(1 / LEFT_BY_CHEBYSHEV) / np.arccosh(middle / half)))

    def solve(forces: np.ndarray) -> np.ndarray:
        rest = levels.balanced(forces * free)
        step = levels.both(rest) / middle
        found, ratio = step.copy(), half / middle
        for _ in range(steps - 1):
            rest -= levels.applied(step)
            following = 1 / (2 * middle / half - ratio)
            step = following * ratio * step + 2 * following / half * levels.both(rest)
            found += step
            ratio = following
        return levels.balanced(found)

    return solve


def inverse_of_springs(body: Body, shear_moduli: float | np.ndarray, free: np.ndarray, left: float = SOLVED) -> Preconditioner:
    """Return the preconditioner that inverts the stiffness of the network `springs_of` a body; on several ranks, for owned points.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
        Shear modulus: one for all points, or one for each.
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held and on the halo.
    left : float
        Residual over the forces, for a body divided among ranks; in one process the inverse is exact.
    """
    system = body, shear_moduli, free
    return Preconditioner(_springs_in_parts(*system, left) if body.share.divided else _factorised_springs(*system))


def inverse_of_laplacian(body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> Preconditioner:
    """Return the preconditioner that inverts `laplacian_of` a body, approximately if it is large or divided among ranks.

    The arguments are those of `inverse_of_springs`.
    """
    return Preconditioner((_laplacian_in_parts if body.share.divided else _inverted_laplacian)(body, shear_moduli, free))


def random_vector(share: Share, free: np.ndarray) -> np.ndarray:
    """Return random, normally distributed numbers in the free components, shape (n, d), which do not depend on the number of ranks."""
    whole = np.random.default_rng(0).standard_normal((share.size, free.shape[1]))
    return whole[share.numbers] * free


def greatest_bond_strain(body: Body, before: np.ndarray, after: np.ndarray) -> float:
    """Return the greatest change of length of a local bond between positions `before` and `after`, over the bond's length at rest."""
    bonds, n = body.bonds, len(body)
    within = bonds.second < n
    first, second = bonds.first[within], bonds.second[within]

    def lengths(positions: np.ndarray) -> np.ndarray:
        return np.linalg.norm(positions[second] - positions[first], axis=1)

    return float((np.abs(lengths(after) - lengths(before)) / lengths(body.points)).max())


def strain_of_step(body: Body, step: np.ndarray) -> float:
    """Return the greatest strain of a bond under displacements (n, d), the halo of which is filled in place."""
    body.share.fill(step)
    return body.share.greatest(greatest_strain[step.shape[1]](step, body.points, body.bonds.first, body.bonds.second))


def strain_rounding(body: Body) -> float:
    """Return the strain that rounding of the positions in double precision causes in a bond as long as the spacing."""
    return float(np.finfo(float).eps) * body.share.greatest(np.abs(body.points)) / body.spacing


def is_rigid(force: InternalForce) -> bool:
    """Return whether the body has moved without deformation, up to rounding, in the state last evaluated."""
    return strain_of(force) <= RESOLVED * strain_rounding(force.body)


def strain_of(force: InternalForce) -> float:
    """Return the greatest strain of a bond of the body in the state last evaluated: change of length over length at rest."""
    n = len(force.body)
    return force.body.share.greatest(greatest_bond_strain(force.body, force.body.points, force.positions[:n]))
