"""Explicit dynamics: central differences with damping proportional to mass and to stiffness, and
a stable time step.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..engine.block_arrays import BLOCK
from ..engine.passes import Chain
from ..engine.threads import chunks_of
from ..forces import InternalForce
from ..kernels.steps import (
    central_difference_step,
    energies_of_step,
    follow,
    look_ahead,
    take_step,
)
from .bond_strains import NONE, strain_of_step
from .equilibrium import Diverging
from .loaded_force import LoadedForce
from .loads import Loads
from .stability import FrequencyEstimate

FREQUENCY_MARGIN = 1.03
"""Safety factor on the highest frequency, which the power iteration underestimates by up to 2 %
on sheets of up to 7,500 points. The estimate of bodies that may break is not increased:
it comes from above.
"""

LEAST_SHARE = 0.9
"""Time step over the one before, below which the estimate is confirmed by one further iteration
while no bonds break. Chosen: where phases of short waves change, the quotient of a point is up to
1.8 times the highest frequency for one iteration.
"""

MOST_TRAVEL = 0.5
"""Displacement of a point in one time step, in spacings, up to which any step is allowed. In a
longer one no two bonded points move further towards or from each other, over the length of their
bond, and beside obstacles no point.

Chosen: two points that meet cannot pass each other in one step. Waves move points by less, but
material that unloads behind the last bonds of a crack could otherwise move past the bonds that
should stop it.
"""


class Balance(NamedTuple):
    """Kinetic energies at the present time, from before and from after it, and powers that damping
    and viscosity dissipate with the velocities half a step before and after it.

    The sum of the first energy and the strain energy is conserved, and so is that of the second.
    The first is the kinetic energy half a step before, plus the work over this half step of the
    forces, including those of bonds that break at the present time. The second is the kinetic
    energy half a step after, minus the work over this half step of the forces without those of
    broken bonds. From the second energy of one step to the first of the next the kinetic energy
    changes by the work of the forces by the trapezoidal rule: for linear forces minus the change of
    strain energy. Both energies equal v M v'/2, with mass M and the velocities v and v' half a step
    before and after, except where bonds break or the step h changes: the scheme then dissipates
    their difference. The kinetic energy from the velocity at the present time exceeds both by h^2 f
    M^-1 f/8 for forces f, which is large where bonds have just broken.

    Each power times half a step is what damping takes, by the trapezoidal rule, in the step that
    ends, or begins, at the present time.
    """

    arriving: float
    leaving: float
    taken_before: float
    taken_after: float


class ExplicitDynamics:
    """Integrator of M (a + c v) = f(y + tau v) by central differences, with velocities at half
    steps.

    M is the mass, y the position, v the velocity, a the acceleration and f the internal force; c is
    the damping and tau the viscosity. With tau = 0 the scheme is that of the paper that
    `pdsurrogate.paper` reproduces.

    Forces at positions a retardation time tau ahead are those of a Kelvin-Voigt solid, f + tau
    df/dt, to first order in tau, without further evaluations. They damp waves as short as the
    bonds, such as those of material that unloads behind a crack, on which damping proportional to
    mass has little effect. Loads are evaluated at y with their present size; only a pressure that
    is multiplied by the stretch of a sheet's thickness uses the stretch at y + tau v.

    Parameters
    ----------
    force : InternalForce
    hold : callable
        ``hold(positions, ahead)`` moves all held parts to their positions at a time `ahead` from
        the present.
    positions, velocities : ndarray, shape (n, d)
        Initial values, changed in place.
    free : ndarray, shape (n, d)
        1 where a component may move by itself, 0 where it is held.
    mass : ndarray, shape (n,)
    damping : float
        c, per unit time.
    viscosity : float
        tau, a time.
    safety : float
        Time step divided by the critical one, at most 1.
    loads : Loads, optional
        Loads, which the caller sets to their present size before each step.
    broken : ndarray of bool, shape (n_pairs,), optional
        Flags of the pairs that the caller has broken.

    Attributes
    ----------
    forces : ndarray, shape (n, d)
        Forces that move the body, including loads.
    take, look, follow, find_energies : BoundPass
        Passes of a step: of the motion, of the positions `ahead` by the viscosity, of `elastic`,
        and of `sums`, by the `spans` of the step.
    elastic : ndarray, shape (n, d)
        Estimate f_e of the internal forces at y, without viscous part and without loads, if there
        is viscosity; otherwise 0. It is integrated from the forces f at y + tau v by f_e + tau
        df_e/dt = f, which is exact for linear forces; the error of a nonlinear step decays within
        tau, and `find_elastic` evaluates f_e exactly.
    time_step : float
        Stable time step, which decreases where the body stiffens; it increases again only where
        bonds may break.
    last_step : float
        Length of the last step, shorter where points would have moved too far.
    longest : float
        Greatest length of the next step, set by the caller.
    """

    # Without breaking bonds the tangent changes over the time in which a wave crosses many
    # horizons. In every second row of the history, where steps need Python anyway.
    STEPS_BETWEEN_ESTIMATES = 40
    # Beside bonds that break rubber retracts and loses neighbors: its frequency doubled within six
    # steps; a wave crosses no bond in two.
    STEPS_WHILE_BONDS_BREAK = 2

    def __init__(
        self,
        force: InternalForce,
        hold: Callable[[np.ndarray, float], None],
        positions: np.ndarray,
        velocities: np.ndarray,
        free: np.ndarray,
        mass: np.ndarray,
        *,
        damping: float,
        viscosity: float,
        safety: float,
        loads: Loads | None = None,
        broken: np.ndarray = NONE,
    ) -> None:
        self.force = force
        self._hold = hold
        self.positions = positions
        self.velocities = velocities
        self.free = free
        self.mass = mass
        self._damping = damping
        self.viscosity = viscosity
        self._safety = safety
        self._loaded = LoadedForce(force, loads) if loads else force
        self._loads = loads
        self._applied = np.empty_like(positions) if loads else None
        self._contact = loads.greatest_frequency(mass) if loads else 0.0
        self._share = force.body.share
        self.ahead = np.empty_like(positions)
        self.elastic = np.zeros_like(positions)
        self.frequency = FrequencyEstimate(mass, free, self._share, everywhere=force.breakable)
        self.forces = np.empty_like(positions)
        self._kicks = None
        self._broken = broken
        self._fastest: float | None = None
        self._strained: float | None = None
        self.time_step = self.last_step = self.longest = np.inf
        self.steps = 0
        # Lengths of the last step, of the step before and of the next, and `followed`.
        self.spans = np.zeros(4)
        self.sums = np.zeros((-(-len(positions) // BLOCK), len(Balance.__annotations__)))
        chunks = chunks_of(len(force.body.bonds.first))
        moved = velocities, self.forces, free, mass, float(damping), self.spans
        self._most = MOST_TRAVEL * force.body.spacing
        self.take = take_step.bind(positions, *moved, self._most, chunks=chunks)
        self.find_energies = energies_of_step.bind(
            velocities, *moved, self.elastic, self.sums, chunks=chunks
        )
        self.look = look_ahead.bind(
            positions, velocities, float(viscosity), self.ahead, chunks=chunks
        )
        self.follow = follow.bind(self.forces, self.spans, self.elastic, chunks=chunks)
        self._take, self._run_energies, self._look, self._follow = map(
            Chain, (self.take, self.find_energies, self.look, self.follow)
        )

    def begin(self) -> None:
        """Compute the stable time step and the forces at the initial positions.

        Raises
        ------
        Diverging
            If no stable time step exists.
        """
        self._share.clear(self.velocities)  # the owners of halo points move them
        self._hold(self.positions, 0.0)
        self.limit(self.frequency(self._loaded, self.positions))
        self.last_step = self.time_step
        self._evaluate()

    def limit(self, squared: float) -> None:
        """Limit the time step to the stable one for the square of the body's highest frequency;
        contact may begin before the next call.
        """
        margin = 1.0 if self.force.breakable else FREQUENCY_MARGIN
        frequency = margin * np.sqrt(squared + self._contact)
        if not 0 < frequency < np.inf:
            raise Diverging(
                f"there is no time step: the highest frequency of the body is {frequency:.3g}"
            )
        # Damping ratio of the highest mode: in an explicit scheme viscosity reduces its stability.
        ratio = 0.5 * self.viscosity * frequency
        step = self._safety * 2 / frequency * (np.sqrt(1 + ratio * ratio) - ratio)
        # A power iteration may leave out places that were stiff before.
        self.time_step = step if self.force.breakable else min(self.time_step, step)

    def _evaluate(self, follow: bool = False, confirm: bool = False) -> None:
        """Evaluate the forces; with `follow` also limit the time step, by the tangent at the same
        places as the forces, and `confirm` it where it becomes shorter.
        """
        places = self.positions
        if self.viscosity > 0:
            places = self.ahead
            self._look()
            self._hold(places, self.viscosity)
        if follow:
            before = self.time_step
            self.limit(self.frequency.follow(self.force, places, self.forces))
            if confirm and self.time_step < LEAST_SHARE * before:
                self.limit(self.frequency.follow(self.force, places, self.forces))
        else:
            self.force(places, self.forces)
        if self.viscosity > 0:
            self.spans[3] = self.followed_in(self.last_step)
            self._follow()
        self._add_loads()

    def followed_in(self, step: float) -> float:
        """Return the fraction of the difference between the forces ahead of the positions and
        `elastic` that is added to `elastic` in a step of a length.
        """
        return step / (step + self.viscosity) if self.viscosity > 0 else 1.0

    def evaluate_at_rest(self) -> None:
        """Evaluate the forces, including loads, at the present positions without viscous part,
        as if the velocities were zero.
        """
        self.force(self.positions, self.forces)
        self._add_loads()

    def accept(self) -> None:
        """Add the present state to the history of the force, with held parts at their present
        places, where loads need them, too: with viscosity they were ahead in the last evaluation.
        """
        if self._loads or self.force.history:
            self._hold(self.positions, 0.0)
        self.force.accept(self.positions)

    def find_elastic(self) -> float:
        """Evaluate `elastic` exactly, after moving held parts to their present places; `force` is
        left in that state.

        Return the power, with the present velocities, of the error that the estimate had.
        """
        estimated = self.elastic.copy()
        self._hold(self.positions, 0.0)
        self.force(self.positions, self.elastic)
        return self._share.dot(estimated - self.elastic, self.velocities)

    def _add_loads(self) -> None:
        """Add the loads at their present size and at the present positions to `forces`."""
        if self._loads:
            self._applied.fill(0.0)
            self._loads.forces(self.positions, self._loaded.thickness(), self._applied)
            self.forces += self._applied

    def center(self) -> None:
        """Shift the velocities in time from the present positions back by half a step, as
        central differences need them.
        """
        self.velocities += self._half_step_of(-self.forces)
        self._fastest = None

    def part_of(self, span: float) -> float:
        """Return the longest stable step that divides a span of time into a whole number of
        steps.
        """
        return span / max(1, math.ceil(span / self.time_step))

    def move(self) -> None:
        """Advance velocities and positions by one step, in place, without evaluating the forces
        at the new positions.
        """
        step = self.next_step()
        self.spans[:3] = step, self.last_step, 0.0
        self._take()
        self.moved(step)

    def moved(self, step: float, times: int = 1) -> None:
        """Take notice of steps in which velocities and positions have advanced, the last of a
        length.
        """
        self.last_step = step
        self.force.elapse(step)
        self.steps += times
        self._kicks = self._fastest = None

    def _step(self, positions: np.ndarray, velocities: np.ndarray, step: float) -> None:
        """Advance arrays of velocities and positions, the body's own or copies, by one step with
        the present forces, in place.
        """
        scheme = self.forces, self.free, self.mass, self._damping, step, self.last_step
        central_difference_step(positions, velocities, *scheme)

    def next_step(self) -> float:
        """Return the length of the next time step: stable, at most `longest`, and such that no
        points move farther than `MOST_TRAVEL`.
        """
        fastest = self._fastest
        if fastest is None:
            fastest = self._share.greatest(max(self.velocities.max(), -self.velocities.min()))
            self._fastest = fastest
            self._strained = None
        step = min(self.time_step, self.longest)
        if fastest * step <= self._most:
            return step
        if self._loads and self._loads.obstacles:
            return self._most / fastest
        if self._strained is None:
            self._strained = strain_of_step(self.force.body, self.velocities.copy(), self._broken)
        return min(step, max(self._most / fastest, MOST_TRAVEL / max(self._strained, 1e-300)))

    def kick(self, forces: np.ndarray) -> None:
        """Add to the velocities the impulse over half a step of `forces` (n, d) of all bonds that
        break at the present positions.

        Velocities are half a step behind the positions. Breaking bonds act until the present time,
        but the forces of the next full step exclude them; without their impulse over the last half
        step the motion would lose less energy than the bonds have taken up. A second call in a
        step, with the forces of further bonds as well, replaces the impulse of the first.
        """
        if self._kicks is not None:
            self.velocities -= self._kicks
        self._share.clear(forces)
        self._kicks = self._half_step_of(forces)
        self.velocities += self._kicks
        self._fastest = None

    def _half_step_of(self, forces: np.ndarray) -> np.ndarray:
        return 0.5 * self.last_step * forces / self.mass[:, None] * self.free

    def evaluate(self, bonds_break: bool = False) -> None:
        """Evaluate the forces at the present positions, and the stable time step if it is due by
        the number of steps.

        `bonds_break` tells whether bonds have broken in this step or in one of the steps just
        before.
        """
        apart = self.STEPS_WHILE_BONDS_BREAK if bonds_break else self.STEPS_BETWEEN_ESTIMATES
        self._evaluate(self.steps % apart == 0, confirm=not bonds_break)

    def velocities_around(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the velocities half a step before the present time and half a step after, shape
        (n, d) each.

        The velocities before exclude the impulse of bonds that broke at the present positions. The
        arrays are not to be changed.
        """
        following = self.velocities.copy()
        # the positions are not used, and the array is free between evaluations
        self._step(self.ahead, following, self.next_step())
        return self._arriving(), following

    def _arriving(self) -> np.ndarray:
        return self.velocities if self._kicks is None else self.velocities - self._kicks

    def balance(self) -> Balance:
        """Return the kinetic energies at the present time, and the powers that damping and
        viscosity dissipate; viscous forces are `forces` minus the elastic forces and loads.
        """
        self.give_energies()
        self.spans[:3] = self.last_step, 0.0, self.next_step()
        self._run_energies()
        return Balance(*self._share.total(tuple(self.sums.sum(axis=0).tolist())))

    def give_energies(self) -> None:
        """Give `find_energies` the arrays of the present step."""
        self.find_energies.give("arriving", self._arriving())
        elastic = self.elastic_with_loads() if self.viscosity > 0 else self.forces
        self.find_energies.give("elastic", elastic)

    def elastic_with_loads(self) -> np.ndarray:
        """Return the elastic forces plus the loads on every point at the present positions,
        without viscous part, shape (n, d).
        """
        return self.elastic + self._applied if self._loads else self.elastic
