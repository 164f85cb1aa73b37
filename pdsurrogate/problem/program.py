"""Program of a scene: stages in equilibrium or in dynamics, the motions that it prescribes, and
the measures that results report.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..discretization.planes import prescribed_components
from ..forces import InvalidState
from ..materials import Law
from ..scenes import Dynamics, Rectangle, Region, Scene, StepDynamics
from ..scenes.amplitudes import amplitude_of
from ..scenes.grips import prescribed_in
from ..scenes.loading_checks import tears_slowly
from ..scenes.model import EDGES
from ..scenes.pulled import pulled_grip
from ..scenes.references import reference_level
from ..scenes.regions import label_of_region
from ..solvers.held import Held
from ..solvers.increments import Motion
from ..solvers.rigid import turn_by
from .regions import BodyRegions


@dataclass(frozen=True)
class Stage:
    """Stage of a loading program, in equilibrium or in dynamics.

    Attributes
    ----------
    to : float
        Loading parameter at the end of the stage.
    outputs : int
        Number of states to record, evenly spaced, the last one at the end of the stage.
    largest_increment : float or None
        Greatest increment of the parameter between two equilibria; None if the scene sets no bound.
    inertia : Dynamics or StepDynamics or None
        Settings of the scene for a stage in dynamics; None for a stage in equilibrium.
    key : str
        Key of the scene that describes the stage, for messages.
    control : str or None
        Key of the displacement of a probe that the stage changes in place of the loading parameter,
        which is found; `to` and `largest_increment` are then displacements.
    duration : float or None
        Time that a stage in equilibrium takes; None without a time.
    tears : bool
        Whether bonds break in a stage in equilibrium, which otherwise ends before one would.
    """

    to: float
    outputs: int
    largest_increment: float | None
    inertia: Dynamics | StepDynamics | None
    key: str
    control: str | None = None
    duration: float | None = None
    tears: bool = False

    def motion(self, begin: float) -> Motion:
        """Return the loading parameter as a function of time in dynamics, from the value `begin`
        to the end of the stage.
        """
        pace = getattr(self.inertia, self.inertia.pace)
        change = self.to - begin
        rate, duration = (
            (change / pace, pace) if self.inertia.pace == "duration" else (pace, change / pace)
        )
        return Motion(begin, self.to, rate, duration)


def stages_of(scene: Scene) -> tuple[Stage, ...]:
    """Return the stages of a scene's program.

    A body between grips has a stage in equilibrium for each stretch and, if the scene gives
    dynamics, a last stage in dynamics; any other body has one stage for each step of the scene.
    If the body tears slowly, all of them are in equilibrium.
    """
    stages = _stages_of(scene)
    return slow_stages(scene, stages) if tears_slowly(scene) else stages


def slow_stages(scene: Scene, stages: tuple[Stage, ...]) -> tuple[Stage, ...]:
    """Return the stages of a body that tears slowly, all of them in equilibrium."""
    begins = (parameter_of(scene)[1], *known_ends(stages))
    return tuple(
        replace(
            stage,
            inertia=None,
            tears=True,
            duration=stage.duration if stage.inertia is None else stage.motion(begin).duration,
        )
        for begin, stage in zip(begins, stages, strict=False)
    )


def _stages_of(scene: Scene) -> tuple[Stage, ...]:
    """Return the stages of a scene as it states them, those in dynamics included."""
    if not scene.stretched:
        return tuple(
            Stage(
                step.to,
                step.outputs,
                step.largest_increment,
                step.dynamics,
                f"steps.{number}.{step.kind}",
                step.control,
                step.duration,
            )
            for number, step in enumerate(scene.steps)
        )
    durations = np.diff(scene.times, prepend=0.0).tolist() or [None] * len(scene.stretches)
    stages = [
        Stage(stretch, 1, scene.solver.largest_increment, None, "stretches", duration=duration)
        for stretch, duration in zip(scene.stretches, durations, strict=True)
    ]
    if scene.dynamics is not None:
        stages.append(
            Stage(scene.dynamics.stretch, scene.dynamics.outputs, None, scene.dynamics, "dynamics")
        )
    return tuple(stages)


def check_durations(stages: Sequence[Stage], laws: Iterable[Law]) -> None:
    """Raise ValueError if a law has branches, and a stage in equilibrium has no duration."""
    if any(law.memory.branches for law in laws):
        for stage in stages:
            if stage.inertia is None and stage.duration is None:
                where, what = (
                    ("times", "times = [...], at which the stretches are reached")
                    if stage.key == "stretches"
                    else (f"{stage.key.rsplit('.', 1)[0]}.duration", "a duration of every step")
                )
                raise ValueError(
                    f"{where}: missing; the stress of a material with branches depends on time:"
                    f" give {what} (0 for a sudden change)"
                )


def parameter_of(scene: Scene) -> tuple[str, float]:
    """Return the name of a scene's loading parameter, and its value for the undeformed body."""
    return ("stretch", 1.0) if scene.stretched else ("t", 0.0)


