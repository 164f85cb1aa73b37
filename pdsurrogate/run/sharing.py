"""Preparation of a run on several ranks: the check that all got the same input, the number of threads, and the compilation."""

import os
import warnings
from pathlib import Path

import numpy as np

from ..body import Body, ReflectionPlane
from ..body.body import Cells
from ..forces import ForceModel
from ..problem import Problem
from ..ranks import Communicator
from ..scenes import Scene, SceneError


class Oversubscribed(RuntimeWarning):
    """More threads than cores: ranks wait for each other in loops, and each keeps a core from those it waits for."""


def refuse_different(ranks: Communicator, scene: Scene, model: ForceModel, folder: str | Path | None, resume: bool) -> None:
    """Refuse ranks that were given different input, which would wait for each other.

    Raises
    ------
    SceneError
        Names the key.
    """
    given = {"scene": scene.model_dump_json(), "force": model.name, "folder": str(folder), "resume": resume}
    others = ranks.everywhere(given)
    different = [what for what in given if any(other[what] != others[0][what] for other in others)]
    if different:
        raise SceneError(
            f"scene {scene.name}: the ranks were not given the same {' and '.join(different)}; start all of them by one command"
        )


def threads_of(ranks: Communicator, asked: int | None, paying: int) -> int:
    """Return the number of threads of this rank: the one given, or else as many as pay, at most the cores per rank of its machine."""
    here = ranks.here()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    threads = asked or max(1, min(paying, cores // here))
    if here * threads > cores and ranks.rank == 0:
        what = f"{here} ranks of {threads} thread{'s' * (threads > 1)} each share {cores} cores"
        warnings.warn(f"{what}: each keeps the others waiting; take as many ranks as cores", Oversubscribed, stacklevel=3)
    return threads


def compile_first(ranks: Communicator, model: ForceModel, problem: Problem) -> None:
    """Compile the kernels on the first rank, so that the others load them and do not compete for its cores."""
    if ranks.rank == 0:
        dimension = problem.body.dimension
        cells = Cells.filling((0.0,) * dimension, (8.0 if dimension == 2 else 5.0,) * dimension, 1.0)
        points = cells.centres()
        planes = (ReflectionPlane(0, 0.0, -1, (-1,) * dimension),)
        body = Body(points, np.full(len(points), cells.volume), 3.15 if dimension == 2 else 1.75, 1.0, planes=planes)
        force = model.bind(body, problem.law, problem.settings)
        force(points.copy(), np.empty_like(points))
    ranks.barrier()
