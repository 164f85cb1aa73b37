"""Volumetric part of a selective energy (isochoric at bonds, volumetric at points), theory
(48)-(52).

At K = 1000 mu an energy evaluated only at the bonds locks: every bond would have to keep its
volume, which are more conditions than the body has degrees of freedom. The mean over the bonds of a
point is one condition per point.
"""

from collections.abc import Callable, Sequence

import numpy as np

from ..engine.block_arrays import BLOCK, aligned_rows, power_of_two
from ..kernels import dilatation, selective_energy
from ..kernels.ghosts import fill_matrices, place_points
from ..materials.response import volume_energy_block
from .binding import Binding
from .bond_shares import BondShares
from .material_points import rows_of_each
from .pair_passes import SelectivePairs
from .smoothing import Smoothing
from .steps import Steps


class VolumeEnergy:
    """Volumetric energy of a body: sum over points of V_i U(J_i), whose forces act as pressures on
    the pairs (`SelectivePairs`).

    J_i is the mean of det F_ij over the bonds of a point in the motion of its own material,
    smoothed over its nearest neighbors of that material, so that the pressure can jump at an
    interface. The mean alone is exact in homogeneous states, but its pressure is rough; det F_i
    alone leads to a pressure that alternates in sign from point to point.

    Parameters
    ----------
    binding : Binding
    shares : BondShares
    parts : sequence of SelectivePairs
        Pairs of every material.
    volumes : ndarray
        det F_ij of the pairs of all materials, one material after the other.

    Attributes
    ----------
    smoothing : Smoothing
        Smoothing of values of the points, which turns means over the bonds into dilatations.
    dilatations : ndarray, shape (n,)
        Smoothed volume ratios J_i in the state last evaluated.
    dilatation_steps : list
        Steps that compute `dilatations` from the deformation gradients; the counts that they return
        are pairs turned inside out.
    places : ndarray of int, shape (n_bonds,)
        For every directed bond, the index into `volumes` of its det F_ij in the motion of its first
        point's material.
    steps : list
        Steps that compute the pressures of the points and the volumetric energies from the
        dilatations.
    """

    def __init__(
        self,
        binding: Binding,
        shares: BondShares,
        parts: Sequence[SelectivePairs],
        volumes: np.ndarray,
    ) -> None:
        self.binding = binding
        self.shares = shares
        self.parts = parts
        body = binding.kinematics.body
        chunks = binding.kinematics.chunks
        n = len(body)
        bonds = body.bonds
        breakable = binding.settings.breakable
        self.smoothing = Smoothing(body, self._carrying(), breakable)
        means = np.ones(n)
        self.dilatations = np.ones(n)
        slopes = np.zeros(n)
        self.places = self._places()
        shares_of_bonds = bonds.pointers, self.places, binding.kinematics.starts, shares.bond_shares
        find_means = binding.kinematics.bind(
            selective_energy.means_over_bonds, *shares_of_bonds, volumes, 1.0, means
        )
        smooth = self.smoothing.bind(means, self.dilatations, chunks)
        # Points in the halo have bonds, and therefore neighbors, that this rank does not have.
        seen = [step for part in parts for step in part.points.seen]
        self.dilatation_steps = [
            *seen,
            *(part.find_volumes for part in parts),
            find_means,
            means,
            smooth,
            self.dilatations,
        ]
        self._find = Steps(body.share, *self.dilatation_steps)

        # The transpose of the smoothing of U' acts on the bonds of the points, and V_i W_ij is
        # symmetric. Slopes may be in units of each material's own modulus, for none reach another.
        # Ghosts' volumes lie beyond the body: they have no pressure, and no share.
        pressures = parts[0].pressures if binding.whole else np.zeros(n)
        spread = self.smoothing.bind(slopes, pressures, chunks), pressures[:n]
        counted = body.volumes * body.share.own
        before = []
        passes = []
        after = []
        shown = []
        for part in parts:
            places, numbers = part.points.own
            # If all points are of one material, these are views of the arrays of all points.
            own_ratios = self.dilatations[numbers]
            own_slopes = slopes[numbers]
            part.volume_energies = np.zeros(-(-len(own_ratios) // BLOCK))
            law = volume_energy_block(part.points.law).address, part.points.parameters, part.buffers
            arrays = own_ratios, counted[numbers], *law, part.volume_energies, own_slopes
            passes.append(binding.kinematics.bind(selective_energy.volume_energies, *arrays))
            if not binding.whole:
                copied = part.points.copied
                every = np.arange(len(numbers))
                before.append(copied(numbers, every, self.dilatations, own_ratios))
                after.append(copied(every, numbers, own_slopes, slopes))
                # The pressures go to the points of each material; other materials and images have
                # none.
                shown.append(copied(numbers, places, pressures, part.pressures))
        self.steps = [*before, *passes, *after, *spread, *shown]

    def _places(self) -> np.ndarray:
        """Return, for every directed bond, the index into `volumes` of its det F_ij in the
        motion of its first point's material.
        """
        binding = self.binding
        bonds = binding.kinematics.body.bonds
        start = 0
        if binding.whole:
            return bonds.pair_of
        owners = binding.portion_of[binding.kinematics.body.bond_owners]
        places = np.zeros(len(bonds.pair_of), dtype=np.uint32)
        for number, part in enumerate(self.parts):
            place = np.zeros(len(bonds.first), dtype=np.uint32)
            place[part.points.pairs] = start + np.arange(len(part.points.pairs))
            places[owners == number] = place[bonds.pair_of[owners == number]]
            start += len(part.points.first)
        return places

    def stiffness(self) -> np.ndarray:
        """Return the stiffness V_i mu U'' of the points against a change of their dilatation in the
        state last evaluated, shape (n,).

        V_i is the volume, mu the shear modulus, and U'' the second derivative of the volumetric
        energy. Rigid points do not change their volume: any stiffness will do.
        """
        volumes = self.binding.kinematics.body.volumes
        found = volumes * max(part.unit for part in self.parts)
        for part in self.parts:
            law = part.points.law
            _, own = part.points.own
            found[own] = (
                part.unit * volumes[own] * law.volumetric(self.dilatations[own], law.parameters)[2]
            )
        return found

    def find_dilatations(self) -> int:
        """Compute `dilatations` from the current deformation gradients; return the number of
        pairs turned inside out.
        """
        return sum(self._find())

    def renew(self) -> None:
        """Update the smoothing after the weights of pairs have changed."""
        self.smoothing.renew(self._carrying())

    def _carrying(self) -> np.ndarray:
        """Return flags of the pairs within one material that carry forces."""
        carries = self.shares.carrying(self.binding.settings.breakable)
        bonds = self.binding.kinematics.body.bonds
        binding = self.binding
        return (
            carries
            if binding.whole
            else carries & (binding.portion_of[bonds.first] == binding.portion_of[bonds.second])
        )


class LinearizedDilatation:
    """Derivative D of the smoothed dilatations of the points by the positions, and its transpose
    (theory (58)), in single precision.

    Solvers use it in approximations of the tangent.

    Parameters
    ----------
    volumes : sequence of VolumeEnergy
        Volumetric energies of a body, whose dilatations are the same.

    Attributes
    ----------
    stiffness : ndarray, shape (n,)
        Stiffness C of the points against a change of their dilatation, the sum of
        `VolumeEnergy.stiffness`.
    """

    def __init__(self, volumes: Sequence[VolumeEnergy]) -> None:
        volume = volumes[0]
        kinematics = volume.binding.kinematics
        shares = volume.shares
        interfaces = kinematics.interfaces
        body = kinematics.body
        chunks = kinematics.chunks
        bonds = body.bonds
        ghosts = body.ghosts
        d = body.dimension
        n = len(body)
        total = len(body.all_points)
        self._volumes = volumes
        self._volume = volume
        self._body = body
        self._chunks = chunks
        length = dilatation.record_length(d)
        sizes = [len(part.points.first) for part in volume.parts]
        of_pairs, means, pressures = (
            np.zeros(size, dtype=np.float32) for size in (sum(sizes), n, total)
        )
        self._changes = np.zeros(n, dtype=np.float32)
        self._values = means
        # Displacements and changes of gradients of points and ghosts, the forces on them, and the
        # moments by their gradients.
        displacements = np.zeros((total, d))
        gradients = aligned_rows((total, d * d))
        # the gradients are no longer needed when the forces are computed
        self._forces = np.zeros((total, d))
        moments = gradients
        several = interfaces is not None
        jumps = np.zeros((total, d)) if several else None
        changes = np.zeros((total, d * d)) if several else None
        seen = [np.zeros((total, width)) for width in (d, d * d)] if several else [None, None]
        self._on_jumps = np.zeros((n, d)) if several else 0.0
        self._linearize = []
        find = []
        gather = []
        (of_forces, sum_forces), (of_moments, sum_moments) = (
            rows_of_each(kinematics, [part.points for part in volume.parts], *out)
            for out in zip((self._forces, moments), seen, strict=True)
        )
        of_parts = np.split(of_pairs, np.cumsum(sizes)[:-1]), of_forces, of_moments
        for part, by_pair, *on_points in zip(volume.parts, *of_parts, strict=True):
            points = part.points
            size = len(points.positions)
            derivatives = aligned_rows((len(by_pair), length), np.float32)
            records = aligned_rows((size, length), np.float32)
            places = points.positions, points.gradients, part.pairs, part.buffers, derivatives
            self._linearize.append(kinematics.bind(dilatation.volume_derivatives[d], *places))
            moved = [displacements, gradients]
            theirs = pressures
            pairs = points.pairs_of_points()
            if several:
                moved = on_points
                theirs = np.zeros(size, dtype=np.float32)
                find.append(points.copies(displacements, gradients, jumps, changes, *moved))
                # Shares of ends in other materials are zero, so that their pressures do not count.
                gather.append(points.copied(points.numbers, np.arange(size), pressures, theirs))
            find += [
                kinematics.bind(dilatation.displacement_records, *moved, records),
                kinematics.bind(
                    dilatation.volume_changes[d],
                    derivatives,
                    records,
                    pairs[0],
                    points.second,
                    by_pair,
                ),
            ]
            gather += [
                kinematics.bind(
                    dilatation.pair_pressures,
                    theirs,
                    points.first,
                    points.second,
                    points.rows,
                    part.end_shares,
                    by_pair,
                ),
                kinematics.bind(
                    dilatation.sum_pressures[d], derivatives, by_pair, *pairs, *on_points
                ),
            ]
        gather += sum_forces + sum_moments
        corrections = []
        continuation = []
        further = []
        if several:
            corrections, continuation = interfaces.steps(displacements, gradients, jumps, changes)
            further = interfaces.steps_back(*seen, moments[:n], self._on_jumps)
        images = (
            ghosts.source,
            ghosts.parity,
            np.zeros_like(ghosts.parity),
        )
        of_ghosts = kinematics.gradient_ghosts.of_gradients
        self._place = kinematics.bind(
            place_points, np.ascontiguousarray(body.points), *images, displacements
        )
        self._find_changes = Steps(
            body.share,
            self._place,
            *kinematics.gradient_steps(displacements, gradients, 0.0),
            *corrections,
            gradients[:n],
            kinematics.bind(
                fill_matrices, gradients, *of_ghosts, 0.0, np.zeros((len(ghosts), d * d))
            ),
            *continuation,
            *find,
            kinematics.bind(
                selective_energy.means_over_bonds,
                bonds.pointers,
                volume.places,
                kinematics.starts,
                shares.bond_shares,
                of_pairs,
                0.0,
                means,
            ),
            means,
            volume.smoothing.bind(means, self._changes, chunks),
        )
        self._find_forces = Steps(
            body.share,
            means,
            volume.smoothing.bind(means, pressures, chunks),
            pressures[:n],
            *gather,
            *shares.steps_to_points(
                moments, self._forces, np.zeros((len(ghosts), d * d)), *further
            ),
        )
        self._rigid = several and volume.binding.portion_of[:n] == len(volume.parts)
        self.stiffness = body.volumes * max(part.unit for part in volume.parts)

    def linearize(self) -> None:
        """Compute the derivative D and `stiffness` at the state last evaluated."""
        for linearize in self._linearize:
            linearize()
        self._volume.smoothing.renew_copies()
        self.stiffness = np.sum([volume.stiffness() for volume in self._volumes], axis=0)

    def changes(self, displacements: np.ndarray) -> np.ndarray:
        """Return the changes D u of the dilatations, shape (n,), for displacements u (n, d)."""
        displacements = np.ascontiguousarray(displacements)
        self._body.share.fill(displacements)
        self._place.give("given", displacements)
        self._find_changes()
        return np.where(self._rigid, 0.0, self._changes.astype(float))

    def forces(self, values: np.ndarray) -> np.ndarray:
        """Return D^T s, shape (n, d), vectors such as forces, for `values` s (n,) at the points;
        the cost is about that of `changes`.
        """
        # The smoothing, weighted by volumes, is its own transpose. A power of two keeps the values
        # in the range of single precision.
        pressures = values / self._body.volumes
        unit = power_of_two(self._body.share.sum(np.abs(pressures)))
        np.divide(pressures, unit, out=self._values, casting="same_kind")
        self._find_forces()
        return -unit * (self._forces[: len(values)] + self._on_jumps)

    def polynomial(self, coefficients: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return a function that applies a polynomial of the smoothing W to values (n,): the sum of
        c_k T_k(2 W^2 - I).

        c_k are the `coefficients`, T_k are Chebyshev polynomials; the sum is taken by Clenshaw's
        recurrence.
        """
        smoothing = self._volume.smoothing
        chunks = self._chunks
        n = len(self._body)
        values, once, found, *sums = np.zeros((5, n), dtype=np.float32)
        first, second = sums
        steps = []
        for k in reversed(range(len(coefficients))):
            # b_k = c_k v + 2 (2 W^2 - I) b_(k + 1) - b_(k + 2), which is overwritten; the result
            # has W^2 once.
            factor, out = (4.0, second) if k else (2.0, found)
            others = (-factor / 2, first), (coefficients[k], values), (-1.0, second)
            steps += [
                first,
                smoothing.bind(first, once, chunks),
                once,
                smoothing.bind_sum(once, factor, others, out, chunks),
            ]
            first, second = second, first
        run = Steps(self._body.share, *steps)

        def product(given: np.ndarray) -> np.ndarray:
            values[:] = given
            for array in sums:
                array[:] = 0.0
            run()
            return found.astype(float)

        return product
