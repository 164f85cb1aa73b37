"""Positions, shape tensors and deformation gradients of the points of a body and of their mirror
images.
"""

import math
from functools import cached_property

import numpy as np

from ..body import Body
from ..body.alike import alike, alike_blocks, stored_lists, vectors_between
from ..body.body import lengths_of
from ..engine.block_arrays import BLOCK, SCRATCH_ROWS, aligned_rows
from ..engine.passes import BoundPass, Chain, Pass
from ..engine.threads import chunks_of
from ..kernels.ghosts import fill_matrices, place_points
from ..kernels.node_state import deformation_gradients
from ..kernels.reference_state import shape_rows
from .changed_weights import BalancedWeights, ChangedWeights
from .steps import Step, Steps

SHARE_ALONG_CLAMPS = {"strain": 1.0, "space": 0.0}
"""Share of the gradient along a clamped plane that ghosts (mirror images) beyond the plane copy
from the points they mirror.

The keys are plane strain and three dimensions, in which volumes are constrained. The gradient of
the clamped plane makes up the rest. The shares follow from comparisons with finite elements. For
the bonded cube of 24 points a side (K = 100 mu) stretched to 1.5, the force is 0.02 % and the side
0.07 % off with share 0, 0.20 % and 0.28 % with share 1; compressed to 0.9, the force is 0.13 % off
with share 0 and 1.07 % with share 1. In plane strain the wide block of `plane-strain-block` at -5 %
(32 points) is 1.5 % too stiff with share 0 and 0.4 % with share 1; at +30 % both are equally good.
"""


