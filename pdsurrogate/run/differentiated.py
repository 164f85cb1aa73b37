"""Body of a scene whose measurements in equilibrium are functions of the parameters of the scene:
their rates by differences (theory, section 23).
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace

import numpy as np

from ..body import Following, fields_at
from ..engine.threads import thread_count
from ..forces import ForceModel, InternalForce
from ..materials.covariance import with_numbers_of
from ..problem import compile_scene
from ..scenes import Scene
from ..scenes.reading import leaves
from ..solvers.bond_strains import strain_rounding
from ..solvers.control import ControlledForce
from ..solvers.reactions import internal_forces
from ..solvers.tangent import COARSE, FINE, central_difference
from .parameters import array_of, laws_of, numbers_in, with_numbers
from .rows import output_row
from .system import System, bound

STEP = 1e-6
STEP_OF_LAWS = 1e-4
"""Changes of parameters in central differences, relative to the value or to the greatest number of
a list or an array; the second one of numbers of laws. Chosen: where a support moves by the first
part of its displacement, while the points beside it stay, and where a number of a network far below
the greatest one changes, curvature leaves relative errors below 1e-6, elsewhere below 1e-9. In
numbers of laws, forces are linear or weakly curved: the second step leaves 2e-8 for an exponent of
5, and 1e-6 at nine tenths of the limit of a Gent law. Rounding leaves errors of 1e-12 times the
forces over those that the number causes: K/mu for a bulk modulus, 1e4 for a term with 1e-4 of the
stress.
"""

LEAST_STEP = 1e-8
"""Least change of the coefficient of a term, relative to the greatest one: rounding and
curvature leave relative errors of this size.
"""

QUICK = re.compile(r"(forces|places)\..*|nominal_stress|energy|probes\..+\.displacement\.\d")
"""Names of measurements that `output_row` takes without the costly ones, and of those that need
displacements alone.
"""

BALANCED = 1e-10
"""Residual, in units of shear modulus / spacing, of the equilibrium whose derivatives are
computed.
"""

ROUNDED_STRAIN = 4.0
"""Least residual of this equilibrium, divided by K/mu times the strain of a bond by rounding of the
positions. Chosen: residuals at which Newton's method ends for K/mu of 1e5 and 1e6, where they
exceed `BALANCED`, are 0.8 and 0.5 of these.
"""

STIFF = 300.0
"""K/mu of nearly incompressible bodies beyond which differences are of fourth order, over wider
steps. At this K/mu, differences of second order have errors of 3e-8.
"""

CAREFUL = 1e-4
"""Greatest displacement of a point, in spacings, in differences of fourth order with obstacles:
wider steps would change contacts.
"""

WIDER = 10.0
"""Steps of parameters in differences of fourth order, divided by those of central ones."""

ROUNDED = 1e-15
"""Norm of the rounding errors of forces, divided by the norm of the forces."""


@dataclass(frozen=True)
class Change:
    """Rates at which a parameter changes an equilibrium while the free components do not move, or
    move at given rates.

    Attributes
    ----------
    name : str
        Name of the parameter.
    moved : ndarray, shape (n, d)
        Derivative of the displacements of held parts.
    forces : ndarray, shape (n, d)
        Derivative of the forces.
    pushes : ndarray, shape (places, obstacles)
        Derivative of the forces of obstacles at places.
    measured : ndarray, shape (measurements,)
        Derivatives of the measurements.
    history : ndarray
        Derivative of the history that contains the equilibrium, flat.
    step : float
        Change of the parameter in differences.
    rounding : float
        Norm of the rounding errors of `forces`.
    """

    name: str
    moved: np.ndarray
    forces: np.ndarray
    pushes: np.ndarray
    measured: np.ndarray
    history: np.ndarray
    step: float
    rounding: float


@dataclass(frozen=True)
class Differentiated:
    """Scene on a body that is built once, whose equilibria are solved and differentiated by
    parameters, in double precision on one rank.

    Attributes
    ----------
    system : System
        Body of the scene in the present state.
    numbers : dict of float
        Values of the possible parameters by name: numbers of the scene below `PLACES`, and numbers
        of the arrays of learned models, such as ``"force.output_weights.3"`` or, for the model of a
        region, ``"materials.0.force.coefficients.0.2.1"``.
    at_places : Following or None
        Map from the displacements of the points to those at places that are measured besides the
        outputs.
    control : str or None
        Key of the displacement that the step of the equilibrium controls, so that the loading
        parameter t is an unknown.
    history : dict of ndarray or None
        By parameter, the derivatives of the history from which the step of the equilibrium begins,
        flat; None for a body that does not remember.
    """

    system: System
    numbers: dict[str, float]
    at_places: Following | None = None
    control: str | None = None
    history: dict[str, np.ndarray] | None = None

    def moved_places(self, displacements: np.ndarray, parameter: float) -> np.ndarray:
        """Return the displacements (k, d) at places that are measured, from those of the points
        (n, d) at a value of the loading parameter.
        """
        if self.at_places is None:
            return np.empty((0, displacements.shape[1]))
        loading = self.system.loading
        planes = loading.planes_at(parameter) - loading.loads.at_rest
        return self.at_places(displacements, planes)

    def changed(self, values: Mapping[str, float]) -> "Differentiated":
        """Return the scene with other values of parameters, by name, on the same body."""
        problem = self.system.problem
        at = self.system.state.parameter
        system = self.system.beside(*with_numbers(problem.scene, problem.models, values), at)
        return replace(self, system=system, numbers=self.numbers | values)

    @property
    def balanced(self) -> float:
        """Residual of the equilibria that are differentiated."""
        return max(BALANCED, self.rounded)

    @property
    def rounded(self) -> float:
        """Residual that rounding of the positions leaves, in the unit of `balanced`."""
        rounding = strain_rounding(self.system.body, self.system.positions)
        return ROUNDED_STRAIN * self.contrast * rounding

    @property
    def contrast(self) -> float:
        """Greatest K/mu of the materials of a nearly incompressible body, else 1."""
        force = self.system.force
        return (
            max(law.bulk_modulus / law.shear_modulus for law, _ in force.laws)
            if force.nearly_incompressible
            else 1.0
        )

    @property
    def width(self) -> float:
        """Greatest displacement of a point in differences of forces, in spacings; beyond
        `COARSE` they are of fourth order.
        """
        if self.contrast <= STIFF:
            return COARSE
        return CAREFUL if self.system.loads.obstacles else FINE

    @property
    def fine(self) -> bool:
        """Whether differences are of fourth order."""
        return self.width > COARSE

    def evaluated(self, positions: np.ndarray) -> tuple[dict[str, float], np.ndarray]:
        """Return the measurements at given positions (n, d), by dotted key, with the displacements
        at places as the last ones; and the forces (n, d).
        """
        with self._remembering(self.system.force):
            forces = _forces(self.system, positions)[1]
            self.accepted()
            return self._read(), forces

    @contextmanager
    def _remembering(
        self, force: InternalForce, name: str = "", way: float = 0.0
    ) -> Iterator[None]:
        """Give a force the history at a parameter that is changed by `way`, until the end of a
        ``with`` block, which may accept a state.
        """
        if self.history is None:
            yield
            return
        own = self.system.force
        elapsed = own.elapsed, own.before
        begin = _history_of(own)
        _remember(force, begin + way * self.history.get(name, 0.0), elapsed)
        try:
            yield
        finally:
            _remember(own, begin, elapsed)

    def accepted(self) -> np.ndarray:
        """Add the state last evaluated to the history, and return this, flat; empty for a body
        that does not remember.
        """
        if self.history is None:
            return np.empty(0)
        self.system.force.accept(self.system.positions)
        return _history_of(self.system.force)

    def _read(self, costly: bool = True) -> dict[str, float]:
        """Return the measurements where the force was last evaluated, see `evaluated`; `costly`
        as for `output_row`.
        """
        system = self.system
        displacements = self.system.positions - self.system.body.points
        probes = system.probes.displacements(displacements, system.loads.planes_moved)
        row = {"probes": probes} | output_row(system, costly=costly)
        found = {key: value for key, value in leaves(row) if isinstance(value, float)}
        moved = self.moved_places(displacements, system.state.parameter)
        return found | {
            f"places.{place}.{axis}": float(u)
            for place, each in enumerate(moved)
            for axis, u in enumerate(each)
        }

    def change_by(
        self,
        name: str,
        names: Sequence[str] = (),
        moved: np.ndarray | None = None,
        pushes: np.ndarray | float = 0.0,
    ) -> Change:
        """Return the rates at which a parameter changes the equilibrium and the measurements
        `names`.

        Free components move at the rates `moved` (n, d); with None they rest. The pushes of
        obstacles change at the rates `pushes` (places, obstacles).
        """
        system = self.system
        fine = self.fine or name.endswith("bulk_modulus")
        value, step = self._step(name, fine, moved is not None)
        if moved is not None:
            step = min(
                step,
                (max(self.width, CAREFUL) if fine else COARSE)
                * system.body.spacing
                / max(np.abs(moved).max(), 1e-300),
            )
        sizes: list[float] = []

        def state(way: float) -> np.ndarray:
            with self._beside(name, value + way, way) as side:
                loads = side.system.loads
                loads.pushes[:] = system.loads.pushes + way * pushes
                positions, forces = _forces(
                    side.system,
                    system.positions if moved is None else system.positions + way * moved,
                )
                sizes.append(float(np.linalg.norm(forces)))
                pushed = loads.pushed(positions, loads.pushes)
                history = side.accepted()
                found = positions, forces, pushed, side.values_of(names), history
                return np.concatenate([each.ravel() for each in found])

        rates = central_difference(state, step, fine)
        system.place(system.positions)  # planes of reflection have moved
        size = system.positions.size
        shape = system.loads.pushes.shape
        motion, forces, found, measured, history = np.split(
            rates, np.cumsum([size, size, system.loads.pushes.size, len(names)])
        )
        motion = motion.reshape(system.positions.shape)
        forces = forces.reshape(system.positions.shape)
        rounding = ROUNDED * max(sizes) / step
        pushed = found.reshape(shape)
        return Change(name, motion, forces, pushed, measured, history, step, rounding)

    def values_of(self, names: Sequence[str]) -> np.ndarray:
        """Return the named measurements where the force was last evaluated; NaN for one that
        does not exist.
        """
        costly = not all(QUICK.fullmatch(name) for name in names)
        measured = self._read(costly) if names else {}
        return np.array([measured.get(name, np.nan) for name in names])

    def _step(self, name: str, fine: bool, whole: bool) -> tuple[float, float]:
        """Return the middle of the values of a parameter in central differences, and the change
        from it.

        The middle is the value of the parameter, with two exceptions. Coefficients of the terms of
        an energy keep their sign: if half of one is less than the least change, the middle lies
        beside it by this change. For a number of a law at the end of its range, the middle lies
        beside it by a tenth of the change: energies are linear in all numbers with such a range,
        and the thickness of a sheet nearly so.
        """
        system = self.system
        array = array_of(name, self.system.problem.models)
        value = system.state.parameter if name == system.loading.parameter else self.numbers[name]
        owner, _, last = name.rpartition(".")
        scale = abs(value) if array is None else float(np.abs(array).max())
        if name == self.control:
            change = STEP_OF_LAWS * (WIDER if fine else 1.0)
            return value, change * max(scale, system.body.spacing)
        if array is None and owner.startswith("material") and last.isdigit():
            scale = max(
                abs(number)
                for key, number in self.numbers.items()
                if key.rpartition(".")[0] == owner
            )
            scale = scale or laws_of(system.problem.scene)[owner.rpartition(".")[0]].shear_modulus
            step = min(STEP_OF_LAWS * scale, max(LEAST_STEP * scale, abs(value) / 2))
            return value + (np.copysign(step, value) if step > abs(value) / 2 else 0.0), step
        laws = laws_of(system.problem.scene)
        owner = next((key for key in laws if name.startswith(f"{key}.")), "")
        of_law = bool(owner)
        change = STEP_OF_LAWS if of_law or (array is None and whole) else STEP
        if fine:
            change *= WIDER**2 if last == "bulk_modulus" else WIDER
        if not of_law:
            of_loads = name.startswith("loads")
            unit = system.problem.law.shear_modulus if of_loads else system.body.spacing
            return value, change * (scale or unit)
        law = laws[owner]
        number = name.removeprefix(f"{owner}.")
        step = change * (scale or 1.0)
        for middle, width in (
            (value, step),
            (value + step / 10, step / 10),
            (value - step / 10, step / 10),
        ):
            with suppress(ValueError):
                for side in (-width, width):
                    with_numbers_of(law, {number: middle + side})
                return middle, width
        raise ValueError(
            f"parameters: {law.name} permits no change of {number} = {value:g}, so that there is no"
            " derivative by it"
        )

    @contextmanager
    def _beside(self, name: str, value: float, way: float) -> Iterator["Differentiated"]:
        """Provide the scene with another value of one parameter, changed by `way`, or of the
        loading parameter, with the force of this one in the block.
        """
        system = self.system
        problem = self.system.problem
        at = self.system.state.parameter
        scene = problem.scene
        models = problem.models
        if name == system.loading.parameter:
            at = value
        elif name != self.control:  # the controlled displacement changes with the positions
            scene, models = with_numbers(scene, models, {name: value})
        with system.lending_force(scene, models, at) as other:
            if self.control is not None:
                other.loaded = system.loaded.beside(other.loaded)
            with self._remembering(other.force, name, way):
                yield replace(self, system=other)

    def gradients(self, names: Sequence[str]) -> list[np.ndarray] | None:
        """Return the derivatives (n, d) of measurements by the positions of free components.

        They are computed for displacements at places and probes, reactions of supports, nominal
        stress and energy; None if another one is asked for, or if the tangent is not symmetric, as
        that of bond forces.
        """
        system = self.system
        found = []
        if not system.loaded.has_energy or system.loading.supports or system.loaded.rigid:
            return None
        for name in names:
            gradient = np.zeros_like(system.positions)
            if place := re.fullmatch(r"places\.(\d+)\.(\d)", name):
                number, axis = map(int, place.groups())
                gradient[:, axis] = self.at_places.component(axis)[[number]].toarray()[0]
            elif place := re.fullmatch(r"probes\.(.+)\.displacement\.(\d)", name):
                axis = int(place[2])
                gradient[:, axis] = system.probes.weights(place[1], axis)
            elif name == "energy":
                _forces(system, system.positions)
                gradient = -internal_forces(system.force)
            elif name == "nominal_stress":
                stress = system.problem.measures.nominal_stress
                unit = np.zeros((len(system.loading.names), system.body.dimension))
                unit[stress.number, stress.axis] = 1.0
                gradient = stress.of(unit) * self._stiffness(stress.number, stress.axis)
            elif (place := re.fullmatch(r"forces\.(.+)\.(\d)", name)) and place[
                1
            ] not in system.loads.by_name(system.positions, system.loaded.thickness()):
                gradient = self._stiffness(system.loading.names.index(place[1]), int(place[2]))
            else:
                return None
            found.append(gradient)
        return found

    def _stiffness(self, holder: int, axis: int) -> np.ndarray:
        """Return the derivative (n, d) of a component of a support's reaction by the positions.

        As K is symmetric, it is minus the derivative of the forces by a displacement of the
        support.
        """
        system = self.system
        loading = self.system.loading
        holders, points, axes = loading.counted
        chosen = (holders == holder) & (axes == axis)

        def forces_at(change: float) -> np.ndarray:
            moved = system.positions.copy()
            forces = np.empty_like(system.positions)
            loading.hold(system.state.parameter, system.loaded, moved)
            moved[points[chosen], axes[chosen]] += change
            for part in loading.held:
                if part.plane is not None and part.holder == holder and axis in part.components:
                    motion = loading.plane_motions(system.state.parameter)[part.plane].copy()
                    motion[axis, -1] += change
                    system.loaded.move_plane(part.plane, motion[:, -1])
                    system.loads.planes[part.plane] += (
                        change * system.loads.normals[part.plane, axis]
                    )
            system.loaded(moved, forces)
            return forces

        found = -central_difference(forces_at, self.width * system.body.spacing, self.fine)
        loading.hold(system.state.parameter, system.loaded, system.positions)
        return found


def differentiated(
    scene: Scene, models: Sequence[ForceModel], places: np.ndarray | None = None
) -> Differentiated:
    """Return a scene at rest, to be differentiated; `models` are as from `checked_models`, and
    `places` (k, d) undeformed ones whose displacements are measured besides the outputs.
    """
    with thread_count(None):
        system = bound(compile_scene(scene, models), "float64")
    at_places = None
    if places is not None:
        at_places, _ = fields_at(system.body, places, system.force.portion_of)
    return Differentiated(system, numbers_in(scene, models), at_places)


def _history_of(force: InternalForce) -> np.ndarray:
    """Return the history of a force, flat."""
    return np.concatenate([values.ravel() for values in force.history.values()])


def _remember(force: InternalForce, history: np.ndarray, elapsed: tuple) -> None:
    """Give a force a flat history, and the arguments of `elapse` since then."""
    at = 0
    for values in force.history.values():
        values[:] = history[at : at + values.size].reshape(values.shape)
        at += values.size
    force.elapse(*elapsed)


def _forces(system: System, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions with the supports of a run in their places, and the forces there; the run
    is at these positions then.
    """
    system.place(positions)
    forces = np.empty_like(positions)
    system.loaded(system.positions, forces)
    if isinstance(system.loaded, ControlledForce):
        system.state.parameter = system.loaded.factor
    return system.positions.copy(), forces
