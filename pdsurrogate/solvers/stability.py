"""Highest frequency of a discretized body, which limits explicit time steps, its lowest mode,
and checks of stability and continuity.
"""

from collections.abc import Callable

import numpy as np
import scipy

from ..forces import InternalForce
from ..ranks import Share
from .bond_strains import strain_of_step
from .conditions import Loading
from .equilibrium import EquilibriumSolver, NotConverged, Unstable
from .nearest_bonds import Preconditioner, random_vector
from .tangent import tangent_product

PROBES = {"float64": 1e-6, "float32": 1e-3}
"""Bond strain of the difference quotients that approximate the tangent, by the precision of the
force; in the forward differences of `FrequencyEstimate` the greatest displacement, in spacings.

In double precision the quotients are one-sided, with a relative error of about the strain times
K/mu; central ones have errors of 1e-8 in columns 20 and 40 times as long as thick. In single
precision rounding requires a greater strain, and those of `least_curvature` are central: their
error is the square of the strain, and that of rounding a ten-thousandth. With 1e-6 frequencies at
single points, of a body in one state, were up to twice the highest one.
"""


class FrequencyEstimate:
    """Estimate of the highest frequency of a body by power iteration on M^-1 K, with masses M and
    tangent stiffness K.

    Products K v are differences of forces. The vector of the iteration is stored, so that a later
    call needs few iterations.

    Away from the stiffest place the vector of a power iteration vanishes, and if another place
    becomes stiffer, as where bonds break, it takes many iterations to grow there. An iteration
    `everywhere` replaces the lengths of the points' vectors by their powers 3/4, and takes the
    greatest quotient of a length and the length that it had before for the eigenvalue, theory
    (38a, 38b).

    Parameters
    ----------
    mass : ndarray, shape (n,)
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.
    share : Share, optional
    everywhere : bool

    Attributes
    ----------
    vector : ndarray, shape (n, d)
        Latest estimate of the mode of highest frequency, or of such modes everywhere.
    fresh : bool
        True until the first call.
    """

    def __init__(
        self,
        mass: np.ndarray,
        free: np.ndarray,
        share: Share | None = None,
        everywhere: bool = False,
    ) -> None:
        self._mass = mass[:, None]
        self._everywhere = everywhere
        self._free = free
        self._share = share or Share.whole(len(free))
        self.vector = random_vector(self._share, free)
        self.fresh = True

    def __call__(self, force: InternalForce, positions: np.ndarray) -> float:
        """Return the greatest eigenvalue of M^-1 K at the given positions, the square of the
        highest frequency.
        """
        if not self._share.any(self.vector.any()):
            return 0.0
        at_rest = np.empty_like(positions)
        value = 0.0
        force(positions, at_rest)
        # From a random vector; later from that of the last estimate, which has changed little.
        for _ in range(25 if self.fresh else 6):
            value = self._iterate(_forward(force), at_rest, self._moved(force, positions))
        self.fresh = False
        return value

    def follow(self, force: InternalForce, positions: np.ndarray, out: np.ndarray) -> float:
        """Write the forces at the given positions to `out`, and return the eigenvalue after one
        more iteration, which costs an evaluation.

        The force is left at these positions. Repeated while the tangent changes, single iterations
        follow its stiffest mode.
        """
        moved = self._moved(force, positions)
        force(positions, out)
        return self._iterate(_forward(force), out, moved)

    def _moved(self, force: InternalForce, positions: np.ndarray) -> np.ndarray:
        """Return the forces after a small displacement by the vector, which is scaled to a
        greatest component of 1.
        """
        if self._everywhere:
            # roots alone have the same bits in vectors of any length
            excess = np.sqrt(np.sqrt(np.sqrt(self._squares(self.vector))))[:, None]
            np.divide(self.vector, excess, out=self.vector, where=excess > 0)
        self.vector /= self._share.greatest(np.abs(self.vector))
        moved = np.empty_like(positions)
        force(positions + _forward(force) * self.vector, moved)
        return moved

    def _iterate(self, forward: float, at_rest: np.ndarray, moved: np.ndarray) -> float:
        """Replace the vector by its image, given the forces without and with the displacement of
        `_moved`, and return the eigenvalue.
        """
        image = (at_rest - moved) / forward / self._mass * self._free
        if self._everywhere:
            before = self._squares(self.vector)
            squares = np.divide(
                self._squares(image), before, out=np.zeros_like(before), where=before > 0
            )
            value = np.sqrt(self._share.greatest(squares))
        else:
            # The norm bounds the Rayleigh quotient from above for a tangent that is not quite
            # symmetric.
            value = np.sqrt(
                self._share.sum(image**2, in_order=True)
                / self._share.sum(self.vector**2, in_order=True)
            )
        self.vector = image
        return float(value)

    def _squares(self, vector: np.ndarray) -> np.ndarray:
        """Return the squared lengths of the vectors of the points, weighed by the masses, (n,)."""
        return self._mass[:, 0] * sum(column * column for column in vector.T)


