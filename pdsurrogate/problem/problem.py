"""The problem of a scene: everything that a run needs, resolved once into points, numbers and names."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from ..body import HALO, Body, Surface, divided
from ..discretisation import check_size, discretise, grip_areas, memory_here, surface_of
from ..forces import ForceModel, InternalForce, InvalidState, Portion, bind_portions
from ..forces.interfaces import SIGHT
from ..ranks import ALONE, Communicator
from ..scenes import Scene, SceneError, SolverSpec, Units
from ..scenes.amplitudes import amplitude_of
from ..solvers.conditions import Loading, place_of
from ..solvers.loads import LoadedForce, Loads
from ..solvers.rigid import RigidForce, RigidRegion
from .conditions import conditions_of, greatest_speed
from .fracture import critical_stretch_in
from .loads import loads_of
from .materials import portions_of, settings_of, warn_of_parts
from .measures import Measures, measures_of
from .programme import Inertia, Stage, stages_of
from .regions import BodyRegions


@dataclass(frozen=True)
class Problem:
    """A scene compiled for a run on this rank.

    Attributes
    ----------
    scene : Scene
        The scene, which results describe; what is below reads none.
    models : sequence of ForceModel
        Of the rest of the body, then of `scene.materials`; empty where no force is bound.
    body : Body
        This rank's share of the body.
    whole : Body
        The whole body.
    box : tuple of ndarray, shape (d,)
        Lower and upper corner of its bounding box.
    regions : BodyRegions
    stages : tuple of Stage
    loads : Loads or None
        None where the scene has none.
    loading : Loading
    portions : list of Portion
        Points of every material.
    rigid : dict of ndarray
        Points of the rigid regions, by name.
    areas : dict of float
        Cross-section of the body at every grip or reflected edge.
    measures : Measures
        Measures that results report.
    critical_stretch : float or None
        Stretch at which bonds break; None without fracture.
    """

    scene: Scene
    models: Sequence[ForceModel]
    body: Body
    whole: Body
    box: tuple[np.ndarray, np.ndarray]
    regions: BodyRegions
    stages: tuple[Stage, ...]
    loads: Loads | None
    loading: Loading
    portions: list[Portion]
    rigid: dict[str, np.ndarray]
    areas: dict[str, float]
    measures: Measures
    critical_stretch: float | None

    @property
    def units(self) -> Units:
        """Return the names of the units of the scene."""
        return self.scene.units

    @property
    def solver(self) -> SolverSpec:
        """Return the settings of the solution for equilibrium."""
        return self.scene.solver

    def bind(self, precision: str | None = None) -> tuple[InternalForce, InternalForce | LoadedForce | RigidForce]:
        """Return the internal force of the body, and the force that solvers work with: it has loads, supports and rigid regions.

        Parameters
        ----------
        precision : {"float32", "float64"}, optional
            Instead of the scene's.

        Raises
        ------
        SceneError
            If the force models do not fit the body, or leave a point without support.
        """
        settings = settings_of(self.scene)
        settings = settings if precision is None else replace(settings, precision=precision)
        with scene_errors(self.scene):
            if self.scene.materials:
                force = bind_portions(self.body, self.portions, settings, np.concatenate([np.zeros(0, np.int64), *self.rigid.values()]))
            else:
                force = self.models[0].bind(self.body, self.portions[0].law, settings)
            loaded = force
            if self.loads is not None or self.loading.supports is not None:
                loaded = LoadedForce(force, self.loads, self.loading.supports)
            if self.rigid:
                loaded = RigidForce(loaded, self._rigid_regions(force))
            if force.portion_of is not None:
                warn_of_parts(self.scene, force, self.models[0].name, list(self.rigid))
            self._check_support(force)
        return force, loaded

    def reached(self, parameter: float) -> str:
        """Return words for how far prescriptions and loads have come at a value of t; empty of stretches, which say it themselves."""
        found = []
        for number, entry in enumerate(self.scene.prescribed):
            factor = amplitude_of(entry.amplitude)(parameter)
            parts = [f"x{component} = {value * factor:.4g}" for component, value in enumerate(entry.displacement, 1) if value]
            parts += [f"rotation = {entry.rotation * factor:.4g}"] if entry.rotation else []
            if parts:
                found.append(f"prescribed.{number} to {', '.join(parts)}")
        for number, load in enumerate(self.scene.loads):
            size = np.array(getattr(load, load.kind)) * amplitude_of(load.amplitude)(parameter)
            found.append(f"loads.{number} to {load.kind} = {np.array2string(size, precision=4, separator=', ')}")
        return "; ".join(found)

    def _rigid_regions(self, force: InternalForce) -> list[RigidRegion]:
        """Return the rigid regions; refuse what is prescribed for them if no rigid body can do it."""
        self._check_rigid_are_bonded()
        regions = [RigidRegion(name, self.body, numbers, self.loading.free) for name, numbers in self.rigid.items()]
        for value in sorted({0.0, *(stage.to for stage in self.stages)}):
            positions = self.body.points.copy()
            try:
                self.loading.hold(value, force, positions)
                for region in regions:
                    region.snap(positions)
            except InvalidState as error:
                raise ValueError(f"{self.loading.at(value)}: {error}") from None
        self.loading.hold(0.0, force, self.body.points.copy())
        return regions

    def _check_rigid_are_bonded(self) -> None:
        """Refuse a rigid region that is neither held nor bonded to anything that is deformed: loads would carry it anywhere."""
        first, second = self.body.bonds.first, self.body.bonds.second
        rigid = np.zeros(len(self.body.all_points), dtype=bool)
        rigid[np.concatenate(list(self.rigid.values()))] = True
        for name, numbers in self.rigid.items():
            own = np.zeros(len(rigid), dtype=bool)
            own[numbers] = True
            pulls = (own[first] & ~rigid[second]) | (own[second] & ~rigid[first])
            if not pulls.any() and (self.loading.free[numbers] > 0).all():
                raise ValueError(
                    f"{name}: nothing holds this rigid region: no material that is deformed is bonded to it; hold it by prescribed, or "
                    "make it one region with what it touches"
                )

    def _check_support(self, force: InternalForce) -> None:
        """Refuse points whose bonds lie on one line, or in one plane: only a crack may leave points without a deformation gradient."""
        alone = np.flatnonzero(~force.supported & self.body.share.own)
        if len(alone):
            where = ("on one line", "two rows of points or more in either direction")
            if self.body.dimension == 3:
                where = ("in one plane", "two layers of points or more in every direction")
            raise ValueError(
                f"body: the bonds of {len(alone)} of its points, the first at {place_of(self.body, alone[0])}, lie {where[0]}; the body "
                f"needs {where[1]} everywhere, {self.body.spacing:.4g} apart: take {self.body.finer}"
            )


def compile_scene(scene: Scene, models: Sequence[ForceModel] = (), ranks: Communicator = ALONE) -> Problem:
    """Compile a scene: resolve its body, regions, conditions, loads and materials.

    Parameters
    ----------
    scene : Scene
    models : sequence of ForceModel, optional
        Of the rest of the body, then of `scene.materials`; needed to bind a force.
    ranks : Communicator, optional
        Processes that share the run.

    Raises
    ------
    SceneError
        If the body cannot be built, a region is empty, or the body is held or loaded in a way that has no solution; names the key.
    """
    check_size(scene, memory_here() * ranks.size / ranks.here())
    whole: list[Body] = []

    def share_of(body: Body) -> Body:
        whole.append(body)
        return body if ranks.size == 1 else divided(body, ranks, SIGHT if scene.materials else HALO)

    def surface() -> Surface:
        found = surface_of(scene, whole[0], *box)
        return found.of_share(body.share) if body.share.divided else found

    body, *corners = discretise(scene, share_of)
    box, stages = (corners[0], corners[1]), stages_of(scene)
    with scene_errors(scene):
        regions = BodyRegions(scene, body, *box, surface)
        loads = loads_of(scene, body, regions)
        portions, rigid = portions_of(scene, body, models, regions) if models else ([], {})
        if rigid and ranks.size > 1:
            raise ValueError("materials: rigid regions are taken on one rank only; run it without mpiexec, or give them a law")
        loading = conditions_of(scene, body, box, regions, loads, stages, rigid.values())
        body.share.clear(loading.free)  # points of the halo are moved by their owners
        if portions:
            _check_speeds(scene, loading, stages, min(portion.law.shear_modulus for portion in portions))
        for number, probe in enumerate(scene.probes):
            regions.check_place(f"probes.{number}.at", probe.at)
        areas = grip_areas(scene, *box)
        critical = critical_stretch_in(scene, portions[0].law, body.horizon, models[0].family) if scene.fracture and portions else None
    return Problem(
        scene=scene,
        models=models,
        body=body,
        whole=whole[0],
        box=box,
        regions=regions,
        stages=stages,
        loads=loads,
        loading=loading,
        portions=portions,
        rigid=rigid,
        areas=areas,
        measures=measures_of(scene, areas),
        critical_stretch=critical,
    )


@contextmanager
def scene_errors(scene: Scene) -> Iterator[None]:
    """Context in which errors of values are those of a scene, and name it."""
    try:
        yield
    except SceneError:
        raise
    except ValueError as error:
        raise SceneError(f"scene {scene.name}: {error}") from None


def _check_speeds(scene: Scene, loading: Loading, stages: tuple[Stage, ...], modulus: float) -> None:
    """Refuse held parts that move apart faster than the slowest shear waves: the result would depend on the motion at the start."""
    begin = loading.rest
    for stage in stages:
        if stage.inertia is not None:
            _check_speed(scene, stage.inertia, greatest_speed(loading, stage.inertia.motion(begin, stage.to)), modulus)
        begin = stage.to


def _check_speed(scene: Scene, inertia: Inertia, speed: float, modulus: float) -> None:
    units, wave = scene.units, math.sqrt(modulus / inertia.density)
    if speed <= wave:
        return
    if inertia.duration is None:
        what, slowest = "the grips", f"the greatest rate is {inertia.rate * wave / speed:.4g}"
    else:
        what, slowest = "parts that are held", f"the least duration is {units.amount(inertia.duration * speed / wave, 'time', '.4g')}"
    unit = f" {units.length}/{units.time}" if units.length and units.time else ""
    key = f"{inertia.key}.{inertia.pace}"
    raise ValueError(f"{key}: {what} would move apart at {speed:.4g}{unit}, faster than shear waves at {wave:.4g}{unit}; {slowest}")
