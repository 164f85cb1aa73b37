"""Check that an equilibrium is stable and continues the last one."""

import numpy as np

from ..forces import InternalForce
from .conditions import Loading
from .equilibrium import EquilibriumSolver, Unstable
from .stability import NEGATIVE, least_curvature

JUMP = 0.25
"""Greatest distance of the points from the extrapolation, over the growth of the body's extent. Contraction across the load and stresses at
holes and cracks cause some hundredths; buckling of a sheet several tenths to ten, and more with shorter increments."""

LEAST_JUMP = 0.1
"""Least distance, in spacings, that counts as a jump: a finer tolerance changes positions by less."""


def check_branch(
    loading: Loading, force: InternalForce, solver: EquilibriumSolver, before: float, after: float, guess: np.ndarray, positions: np.ndarray
) -> None:
    """Check an equilibrium in which the force was last evaluated: that it is stable, and continues the last one.

    Only compressed bodies are checked for stability: under tension the stress itself prevents buckling.

    Parameters
    ----------
    loading : Loading
    force : InternalForce
    solver : EquilibriumSolver
        Solver that computed the equilibrium.
    before, after : float
        Loading parameter of the last equilibrium, and of this one.
    guess : ndarray, shape (n, 2)
        Extrapolation from the last equilibrium.
    positions : ndarray, shape (n, 2)

    Raises
    ------
    InvalidState
        If a point lies beyond a plane of reflection.
    Unstable
        If a compressed body jumped away from the extrapolation, provided that the conditions determine it, or its energy is not a local
        minimum.
    """
    loading.check_inside(after, force, positions)
    growth, jumped = loading.course.growth(before, after), False
    if growth is not None:
        moved = np.sqrt(solver.share.sum(np.square(positions - guess)) / solver.share.total(positions.size))
        jumped = moved > max(JUMP * growth, LEAST_JUMP * force.body.spacing)
    if not (jumped or force.has_energy) or not loading.course.pushes(force):
        return
    if jumped:
        raise Unstable(
            f"the body buckles between the stretches {before:.4g} and {after:.4g}: while its length changed by {growth:.3g}, "
            f"its points moved by {moved:.3g} in the mean from where the states before lead"
        )
    preconditioner = solver.preconditioner(force)
    preconditioner.update()
    arrays = force.state_arrays()
    held = {key: array.copy() for key, array in arrays.items()}
    curvature = least_curvature(force, positions, loading.free, preconditioner)
    force(positions, np.empty_like(positions))
    for key, array in arrays.items():
        array[:] = held[key]
    if curvature < NEGATIVE:
        raise Unstable(
            f"the equilibrium at {loading.at(after)} is not stable: along one displacement the energy has "
            f"{curvature:.2g} times the curvature that it has at rest, so that the body buckles"
        )