def _forward(force: InternalForce) -> float:
    """Return the greatest displacement of a point in forward differences of a force."""
    return PROBES[force.precision] * force.body.spacing


MOST_PRODUCTS = 25
"""Maximum number of Lanczos steps. Preconditioned, a stable body has eigenvalues from some
tenths to a few; ten steps find lower ones.
"""

KNOWN = 1 / 3
"""Relative error bound at which a positive least Ritz value (Lanczos' estimate of the least
eigenvalue) is accepted. Its sign is then certain; the value itself is not used, and a sharper bound
costs products, each a force evaluation.
"""

LEAST_PRODUCTS = 3
"""Least number of Lanczos steps. The softest modes of the preconditioner make up most of the first
vector. In one of ten cases the second mode of a column happened to outweigh the first in it, and a
single step, which knew the value of the second, missed the lower one.
"""

NEGATIVE = {"float64": -1e-4, "float32": -0.01}
"""Curvature of the energy, divided by that of the preconditioner, below which an equilibrium counts
as not stable, by the precision of the force. Chosen below zero by more than the errors of central
differences, in single precision a ten-thousandth times K/mu of 100: bodies that can drift have a
curvature of zero.
"""


JUMP = 0.25
"""Distance of an equilibrium from its extrapolation, above which a body has jumped to another
branch of equilibria: root mean square component of the differences of positions, divided by the
change of the body's length from the previous equilibrium to this one.

Contraction across the load and stresses at holes and cracks cause some hundredths; buckling of a
sheet several tenths to ten, and more with shorter increments.
"""

LEAST_JUMP = 0.1
"""Least distance from the extrapolation, in spacings, that counts as a jump; a finer tolerance of
the solver changes positions by less. Chosen: a tenth of a spacing cannot be seen, and buckling
moves points by many.
"""


def least_curvature(
    force: InternalForce, positions: np.ndarray, free: np.ndarray, stiffness: Preconditioner
) -> float:
    """Return an upper bound of the least curvature of the energy, divided by that of the
    preconditioner along the same displacement.

    The latter is about the curvature of the undeformed body. A negative value proves that the state
    is not stable. Lanczos' method is applied to P^-1 K, with products of the tangent K from force
    differences and the approximation P of K. Its Ritz values are quotients x K x / x P x, also with
    a P^-1 that is not quite linear and symmetric. The method ends when the least one is below
    `NEGATIVE`, which a central difference along x confirms, or positive and known to within
    `KNOWN`.

    Parameters
    ----------
    force : InternalForce
        Force that has an energy.
    positions : ndarray, shape (n, d)
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.
    stiffness : Preconditioner
        Approximation P of the tangent.
    """
    share = force.body.share
    precision = force.precision
    here = np.empty_like(positions)
    there = np.empty_like(positions)
    if precision == "float64":
        force(positions, here)

    def product(q: np.ndarray, one_sided: bool) -> np.ndarray:
        probe = PROBES[precision] / max(strain_of_step(force.body, q), 1e-300)
        if not one_sided:
            return tangent_product(force, positions, q, probe) * free
        force(positions + probe * q, there)
        return (here - there) / probe * free

    # K-conjugate bases: displacements q and the forces p = P q, with q_i . p_j = 1 if i = j, else
    # 0.
    displacements = []
    duals = []
    diagonal = []
    off_diagonal = []
    p = random_vector(share, free)
    # The least Ritz value, and the last component of its vector: with the next off-diagonal entry
    # that bounds the value's error.
    least = np.inf
    last = 1.0
    for _ in range(MOST_PRODUCTS):
        q = stiffness.solve(p) * free
        # Where P^-1 is an iteration, q contains earlier ones: the values below would not be those
        # of K, and negative in stable bodies.
        for displacement, dual in zip(displacements, duals, strict=True):
            q -= share.dot(dual, q) * displacement
        norm = np.sqrt(max(share.dot(p, q), 0.0))
        if diagonal:
            known = len(diagonal) >= LEAST_PRODUCTS and norm * abs(last) <= KNOWN * least
            if known or not norm > 1e-10 * max(map(abs, diagonal)):
                break
            off_diagonal.append(norm)
        elif norm == 0:
            break
        p = p / norm
        q = q / norm
        displacements.append(q)
        duals.append(p)
        p = product(q, precision == "float64")
        diagonal.append(share.dot(q, p))
        values, vectors = scipy.linalg.eigh_tridiagonal(
            diagonal, off_diagonal, select="i", select_range=(0, 0)
        )
        least = float(values[0])
        last = float(vectors[-1, 0])
        if least < NEGATIVE[precision]:
            lowest = np.tensordot(vectors[:, 0], displacements, 1)
            least = share.dot(lowest, product(lowest, False))
            if least < NEGATIVE[precision]:
                break
        for displacement, dual in zip(displacements, duals, strict=True):
            p -= share.dot(displacement, p) * dual
    return least


