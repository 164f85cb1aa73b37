"""Base class of the solvers for equilibrium, the result of a solver, and the errors that solvers
raise.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..body import Body
from ..forces import InternalForce
from ..kernels.steps import greatest_force_density
from ..ranks import Share
from .bond_strains import is_rigid, strain_of_step, strain_rounding
from .loaded_force import LoadedForce
from .preconditioner import (
    WIDEST_CHECKED,
    Preconditioner,
    has_struts,
    is_slender,
    preconditioner_of,
)

Report = Callable[[int, float], None]
"""Function that a solver calls with the number of force evaluations so far and the residual."""

UNBALANCED = 5e-4
"""Greatest permitted sum of the magnitudes of the residual forces on free points, divided by the
greater of the sums for the loads and for the reactions. It also bounds the error of every balance
of forces, and of moments divided by the greatest lever arm. Chosen: half of the error of 0.1 % at
which an output counts as not converged (`run.levels.MOST_OFF`).
"""

NEARLY_BALANCED = 0.01
"""Such a sum in intermediate states of slender bodies. Their loads are so small that the coarse
tolerance of these states would let a body stay as it was before an increment, and a check of
stability miss its buckling. Chosen: loads at which columns buckle are then known to about a
percent.
"""

USUAL = 1e-6
"""Default tolerance of solvers and scenes, in units of shear modulus / spacing; a smaller one
reduces `UNBALANCED` in proportion, and `PENETRATION` with its power 2/3.
"""

PENETRATION = 0.01
"""Greatest force that penetration may add to that of contact, relative to this: forces of obstacles
are then off by 0.006 % at most, against 0.8 % with 1 (eight points across a body).
"""

SETTLED = 0.1
"""Residual, divided by the forces that penetration lacks, below which these forces are added: with
0.03 and 0.3 the cases of docs/validation/obstacles.md take as many evaluations within 2 %.
"""

SINGLE = 1e-7
"""Least residual, in units of shear modulus / spacing, that forces in single precision can reach.
In the undeformed body their rounding error is some 1e-8.
"""

SPREAD = 1e3
"""Residual, divided by that of rounding errors, below which their sum is looked at: a residual is
that of one point, and some hundred times the mean of all.
"""

ROUNDED_SINGLE = float(np.finfo(np.float32).eps) / 4
"""Mean rounding error of a number of size 1 in single precision: that of a component of a point's
force, in units of shear modulus times volume / spacing. Searches of `uniaxial` at 7,500 to a
million points end at means of 2e-8 to 4e-8.
"""

SINGLE_ENDS = "the forces that drive the body are too small for single precision"
"""Message of `TooSmall` for forces in single precision."""

ROUNDED = 100
"""Greatest residual that may be due to rounding of the positions, divided by the stress that this
rounding causes in a bond. Below it a search continues only while the residual forces fall by a
third within `EquilibriumSolver.IDLE` evaluations, and then ends as converged. Chosen: the errors of
some thirty bonds of a point add up; with a greater value this check only begins earlier.
"""

MOST_GROWTH = 1e3
"""Residual of a search, divided by the first one or by shear modulus / spacing if that is greater,
beyond which the search diverges: residuals of an unstable iteration grow without bound, and waves
of a stable one exceed the first value by less.
"""

PERIODS = 4
LEAST_WINDOW = 200
"""Force evaluations per spacing in the body's extent, and the least number, in which the residual
of a converging search halves. Chosen: some two periods of the slowest mode in relaxation, which
takes tens of evaluations per spacing in all.
"""


def no_report(evaluations: int, residual: float) -> None:
    """Do nothing: default function of type `Report`, which a solver calls to report its
    progress.
    """


class NoEquilibrium(RuntimeError):
    """Error for an equilibrium that was not found, which a shorter increment may avoid."""


class NotConverged(NoEquilibrium):
    """Error for a residual that did not fall below the tolerance."""


class Unbalanced(NotConverged):
    """Error for loads and reactions that do not add up to zero."""


class Diverging(NoEquilibrium):
    """Error for an iteration of a solver that diverges."""


class TooSmall(RuntimeError):
    """Error for strains, loads and reactions so small that rounding errors of the forces or of
    the positions exceed the tolerance.
    """


class Unstable(NoEquilibrium):
    """Error for an equilibrium that is not stable, or not a continuation of the previous one."""


class TooFar(NoEquilibrium):
    """Error for an increment whose first guess strains the body too much for a solver to
    converge.
    """


class RanAway(NoEquilibrium):
    """Error for a body that its loads displace very far within one increment, as happens beyond
    its limit load.
    """


def window_of(body: Body) -> int:
    """Return the number of force evaluations in which the residual of a converging search halves
    on a body.
    """
    return max(LEAST_WINDOW, int(PERIODS * body.extent / body.spacing))


def check_growth(first: float, residual: float) -> None:
    """Raise Diverging if the residual of a search exceeds `MOST_GROWTH` times its first value
    (or shear modulus / spacing).
    """
    if not residual < MOST_GROWTH * max(first, 1.0):
        raise Diverging(
            f"the residual grew from {first:.2g} to {residual:.2g} shear modulus / spacing"
        )


def falls(course: list[tuple[int, float]], window: float) -> bool:
    """Return whether a search converges: whether its least residual halves from one `window` of
    evaluations to the next.

    `course` lists evaluations and residuals. A search that is shorter than a window counts as
    converging.
    """
    ages = [(course[-1][0] - number, residual) for number, residual in course]
    before = min((residual for age, residual in ages if window <= age < 2 * window), default=np.inf)
    return min((residual for age, residual in ages if age < window), default=0.0) < before / 2


def note_of_modes(force: InternalForce, consequence: str) -> str:
    """Return a note for an error message that the force has zero-energy modes, with their
    consequence; empty if it has none.
    """
    if not force.zero_energy_modes:
        return ""
    others = (
        "force=bond-energy" if force.body.dimension == 3 else "force=analytic or force=bond-energy"
    )
    return f" (this force has zero-energy modes, {consequence}; use {others})"


@dataclass(frozen=True)
class Equilibrium:
    """Result of a solver that has found an equilibrium.

    Attributes
    ----------
    residual : float
        Largest force density over the free components, in units of shear modulus / spacing.
    evaluations : int
        Number of force evaluations.
    method : str
        Name of the method that converged.
    drive : float
        Driving force: sum of the magnitudes of the loads or of the reactions, whichever is greater;
        in two dimensions per unit thickness.
    """

    residual: float
    evaluations: int
    method: str
    drive: float = 0.0


class EquilibriumSolver(ABC):
    """Base class of the solvers for equilibrium.

    The search ends when two conditions hold: the residual is below the tolerance, and the residual
    forces on the free points are small compared with the driving forces (the loads or reactions,
    see `Equilibrium.drive`), or no greater than rounding errors.

    Parameters
    ----------
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.
    volumes : ndarray, shape (n,)
    tolerance : float
        Tolerance of the residual, in units of shear modulus / spacing.
    most_evaluations : int
        Maximum number of force evaluations in a call of `solve`.
    share : Share, optional
        Part of the body that this rank works on; by default the whole body.
    """

    name: str
    needs_energy = False
    """Whether the method needs a force that has an energy."""
    needs_tangent = False
    """Whether the method needs products of the tangent, and so a force in double precision and
    one rank.
    """
    IDLE = 200
    """Number of evaluations after which a search ends if the residual forces, which may be rounding
    errors (see `ROUNDED`), have not fallen by a third. Chosen: on nearly incompressible strips that
    bend, L-BFGS takes up to 75 evaluations for a third at a length of 20 thicknesses, and up to 150
    at 40.
    """
    LARGEST_STRAIN = 0.25
    """Greatest change of a bond's stretch in one step: beyond it the tangent differs too much from
    the next one. A quarter is chosen so that no bond, even one pressed to half its length, turns
    inside out.
    """
    gave_up = False
    """Whether a faster method has failed on this body, so that it is not tried again."""

    def __init__(
        self,
        free: np.ndarray,
        volumes: np.ndarray,
        tolerance: float = USUAL,
        most_evaluations: int = 50_000,
        share: Share | None = None,
    ) -> None:
        self.free = free
        self.volumes = volumes
        self.share = share or Share.whole(len(free))
        self.tolerance = tolerance
        self.most_evaluations = most_evaluations
        # Permitted sum of the forces on free points, relative to the driving forces.
        self._share_left = UNBALANCED * min(1.0, tolerance / USUAL)
        # Places that move alike share their forces only after many steps: not in proportion.
        # With the root derivatives in contact would be off by 1.1e-6.
        self._penetration = PENETRATION * min(1.0, tolerance / USUAL) ** (2 / 3)
        self._held = np.nonzero(free == 0)
        self._drive = 0.0
        self._preconditioner: Preconditioner | None = None
        self._bending: Preconditioner | None = None

    @abstractmethod
    def solve(
        self,
        force: InternalForce,
        positions: np.ndarray,
        tolerance: float | None = None,
        report: Report = no_report,
        least_drive: float = 0.0,
    ) -> Equilibrium:
        """Bring `positions` to equilibrium, in place.

        Parameters
        ----------
        force : InternalForce
        positions : ndarray, shape (n, d)
            Initial positions; the equilibrium on return, or the last state reached if an error is
            raised.
        tolerance : float, optional
            Tolerance in place of the solver's own, for intermediate states. If it is greater, the
            sum of the residual forces is compared with the driving forces in slender bodies alone,
            and then with `NEARLY_BALANCED` of them.
        report : callable
            Called every few evaluations.
        least_drive : float
            Lower bound of the driving forces in the convergence criterion. For a body that returns
            to its undeformed state, where loads and reactions vanish, it is the greatest driving
            force of earlier equilibria.

        Raises
        ------
        NotConverged
            If the search has not ended after `most_evaluations`.
        Diverging, InvalidState
            If the initial state has no force, or the iteration reaches states without one even with
            small steps.
        """

    def preconditioner(self, force: InternalForce) -> Preconditioner:
        """Return the preconditioner, an approximation of the tangent of the force, built on
        first use.
        """
        if self._preconditioner is None:
            self._preconditioner = preconditioner_of(force, self.free)
        return self._preconditioner

    def bending_preconditioner(self, force: InternalForce) -> Preconditioner:
        """Return the preconditioner with which checks find the buckling of slender bodies, built
        on first use.
        """
        if self._bending is None:
            struts = has_struts(force.body, WIDEST_CHECKED[force.body.dimension])
            self._bending = (
                preconditioner_of(force, self.free, bending=True)
                if struts
                else self.preconditioner(force)
            )
        return self._bending

    def _bound(self, force: InternalForce, step: np.ndarray) -> None:
        """Scale a step (n, d), in place, so that it strains no bond by more than
        `LARGEST_STRAIN`.
        """
        step *= min(1.0, self.LARGEST_STRAIN / max(strain_of_step(force.body, step), 1e-300))

    def residual(self, force: InternalForce, forces: np.ndarray) -> float:
        """Return the largest absolute value of a free component of `forces` (n, d) per volume, in
        units of shear modulus / spacing.

        The shear modulus is that of each point, see `InternalForce.force_scale`.
        """
        # With several materials every point has its own scale.
        density = greatest_force_density(forces, self.free, self.volumes * force.force_scale)
        return self.share.greatest(density) * force.body.spacing

    def evaluate(self, force: InternalForce, positions: np.ndarray, out: np.ndarray) -> None:
        """Evaluate the force and write it to `out`, shape (n, d), with 0 in held components,
        whose forces are kept for `judge`.
        """
        force(positions, out)
        self._on_held = out[self._held]
        out[self._held] = 0.0

    def begin(self, force: InternalForce, least_drive: float) -> None:
        """Reset the criteria of convergence for a new search; `least_drive` as in `solve`."""
        stiffness = (
            force.law.bulk_modulus / force.law.shear_modulus if force.nearly_incompressible else 1.0
        )
        self._least_drive = least_drive
        self.least_left = np.inf
        self._idle = 0
        self._floor = 0.0
        self._least_rounded = np.inf
        if force.precision == "float32":
            unit = self.share.sum(self.volumes * force.force_scale) / force.body.spacing
            self._floor = ROUNDED_SINGLE * force.body.dimension * unit
        self._slender = is_slender(force.body)
        self._rounding = ROUNDED * stiffness * strain_rounding(force.body, force.positions)

    def judge(
        self, force: InternalForce, forces: np.ndarray, tolerance: float
    ) -> tuple[float, bool]:
        """Return the residual in the state last evaluated, and whether that state is an
        equilibrium; `forces` are as `evaluate` wrote them.

        Raises
        ------
        TooSmall
            If the residual forces would have to be smaller than single precision resolves.
        """
        residual = self.residual(force, forces)
        if force.obstacles and self._presses(force, forces, residual, tolerance):
            return residual, False
        coarse = tolerance > self.tolerance
        small = residual <= tolerance
        single = force.precision == "float32"
        if (coarse and not self._slender) or not (small or (single and residual < SPREAD * SINGLE)):
            return residual, small
        left = self.share.sum(np.abs(forces))
        stands = 0.9 * self._least_rounded < left < 4 * self._floor
        self._least_rounded = min(self._least_rounded, left)
        if not (small or stands):
            return residual, False
        loading = self.share.sum(np.abs(force.applied()))
        self._drive = max(loading, self._holding(force), self._least_drive)
        most = (NEARLY_BALANCED if coarse else self._share_left) * self._drive
        if small and (left <= most or (coarse and residual <= self._rounding)):
            return residual, True
        if (stands and most < self._floor) or (
            small and single and residual * most < SINGLE * left
        ):
            if small and loading == 0 and is_rigid(force):
                return residual, True
            raise TooSmall(SINGLE_ENDS)
        if not small or residual > self._rounding:
            return residual, False
        self._idle = 0 if left < 2 / 3 * self.least_left else self._idle + 1
        self.least_left = min(self.least_left, left)
        return residual, self._idle >= self.IDLE

    def _presses(
        self, force: LoadedForce, forces: np.ndarray, residual: float, tolerance: float
    ) -> bool:
        """Return whether contact has penetration that counts, beside which the residual is small;
        its forces then become the pushes of the obstacles, and `forces` change in place.
        """
        positions = force.positions[: len(force.body)]
        loads = force.loads
        found = loads.pushed(positions, loads.pushes)
        change = force.of_contact(loads.pushed(positions, found) - found) * self.free
        missing = self.residual(force, change)
        if residual > SETTLED * missing or missing <= tolerance / SETTLED:
            return False
        whole = self.residual(force, force.of_contact(found) * self.free)
        if missing <= self._penetration * whole:
            return False
        loads.pushes[:] = found
        forces += change
        return True

    def _holding(self, force: InternalForce) -> float:
        """Return the sum of the magnitudes of all reactions: of the forces in held components,
        and of bonds across reflection planes.
        """
        body = force.body
        outer = np.flatnonzero(body.bonds.second >= len(body))
        crossing = outer[self.share.own[body.bonds.first[outer]]]
        across = np.abs(force.pair_forces(crossing)).sum() if len(crossing) else 0.0
        return self.share.total(float(np.abs(self._on_held).sum() + across))

    def not_converged(
        self, force: InternalForce, residual: float, evaluations: int, tolerance: float
    ) -> NotConverged | TooSmall:
        """Return the error to raise for a residual, or a sum of residual forces, that is still
        too large; `TooSmall` for a sum in single precision, whose rounding errors add up in large
        bodies.
        """
        if residual <= tolerance and force.precision == "float32":
            return TooSmall(SINGLE_ENDS)
        reached = (
            f"the residual is {residual:.2g} shear modulus / spacing after {evaluations} force"
            f" evaluations; asked for {tolerance:.2g}"
        )
        if residual <= tolerance:
            left = (
                f"the sum of the residual forces on free points is more than {self._share_left:.1g}"
                " of the forces that drive the body"
            )
            reached = f"after {evaluations} force evaluations {left}"
        elif residual <= self._rounding:
            farthest = force.body.share.greatest(np.abs(force.positions))
            reached += (
                f", which positions as far as {farthest:.1g} from the origin do not resolve:"
                " describe the body nearer to it"
            )
        return NotConverged(reached + note_of_modes(force, "in which points never come to rest"))
