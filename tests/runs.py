"""Runs that are started and not driven, so that a test looks at their parts."""

from pathlib import Path

import pdsurrogate as pds
from pdsurrogate.forces import ForceModel
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.run.run import Run


def started(
    scene: pds.Scene, force: str | ForceModel = "bond-energy", folder: Path | None = None
) -> Run:
    """Return a run of a scene with a force model, given by itself or by its name, before its
    first stage.
    """
    model = pds.load_surrogate(force) if isinstance(force, str) else force
    return Run(scene, checked_models(scene, model), folder)
