"""One simulation under way: what every part of its programme works on."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numba
import numpy as np

from ..body import Body, Surface
from ..discretisation import check_size, discretise, grip_areas, memory_here, surface_of
from ..engine.threads import threads_for
from ..forces import ForceModel, ForceSettings, InternalForce, InvalidState, bind_portions
from ..forces.interfaces import SIGHT
from ..materials import Law
from ..ranks import ALONE, HALO, Communicator, communicator, divided
from ..ranks.communicator import Alone
from ..results import measures
from ..results.checkpoint import Checkpoint, CheckpointError
from ..results.contents import Contents
from ..results.probes import Probes
from ..results.states import Moment, Moments, States, StatesInFiles, StatesInMemory, StatesInPieces
from ..scenes import Mesh, Scene, SceneError
from ..scenes.model import EDGES
from ..solvers.conditions import Loading, place_of
from ..solvers.grips import GripLoading
from ..solvers.loads import LoadedForce, Loads
from ..solvers.prescribed import PrescribedLoading
from ..solvers.regions import BodyRegions
from .interruption import Interruption
from .materials import check_fracture, models_of, portions_of, settings_of, warn_of_bulk_moduli, warn_of_parts
from .programme import Inertia, stages_of

if TYPE_CHECKING:
    from ..solvers.rigid import RigidRegion
    from .fracture import Damage
    from .levels import Way
    from .record import Record


ACCEPTED = "accepted_"
"""How the names of arrays in a checkpoint begin that are of the last equilibrium on the way to an output."""

MOST_GATHERED = 500_000
"""Points of a body on several ranks beyond which each of them writes its own piece of a state.  Gathered, a state of so many takes the
first rank 0.16 GB and 10 s of its processor, in which the others wait."""


SECONDS_BETWEEN_CHECKPOINTS = 30.0
"""Of stages in dynamics, and on the way to an output in equilibrium."""

CHECKPOINT_SHARE = 20
"""Of the time that writing a checkpoint took, at least as many go by before the next."""


@runtime_checkable
class Progress(Protocol):
    """Receiver of the progress of a simulation."""

    def compiling(self) -> None:
        """Kernels are being compiled, which happens once on a machine."""

    def level(self, number: int, parameter: float) -> None:
        """The way to an output in equilibrium begins, in a stage of the programme, at a value of the loading parameter."""

    def residual(self, evaluations: int, residual: float, tolerance: float) -> None:
        """Report the residual of a level."""

    def dynamics(self, done: float, parameter: float, broken_bonds: int) -> None:
        """Report the share of a stage in dynamics that is done, from 0 to 1."""

    def account(self, steps: int, kinetic_energy: float, strain_energy: float) -> None:
        """Report the row that a stage in dynamics adds to the history."""


class Silent:
    """Progress that goes nowhere."""

    def compiling(self) -> None:
        """Say nothing."""

    def level(self, number: int, parameter: float) -> None:
        """Say nothing."""

    def residual(self, evaluations: int, residual: float, tolerance: float) -> None:
        """Say nothing."""

    def dynamics(self, done: float, parameter: float, broken_bonds: int) -> None:
        """Say nothing."""

    def account(self, steps: int, kinetic_energy: float, strain_energy: float) -> None:
        """Say nothing."""


def loading_of(
    scene: Scene,
    body: Body,
    lower: np.ndarray,
    upper: np.ndarray,
    regions: BodyRegions,
    loads: Loads | None,
    rigid: Iterable[np.ndarray] = (),
) -> Loading:
    """Return the conditions of a scene on its body; see `GripLoading` and `PrescribedLoading` for what is refused."""
    if scene.stretched:
        return GripLoading(scene, body, lower, upper)
    modulus = 1.0 if scene.material is None else scene.law().shear_modulus  # a picture of a scene without a material needs none
    return PrescribedLoading(scene, body, lower, upper, regions, loads, modulus, *rigid)


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
    law, body, regions, loading, force
        What was built for it; the law is that of the rest where there are several materials.
    models : list of ForceModel
        Of the rest, then of `scene.materials`.
    loads : Loads or None
        None where the scene has none.
    loaded : InternalForce or LoadedForce
        The force with the loads, which is what solvers are given; without loads the force itself.
    grip_areas : dict of float
        Cross-section of the body at every grip or reflected edge.
    stress_grip : Grip or None
        The one whose force gives the nominal stress: that which travels further, of two that travel alike the right or top one.
    positions : ndarray, shape (n, d)
    parameter, target : float
        Loading parameter at the positions; and of the output that is under way.
    stages : tuple of Stage
        The programme.
    stage, outputs : int
        Number of the stage that is under way, and how many of its outputs are there.
    begin : float
        Loading parameter where that stage began.
    greatest_drive : float
        What drove the body (`Equilibrium.drive`) in the outputs so far, at most.
    wasted : int
        Evaluations of increments that failed.
    elapsed : float
        Time that earlier stages in dynamics took.
    damage : Damage or None
        None where the scene has no fracture: then there is nothing of it here.
    velocities : ndarray, shape (n, d), or None
        With which a stage in dynamics ended; None after equilibrium.
    earlier : tuple of float and ndarray, or None
        The equilibrium before the last: its parameter and positions; of a loading that is `adaptive`.
    way : Way or None
        To the output that is under way in equilibrium, of a run that goes on from a checkpoint there.
    record_of_folder : Record or None
        What keeps the tables of a run in its folder.
    resumable : bool
        Whether there is a checkpoint of it.
    critical_stretch : float or None
        Where bonds break, if they do.
    steps : int
        Of the dynamics.
    levels, history, convergence : list of dict
        Measures at every level; rows of the history; what the search for equilibrium went through.
    states : States
    residual : float or None
        Latest of the equilibrium iteration.
    crack : dict or None
        What the dynamics tell about a crack.
    dynamics : list of dict
        What is told of every stage in dynamics: its viscosity and its account of energy.
    beyond_data : list of dict
        Of every recorded state of an energy from test data, which share of the bonds is beyond them, and how far the farthest.
    interruption : Interruption
        Whether somebody wants it to stop.
    ranks : Alone or Communicator
        The processes that share the run.
    whole : Body or None
        The whole body, for results; of a run on several ranks on the first of them alone, where nobody asks for its bonds.
    """

    scene: Scene
    model: ForceModel
    progress: Progress
    folder: Path | None = None
    threads: int | None = None
    critical_stretch: float | None = None
    steps: int = 0
    levels: list[dict] = field(default_factory=list)
    history: list[dict] = field(default_factory=list)
    convergence: list[dict] = field(default_factory=list)
    residual: float | None = None
    crack: dict | None = None
    dynamics: list[dict] = field(default_factory=list)
    beyond_data: list[dict] = field(default_factory=list)
    interruption: Interruption = field(default_factory=Interruption)
    ranks: Alone | Communicator = ALONE

    def __post_init__(self) -> None:
        scene = self.scene
        self.ranks = communicator()
        self.stages = stages_of(scene)
        self.stage, self.outputs, self.wasted, self.elapsed, self.greatest_drive = 0, 0, 0, 0.0, 0.0
        self.damage: Damage | None = None
        self.velocities: np.ndarray | None = None
        self.earlier: tuple[float, np.ndarray] | None = None
        self.way: Way | None = None
        self.record_of_folder: Record | None = None
        self.resumable, self._late = False, time.monotonic() + SECONDS_BETWEEN_CHECKPOINTS
        self.law: Law = scene.law()
        check_fracture(scene, self.model)
        warn_of_bulk_moduli(scene)
        self.models = [self.model, *models_of(scene, self.model)]
        self.contents = Contents.of(scene, self.models)
        self.body: Body
        self.whole: Body | None
        check_size(scene, memory_here() * self.ranks.size / self.ranks.here())
        self.body, lower, upper = discretise(scene, self._part_of)
        self.regions = BodyRegions(scene, self.body, lower, upper, lambda: self._surface(lower, upper))
        paying = threads_for(len(self.body.bonds.first))
        if self.ranks.size > 1:
            from .sharing import threads_of  # of which a run of one process has no need

            self.threads = threads_of(self.ranks, self.threads, paying)
        self.threads = self.threads or paying
        settings = settings_of(scene)
        try:
            self.loads = Loads(scene, self.body, self.regions) if scene.loads else None
            self._portions, self._rigid = portions_of(scene, self.body, self.models, self.regions) if scene.materials else ([], {})
            if self._rigid and self.ranks.size > 1:
                raise ValueError("materials: rigid regions are taken on one rank only; run it without mpiexec, or give them a law")
            rigid = self._rigid.values()
            self.loading = loading_of(scene, self.body, lower, upper, self.regions, self.loads, rigid)
            self.body.share.clear(self.loading.free)  # what others own they move
            self._check_speeds()
            numba.set_num_threads(self.threads)
            if self.ranks.size > 1:
                from .sharing import compile_first  # of which a run of one process has no need

                compile_first(self.ranks, self.model, self.law, settings, scene.dimension)
            self._bind(settings)
            if self.force.portion_of is not None:
                warn_of_parts(scene, self.force, self.model.name, list(self._rigid))
            self._check_support()
            for number, probe in enumerate(scene.probes):
                self.regions.check_place(f"probes.{number}.at", probe.at)
            self.probes = Probes(self.whole, scene.probes, self._portion_of(), self.body.share)
        except ValueError as error:
            raise SceneError(f"scene {scene.name}: {error}") from None
        if self.ranks.rank:
            self.whole = None
        self.grip_areas = grip_areas(scene, lower, upper)
        self.stress_grip = max(scene.grips, key=lambda grip: (grip.travel, EDGES[grip.edge][1]), default=None)
        self.parameter = self.target = self.begin = self.loading.rest
        self.positions = self.body.points.copy()
        self.states = self._states()

    def _bind(self, settings: ForceSettings) -> None:
        """Bind the force models to the body."""
        self.force: InternalForce
        if self.scene.materials:
            rigid = np.concatenate([np.empty(0, dtype=np.int64), *self._rigid.values()])
            self.force = bind_portions(self.body, self._portions, settings, rigid)
        else:
            self.force = self.model.bind(self.body, self.law, settings)
        self.loaded = self.force
        if self.loads is not None or self.loading.supports is not None:
            self.loaded = LoadedForce(self.force, self.loads, self.loading.supports)
        if self._rigid:
            from ..solvers.rigid import RigidForce  # of which a scene without rigid regions has no need

            self.loaded = RigidForce(self.loaded, self._rigid_regions(self._rigid))

    def takes_double(self) -> bool:
        """Return whether the force models can be evaluated in double instead of single precision."""
        if self.scene.precision is not None or self.force.precision == "float64":
            return False
        return all("float64" in model.honoured(self.scene.plane)["precision"] for model in self.models)

    def take_double(self) -> None:
        """Evaluate the force models in double precision from here on."""
        old = self.force
        self._bind(replace(settings_of(self.scene), precision="float64"))
        for key, array in self.force.state_arrays().items():
            array[:] = old.state_arrays()[key]
        if self.damage is not None and self.body.share.any(bool(self.damage.broken.any())):
            self.force.break_bonds(np.flatnonzero(self.damage.broken))
        self.force.evaluations, self.force.pairs_outside = old.evaluations, old.pairs_outside
        self.force.seconds, self.force.timed = old.seconds, old.timed

    def _states(self, moments: list[Moment] | None = None) -> States:
        """Return the storage of states, with the recorded ones where the run is resumed."""
        if self._in_pieces:
            return StatesInPieces(self.folder, self.body, self.scene.name, moments)
        if self.ranks.rank:
            return Moments(moments)
        return StatesInMemory() if self.folder is None else StatesInFiles(self.folder, self.whole, self.scene.name, moments)

    @property
    def _in_pieces(self) -> bool:
        """Return whether every rank writes the states of its own points, as for bodies that are too large for one rank to write."""
        large = self.body.share.size(len(self.body)) > MOST_GATHERED
        return large and self.ranks.size > 1 and self.folder is not None and not isinstance(self.scene.body, Mesh)

    def _surface(self, lower, upper) -> Surface:
        """Return the boundary of the body, whose interpolation the points of all ranks share."""
        surface = surface_of(self.scene, self.whole, lower, upper)
        return surface.of_share(self.body.share) if self.body.share.divided else surface

    def _part_of(self, body: Body) -> Body:
        """Return this rank's share of the whole body."""
        self.whole = body
        if self.ranks.size == 1:
            return body
        return divided(body, self.ranks, SIGHT if self.scene.materials else HALO)

    def _portion_of(self) -> np.ndarray | None:
        """Material of every point of the whole body; None where there is one."""
        if self.force.portion_of is None:
            return None
        found = self.force.portion_of[: len(self.body)]
        return self.ranks.to_all(self.body.share.gather(found))

    @property
    def _least_modulus(self) -> float:
        """Shear modulus of the material in which shear waves are slowest."""
        laws = self.law, *(part.material.build() for part in self.scene.materials if not part.rigid)
        return min(law.shear_modulus for law in laws)

    def _rigid_regions(self, points: dict[str, np.ndarray]) -> list[RigidRegion]:
        """The rigid regions, of which everything that is prescribed is what one body can do."""
        from ..solvers.rigid import RigidRegion

        self._check_rigid_are_bonded(points)
        regions = [RigidRegion(name, self.body, numbers, self.loading.free) for name, numbers in points.items()]
        ends = sorted({0.0, *(stage.to for stage in self.stages)})
        for value in ends:
            positions = self.body.points.copy()
            try:
                self.loading.hold(value, self.force, positions)
                for region in regions:
                    region.snap(positions)
            except InvalidState as error:
                raise ValueError(f"{self.loading.at(value)}: {error}") from None
        self.loading.hold(0.0, self.force, self.body.points.copy())
        return regions

    def _check_rigid_are_bonded(self, points: dict[str, np.ndarray]) -> None:
        """Refuse a rigid region that is neither held nor bonded to anything that is deformed: loads would carry it anywhere."""
        bonds = self.body.bonds
        rigid = np.zeros(len(self.body.all_points), dtype=bool)
        rigid[np.concatenate(list(points.values()))] = True
        for name, numbers in points.items():
            own = np.zeros(len(rigid), dtype=bool)
            own[numbers] = True
            first, second = bonds.first, bonds.second
            pulls = (own[first] & ~rigid[second]) | (own[second] & ~rigid[first])
            if not pulls.any() and (self.loading.free[numbers] > 0).all():
                raise ValueError(
                    f"{name}: nothing holds this rigid region: no material that is deformed is bonded to it; hold it by prescribed, or "
                    "make it one region with what it touches"
                )

    def _check_speeds(self) -> None:
        """Refuse held parts that move apart faster than shear waves: what the body does then hangs on the motion it is started with."""
        begin = self.loading.rest
        for stage in self.stages:
            if stage.inertia is not None:
                self._check_speed(stage.inertia, self.loading.greatest_speed(stage.inertia.motion(begin, stage.to)))
            begin = stage.to

    def _check_speed(self, inertia: Inertia, speed: float) -> None:
        units, wave = self.scene.units, math.sqrt(self._least_modulus / inertia.density)
        if speed <= wave:
            return
        if inertia.duration is None:
            what, slowest = "the grips", f"the greatest rate is {inertia.rate * wave / speed:.4g}"
        else:
            what, slowest = "parts that are held", f"the least duration is {units.amount(inertia.duration * speed / wave, 'time', '.4g')}"
        unit = f" {units.length}/{units.time}" if units.length and units.time else ""
        raise ValueError(
            f"{inertia.key}.{inertia.pace}: {what} would move apart at {speed:.4g}{unit}, faster than shear waves at {wave:.4g}{unit}; "
            f"{slowest}"
        )

    def _check_support(self) -> None:
        """Refuse points whose bonds lie on one line, or in one plane: only a crack may leave points without a deformation gradient."""
        alone = self.body.share.own_points(np.flatnonzero(~self.force.supported))
        if len(alone):
            where = ("on one line", "two rows of points or more in either direction")
            if self.body.dimension == 3:
                where = ("in one plane", "two layers of points or more in every direction")
            raise ValueError(
                f"body: the bonds of {len(alone)} of its points, the first at {place_of(self.body, alone[0])}, lie {where[0]}; the body "
                f"needs {where[1]} everywhere, {self.body.spacing:.4g} apart: take {self.body.finer}"
            )

    def warm_up(self) -> None:
        """Compile everything before the clock of the evaluations starts."""
        self.force(self.positions, np.empty_like(self.positions))
        self.force.seconds, self.force.timed = 0.0, 0

    def strain_energy(self) -> float:
        """Stored energy per unit thickness in the state last evaluated, see `measures.strain_energy`."""
        return self.body.share.total(measures.strain_energy(self.force))

    def unsupported_points(self) -> int:
        """Return the number of points that have too few bonds left for a deformation gradient."""
        return self.body.share.total(len(self.body.share.own_points(np.flatnonzero(~self.force.supported))))

    def nominal_stress(self, forces: np.ndarray) -> float:
        """Pull of one grip outwards along the loaded axis, over its own cross-section, by the forces (2, d) of the grips."""
        grip = self.stress_grip
        axis, side = EDGES[grip.edge]
        return float(side * forces[self.scene.grips.index(grip), axis] / self.grip_areas[grip.edge])

    def record(self, time: float = 0.0) -> None:
        """Record the present state: of the last equilibrium, or so long after the beginning of the stage in dynamics."""
        damage = None if self.damage is None else self.damage.at_points()
        fields = measures.point_fields(measures.PointState(self.force, self.positions, damage))
        if not self._in_pieces:
            fields = {name: self.body.share.gather(values) for name, values in fields.items()}
        equilibria, since = sum("time" not in level for level in self.levels), self.elapsed + time
        moment = Moment(equilibria + since, self.parameter, since)
        self._tell_beyond_data(moment)
        self.states.append(moment if self.scene.stretched else Moment(moment.run_time, None, since, self.parameter), fields)
        if self.record_of_folder is not None:
            self.record_of_folder.state()

    def _tell_beyond_data(self, moment: Moment) -> None:
        """Count the bonds, or of an energy the points, that are beyond the test data that the force was learnt from."""
        beyond = self.force.learnt.beyond_data()
        if beyond is None:
            return
        total, outside = (self.body.share.total(int(count)) for count in (len(beyond), np.count_nonzero(beyond > 0)))
        farthest = self.body.share.greatest(float(beyond.max(initial=0.0)))
        row = {"run_time": moment.run_time, self.loading.parameter: self.parameter}
        self.beyond_data.append(row | {"share": outside / max(total, 1), "log_stretch": farthest})

    @property
    def identity(self) -> dict:
        """Return the identity that a checkpoint of this run must have."""
        return {
            **self.contents.describe(),
            "n_points": self.body.share.size(len(self.body)),
            "n_pairs": self.body.share.total(self.counted_pairs()),
        }

    def counted_pairs(self) -> int:
        """Return the number of pairs that this rank counts; all of them in one process."""
        counted = self.body.share.counted_pairs(self.body.bonds.first)
        return len(self.body.bonds.first) if counted is None else int(np.count_nonzero(counted))

    def directed_bonds(self) -> int:
        """Directed bonds within the body of the points that are counted here."""
        bonds, n = self.body.bonds, len(self.body)
        if not self.body.share.divided:
            return bonds.n_directed
        owners = np.repeat(np.arange(n), np.diff(bonds.pointers).astype(np.int64))
        return int(np.count_nonzero(self.body.share.own[owners] & (bonds.neighbours < n)))

    def checkpoint(self, progress: dict, arrays: dict[str, np.ndarray]) -> None:
        """Write a checkpoint, if there is a folder for it."""
        if self.folder is None:
            return
        began = time.monotonic()
        share = self.body.share
        common = {
            "parameter": self.parameter,
            "stage": self.stage,
            "outputs": self.outputs,
            "begin": self.begin,
            "elapsed": self.elapsed,
            "crack": self.crack,
            "dynamics_told": self.dynamics,
            "earlier": None if self.earlier is None else self.earlier[0],
            "levels": self.levels,
            "history": self.history,
            "convergence": self.convergence,
            "beyond_data": self.beyond_data,
            "moments": [astuple(moment) for moment in self.states.moments],
            "evaluations": self.force.evaluations,
            "precision": self.force.precision,
            "greatest_drive": self.greatest_drive,
            "wasted": self.wasted,
            "outside": self.body.share.total(self.force.pairs_outside),
        }
        held = {"positions": self.positions, **self.force.state_arrays(), **arrays}
        if self.earlier is not None:
            held["earlier"] = self.earlier[1]
        # In the order of the whole body, so that any number of ranks can go on from it.
        if self.damage is not None:
            held["broken"] = self.damage.broken
        whole = {key: share.to_whole(array, self.body, self._rows_of(key)) for key, array in held.items()}
        kept = Checkpoint(self.identity, {**common, **progress}, whole)
        if self.ranks.rank == 0:
            kept.write(self.folder)
        ended = time.monotonic()
        self.resumable, self._late = True, ended + max(SECONDS_BETWEEN_CHECKPOINTS, CHECKPOINT_SHARE * (ended - began))

    @property
    def late(self) -> bool:
        """Return whether a checkpoint is due."""
        return self.folder is not None and time.monotonic() >= self._late

    def restore(self) -> Checkpoint:
        """Take up what a checkpoint holds of everything but what moves a stage in dynamics."""
        held = {"positions": self.positions, **self.force.state_arrays()}
        found = self._read_checkpoint(held)
        progress = found.progress
        if progress["precision"] != self.force.precision:
            self.take_double()
            held |= self.force.state_arrays()
        for key, array in held.items():
            array[:] = found.arrays[key]
        self.parameter, self.levels = progress["parameter"], progress["levels"]
        self.history, self.convergence, self.beyond_data = progress["history"], progress["convergence"], progress["beyond_data"]
        self.stage, self.outputs = progress["stage"], progress["outputs"]
        self.begin, self.elapsed, self.crack = progress["begin"], progress["elapsed"], progress["crack"]
        self.greatest_drive, self.wasted = progress["greatest_drive"], progress["wasted"]
        self.dynamics = progress["dynamics_told"]
        if progress["earlier"] is not None:
            self.earlier = progress["earlier"], found.arrays["earlier"].copy()
        self.states = self._states([Moment(*moment) for moment in progress["moments"]])
        if self.damage is not None:
            pairs = np.flatnonzero(found.arrays["broken"])
            if self.body.share.any(len(pairs) > 0):
                self.damage.break_bonds(pairs)
                self.force.break_bonds(pairs)
        self.resumable = True
        self.force.evaluations, self.force.pairs_outside = progress["evaluations"], 0 if self.ranks.rank else progress["outside"]
        return found

    def _read_checkpoint(self, held: dict[str, np.ndarray]) -> Checkpoint:
        """Read a checkpoint on the first rank and return every rank's rows of it; the present arrays give the names of those required."""
        body, share, identity = self.body, self.body.share, self.identity
        counts = {key: share.rows_of_whole(len(array), body, self._rows_of(key)) for key, array in held.items()}
        shapes = {key: ((counts[key], *array.shape[1:]), array.dtype) for key, array in held.items()}
        if not share.divided:
            return Checkpoint.read(self.folder, identity, shapes)
        whole = error = None
        if self.ranks.rank == 0:
            try:
                whole = Checkpoint.read(self.folder, identity, shapes)
            except CheckpointError as found:
                error = found
        share.agree(error)
        progress, keys = self.ranks.to_all(whole and (whole.progress, list(whole.arrays)))
        arrays = {key: share.from_whole(whole and whole.arrays[key], body, self._rows_of(key)) for key in keys}
        return Checkpoint(identity, progress, arrays)

    def _rows_of(self, key: str) -> str:
        """Return what an array of a checkpoint has a row for, see `Share.to_whole`."""
        return "pairs" if key == "broken" else self.force.state_rows.get(key.removeprefix(ACCEPTED), "points")
