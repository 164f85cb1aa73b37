"""Compilation of a scene into a problem: everything that a run needs, resolved once into points,
numbers and names.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..body import HALO, Body, Surface, divided
from ..body.local_fit import text_of
from ..discretization import (
    check_size,
    cuts_of,
    discretize,
    grip_areas,
    held_at_points,
    memory_here,
    surface_of,
)
from ..forces import (
    ForceModel,
    ForceSettings,
    InternalForce,
    InvalidState,
    MaterialPart,
    bind_portions,
)
from ..forces.interface_fits import SIGHT
from ..materials import Law
from ..ranks import ALONE, Communicator
from ..scenes import Scene
from ..scenes.amplitudes import amplitude_of
from ..scenes.loading_checks import criteria_give
from ..scenes.model import RIGID
from ..solvers.conditions import Loading
from ..solvers.loaded_force import LoadedForce
from ..solvers.rigid import RigidRegion
from .conditions import check_supports, conditions_of, warn_of_points
from .fracture import CriticalStretches, check_walls
from .fronts import Fronts
from .loads import loads_of
from .materials import (
    portions_of,
    scene_errors,
    settings_of,
    warn_of_bulk_moduli,
    warn_of_parts,
)
from .obstacles import bar_rigid_regions
from .program import (
    Measures,
    Prescription,
    Stage,
    check_durations,
    known_ends,
    measures_of,
    parameter_of,
    prescriptions_of,
    slow_stages,
    stages_of,
)
from .regions import BodyRegions
from .time_steps import check_dynamics, process_of

if TYPE_CHECKING:
    from .strength import Strengths


@dataclass(frozen=True)
class Problem:
    """Scene compiled for a run on this rank (one of several parallel processes, or the only one).

    Attributes
    ----------
    scene : Scene
        Scene that the results describe; the solvers do not read it.
    models : sequence of ForceModel
        Force model of the body outside the regions of the scene's `materials`, then one for each of
        these; empty if the problem is compiled without models, so that no force can be bound.
    settings : ForceSettings
        Choices for the evaluation of the force models.
    body : Body
        This rank's share of the body.
    whole : Body
        The whole body.
    regions : BodyRegions
    prescriptions : list of Prescription
    stages : tuple of Stage
    loading : Loading
    portions : list of MaterialPart
        Law, force model and points of every deformable material.
    rigid : dict of ndarray
        Points of the rigid regions, by name.
    measures : Measures
        Measures that results report.
    critical_stretches : CriticalStretches or None
        Stretches at which bonds break; None without fracture.
    strengths : Strengths or None
        Strengths of the materials; None if none has one.
    """

    scene: Scene
    models: Sequence[ForceModel]
    settings: ForceSettings
    body: Body
    whole: Body
    regions: BodyRegions
    prescriptions: list[Prescription]
    stages: tuple[Stage, ...]
    loading: Loading
    portions: list[MaterialPart]
    rigid: dict[str, np.ndarray]
    measures: Measures
    critical_stretches: CriticalStretches | None
    strengths: "Strengths | None"

    @cached_property
    def law(self) -> Law:
        """Return the material law of the body, except in regions of other materials."""
        return self.scene.law()

    @cached_property
    def fronts(self) -> Fronts:
        """Fronts of the cracks of the whole body."""
        return Fronts(
            self.scene, self.whole, cuts_of(self.scene, self.regions.lower, self.regions.upper)
        )

    @cached_property
    def held_at_points(self) -> dict[str, str]:
        """Return the outlines, holes and curved groups that are held at their points, by name,
        with the reason and what would help.
        """
        return held_at_points(self.scene, all(model.mirrors_curves for model in self.models))

    def describe(self) -> dict:
        """Return the entries of a run's summary that follow from the scene and the names of its
        force models.
        """
        units = self.scene.units
        found = {
            "scene": self.scene.name,
            "material": self.law.describe(),
            "support": self.scene.support,
            "held_at_points": self.held_at_points,
            "units": {**units.model_dump(), "force": units.force, "energy": units.energy},
            "grip_areas": self.measures.nominal_stress and self.measures.areas,
            "materials": [
                self._describe_part(number) for number in range(len(self.scene.materials))
            ],
        }
        return {key: value for key, value in found.items() if value}

    def bind(self, precision: str | None = None) -> tuple[InternalForce, LoadedForce]:
        """Return the internal force of the body, and the force with loads, supports and rigid
        regions with which solvers work.

        Parameters
        ----------
        precision : {"float32", "float64"}, optional
            Precision of the force in place of the scene's setting.

        Raises
        ------
        SceneError
            If the force models do not fit the body, or leave a point without support.
        """
        settings = (
            self.settings if precision is None else replace(self.settings, precision=precision)
        )
        with scene_errors(self.scene):
            force = bind_portions(self.body, self.portions, settings, _together(self.rigid))
            rigid = self._rigid_regions(force) if self.rigid else []
            loaded = LoadedForce(force, self.loading.loads, self.loading.supports, rigid)
            if force.portion_of is not None:
                warn_of_parts(self.scene, force, self.models[0].name, list(self.rigid))
            self._check_support(force)
        return force, loaded

    def changed(self, scene: Scene, models: Sequence[ForceModel]) -> "Problem":
        """Return the problem of a scene that differs in materials, loads or prescribed motions
        alone, on the same body, on one rank.
        """
        moved = any(
            getattr(scene, key) != getattr(self.scene, key)
            for key in ("loads", "prescribed", "obstacles")
        )
        if not moved and not len(self.loading.loads):  # loads and obstacles may depend on the laws
            with scene_errors(scene):
                portions, _, _ = portions_of(scene, self.body, models, self.regions)
            measures = measures_of(scene, self.measures.areas)
            return replace(self, scene=scene, models=models, portions=portions, measures=measures)
        regions = BodyRegions(
            scene, self.body, self.regions.lower, self.regions.upper, self.regions.surface
        )
        return _on_body(scene, models, self.whole, regions, ALONE, self.measures.areas)

    def reached(self, parameter: float) -> str:
        """Return the prescribed motions and loads at a value of the loading parameter, as text
        for messages.
        """
        found = [
            f"{one.key} to {words}"
            for one in self.prescriptions
            if (words := one.reached(parameter))
        ]
        for number, load in enumerate(self.scene.loads):
            size = np.array(getattr(load, load.kind)) * amplitude_of(load.amplitude)(parameter)
            found.append(
                f"loads.{number} to {load.kind} ="
                f" {np.array2string(size, precision=4, separator=', ')}"
            )
        for one in self.loading.loads.obstacles:
            if one.travel.any():
                found.append(
                    f"{one.name} moved by {text_of(one.amplitude(parameter) * one.travel)}"
                )
        return "; ".join(found)

    def _describe_part(self, number: int) -> dict:
        """Return the entry of a run's summary about an entry of `materials`: region, material,
        force model and critical stretch.
        """
        part = self.scene.materials[number]
        stretches = self.critical_stretches
        region = part.model_dump(mode="json", include={"region"}, exclude_none=True, by_alias=True)
        if part.material.rigid:
            return {**region, "material": {"law": RIGID}}
        found = {
            **region,
            "material": part.material.build().describe(),
            "force": self.models[number + 1].name,
        }
        return (
            found
            if stretches is None
            else {**found, "critical_stretch": stretches.of_materials[number + 1]}
        )

    def _rigid_regions(self, force: InternalForce) -> list[RigidRegion]:
        """Return the rigid regions of the body; raise ValueError for one that cannot move as
        prescribed, or that nothing holds.

        A region that is neither held nor bonded to a deformable material could be anywhere.
        """
        first = self.body.bonds.first
        second = self.body.bonds.second
        every = np.arange(len(self.body.all_points))
        rigid = np.isin(every, _together(self.rigid))
        for name, numbers in self.rigid.items():
            own = np.isin(every, numbers)
            pulls = (own[first] & ~rigid[second]) | (own[second] & ~rigid[first])
            if not pulls.any() and (self.loading.free[numbers] > 0).all():
                raise ValueError(
                    f"{name}: nothing holds this rigid region: it is not bonded to a deformable"
                    " material; hold it with prescribed, or join it with the region that it"
                    " touches"
                )
        regions = [
            RigidRegion(name, self.body, numbers, self.loading.free)
            for name, numbers in self.rigid.items()
        ]
        for value in sorted({0.0, *known_ends(self.stages)}):
            positions = self.body.points.copy()
            try:
                self.loading.hold(value, force, positions)
                for region in regions:
                    region.snap(positions)
            except InvalidState as error:
                raise ValueError(f"{self.loading.at(value)}: {error}") from None
        self.loading.hold(0.0, force, self.body.points.copy())
        return regions

    def _check_support(self, force: InternalForce) -> None:
        """Raise ValueError for points whose bonds lie on one line, or in one plane in a solid: they
        have no deformation gradient.

        Only a crack may leave points without a deformation gradient.
        """
        alone = np.flatnonzero(~force.supported & self.body.share.own)
        if len(alone):
            plane = self.body.dimension == 2
            where, what = ("on one line", "rows") if plane else ("in one plane", "layers")
            raise ValueError(
                f"body: the bonds of {len(alone)} of its points, the first at"
                f" {text_of(self.body.points[alone[0]])}, lie {where}; it needs at least two"
                f" {what} of points in {'either' if plane else 'every'} direction everywhere, at"
                f" the spacing {self.body.spacing:.4g}: use {self.body.finer}"
            )


def _together(rigid: dict[str, np.ndarray]) -> np.ndarray:
    """Return the points of all rigid regions in one array, from the points of each by name."""
    return np.concatenate([np.zeros(0, np.int64), *rigid.values()])


def compile_scene(
    scene: Scene, models: Sequence[ForceModel] = (), ranks: Communicator = ALONE
) -> Problem:
    """Compile a scene: resolve its body, regions, conditions, loads and materials.

    Parameters
    ----------
    scene : Scene
    models : sequence of ForceModel
        The models that `checked_models` returns for the scene; needed to bind a force.
    ranks : Communicator, optional
        Processes that share the run; by default this one alone.

    Raises
    ------
    SceneError
        If the body cannot be built, a region is empty, or the body is held or loaded in a way that
        has no solution; the message names the key.
    """
    if models:
        warn_of_bulk_moduli(scene)
    check_size(scene, memory_here() * ranks.size / ranks.here())
    whole: list[Body] = []

    def share_of(body: Body) -> Body:
        whole.append(body)
        return body if ranks.size == 1 else divided(body, ranks, SIGHT if scene.materials else HALO)

    # The body has this function, which therefore has no reference to the body: a cycle would keep
    # both in memory.
    made: list[Surface] = []

    def boundary(body: Body) -> np.ndarray | None:
        try:
            return surface_of_part(body).on_points(body.planes)
        except ValueError as error:  # such as of holes in three dimensions that meet
            warnings.warn(
                f"{error}; strain and stress near the boundary are less accurate: gradients are not"
                " balanced",
                stacklevel=2,
            )
            return None

    def surface_of_part(body: Body) -> Surface:
        if not made:
            made.append(surface_of(scene, undivided or body, lower, upper).of_share(body.share))
        return made[0]

    curves = all(model.mirrors_curves for model in models)
    # Bond forces do not know where in a cell the interface lies: they gain nothing by divided
    # cells.
    body, lower, upper = discretize(
        scene, share_of, curves, all(model.family == "bond energy" for model in models)
    )
    undivided = None if ranks.size == 1 else whole[0]
    vars(body)["boundary"] = boundary
    problem = _on_body(
        scene,
        models,
        whole[0],
        BodyRegions(scene, body, lower, upper, lambda: surface_of_part(body)),
        ranks,
    )
    if models:
        warn_of_points(scene, problem.held_at_points)
    return problem


def _on_body(
    scene: Scene,
    models: Sequence[ForceModel],
    whole: Body,
    regions: BodyRegions,
    ranks: Communicator,
    areas: dict[str, float] | None = None,
) -> Problem:
    """Return the problem of a scene on its discretized body: this rank's part with its regions,
    and the whole body; `areas` as of `grip_areas` if they are known.
    """
    body = regions.body
    stages = stages_of(scene)
    with scene_errors(scene):
        portions, rigid, of_points = (
            portions_of(scene, body, models, regions)
            if models
            else ([], {}, np.zeros(len(body), np.int64))
        )
        if rigid and ranks.size > 1:
            raise ValueError(
                "materials: rigid regions are supported on one rank only; run without mpiexec, or"
                " give the regions a law"
            )
        laws = [portion.law for portion in portions]
        check_durations(stages, laws)
        loads = loads_of(scene, body, regions, laws)
        prescriptions = prescriptions_of(scene, regions, stages, parameter_of(scene)[1])
        if areas is None:
            areas = grip_areas(scene, regions.lower, regions.upper)
        measures = measures_of(scene, areas)
        loading = conditions_of(
            scene, prescriptions, regions, loads, stages, _together(rigid), measures.nominal_stress
        )
        bar_rigid_regions(loading, rigid, known_ends(stages))
        body.share.clear(loading.free)  # points of the halo are moved by their owners
        if portions:
            softest = min(law.shear_modulus for law in laws)
            if scene.fracture:
                process = process_of(scene, loading, stages, softest)
                if process[0] == "quasi-static":
                    stages = slow_stages(scene, stages)
            check_dynamics(scene, loading, stages, softest)
        if portions or not scene.fracture:  # a picture does not know the process
            check_supports(loading, stages, measures.nominal_stress)
        for number, probe in enumerate(scene.probes):
            regions.check_place(f"probes.{number}.at", probe.at)
        critical = strengths = None
        if scene.fracture and portions:
            check_walls(scene, whole)
            critical = CriticalStretches(scene, scene.fracture, body, models[0].family, of_points)
            critical.say_process(*process)
            if criteria_give(scene, "strength"):
                from .strength import Strengths

                strengths = Strengths(scene, body, whole, loading, of_points)
    held = (regions, prescriptions, stages, loading)
    return Problem(
        scene,
        models,
        replace(settings_of(scene), paths=any(one.inertia is None for one in stages)),
        body,
        whole,
        *held,
        portions,
        rigid,
        measures,
        critical,
        strengths,
    )
