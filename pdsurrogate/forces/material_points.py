"""Points that the bonds of one material involve, with their volume ratios and thickness
stretches by its law.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ..body.bonds import pairs_of_points, pointers_to
from ..engine.block_arrays import BLOCK, aligned_rows
from ..engine.passes import BoundPass
from ..errors import InvalidState
from ..kernels import node_state
from ..kernels.material_copies import copy_values, gather_rows, see_points
from ..kernels.sums import sum_pair_forces
from ..materials import PLANES, Law
from .errors import at_point, why_invalid
from .kinematics import Kinematics, matrices
from .settings import ROTATION, ROTATIONS
from .steps import Steps


class MaterialPoints:
    """Points and images of one material, points of other materials bonded to them, and the states
    of all these points by its law.

    If all points of the body are of the material, the arrays are the body's own. Otherwise they are
    copies, in which the points of other materials are where they would be if they moved with this
    material (`Interfaces`).

    Parameters
    ----------
    kinematics : Kinematics
    law : Law
    precision : str
        Precision of the records.
    rotation : str, optional
        See `ForceSettings`; only bond forces read it.
    own : ndarray of bool, shape (n + m,), optional
        Flags of the points and images of the material; by default all.
    pairs : ndarray of int, optional
        Pairs of the body with an end in the material; by default all.

    Attributes
    ----------
    whole : bool
        Whether all points are of the material.
    numbers, pairs : slice or ndarray of int
        Numbers in the body of the k points and images of this object, and of its pairs.
    own : tuple
        Indices into `numbers`, and numbers in the body, of the points of the material itself,
        without images.
    others : ndarray of bool, shape (k,)
        In a body of several materials, flags of the points of other materials.
    first, second : ndarray of uint32
        Ends of the pairs by their places in `numbers`, filled up to whole blocks.
    rows : ndarray of uint32, shape (n_blocks,)
        Row in which the constants of each block of pairs are stored, one for all that are alike.
    positions, gradients : ndarray, shapes (k, d) and (k, d d)
    volume_ratios : ndarray, shape (k,)
        Volume ratios J3 of the points.
    kept_ratios : ndarray, shape (n + m,)
        Latest volume ratios by the numbers of points and images in the body, from which the next
        iteration starts.
    records : ndarray, shape (k, 4)
        (cos, sin) of the rotation, J and C33 of every point, which bond forces read; empty in three
        dimensions.
    response, parameters
        Compiled response function of the law, and the parameters of the law, changed in place by
        `set_parameters`.
    seen : list of BoundPass
        In a body of several materials, the passes that update positions, gradients and volume
        ratios from the body.
    state_pass : BoundPass or None
        Compiled pass that finds volume ratios and records with a learned force; None if the law
        determines them.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        law: Law,
        precision: str,
        rotation: str | None = None,
        own=None,
        pairs=None,
    ) -> None:
        body = kinematics.body
        self._kinematics = kinematics
        self.law = law
        self.whole = own is None
        self.response = PLANES[kinematics.plane].response.block(law)
        self.parameters = law.parameters.copy()
        self.state_pass: BoundPass | None = None
        self.seen: list[BoundPass] = []
        self._keep = self.seen
        self._found_at = -1
        if own is None:
            self.numbers = self.pairs = slice(None)
            self.own = slice(len(body)), slice(len(body))
            self.first, self.second = body.bonds.ends_in_blocks(BLOCK)
            self.rows = kinematics.rows_of_blocks
            self.positions = kinematics.positions
            self.gradients = kinematics.gradients
            self.volume_ratios = self.kept_ratios = np.ones(len(self.positions))
        else:
            self._see(own, np.empty(0, dtype=np.int64) if pairs is None else pairs)
        self.records = aligned_rows(
            (len(self.positions) if body.dimension == 2 else 0, 4), precision
        )
        turn = ROTATIONS[rotation or ROTATION]
        self._turn = turn and kinematics.bind(turn, self.gradients, self.records)

    def set_parameters(self, law: Law) -> None:
        """Replace the law by one of the same kind with other numbers; passes that are bound to
        `parameters` evaluate it from then on.
        """
        self.law = law
        self._found_at = -1
        self.parameters[:] = law.parameters

    def _see(self, own: np.ndarray, pairs: np.ndarray) -> None:
        """Set up copies of the arrays for the material's own points and the other ends of its
        pairs, in a body of several materials.
        """
        kinematics = self._kinematics
        body = self._kinematics.body
        ends = body.bonds.first[pairs], body.bonds.second[pairs]
        seen = own.copy()
        seen[np.concatenate(ends)] = True
        self.pairs = pairs
        self.numbers = np.flatnonzero(seen)
        place = np.cumsum(seen) - 1
        places = np.flatnonzero(own[self.numbers] & (self.numbers < len(body)))
        self.own = places, self.numbers[places]
        self.first, self.second = (
            np.pad(place[end], (0, -len(end) % BLOCK)).astype(np.uint32) for end in ends
        )
        self.rows = np.arange(len(self.first) // BLOCK, dtype=np.uint32)
        size = len(self.numbers)
        d = body.dimension
        self.positions = aligned_rows((size, d))
        self.gradients = aligned_rows((size, d * d))
        self.volume_ratios = np.ones(size)
        self.kept_ratios = np.ones(len(own))
        self.others = ~own[self.numbers]
        every = np.arange(size)
        places = (
            kinematics.positions,
            kinematics.gradients,
            kinematics.interfaces.jumps,
            kinematics.interfaces.changes,
        )
        ratios = self.copied(self.numbers, every, self.kept_ratios, self.volume_ratios)
        self.seen = [self.copies(*places, self.positions, self.gradients), ratios]
        self._keep = [self.copied(every, self.numbers, self.volume_ratios, self.kept_ratios)]

    def places_of_pairs(self, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray | slice]:
        """Return the places, among the pairs of this object, of those of some `pairs` of the body
        that are among them, and their indices in `pairs`.
        """
        if self.whole:
            return pairs, slice(None)
        # Not by `isin`, which takes as long for a few pairs as for all of a large body.
        places = np.searchsorted(self.pairs, pairs)
        chosen = np.flatnonzero(np.searchsorted(self.pairs, pairs, side="right") > places)
        return places[chosen], chosen

    @property
    def stored(self) -> tuple[np.ndarray, np.ndarray]:
        """Numbers in the body of the pairs whose constants are stored, and their places in the rows
        of `rows`, one row after the other.
        """
        # Rows are numbered in the order in which blocks first have them.
        blocks = np.flatnonzero(
            np.diff(np.maximum.accumulate(self.rows.astype(np.int32)), prepend=-1)
        )
        places = (blocks[:, None] * BLOCK + np.arange(BLOCK)).ravel()
        count = self._kinematics.body.bonds.n_pairs if self.whole else len(self.pairs)
        within = np.flatnonzero(places < count)
        places = places[within]
        return places if self.whole else self.pairs[places], within

    def pairs_of_points(self) -> tuple[np.ndarray, ...]:
        """Return the pairs of each point of this object, see `pdsurrogate.body.bonds`."""
        if self.whole:
            return self._kinematics.body.bonds.pairs_of_points
        ends = (end[: len(self.pairs)] for end in (self.first, self.second))
        return pairs_of_points(*ends, len(self.positions))

    def copied(
        self, numbers: np.ndarray, places: np.ndarray, values: np.ndarray, out: np.ndarray
    ) -> BoundPass:
        """Return the pass that writes ``values[numbers]`` to ``out[places]``."""
        return self._kinematics.bind(
            copy_values, numbers.astype(np.uint32), places.astype(np.uint32), values, out
        )

    def copies(
        self,
        positions,
        gradients,
        jumps,
        changes,
        to_positions: np.ndarray,
        to_gradients: np.ndarray,
    ) -> BoundPass:
        """Return the pass that copies positions and gradients of a body of several materials, or
        their changes, as this material sees them.

        The first four arrays have rows for the body's points and images; `jumps` and `changes` as
        in `Interfaces`. The last two have the rows of this object and receive the copies.
        """
        arrays = (
            self.numbers.astype(np.uint32),
            self.others,
            self._kinematics.interfaces.depths,
            positions,
            gradients,
            jumps,
            changes,
        )
        return self._kinematics.bind(
            see_points(positions.shape[1]), *arrays, to_positions, to_gradients
        )

    @cached_property
    def steps(self) -> list[BoundPass]:
        """Passes of an evaluation that find volume ratios and records from the gradients, and count
        the points without a state.

        They are bound at first use, as `state_pass` may be set after construction.
        """
        return [
            *self.seen,
            self.state_pass or self._pass_of_law(),
            *([self._turn] if self._turn else []),
            *self._keep,
        ]

    def _pass_of_law(self) -> BoundPass:
        """Return the compiled pass that finds volume ratios and records of the points by the law
        of the material.
        """
        kinematics = self._kinematics
        arrays = (self.gradients, self.volume_ratios)
        if kinematics.plane != "stress":
            return kinematics.bind(
                node_state.held_states[kinematics.body.dimension], *arrays, self.records
            )
        law = self.response.address, self.parameters, kinematics.scratch
        return kinematics.bind(node_state.node_states, *arrays, *law, self.records)

    def find(self) -> None:
        """Bring the gradients, volume ratios and records of the points up to date with the
        positions.

        Raises
        ------
        InvalidState
            If a point has det F <= 0, no state by the law, or numbers that are not finite; the
            message names the point.
        """
        self._kinematics.form_gradients()
        if self._found_at != self._kinematics.changes:
            have_states([self], Steps(self._kinematics.body.share, *self.steps)())

    def note(self, counts: list[int]) -> bool:
        """Take the `counts` of this material's state passes; return whether all its points have a
        state.

        If a point has none, the next evaluation starts from volume ratios of 1.
        """
        found = not any(counts)
        self._found_at = self._kinematics.changes if found else -1
        if not found:
            self.kept_ratios[:] = 1.0  # a later evaluation then starts from the initial values
        return found

    def diagnose(self) -> str:
        """Return an error message that names a point that has no state by the law, and the
        reason.
        """
        body = self._kinematics.body
        plane = self._kinematics.plane
        # Images are checked too: beyond a grip the reflected gradient may be turned inside out
        # where the point's own is not.
        place, reason = why_invalid(matrices(self.gradients), "", plane, lambda _: [self.law])
        number = np.arange(len(body.all_points))[self.numbers][place]
        image = "its image beyond the grip: " if number >= len(body) else ""
        return at_point(body, int(self._kinematics.sources[number]), image + reason)


def rows_of_each(
    kinematics: Kinematics, materials: list[MaterialPoints], out: np.ndarray, theirs=None
) -> tuple[list[np.ndarray], list[BoundPass]]:
    """Return an array with a row for each point of each material, and the pass that sums these
    rows at the points and ghosts of the body and writes the sums to `out`.

    `theirs` receives the sums over those materials only that are not the point's own. With one
    material the array is `out` itself.
    """
    if materials[0].whole:
        return [out], []
    ends = np.cumsum([len(points.positions) for points in materials])
    rows = aligned_rows((ends[-1], out.shape[1]))
    numbers = np.concatenate([points.numbers for points in materials])
    others = np.concatenate([points.others for points in materials])
    order = np.argsort(numbers, kind="stable")
    pointers = pointers_to(numbers, len(out))
    arrays = pointers, order.astype(np.uint32), others[order], rows, out
    theirs = out[:0] if theirs is None else theirs
    gather = kinematics.bind(gather_rows(rows.shape[1]), *arrays, theirs)
    return np.split(rows, ends[:-1]), [gather]


def pair_sums(kinematics: Kinematics, parts: Sequence, out: np.ndarray) -> list[BoundPass]:
    """Return the passes that sum the forces of pairs at the points of a body, see `rows_of_each`.

    `parts` hold the pairs of each material in units of ``part.unit``. The first passes are one for
    each material, in order.
    """
    rows, gather = rows_of_each(kinematics, [part.points for part in parts], out)
    passes = [
        kinematics.bind(
            sum_pair_forces[kinematics.body.dimension],
            part.forces,
            *part.points.pairs_of_points(),
            float(part.unit),
            own_rows,
        )
        for part, own_rows in zip(parts, rows, strict=True)
    ]
    return passes + gather


def have_states(materials: list[MaterialPoints], counts: list[int]) -> list[int]:
    """Check that all points have a state; return the counts of the passes that follow the state
    passes.

    `counts` are those of all passes of an evaluation, which begins with the state passes of each of
    `materials`.

    Raises
    ------
    InvalidState
        If a point has no state; the message names it.
    """
    unsolved = None
    begun = 0
    for points in materials:
        end = begun + len(points.steps)
        if not points.note(counts[begun:end]):
            unsolved = unsolved or points
        begun = end
    if unsolved is not None:
        raise InvalidState(unsolved.diagnose())
    return counts[begun:]
