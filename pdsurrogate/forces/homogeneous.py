"""Stresses of a uniformly stretched test piece (a small body) with any force model, evaluated as
in a simulation.
"""

from collections.abc import Sequence

import numpy as np
import scipy

from ..body import Body, grid
from ..materials import Law, dimension_of
from ..materials.homogeneous import sheet_states
from .protocol import ForceModel
from .settings import ForceSettings

SPACING = 0.25
"""Spacing of the points of the test piece, a unit square or cube. Chosen: the deformation is
homogeneous, so that more points would only repeat the same state.
"""

TOLERANCE = 1e-9
"""Relative change of the free stretch at which the secant method ends. Chosen: the method converges
faster than linearly, so that the error of the stretch is then far smaller than this, and rounding
in double precision is smaller still.
"""


def nominal_states(
    model: ForceModel, law: Law, stretches: Sequence[tuple[float, float]]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the nominal stresses of a small body with a force model at given uniform stretches.

    The given stretches fix the positions. The force model determines the thickness of a sheet; the
    free stretches of a body in three dimensions, and of the sides in uniaxial tension, are those at
    which the free stresses vanish.

    Parameters
    ----------
    model : ForceModel
    law : Law
        Law of the body.
    stretches : ndarray, shape (n, 2)
        Stretches along the stress and across it; the latter is NaN where the sides are free.

    Returns
    -------
    stresses : ndarray, shape (n,)
        Nominal stress P11, in the same unit as the shear modulus; NaN where the model has no such
        state.
    beyond : ndarray, shape (n,)
        Distance of each state beyond the model's domain (`Domain.deviation`); -inf for a model
        without a domain, or where the model has no such state.

    Raises
    ------
    ValueError
        If the model does not describe the law, or accepts only bodies in plane strain.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.forces.homogeneous import nominal_states
    >>> stress, _ = nominal_states(
    ...     pds.load_surrogate("neo-hookean"), pds.materials.NeoHookean(), [(1.5, float("nan"))]
    ... )
    >>> round(float(stress[0]), 3)
    1.05
    """
    plane = "stress" if "stress" in model.honored("stress").get("plane", ("stress",)) else "space"
    points = grid((0.0,) * dimension_of(plane), (1.0,) * dimension_of(plane), SPACING)
    body = Body(points, np.full(len(points), 1 / len(points)), 3.015 * SPACING, SPACING)
    force = model.bind(body, law, ForceSettings(precision="float64", plane=plane))
    out = np.empty_like(body.points)

    def stress_at(given: np.ndarray) -> np.ndarray:
        force(body.points * given, out)
        return np.diag(force.mean_stress())

    found = np.full(len(stretches), np.nan)
    beyond = np.full(len(stretches), -np.inf)
    for row, (first, second) in enumerate(stretches):
        at = np.array([first, second, 1.0])[: body.dimension]
        free = [axis for axis in range(1, body.dimension) if axis == 2 or np.isnan(second)]
        J3 = float(sheet_states(law, np.array([first]), np.array([second]))[1][0])
        # Free sides and thickness have the same stretch; the search begins at the state of the law.
        at[free] = np.sqrt(J3 / first) if np.isnan(second) else J3 / (first * second)
        if not np.isfinite(J3):
            continue

        def free_stress(stretch: float, at: np.ndarray = at, free: list[int] = free) -> float:
            at[free] = stretch
            return stress_at(at)[free].mean()

        try:
            if free:
                starts = at[free[0]] * np.array([1, 1 + 1e-4])
                at[free] = scipy.optimize.newton(
                    free_stress, starts[0], x1=starts[1], tol=TOLERANCE
                )
            found[row] = stress_at(at)[0]
        except RuntimeError:  # past the law's limit, or turned inside out
            continue
        if (deviation := force.learned.domain_deviation()) is not None:
            beyond[row] = deviation.max()
    return found, beyond
