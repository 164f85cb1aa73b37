"""Levels of the loading programme, each in equilibrium."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..materials import homogeneous
from ..results import measures
from ..scenes import Rectangle
from ..scenes.references import finite_element_level
from ..solvers import SOLVERS, EquilibriumSolver
from .run import Run

if TYPE_CHECKING:
    from ..damage import Damage


def solver_of(run: Run) -> EquilibriumSolver:
    """The solver that the scene asks for."""
    spec = run.scene.solver
    return SOLVERS[spec.method](run.loading.free, run.body.volumes, spec.tolerance, spec.most_evaluations)


def go_through_levels(run: Run, solver: EquilibriumSolver, damage: Damage | None) -> None:
    """Go through the levels that are left, each from the last, by increments of a bounded size.

    Where a bond would break the levels end, and the body is put back to the last one: what follows is not in equilibrium.
    """
    spec = run.scene.solver
    for number in range(len(run.levels), len(run.scene.stretches)):
        stretch, reached = run.scene.stretches[number], run.stretch
        run.progress.level(number, stretch)
        run.target = stretch
        last_level = run.positions.copy(), run.stretch
        steps = max(1, int(np.ceil(abs(stretch - reached) / spec.largest_increment - 1e-9)))
        for target in np.linspace(reached, stretch, steps + 1)[1:]:
            guess = run.loading.stretched(run.positions, run.stretch, target)
            last = target == stretch
            # States on the way need not be exact: they only bring the next start near.
            tolerance = spec.tolerance if last else max(spec.tolerance, 1e-3)
            run.loading.apply(target, run.force, guess)
            run.positions[:] = guess
            equilibrium = _solve(run, solver, stretch, tolerance)
            run.stretch = float(target)
            if damage is not None and len(damage.overstretched(run.force.kinematics.positions)):
                run.positions[:], run.stretch = last_level
                run.loading.apply(run.stretch, run.force, run.positions)
                return
        _record(run, equilibrium)
        run.checkpoint({"phase": "levels", "gave_up": solver.gave_up}, {})


def _solve(run: Run, solver: EquilibriumSolver, stretch: float, tolerance: float):
    began = run.force.evaluations

    def report(evaluations: int, residual: float) -> None:
        run.residual = residual
        row = {"stretch": stretch, "evaluation": began + evaluations, "residual": residual}
        run.history.append(row | ({"energy": run.force.energy()} if hasattr(run.force, "energy") else {}))
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
        "nominal_stress_work_conjugate": float(measures.mean_stress(run.force)[axis, axis]),
    }
    if hasattr(run.force, "energy"):
        level["energy"] = run.force.energy()
    if isinstance(run.scene.body, Rectangle):
        # Other outlines have no straight edges to read displacements from.
        _, low, high = measures.edge_displacements(body, displacements, 1 - axis)
        level["lateral_displacement"] = float((low - high).mean() / 2)
        level["greatest_lateral_displacement"] = float(max(np.abs(low).max(), np.abs(high).max()))
        level["roughness"] = measures.roughness(body, displacements, axis)
    level |= {"residual": equilibrium.residual, "evaluations": equilibrium.evaluations, "method": equilibrium.method}
    for key, reference in _references(run, stretch).items():
        if key in level:
            level[f"{key}_reference"] = float(reference)
            level[f"{key}_error"] = float(level[key] / reference - 1) if reference else None
    run.levels.append(level)
    run.record(measures.point_fields(run.force, run.positions))


def _references(run: Run, stretch: float) -> dict[str, float]:
    if run.scene.reference == "uniaxial":
        try:
            exact = homogeneous.uniaxial(run.law, stretch)
        except ValueError:  # the law has no such state: there is nothing to compare with
            return {}
        narrowing = (1 - exact.lateral_stretch) / 2 * run.width
        return {
            "nominal_stress": exact.nominal_stress,
            "lateral_displacement": narrowing,
            "greatest_lateral_displacement": narrowing,
        }
    if run.scene.reference == "finite-elements":
        return finite_element_level(run.scene, stretch)
    return {}
