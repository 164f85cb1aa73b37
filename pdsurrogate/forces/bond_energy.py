"""The bond-level energy and the forces that are its gradient (theory (27)-(31), volumes shared out by `reference_state.bond_shares`)."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..body import Body
from ..engine.block_arrays import BLOCK, aligned_rows
from ..engine.passes import Chain
from ..kernels import bond_energy
from ..kernels.bond_force import FALL_BACK, UNGUARDED
from ..kernels.domain import DOMAIN_SIZE
from ..kernels.elementary import sum_in_order
from ..kernels.energy_density import analytic_energy_density
from ..kernels.reference_state import bond_shares
from ..kernels.sums import add_node_forces, point_forces, sum_moments, weigh_moments
from ..materials import PLANES, Law, plane_stress
from .energy_density import BLEND, EnergyDerivatives, blended, domain_constants
from .evaluation import DomainWatch, Evaluation, usual_precision
from .kinematics import Kinematics, at_point, locate, matrices
from .protocol import CompiledBondForce, Domain, ForceModel, InvalidState, Portion, Release
from .settings import OUTSIDE, OUTSIDE_POLICIES, PRECISIONS, ForceSettings

if TYPE_CHECKING:
    from .energy_of_portions import EnergyOfPortions
    from .selective_energy import IsochoricEnergy
    from .tangent import Tangent


class EnergySurrogate(ForceModel):
    """A force model that maps the invariants of a bond's deformation gradient to its energy: a surrogate, or the exact energy.

    Attributes
    ----------
    domain : Domain or None
        Where it was trained, as bounds of the principal stretches; None if it holds everywhere.
    default_precision : str

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> isinstance(pds.load_surrogate("neo-hookean-energy"), pds.EnergySurrogate)
    True
    """

    family = "bond energy"
    domain: Domain | None
    default_precision: str

    @property
    def honours(self) -> Mapping[str, tuple]:
        # It is exact on incomplete horizons, and its invariants know no rotation.  What is learnt is the energy of a sheet.
        honours = {"precision": PRECISIONS, "correction": ("none",), "breakable": (True,), "plane": ("stress",)}
        return honours | ({} if self.domain is None else {"outside": tuple(OUTSIDE_POLICIES)})

    def evaluation(self, body: Body, law: Law, settings: ForceSettings) -> BondEnergyEvaluation:
        return BondEnergyEvaluation(self, body, law, settings)

    def evaluation_of_portions(self, body: Body, portions: Sequence[Portion], settings: ForceSettings) -> EnergyOfPortions:
        from .energy_of_portions import BondEnergyOfPortions  # which stands on this module

        return BondEnergyOfPortions(body, portions, settings)

    @abstractmethod
    def energy_derivatives(self, law: Law, trace, area_ratio) -> EnergyDerivatives:
        """Energy and derivatives in NumPy, for checking and for the tangent."""

    @abstractmethod
    def compiled(self, dtype) -> CompiledBondForce:
        """Energy and first derivatives for the pass over the pairs (`pdsurrogate.kernels.energy_density`)."""


class BondEnergyForce(EnergySurrogate):
    """The exact energy of any law.

    Under plane stress it is that of the bonds, C33 solved in every evaluation.  In plane strain and in space the isochoric part is taken
    at the bonds and the volumetric one at the points, which does not lock (`pdsurrogate.forces.selective_energy`).

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> body = pds.Body.rectangle(1.0, 1.0, 0.25, 0.7875)
    >>> force = pds.BondEnergyForce().bind(body, pds.NeoHookean(), pds.ForceSettings(precision="float64"))
    >>> force.place(body.points * [1.1, 1.0])
    >>> bool(force.stress_and_energy()[1].min() > 0)
    True
    """

    name = "bond-energy"
    domain = None
    default_precision = "float64"

    @property
    def honours(self) -> Mapping[str, tuple]:
        return {**super().honours, "plane": tuple(PLANES)}

    def honoured(self, plane: str) -> Mapping[str, tuple]:
        # Of the selective energy single precision would be that of what the pairs hand to the points, for 4 per cent of its time.
        return self.honours if plane == "stress" else {**self.honours, "precision": ("float64",)}

    def evaluation(self, body: Body, law: Law, settings: ForceSettings) -> BondEnergyEvaluation:
        if settings.plane == "stress":
            return BondEnergyEvaluation(self, body, law, settings)
        from .selective_energy import SelectiveEnergyEvaluation  # which stands on this module

        return SelectiveEnergyEvaluation(self, body, law, settings)

    def evaluation_of_portions(self, body: Body, portions: Sequence[Portion], settings: ForceSettings) -> EnergyOfPortions:
        if settings.plane == "stress":
            return super().evaluation_of_portions(body, portions, settings)
        from .energy_of_portions import SelectiveEnergyOfPortions  # which stands on this module

        return SelectiveEnergyOfPortions(body, portions, settings)

    def isochoric_energy(self, law: Law, plane: str, outside: str, precision: str) -> IsochoricEnergy:
        """What the pass over the pairs takes at the bonds in plane strain and in space, in double precision; it holds everywhere."""
        from .selective_energy import IsochoricEnergy  # which stands on this module

        return IsochoricEnergy.exact(law, plane)

    def energy_derivatives(self, law: Law, trace, area_ratio) -> EnergyDerivatives:
        return EnergyDerivatives(*plane_stress.energy_derivatives(law, trace, area_ratio))

    def compiled(self, dtype) -> CompiledBondForce:
        """Block function of the exact energy, whose law the pass supplies."""
        return CompiledBondForce(analytic_energy_density(dtype).address, np.zeros(1, dtype=np.int64), np.zeros(1, dtype=dtype), 0)


def pair_geometry(body: Body, pairs: np.ndarray | slice, weights: np.ndarray, precision: str) -> np.ndarray:
    """Reference data of pairs in blocks, shape (n_blocks, d + 2 or d + 3, BLOCK).

    They are n, 1/l, the volume that the energy of each counts for and, of a body in parts, what of that is counted here.
    """
    first, second = body.bonds.first[pairs], body.bonds.second[pairs]
    counted = body.share.counted_pairs(first)
    vectors = body.all_points[second] - body.all_points[first]
    length = np.linalg.norm(vectors, axis=1)
    blocks, size = -(-len(first) // BLOCK), body.dimension + (2 if counted is None else 3)
    rows = np.zeros((size, blocks * BLOCK))
    rows[:, : len(first)] = *(vectors / length[:, None]).T, 1 / length, weights, *(() if counted is None else (weights * counted,))
    geometry = aligned_rows((blocks, size, BLOCK), precision)
    geometry[:] = rows.reshape(size, blocks, BLOCK).transpose(1, 0, 2)
    return geometry


class PairEnergies:
    """The pass of one model over some pairs of a body, bound to its arrays.

    Parameters
    ----------
    model : EnergySurrogate
    law : Law
    precision, outside : str
        See `ForceSettings`.
    kinematics : Kinematics
    response
        Compiled response of the law.
    positions, gradients : ndarray, shapes (k, 2) and (k, 4)
        Of the points and images that pairs are made of.
    first, second : ndarray of uint32
        Ends of the pairs, filled up to whole blocks.
    geometry : ndarray
        See `pair_geometry`.

    Attributes
    ----------
    energy : float
        Of the pairs, over the shear modulus, as last found.
    collapsed, invalid : int
        Pairs with det F_ij below `COLLAPSED`; of them those turned inside out.
    forces : ndarray, shape (n_blocks * BLOCK, 2)
    moments : ndarray, shape (n_blocks * BLOCK, 4)
        See `pdsurrogate.kernels.bond_energy.pair_energies`.
    buffers, sums : ndarray
        Working memory.
    """

    def __init__(
        self,
        model: EnergySurrogate,
        law: Law,
        precision: str,
        outside: str,
        kinematics: Kinematics,
        response,
        positions: np.ndarray,
        gradients: np.ndarray,
        first: np.ndarray,
        second: np.ndarray,
        geometry: np.ndarray,
    ) -> None:
        self.model, self.law, self.outside = model, law, outside
        self._compiled = compiled = model.compiled(precision)
        self._exact, self._response = analytic_energy_density(precision), response
        domain, chunks = model.domain, kinematics.chunks
        guard = {"fallback": FALL_BACK, "extrapolate": UNGUARDED}.get(outside, bond_energy.COUNTED) if domain else UNGUARDED
        self.buffers = aligned_rows((chunks.threads, bond_energy.BUFFER_ROWS, BLOCK), precision)
        self.sums = aligned_rows((chunks.threads, 4, BLOCK))
        self._counts = np.zeros((chunks.number, 3), dtype=np.int64)
        self.energy, self.collapsed, self.invalid = 0.0, 0, 0
        self._energies = np.zeros(len(geometry))
        self.forces = aligned_rows((len(first), 2), precision)
        self.moments = aligned_rows((len(first), 4), precision)
        self._find = bond_energy.pair_energies.bind(
            positions,
            gradients,
            first,
            second,
            geometry,
            compiled.address,
            compiled.sizes,
            compiled.weights,
            self._exact.address,
            response.address,
            law.parameters,
            guard,
            domain_constants(domain, precision) if domain else np.zeros(DOMAIN_SIZE, precision),
            self.buffers,
            self.sums,
            aligned_rows((chunks.threads, max(compiled.work_rows, 1), BLOCK), precision),
            kinematics.scratch,
            self._counts,
            self._energies,
            self.forces,
            self.moments,
            chunks=chunks,
        )

    def __call__(self) -> int:
        """Bring energy, forces and moments up to date; returns the number of pairs outside the model's domain."""
        self._find()
        self.energy = float(sum_in_order(self._energies))
        outside, self.collapsed, self.invalid = self._counts.sum(axis=0).tolist()
        return outside

    def energy_derivatives(self, trace, area_ratio) -> EnergyDerivatives:
        """The energy used here, the exact one taking over where the pass falls back on it, with second derivatives."""
        found = self.model.energy_derivatives(self.law, trace, area_ratio)
        if self.model.domain is None or self.outside != "fallback":
            return found
        exact = BondEnergyForce().energy_derivatives(self.law, trace, area_ratio)
        return blended(found, exact, self.model.domain, trace, area_ratio)


