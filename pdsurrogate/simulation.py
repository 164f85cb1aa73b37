"""A scene and a force model in, a result out: picks what this scene needs and runs it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from . import artifacts
from .body import Body, grid
from .forces import ForceModel, ForceSettings, InvalidState, OutsideDomain
from .kernels.compile import compilation_clock, thread_count
from .materials import Law, homogeneous
from .results import Result, measures
from .scenes import Scene, SceneError
from .solvers import SOLVERS, Diverging, NotConverged
from .solvers.conditions import Loading, reflection_planes


class SimulationFailed(RuntimeError):
    """A run that did not reach its end; what it did reach is in `result`."""

    def __init__(self, message: str, result: Result) -> None:
        super().__init__(message)
        self.result = result


class Progress(Protocol):
    """Where a simulation reports to."""

    def compiling(self) -> None:
        """Kernels are being compiled, which happens once on a machine."""

    def level(self, number: int, stretch: float) -> None:
        """A level of the loading programme begins."""

    def residual(self, evaluations: int, residual: float, tolerance: float) -> None:
        """How far the level has come."""


class Silent:
    """Progress that goes nowhere."""

    def compiling(self) -> None:
        """Say nothing."""

    def level(self, number: int, stretch: float) -> None:
        """Say nothing."""

    def residual(self, evaluations: int, residual: float, tolerance: float) -> None:
        """Say nothing."""


class _Stopwatch:
    """An internal force that measures the time spent in it."""

    def __init__(self, force) -> None:
        self._force, self.seconds, self.timed = force, 0.0, 0

    def __call__(self, positions, out) -> None:
        began = time.perf_counter()
        self._force(positions, out)
        self.seconds += time.perf_counter() - began
        self.timed += 1

    def __getattr__(self, name):
        return getattr(self._force, name)


def simulate(
    scene: Scene,
    force: str | Path | ForceModel = "neo-hookean",
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Result:
    """Run a scene.

    Parameters
    ----------
    scene : Scene
        See `pdsurrogate.load_scene`.
    force : str, path or ForceModel
        A force model, the name of one ("analytic", "nosb"), or an artefact: NAME, NAME@VERSION or a path.
    threads : int, optional
        Threads of the kernels, by default all that numba was started with.  The result does not depend on it.
    progress : Progress, optional
        Where to report progress.

    Returns
    -------
    Result

    Raises
    ------
    SceneError
        If the scene and the force model do not fit, or the body cannot be built.
    SimulationFailed
        If a level does not converge, or the deformation leaves the states that the material has; the part that was reached is kept.
    """
    began = time.perf_counter()
    model = artifacts.load_surrogate(force) if isinstance(force, str | Path) else force
    progress = progress or Silent()
    # BLAS threads spin for a while after each call, on the cores that the kernels want next.
    with thread_count(threads) as count, threadpool_limits(1, user_api="blas"), compilation_clock(progress.compiling) as clock:
        run = _Run(scene, model, progress)
        run.warm_up()
        try:
            run.programme()
        except (NotConverged, Diverging, InvalidState, OutsideDomain) as error:
            message = f"stretch {run.stretch:g}: {error}"
            raise SimulationFailed(message, run.result(count, clock.seconds, began, message)) from error
        return run.result(count, clock.seconds, began, None)


def build_body(scene: Scene) -> Body:
    """The points of a scene and the images beyond its grips.

    Raises
    ------
    SceneError
        If the spacing does not fit the body.
    """
    lower, upper = bounding_box(scene)
    try:
        points = grid(lower, upper, scene.spacing)
        return Body(
            points,
            np.full(len(points), scene.spacing**2),
            scene.horizon,
            scene.spacing,
            scene.weight,
            reflection_planes(scene, lower, upper),
        )
    except ValueError as error:
        raise SceneError(f"scene {scene.name}: {error}") from None


def bounding_box(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corner of a scene's body."""
    lower = np.array(scene.body.lower)
    return lower, lower + np.array(scene.body.size)


