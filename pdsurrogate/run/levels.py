"""Levels of the loading programme, each in equilibrium."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..forces import InvalidState
from ..results import measures
from ..scenes import Rectangle, SceneError
from ..scenes.references import reference_level
from ..solvers import SOLVERS, Diverging, Equilibrium, EquilibriumSolver, Increments, NotConverged, Unstable
from ..solvers.branch import Branch
from .run import Run

if TYPE_CHECKING:
    from .fracture import Damage


def solver_of(run: Run) -> EquilibriumSolver:
    """The solver that the scene asks for.

    Raises
    ------
    SceneError
        If it does not work with the run's force.
    """
    spec = run.scene.solver
    solver = SOLVERS[spec.method]
    if solver.needs_energy and not run.force.has_energy:
        raise SceneError(
            f"scene {run.scene.name}: solver.method={spec.method} needs a force that has an energy, as bond-energy does; "
            f"{run.model.name} has none, so take another solver.method"
        )
    return solver(run.loading.free, run.body.volumes, spec.tolerance, spec.most_evaluations, run.reductions)


def go_through_levels(run: Run, solver: EquilibriumSolver, damage: Damage | None) -> None:
    """Go through the levels that are left, each from the last, by increments of a bounded size.

    Where an increment finds no equilibrium, or not the one looked for, it is taken back and shortened.  Where a bond would break the
    levels end, and the body is put back to the last one: what follows is not in equilibrium.
    """
    spec, branch = run.scene.solver, Branch(run.loading, run.force, run.reductions)
    for number in range(len(run.levels), len(run.scene.stretches)):
        stretch, reached = run.scene.stretches[number], run.stretch
        run.progress.level(number, stretch)
        run.target = stretch
        last_level = run.positions.copy(), run.stretch
        increments, wasted = Increments(reached, stretch, spec.largest_increment), 0
        while not increments.finished:
            accepted, began = _Accepted(run, solver), run.force.evaluations
            try:
                equilibrium = _follow(run, solver, branch, increments)
            except (NotConverged, Diverging, InvalidState, Unstable) as error:
                wasted += run.force.evaluations - began
                _take_back(run, solver, accepted, increments, error, wasted)
                continue
            increments.accept()
            if damage is not None and run.reductions.any(len(damage.overstretched(run.force.positions)) > 0):
                run.positions[:], run.stretch = last_level
                run.loading.apply(run.stretch, run.force, run.positions)
                return
        _record(run, equilibrium)
        run.checkpoint({"phase": "levels", "gave_up": solver.gave_up}, {})


class _Accepted:
    """The equilibrium that the next increment starts from, and comes back to if it fails."""

    def __init__(self, run: Run, solver: EquilibriumSolver) -> None:
        self.stretch, self.positions, self.gave_up = run.stretch, run.positions.copy(), solver.gave_up
        self._arrays = {key: array.copy() for key, array in run.force.state_arrays().items()}

    def restore(self, run: Run, solver: EquilibriumSolver) -> None:
        run.stretch, solver.gave_up = self.stretch, self.gave_up
        run.positions[:] = self.positions
        for key, array in run.force.state_arrays().items():
            array[:] = self._arrays[key]
        run.loading.apply(run.stretch, run.force, run.positions)


def _follow(run: Run, solver: EquilibriumSolver, branch: Branch, increments: Increments) -> Equilibrium:
    """Bring the run to equilibrium at the end of the present increment."""
    target, spec = increments.target, run.scene.solver
    guess = run.loading.stretched(run.positions, run.stretch, target)
    # States on the way need not be exact: they only bring the next start near.
    tolerance = spec.tolerance if increments.ends else max(spec.tolerance, 1e-3)
    run.loading.apply(target, run.force, guess)
    run.positions[:] = guess
    equilibrium = _solve(run, solver, target, tolerance)
    branch.check(run.stretch, target, guess, run.positions)
    run.stretch = target
    return equilibrium


def _take_back(run: Run, solver: EquilibriumSolver, accepted: _Accepted, increments: Increments, error: Exception, wasted: int) -> None:
    """Go back to before an increment that failed, and shorten it.

    Raises
    ------
    NotConverged, Diverging, InvalidState, Unstable
        What failed, with how far the loading came, where the increment cannot be shorter, or the failures of a level have taken as many
        evaluations as a solution may.
    """
    row = {"stretch": run.target, "increment": increments.target, "evaluation": run.force.evaluations, "failure": str(error)}
    run.history.append(row)
    accepted.restore(run, solver)
    size, first = increments.size, increments.share == 1
    if wasted < run.scene.solver.most_evaluations and increments.shorten():
        return
    if first:
        raise error
    reached = f"equilibrium was followed to stretch {run.stretch:.4g}, and not further with increments down to {size:.2g}"
    raise type(error)(f"{error}; {reached}") from error


def _solve(run: Run, solver: EquilibriumSolver, target: float, tolerance: float) -> Equilibrium:
    began = run.force.evaluations

    def report(evaluations: int, residual: float) -> None:
        run.residual = residual
        row = {"stretch": run.target, "increment": target, "evaluation": began + evaluations, "residual": residual}
        run.history.append(row | ({"energy": run.strain_energy()} if run.force.has_energy else {}))
        run.progress.residual(evaluations, residual, tolerance)
        run.interruption.check()

    return solver.solve(run.force, run.positions, tolerance, report)


def _record(run: Run, equilibrium) -> None:
    axis, body, stretch = run.loading.axis, run.body, run.stretch
    displacements = run.positions - body.points
    reactions = run.loading.reactions(run.force)
    level = {
        "stretch": stretch,
        "nominal_stress": run.nominal_stress(reactions),
        "nominal_stress_grip": run.stress_grip.edge,
        "nominal_stress_area": run.grip_areas[run.stress_grip.edge],
        "forces": {grip.edge: reaction.tolist() for grip, reaction in zip(run.scene.grips, reactions, strict=True)},
        "nominal_stress_work_conjugate": float(run.force.mean_stress()[axis, axis]),
    }
    if run.force.has_energy:
        level["energy"] = run.strain_energy()
    if run.loading.pull(reactions) < -run.scene.solver.tolerance * run.force.law.shear_modulus * min(run.grip_areas.values()):
        level["stability"] = "checked" if run.force.has_energy else "not checked"
    if isinstance(run.scene.body, Rectangle):
        # Other outlines have no straight edges to read displacements from.
        _, low, high = measures.edge_displacements(body, displacements, 1 - axis)
        level["lateral_displacement"] = float((low - high).mean() / 2)
        level["greatest_lateral_displacement"] = float(max(np.abs(low).max(), np.abs(high).max()))
        level["roughness"] = measures.roughness(body, displacements, axis)
    level |= {"residual": equilibrium.residual, "evaluations": equilibrium.evaluations, "method": equilibrium.method}
    for key, reference in reference_level(run.scene, stretch).items():
        if key in level:
            level[f"{key}_reference"] = float(reference)
            level[f"{key}_error"] = float(level[key] / reference - 1) if reference else None
    run.levels.append(level)
    run.record()
