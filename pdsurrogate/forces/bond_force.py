"""Force models that map quantities of a bond to its force (learned or exact), and the force term
that evaluates such models.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np

from ..body.alike import pair_strength
from ..body.ghosts import symmetric
from ..engine.passes import BoundPass
from ..kernels import bond_force, reference_state
from ..kernels.bond_force import along_and_across
from ..materials import SHEETS, Law, NeoHookean, plane_stress
from ..materials.states import principal_stretches
from .binding import Binding, MaterialPart
from .compiled_force import CompiledBondForce
from .domain import Domain
from .errors import at_point
from .material_points import pair_sums
from .pair_balance import balanced_changes
from .pair_forces import PairForces
from .protocol import ForceModel
from .settings import OUTSIDE_POLICIES, PRECISIONS, ROTATIONS
from .term import MaterialTerm, OutsideCounter, Term


class BondForces(MaterialTerm):
    """Internal force that sums the forces of bonds, each a function of the states of the bond's two
    ends, theory (55).

    A pair within one material carries its bond force. A pair across an interface carries the mean
    of two bond forces, one from the model and law of each material, each evaluated with the states
    of both ends, so that the forces on the two ends are opposite.
    """

    def __init__(self, binding: Binding) -> None:
        super().__init__(binding)
        body = self.body
        bonds = body.bonds
        models = cast("list[ForceSurrogate]", [portion.model for portion in binding.portions])
        self.correction = binding.settings.correction or (
            "tensor" if all(model.gives_transverse for model in models) else "scalar"
        )
        # The halves of their forces that pairs have lost: both if broken, one across an interface.
        self._lost_halves = np.zeros(len(bonds.first), dtype=np.uint8)
        self.parts = []
        if binding.portion_of is not None:
            of_ends = binding.portion_of[np.stack([bonds.first, bonds.second])]
            self._lost_halves[of_ends[0] != of_ends[1]] = 1
        for number, model in enumerate(models):
            points = self.points_of(
                number, None if binding.whole else np.flatnonzero((of_ends == number).any(axis=0))
            )
            self.parts.append(PairForces(binding, model, points, self._strength, self.correction))
        # Changes that balance pairs, and the first moments that points have lost of them with
        # broken bonds.
        self._changes = (np.empty(0, dtype=np.int64), np.empty((0, 2)))
        self._lost = np.zeros((len(body.all_points), 2, 2))
        if self.correction == "tensor" and body.outward is not None:
            vectors = self.parts[0].reference_vectors()[: len(bonds.first)]
            if not binding.whole:
                vectors = np.zeros((len(bonds.first), 2), dtype=binding.precision)
                for part in self.parts:
                    of_body = vectors[part.points.pairs]
                    vectors[part.points.pairs] = of_body + part.reference_vectors()[: len(of_body)]
            pairs, changes = balanced_changes(body, vectors)
            self._changes = pairs, changes * (1 - self._lost_halves[pairs, None] / 2)
            for part in self.parts:
                part.separate(part.points.places_of_pairs(pairs)[0])
            self._change(pairs)
        for part in self.parts:
            if isinstance(part.find, BoundPass):
                outside = OutsideCounter(binding, part.model, part.points, "force", "bond force")
                self.watches.append(outside)
        self.learned_thickness = any(part.learns_thickness for part in self.parts)
        self._model = models[0]
        self._domain = models[0].domain if binding.whole else None
        out = np.empty_like(body.points)
        sums = pair_sums(self.kinematics, self.parts, out)
        self.in_units = list(enumerate(sums[: len(models)]))
        self.bind_steps(*(part.find for part in self.parts), *sums)

    def set_parameters(self, portions: Sequence[MaterialPart]) -> None:
        super().set_parameters(portions)
        self._model = cast("ForceSurrogate", portions[0].model)
        for part, portion in zip(self.parts, portions, strict=True):
            part.set_parameters(portion.model)

    def diagnose(self, out: np.ndarray) -> str:
        body = self.body
        broken = np.flatnonzero(
            ~np.isfinite(self.pair_forces(np.arange(len(body.bonds.first)))).all(axis=1)
        )
        if len(broken) == 0:
            return super().diagnose(out)
        i = int(body.bonds.first[broken[0]])
        j = int(body.bonds.second[broken[0]])
        positions = self.kinematics.positions
        points = body.all_points
        stretch = np.linalg.norm(positions[j] - positions[i]) / np.linalg.norm(
            points[j] - points[i]
        )
        x1, x2 = points[j]
        law = max(
            (portion.law for portion in self.binding.portions), key=lambda law: law.shear_modulus
        )
        what = (
            f"its bond to ({x1:.4g}, {x2:.4g}), stretched {stretch:.3g} times, has no finite force"
        )
        return at_point(body, i, f"{what}: that is beyond the limit of {law.name}")

    def _strength(self, pairs: np.ndarray) -> np.ndarray:
        """Return `pair_strength` of some `pairs`, times the halves of their forces that they
        have.
        """
        return pair_strength(self.body, pairs) * (1 - self._lost_halves[pairs] / 2)

    def _change(self, pairs: np.ndarray) -> None:
        """Add the changes that balance the body to the reference vectors of some `pairs`, in
        ascending order, as computed without them.
        """
        changes = np.zeros((len(pairs), 2))
        changed, of_changed = self._changes
        _, here, there = np.intersect1d(pairs, changed, assume_unique=True, return_indices=True)
        changes[here] = of_changed[there]
        if self._lost.any():
            body = self.body
            ends = (self.body.bonds.first[pairs], self.body.bonds.second[pairs])
            vectors = body.all_points[ends[1]] - body.all_points[ends[0]]
            for end in ends:
                restored = self._lost[end] @ symmetric(self.kinematics.inverse_shape[end])
                changes += (self._strength(pairs) / body.all_volumes[end])[:, None] * np.einsum(
                    "bij,bj->bi", restored, vectors
                )
        for part in self.parts:
            places, chosen = part.points.places_of_pairs(pairs)
            part.add(places, changes[chosen])

    def break_bonds(self, pairs: np.ndarray, changed: np.ndarray) -> None:
        self._lost_halves[pairs] = 2
        body = self.body
        bonds = body.bonds
        numbers, changes = self._changes
        broken = np.isin(numbers, pairs)
        gone = numbers[broken]
        if body.share.any(len(gone)):
            vectors = body.all_points[bonds.second[gone]] - body.all_points[bonds.first[gone]]
            for end in (bonds.first[gone], bonds.second[gone]):
                np.add.at(self._lost, end, changes[broken][:, :, None] * vectors[:, None] / 2)
            self._changes = numbers[~broken], changes[~broken]
            body.ghosts.fill(self._lost)
            self._lost[len(body) :] *= (
                body.ghosts.reflection[:, :, None] * body.ghosts.reflection[:, None]
            )
        for part in self.parts:
            places, chosen = part.points.places_of_pairs(changed)
            part.find_geometry(changed[chosen], places, self._strength, self.correction)
        self._change(changed)

    def pair_forces(self, pairs: np.ndarray) -> np.ndarray:
        found = np.zeros((len(pairs), 2))
        for part in self.parts:
            places, chosen = part.points.places_of_pairs(pairs)
            found[chosen] += part.unit * part.forces[places].astype(float)
        return found

    def domain_deviation(self) -> np.ndarray | None:
        if self._domain is None:
            return None
        return self._domain.deviation(
            principal_stretches(self.kinematics.deformation_gradients()), self.volume_ratios() ** 2
        )

    def beyond_data(self) -> np.ndarray | None:
        if self._domain is None or self._domain.hull is None:
            return None
        pairs, states, _ = self.parts[0].states()
        counted = self.body.share.own[self.body.bonds.first[pairs]]
        # A bond turned past a right angle has no stretch tensor and is omitted.
        chosen = states.has_stretch_tensor & counted
        return self._domain.beyond_data(states.stretches[chosen])


class ForceSurrogate(ForceModel):
    """Base class of force models that map quantities of a bond to its force: surrogates, or the
    exact map.

    Attributes
    ----------
    features : tuple of str
        Quantities of a bond that the model depends on; by default all.
    domain : Domain or None
        States on which the model was trained; None if it is valid everywhere.
    gives_transverse : bool
        Whether the model provides the stress component T_mm across a bond, which the tensor
        correction of incomplete horizons needs.
    default_precision : str
        Precision of the bond forces under plane stress, unless the settings give one.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.load_surrogate("neo-hookean@1")
    >>> isinstance(model, pds.forces.ForceSurrogate)
    True
    """

    family = "bond force"
    several_materials: tuple[str, ...] = ("stress",)
    features: tuple[str, ...] = ("stretch", "rotation", "length", "C33", "J")
    domain: Domain | None
    gives_transverse: bool = True

    @property
    def honors(self) -> Mapping[str, tuple]:
        corrections = tuple(
            name
            for name in reference_state.CORRECTIONS
            if self.gives_transverse or name != "tensor"
        )
        # The pressure of plane strain is the trace of the stress, of which T_mm is a part.
        planes = SHEETS if self.gives_transverse else ("stress",)
        honors = {
            "precision": PRECISIONS,
            "correction": corrections,
            "rotation": tuple(ROTATIONS),
            "breakable": (True,),
            "plane": planes,
        }
        return honors | ({} if self.domain is None else {"outside": tuple(OUTSIDE_POLICIES)})

    def terms(self, plane: str) -> tuple[type[Term], ...]:
        return (BondForces,)

    @abstractmethod
    def bond_force(self, stretch, rotation, length, C33, J) -> np.ndarray:
        """Return the dimensionless bond force, theory (9), in NumPy.

        Parameters
        ----------
        stretch : array_like, shape (n,)
            Stretch lambda_b of the bond.
        rotation : array_like, shape (n,)
            Rotation dtheta of the bond relative to the material around it (its horizon), in
            radians, counter-clockwise.
        length : array_like, shape (n,)
            Undeformed length of the bond divided by the horizon.
        C33 : array_like, shape (n,)
            Squared thickness stretch.
        J : array_like, shape (n,)
            det F in the plane.

        Returns
        -------
        ndarray, shape (n, 2)
            Components t_n and t_tau along and across the deformed bond, in units of w l mu/kappa,
            with the weight w and length l of the bond, the shear modulus mu, and the shape tensor
            kappa I of a full horizon.

        Raises
        ------
        ValueError
            If the arguments do not broadcast to one vector, are not finite, or a stretch, C33 or J
            is not positive.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.AnalyticBondForce().bond_force(
        ...     stretch=[1.0, 1.2], rotation=0.0, length=1.0, C33=[1.0, 0.8], J=[1.0, 1.1]
        ... ).round(4).tolist()
        [[0.0, 0.0], [0.5391, 0.0]]
        """

    @abstractmethod
    def compiled(self, dtype) -> CompiledBondForce:
        """Return `bond_force` as a function compiled for blocks of bonds of fixed size.

        Parameters
        ----------
        dtype : dtype
            Precision, float32 or float64.

        Returns
        -------
        CompiledBondForce

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.AnalyticBondForce().compiled("float64").asks_law
        True
        """


class AnalyticBondForce(ForceSurrogate):
    """Exact bond force of a material law, as a function of the features that surrogates use (theory
    (7), (11)).

    Parameters
    ----------
    law : Law, optional
        Law that `bond_force` evaluates, by default neo-Hookean. A simulation uses the law of its
        scene instead.

    See Also
    --------
    pdsurrogate.BondEnergyForce : exact energy of any law.
    pdsurrogate.load_surrogate : loads a learned bond force, which is faster for expensive laws.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.AnalyticBondForce()
    >>> model, model.family
    (<AnalyticBondForce analytic>, 'bond force')
    """

    name = "analytic"
    domain = None

    def __init__(self, law: Law | None = None) -> None:
        self.law = law or NeoHookean()

    def bond_force(self, stretch, rotation, length, C33, J) -> np.ndarray:
        stretch, rotation, _, C33, J = bond_arrays(stretch, rotation, length, C33, J)
        return exact_bond_force(self.law, stretch, rotation, C33, J)

    def compiled(self, dtype) -> CompiledBondForce:
        none = np.zeros(1, dtype=np.int64), np.zeros(1, dtype=dtype)
        return CompiledBondForce(
            bond_force.analytic_bond_force(dtype).address, *none, 0, asks_law=True
        )


def exact_bond_force(law: Law, stretch, rotation, C33, J) -> np.ndarray:
    """Return the exact bond force of a law, shape (n, 2), for arguments as in
    `ForceSurrogate.bond_force`.
    """
    a = stretch * np.cos(rotation)
    b = stretch * np.sin(rotation)
    T_nn, T_nm, _ = plane_stress.bond_traction(law, a, b, J, C33)
    return along_and_across(T_nn, T_nm, a, b, stretch)


def bond_arrays(stretch, rotation, length, C33, J) -> tuple[np.ndarray, ...]:
    """Check the five bond quantities, and return them as vectors of doubles of one length.

    Raises
    ------
    ValueError
        If they do not broadcast to one vector, are not finite, or a stretch, C33 or J is not
        positive.
    """
    arrays = np.broadcast_arrays(
        *(
            np.atleast_1d(np.asarray(value, dtype=float))
            for value in (stretch, rotation, length, C33, J)
        )
    )
    if arrays[0].ndim != 1:
        raise ValueError(f"bond quantities must be vectors, not of shape {arrays[0].shape}")
    for name, array in zip(ForceSurrogate.features, arrays, strict=True):
        if not np.isfinite(array).all():
            raise ValueError(f"{name} has a value that is not finite")
        if name in ("stretch", "C33", "J") and not (array > 0).all():
            raise ValueError(f"{name} must be positive; the least given is {array.min():g}")
    return arrays