class _Run:
    """One simulation under way."""

    def __init__(self, scene: Scene, model: ForceModel, progress: Progress) -> None:
        self.scene, self.model, self.progress = scene, model, progress
        self.law: Law = scene.material.build()
        self.body = build_body(scene)
        lower, upper = bounding_box(scene)
        settings = ForceSettings(scene.precision, scene.correction, scene.rotation, scene.outside)
        try:
            self.loading = Loading(scene, self.body, lower, upper)
            self.force = _Stopwatch(model.bind(self.body, self.law, settings))
        except ValueError as error:
            raise SceneError(f"scene {scene.name}: {error}") from None
        self.solver = SOLVERS[scene.solver.method](
            self.loading.free, self.body.volumes, scene.solver.tolerance, scene.solver.most_evaluations
        )
        self.lateral = 1 - self.loading.axis
        self.width = (upper - lower)[self.lateral]
        self.middle = (lower + upper)[self.loading.axis] / 2
        self.stretch = 1.0
        self.levels: list[dict] = []
        self.history: list[dict] = []
        self.states: list[tuple[float, dict[str, np.ndarray]]] = []
        self.residual: float | None = None

    def warm_up(self) -> None:
        """Compile everything before the clock of the evaluations starts."""
        positions = self.body.points.copy()
        self.force(positions, np.empty_like(positions))
        self.force.seconds, self.force.timed = 0.0, 0

    def programme(self) -> None:
        """Go through the levels, each from the last, by increments of a bounded size."""
        spec = self.scene.solver
        positions, reached = self.body.points.copy(), 1.0
        for number, stretch in enumerate(self.scene.stretches):
            self.progress.level(number, stretch)
            self.stretch = stretch
            steps = max(1, int(np.ceil(abs(stretch - reached) / spec.largest_increment - 1e-9)))
            for target in np.linspace(reached, stretch, steps + 1)[1:]:
                guess = self.loading.stretched(positions, reached, target)
                last = target == stretch
                # States on the way need not be exact: they only bring the next start near.
                tolerance = spec.tolerance if last else max(spec.tolerance, 1e-3)
                self.loading.apply(target, self.force, guess)
                positions[:] = guess
                equilibrium = self._relax(stretch, positions, tolerance)
                reached = target
            self._record(stretch, positions, equilibrium)

    def _relax(self, stretch: float, positions: np.ndarray, tolerance: float):
        began = self.force.evaluations

        def report(evaluations: int, residual: float) -> None:
            self.residual = residual
            self.history.append({"stretch": stretch, "evaluation": began + evaluations, "residual": residual})
            self.progress.residual(evaluations, residual, tolerance)

        return self.solver.solve(self.force, positions, tolerance, report)

    def _record(self, stretch: float, positions: np.ndarray, equilibrium) -> None:
        axis, lateral = self.loading.axis, self.lateral
        displacements = positions - self.body.points
        # A hair off the middle, where a column of points may lie.
        section = measures.section_force(self.force, axis, self.middle + 1e-6 * self.body.spacing)
        _, low, high = measures.edge_displacements(self.body, displacements, lateral)
        level = {
            "stretch": stretch,
            "nominal_stress": float(section[axis] / self.width),
            "nominal_stress_work_conjugate": float(measures.mean_stress(self.force)[axis, axis]),
            "lateral_displacement": float((low - high).mean() / 2),
            "greatest_lateral_displacement": float(max(np.abs(low).max(), np.abs(high).max())),
            "roughness": measures.roughness(self.body, displacements, axis),
            "residual": equilibrium.residual,
            "evaluations": equilibrium.evaluations,
            "method": equilibrium.method,
        }
        if self.scene.reference == "uniaxial":
            exact = homogeneous.uniaxial(self.law, stretch)
            narrowing = (1 - exact.lateral_stretch) / 2 * self.width
            _compare(level, "nominal_stress", exact.nominal_stress)
            _compare(level, "lateral_displacement", narrowing)
            _compare(level, "greatest_lateral_displacement", narrowing)
        self.levels.append(level)
        self.states.append((stretch, measures.point_fields(self.force, positions)))

    def result(self, threads: int, seconds_compile: float, began: float, failure: str | None) -> Result:
        """Everything reached so far."""
        force, bonds = self.force, self.body.bonds
        residuals = [level["residual"] for level in self.levels]
        if failure is not None and self.residual is not None and np.isfinite(self.residual):
            residuals.append(self.residual)
        outside = force.fraction_outside
        summary = {
            "scene": self.scene.name,
            "force": self.model.name,
            "material": self.law.describe(),
            "n_points": len(self.body),
            "n_bonds": bonds.n_directed,
            "n_ghost_points": len(self.body.images),
            "spacing": self.scene.spacing,
            "horizon": self.scene.horizon,
            "precision": force.precision,
            "correction": force.correction,
            "support": self.scene.support,
            "threads": threads,
            "converged": failure is None,
            "failure": failure,
            "residual": max(residuals, default=None),
            "n_force_evaluations": force.evaluations,
            "seconds_total": time.perf_counter() - began,
            "seconds_compile": seconds_compile,
            "ns_per_bond": 1e9 * force.seconds / max(1, force.timed * bonds.n_directed),
            "fallback_fraction": outside if self.scene.outside == "fallback" else 0.0,
            "fraction_outside_domain": outside,
            "unsupported_points": len(force.kinematics.unsupported),
            "units": self.scene.units.model_dump(),
            "levels": self.levels,
        }
        return Result(self.scene, self.body, summary, self.history, self.states)


def _compare(level: dict, key: str, reference: float) -> None:
    level[f"{key}_reference"] = float(reference)
    level[f"{key}_error"] = float(level[key] / reference - 1) if reference else None
