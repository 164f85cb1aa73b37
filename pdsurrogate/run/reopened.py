"""Outputs of a result in equilibrium that are computed once more, in double precision on one
rank: checks, and the run that does so.
"""

from collections.abc import Sequence

import numpy as np

from ..forces import ForceModel
from ..ranks import communicator
from ..results import Result
from ..scenes import Scene
from .run import Run


def check_models(
    scene: Scene,
    models: Sequence[ForceModel],
    method: str = "sensitivity",
    what: str = "derivatives",
) -> None:
    """Raise ValueError if a force model does not permit `what` a method of the result returns:
    it needs double precision and a tangent.
    """
    for model in models:
        if not model.differentiable:
            why = "with which Newton's method does not find equilibria"
            raise ValueError(
                f"{method}: there are no {what} with {model.name}, {why}: the forces of"
                f" {model.name} have no energy: use bond-energy"
            )
        if any(term.keeps for term in model.terms(scene.plane)):
            raise ValueError(
                f"{method}: there are no {what} with {model.name}, whose forces depend on earlier"
                " states of the body"
            )
        if "float64" not in model.honored(scene.plane)["precision"]:
            raise ValueError(
                f"{method}: {model.name} cannot be evaluated in double precision, which {what} need"
            )


def number_of_output(
    scene: Scene, models: Sequence[ForceModel], result: Result, level: int, method: str, what: str
) -> int:
    """Return the number from 0 of an output in equilibrium of which a `method` of the result
    returns `what`, such as "derivatives".
    """
    if communicator().size > 1:
        raise ValueError(f"{method}: run the scene on one rank, without mpiexec")
    check_models(scene, models, method, what)
    levels = result.levels
    if not -len(levels) <= level < len(levels):
        raise IndexError(
            f"level: the result has {len(levels)} outputs, none with the number {level}"
        )
    number = level % len(levels)
    if "time" in levels[number]:
        raise ValueError(
            f"level: output {number} is one of dynamics; {what} are those of equilibria"
        )
    return number


def run_in_double(scene: Scene, models: Sequence[ForceModel]) -> Run:
    """Return a run of a scene, at rest, in double precision."""
    run = Run(scene, models)
    if run.force.precision != "float64":
        run.take_double()
    return run


def check_intact(run: Run, result: Result, number: int, what: str) -> None:
    """Raise ValueError if bonds are broken at an output."""
    # Bonds that a precut has cut are damage of the undeformed body as well; single precision of
    # files leaves 1e-7.
    if (
        run.damage is not None
        and (result.field("damage", number) > run.damage.at_points() + 1e-6).any()
    ):
        raise ValueError(
            f"level: bonds are broken at output {number}; {what} are those of bodies whose bonds"
            " are intact"
        )


def place(run: Run, positions: np.ndarray) -> None:
    """Bring a run to given positions (n, d), with its supports and loads in their places."""
    run.positions[:] = positions
    run.loading.apply(run.state.parameter, run.loaded, run.positions)