def known_ends(stages: tuple[Stage, ...]) -> list[float]:
    """Return the loading parameters at the ends of those stages that prescribe it."""
    return [stage.to for stage in stages if stage.control is None]


@dataclass(frozen=True)
class NominalStress:
    """Nominal stress of a body between grips: the outward force of one grip along the loaded axis,
    divided by the cross-section there.

    Attributes
    ----------
    edge : str
        Edge of that grip: of the two grips the one that travels farther, or the right or top one if
        they travel alike.
    area : float
        Undeformed cross-section of the body at the grip.
    number : int
        Index of the grip in the list of supports whose forces are reported.
    """

    edge: str
    area: float
    number: int

    def of(self, forces: np.ndarray) -> float:
        """Return the nominal stress from the forces of both grips on the body, shape (2, d)."""
        return float(EDGES[self.edge][1] * forces[self.number, self.axis] / self.area)

    def pull(self, forces: np.ndarray) -> float:
        """Return the force with which the grips pull, negative where they push, from the forces
        of both grips, shape (2, d).
        """
        return self.of(forces) * self.area

    @property
    def axis(self) -> int:
        """Return the loaded axis, 0 for x1."""
        return EDGES[self.edge][0]


@dataclass(frozen=True)
class Measures:
    """Quantities that the results of a problem report, depending on the kind of its scene.

    Attributes
    ----------
    nominal_stress : NominalStress or None
        Nominal stress of a body between two grips; None for other bodies. The results of other
        bodies report moments and, in dynamics, have a row of ``summary["levels"]`` for every
        output.
    lateral : int or None
        Axis across the load, along which the displacements of the edges of a rectangle between
        grips are reported; None otherwise.
    areas : dict of float
        Cross-section of the body at every grip or reflected edge.
    reference : callable
        Function that returns reference values of reported quantities, by name, at a value of the
        loading parameter.
    """

    nominal_stress: NominalStress | None
    lateral: int | None
    areas: dict[str, float]
    reference: Callable[[float], dict[str, float]]


def measures_of(scene: Scene, areas: dict[str, float]) -> Measures:
    """Return the `Measures` of a scene, which say what its results report; `areas` maps edges
    with grips to the cross-sections there.
    """
    if not scene.stretched:
        return Measures(None, None, areas, lambda parameter: {})
    grip = pulled_grip(scene)
    stress = NominalStress(grip.edge, areas[grip.edge], scene.grips.index(grip))
    # Other outlines have no straight edges to read displacements from.
    lateral = 1 - scene.loaded_axis if isinstance(scene.body, Rectangle) else None
    return Measures(stress, lateral, areas, partial(reference_level, scene))


@dataclass(frozen=True)
class Prescription:
    """Motion prescribed for a region: a displacement and a rotation, both times a factor that
    depends on the loading parameter.

    Attributes
    ----------
    key : str
        Key of the entry in the scene.
    holder : str or None
        Name under which results report the force of the support; None where they do not report it.
    region : str or Region
    components : tuple of int
        Components that are held.
    displacement : ndarray, shape (d,)
        Displacement where the factor is 1.
    factor : callable
        Factor as a function of the loading parameter.
    words : str
        Description of the support for drawings of the scene.
    rotation : float or None
        Angle in degrees where the factor is 1.
    about, axis : ndarray, shape (d,), or None
        Center of the rotation, and in three dimensions the direction of its axis.
    """

    key: str
    holder: str | None
    region: str | Region
    components: tuple[int, ...]
    displacement: np.ndarray
    factor: Callable[[float], float]
    words: str
    rotation: float | None = None
    about: np.ndarray | None = None
    axis: np.ndarray | None = None

    def motion(self, parameter: float | np.ndarray) -> np.ndarray:
        """Return the motion [Q - I, c] at a value of the loading parameter, shape (d, d + 1), or
        those at several, (k, d, d + 1): a place X moves by (Q - I) X + c.
        """
        factors = np.ravel(parameter).tolist()
        if self.rotation is not None or self.displacement.any():
            factors = list(map(self.factor, factors))
        dimension = len(self.displacement)
        found = np.zeros((len(factors), dimension, dimension + 1))
        found[:, :, -1] = self.displacement * np.reshape(factors, (-1, 1))
        if self.rotation is not None:
            axis = np.ones(1) if dimension == 2 else self.axis / np.linalg.norm(self.axis)
            for one, factor in zip(found, factors, strict=True):
                one[:, :-1] = turn_by(math.radians(self.rotation * factor) * axis)
                one[:, :-1] -= np.eye(dimension)
                one[:, -1] -= one[:, :-1] @ self.about
        return found.reshape(*np.shape(parameter), dimension, dimension + 1)

    def angle(self, parameter: float) -> float:
        """Return the angle in degrees by which the region has turned at a value of the loading
        parameter.
        """
        return self.rotation * self.factor(parameter)

    def held(
        self,
        names: tuple[str, ...],
        points: np.ndarray,
        places: np.ndarray,
        components: tuple[int, ...] | None = None,
        **further,
    ) -> Held:
        """Return a held part of the body, points or a reflection plane, that makes the prescribed
        motion.

        `points` are the held points, or for a reflection plane the points that have mirror images
        beyond it, and `places`, shape (k, d), the undeformed places of the part. `names` lists the
        names of all supports whose forces are reported, `components` the held components (by
        default all prescribed ones); `further` are more fields of `Held`.
        """
        holder = None if self.holder is None else names.index(self.holder)
        angle = None if self.rotation is None else self.angle
        return Held(
            self.key,
            holder,
            components or self.components,
            self.motion,
            points,
            places,
            angle,
            **further,
        )

    def reached(self, parameter: float) -> str:
        """Return the prescribed displacement and rotation at a value of the parameter, as text
        for messages; empty if all are zero.
        """
        factor = self.factor(parameter)
        found = [
            f"x{component} = {value * factor:.4g}"
            for component, value in enumerate(self.displacement, 1)
            if value
        ]
        return ", ".join(
            found + ([f"rotation = {self.rotation * factor:.4g}"] if self.rotation else [])
        )