BLOCK = 3
"""Number of modes that are computed together: equal or nearly equal lowest ones, as of symmetric
bodies, then converge as well.
"""

MOST_STEPS = 300
"""Most steps of the iteration for the lowest modes."""

NEW = 1e-8
"""Part of a unit vector outside the space of others, below which it adds nothing to this space
but rounding.
"""

SEPARATED = 1e-2
"""Permitted residual of the lowest mode, divided by its distance to the next or its own size:
its error is the square of this part.
"""

ACCURATE = 1e-7
"""Permitted error of the eigenvalue, divided by the greatest one of the block. Slender bodies
fulfil it, but not `SEPARATED`: forces of some 1e-9 of those of short waves are a residual greater
than their lowest eigenvalue, and hardly change it.
"""

TURNED = 1e-6
"""Strain of a bond in the central differences of forces that are products of the tangent. Chosen: a
solid cantilever 40 times as long as thick has the same eigenvalue within 1e-6 with 1e-7, and with
1e-5 one greater by 5e-5, by its rotation.
"""


def lowest_mode(
    force: InternalForce, positions: np.ndarray, free: np.ndarray, stiffness: Preconditioner
) -> tuple[float, float, np.ndarray]:
    """Return the least eigenvalue of the tangent K over the volumes V, K q = e V q, its estimated
    error, and its mode q, (n, d).

    The locally optimal block method of conjugate gradients (Knyazev 2001), which needs products of
    K and a preconditioner alone, on orthonormal bases (Hetmaniuk and Lehoucq 2006).

    Parameters
    ----------
    force : InternalForce or LoadedForce
        Force in double precision that has an energy.
    positions : ndarray, shape (n, d)
        Equilibrium.
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.
    stiffness : Preconditioner
        Approximation of the tangent.

    Raises
    ------
    NotConverged
        If the mode is not found.
    """
    force(positions, np.empty_like(positions))
    stiffness.update()
    moving = free.ravel() > 0
    root = np.sqrt(np.broadcast_to(force.body.volumes[:, None], free.shape)).ravel()[moving]

    def product(scaled: np.ndarray) -> np.ndarray:
        """Return the product of V^-1/2 K V^-1/2 with one vector of the free components."""
        moved = np.zeros(free.size)
        moved[moving] = scaled.ravel() / root
        moved = moved.reshape(free.shape)
        # Bonds of slender bodies turn rather than stretch: in steps of a given displacement,
        # rounding would be greater than the forces.
        step = TURNED / max(strain_of_step(force.body, moved), 1e-300)
        return tangent_product(force, positions, moved, step).ravel()[moving] / root

    def preconditioned(scaled: np.ndarray) -> np.ndarray:
        forces = np.zeros(free.size)
        forces[moving] = scaled.ravel() * root
        return stiffness.solve(forces.reshape(free.shape)).ravel()[moving] * root

    # The preconditioner leaves out rigid motions that no support resists.
    vectors = _each(
        preconditioned, np.random.default_rng(0).standard_normal((len(root), min(BLOCK, len(root))))
    )
    vectors, _ = np.linalg.qr(vectors)
    images = _each(product, vectors)
    before = vectors[:, :0]
    images_before = vectors[:, :0]
    error = np.inf
    found = False
    for _ in range(MOST_STEPS):
        values, turned = np.linalg.eigh(vectors.T @ images)
        vectors = vectors @ turned
        images = images @ turned
        # the error is that of the step before, of which an estimate that is a little too small
        # remains a bound
        if found:
            mode = np.zeros(free.size)
            mode[moving] = vectors[:, 0] / root
            mode = mode.reshape(free.shape)
            return float(values[0]), error, mode / np.linalg.norm(mode, axis=1).max()
        residuals = images - values * vectors
        towards = _each(preconditioned, residuals)
        left = float(np.linalg.norm(residuals[:, 0]))
        apart = float(values[1] - values[0]) if len(values) > 1 else 0.0
        # Of the two bounds (Parlett 1980), the second holds for a mode apart from the others.
        error = min(left, left**2 / apart) if apart > 0 else left
        last = float(values[-1])
        if last > max(values[0], 0.0):
            # The tangent is at least so many times the approximation in modes that the block does
            # not contain.
            share = last * float(vectors[:, -1] @ preconditioned(vectors[:, -1]))
            error = min(
                error,
                float(residuals[:, 0] @ towards[:, 0] / (min(share, 1.0) * (1 - values[0] / last))),
            )
        found = left <= SEPARATED * max(apart, abs(values[0])) or error <= ACCURATE * max(
            abs(values[0]), abs(last)
        )
        known = np.hstack([vectors, before])
        towards = _beside(towards, known)
        known = np.hstack([known, towards])
        of_known = np.hstack([images, images_before, _each(product, towards)])
        _, combined = np.linalg.eigh(known.T @ of_known)
        count = len(values)
        chosen = combined[:, :count]
        changed = combined[:, :count].copy()
        changed[:count] = 0.0
        changed = _beside(changed, chosen)
        vectors = known @ chosen
        images = of_known @ chosen
        before = known @ changed
        images_before = of_known @ changed
    raise NotConverged(
        f"the lowest mode is not found after {MOST_STEPS} steps: the body may be too slender, or"
        " its modes too close"
    )


