"""Measurements at an output: the rows of ``summary["levels"]``, and the forces in the history."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..body import Body
from ..results import measures
from ..scenes import Rectangle
from ..scenes.references import reference_level

if TYPE_CHECKING:
    from ..solvers.conditions import Reactions
    from .run import Run


def forces_by_name(run: Run, reactions: Reactions) -> dict[str, np.ndarray]:
    """Force on the body of everything that holds or loads it, shape (d,), in the state last evaluated; in the plane per unit thickness."""
    forces = dict(zip(run.loading.names, reactions.forces, strict=True))
    if run.loads is not None:
        for name, force in run.loads.by_name(run.positions, run.loaded.thickness()).items():
            forces[name] = forces.get(name, 0.0) + force
    return forces


def moments_by_name(run: Run, reactions: Reactions) -> dict[str, list | float]:
    """Return moments of supports and loads about the origin: one number, counter-clockwise, in two dimensions, three in three."""
    moments = dict(zip(run.loading.names, run.loading.moments(run.loaded, reactions), strict=True))
    if run.loads is not None:
        for name, moment in run.loads.moments(run.positions, np.zeros(run.body.dimension), run.loaded.thickness()).items():
            moments[name] = moments.get(name, 0.0) + moment
    return {name: moment.tolist() for name, moment in moments.items()}


def displacements_by_name(run: Run) -> dict[str, np.ndarray]:
    """Mean displacement of everything that holds or loads the body, shape (d,), at its present positions."""
    found = dict(zip(run.loading.names, run.loading.displacements(run.parameter, run.positions), strict=True))
    if run.loads is not None:
        found = run.loads.displacements(run.positions) | found
    return found


def displacement_columns(run: Run) -> dict[str, float]:
    """Return the displacements of `displacements_by_name` as columns of the history."""
    return {
        f"displacement_{name}_{component}": float(value)
        for name, displacement in displacements_by_name(run).items()
        for component, value in enumerate(displacement, 1)
    }


def place_columns(run: Run, time: float | None = None) -> dict:
    """The columns that every row of the history begins with: where it is in the programme, and what it has taken to come there."""
    row = {"step": run.stage, run.loading.parameter: run.parameter, "evaluations": run.force.evaluations}
    return row if time is None else row | {"time": time}


def equilibrium_columns(run: Run, level: dict) -> dict:
    """Row of the history at an output in equilibrium, with the measures of its level."""
    row = place_columns(run)
    if run.scene.stretched:
        row["nominal_stress"] = level["nominal_stress"]
    row["strain_energy"] = run.strain_energy()
    row |= force_columns(level["forces"]) | moment_columns(level.get("moments", {}))
    for name, told in level.get("rigid", {}).items():
        row |= force_columns({f"{name}_rigid": told["force"]}) | moment_columns({f"{name}_rigid": told["moment"]})
    return row | displacement_columns(run) | probe_columns(run)


def force_columns(forces: dict[str, np.ndarray | list]) -> dict[str, float]:
    """Forces by name as columns of the history."""
    return {f"force_{name}_{component}": float(value) for name, force in forces.items() for component, value in enumerate(force, 1)}


def moment_columns(moments: dict[str, list | float]) -> dict[str, float]:
    """Moments by name as columns of the history; of a vector one for each component."""
    columns = {}
    for name, moment in moments.items():
        parts = {f"_{component}": value for component, value in enumerate(moment, 1)} if isinstance(moment, list) else {"": moment}
        columns |= {f"moment_{name}{which}": value for which, value in parts.items()}
    return columns


def output_row(run: Run, time: float | None = None, drive: float | None = None) -> dict:
    """Return the entries of every output of a general programme: its place in the programme, and all forces and moments.

    Parameters
    ----------
    run : Run
        With its force evaluated at its positions.
    time : float, optional
        Since the dynamics began; none in equilibrium.
    drive : float, optional
        See `force_balance`.
    """
    reactions = run.loading.reactions(run.loaded)
    row: dict = {run.loading.parameter: run.parameter, "step": run.stage}
    if time is None:
        row["force_balance"] = force_balance(run, reactions, drive)
    else:
        row["time"] = time
    row["forces"] = {name: force.tolist() for name, force in forces_by_name(run, reactions).items()}
    row["moments"] = moments_by_name(run, reactions)
    row["displacements"] = {name: displacement.tolist() for name, displacement in displacements_by_name(run).items()}
    if run.force.has_energy:
        row["energy"] = run.strain_energy()
    if regions := getattr(run.loaded, "rigid", ()):
        internal = run.loading.internal_forces(run.force)
        row["rigid"] = {region.name: region.told(run.positions, internal) for region in regions}
    return row | probe_readings(run)


def probe_readings(run: Run) -> dict:
    """Return the values at the probes in the present state as an entry of a row; an empty one without probes."""
    if not len(run.probes):
        return {}
    return {"probes": run.probes.read(measures.PointState(run.force, run.positions))}


def probe_columns(run: Run) -> dict[str, float]:
    """Displacements that the probes read, as columns of the history."""
    return run.probes.columns(run.positions - run.body.points)


def force_balance(run: Run, reactions: Reactions, drive: float | None) -> float | None:
    """Size of the sum of all loads and reactions over the forces that drive the body (`Equilibrium.drive`); None where nothing does."""
    if not drive:
        return None
    total = reactions.on_planes.sum(axis=0)
    if reactions.at_points is not None:
        total = total + [run.body.share.sum(column) for column in reactions.at_points.T]
    if run.loads is not None:
        total = total + sum(run.loads.by_name(run.positions, run.loaded.thickness()).values())
    return float(np.linalg.norm(total) / drive)


def level_row(run: Run, drive: float | None) -> dict:
    """Return the measurements of an equilibrium, without those of its solution; `drive` as in `force_balance`."""
    if run.scene.stretched:
        return _stretched(run, drive)
    row = output_row(run, drive=drive)
    if run.loading.pushes(run.loaded):
        row["stability"] = "checked" if run.loaded.has_energy else "not checked"
    return row


def _stretched(run: Run, drive: float | None) -> dict:
    """An equilibrium between two grips."""
    axis, stretch = run.loading.axis, run.parameter
    reactions = run.loading.reactions(run.force)
    level = {
        "stretch": stretch,
        "nominal_stress": run.nominal_stress(reactions.forces),
        "nominal_stress_grip": run.stress_grip.edge,
        "nominal_stress_area": run.grip_areas[run.stress_grip.edge],
        "forces": {name: force.tolist() for name, force in forces_by_name(run, reactions).items()},
        "displacements": {name: displacement.tolist() for name, displacement in displacements_by_name(run).items()},
        "force_balance": force_balance(run, reactions, drive),
        "nominal_stress_work_conjugate": float(run.body.share.total(run.force.mean_stress())[axis, axis]),
    }
    if run.force.has_energy:
        level["energy"] = run.strain_energy()
    if run.loading.pull(reactions) < -run.scene.solver.tolerance * run.force.law.shear_modulus * min(run.grip_areas.values()):
        level["stability"] = "checked" if run.force.has_energy else "not checked"
    if isinstance(run.scene.body, Rectangle):
        # Other outlines have no straight edges to read displacements from.
        displacements = run.body.share.gather(run.positions - run.body.points)
        level |= run.ranks.to_all(None if displacements is None else _lateral(run.whole, displacements, axis))
    return level | probe_readings(run)


def _lateral(body: Body, displacements: np.ndarray, axis: int) -> dict[str, float]:
    """Return the lateral displacements of the edges of a rectangle from the displacements (n, 2) of its points."""
    _, low, high = measures.edge_displacements(body, displacements, 1 - axis)
    return {
        "lateral_displacement": float((low - high).mean() / 2),
        "greatest_lateral_displacement": float(max(np.abs(low).max(), np.abs(high).max())),
        "roughness": measures.roughness(body, displacements, axis),
    }


def compare(run: Run, level: dict) -> None:
    """Add the values of the scene's reference to a level, and its deviations from them."""
    if not run.scene.stretched:
        return
    for key, reference in reference_level(run.scene, level["stretch"]).items():
        if key in level:
            level[f"{key}_reference"] = float(reference)
            level[f"{key}_error"] = float(level[key] / reference - 1) if reference else None