class EnergyOfPairs(Evaluation):
    """An energy that is summed over the pairs of a body: shares of the points' volumes, and sums of forces and moments to the points.

    The energy is that of the body's own points: of a pair with a ghost, the point's share counts and the ghost's, which lies beyond the
    grip, does not.  Ghosts are functions of the points they mirror, so what the energy says about a ghost is handed on to that point.

    Attributes
    ----------
    unit : float
        By which forces, moments and energies of the pairs are multiplied.
    bond_shares : ndarray, shape (n_bonds,)
        Volume of its point that every directed bond stands for.
    bond_weights : ndarray, shape (n_pairs,)
        Volume bond_volume that the energy of every pair counts for; zero of those that carry nothing.
    """

    has_energy = True
    unit: float
    _forces: np.ndarray
    _moments: np.ndarray

    @property
    def geometry_precision(self) -> str:
        """Of the reference data of the pairs."""
        return self.precision

    def _prepare(self) -> None:
        """Shares of the bonds, and lists of the pairs and bonds of ghosts."""
        body = self.body
        bonds, n, total = body.bonds, len(body), len(body.all_points)
        vectors = body.all_points[bonds.second] - body.all_points[bonds.first]
        length = np.linalg.norm(vectors, axis=1)
        self._strength = body.weigh(length) * body.all_volumes[bonds.first] * body.all_volumes[bonds.second]
        self._intact = np.ones(self._n_pairs, dtype=bool)
        self.bond_weights = np.zeros(self._n_pairs)

        # Pairs in which a point or a ghost comes second; ghosts are first in none.
        incidence = np.argsort(bonds.second, kind="stable").astype(np.uint32)
        self._incidence = incidence
        self._incidence_pointers = np.zeros(total + 1, dtype=np.uint64)
        self._incidence_pointers[1:] = np.cumsum(np.bincount(bonds.second, minlength=total))
        self._pair_pointers = np.full(total + 1, bonds.pair_pointers[-1])
        self._pair_pointers[: n + 1] = bonds.pair_pointers
        # Bonds of the ghosts, seen from them: the directed bonds that end in one, by image.
        towards = np.flatnonzero(bonds.neighbours >= n)
        self._ghost_bonds = towards[np.argsort(bonds.neighbours[towards], kind="stable")]
        owners = np.repeat(np.arange(n, dtype=np.uint32), np.diff(bonds.pointers).astype(np.int64))
        self._ghost_neighbours = owners[self._ghost_bonds]
        self._ghost_pointers = np.zeros(total - n + 1, dtype=np.uint64)
        self._ghost_pointers[1:] = np.cumsum(np.bincount(bonds.neighbours[towards] - n, minlength=total - n))
        # In the precision of the points' own: another would have `point_forces` compiled a second time.
        self._ghost_weighted_bonds = aligned_rows((len(towards), body.dimension), self.precision)
        self._counted, self.bond_shares = np.zeros(self._n_pairs), np.zeros(len(bonds.neighbours))
        self._weigh_pairs(np.arange(self._n_pairs))
        self._energy = 0.0
        self._stresses = aligned_rows((total, body.dimension**2))
        self._node_parts, self._all_forces = np.zeros((2, total, body.dimension))

    def evaluate(self, positions: np.ndarray, out: np.ndarray) -> None:
        self._kinematics.place(positions)
        self._form()
        outside, invalid, without_force = self.pass_bonds(out)
        self.pairs_outside += sum(outside)
        for watch, found in zip(self._watches, outside, strict=True):
            watch.report(found)
        if invalid or not np.isfinite(self._energy):
            raise InvalidState(self._diagnose())
        if without_force:
            raise InvalidState(locate(self.body, out, "the force on it is not finite"))

    def _form(self) -> None:
        """Bring up to date what the pass over the pairs reads, at the positions last placed."""
        self._kinematics.form_gradients()

    @abstractmethod
    def pass_bonds(self, out: np.ndarray) -> tuple[list[int], int, int]:
        """Pass over the pairs and sums, with the deformation gradients last formed.

        Returns the number of pairs outside the domain of every model, of those turned inside out, and of points without a force.
        """

    def sums_of(
        self, forces: np.ndarray, moments: np.ndarray, others_of: Callable[[np.ndarray], np.ndarray] | None = None
    ) -> Callable[[np.ndarray], int]:
        """What sums forces and moments of the pairs to the body's points, bound to these arrays.

        What falls to a ghost goes to the point behind it.  Called with the array to write to, it returns the number of points and ghosts
        without a force.

        Parameters
        ----------
        forces, moments : ndarray
            Of the pairs.
        others_of : callable, optional
            Called with the moments of the points, it gives forces on them beside these.
        """
        body, bonds, ghosts, kinematics = self.body, self.body.bonds, self.body.ghosts, self._kinematics
        n, d, chunks = len(body), body.dimension, kinematics.chunks
        pairs = self._pair_pointers, self._incidence_pointers, self._incidence
        gather = sum_moments[d].bind(moments, *pairs, self._stresses, chunks=chunks)
        weigh = weigh_moments[d].bind(self._stresses, kinematics.inverse_shape, body.volumes, chunks=chunks)
        common = forces, self._stresses, *pairs
        unit, total = self.unit, self._all_forces if len(ghosts) else np.empty_like(body.points)
        directed = bonds.pointers, bonds.neighbours, kinematics.weighted_bonds, body.volumes
        sums = [point_forces[d].bind(*common, *directed, unit, 0, self._node_parts, total, chunks=chunks)]
        if len(ghosts):
            directed = self._ghost_pointers, self._ghost_neighbours, self._ghost_weighted_bonds, body.all_volumes
            sums.append(point_forces[d].bind(*common, *directed, unit, n, self._node_parts, total, chunks=chunks))
        weigh_and_sum = Chain(weigh, *sums)

        def to_points(out: np.ndarray, on_ghosts: np.ndarray | None = None) -> int:
            gather()
            if on_ghosts is not None:
                on_ghosts[:] = self._stresses[n:]
            kinematics.gradient_ghosts.fold_moments(self._stresses)
            body.share.fill(self._stresses[:n])
            beside = None if others_of is None else others_of(self._stresses[:n])
            if not len(ghosts):
                sums[0].give("out", out)
            _, *without_force = weigh_and_sum()
            if len(ghosts):
                ghosts.fold_forces(total)
                out[:] = total[:n]
            if beside is not None:
                out += beside
            return sum(without_force)

        return to_points

    def moments_to_points(self, moments: np.ndarray, forces: np.ndarray) -> Callable[[], None]:
        """What adds to forces on points and ghosts those of the points' moments, and hands all on to the body's points.

        Parameters
        ----------
        moments : ndarray, shape (n + m, d d)
            Derivatives by the gradients, by columns; spoilt by the call.
        forces : ndarray, shape (n + m, d)
        """
        body, bonds, ghosts, kinematics = self.body, self.body.bonds, self.body.ghosts, self._kinematics
        n, d, chunks = len(body), body.dimension, kinematics.chunks
        directed = bonds.pointers, bonds.neighbours, kinematics.weighted_bonds, body.volumes
        outer = self._ghost_pointers, self._ghost_neighbours, self._ghost_weighted_bonds, body.all_volumes
        passes = [
            weigh_moments[d].bind(moments, kinematics.inverse_shape, body.volumes, chunks=chunks),
            add_node_forces[d].bind(moments, *directed, 0, self._node_parts, forces, chunks=chunks),
        ]
        if len(ghosts):
            passes.append(add_node_forces[d].bind(moments, *outer, len(body), self._node_parts, forces, chunks=chunks))
        weigh_and_add = Chain(*passes)

        def to_points() -> None:
            kinematics.gradient_ghosts.fold_moments(moments)
            body.share.fill(moments[:n])
            weigh_and_add()
            ghosts.fold_forces(forces)

        return to_points

    def pairs_of_points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where the pairs begin of which every point and ghost is the first, then where those of which it is the second, and these."""
        return self._pair_pointers, self._incidence_pointers, self._incidence

    def energy(self) -> float:
        return self.unit * self._energy

    def levers_on_planes(self) -> np.ndarray:
        kinematics, n, d = self._kinematics, len(self.body), self.body.dimension
        moments = np.zeros((len(self.body.ghosts), d * d))
        # The sums again, to the same bits, since those of the ghosts are not kept.
        self._own_sums(np.empty_like(self.body.points), moments)
        forces = self._all_forces[n:]
        if self.body.share.divided:  # images count where the points behind them do
            own = self.body.share.counted(np.ones(n))[self.body.ghosts.source, None]
            forces, moments = forces * own, moments * own
        places = kinematics.positions, matrices(kinematics.gradients)
        return kinematics.gradient_ghosts.levers_on_planes(*places, forces, self.unit * matrices(moments))

    def mean_stress(self) -> np.ndarray:
        # Of the bonds' own stresses: the derivative of the energy by a homogeneous F.
        bonds, points, d = self.body.bonds, self.body.all_points, self.body.dimension
        counted = self.body.share.counted_pairs(bonds.first)
        pairs = slice(self._n_pairs) if counted is None else np.flatnonzero(counted)
        vectors = points[bonds.second[pairs]] - points[bonds.first[pairs]]
        along = self._forces[pairs].astype(float).T @ vectors
        # P (I - n (x) n) is twice the moment.
        across = 2 * self._moments[pairs].sum(axis=0, dtype=float).reshape(d, d).T
        return self.unit * (along + across) / self._whole_volume()

    def pair_forces(self, pairs: np.ndarray | None = None) -> np.ndarray:
        """The pair's own part, and what the two ends' S exert along it.

        Of a pair with a ghost, that includes what the energy of the mirrored pair says about the ghost of this point.
        """
        bonds, body, n = self.body.bonds, self.body, len(self.body)
        chosen = slice(self._n_pairs) if pairs is None else pairs
        first, second = bonds.first[chosen], bonds.second[chosen]
        stresses = self._stresses.copy()
        body.ghosts.fill_changes(stresses)
        stresses = matrices(stresses)
        strength = self._strength[chosen] * self._intact[chosen]
        forces = self._forces[chosen].astype(float)
        outer = np.flatnonzero(second >= n)
        if len(outer):
            numbers, mirrored = self._mirrored_pairs
            partners = mirrored[np.searchsorted(numbers, outer if pairs is None else pairs[outer])]
            forces[outer] -= body.ghosts.parity[second[outer] - n] * self._forces[partners]
        vectors = body.all_points[second] - body.all_points[first]
        forces += strength[:, None] * np.einsum("bij,bj->bi", stresses[first] + stresses[second], vectors)
        return self.unit * forces

    @cached_property
    def _mirrored_pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of a point i and the ghost of a point k, and for each that of k and the ghost of i under the same reflections."""
        bonds, ghosts, n = self.body.bonds, self.body.ghosts, len(self.body)
        outer = np.flatnonzero(bonds.second >= n)
        ghost = bonds.second[outer].astype(np.int64) - n
        number = np.full((int(ghosts.image.max()) + 1, n), -1)
        number[ghosts.image, ghosts.source] = np.arange(len(ghosts))
        partner = ghosts.source[ghost].astype(np.int64), n + number[ghosts.image[ghost], bonds.first[outer]]
        total = n + len(ghosts)
        keys = bonds.first[outer].astype(np.int64) * total + bonds.second[outer]
        order = np.argsort(keys)
        return outer, outer[order[np.searchsorted(keys[order], partner[0] * total + partner[1])]]

    def bond_gradients(self) -> np.ndarray:
        """F_ij of every pair at the positions last given, shape (n_pairs, d, d) (theory (27))."""
        kinematics, bonds, body = self._kinematics, self.body.bonds, self.body
        kinematics.form_gradients()
        vectors = body.all_points[bonds.second] - body.all_points[bonds.first]
        length = np.linalg.norm(vectors, axis=1)[:, None]
        n = vectors / length
        F = matrices(kinematics.gradients[bonds.first] + kinematics.gradients[bonds.second]) / 2
        along = (kinematics.positions[bonds.second] - kinematics.positions[bonds.first]) / length
        return F + (along - np.einsum("bij,bj->bi", F, n))[:, :, None] * n[:, None]

    def bond_columns(self) -> tuple[np.ndarray, np.ndarray]:
        """C = F_ij n and e = F_ij m of every pair in the plane at the positions last given, shape (n_pairs, 2) each."""
        kinematics, bonds, body = self._kinematics, self.body.bonds, self.body
        kinematics.form_gradients()
        vectors = body.all_points[bonds.second] - body.all_points[bonds.first]
        length = np.linalg.norm(vectors, axis=1)[:, None]
        m = np.stack([-vectors[:, 1], vectors[:, 0]], axis=1) / length
        mean = (kinematics.gradients[bonds.first] + kinematics.gradients[bonds.second]).reshape(-1, 2, 2) / 2
        return (kinematics.positions[bonds.second] - kinematics.positions[bonds.first]) / length, np.einsum("bji,bj->bi", mean, m)

    def _weigh_pairs(self, pairs: np.ndarray) -> np.ndarray:
        """Bring shares and weights of bonds up to date after a change at the given pairs.

        They follow from what is intact and which points have a gradient.
        Of a pair with a ghost only the point's share counts.  Returns all pairs whose weights may have changed.
        """
        bonds, body, n = self.body.bonds, self.body, len(self.body)
        supported = self._kinematics.supported.astype(bool)
        # A point without support has no gradient; its bonds carry nothing, and so take no share of the other end's volume either.
        carries = self._intact[pairs] & supported[bonds.first[pairs]] & supported[bonds.second[pairs]]
        self._counted[pairs] = np.where(carries, self._strength[pairs], 0.0)
        ends = np.concatenate([bonds.first[pairs], bonds.second[pairs]])
        touched = np.unique(ends[ends < n])
        starts, counts = bonds.pointers[touched].astype(np.int64), np.diff(bonds.pointers).astype(np.int64)[touched]
        entries = np.repeat(starts - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
        around = np.unique(bonds.pair_of[entries])
        self._share(touched, bonds.pair_of, self._counted)
        if body.share.divided:
            body.share.fill_bonds(self.bond_shares, body)
            around = np.union1d(around, body.share.beside_halo(bonds.first, bonds.second))
        entries, starts = self._kinematics.pair_entries
        one, other = entries[starts[around]], entries[starts[around + 1] - 1]
        self.bond_weights[around] = self.bond_shares[one] + np.where(other != one, self.bond_shares[other], 0.0)
        bond, volumes = self._kinematics.weighted_bonds[self._ghost_bonds], body.all_volumes
        ratio = volumes[self._ghost_neighbours] / volumes[bonds.neighbours[self._ghost_bonds]]
        self._ghost_weighted_bonds[:] = -bond * ratio[:, None]
        return around

    def _share(self, rows: np.ndarray, numbers: np.ndarray, strength: np.ndarray) -> None:
        """Divide the volumes of points among their directed bonds, whose strengths have these numbers."""
        body, bonds = self.body, self.body.bonds
        directed = bonds.pointers, bonds.neighbours, numbers
        bond_shares[body.dimension](rows, *directed, body.all_points, body.volumes, strength, body.horizon, self.bond_shares)

    def _diagnose(self) -> str:
        """Say which bond has no energy, and why."""
        F = self.bond_gradients()
        with np.errstate(invalid="ignore"):  # what is not finite is looked for
            bonds, alive, J = self.body.bonds, self.bond_weights > 0, np.linalg.det(F)
        broken = alive & ~np.isfinite(J)
        if broken.any():
            return at_point(self.body, int(bonds.first[broken.argmax()]), "the deformation gradient of a bond is not finite")
        worst = int(np.where(alive, J, np.inf).argmin())
        if J[worst] <= 0:
            what = f"det F = {J[worst]:.3g} of a bond: the material is turned inside out there"
            return at_point(self.body, int(bonds.first[worst]), what)
        trace = (F * F).sum(axis=(1, 2))
        for pair in np.argsort(np.where(alive, -trace, np.inf))[:100]:
            try:
                for law in self._laws_of(pair):
                    self._check_state(law, F[pair])
            except ValueError as error:
                return at_point(self.body, int(bonds.first[pair]), str(error))
        worst = int(np.where(alive, trace, -np.inf).argmax())
        what = f"one of the bonds has no energy; of the most strained one, tr C = {trace[worst]:.4g} and det F = {J[worst]:.4g}"
        return at_point(self.body, int(bonds.first[worst]), what)

    def _check_state(self, law: Law, F: np.ndarray) -> None:
        """Raise ValueError, which says why, where a law has no energy at the gradient of a bond."""
        if self.plane == "stress":
            trace, J = plane_stress.invariants(F[None])
            BondEnergyForce().energy_derivatives(law, trace, J)
            return
        from ..materials import solid  # of which a sheet under plane stress has no need

        reason = solid.why_no_energy(law, F)
        if reason:
            raise ValueError(f"{law.name}: a bond has no energy: {reason}")

    def _laws_of(self, pair: int) -> list[Law]:
        """Laws that have a part in the energy of a pair."""
        return [self.law]


class BondEnergyEvaluation(EnergyOfPairs):
    """An energy bound to a body: gradient pass, a pass over each pair once, and the sums to points.

    Attributes
    ----------
    model : EnergySurrogate
    outside : str
        What is done about pairs outside its domain, see `ForceSettings`.
    """

    def __init__(self, model: EnergySurrogate, body: Body, law: Law, settings: ForceSettings) -> None:
        super().__init__(body, law, usual_precision(model, settings), "none", settings)
        self.model, self.outside, self.unit = model, settings.outside or OUTSIDE, law.shear_modulus
        self._watches = [DomainWatch(model, self.pairs_evaluated, self.outside, "energy", "energy", body.share)]
        self._prepare()
        self.geometry = pair_geometry(body, slice(None), self.bond_weights, self.geometry_precision)
        self._bind_energies()
        self._own_sums = self.sums_of(self._forces, self._moments)

    def _bind_energies(self) -> None:
        """Bind the pass over the pairs to its arrays."""
        kinematics, arrays = self._kinematics, (*self.body.bonds.ends_in_blocks(BLOCK), self.geometry)
        places = kinematics.positions, kinematics.gradients
        self._pairs = PairEnergies(self.model, self.law, self.precision, self.outside, kinematics, kinematics.response, *places, *arrays)
        self._forces, self._moments = self._pairs.forces, self._pairs.moments

    def pass_bonds(self, out: np.ndarray) -> tuple[list[int], int, int]:
        outside = self._pairs()
        self._energy = self._pairs.energy
        return [outside], self._pairs.invalid, self._own_sums(out)

    def energy_derivatives(self, trace, area_ratio) -> EnergyDerivatives:
        """See `PairEnergies.energy_derivatives`."""
        return self._pairs.energy_derivatives(trace, area_ratio)

    def stress_and_energy(self) -> tuple[np.ndarray, np.ndarray]:
        stress, energy = super().stress_and_energy()
        if self.model.domain is None:
            return stress, energy
        F, unit = self.deformation_gradients(), self.law.shear_modulus
        trace, J = plane_stress.invariants(F)
        found = self.model.energy_derivatives(self.law, trace, J)
        learnt = np.ones(len(F), dtype=bool)
        if self.outside == "fallback":  # where the exact energy begins to take over, it has the word
            learnt = self.domain_deviation() < 0.5 * np.log(1 - BLEND)
        stress[learnt, :2, :2] = unit * plane_stress.in_plane_stress(F, 2 * found.by_trace, J * found.by_area)[learnt]
        energy[learnt] = unit * found.psi[learnt]
        return stress, energy

    def domain_deviation(self) -> np.ndarray | None:
        return None if self.model.domain is None else self.model.domain.deviation(self.principal_stretches())

    @property
    def has_tangent(self) -> bool:
        # Rounding in single precision would be most of what differences of the energy leave; second derivatives are of a sheet's energy.
        return self.precision == "float64" and self.plane == "stress"

    def tangent(self, positions: np.ndarray) -> Tangent:
        from .tangent import Tangent

        return Tangent(self, positions)

    def tangent_pass(self, linearised: np.ndarray) -> Callable[[np.ndarray, np.ndarray], None]:
        """What multiplies the tangent by displacements of the points.

        Parameters
        ----------
        linearised : ndarray, shape (n_blocks, 9, BLOCK)
            See `pdsurrogate.kernels.bond_energy.pair_tangents`.

        Returns
        -------
        callable
            Called with displacements (n, 2), it writes minus the tangent times them to its second argument.
        """
        ghosts, n, chunks = self.body.ghosts, len(self.body), self._kinematics.chunks
        changes, gradients = np.zeros_like(self.positions), np.zeros_like(self._kinematics.gradients)
        forces, moments = np.zeros((linearised.shape[0] * BLOCK, 2)), np.zeros((linearised.shape[0] * BLOCK, 4))
        form, to_points = self._kinematics.gradient_pass(changes, gradients, 0.0), self.sums_of(forces, moments)
        geometry = pair_geometry(self.body, slice(None), self.bond_weights, self.precision)
        pairs = *self.body.bonds.ends_in_blocks(BLOCK), geometry, linearised
        memory = aligned_rows((chunks.threads, bond_energy.BUFFER_ROWS, BLOCK), self.precision), aligned_rows((chunks.threads, 4, BLOCK))
        find = bond_energy.pair_tangents.bind(changes, gradients, *pairs, *memory, forces, moments, chunks=chunks)

        def multiply(displacements: np.ndarray, out: np.ndarray) -> None:
            changes[:n] = displacements
            ghosts.fill_displacements(changes)
            form()
            ghosts.fill_changes(gradients)
            find()
            to_points(out)

        return multiply

    def gradient_weights(self) -> np.ndarray:
        """Weights of the neighbours' positions in the points' F, K^-1 w x V_j of every directed bond, shape (n_bonds, d)."""
        return self._kinematics.gradient_weights()

    def take_out(self, pairs: np.ndarray) -> Release:
        """Of the horizons, the deformation gradients and the sum of energies.

        Returns
        -------
        Release
            What they had held, at the positions last placed; nothing where the body has no finite energy before or after.
        """
        forces, remaining = np.zeros_like(self.body.points), np.zeros_like(self.body.points)
        before = self._energy_at_present(forces)
        self._intact[pairs] = False
        self.renew_weights(self._weigh_pairs(self._kinematics.break_bonds(pairs)))
        energy, forces = before - self._energy_at_present(remaining), forces - remaining
        if self.body.share.any(not (np.isfinite(energy) and np.isfinite(forces).all())):
            return Release(0.0, np.zeros_like(forces))
        return Release(energy, forces)

    def renew_weights(self, pairs: np.ndarray) -> None:
        """Bring up to date what the pass reads of the weights of given pairs."""
        self.geometry[pairs // BLOCK, self.body.dimension + 1, pairs % BLOCK] = self.bond_weights[pairs]
        counted = self.body.share.counted_pairs(self.body.bonds.first[pairs])
        if counted is not None:
            self.geometry[pairs // BLOCK, -1, pairs % BLOCK] = self.bond_weights[pairs] * counted

    def collapsed_pairs(self) -> np.ndarray:
        """Of the pairs that were turned inside out, or pressed below a third of their area or volume."""
        if not self._pairs.collapsed:
            return np.empty(0, dtype=np.int64)
        c, e = self.bond_columns()
        return np.flatnonzero((self.bond_weights > 0) & ~(c[:, 0] * e[:, 1] - c[:, 1] * e[:, 0] > bond_energy.COLLAPSED))

    def _energy_at_present(self, out: np.ndarray) -> float:
        """Energy at the positions last placed, NaN where there is none; forces to `out`."""
        self._kinematics.form_gradients()
        _, invalid, _ = self.pass_bonds(out)
        return np.nan if invalid else self.energy()
