"""Steps of a stage in dynamics between two that need Python."""

import numpy as np

from ..engine.passes import BoundPass
from ..forces import InvalidState
from ..solvers.dynamics import ExplicitDynamics
from ..solvers.step_runs import StepRuns
from .account import STEPS_PER_ROW, Bookkeeping
from .run import Run


class QuickSteps:
    """Steps without a row, an estimate of the time step, or bonds that break, of a body whose
    steps `can_run` in compiled code; their bits are those of `Transient.step`.

    Parameters
    ----------
    run : Run
    integrator : ExplicitDynamics
    books : Bookkeeping
    search : BoundPass, optional
        Pass that finds bonds that break.
    apart : int
        Steps from row to row of the history.
    """

    def __init__(
        self,
        run: Run,
        integrator: ExplicitDynamics,
        books: Bookkeeping,
        search: BoundPass | None,
        apart: int,
    ) -> None:
        self._run = run
        self.integrator = integrator
        self._books = books
        self._apart = apart
        self._runs = StepRuns(integrator, run.loading, apart, search)

    def take(self, due: float) -> float | None:
        """Take steps before the time `due` of the next output until one needs Python.

        Return the length of a step that has moved the points and is not done; None if all are.
        """
        run = self._run
        integrator = self.integrator
        account = self._books.account
        crack = run.state.crack
        number = integrator.steps
        apart = self._apart, integrator.STEPS_BETWEEN_ESTIMATES
        most = min(each - number % each for each in apart) - 1
        quiet = number + 1 - max(account.last_break, account.last_drift) >= STEPS_PER_ROW
        if not quiet or (crack is not None and crack["broken_bonds"]):
            return None
        spans, times = self._plan(most, due)
        if not times:
            return None
        viscosity = integrator.viscosity
        try:
            supports = self._books.supports(times, float(spans[-1, 2]))
        except InvalidState:  # of an amplitude, in a later step
            return None
        moving = supports.planes_move
        unknown = not self._runs.has_planes or (viscosity > 0 and account.on_planes is None)
        stops = supports.uneven | (moving != moving[0]) | (moving & unknown)
        count = int(np.argmax(stops)) if stops.any() else len(times)
        if not count:
            return None
        some = supports.first(count)
        done, taken = self._runs(spans[:count], some.now, some.ahead)
        if done:
            if not moving[0]:
                taken = taken._replace(on_planes=None)
            self._books.add_steps(times[:done], spans[:done], taken, supports.first(done))
            run.state.steps += done
            account.time = times[done - 1]
            run.state.parameter = run.target = float(supports.parameters[done])
            integrator.moved(float(spans[done - 1, 0]), done)
            integrator.longest = integrator.part_of(due - account.time)
            run.force.elapse(0.0)
        return None if done == count else float(spans[done, 0])

    def _plan(self, most: int, due: float) -> tuple[np.ndarray, list[float]]:
        """Return the spans of the next steps (k, 4), at most so many, and the times at which they
        end, before the time `due`.
        """
        integrator = self.integrator
        time = self._books.account.time
        last = integrator.last_step
        step = integrator.next_step()
        spans = []
        times = []
        for _ in range(most):
            if step == due - time or time + step >= due:
                break
            time += step
            following = min(integrator.time_step, integrator.part_of(due - time))
            spans.append((step, last, following, integrator.followed_in(step)))
            times.append(time)
            last, step = step, following
        return np.array(spans), times
