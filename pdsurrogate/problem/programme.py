"""Programme of a scene as stages, each in equilibrium or in dynamics, and the measures that its results report."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..scenes import Rectangle, Scene
from ..scenes.model import EDGES
from ..scenes.references import reference_level
from ..solvers.increments import Motion


@dataclass(frozen=True)
class Inertia:
    """Settings of a stage in dynamics, in addition to its path.

    Attributes
    ----------
    density, damping, safety : float
        See `pdsurrogate.scenes.StepDynamics`.
    viscosity : float or None
        None if the scene does not set it.
    duration : float or None
        Duration of the stage.
    rate : float or None
        Rate of the loading parameter; one of the two is given.
    key : str
        Key in the scene.
    """

    density: float
    damping: float
    viscosity: float | None
    safety: float
    duration: float | None
    rate: float | None
    key: str

    @property
    def pace(self) -> str:
        """Return the name of the key, within the scene's table `key`, that sets how fast the stage runs."""
        return "stretch_rate" if self.duration is None else "duration"

    def motion(self, begin: float, end: float) -> Motion:
        """Return the loading parameter as a function of time."""
        return Motion.at_rate(begin, end, self.rate) if self.duration is None else Motion.lasting(begin, end, self.duration)


@dataclass(frozen=True)
class Stage:
    """A part of a programme.

    Attributes
    ----------
    to : float
        Loading parameter at its end.
    outputs : int
        States recorded on the way, evenly, the last one at the end.
    largest_increment : float or None
        Greatest increment of the parameter between two equilibria; None where the first guess determines it.
    inertia : Inertia or None
        None for a stage in equilibrium.
    """

    to: float
    outputs: int
    largest_increment: float | None
    inertia: Inertia | None


def stages_of(scene: Scene) -> tuple[Stage, ...]:
    """Return the stages of a scene: with grips, one for every stretch and one for the dynamics after them; otherwise one for every step."""
    if not scene.stretched:
        return tuple(
            Stage(step.to, step.outputs, step.largest_increment, None if step.dynamics is None else _inertia(number, step.dynamics))
            for number, step in enumerate(scene.steps)
        )
    stages = [Stage(stretch, 1, scene.solver.largest_increment, None) for stretch in scene.stretches]
    spec = scene.dynamics
    if spec is not None:
        inertia = Inertia(spec.density, spec.damping, spec.viscosity, spec.safety, None, spec.stretch_rate, "dynamics")
        stages.append(Stage(spec.stretch, spec.outputs, None, inertia))
    return tuple(stages)


def _inertia(number: int, spec) -> Inertia:
    return Inertia(spec.density, spec.damping, spec.viscosity, spec.safety, spec.duration, None, f"steps.{number}.dynamics")


@dataclass(frozen=True)
class NominalStress:
    """Pull of a grip outwards along the loaded axis over its cross-section.

    Attributes
    ----------
    edge : str
        Edge of the grip: of the two that which travels further, or the right or top one of two that travel alike.
    area : float
    number : int
        Number of the grip among the holders.
    """

    edge: str
    area: float
    number: int

    def of(self, forces: np.ndarray) -> float:
        """Return the stress from the forces of the grips, shape (2, d)."""
        axis, side = EDGES[self.edge]
        return float(side * forces[self.number, axis] / self.area)


@dataclass(frozen=True)
class Measures:
    """Measures that results of a problem report.

    Attributes
    ----------
    nominal_stress : NominalStress or None
        Measure of a body between two grips; other results report moments, and their outputs in dynamics among the levels.
    lateral : int or None
        Axis across the load whose edges move straight, of a rectangle between grips.
    areas : dict of float
        Cross-section of the body at every grip or reflected edge.
    reference : callable
        Known values of measures at a value of the loading parameter, by name.
    """

    nominal_stress: NominalStress | None
    lateral: int | None
    areas: dict[str, float]
    reference: Callable[[float], dict[str, float]]


def measures_of(scene: Scene, areas: dict[str, float]) -> Measures:
    """Return the measures of a scene, for cross-sections at its grips."""
    if not scene.stretched:
        return Measures(None, None, areas, lambda parameter: {})
    grip = max(scene.grips, key=lambda grip: (grip.travel, EDGES[grip.edge][1]))
    stress = NominalStress(grip.edge, areas[grip.edge], scene.grips.index(grip))
    # Other outlines have no straight edges to read displacements from.
    lateral = 1 - scene.loaded_axis if isinstance(scene.body, Rectangle) else None
    return Measures(stress, lateral, areas, partial(reference_level, scene))