def prescriptions_of(
    scene: Scene, regions: BodyRegions, stages: tuple[Stage, ...], rest: float
) -> list[Prescription]:
    """Return the prescribed motions of a scene in the order in which they take effect: of two that
    hold a point, the later one counts.

    `rest` is the loading parameter of the undeformed body.

    Raises
    ------
    ValueError
        If two entries on different regions share a name.
    """
    length = float((regions.upper - regions.lower)[scene.loaded_axis]) if scene.stretched else 1.0
    entries = prescribed_in(scene, length)
    labels = names_of_forces(scene)
    ends = [0.0, *(end - rest for end in known_ends(stages))]
    found = []
    for key, entry in entries.items():
        values = np.array([value or 0.0 for value in entry.displacement[: scene.dimension]])
        factor = partial(
            _factor, f"{key}.amplitude", amplitude_of(entry.amplitude), (min(ends), max(ends)), rest
        )
        words = [
            f"x{number} = {value:g}"
            for number, value in enumerate(entry.displacement, 1)
            if value is not None
        ]
        words += [] if entry.rotation is None else [f"turned by {entry.rotation:g} degrees"]
        about, axis = (
            None if place is None else np.array(place) for place in (entry.about, entry.axis)
        )
        held = labels.get(key), entry.region, prescribed_components(entry, scene.dimension)
        found.append(
            Prescription(key, *held, values, factor, ", ".join(words), entry.rotation, about, axis)
        )
    return found


def _factor(
    key: str,
    amplitude: Callable[[float], float],
    span: tuple[float, float],
    rest: float,
    parameter: float,
) -> float:
    """Return an amplitude at t = parameter - rest; beyond the program's `span`, its least and
    greatest t, it is extrapolated.

    Viscous forces need values slightly after the end of the program, where the amplitude itself may
    be undefined. The extrapolation, by reflection in the point at the end, keeps the velocity of
    parts that move there. Raise InvalidState, with the `key` of the amplitude in the scene, if the
    amplitude is undefined at `t`, or at a value within the span that the extrapolation uses.
    """
    t = parameter - rest
    try:
        within = min(max(t, span[0]), span[1])
        return amplitude(t) if t == within else 2 * amplitude(within) - amplitude(2 * within - t)
    except ValueError as error:
        raise InvalidState(f"{key}: {error}") from None


def names_of_forces(scene: Scene) -> dict[str, str]:
    """Return the names under which results report forces, by the keys of the grips, or of the
    entries that prescribe, load or press.

    Raises
    ------
    ValueError
        If entries on different regions share a name.
    """
    entries = {
        key: entry for key, entry in prescribed_in(scene).items() if not key.startswith("holds")
    }
    entries |= {
        f"{kind}.{number}": entry
        for kind in ("loads", "obstacles")
        for number, entry in enumerate(getattr(scene, kind))
    }
    names = {}
    owners = {}
    for key, entry in entries.items():
        own = key if key.startswith("obstacles") else entry.region
        names[key] = entry.name or (key if own == key else label_of_region(own, key))
        other, region = owners.setdefault(names[key], (key, own))
        if region != own:
            raise ValueError(
                f"{other} and {key} have different regions but the same name {names[key]!r}; give"
                " one of them another name"
            )
    return names