class Kinematics:
    """Positions, shape tensors and deformation gradients of a body, updated in place and
    independent of materials.

    Parameters
    ----------
    body : Body
    precision : {"float32", "float64"}
        Precision of the weighted bonds; positions, gradients and sums are double.
    plane : {"stress", "strain", "space"}
    alone : bool
        Whether each bond has numbers of its own, because bonds break or have memory, or materials
        differ.

    Attributes
    ----------
    positions : ndarray, shape (n + m, d)
        Positions of the n points, then of the m ghosts (mirror images).
    gradients : ndarray, shape (n + m, d d)
        Deformation gradients F of points and ghosts, by columns.
    alike : ndarray of int, shape (n,)
        The first point with bonds like those of each point, see `pdsurrogate.body.alike`; each
        itself if bonds are `alone`.
    starts : ndarray of uint64, shape (n,)
        Place in `weighted_bonds` at which the bonds of each point begin.
    ways : ndarray of uint32, shape (k,)
        Numbers of the second ends of these bonds minus those of their points, modulo 2^32.
    weighted_bonds : ndarray, shape (k, d)
        w x V_j of the directed bonds of points that are not alike, with the weight w, the reference
        vector x and the volume V_j of the second end; zero if broken.
    inverse_shape : ndarray, shape (n + m, d (d + 1)/2)
        Inverse shape tensor K^-1 as its upper triangle row by row, zero where the bonds do not span
        all dimensions.
    supported : ndarray of uint8, shape (n + m,)
        1 where the bonds span all dimensions.
    gradient_ghosts : Ghosts
        Ghosts with the continuation that is used for deformation gradients and derivatives by
        these.
    interfaces : Interfaces or None
        Interfaces between materials, in a body of several.
    changed : list of ChangedWeights
        Changes of the weights of directed bonds in the gradients of their first points: of bonds
        that interfaces omit, and those of `balance`.
    balance : BalancedWeights or None
        Changes of weights that balance the body, see `change_weights`.
    shifts : ndarray, shape (m, d)
        Shifts of the ghosts by the reflection planes.
    plane_motions : ndarray, shape (planes, d, d + 1)
        Motions of the reflection planes, see `move_planes`.
    changes : int
        Number of changes of positions and bonds, by which dependent states detect that they are out
        of date.
    formed : bool
        Whether `gradients` belong to `positions`.
    elapsed : float
        Time since the state of the body that was last accepted, for terms with history.
    before : float or None
        Duration of the step before, see `InternalForce.elapse`.
    """

    def __init__(
        self, body: Body, precision: str, plane: str = "stress", alone: bool = False
    ) -> None:
        self.body = body
        self.plane = plane
        bonds = body.bonds
        points = body.all_points
        d = body.dimension
        total = len(points)
        self.chunks = chunks_of(len(bonds.first))
        self.scratch = aligned_rows((self.chunks.threads, SCRATCH_ROWS, BLOCK), value=1)
        each = np.arange(len(body))
        alone = alone or body.relaxed or body.share.divided
        self._store(each if alone else alike(body), precision)
        # Bonds to points without support carry nothing, and others like them do.
        if not (alone or self.supported.all()):
            self._store(each, precision)
        self.changed: list[ChangedWeights] = []
        self.balance: BalancedWeights | None = None
        self.positions = points.copy()
        self.gradients = aligned_rows((total, d * d))
        self.changes = 0
        self.formed = False
        self.elapsed = 0.0
        self.before: float | None = None
        self._has_steps = False
        self.interfaces = None
        self.plane_motions = np.zeros((len(body.planes), d, d + 1))
        self._turned = False
        ghosts = body.ghosts
        self._unmoved = ghosts.shifts(body.points, self.plane_motions[:, :, -1])
        self.shifts = self._unmoved.copy()
        self.gradient_ghosts = (
            ghosts if plane == "stress" else ghosts.held_by_clamps(SHARE_ALONG_CLAMPS[plane])
        )
        images = ghosts.source, ghosts.parity, self.shifts
        self._place = self.bind(
            place_points, np.ascontiguousarray(body.points), *images, self.positions
        )
        self._gradient_shifts = np.zeros((len(ghosts), d * d))
        self._place_alone = Chain(self._place)

    def _store(self, alike: np.ndarray, precision: str) -> None:
        """Compute weights and shape tensors, those of points that are `alike` once."""
        body = self.body
        bonds = self.body.bonds
        n, d = self.body.points.shape
        total = len(body.all_points)
        self.alike = alike
        rows, self.starts = stored_lists(bonds.pointers, alike)
        _, vectors = bonds_of_rows(body, rows)
        ends = bonds.neighbors_of(rows)
        self.ways = ends - np.repeat(rows, np.diff(bonds.pointers)[rows].astype(np.int64))
        factors = body.weigh(lengths_of(vectors)) * body.all_volumes[ends]
        self.weighted_bonds = aligned_rows(vectors.shape, precision)
        self.weighted_bonds[:] = vectors * factors[:, None]
        self.inverse_shape = np.zeros((total, d * (d + 1) // 2))
        self.supported = np.zeros(total, dtype=np.uint8)
        shapes = self.inverse_shape, self.supported
        find_shapes(body, rows, self.starts, self.weighted_bonds, *shapes)
        for each in shapes:
            each[:n] = each[alike]
        body.ghosts.fill_shapes(self.inverse_shape, slice(None))
        body.ghosts.fill(self.supported)

    def bind(self, what: Pass, *arguments) -> BoundPass:
        """Return a pass bound to its arguments, in the chunks of this body."""
        return what.bind(*arguments, chunks=self.chunks)

    @cached_property
    def rows_of_blocks(self) -> np.ndarray:
        """Row in which the constants of each block of pairs are stored, one for all that are
        alike.
        """
        blocks = np.arange(len(self.body.bonds.ends_in_blocks(BLOCK)[0]) // BLOCK)
        if len(self.weighted_bonds) == self.body.bonds.pointers[-1]:
            return blocks.astype(np.uint32)
        found = alike_blocks(self.body, self.alike, BLOCK)
        return stored_lists(np.append(blocks, len(blocks)), found)[1].astype(np.uint32)

    @cached_property
    def sources(self) -> np.ndarray:
        """Number of each point itself, then of the point that each ghost mirrors, shape (n +
        m,).
        """
        return np.concatenate([np.arange(len(self.body)), self.body.ghosts.source.astype(np.int64)])

    def break_bonds(self, pairs: np.ndarray) -> np.ndarray:
        """Break pairs: remove them from the horizons of their ends; return the numbers of all pairs
        that a changed horizon affects.

        An end of these pairs is a point whose shape tensor has changed, or a mirror image of such a
        point.
        """
        bonds = self.body.bonds
        n = len(self.body)
        self.weighted_bonds[np.concatenate([bonds[pairs] for bonds in self.bonds_of_pairs])] = 0.0
        ends = np.concatenate([bonds.first[pairs], bonds.second[pairs]])
        touched = np.unique(ends[ends < n])
        reached = np.zeros(len(self.body.all_points), dtype=bool)
        reached[touched] = True
        self.body.ghosts.fill(reached)
        find_shapes(
            self.body,
            touched,
            self.starts,
            self.weighted_bonds,
            self.inverse_shape,
            self.supported,
            np.flatnonzero(reached[n:]),
        )
        if self.interfaces is not None:
            self.interfaces.break_bonds(pairs)
        if self.balance is not None:
            self.balance.renew(touched)
        self.formed = False
        self.changes = self.changes + 1
        own = bonds.pair_of[entries_of(bonds.pointers, touched)]
        outer = self.outer_pairs
        # other ranks may have broken pairs that this rank does not have
        beside = self.body.share.beside_halo(bonds.first, bonds.second)
        return np.unique(np.concatenate([own, outer[reached[bonds.second[outer]]], beside]))

    @cached_property
    def bonds_of_pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the two directed bonds of every pair, from its first and its second end;
        for a pair with a ghost, the first twice.
        """
        bonds = self.body.bonds
        forward = bonds.neighbors > self.body.bond_owners
        one = np.flatnonzero(forward).astype(np.uint32)
        other = one.copy()
        backward = np.flatnonzero(~forward)
        other[bonds.pair_of[backward]] = backward
        return one, other

    def places_of(self, numbers: np.ndarray, owners: np.ndarray) -> np.ndarray:
        """Return the places in `weighted_bonds` of directed bonds, with these first points."""
        return (self.starts[owners] - self.body.bonds.pointers[owners]).astype(np.int64) + numbers

    @cached_property
    def outer_pairs(self) -> np.ndarray:
        """Numbers of the pairs that have a ghost as one end."""
        return np.flatnonzero(self.body.bonds.second >= len(self.body))

    @cached_property
    def mirrored_pairs(self) -> np.ndarray:
        """Mirrored pair of each of the `outer_pairs`: for a pair of i and an image of k, the
        pair of k and the same plane's image of i.
        """
        bonds = self.body.bonds
        ghosts = self.body.ghosts
        outer = self.outer_pairs
        n = len(self.body)
        if not len(ghosts):
            return outer
        first = bonds.first[outer].astype(np.int64)
        ghost = bonds.second[outer].astype(np.int64) - n
        total = n + len(ghosts)
        keys = first * total + n + ghost
        # The products exceed 32 bits in bodies of more than 65,535 points.
        wanted = ghosts.source[ghost].astype(np.int64) * total + n + ghosts.mirrored(first, ghost)
        order = np.argsort(keys)
        return outer[order[np.searchsorted(keys, wanted, sorter=order)]]

    @cached_property
    def crossing(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Bonds to images of the points that this rank owns, plane by plane: their numbers (k,);
        half the displacement of the image per displacement of the plane, component by component
        (k, d); and where the bonds of each plane begin and end (planes + 1,).

        The factor is a half since half of the energy of such a bond belongs to the mirrored body.
        """
        body = self.body
        outer = self.outer_pairs
        outer = outer[body.share.own[body.bonds.first[outer]]]
        levers = body.ghosts.lever[body.bonds.second[outer] - len(body)]
        planes, rows = np.nonzero(levers.any(axis=2).T)
        ends = np.searchsorted(planes, np.arange(len(body.planes) + 1))
        return outer[rows], np.sign(levers[rows, planes]), ends

    def gradient_steps(
        self, positions: np.ndarray, gradients: np.ndarray, unsupported: float
    ) -> list[Step]:
        """Return the steps that compute deformation gradients from positions, or changes of
        gradients from displacements.

        `unsupported` is the value that they write on the diagonal at points without `supported`: 1
        for gradients, 0 for changes.
        """
        bonds = self.body.bonds
        arrays = bonds.pointers, self.starts, self.ways, self.weighted_bonds
        given = positions, *arrays, self.inverse_shape, unsupported, gradients
        form = self.bind(deformation_gradients[self.body.dimension], *given)
        return [
            form,
            *(step for each in self.changed for step in each.gradient_steps(positions, gradients)),
        ]

    def change_weights(
        self, numbers: np.ndarray, changes: np.ndarray, functions: np.ndarray
    ) -> None:
        """Add `changes` (k, d) to the weights of directed bonds in the gradients of their first
        points, before any steps are made.

        The sums of f c over the bonds of a point must vanish for its changes c and each of the
        `functions` f (k, d or d + 1). They begin with the undeformed bonds, so that gradients of
        affine motions stay as they are.
        """
        if self._has_steps:
            raise ValueError(
                "the first term of a force must be one with an energy if others have one: it"
                " balances the gradients of all"
            )
        of_bonds = self.body, self.chunks, numbers, changes, functions
        self.balance = BalancedWeights(*of_bonds, self.weighted_bonds, self.supported)
        self.changed.append(self.balance)

    def of_pairs(self, numbers: np.ndarray, owners: np.ndarray, pulls: np.ndarray) -> np.ndarray:
        """Return the forces on the first points of all pairs that follow from derivatives `pulls`
        (k, d) of an energy by the second ends of directed bonds, in gradients of their `owners`.
        """
        bonds = self.body.bonds
        signs = np.where(bonds.first[bonds.pair_of[numbers]] == owners, 1.0, -1.0)
        found = np.stack(
            [
                np.bincount(bonds.pair_of[numbers], signs * pull, len(bonds.first))
                for pull in pulls.T
            ],
            axis=1,
        )
        outer = self.outer_pairs
        found[outer] -= (
            self.body.ghosts.parity[bonds.second[outer] - len(self.body)]
            * found[self.mirrored_pairs]
        )
        return found

    def move_planes(self, motions: np.ndarray) -> None:
        """Displace every reflection plane by u(X) = turn X + displacement, with the `motions`
        [turn, displacement] of shape (planes, d, d + 1); their images follow when positions are
        next set.
        """
        if (motions == self.plane_motions).all():
            return
        turns = motions[:, :, :-1]
        if (turns != self.plane_motions[:, :, :-1]).any():
            self._turned = True
            self._gradient_shifts[:] = self.gradient_ghosts.gradient_shifts(turns)
        self.plane_motions[:] = motions
        self.shifts[:] = self.shifts_at(motions)

    def shifts_at(self, motions: np.ndarray) -> np.ndarray:
        """Return the shifts of the ghosts (..., m, d) for motions (..., planes, d, d + 1) of the
        planes.
        """
        turns = motions[..., :-1] if self._turned else None
        return self._unmoved + self.body.ghosts.moved_by_planes(motions[..., -1], turns)

    def steps(self) -> list[Step]:
        """Return the steps that place points and ghosts at the positions last taken and compute
        deformation gradients.

        A term that runs these steps before its own, in one call of compiled code, then sets
        `formed`.
        """
        self._has_steps = True
        before, after = (
            ([], [])
            if self.interfaces is None
            else (self.interfaces.corrections, self.interfaces.continuation)
        )
        of_ghosts = *self.gradient_ghosts.of_gradients, 1.0, self._gradient_shifts
        on_ghosts = (
            [self.bind(fill_matrices, self.gradients, *of_ghosts)] if len(self.body.ghosts) else []
        )
        form = self.gradient_steps(self.positions, self.gradients, 1.0)
        return [self._place, *form, *before, self.gradients, *on_ghosts, *after]

    @cached_property
    def place_and_form(self) -> Steps:
        """Sequence of `steps`, for terms that do not run these with their own."""
        return Steps(self.body.share, *self.steps())

    @cached_property
    def _form_gradients(self) -> Steps:
        return Steps(self.body.share, *self.steps()[1:])

    def set_positions(self, positions: np.ndarray) -> None:
        """Set the positions of the points, shape (n, d), for the next run of `steps`."""
        positions = np.ascontiguousarray(positions, dtype=float)
        self.body.share.fill(positions)
        self._place.give("given", positions)
        self.formed = False
        self.changes = self.changes + 1

    def place(self, positions: np.ndarray, form: bool = False) -> None:
        """Set the positions of the points and ghosts; compute deformation gradients at once if
        `form`, or else when they are needed.
        """
        self.set_positions(positions)
        if form:
            self.place_and_form()
            self.formed = True
        else:
            self._place_alone()

    def form_gradients(self) -> None:
        """Bring the deformation gradients of points and ghosts up to date."""
        if not self.formed:
            self._form_gradients()
            self.formed = True

    def deformation_gradients(self, images: bool = False) -> np.ndarray:
        """Return the deformation gradients F of the body's points, or of the ghosts if `images`,
        shape (n, d, d).
        """
        self.form_gradients()
        n = len(self.body)
        return matrices(self.gradients[n:] if images else self.gradients[:n])


def find_shapes(
    body: Body,
    rows: np.ndarray,
    starts: np.ndarray,
    weighted_bonds: np.ndarray,
    inverse_shape: np.ndarray,
    supported: np.ndarray,
    images: np.ndarray | slice = slice(None),
) -> None:
    """Write inverse shape tensors and flags of support of the points `rows`, see `Kinematics`, and
    complete them on halo and ghosts.

    `images` are the ghosts of points that change, by default all; those of halo points that other
    ranks change are among them.
    """
    pointers, vectors = bonds_of_rows(body, rows)
    of_bonds = pointers, vectors, starts[rows], weighted_bonds
    shape_rows[body.dimension](rows, *of_bonds, inverse_shape, supported)
    body.ghosts.fill_shapes(inverse_shape, images)
    body.ghosts.fill(supported)


def bonds_of_rows(body: Body, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the undeformed vectors of the directed bonds of the points `rows`, and before them
    the index at which those of each point begin.
    """
    bonds = body.bonds
    counts = (bonds.pointers[rows + 1] - bonds.pointers[rows]).astype(np.int64)
    vectors = vectors_between(body, np.repeat(rows, counts), bonds.neighbors_of(rows))
    return np.append(0, np.cumsum(counts)).astype(np.uint64), vectors


def entries_of(pointers: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the indices of all entries of the given rows, row by row; row i extends from
    ``pointers[i]`` to ``pointers[i + 1]``.
    """
    starts = pointers[rows].astype(np.int64)
    counts = pointers[rows + 1].astype(np.int64) - starts
    return np.repeat(starts - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())


def matrices(columns: np.ndarray) -> np.ndarray:
    """Return matrices, shape (k, d, d), from arrays that store them by columns, shape (k, d d);
    a view where possible.
    """
    d = math.isqrt(columns.shape[1])
    return columns.reshape(-1, d, d).transpose(0, 2, 1)
