"""Checks of outputs of a result in equilibrium that are computed once more, in double precision
on one rank.
"""

from collections.abc import Sequence

from ..forces import ForceModel
from ..problem import Problem
from ..ranks import communicator
from ..results import Result
from ..scenes import Scene
from .damage import Damage


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
        if "float64" not in model.honored(scene.plane)["precision"]:
            raise ValueError(
                f"{method}: {model.name} cannot be evaluated in double precision, which {what} need"
            )
    keeps = any(term.keeps for model in models for term in model.terms(scene.plane))
    if keeps or (scene.remembers and method == "lowest_mode"):
        raise ValueError(
            f"{method}: there are no {what} here: the forces depend on earlier states of the body"
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
    if "kinetic_energy" in levels[number]:
        raise ValueError(
            f"level: output {number} is one of dynamics; {what} are those of equilibria"
        )
    return number


def check_intact(problem: Problem, result: Result, number: int, what: str) -> None:
    """Raise ValueError if bonds are broken at an output."""
    # Bonds that a precut has cut are damage of the undeformed body as well; single precision of
    # files leaves 1e-7.
    critical = problem.critical_stretches
    if (
        critical is not None
        and (
            result.field("damage", number)
            > Damage(problem.body, critical.of_pairs()).at_points() + 1e-6
        ).any()
    ):
        raise ValueError(
            f"level: bonds are broken at output {number}; {what} are those of bodies whose bonds"
            " are intact"
        )