def _each(function: Callable[[np.ndarray], np.ndarray], columns: np.ndarray) -> np.ndarray:
    """Return the values of a function of vectors (n,) for the columns (n, k)."""
    return np.stack([function(column) for column in columns.T], axis=1) if columns.size else columns


def _beside(columns: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return orthonormal vectors (n, m), m <= k, that span with orthonormal `others` (n, l) what
    the columns (n, k) span with them.
    """
    sizes = np.linalg.norm(columns, axis=0)
    columns = columns[:, sizes > 0] / sizes[sizes > 0]
    for _ in range(
        2
    ):  # once more, since what rounding left of the others is not small beside a small remainder
        columns = columns - others @ (others.T @ columns)
        columns, upper = np.linalg.qr(columns)
        columns = columns[:, np.abs(np.diag(upper)) > NEW]
    return columns


def check_branch(
    loading: Loading,
    force: InternalForce,
    solver: EquilibriumSolver,
    before: float,
    after: float,
    guess: np.ndarray,
    positions: np.ndarray,
) -> None:
    """Check that the equilibrium in which the force was last evaluated is stable, and continues the
    previous equilibrium.

    Only compressed bodies are checked for stability: under tension the stress itself prevents
    buckling.

    Parameters
    ----------
    loading : Loading
    force : InternalForce
    solver : EquilibriumSolver
        Solver that computed the equilibrium.
    before, after : float
        Loading parameter of the previous equilibrium, and of the one to check.
    guess : ndarray, shape (n, d)
        Extrapolation from the previous equilibrium.
    positions : ndarray, shape (n, d)
        Equilibrium to check.

    Raises
    ------
    InvalidState
        If a point lies beyond a plane of reflection.
    Unstable
        If a body under compression is far from `guess` (checked only where two grips pull, with a
        stretch as loading parameter), or if its energy is not a local minimum.
    """
    loading.check_inside(after, force, positions)
    growth = abs(after - before) * loading.body.extent
    jumped = False
    if loading.course.between_grips and after != before:  # in a hold, rubber moves as it relaxes
        moved = np.sqrt(
            solver.share.sum(np.square(positions - guess)) / solver.share.total(positions.size)
        )
        jumped = moved > max(JUMP * growth, LEAST_JUMP * force.body.spacing)
    if not (jumped or force.has_energy) or not loading.course.pushes(force):
        return
    if jumped:
        raise Unstable(
            f"the body buckles between the stretches {before:.4g} and {after:.4g}: while its length"
            f" changed by {growth:.3g}, its points moved by {moved:.3g} on average from their"
            " extrapolated positions"
        )
    preconditioner = solver.bending_preconditioner(force)
    preconditioner.update()
    arrays = force.state_arrays
    held = {key: array.copy() for key, array in arrays.items()}
    curvature = least_curvature(force, positions, loading.free, preconditioner)
    force(positions, np.empty_like(positions))
    for key, array in arrays.items():
        array[:] = held[key]
    if curvature < NEGATIVE[force.precision]:
        raise Unstable(
            f"the equilibrium at {loading.at(after)} is not stable, so the body buckles: along one"
            f" displacement the energy has {curvature:.2g} times its curvature at rest"
        )
