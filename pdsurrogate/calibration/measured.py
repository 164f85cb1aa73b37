"""Scene whose measurements in a table are simulated, with their derivatives by the numbers of
its law.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..artifacts import load_surrogate
from ..body import Body, fields_at
from ..forces import InvalidState
from ..materials import Law
from ..materials.covariance import numbers_of
from ..problem.materials import checked_models
from ..progress import listening
from ..results import Result
from ..run.differentiated import Differentiated, differentiated
from ..run.followed import FollowedRun
from ..run.parameters import check_not_at_break
from ..run.sensitivity import Jacobian, jacobian
from ..run.simulate import SimulationFailed, simulate
from ..scenes import Scene, SceneError
from ..scenes.pulled import pulled_force
from ..scenes.reading import leaves
from ..solvers.equilibrium import NoEquilibrium
from ..solvers.methods import Newton
from ..solvers.tangent import COARSE
from .image_map import ImageMap
from .kinematics import Kinematics
from .scatter import Rows, local_fit

FORCE_PULLED = "force"
"""Name, among those of outputs, of the force of the region that a scene pulls farthest."""

FORCES = re.compile(r"force|forces\..*")
"""Names of outputs that are forces."""

DISPLACEMENTS = re.compile(r"displacements\..*|probes\..*\.displacement\..*")
"""Names of outputs that are displacements. Under prescribed motions displacements do not depend
on a common factor of all stresses.
"""

FORCE = "bond-energy"
"""Force model of calibrations: the exact energy of a law, which converges with the spacing at
any bulk modulus.
"""

SMOOTHED = {2: 25, 3: 40}
"""Number of places, by dimension, to which a quadratic is fitted in order to carry measured
displacements to a point: about four times the number of its coefficients. With 13 and 50 in the
plane the fit of the weak form to the measurements is as good within a tenth.
"""


def with_law(scene: Scene, law: Law, spacing: float | None = None) -> Scene:
    """Return a scene with another law of its material, and optionally another spacing."""
    data = scene.model_dump(mode="json") | {"material": law.describe()}
    return Scene.model_validate(data if spacing is None else data | {"spacing": spacing})


class MeasuredScene:
    """Scene with a table of what was measured on it; simulates the measurements for a law.

    Parameters
    ----------
    scene : Scene
    rows : Rows
    outputs : sequence of str, optional
        Dotted keys of measurements of an output, those of the quantities 0, -1, and so on;
        ``"force"``, the default, is the force of the region that is pulled.
    number : int
        Number of the scene among those of the table.

    Attributes
    ----------
    steps : list of int
        Numbers of the measured outputs of the scene.
    used : float
        Number of degrees of freedom that a map from an image takes.
    greatest_stretch : float
        Greatest stretch, or inverse of the least one, in the simulation with which `begin` was last
        called.
    """

    def __init__(
        self,
        scene: Scene,
        rows: Rows,
        outputs: Sequence[str] | None = None,
        number: int = 0,
    ) -> None:
        self.scene = scene
        self.number = number
        self.rows = rows
        self.used = 0.0
        check_not_at_break(outputs or (), "outputs")
        named = outputs if outputs is not None else [] if rows.is_field.all() else [FORCE_PULLED]
        self.outputs = [
            pulled_force(scene) if name == FORCE_PULLED else (name, 1.0) for name in named
        ]
        self._check()
        self._places, at = np.unique(rows.places[rows.is_field], axis=0, return_inverse=True)
        # Entries of all displacements at places, and then of the outputs.
        self._entry_of = self._places.size - rows.quantity
        first = scene.dimension * at.ravel() - 1
        self._entry_of[rows.is_field] = first + rows.quantity[rows.is_field]
        self.steps = np.unique(rows.step).tolist()
        self.count = len(self.steps)
        self._loading = "stretch" if scene.stretched else "t"
        self._base: Differentiated | None = None
        self._guesses: dict[int, np.ndarray] = {}

    def among(self, names: re.Pattern) -> np.ndarray:
        """Return a mask, shape (n,), of the rows that are outputs whose dotted keys match a
        pattern.
        """
        matching = np.array([*(bool(names.fullmatch(name)) for name, _ in self.outputs), False])
        return matching[np.where(self.rows.is_field, -1, -self.rows.quantity)]

    def simulate(self, law: Law, spacing: float | None = None) -> tuple[np.ndarray, Result]:
        """Simulate the scene; return the measurements of the rows, shape (n,), and the result of
        the run.

        Raises
        ------
        SimulationFailed
            If an output is not reached with this law.
        """
        scene = with_law(self.scene, law, spacing)
        result = _simulated(scene)
        found = np.empty(len(self.rows.step))
        at_places = self._interpolation(scene)
        for step, level in self._levels(result).items():
            fields = at_places(result.displacement(step - 1), level[self._loading])
            self._fill(found, step, self._named(level), self._seen(step, fields))
        return found, result

    def motion(
        self, law: Law, names: Sequence[str] = (), chain: np.ndarray | None = None
    ) -> Kinematics:
        """Return the motion of the body in the steps, simulated with a law, with its derivatives by
        variables by which the numbers of the law of given names have the derivatives `chain`.
        """
        result = _simulated(with_law(self.scene, law))
        responses = None
        if chain is not None:
            found = self._jacobians(law, [], names, places=False)
            responses = [np.einsum("pnd,pk->ndk", one.moved, chain) for one in found.values()]
        return Kinematics.of(result, [step - 1 for step in self._levels(result)], responses)

    def states(self, law: Law) -> np.ndarray:
        """Return the three principal stretches of all points in all steps with a law, in
        descending order, shape (n, 3).
        """
        return self._stretches(_simulated(with_law(self.scene, law)))

    def _stretches(self, result: Result) -> np.ndarray:
        """Return the principal stretches of all points in all steps of a result, (n, 3)."""
        found = [result.field("principal_stretches", step - 1) for step in self._levels(result)]
        return np.concatenate(found)

    def begin(self, law: Law) -> np.ndarray:
        """Simulate the scene at its own spacing as the start of `differentiate`; return the
        measurements of the rows.
        """
        values, result = self.simulate(law)
        levels = self._levels(result)
        self._parameters = {step: level[self._loading] for step, level in levels.items()}
        self._guesses = {step: result.displacement(step - 1) for step in levels}
        stretches = self._stretches(result)
        self.greatest_stretch = max(float(stretches.max()), 1 / float(stretches.min()))
        self._base = self._differentiated(with_law(self.scene, law))
        return values

    def differentiate(self, law: Law, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Return the measurements of the rows, shape (n,), and their derivatives by numbers of the
        law, shape (n, names).

        Parameters
        ----------
        law : Law
        names : sequence of str
            Names of numbers such as "material.shear_modulus"; without names only the measurements
            are computed.

        Raises
        ------
        NoEquilibrium, InvalidState, SimulationFailed
            If the equilibria are not found with this law.
        """
        values = np.empty(len(self.rows.step))
        derivatives = np.empty((len(self.rows.step), len(names)))
        outputs = [] if self.rows.is_field.all() else self.outputs
        keys = list(dict.fromkeys(name for name, _ in outputs))
        for step, found in self._jacobians(law, keys, names).items():
            for target, source, seen in (
                (values, found.values, self._seen),
                (derivatives, found.derivatives, self._seen_changes),
            ):
                fields = source[len(keys) :].reshape(*self._places.shape, *source.shape[1:])
                self._fill(target, step, dict(zip(keys, source, strict=False)), seen(step, fields))
        return values, derivatives

    def _jacobians(
        self, law: Law, outputs: Sequence[str], names: Sequence[str], places: bool = True
    ) -> dict[int, Jacobian]:
        """Return measurements, with `places` also those of displacements, of all steps with a law,
        and their derivatives by its numbers.
        """
        scene = with_law(self.scene, law)
        measured = places and len(self._places)
        if scene.remembers:
            run = FollowedRun(scene, checked_models(scene, load_surrogate(FORCE)))
            measuring = [self._at_places] if measured else []
            with listening(None):
                every = run.follow(outputs, names, max(self.steps) - 1, *measuring)
            found = {step: every[step - 1] for step in self.steps}
        else:
            body = self._base.changed(_named_numbers(law))
            body = body if measured else replace(body, at_places=None)

            def at(step: int) -> Jacobian:
                return jacobian(body, self._parameters[step], self._guesses[step], outputs, names)

            found = {}
            for step in self.steps:
                try:
                    found[step] = at(step)
                except (NoEquilibrium, InvalidState):
                    self.begin(law)  # in increments, as a run goes
                    found[step] = at(step)
        self._guesses |= {step: one.displacements for step, one in found.items()}
        return found

    def weak_form(
        self, law_of: Callable[[np.ndarray], Law], start: np.ndarray, y: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the linear equations J x = right of the weak form for the coefficients x of an
        energy.

        They say that a body in equilibrium near the measured displacements has the measurements.
        The forces of each term at the measured displacements, one evaluation, move the points by
        the preconditioner of the law at the `start`, at which `begin` has simulated the scene:
        these displacements are comparable with the measured ones, and change the outputs, too.

        Parameters
        ----------
        law_of : callable
            Law of coefficients.
        start : ndarray, shape (n_terms,)
        y : ndarray, shape (n,)
            Measured values of the rows.

        Returns
        -------
        jacobian : ndarray, shape (n, n_terms)
        right : ndarray, shape (n,)

        Raises
        ------
        InvalidState
            If the force is undefined at the measured displacements.
        """
        base = self._base
        change = start.max()
        run = self._base.system
        others = [
            base.changed(_named_numbers(law_of(start + change * unit)))
            for unit in np.eye(len(start))
        ]
        jacobian = np.empty((len(y), len(start)))
        right = np.empty(len(y))
        for step in self.steps:
            here = self.rows.step == step
            positions = run.body.points + self._carried(step, y)
            values, forces = self._evaluated(base, step, positions)
            equations = Newton(run.loading.free, run.body.volumes, 1.0).equations(
                run.loaded, run.positions
            )
            # Change of the measurements where the points stay, and forces that move the points, for
            # each coefficient and for the start.
            columns = [
                (changed - values, pulled - forces)
                for changed, pulled in (self._evaluated(one, step, positions) for one in others)
            ]
            effects = []
            for changed, pulled in [(np.zeros_like(values), change * forces), *columns]:
                moved = equations.estimate(pulled)[0]
                width = COARSE * run.body.spacing / max(np.abs(moved).max(), 1e-300)
                ahead, behind = (
                    self._evaluated(base, step, positions + way * width * moved)[0]
                    for way in (1, -1)
                )
                effects.append((changed + (ahead - behind) / (2 * width)) / change)
            jacobian[here] = np.column_stack(effects[1:])
            right[here] = y[here] - values - effects[0] + jacobian[here] @ start
        return jacobian, right

    def _evaluated(
        self, body: Differentiated, step: int, positions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the measurements of the rows of a step, and the forces (n, d), where the points
        have given positions (n, d).
        """
        body.system.state.parameter = self._parameters[step]
        measured, forces = body.evaluated(positions)
        fields = np.array([*measured.values()][-self._places.size :]).reshape(self._places.shape)
        found = np.empty(len(self.rows.step))
        self._fill(found, step, measured, self._seen(step, fields))
        return found[self.rows.step == step], forces

    def follow(self, maps: Mapping[int, ImageMap]) -> None:
        """Take the place of an image in the scene from fitted maps by the numbers of scenes."""

    def weigh(self, y: np.ndarray, root: np.ndarray) -> None:
        """Set the measured values of the rows and the roots of their weights, (n,)."""

    def chain(self, matrix: np.ndarray) -> None:
        """Say that variables of a search have the derivatives `matrix` of the numbers by which
        the measurements were differentiated last.
        """

    def robust(self, off: np.ndarray) -> np.ndarray:
        """Return weights of the rows, (n,), from their residuals in standard deviations."""
        return np.ones(len(off))

    def _seen(self, step: int, fields: np.ndarray) -> np.ndarray:
        """Return displacements in a step as they are measured, (k, d), from those in the scene."""
        return fields

    def _seen_changes(self, step: int, fields: np.ndarray) -> np.ndarray:
        """Return changes of measured displacements, (k, d, m), from those in the scene."""
        return fields

    def _in_scene(self, step: int, off: np.ndarray) -> np.ndarray:
        """Return changes of displacements in the scene, (k, d), from those of measured ones."""
        return off

    def _places_in(self, body: Body) -> np.ndarray:
        """Return the places at which displacements were measured, near the points of a body."""
        return self._places

    @property
    def has_fields(self) -> bool:
        """Whether each component of a displacement that was measured in a step was measured at
        the places that `weak_form` needs.
        """
        field = self.rows.is_field
        counts = np.unique(
            np.column_stack([self.rows.step, self.rows.quantity, self._entry_of])[field], axis=0
        )[:, :2]
        return (
            bool(field.any())
            and np.unique(counts, axis=0, return_counts=True)[1].min()
            >= SMOOTHED[self.scene.dimension]
        )

    def _carried(self, step: int, y: np.ndarray) -> np.ndarray:
        """Return the measured displacements of a step carried to the points, shape (n, d).

        What is smoothed, by local quadratic fits, is their difference from the simulated ones. It
        is zero where components are held.
        """
        run = self._base.system
        moved = self._guesses[step].copy()
        guessed = self._base.moved_places(self._guesses[step], self._parameters[step])
        here = (self.rows.step == step) & self.rows.is_field
        changes = np.full(guessed.shape, np.nan)
        entry = self._entry_of[here]
        changes.flat[entry] = y[here] - self._seen(step, guessed).flat[entry]
        changes = self._in_scene(step, changes)
        for axis in range(guessed.shape[1] if len(guessed) else 0):
            at = np.flatnonzero(np.isfinite(changes[:, axis]))
            if not at.size:
                continue
            held = run.loading.free[:, axis] == 0
            places = np.vstack([self._places[at], run.body.points[held]])
            off = np.append(changes[at, axis], np.zeros(held.sum()))
            near, weights = local_fit(places, run.body.points, SMOOTHED[self.scene.dimension])
            moved[~held, axis] += (weights * off[near]).sum(axis=1)[~held]
        return moved

    def _check(self) -> None:
        """Raise ValueError for steps or quantities that the scene does not have."""
        rows = self.rows
        d = self.scene.dimension
        count = len(self.scene.stretches) if self.scene.stretched else None
        if rows.step.min() < 1 or (count is not None and rows.step.max() > count):
            most = f", the number of its stretches ({count})" if count else ""
            wrong = rows.step.min() if rows.step.min() < 1 else rows.step.max()
            raise ValueError(
                f"step {wrong}: the outputs of scene {self.scene.name} are numbered from 1{most}"
            )
        if rows.quantity.max() > d or rows.quantity.min() <= -len(self.outputs):
            wrong = rows.quantity.max() if rows.quantity.max() > d else rows.quantity.min()
            known = (
                f"1 to {d} are components of the displacement, and 0 to {1 - len(self.outputs)}"
                " outputs"
            )
            raise ValueError(
                f"quantity {wrong}: {known.replace('0 to 0 outputs', '0 is the output')} of scene"
                f" {self.scene.name}"
            )

    def _levels(self, result: Result) -> dict[int, dict]:
        """Return the entries of the levels of a result by steps; step k is the state k - 1."""
        levels = result.levels
        for step in self.steps:
            if step > len(levels) or "kinetic_energy" in levels[step - 1]:
                at_rest = sum("kinetic_energy" not in level for level in levels)
                raise ValueError(
                    f"step {step}: scene {self.scene.name} has {at_rest} outputs in equilibrium,"
                    " numbered from 1"
                )
        return {step: levels[step - 1] for step in self.steps}

    def _differentiated(self, scene: Scene) -> Differentiated:
        body = differentiated(scene, checked_models(scene, load_surrogate(FORCE)))
        return self._at_places(body) if len(self._places) else body

    def _at_places(self, body: Differentiated) -> Differentiated:
        """Return a body whose displacements at the places are measured."""
        system = body.system
        places = self._places_in(system.body)
        return replace(body, at_places=fields_at(system.body, places, system.force.portion_of)[0])

    def _interpolation(self, scene: Scene) -> Callable[[np.ndarray, float], np.ndarray]:
        """Return the function that gives displacements at the places of the rows from those of the
        points and the loading parameter.
        """
        if not len(self._places):
            return lambda *_: np.empty((0, 0))
        try:
            return self._differentiated(scene).moved_places
        except ValueError as error:
            raise Unlike(
                f"a place of the displacements: {error} (places are those of the undeformed body of"
                " the scene)"
            ) from None

    def _named(self, level: dict) -> dict[str, float]:
        """Return the outputs of a level by dotted key; raise ValueError if one is missing."""
        row = {key: value for key, value in leaves(level) if isinstance(value, float)}
        for name, _ in self.outputs:
            if name not in row:
                raise ValueError(
                    f"outputs: scene {self.scene.name} has no {name!r}; its outputs have"
                    f" {', '.join(row)}"
                )
        return row

    def _fill(
        self, found: np.ndarray, step: int, outputs: Mapping[str, Any], fields: np.ndarray
    ) -> None:
        """Write the entries of the rows of a step, from outputs by dotted key and displacements at
        the places (k, d, ...).
        """
        here = self.rows.step == step
        signed = [sign * outputs[name] for name, sign in self.outputs if name in outputs]
        every = fields.reshape(self._places.size, *fields.shape[2:])
        if len(signed):
            every = np.concatenate([every, np.array(signed)])
        found[here] = every[self._entry_of[here]]


FAILURES = (NoEquilibrium, InvalidState, SimulationFailed, SceneError)
"""Errors with which a law has no equilibrium in a scene."""


class Unlike(ValueError):
    """Measured displacements are unlike those of a test."""


def _simulated(scene: Scene) -> Result:
    with listening(None):  # the search tells how far it is
        return simulate(scene, FORCE)


def _named_numbers(law: Law) -> dict[str, float]:
    """Return the numbers of a law by their names as parameters of a scene."""
    return {f"material.{name}": value for name, value in numbers_of(law).items()}
