"""One simulation under way: what every part of its programme works on."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import astuple, dataclass, field
from functools import partial
from pathlib import Path
from typing import Protocol

import numba
import numpy as np

from ..body import Body
from ..discretisation import discretise, grip_areas, surface_of
from ..forces import ForceModel, ForceSettings, InternalForce, bind_portions
from ..kernels.threads import threads_for
from ..materials import Law
from ..results import measures
from ..results.checkpoint import Checkpoint
from ..results.states import Moment, States, StatesInFiles, StatesInMemory
from ..scenes import Scene, SceneError
from ..scenes.model import EDGES
from ..solvers.conditions import Loading
from ..solvers.reductions import LOCAL, LocalReductions
from ..solvers.regions import BodyRegions
from .interruption import Interruption
from .materials import models_of, portions_of


class Progress(Protocol):
    """Where a simulation reports to."""

    def compiling(self) -> None:
        """Kernels are being compiled, which happens once on a machine."""

    def level(self, number: int, stretch: float) -> None:
        """A level of the loading programme begins."""

    def residual(self, evaluations: int, residual: float, tolerance: float) -> None:
        """How far the level has come."""

    def dynamics(self, done: float, stretch: float, broken_bonds: int) -> None:
        """How far the dynamics have come, from 0 to 1."""


class Silent:
    """Progress that goes nowhere."""

    def compiling(self) -> None:
        """Say nothing."""

    def level(self, number: int, stretch: float) -> None:
        """Say nothing."""

    def residual(self, evaluations: int, residual: float, tolerance: float) -> None:
        """Say nothing."""

    def dynamics(self, done: float, stretch: float, broken_bonds: int) -> None:
        """Say nothing."""


@dataclass
class Run:
    """One simulation under way.

    Attributes
    ----------
    scene, model, progress
        What was asked for.
    folder : Path or None
        Where states and checkpoints are written as they are reached.
    threads : int or None
        Of the kernels; None for as many as pay for the body.
    law, body, loading, force
        What was built for it; the law is that of the rest where there are several materials.
    models : list of ForceModel
        Of the rest, then of `scene.materials`.
    grip_areas : dict of float
        Cross-section of the body at every grip, by edge.
    stress_grip : Grip
        The one whose force gives the nominal stress: that which travels further, of two that travel alike the right or top one.
    positions : ndarray, shape (n, 2)
    stretch, target : float
        At the positions; and of the level that is under way.
    critical_stretch : float or None
        Where bonds break, if they do.
    steps : int
        Of the dynamics.
    levels, history : list of dict
        Measures at every level; rows of the history.
    states : States
    residual : float or None
        Latest of the equilibrium iteration.
    crack : dict or None
        What the dynamics tell about a crack.
    interruption : Interruption
        Whether somebody wants it to stop.
    reductions : LocalReductions
        Of the body that is here.
    """

    scene: Scene
    model: ForceModel
    progress: Progress
    folder: Path | None = None
    threads: int | None = None
    stretch: float = 1.0
    target: float = 1.0
    critical_stretch: float | None = None
    steps: int = 0
    levels: list[dict] = field(default_factory=list)
    history: list[dict] = field(default_factory=list)
    residual: float | None = None
    crack: dict | None = None
    interruption: Interruption = field(default_factory=Interruption)
    reductions: LocalReductions = LOCAL

    def __post_init__(self) -> None:
        scene = self.scene
        self.law: Law = scene.material.build()
        self.models = [self.model, *models_of(scene, self.model)]
        self.body: Body
        self.body, lower, upper = discretise(scene)
        self._check_rate((upper - lower)[scene.loaded_axis])
        self.threads = self.threads or threads_for(len(self.body.bonds.first))
        settings = ForceSettings(scene.precision, scene.correction, scene.rotation, scene.outside, scene.fracture is not None)
        try:
            self.loading = Loading(scene, self.body, lower, upper, self.reductions)
            numba.set_num_threads(self.threads)
            self.force: InternalForce
            if scene.materials:
                regions = BodyRegions(scene, self.body, lower, upper, partial(surface_of, scene, self.body, lower, upper))
                self.force = bind_portions(self.body, portions_of(scene, self.body, self.models, regions), settings)
            else:
                self.force = self.model.bind(self.body, self.law, settings)
            self._check_support()
        except ValueError as error:
            raise SceneError(f"scene {scene.name}: {error}") from None
        self.grip_areas = grip_areas(scene, lower, upper)
        self.stress_grip = max(scene.grips, key=lambda grip: (grip.travel, EDGES[grip.edge][1]))
        self.positions = self.body.points.copy()
        self.states: States = StatesInMemory() if self.folder is None else StatesInFiles(self.folder, self.body.points, scene.name)

    def _check_rate(self, length: float) -> None:
        """Refuse grips that move apart faster than shear waves: what the body does then hangs on the motion that it is started with."""
        spec = self.scene.dynamics
        if spec is None:
            return
        laws = [self.law, *(part.material.build() for part in self.scene.materials)]
        speed, wave = spec.stretch_rate * length, math.sqrt(min(law.shear_modulus for law in laws) / spec.density)
        if speed > wave:
            unit = f"{self.scene.units.length}/{self.scene.units.time}"
            raise SceneError(
                f"scene {self.scene.name}: dynamics.stretch_rate: the grips would move apart at {speed:.4g} {unit}, faster than "
                f"shear waves at {wave:.4g} {unit}; the greatest rate is {wave / length:.4g}"
            )

    def _check_support(self) -> None:
        """Refuse points whose bonds lie on one line: only a crack may leave points without a deformation gradient."""
        alone = np.flatnonzero(~self.force.supported)
        if len(alone):
            x1, x2 = self.body.points[alone[0]]
            raise ValueError(
                f"body: the bonds of {len(alone)} of its points, the first at ({x1:.4g}, {x2:.4g}), lie on one line; the body needs two "
                f"rows of points or more in either direction everywhere, {self.body.spacing:.4g} apart"
            )

    def warm_up(self) -> None:
        """Compile everything before the clock of the evaluations starts."""
        self.force(self.positions, np.empty_like(self.positions))
        self.force.seconds, self.force.timed = 0.0, 0

    def strain_energy(self) -> float:
        """Stored energy per unit thickness in the state last evaluated, see `measures.strain_energy`."""
        return self.reductions.total_of_parts(measures.strain_energy(self.force))

    def unsupported_points(self) -> int:
        """How many points have too few bonds left for a deformation gradient."""
        return self.reductions.total_of_parts(int(np.count_nonzero(~self.force.supported)))

    def nominal_stress(self, reactions: np.ndarray) -> float:
        """Pull of one grip outwards along the loaded axis, over its own cross-section; see `Loading.reactions`."""
        grip = self.stress_grip
        axis, side = EDGES[grip.edge]
        return float(side * reactions[self.scene.grips.index(grip), axis] / self.grip_areas[grip.edge])

    def record(self, damage: np.ndarray | None = None, time: float = 0.0) -> None:
        """Record the present state: of the last level, or so long after it."""
        fields = measures.point_fields(measures.PointState(self.force, self.positions, damage))
        self.states.append(Moment(len(self.levels) + time, self.stretch, time), fields)

    @property
    def identity(self) -> dict:
        """What a checkpoint of this run must have in common with it."""
        return {
            "scene": self.scene.model_dump(mode="json"),
            "force": _name_and_digest(self.model),
            **({"forces_of_materials": [_name_and_digest(model) for model in self.models[1:]]} if self.scene.materials else {}),
            "n_points": len(self.body),
            "n_pairs": len(self.body.bonds.first),
        }

    def checkpoint(self, progress: dict, arrays: dict[str, np.ndarray]) -> None:
        """Write a checkpoint, if there is a folder for it."""
        if self.folder is None:
            return
        common = {
            "stretch": self.stretch,
            "levels": self.levels,
            "history": self.history,
            "moments": [astuple(moment) for moment in self.states.moments],
            "evaluations": self.force.evaluations,
            "outside": self.force.pairs_outside,
        }
        held = {"positions": self.positions, **self.force.state_arrays()}
        Checkpoint(self.identity, {**common, **progress}, {**held, **arrays}).write(self.folder)

    def restore(self) -> Checkpoint:
        """Take up what a checkpoint holds of everything but the dynamics."""
        held = {"positions": self.positions, **self.force.state_arrays()}
        found = Checkpoint.read(self.folder, self.identity, {key: (array.shape, array.dtype) for key, array in held.items()})
        progress = found.progress
        for key, array in held.items():
            array[:] = found.arrays[key]
        self.stretch, self.levels, self.history = progress["stretch"], progress["levels"], progress["history"]
        self.states = StatesInFiles(self.folder, self.body.points, self.scene.name, [Moment(*moment) for moment in progress["moments"]])
        self.force.evaluations, self.force.pairs_outside = progress["evaluations"], progress["outside"]
        return found


def _name_and_digest(model: ForceModel) -> list[str]:
    """What tells a force model from others."""
    return [model.name, _digest(model.payload())]


def _digest(payload) -> str:
    """Digest of the numbers of a learnt model."""

    def plain(value):
        if isinstance(value, np.ndarray):
            return [value.shape, hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
        if isinstance(value, dict):
            return {str(key): plain(item) for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [plain(item) for item in value]
        return value if isinstance(value, str | int | float | bool | None) else str(value)

    return hashlib.sha256(json.dumps(plain(payload), sort_keys=True).encode()).hexdigest()
