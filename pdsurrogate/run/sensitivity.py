"""Sensitivities of an equilibrium (theory, section 23): derivatives of its measurements by
parameters of the scene.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from ..engine.threads import thread_count
from ..solvers.control import DisplacementControl
from ..solvers.equilibrium import NotConverged
from ..solvers.methods import Newton
from ..solvers.tangent import TangentEquations
from .controlled import control_of, displacement_of
from .differentiated import Change, Differentiated
from .parameters import names_below

ROUGH = 1e-4
"""Relative residual of each solution of the linear equations. Differences of forces along the
displacements found give the residual anew; its solution is the next correction.
"""

EXACT = 3e-7
LEAST_EXACT = 1e-6
"""Estimated error of derivatives, divided by the greatest derivative by the same parameter, at
which corrections end, and greatest such error without a warning.
"""

MOST_ROUNDS = 8
IDLE = 0.5
"""Greatest number of corrections, of which two are usual, and four where K = 10,000 mu; and ratio
of the estimated errors after and before a correction above which the correction counts as idle:
rounding limits the derivatives.
"""

SINGULAR = 1e-2
"""Estimated error of the derivatives of the displacements, relative to the greatest one, beyond
which the tangent counts as singular, unless rounding explains it.
"""

TINY = 1e-9
"""Estimated error of the derivatives of the displacements, relative to the greatest one, below
which errors of measurements are due to rounding.
"""

RESTING = 1e-2
"""Greatest displacement by a parameter as a whole, divided by the greatest displacement of the
body, that errors of derivatives of displacements at a controlled displacement are compared with: by
the moduli together or by the load the body does not move at all.
"""

MOST_CONTRAST = 2e4
"""Greatest K/mu with adjoint equations. Their estimated errors leave out rounding, whose errors
stay below 1e-6 up to this K/mu. Forward solutions show the errors by rounding in the corrections.
"""


@dataclass(frozen=True)
class Jacobian:
    """Measurements of an equilibrium, and their derivatives by parameters.

    Attributes
    ----------
    names : tuple of str
        Names of the measurements: dotted keys of an output, then ``"places.0.0"`` and so on for
        place and component.
    values : ndarray, shape (measurements,)
    derivatives : ndarray, shape (measurements, parameters)
    displacements : ndarray, shape (n, d)
        Displacements of the points in equilibrium.
    moved : ndarray, shape (parameters, n, d), or None
        Derivatives of the displacements; None if there are fewer measurements than parameters,
        where adjoint equations are solved.
    errors : ndarray, shape (measurements, parameters)
        Estimated errors of the derivatives.
    history : dict of ndarray
        By parameter, the derivatives of the history that contains the equilibrium, flat.
    """

    names: tuple[str, ...]
    values: np.ndarray
    derivatives: np.ndarray
    displacements: np.ndarray
    moved: np.ndarray | None
    errors: np.ndarray
    history: dict[str, np.ndarray]


def jacobian(
    body: Differentiated,
    at: float,
    displacements: np.ndarray,
    outputs: Sequence[str],
    parameters: Sequence[str],
    control: str | None = None,
) -> Jacobian:
    """Return measurements of the equilibrium at a value of the loading parameter, with their
    derivatives.

    With `control`, the key of a displacement, the derivatives are those at the value of this
    displacement, and t follows.

    Parameters
    ----------
    body : Differentiated
    at : float
        Stretch or t.
    displacements : ndarray, shape (n, d)
        Displacements near the equilibrium.
    outputs : sequence of str
        Dotted keys of an output; a key that is continued in several entries stands for all of
        them.
    parameters : sequence of str
        Names in `body.numbers`, or the loading parameter; with `control` that key instead of the
        loading parameter.
    control : str, optional

    Raises
    ------
    NoEquilibrium
        If Newton's method does not find the equilibrium, or the tangent is nearly singular.
    ValueError
        If there is no such output.
    """
    with thread_count(None), threadpool_limits(1, user_api="blas"):
        system = body.system
        system.state.parameter = at
        system.place(system.body.points + displacements)
        settings = system.loading.free, system.body.volumes, body.balanced
        if control is None:
            solver = Newton(*settings)
            solver.solve(system.loaded, system.positions)
            return present_jacobian(body, outputs, parameters, solver)
        controlled = DisplacementControl(control_of(system, control), *settings)
        controlled.solve(system.loaded, system.positions)
        system = replace(system, loaded=controlled.controlled(system.loaded))
        reached = displacement_of(system, control, system.positions)
        numbers = body.numbers | {control: reached}
        held = replace(body, system=system, numbers=numbers, control=control)
        return present_jacobian(held, outputs, parameters)


def present_jacobian(
    body: Differentiated,
    outputs: Sequence[str],
    parameters: Sequence[str],
    solver: Newton | None = None,
) -> Jacobian:
    """Return measurements and derivatives in the present equilibrium, which `solver` has found,
    or which is one at a controlled displacement.

    The force of the latter has the factor of the loads at which the weighted forces vanish, and
    no direction of its equations changes the controlled displacement: they are the bordered
    system of theory (73c), regular at a limit load.
    """
    system = body.system
    loaded = body.system.loaded
    positions = body.system.positions
    measured = body.evaluated(positions)[0]
    gradients = None
    along = None
    names = [
        *names_below(outputs, measured),
        *(name for name in measured if name.startswith("places.")),
    ]
    if solver is None:
        equations = loaded.equations(positions)
        along = loaded.along()
    else:
        few = 0 < len(names) < len(parameters) and body.contrast <= MOST_CONTRAST
        # pushes and the history follow forward solutions
        if few and not system.loads.obstacles and body.history is None:
            gradients = body.gradients(names)
        if parameters:
            equations = solver.equations(loaded, positions)
    moved = None if gradients else np.empty((len(parameters), *positions.shape))
    derivatives, errors = np.empty((2, len(names), len(parameters)))
    history = {}
    if gradients:
        derivatives, errors = _adjoint(body, equations, gradients, names, parameters)
    else:
        for number, name in enumerate(parameters):
            change = body.change_by(name, (), along if name == body.control else None)
            found, moved[number], errors[:, number] = _forward(body, equations, change, names)
            derivatives[:, number] = found.measured
            history[name] = found.history
    values = np.array([measured[name] for name in names])
    displacements = positions - system.body.points
    return Jacobian(tuple(names), values, derivatives, displacements, moved, errors, history)


def _forward(
    body: Differentiated, equations: TangentEquations, change: Change, names: Sequence[str]
) -> tuple[Change, np.ndarray, np.ndarray]:
    """Return the change of measurements by a parameter, the derivatives of the displacements
    (n, d), and estimated errors of the former.

    Differences along the displacements found so far give the measurements, and the forces that
    are left. The next correction, under these forces, would change the measurements by about
    the last change times the ratio of the roots of the work of both corrections.
    """
    moved = change.moved.copy()
    left = change.forces
    measured = np.zeros(len(names))
    size = np.inf
    idle = 0
    pushes = np.zeros_like(change.pushes)
    least = 1e-300
    if (
        body.control is not None and body.numbers[change.name]
    ):  # loads answer to a unit of stress, and the body rests
        least = (
            RESTING
            * float(np.abs(body.system.positions - body.system.body.points).max())
            / abs(body.numbers[change.name])
        )
    for number in range(MOST_ROUNDS):
        moved += equations.displacements(left, ROUGH, change.rounding)
        along = body.change_by(change.name, names, moved, pushes)
        left = along.forces
        if body.system.loads.obstacles:
            left = left + body.system.loaded.of_contact(along.pushes - pushes)
            pushes = along.pushes
        (wrong, size), before = equations.estimate(left), size
        off = float(np.abs(wrong).max())
        share = off / max(float(np.abs(moved).max()), least)
        last = measured
        measured = along.measured
        if number == 0:  # there are no earlier derivatives to compare with
            continue
        ratio = size / before if before else 0.0
        errors = min(ratio, 1.0) * np.abs(measured - last)
        close = (errors <= EXACT * np.abs(measured).max(initial=0.0)).all()
        idle = idle + 1 if ratio > IDLE else 0
        if (close and share <= (LEAST_EXACT if names else EXACT)) or share <= TINY or idle == 2:
            break
    # what rounding of bond strains moves a body by is no sign of a singular tangent: the
    # parameter may have no effect
    rounded = body.rounded * float(np.ptp(body.system.body.points, axis=0).max())
    if share > SINGULAR and off * along.step > rounded:
        raise NotConverged(
            "the linear equations of the tangent are not solved: it is nearly singular"
        )
    return along, moved, errors


def _adjoint(
    body: Differentiated,
    equations: TangentEquations,
    gradients: Sequence[np.ndarray],
    names: Sequence[str],
    parameters: Sequence[str],
) -> tuple[np.ndarray, np.ndarray]:
    """Return the derivatives of measurements by parameters, by one solution for each
    measurement, and their estimated errors.

    An error is the work of the forces that are left in a solution on the displacements under
    those of the change of a parameter. By the inequality of Cauchy and Schwarz it is at most
    the product of the roots of the work of both on their own displacements.
    """
    free = body.system.loading.free
    # The reactions of all supports change together if all free points move alike.
    equations.learn(np.broadcast_to(axis, free.shape) for axis in np.eye(free.shape[1]))
    solutions = [equations.displacements(each, ROUGH) for each in gradients]
    changes = [body.change_by(name, names) for name in parameters]
    for number, change in enumerate(changes):
        # the forces, and with them the errors, are much smaller if the body moves with its
        # supports
        if change.moved.any():
            moved = change.moved + equations.displacements(change.forces, ROUGH, change.rounding)
            changes[number] = body.change_by(change.name, names, moved)
    sizes = np.array([equations.estimate(change.forces)[1] for change in changes])
    found, errors = np.empty((2, len(names), len(changes)))
    left = list(gradients)
    work = np.full(len(names), np.inf)
    rows = np.arange(len(names))
    for number in range(MOST_ROUNDS):
        before = work.copy()
        for row in rows:
            left[row] = gradients[row] - equations.forces(solutions[row], body.width)
            work[row] = equations.estimate(left[row])[1]
            found[row] = [
                change.measured[row] + np.vdot(free * solutions[row], change.forces)
                for change in changes
            ]
            errors[row] = work[row] * sizes
        greatest = np.abs(found).max(axis=0)
        rows = np.flatnonzero((errors > EXACT * greatest).any(axis=1) & (work < IDLE * before))
        if (
            not len(rows) or number == MOST_ROUNDS - 1
        ):  # what is returned is of the solutions that the errors are of
            break
        for row in rows:
            solutions[row] += equations.displacements(left[row], ROUGH)
    for column in np.flatnonzero(
        (errors > LEAST_EXACT * greatest).any(axis=0)
    ):  # the bound may far exceed the error
        along, _, errors[:, column] = _forward(
            body, equations, body.change_by(parameters[column]), names
        )
        found[:, column] = along.measured
    return found, errors
