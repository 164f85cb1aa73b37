"""Small bodies for tests."""

from functools import partial

import numpy as np

from pdsurrogate.discretization import discretize
from pdsurrogate.kernels.ghosts import fill_matrices
from pdsurrogate.solvers.dynamics import ExplicitDynamics
from pdsurrogate.testing.bodies import disc_with_hole, gripped, jittered, sheet

__all__ = [
    "build_body",
    "disc_with_hole",
    "fill_gradients",
    "gripped_sheet",
    "jittered",
    "nothing_held",
    "rotation",
    "sheet",
]


gripped_sheet = partial(gripped, 2)


def fill_gradients(ghosts, gradients):
    """Write the deformation gradients of ghosts beyond planes at rest into the last rows of
    `gradients`.
    """
    fill_matrices(gradients, *ghosts.of_gradients, 1.0, np.zeros((len(ghosts), gradients.shape[1])))


def nothing_held(force, body, velocities, **settings):
    """Explicit dynamics of a body of density 1 that nothing holds, with the velocities of its
    points at the beginning.
    """
    free = np.ones_like(velocities)
    integrator = ExplicitDynamics(
        force,
        lambda positions, ahead: None,
        body.points.copy(),
        velocities,
        free,
        body.volumes,
        **settings,
    )
    integrator.begin()
    return integrator


def build_body(scene):
    """The body of a scene."""
    return discretize(scene)[0]


def rotation(angle):
    """2 x 2 rotation matrix."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
