"""The passes that every force model shares: images, deformation gradients, and the state of the points."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..body import Body
from ..engine.block_arrays import BLOCK, SCRATCH_ROWS, aligned_rows
from ..engine.passes import BoundPass, Chain
from ..engine.threads import chunks_of
from ..kernels import node_state
from ..kernels.ghosts import place_points
from ..kernels.gradient import deformation_gradients
from ..kernels.reference_state import shape_rows
from ..materials import PLANES, Law, plane_stress
from .protocol import InvalidState
from .settings import ROTATION, ROTATIONS
from .surrogate_thickness import SurrogateThickness

if TYPE_CHECKING:
    from .interfaces import Interfaces

SHARE_ALONG_CLAMPS = {"strain": 1.0, "space": 0.0}
"""Of the gradient along a clamped plane, what images beyond it have from their sources where volumes are held; the rest is the plane's.

Measured against finite elements.  The bonded cube of 24 points a side (K = 100 mu): stretched to 1.5 the force is 0.02 % off and the side
0.07 % with none, 0.20 % and 0.28 % with all; compressed to 0.9 the force is 0.13 % and 1.07 %.  In plane strain the wide block of
`plane-strain-block` at -5 % (32 points) is 1.5 % too stiff with none and 0.4 % with all, and at +30 % they are as good.
"""


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
    plane : {"stress", "strain", "space"}
        Whether the volume ratios follow from the plane-stress condition, or are det F.

    Attributes
    ----------
    positions : ndarray, shape (n + m, d)
        Of the points, then of their images.
    gradients : ndarray, shape (n + m, d d)
        F by columns.
    volume_ratios : ndarray, shape (n + m,)
        J3, the start of the next plane-stress iteration.
    records : ndarray, shape (n + m, 4)
        (cos, sin, J, C33), which bond forces read; empty in space.
    weighted_bonds : ndarray, shape (n_bonds, d)
        w x V_j of every directed bond, zero where broken.
    inverse_shape : ndarray, shape (n + m, d (d + 1)/2)
        K^-1 as its upper triangle row by row, zero where the bonds do not span plane or space.
    supported : ndarray of uint8, shape (n + m,)
        1 where the bonds span plane or space.
    gradient_ghosts : Ghosts
        Which fill the gradients, and fold derivatives by them.
    surrogate_thickness : SurrogateThickness or None
        What solves the plane-stress condition in the place of the law.
    interfaces : Interfaces or None
        Where materials meet, in a body of several.
    """

    def __init__(self, body: Body, law: Law, precision: str, rotation: str | None = None, plane: str = "stress") -> None:
        self.body, self.law, self.plane = body, law, plane
        bonds, points = body.bonds, body.all_points
        n, total = len(body), len(points)
        self.chunks = chunks_of(len(bonds.first))
        self.response = PLANES[plane].response.block(law)
        self.parameters = law.parameters

        owners = np.repeat(np.arange(n), np.diff(bonds.pointers).astype(np.int64))
        vectors = points[bonds.neighbours] - points[owners]
        factors = body.weigh(np.linalg.norm(vectors, axis=1)) * body.all_volumes[bonds.neighbours]
        self.weighted_bonds = aligned_rows(vectors.shape, precision)
        self.weighted_bonds[:] = vectors * factors[:, None]
        dimension = body.dimension
        self.inverse_shape = np.zeros((total, dimension * (dimension + 1) // 2))
        self.supported = np.zeros(total, dtype=np.uint8)
        self._find_shapes(np.arange(n, dtype=np.uint32))

        self.positions = points.copy()
        self._formed = self._found = False
        self._plane_displacements = np.zeros((len(body.planes), dimension))
        self._plane_turns: np.ndarray | None = None
        self._gradient_shifts: np.ndarray | None = None
        self._shifts = body.ghosts.shifts(body.points, self._plane_displacements)
        self.gradients = aligned_rows((total, dimension * dimension))
        self.gradient_ghosts = body.ghosts if plane == "stress" else body.ghosts.held_by_clamps(SHARE_ALONG_CLAMPS[plane])
        ghosts = body.ghosts
        images = ghosts.source, ghosts.parity, self._shifts
        self._place = place_points.bind(np.ascontiguousarray(body.points), *images, self.positions, chunks=self.chunks)
        self._form_gradients = self.gradient_pass(self.positions, self.gradients, 1.0)
        self._place_and_form = Chain(self._place, self._form_gradients)
        self.volume_ratios = np.ones(total)
        self.records = aligned_rows((total if dimension == 2 else 0, 4), precision)
        self.scratch = aligned_rows((self.chunks.threads, SCRATCH_ROWS, BLOCK), value=1)
        self.surrogate_thickness: SurrogateThickness | None = None
        self.interfaces: Interfaces | None = None
        turn = ROTATIONS[rotation or ROTATION]
        self._turn = turn and turn.bind(self.gradients, self.records, chunks=self.chunks)

    def _find_shapes(self, rows: np.ndarray) -> None:
        """Shape tensors of the given points, then of all images."""
        body, bonds = self.body, self.body.bonds
        shape_rows[body.dimension](
            rows,
            bonds.pointers,
            bonds.neighbours,
            body.all_points,
            self.weighted_bonds,
            self.inverse_shape,
            self.supported,
        )
        body.share.fill(self.inverse_shape[: len(body)])
        body.share.fill(self.supported[: len(body)])
        body.ghosts.fill_shapes(self.inverse_shape)
        body.ghosts.fill(self.supported)

    def break_bonds(self, pairs: np.ndarray) -> np.ndarray:
        """Take pairs out of their ends' horizons.

        Returns
        -------
        ndarray
            All pairs at which anything changed: those of every point that lost a bond, and of its images.
        """
        bonds, n = self.body.bonds, len(self.body)
        entries, starts = self.pair_entries
        self.weighted_bonds[np.concatenate([entries[starts[pairs]], entries[starts[pairs + 1] - 1]])] = 0.0
        ends = np.concatenate([bonds.first[pairs], bonds.second[pairs]])
        touched = np.unique(ends[ends < n])
        self._find_shapes(touched)
        self._formed = self._found = False
        reached = np.zeros(len(self.body.all_points), dtype=bool)
        reached[touched] = True
        self.body.ghosts.fill(reached)
        outer = self._outer_pairs
        own = [bonds.pair_of[bonds.pointers[i] : bonds.pointers[i + 1]] for i in touched]
        beside = self.body.share.beside_halo(bonds.first, bonds.second)  # where others may have broken some that are not here
        return np.unique(np.concatenate([*own, outer[reached[bonds.second[outer]]], beside]))

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

    def gradient_weights(self, weighted_bonds: np.ndarray | None = None, inverse_shape: np.ndarray | None = None) -> np.ndarray:
        """K^-1 w x V_j of every directed bond, shape (n_bonds, d), of the body's own shapes and bonds or of given ones."""
        weighted_bonds = self.weighted_bonds if weighted_bonds is None else weighted_bonds
        inverse_shape = self.inverse_shape if inverse_shape is None else inverse_shape
        pointers, d = self.body.bonds.pointers, self.body.dimension
        owners = np.repeat(np.arange(len(self.body)), np.diff(pointers).astype(np.int64))
        place = np.zeros((d, d), dtype=np.int64)
        place[np.triu_indices(d)] = np.arange(inverse_shape.shape[1])
        return np.einsum("bij,bj->bi", inverse_shape[owners][:, np.maximum(place, place.T)], weighted_bonds)

    def gradient_pass(self, positions: np.ndarray, gradients: np.ndarray, unsupported: float) -> BoundPass:
        """The pass that forms the points' deformation gradients from positions; with `unsupported` 0, changes from displacements."""
        bonds = self.body.bonds
        arrays = bonds.pointers, bonds.neighbours, self.weighted_bonds, self.inverse_shape
        return deformation_gradients[self.body.dimension].bind(positions, *arrays, unsupported, gradients, chunks=self.chunks)

    def move_plane(self, plane: int, displacement, turn: np.ndarray | None = None) -> None:
        """Displace a reflection plane, and turn it: its images follow, odd components about the new place."""
        self._plane_displacements[plane] = displacement
        if turn is not None:
            if self._plane_turns is None:
                self._plane_turns = np.zeros((len(self.body.planes), *turn.shape))
            self._plane_turns[plane] = turn
            self._gradient_shifts = self.gradient_ghosts.gradient_shifts(self._plane_turns)
        self._shifts[:] = self.body.ghosts.shifts(self.body.points, self._plane_displacements, self._plane_turns)

    def place(self, positions: np.ndarray) -> None:
        """Take new positions of the body's points, and move the ghosts with them; gradients and states follow when they are asked for."""
        positions = np.ascontiguousarray(positions, dtype=float)
        self.body.share.fill(positions)
        self._place.give("given", positions)
        self._place()
        self._formed = self._found = False

    def place_and_form(self, positions: np.ndarray) -> None:
        """Take new positions and bring the deformation gradients up to date."""
        positions = np.ascontiguousarray(positions, dtype=float)
        self.body.share.fill(positions)
        self._place.give("given", positions)
        self._place_and_form()
        self._found = False
        self._complete_gradients()

    def form_gradients(self) -> None:
        """Bring the deformation gradients of points and ghosts up to date."""
        if not self._formed:
            self._form_gradients()
            self._complete_gradients()

    def _complete_gradients(self) -> None:
        """What follows the pass over the points: where materials meet, what others own, and ghosts."""
        if self.interfaces is not None:
            self.interfaces.correct(self.positions, self.gradients)
        self.body.share.fill(self.gradients[: len(self.body)])
        if len(self.body.ghosts):
            self.gradient_ghosts.fill_gradients(self.gradients)
        if self._gradient_shifts is not None:
            self.gradients[len(self.body) :] += self._gradient_shifts
        self._formed = True

    def find_states(self) -> None:
        """Bring gradients, volume ratios and records up to date.

        Raises
        ------
        InvalidState
            Where det F <= 0, the law ends, or numbers are not finite; names the point.
        """
        self.form_gradients()
        if not self._found:
            unsolved, *_ = self._find_states()
            self.have_states(unsolved)

    def have_states(self, unsolved: int) -> None:
        """Take note that `state_passes` have run; raises as `find_states` does where the first of them left points without a state."""
        if unsolved:
            self.volume_ratios[:] = 1.0  # so that a later evaluation starts afresh
            raise InvalidState(self.diagnose(self.law))
        self._found = True

    @cached_property
    def _find_states(self) -> Chain:
        return Chain(*self.state_passes)

    @cached_property
    def state_passes(self) -> list[BoundPass]:
        """The passes over the points' states after the gradients, of which the first counts the points that have none.

        Bound at their first use, when it is known what solves the plane-stress condition.
        """
        return [self._state_pass(), *([self._turn] if self._turn else [])]

    def _state_pass(self) -> BoundPass:
        if self.plane == "space":
            return node_state.volume_ratios[3].bind(self.gradients, self.volume_ratios, chunks=self.chunks)
        if self.plane == "strain":
            return node_state.held_states.bind(self.gradients, self.volume_ratios, self.records, chunks=self.chunks)
        if self.surrogate_thickness is not None:
            law = self.response.address, self.parameters
            return self.surrogate_thickness.bind(self.gradients, self.volume_ratios, *law, self.records, self.chunks)
        return node_state.node_states.bind(
            self.gradients,
            self.volume_ratios,
            self.response.address,
            self.parameters,
            self.scratch,
            self.records,
            chunks=self.chunks,
        )

    def deformation_gradients(self) -> np.ndarray:
        """F of the body's points, shape (n, d, d)."""
        self.form_gradients()
        return matrices(self.gradients[: len(self.body)])

    def diagnose(self, law: Law, numbers: np.ndarray | None = None, gradients: np.ndarray | None = None) -> str:
        """Say which point has no state by a law, and why; of all, or of points and images of the given numbers with these gradients."""
        numbers, gradients = (np.arange(len(self.gradients)), self.gradients) if numbers is None else (numbers, gradients)
        owners = np.concatenate([np.arange(len(self.body)), self.body.ghosts.source.astype(np.int64)])

        def at(number: int, what: str) -> str:
            image = "" if numbers[number] < len(self.body) else "its image beyond the grip: "
            return at_point(self.body, int(owners[numbers[number]]), image + what)

        # Images too: beyond a grip the reflected gradient may be turned inside out where the point's own is not.
        F = matrices(gradients)
        broken = np.flatnonzero(~np.isfinite(F).all(axis=(1, 2)))
        if len(broken):
            return at(int(broken[0]), "its deformation gradient is not finite")
        J = np.linalg.det(F)
        if J.min() <= 0:
            return at(int(J.argmin()), f"det F = {J.min():.3g}: the material is turned inside out there")
        trace = (F * F).sum(axis=(1, 2))
        order = np.argsort(-trace)
        if self.plane != "stress":
            return at(int(order[0]), f"there is no state there or nearby, at tr C = {trace[order[0]]:.4g} and det F = {J[order[0]]:.4g}")
        for i in order[:100]:
            try:
                plane_stress.volume_ratio(law, trace[i], J[i])
            except ValueError as error:
                return at(int(i), str(error))
        i = int(order[0])
        return at(i, f"no plane-stress state was found there or nearby, at tr C = {trace[i]:.4g} and det F = {J[i]:.4g}")


def matrices(columns: np.ndarray) -> np.ndarray:
    """Matrices, shape (k, d, d), of records by columns, shape (k, d d); a view where it can be one."""
    d = math.isqrt(columns.shape[1])
    return columns.reshape(-1, d, d).transpose(0, 2, 1)


def at_point(body: Body, i: int, what: str) -> str:
    """Say where something is."""
    return f"point {body.share.number(i)} at ({', '.join(f'{x:.4g}' for x in body.points[i])}): {what}"


def locate(body: Body, values: np.ndarray, what: str) -> str:
    """Say at which point values are not finite."""
    return at_point(body, int(np.flatnonzero(~np.isfinite(values.reshape(len(body), -1)).all(axis=1))[0]), what)
