"""Evaluations of a force within a sequence of compiled passes."""

from __future__ import annotations

import numpy as np

from ..engine.passes import BoundPass
from ..kernels.ghosts import place_points
from .internal_force import InternalForce


class Evaluation:
    """Passes that evaluate a force at positions which other passes write, without Python.

    Parameters
    ----------
    force : InternalForce
        Force that `is_passes`.
    positions, out : ndarray, shape (n, d)
        Arrays of the positions and of the forces.

    Attributes
    ----------
    passes : tuple of BoundPass
        The evaluation. Where one of them returns a count, a call of the force at these positions
        says what is wrong.
    shifts : ndarray, shape (m d,)
        Shifts of the ghosts by the reflection planes (`images_at`).
    all_positions : ndarray, shape (n + m, d)
        Positions of points and ghosts in the force.
    of_planes : tuple of BoundPass and ndarray, or None
        See `pdsurrogate.forces.term.Passes`.
    """

    def __init__(self, force: InternalForce, positions: np.ndarray, out: np.ndarray) -> None:
        (term,) = force.terms
        self._force = force
        self._term = term
        self._kinematics = term.kinematics
        self._positions = positions
        self._out = out
        self.shifts = self._kinematics.shifts.reshape(-1)
        self.all_positions = force.positions
        self.passes, self.of_planes = term.passes(out)

    def placing(self, positions: np.ndarray) -> BoundPass:
        """Return the pass that places the points at positions (n, d), and the ghosts."""
        ghosts = self._force.body.ghosts
        images = ghosts.source, ghosts.parity, self._kinematics.shifts
        return self._kinematics.bind(place_points, positions, *images, self.all_positions)

    def images_at(self, motions: np.ndarray) -> np.ndarray:
        """Return rows of `shifts`, shape (k, m d), for motions (k, planes, d, d + 1) of the planes,
        which do not turn.
        """
        return self._kinematics.shifts_at(motions).reshape(len(motions), -1)

    def begin(self) -> None:
        """Give the passes their arrays, before they run."""
        self._kinematics.set_positions(self._positions)
        self._term.passes(self._out)

    def end(self, times: int) -> None:
        """Take notice of so many evaluations."""
        self._force.evaluations += times
        kinematics = self._kinematics
        kinematics.plane_motions[:, :, -1] = np.nan  # until planes are moved again
        kinematics.formed = False
        kinematics.changes += 1


def is_passes(force: InternalForce) -> bool:
    """Return whether an evaluation consists of passes alone, in a body on one rank, and nothing
    happens where a state is accepted.
    """
    out = np.empty_like(force.body.points)
    alone = not force.body.share.divided and not force.history and len(force.terms) == 1
    return alone and force.terms[0].places and force.terms[0].passes(out) is not None
