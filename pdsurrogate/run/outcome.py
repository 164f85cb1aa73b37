"""Result of a run with its summary, complete or as far as the run came."""

import time
from collections.abc import Sequence
from functools import partial

import numpy as np

from ..forces import ForceModel
from ..results import Result
from ..results.folder import INTERRUPTED
from ..results.provenance import provenance
from ..scenes import Scene
from .cracks import crack_path
from .derivatives import differentiate
from .lowest_mode import lowest_mode_of
from .run import Run
from .standard_errors import standard_errors


def _peak(history: list[dict]) -> dict | None:
    """Return the most that a cracked body bears, with its time and loading parameter: the history's
    greatest nominal stress or, without it, the greatest force and the name of its support or load;
    None without history.
    """

    def forces(row: dict) -> dict[str, float]:
        """Magnitude of the force of each support and load."""
        components: dict[str, list[float]] = {}
        for column, value in row.items():
            if column.startswith("force_"):
                components.setdefault(column[6:-2], []).append(value)
        return {name: float(np.linalg.norm(each)) for name, each in components.items()}

    def borne(row: dict) -> dict:
        if "nominal_stress" in row:
            return {"nominal_stress": row["nominal_stress"]}
        force, name = max(((force, name) for name, force in forces(row).items()), default=(0.0, ""))
        return {"force": force, "name": name}

    rows = [
        {key: row[key] for key in ("time", "stretch", "t") if key in row} | borne(row)
        for row in history
    ]
    return max(rows, key=lambda row: row.get("nominal_stress", row.get("force")), default=None)


def result_of(
    run: Run, seconds_compile: float, began: float, failure: str | None, status: str
) -> Result:
    """Return the result of a run, complete or as far as it was reached, with its summary.

    `began` is the start of the run by `time.perf_counter`, `failure` the message of the error that
    ended the run, or None.
    """
    force = run.force
    state = run.state
    residuals = [level["residual"] for level in state.levels if "residual" in level]
    if failure is not None and run.residual is not None and np.isfinite(run.residual):
        residuals.append(run.residual)
    outside = force.fraction_outside
    share = run.body.share
    bonds = run.body.bonds
    stress = run.problem.measures.nominal_stress
    # without bonds to images; an undirected bond counts at each end
    to_images = np.count_nonzero(share.own[bonds.first[bonds.second >= len(run.body)]])
    directed = share.total(int(np.diff(bonds.pointers)[share.own].sum() - to_images))
    summary = {
        **run.problem.describe(),
        "force": run.contents["force"],
        "plane": force.plane,
        "thickness": 1.0,
        "n_points": share.size,
        "n_bonds": share.total(
            int(np.diff(bonds.pairs_of_points[0])[: len(run.body)][share.own].sum())
        ),
        "n_directed_bonds": directed,
        "n_ghost_points": share.total(int(share.own[run.body.ghosts.source].sum())),
        "spacing": run.body.spacing,
        "cell_size": np.asarray(run.body.cell).tolist(),
        "horizon": run.body.horizon,
        "precision": force.precision,
        "correction": force.correction,
        **({"ranks": run.ranks.size} if run.ranks.size > 1 else {}),
        "threads": run.threads,
        "status": status,
        "converged": failure is None,
        "interrupted": status == INTERRUPTED,
        "failure": failure,
        "residual": max(residuals, default=None),
        "n_force_evaluations": force.evaluations,
        "seconds_total": time.perf_counter() - began,
        "seconds_compile": seconds_compile,
        "ns_per_directed_bond": 1e9 * force.seconds / max(1, force.timed * directed),
        "fallback_fraction": outside if run.problem.settings.outside in (None, "fallback") else 0.0,
        "fraction_outside_domain": outside,
        **({"beyond_data": state.beyond_data} if state.beyond_data else {}),
        "unsupported_points": share.count(~force.supported),
        "levels": state.levels,
        **run.contents,
        "provenance": provenance(),
    }
    moving = any(stage.inertia is not None for stage in run.stages)
    if stress is not None and (moving or any(stage.tears for stage in run.stages)):
        stresses = [
            row["nominal_stress"]
            for row in [*state.levels, *state.history]
            if "nominal_stress" in row
        ]
        summary["peak_nominal_stress"] = max(stresses, default=None)
    if moving:
        summary["n_steps"] = state.steps
        summary["dynamics"] = state.dynamics
    if state.tear is not None:
        from .tear_account import tear_entry  # what most scenes do not need

        summary["quasi_static"] = tear_entry(run)
    if state.crack is not None:
        summary |= (
            {} if run.problem.critical_stretches is None else run.problem.critical_stretches.summary
        )
        if run.problem.strengths is not None:
            summary["strength"] = run.problem.strengths.summary
        summary["crack"] = state.crack | {
            "path": crack_path(state.crack["tips"]),
            "peak": _peak(state.history),
        }
    scene = run.problem.scene
    body = run.body if run.whole is None else run.whole
    return Result(
        scene,
        body,
        summary,
        state.history,
        run.states,
        state.convergence,
        **methods_of(scene, run.problem.models),
    )


def methods_of(scene: Scene, models: Sequence[ForceModel]) -> dict[str, partial]:
    """Return the functions behind methods of `Result`, such as `Result.sensitivity`, with the
    scene and the force models of the run.
    """
    return {
        "differentiated": partial(differentiate, scene, models),
        "uncertain": partial(standard_errors, scene, models),
        "resisting": partial(lowest_mode_of, scene, models),
    }
