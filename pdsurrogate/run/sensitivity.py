"""Sensitivities of an equilibrium (theory, section 23): derivatives of its measurements by parameters of the scene."""

from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from ..engine.threads import thread_count
from ..forces import ForceModel
from ..problem.materials import checked_models, scene_errors
from ..ranks import communicator
from ..results import Result
from ..results.sensitivity import Sensitivities
from ..scenes import Scene
from ..scenes.problems import suggestion
from ..scenes.reading import apply_change, leaves
from ..solvers.equilibrium import NoEquilibrium
from ..solvers.methods import Newton
from ..solvers.tangent import TangentEquations
from .rows import output_row
from .run import Run, Silent

PLACES = ("material", "materials", "loads", "prescribed", "obstacles")
"""Keys of a scene below which numbers can be parameters of sensitivities: they change neither the points nor which of them are held."""

STEP = 1e-6
"""Change of a parameter, relative to its value, in central differences. Chosen: rounding then leaves relative errors of 1e-10 times K/mu,
and curvature less, also where a support moves by this part of its displacement while the points beside it stay."""

BALANCED = 1e-10
"""Residual, in units of shear modulus / spacing, of the equilibrium whose derivatives are computed."""

SOLVED = 1e-8
"""Permitted relative residual of the linear equations for the displacements: some ten times the error of products of the tangent, which are
differences of forces."""

ROUNDED = 1e-9
"""Norm of the rounding errors in the derivatives of the forces, divided by the norm of the forces over the value of the parameter."""


def differentiate(
    scene: Scene, models: Sequence[ForceModel], result: Result, outputs: Sequence[str], parameters: Sequence[str], level: int
) -> Sensitivities:
    """Return the derivatives of measurements of a result in equilibrium, see `Result.sensitivity`; `models` are those of its run."""
    loading = "stretch" if scene.stretched else "t"
    number = _check(scene, models, result, parameters, loading, level)
    with thread_count(None), threadpool_limits(1, user_api="blas"):
        run = Run(scene, models, Silent())
        run.take_double()
        run.positions += result.displacement(number)
        run.state.parameter = result.levels[number][loading]
        run.loading.apply(run.state.parameter, run.loaded, run.positions)
        solver = Newton(run.loading.free, run.body.volumes, BALANCED)
        try:
            solver.solve(run.loaded, run.positions)
            equations = TangentEquations(run.loaded, run.positions, run.loading.free, solver.preconditioner(run.loaded))
            columns = [_derivatives(run, equations, name) for name in parameters]
        except NoEquilibrium as error:
            raise ValueError(f"sensitivity at {run.loading.at(run.state.parameter)}: {error}") from None
        measured = _measured(run, run.positions)
    names = _named(outputs, measured)
    derivatives = np.array([[changes[name] for changes, _ in columns] for name in names]).reshape(len(names), len(parameters))
    displacements = np.array([moved for _, moved in columns]).reshape(len(parameters), *run.positions.shape)
    return Sensitivities(tuple(names), tuple(parameters), np.array([measured[name] for name in names]), derivatives, displacements)


def _check(scene: Scene, models: Sequence[ForceModel], result: Result, parameters: Sequence[str], loading: str, level: int) -> int:
    """Check the arguments of `Result.sensitivity`, and return the number of the output."""
    if communicator().size > 1:
        raise ValueError("sensitivity: run the scene on one rank, without mpiexec")
    for model in models:
        if "float64" not in model.honored(scene.plane)["precision"]:
            raise ValueError(f"sensitivity: {model.name} cannot be evaluated in double precision, which derivatives need")
    levels = result.levels
    if not -len(levels) <= level < len(levels):
        raise IndexError(f"level: the result has {len(levels)} outputs, none with the number {level}")
    number = level % len(levels)
    if "time" in levels[number]:
        raise ValueError(f"level: output {number} is one of dynamics; derivatives are those of equilibria")
    if scene.fracture is not None and result.field("damage", number).any():
        raise ValueError(f"level: bonds are broken at output {number}; derivatives are those of bodies whose bonds are intact")
    known = _numbers_in(scene)
    for name in parameters:
        if name not in known and name != loading:
            raise ValueError(f"parameters: there is no number {name!r} to differentiate by; {suggestion(name, [*known, loading])}")
    return number


def _numbers_in(scene: Scene) -> dict[str, float]:
    """Return, by dotted key, the numbers of a scene that can be parameters."""
    found = {key: value for key, value in leaves(scene.model_dump(mode="json")) if key.split(".")[0] in PLACES and ".region." not in key}
    return {key: float(value) for key, value in found.items() if isinstance(value, float | int) and not isinstance(value, bool)}


def _derivatives(run: Run, equations: TangentEquations, name: str) -> tuple[dict[str, float], np.ndarray]:
    """Return the derivatives of all measurements by one parameter, by name, and those of the displacements, shape (n, d)."""
    scene, positions = run.problem.scene, run.positions
    value = run.state.parameter if name == run.loading.parameter else _numbers_in(scene)[name]
    scale = abs(value) or (run.problem.law.shear_modulus if name.startswith("loads") else run.body.spacing)
    sides = [_changed(run, name, value + change) for change in (STEP * scale, -STEP * scale)]
    (ahead, forces), (behind, opposite) = (_forces(side, positions) for side in sides)
    moved, rate = (ahead - behind) / (2 * STEP * scale), (forces - opposite) / (2 * STEP * scale)
    moved += equations.displacements(rate, SOLVED, ROUNDED * float(np.linalg.norm(forces)) / scale)
    after, before = (_measured(side, positions + change * moved) for side, change in zip(sides, (STEP * scale, -STEP * scale), strict=True))
    return {key: (after[key] - before[key]) / (2 * STEP * scale) for key in after if key in before}, moved


def _changed(run: Run, name: str, value: float) -> Run:
    """Return a run on the same body with another value of one parameter: a number of the scene, or the loading parameter."""
    if name == run.loading.parameter:
        return run.beside(run.problem.scene, run.problem.models, value)
    data = run.problem.scene.model_dump(mode="json")
    apply_change(data, name, value)
    scene = Scene.model_validate(data)
    with scene_errors(scene):
        return run.beside(scene, checked_models(scene, run.model), run.state.parameter)


def _forces(run: Run, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions with the supports of a run in their places, and the forces there; the run is at these positions then."""
    run.positions[:] = positions
    run.loading.apply(run.state.parameter, run.loaded, run.positions)
    forces = np.empty_like(positions)
    run.loaded(run.positions, forces)
    return run.positions.copy(), forces


def _measured(run: Run, positions: np.ndarray) -> dict[str, float]:
    """Return the measurements of an output at given positions (n, d), by dotted key."""
    _forces(run, positions)
    return {key: value for key, value in leaves(output_row(run)) if isinstance(value, float)}


def _named(outputs: Sequence[str], measured: dict[str, float]) -> list[str]:
    """Return the names of all measurements that `outputs` names, each with all below it; raise ValueError for one that there is not."""
    found: list[str] = []
    for output in outputs:
        below = [name for name in measured if name == output or name.startswith(f"{output}.")]
        if not below:
            raise ValueError(f"outputs: the result has no {output!r}; {suggestion(output, measured)}")
        found += below
    return found
