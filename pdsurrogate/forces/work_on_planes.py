"""Forces of reflection planes by virtual work."""

from functools import cached_property

import numpy as np

from ..engine.passes import BoundPass
from ..kernels.ghosts import sum_on_planes
from .kinematics import matrices
from .term import MaterialTerm


class WorkOnPlanes(MaterialTerm):
    """Base class of terms with an energy, whose derivatives by the positions and gradients of
    ghosts are the forces of the planes that move these.
    """

    _on_points: np.ndarray
    _moments_of_ghosts: np.ndarray

    def forces_of_planes(self) -> np.ndarray:
        """Return the forces of the planes by virtual work: a plane moves its ghosts."""
        step, found = self._sum_on_planes
        step()
        return found.copy()

    @cached_property
    def _sum_on_planes(self) -> tuple[BoundPass, np.ndarray]:
        lever = self._counted(self.body.ghosts.lever)
        found = np.zeros(lever.shape[1:])
        return self.kinematics.bind(sum_on_planes, lever, self._on_points, found), found

    def levers_on_planes(self) -> np.ndarray:
        kinematics = self.kinematics
        moments = self._counted(self._moments_of_ghosts)
        places = kinematics.positions, matrices(kinematics.gradients)
        return kinematics.gradient_ghosts.levers_on_planes(
            *places, self._on_ghosts(), matrices(moments)
        )

    def _on_ghosts(self) -> np.ndarray:
        """Return the forces on the ghosts, (m, d), that this rank counts."""
        return self._counted(self._on_points[len(self.body) :])

    def _counted(self, on_ghosts: np.ndarray) -> np.ndarray:
        """Return values of ghosts, 0 where another rank owns the point that the ghost mirrors."""
        share = self.body.share
        if not share.divided:
            return on_ghosts
        own = share.own[self.body.ghosts.source]
        return on_ghosts * own.reshape(-1, *[1] * (on_ghosts.ndim - 1))
