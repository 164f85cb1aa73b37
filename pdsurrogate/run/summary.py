"""Summary of a run, and the result with it."""

from __future__ import annotations

import time

import numpy as np

from ..results import Result
from ..results.folder import INTERRUPTED
from ..results.provenance import provenance
from .run import Run


def _peak(history: list[dict]) -> dict | None:
    """Return the row of the greatest nominal stress, which is the load that a body with a crack bears; None without rows."""
    highest = max(history, key=lambda row: row["nominal_stress"], default=None)
    return highest and {key: highest[key] for key in ("time", "stretch", "nominal_stress") if key in highest}


def result_of(run: Run, seconds_compile: float, began: float, failure: str | None, status: str) -> Result:
    """Return the result that the run has reached so far."""
    force, state = run.force, run.state
    residuals = [level["residual"] for level in state.levels if "residual" in level]
    if failure is not None and run.residual is not None and np.isfinite(run.residual):
        residuals.append(run.residual)
    outside = force.fraction_outside
    total, stress = run.body.share.total, run.problem.measures.nominal_stress
    directed = total(run.directed_bonds())
    summary = {
        **run.problem.describe(),
        "force": run.contents.force,
        "plane": force.plane,
        "thickness": 1.0,
        "n_points": run.body.share.size,
        "n_bonds": total(run.counted_pairs()),
        "n_directed_bonds": directed,
        "n_ghost_points": total(int(run.body.share.own[run.body.ghosts.source].sum())),
        "spacing": run.body.spacing,
        "cell_size": run.body.cell.tolist(),
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
        "unsupported_points": run.unsupported_points(),
        "levels": state.levels,
        **run.contents.describe(),
        "provenance": provenance(),
    }
    if any(stage.inertia is not None for stage in run.stages):
        if stress is not None:
            stresses = [row["nominal_stress"] for row in [*state.levels, *state.history] if "nominal_stress" in row]
            summary["peak_nominal_stress"] = max(stresses, default=None)
        summary["n_steps"] = state.steps
        summary["dynamics"] = state.dynamics
    if state.crack is not None:
        summary["critical_stretch"] = run.problem.critical_stretch
        summary["crack"] = state.crack | ({} if stress is None else {"peak": _peak(state.history)})
    return Result(run.problem.scene, run.body if run.whole is None else run.whole, summary, state.history, run.states, state.convergence)
