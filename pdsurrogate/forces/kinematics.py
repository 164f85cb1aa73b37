"""The passes that every force model shares: images, deformation gradients, and the state of the points."""

from __future__ import annotations

from functools import cached_property

import numba
import numpy as np

from ..body import Body
from ..kernels import gradient, node_state, reference
from ..kernels.blocks import BLOCK, SCRATCH_ROWS, aligned_rows
from ..materials import Law, plane_stress
from .learnt_thickness import LearntThickness
from .protocol import InvalidState
from .settings import ROTATION


class Kinematics:
    """Positions, deformation gradients and node states of a body, updated in place.

    Parameters
    ----------
    body : Body
    law : Law
    precision : {"float32", "float64"}
        Of the node records and the weighted bonds; positions, gradients and what is summed are double.
    rotation : {"polar", "convected"}, optional
        In the node records, which only bond forces read.
    breakable : bool
        Whether bonds may break.

    Attributes
    ----------
    positions : ndarray, shape (n + m, 2)
        Of the points, then of their images.
    gradients : ndarray, shape (n + m, 4)
        F as records (11, 21, 12, 22).
    volume_ratios : ndarray, shape (n + m,)
        J3, the start of the next plane-stress iteration.
    records : ndarray, shape (n + m, 4)
        (cos, sin, J, C33).
    weighted_bonds : ndarray, shape (n_bonds, 2)
        w x V_j of every directed bond, zero where broken.
    inverse_shape : ndarray, shape (n + m, 3)
        K^-1 as (11, 12, 22), zero where the bonds do not span the plane.
    learnt_thickness : LearntThickness or None
        What solves the plane-stress condition in the place of the law.
    """

    def __init__(self, body: Body, law: Law, precision: str, rotation: str | None = None, breakable: bool = False) -> None:
        self.body, self.law, self._breakable = body, law, breakable
        bonds, points = body.bonds, body.all_points
        n, total = len(body), len(points)
        self.chunks = numba.get_num_threads()
        self.response = law.response_block()
        self.parameters = law.parameters
        self._rotation = node_state.ROTATIONS[rotation or ROTATION]

        owners = np.repeat(np.arange(n), np.diff(bonds.pointers).astype(np.int64))
        vectors = points[bonds.neighbours] - points[owners]
        factors = body.weigh(np.linalg.norm(vectors, axis=1)) * body.all_volumes[bonds.neighbours]
        self.weighted_bonds = aligned_rows(vectors.shape, precision)
        self.weighted_bonds[:] = vectors * factors[:, None]
        self.inverse_shape = np.zeros((total, 3))
        self.supported = np.zeros(total, dtype=np.uint8)
        self._find_shapes(np.arange(n, dtype=np.uint32))
        images = body.images

        self.positions = points.copy()
        self._shift = images.points - images.parity * points[images.mirror]
        self._shift_at_rest = self._shift.copy()
        self.gradients = aligned_rows((total, 4))
        self.volume_ratios = np.ones(total)
        self.records = aligned_rows((total, 4), precision)
        self.scratch = aligned_rows((self.chunks, SCRATCH_ROWS, BLOCK), value=1)
        self._unsolved = np.zeros(self.chunks, dtype=np.int64)
        self.learnt_thickness: LearntThickness | None = None

    def _find_shapes(self, rows: np.ndarray) -> None:
        """Shape tensors of the given points, then of all images."""
        body, bonds = self.body, self.body.bonds
        reference.shape_rows(
            rows,
            bonds.pointers,
            bonds.neighbours,
            body.all_points,
            self.weighted_bonds,
            self.inverse_shape,
            self.supported,
        )
        reference.reflect_shapes(len(body), body.images.mirror, self.inverse_shape, self.supported)
        self.unsupported = np.flatnonzero(self.supported[: len(body)] == 0)

    def break_bonds(self, pairs: np.ndarray) -> np.ndarray:
        """Take pairs out of their ends' horizons.

        Returns
        -------
        ndarray
            All pairs at which anything changed: those of every point that lost a bond, and of its images.
        """
        self.check_breakable()
        bonds, n = self.body.bonds, len(self.body)
        entries, starts = self.pair_entries
        self.weighted_bonds[np.concatenate([entries[starts[pairs]], entries[starts[pairs + 1] - 1]])] = 0.0
        ends = np.concatenate([bonds.first[pairs], bonds.second[pairs]])
        touched = np.unique(ends[ends < n])
        self._find_shapes(touched)
        reached = np.zeros(len(self.body.all_points), dtype=bool)
        reached[touched] = True
        reached[n:] = reached[self.body.images.mirror]
        outer = self._outer_pairs
        own = [bonds.pair_of[bonds.pointers[i] : bonds.pointers[i + 1]] for i in touched]
        return np.unique(np.concatenate([*own, outer[reached[bonds.second[outer]]]]))

    def check_breakable(self) -> None:
        """Raise ValueError if the force was bound without bonds that may break."""
        if not self._breakable:
            raise ValueError("this force was bound without bonds that break; bind it with ForceSettings(breakable=True)")

    def state_arrays(self) -> dict[str, np.ndarray]:
        """What an evaluation starts from beside positions and broken bonds, see `InternalForce`."""
        return {"volume_ratios": self.volume_ratios}

    @cached_property
    def pair_entries(self) -> tuple[np.ndarray, np.ndarray]:
        """Entries of the neighbour lists by pair, and where each pair's begin: two to a pair, one for a pair with an image."""
        pair_of = self.body.bonds.pair_of
        starts = np.zeros(len(self.body.bonds.first) + 1, dtype=np.int64)
        starts[1:] = np.cumsum(np.bincount(pair_of, minlength=len(starts) - 1))
        return np.argsort(pair_of, kind="stable"), starts

    @cached_property
    def _outer_pairs(self) -> np.ndarray:
        """Numbers of the pairs with an image."""
        return np.flatnonzero(self.body.bonds.second >= len(self.body)).astype(np.uint32)

    def move_plane(self, plane: int, displacement) -> None:
        """Displace a reflection plane: its images follow, odd components about the new place."""
        images = self.body.images
        chosen = images.plane == plane
        self._shift[chosen] = self._shift_at_rest[chosen] + (1 - images.parity[chosen]) * np.asarray(displacement, dtype=float)

    def place(self, positions: np.ndarray) -> None:
        """Take new positions of the body's points, and move the images with them; nothing else."""
        images = self.body.images
        gradient.place(positions, self.positions, images.mirror, images.parity, self._shift)

    def update_gradients(self, positions: np.ndarray) -> None:
        """Take new positions of the body's points, and form the deformation gradients of points and images; nothing else."""
        self.place(positions)
        bonds, images = self.body.bonds, self.body.images
        gradient.deformation_gradients(
            self.positions, bonds.pointers, bonds.neighbours, self.weighted_bonds, self.inverse_shape, 1.0, self.gradients
        )
        gradient.reflect_gradients(self.gradients, len(self.body), images.mirror, images.parity, images.axis)

    def update(self, positions: np.ndarray) -> None:
        """Take new positions of the body's points, and bring everything else up to date.

        Raises
        ------
        InvalidState
            Where det F <= 0, the law ends, or numbers are not finite; names the point.
        """
        self.update_gradients(positions)
        if self.learnt_thickness is not None:
            law = self.response.address, self.parameters
            unsolved = self.learnt_thickness.update(self.gradients, self.volume_ratios, self._rotation, *law, self.records, self._unsolved)
        else:
            unsolved = node_state.node_states(
                self.gradients,
                self.volume_ratios,
                self._rotation,
                self.response.address,
                self.parameters,
                self.scratch,
                self.records,
                self._unsolved,
            )
        if unsolved:
            raise InvalidState(self._diagnose())

    def deformation_gradients(self) -> np.ndarray:
        """F of the body's points, shape (n, 2, 2)."""
        return self.gradients[: len(self.body)].reshape(-1, 2, 2).transpose(0, 2, 1)

    def _diagnose(self) -> str:
        """Say which point has no state, and why.  The volume ratios are reset, so that a later evaluation starts afresh."""
        self.volume_ratios[:] = 1.0
        owners = np.concatenate([np.arange(len(self.body)), self.body.images.mirror.astype(np.int64)])

        def at(number: int, what: str) -> str:
            image = "" if number < len(self.body) else "its image beyond the grip: "
            return at_point(self.body, int(owners[number]), image + what)

        # Images too: beyond a grip the reflected gradient may be turned inside out where the point's own is not.
        F = self.gradients.reshape(-1, 2, 2).transpose(0, 2, 1)
        broken = np.flatnonzero(~np.isfinite(F).all(axis=(1, 2)))
        if len(broken):
            return at(int(broken[0]), "its deformation gradient is not finite")
        J = np.linalg.det(F)
        if J.min() <= 0:
            return at(int(J.argmin()), f"det F = {J.min():.3g}: the material is turned inside out there")
        trace, _ = plane_stress.invariants(F)
        order = np.argsort(-trace)
        for i in order[:100]:
            try:
                plane_stress.volume_ratio(self.law, trace[i], J[i])
            except ValueError as error:
                return at(int(i), str(error))
        i = int(order[0])
        return at(i, f"no plane-stress state was found there or nearby, at tr C = {trace[i]:.4g} and det F = {J[i]:.4g}")


def at_point(body: Body, i: int, what: str) -> str:
    """Say where something is."""
    x1, x2 = body.points[i]
    return f"point {i} at ({x1:.4g}, {x2:.4g}): {what}"


def locate(body: Body, values: np.ndarray, what: str) -> str:
    """Say at which point values are not finite."""
    return at_point(body, int(np.flatnonzero(~np.isfinite(values.reshape(len(body), -1)).all(axis=1))[0]), what)
