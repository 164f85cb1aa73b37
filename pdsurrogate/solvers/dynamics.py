"""Explicit dynamics: central differences with damping proportional to mass and to stiffness, and a step below the critical one."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..forces import InternalForce
from ..kernels.steps import central_difference_step
from .equilibrium import Diverging
from .loads import LoadedForce, Loads
from .reductions import LOCAL, LocalReductions
from .stability import FrequencyEstimate

FREQUENCY_MARGIN = 1.03
"""The power iteration comes to the highest frequency from below, within 2 % on sheets of up to 7,500 points."""


MOST_TRAVEL = 0.5
"""Spacings that a point may move in a step.  At the speeds of waves it does not get as far; what snaps back from the last bonds of a crack
would, past the bonds that should stop it."""


class ExplicitDynamics:
    """M (a + c v) = f(y + tau v) by central differences, velocities at half steps; with tau = 0 the paper's scheme, here in real time.

    Forces at positions a retardation time tau ahead are those of a Kelvin-Voigt solid, f + tau df/dt, to first order in tau, at no further
    evaluation.  They damp what is as short as the bonds, which damping proportional to mass hardly touches: material that snaps
    back from a crack.  Loads are those of now: at y, and of their present size; but a pressure on the deformed thickness is on that ahead.

    Parameters
    ----------
    force : InternalForce
    hold : callable
        ``hold(positions, ahead)`` brings all that is held to where it is a time `ahead` from now.
    positions, velocities : ndarray, shape (n, 2)
        Start; taken over, and changed in place.
    free : ndarray, shape (n, 2)
        1 where a component may move by itself, 0 where it is held.
    mass : ndarray, shape (n,)
    damping : float
        c, per unit time.
    viscosity : float
        tau, a time.
    safety : float
        Time step over the critical one, at most 1.
    loads : Loads, optional
        Brought to their present size by whoever steps.
    reductions : LocalReductions, optional

    Attributes
    ----------
    forces : ndarray, shape (n, 2)
        At the positions.
    time_step : float
        The stable one.  Falls where the body stiffens, never rises.
    last_step : float
        The one last taken, shorter where a point would have moved too far.
    """

    # The tangent changes over the time that a wave takes across many horizons; a look every so many steps costs 1 to 2 %.
    STEPS_BETWEEN_ESTIMATES = 500

    def __init__(
        self,
        force: InternalForce,
        hold: Callable[[np.ndarray, float], None],
        positions,
        velocities,
        free,
        mass,
        damping: float,
        viscosity: float,
        safety: float,
        loads: Loads | None = None,
        reductions: LocalReductions = LOCAL,
    ) -> None:
        self.force, self._hold, self.positions, self.velocities = force, hold, positions, velocities
        self._free, self._mass, self._damping, self._viscosity, self._safety = free, mass, damping, viscosity, safety
        self._loaded = force if loads is None else LoadedForce(force, loads)
        self._loads, self._applied = loads, None if loads is None else np.empty_like(positions)
        self._reductions = reductions
        self._ahead, self._elastic = np.empty_like(positions), np.empty_like(positions)
        self.frequency = FrequencyEstimate(mass, free, self._reductions)
        self.forces = np.empty_like(positions)
        self.time_step = self.last_step = np.inf
        self.steps = 0

    def begin(self) -> None:
        """Find the time step and the forces at the start.

        Raises
        ------
        Diverging
            If there is no time step.
        """
        self._estimate()
        self.last_step = self.time_step
        self._evaluate()

    def _estimate(self) -> None:
        self._hold(self.positions, 0.0)
        frequency = FREQUENCY_MARGIN * np.sqrt(self.frequency(self._loaded, self.positions))
        if not 0 < frequency < np.inf:
            raise Diverging(f"there is no time step: the highest frequency of the body is {frequency:.3g}")
        # Damping ratio of the highest mode, which the viscosity makes less stable in an explicit scheme.
        ratio = 0.5 * self._viscosity * frequency
        self.time_step = min(self.time_step, self._safety * 2 / frequency * (np.sqrt(1 + ratio * ratio) - ratio))

    def _evaluate(self) -> None:
        if self._viscosity == 0:
            self.evaluate_at_rest()
            return
        np.multiply(self.velocities, self._viscosity, out=self._ahead)
        self._ahead += self.positions
        self._hold(self._ahead, self._viscosity)
        self._find(self._ahead)

    def evaluate_at_rest(self) -> None:
        """Forces at the positions, without what viscosity adds."""
        self._find(self.positions)

    def _find(self, positions: np.ndarray) -> None:
        """Internal forces at some positions, and loads at those of now."""
        self.force(positions, self.forces)
        if self._loads is not None:
            self._applied.fill(0.0)
            self._loads.forces(self.positions, self._loaded.thickness(), self._applied)
            self.forces += self._applied

    def centre(self) -> None:
        """Take velocities that are those at the positions back by half a step, where the scheme has them."""
        self.kick(-self.forces)

    def part_of(self, span: float) -> float:
        """The longest step, no longer than the stable one, of which a whole number makes a span of time."""
        return span / max(1, math.ceil(span / self.time_step))

    def move(self, longest: float = np.inf) -> None:
        """Advance velocities and positions by one step of at most `longest`; the forces are still those before it."""
        fastest = self._reductions.greatest_of_parts(max(self.velocities.max(), -self.velocities.min()))
        step = min(self.time_step, longest)
        if fastest > 0:
            step = min(step, MOST_TRAVEL * self.force.body.spacing / fastest)
        scheme = self.forces, self._free, self._mass, self._damping
        central_difference_step[self.positions.shape[1]](self.positions, self.velocities, *scheme, step, self.last_step)
        self.last_step = step
        self.steps += 1

    def kick(self, forces: np.ndarray) -> None:
        """Half a step's impulse of forces that end at the present positions.

        Velocities stand half a step back.  Bonds that break act up to now, but the forces of the next full step will be without them;
        left out, their last half step would hand the body energy that nothing supplied.
        """
        self.velocities += 0.5 * self.last_step * forces / self._mass[:, None] * self._free

    def evaluate(self) -> None:
        """Forces at the positions, and now and then the time step."""
        if self.steps % self.STEPS_BETWEEN_ESTIMATES == 0:
            self._estimate()
        self._evaluate()

    def kinetic_energy(self, velocities: np.ndarray | None = None) -> float:
        """Of given velocities; of those at the last half step where none are."""
        velocities = self.velocities if velocities is None else velocities
        return 0.5 * self._reductions.dot(velocities, velocities, self._mass)

    def mean_velocities(self) -> np.ndarray:
        """Velocities at the positions, the mean of those half a step before and after, shape (n, 2)."""
        following = self.velocities.copy()
        scheme = self.forces, self._free, self._mass, self._damping, self.last_step, self.last_step
        central_difference_step[self.positions.shape[1]](self.positions.copy(), following, *scheme)
        return 0.5 * (self.velocities + following)

    def damped_power(self) -> float:
        """Power that damping and viscosity take; leaves the force evaluated at the positions themselves.

        It is taken with the velocity at the positions.  That half a step before alone would overstate it where velocities change within a
        step, as they do beside a crack.
        """
        mean = self.mean_velocities()
        power = self._damping * self._reductions.dot(mean, mean, self._mass)
        if self._viscosity > 0:
            self._hold(self.positions, 0.0)
            self.force(self.positions, self._elastic)
            if self._loads is not None:
                self._elastic += self._applied
            power += self._reductions.dot(self._free * (self._elastic - self.forces), mean)
        return power
