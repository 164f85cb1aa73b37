"""Lowest mode of an equilibrium, theory (83a): the displacement that the body resists least, and
whether it is stable.
"""

from collections.abc import Sequence

from threadpoolctl import threadpool_limits

from ..engine.threads import thread_count
from ..forces import ForceModel
from ..problem import compile_scene
from ..results import Result
from ..results.lowest_mode import LowestMode
from ..scenes import Scene
from ..solvers.equilibrium import NotConverged
from ..solvers.preconditioner import preconditioner_of
from ..solvers.quasi_newton import EnergyMinimizer
from ..solvers.stability import lowest_mode
from .reopened import check_intact, number_of_output
from .system import bound


def lowest_mode_of(
    scene: Scene, models: Sequence[ForceModel], result: Result, level: int
) -> LowestMode:
    """Return the lowest mode of a result in equilibrium, see `Result.lowest_mode`; `models` are
    those of its run.
    """
    loading = "stretch" if scene.stretched else "t"
    number = number_of_output(scene, models, result, level, "lowest_mode", "modes")
    with thread_count(None), threadpool_limits(1, user_api="blas"):
        system = bound(compile_scene(scene, models), "float64")
        if not system.force.has_energy:
            raise ValueError(
                f"lowest_mode: {models[0].name} is a bond force without energy: use a force with"
                " one, such as bond-energy"
            )
        if not system.loaded.has_energy:
            raise ValueError(
                f"lowest_mode: the loads have no energy: {system.loaded.no_energy_because}"
            )
        if system.loading.supports or system.loaded.rigid:
            raise ValueError(
                "lowest_mode: the scene has rigid regions or supports between points, with which"
                " modes are not computed"
            )
        check_intact(system.problem, result, number, "modes")
        at = system.state.parameter = result.levels[number][loading]
        system.place(system.body.points + result.displacement(number))
        if system.loads.obstacles:  # finds their pushes
            EnergyMinimizer(system.loading.free, system.body.volumes).solve(
                system.loaded, system.positions
            )
        preconditioner = preconditioner_of(system.loaded, system.loading.free, bending=True)
        try:
            eigenvalue, error, mode = lowest_mode(
                system.loaded, system.positions, system.loading.free, preconditioner
            )
        except NotConverged as problem:
            raise ValueError(f"lowest_mode at {loading} {at:g}: {problem}") from None
    return LowestMode(eigenvalue, error, mode)
