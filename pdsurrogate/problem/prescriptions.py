"""Prescriptions: the motions that a scene prescribes for regions, whether it gives them by grips and holds or by `prescribed`."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..discretisation.planes import prescribed_components
from ..forces import InvalidState
from ..scenes import Region, Scene
from ..scenes.amplitudes import amplitude_of
from ..scenes.model import EDGES
from ..solvers.held import Held
from ..solvers.rigid import turn_by
from .programme import Stage
from .regions import BodyRegions


@dataclass(frozen=True)
class Prescription:
    """Motion prescribed for a region: a displacement and a rotation, both times a factor that depends on the loading parameter.

    Attributes
    ----------
    key : str
        Key in the scene.
    name : str
        Name in messages.
    holder : str or None
        Name under which results report its force; None where they do not.
    region : str or Region
    components : tuple of int
        Components that are held.
    displacement : ndarray, shape (d,)
        Displacement where the factor is 1.
    factor : callable
        Function of the loading parameter.
    words : str
        Description for figures.
    rotation : float or None
        Angle in degrees where the factor is 1.
    about, axis : ndarray, shape (d,), or None
        Centre of the rotation, and in three dimensions the direction of its axis.
    """

    key: str
    name: str
    holder: str | None
    region: str | Region
    components: tuple[int, ...]
    displacement: np.ndarray
    factor: Callable[[float], float]
    words: str
    rotation: float | None = None
    about: np.ndarray | None = None
    axis: np.ndarray | None = None

    def motion(self, parameter: float) -> np.ndarray:
        """Return [Q - I, c] at a value of the parameter, shape (d, d + 1): a place X moves by (Q - I) X + c."""
        factor, dimension = self.factor(parameter), len(self.displacement)
        found = np.zeros((dimension, dimension + 1))
        found[:, -1] = self.displacement * factor
        if self.rotation is not None:
            axis = np.ones(1) if dimension == 2 else self.axis / np.linalg.norm(self.axis)
            found[:, :-1] = turn_by(math.radians(self.rotation * factor) * axis) - np.eye(dimension)
            found[:, -1] -= found[:, :-1] @ self.about
        return found

    def angle(self, parameter: float) -> float:
        """Return the angle in degrees by which the region has turned."""
        return self.rotation * self.factor(parameter)

    def held(
        self, names: tuple[str, ...], points: np.ndarray, places: np.ndarray, components: tuple[int, ...] | None = None, **further
    ) -> Held:
        """Return points at given places, some components of which, by default all that are prescribed, move so."""
        holder = None if self.holder is None else names.index(self.holder)
        angle = None if self.rotation is None else self.angle
        return Held(self.name, holder, components or self.components, self.motion, points, places, angle, **further)

    def reached(self, parameter: float) -> str:
        """Return the progress of the prescription at a value of the parameter, in words; empty if it moves nothing."""
        factor = self.factor(parameter)
        found = [f"x{component} = {value * factor:.4g}" for component, value in enumerate(self.displacement, 1) if value]
        return ", ".join(found + ([f"rotation = {self.rotation * factor:.4g}"] if self.rotation else []))


def prescriptions_of(scene: Scene, regions: BodyRegions, stages: tuple[Stage, ...]) -> list[Prescription]:
    """Return the prescriptions of a scene in the order in which they take effect: of two that hold a point, the later one counts.

    Grips move in proportion to the elongation of the body, as do holds.

    Raises
    ------
    ValueError
        If two entries on different regions share a name.
    """
    if not scene.stretched:
        ends = [0.0, *(stage.to for stage in stages)]
        return [_of_entry(scene, number, label, (min(ends), max(ends))) for number, label in enumerate(_labels(scene, regions))]

    length = float((regions.upper - regions.lower)[scene.loaded_axis])

    def elongation(stretch: float) -> float:
        return (stretch - 1) * length

    found, every = [], tuple(range(scene.dimension))
    for number, hold in enumerate(scene.holds):
        components = every if hold.components is None else tuple(int(name[1:]) - 1 for name in hold.components)
        travel, key = np.zeros(scene.dimension) if hold.travel is None else np.array(hold.travel), f"holds.{number}"
        region = Region.model_construct(box=hold.box, points=hold.points)  # it may list no points, and is refused where it is resolved
        words = "all" if hold.components is None else ", ".join(hold.components)
        found.append(Prescription(key, key, None, region, components, travel, elongation, words))
    for number, grip in enumerate(scene.grips):
        axis, side = EDGES[grip.edge]
        components, words = ((axis,), "roller") if grip.holds == "normal" else (every, "grip")
        travel = side * grip.travel * np.eye(scene.dimension)[axis]
        found.append(Prescription(f"grips.{number}", f"the {grip.edge} grip", grip.edge, grip.edge, components, travel, elongation, words))
    return found


def _of_entry(scene: Scene, number: int, label: str, span: tuple[float, float]) -> Prescription:
    """Return the prescription of an entry of `prescribed` for a programme over a span of the parameter."""
    entry, key = scene.prescribed[number], f"prescribed.{number}"
    values = np.array([value or 0.0 for value in entry.displacement[: scene.dimension]])
    components = prescribed_components(entry, scene.dimension)
    factor = partial(_factor, f"{key}.amplitude", amplitude_of(entry.amplitude), span)
    words = [f"x{number} = {value:g}" for number, value in enumerate(entry.displacement, 1) if value is not None]
    words += [] if entry.rotation is None else [f"turned by {entry.rotation:g} degrees"]
    about, axis = (None if place is None else np.array(place) for place in (entry.about, entry.axis))
    turn = (entry.rotation, about, axis)
    return Prescription(key, key, label, entry.region, components, values, factor, ", ".join(words), *turn)


def _factor(key: str, amplitude: Callable[[float], float], span: tuple[float, float], t: float) -> float:
    """Return the amplitude at t; raise InvalidState where it has no value.

    An amplitude may have no value beyond its programme, but a force with viscosity evaluates it slightly later: the amplitude is then
    continued at its last rate, so that parts that move at the end of the programme keep their velocity.
    """
    try:
        within = min(max(t, span[0]), span[1])
        return amplitude(t) if t == within else 2 * amplitude(within) - amplitude(2 * within - t)
    except ValueError as error:
        raise InvalidState(f"{key}: {error}") from None


def _labels(scene: Scene, regions: BodyRegions) -> list[str]:
    """Return the names under which results report forces of prescribed entries; raise ValueError if two regions share a name."""
    labels, owners = [], {}
    for kind in ("prescribed", "loads"):
        for number, entry in enumerate(getattr(scene, kind)):
            key = f"{kind}.{number}"
            labels.append(entry.name or regions.label(entry.region, key))
            other, region = owners.setdefault(labels[-1], (key, entry.region))
            if region != entry.region:
                one = f"{other} and {key} are on different regions and both called {labels[-1]!r}"
                raise ValueError(f"{one}; give one of them another name")
    return labels[: len(scene.prescribed)]
