"""Lowest mode of an equilibrium, theory (83a): the displacement that the body resists least, and whether it is stable."""

from collections.abc import Sequence

from threadpoolctl import threadpool_limits

from ..engine.threads import thread_count
from ..forces import ForceModel
from ..ranks import communicator
from ..results import Result
from ..results.lowest_mode import LowestMode
from ..scenes import Scene
from ..solvers.equilibrium import NotConverged
from ..solvers.methods import Newton
from ..solvers.stability import lowest_mode
from .run import Run, Silent
from .sensitivity import BALANCED, check_precision


def lowest_mode_of(scene: Scene, models: Sequence[ForceModel], result: Result, level: int) -> LowestMode:
    """Return the lowest mode of a result in equilibrium, see `Result.lowest_mode`; `models` are those of its run."""
    if communicator().size > 1:
        raise ValueError("lowest_mode: run the scene on one rank, without mpiexec")
    check_precision(scene, models)
    levels, loading = result.levels, "stretch" if scene.stretched else "t"
    if not -len(levels) <= level < len(levels):
        raise IndexError(f"level: the result has {len(levels)} outputs, none with the number {level}")
    number = level % len(levels)
    if "time" in levels[number]:
        raise ValueError(f"level: output {number} is one of dynamics; the lowest mode is that of an equilibrium")
    with thread_count(None), threadpool_limits(1, user_api="blas"):
        run = Run(scene, models, Silent())
        if run.force.precision != "float64":
            run.take_double()
        if not run.force.has_energy:
            raise ValueError(f"lowest_mode: {models[0].name} is a bond force without energy: use a force with one, such as bond-energy")
        if not run.loaded.has_energy:
            raise ValueError(f"lowest_mode: the loads have no energy: {run.loaded.no_energy_because}")
        if run.loading.supports or getattr(run.loaded, "rigid", ()):
            raise ValueError("lowest_mode: the scene has rigid regions or supports between points, with which modes are not computed")
        # Bonds that a precut has cut are damage of the undeformed body as well; single precision of files leaves 1e-7.
        if run.damage is not None and (result.field("damage", number) > run.damage.at_points() + 1e-6).any():
            raise ValueError(f"level: bonds are broken at output {number}; modes are those of bodies whose bonds are intact")
        at = run.state.parameter = levels[number][loading]
        run.positions[:] = run.body.points + result.displacement(number)
        run.loading.apply(at, run.loaded, run.positions)
        preconditioner = Newton(run.loading.free, run.body.volumes, BALANCED).preconditioner(run.loaded)
        try:
            eigenvalue, error, mode = lowest_mode(run.loaded, run.positions, run.loading.free, preconditioner)
        except NotConverged as problem:
            raise ValueError(f"lowest_mode at {loading} {at:g}: {problem}") from None
    return LowestMode(eigenvalue, error, mode)
