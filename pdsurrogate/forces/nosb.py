"""Non-ordinary state-based force model, theory (2), which evaluates the exact law at points and
has zero-energy modes.
"""

from typing import ClassVar

import numpy as np

from ..body.body import lengths_of
from ..body.ghosts import symmetric
from ..engine.block_arrays import aligned_rows
from ..kernels import nosb
from ..kernels.ghosts import fill_matrices, fold_vectors
from ..materials import PLANES
from .balanced import balanced_changes
from .binding import Binding
from .changed_weights import ChangedWeights
from .errors import at_point, why_invalid
from .kinematics import matrices
from .material_points import rows_of_each
from .protocol import ForceModel
from .term import MaterialTerm, Term


class PointStress(MaterialTerm):
    """Internal force of the non-ordinary state-based model, from the stresses of the points by
    the laws of their materials.
    """

    zero_energy_modes = True

    def __init__(self, binding: Binding) -> None:
        super().__init__(binding)
        kinematics = self.kinematics
        body = self.body
        bonds = body.bonds
        d = body.dimension
        # Without loads on the boundary the model stays as it was published. Those of several terms
        # may need different changes.
        alone = len(binding.portions[0].model.terms(kinematics.plane)) == 1
        changes = balanced_changes(binding) if body.loaded and alone else None
        self._stresses = aligned_rows((len(body.all_points), d * d))
        passes = []
        self._broken = np.zeros(len(bonds.first), dtype=bool)
        self._shapes = []
        materials = [self.points_of(number) for number in range(len(binding.portions))]
        # P K^-1 of points and images.
        of_each, gather = rows_of_each(kinematics, materials, self._stresses)
        for points, stresses in zip(materials, of_each, strict=True):
            shapes = kinematics.inverse_shape[points.numbers]
            self._shapes.append((points.numbers, shapes))
            state = points.gradients, points.volume_ratios, shapes
            law = (
                points.law.shear_modulus,
                points.response.address,
                points.parameters,
                kinematics.scratch,
            )
            passes.append(kinematics.bind(nosb.weighted_stresses[d], *state, *law, stresses))
        self.in_units = list(enumerate(passes))
        ghosts = body.ghosts
        if len(ghosts):
            # Those with which forces are minus the derivative of the energy of the points: stresses
            # at the gradients of images would make clamps a source of energy.
            continued = *ghosts.of_gradients, 0.0, np.zeros((len(ghosts), d * d))
            gather = [*gather, kinematics.bind(fill_matrices, self._stresses, *continued)]
        self._pulls = None
        pulls = np.zeros((0, d))
        pull = []
        if changes is not None:
            numbers, vectors, _ = changes
            kinematics.change_weights(*changes)
            levers = self._levers(numbers, vectors)
            self._pulls = ChangedWeights(body, kinematics.chunks, numbers, levers)
            pulls = np.zeros((len(body.all_points), d))
            pull = [
                *self._pulls.pull_steps(self._stresses, pulls, add=False),
                kinematics.bind(fold_vectors, pulls, ghosts.source, ghosts.parity),
            ]
        sums = (
            self._stresses,
            bonds.pointers,
            bonds.neighbors,
            kinematics.starts,
            kinematics.weighted_bonds,
            body.volumes,
            pulls,
        )
        to_points = kinematics.bind(nosb.nosb_forces[d], *sums, np.empty_like(body.points))
        self.bind_steps(*passes, *gather, *pull, to_points)

    def _levers(self, numbers: np.ndarray, changes: np.ndarray) -> np.ndarray:
        """Return V K c of bonds with changed weights, (k, d): P K^-1 of the first point of a bond
        times this is the derivative of the energy by its end.
        """
        points, places = np.unique(self.body.bond_owners[numbers], return_inverse=True)
        inverse = symmetric(self.kinematics.inverse_shape[points])
        # A point without a gradient has no stress, and no changes.
        inverse[self.kinematics.supported[points] == 0] = np.eye(self.body.dimension)
        shapes = self.body.volumes[points, None, None] * np.linalg.inv(inverse)
        return np.einsum("bij,bj->bi", shapes[places], changes)

    def diagnose(self, out: np.ndarray) -> str:
        F = self.kinematics.deformation_gradients()
        owners = self.binding.portion_of
        portions = self.binding.portions
        i, reason = why_invalid(
            F,
            "",
            self.kinematics.plane,
            lambda i: [portions[0 if owners is None else owners[i]].law],
        )
        return at_point(self.body, i, f"it has no stress: {reason}")

    def pair_forces(self, pairs: np.ndarray) -> np.ndarray:
        bonds = self.body.bonds
        body = self.body
        first = bonds.first[pairs]
        second = bonds.second[pairs]
        bond = body.all_points[second] - body.all_points[first]
        factor = body.weigh(lengths_of(bond)) * body.all_volumes[first] * body.all_volumes[second]
        factor[self._broken[pairs]] = 0
        forces = factor[:, None] * np.einsum(
            "bij,bj->bi", matrices(self._stresses[first] + self._stresses[second]), bond
        )
        if self._pulls is not None:
            each = self._pulls
            pulls = np.einsum("bij,bj->bi", matrices(self._stresses[each.owners]), each.changes)
            forces += self.kinematics.of_pairs(each.numbers, each.owners, pulls)[pairs]
        return forces

    def break_bonds(self, pairs: np.ndarray, changed: np.ndarray) -> None:
        self._broken[pairs] = True
        for numbers, shapes in self._shapes:
            shapes[:] = self.kinematics.inverse_shape[numbers]
        balance = self.kinematics.balance
        if self._pulls is not None and balance is not None:
            self._pulls.put(self._levers(balance.numbers, balance.changes))


class NOSBForce(ForceModel):
    """Force model NOSB (non-ordinary state-based peridynamics), exact in homogeneous states.

    A point i contributes w P_i K_i^-1 x to the force of a bond, with the weight w and the vector x
    of the undeformed bond, the first Piola-Kirchhoff stress P_i and the shape tensor K_i. The model
    does not resist zero-energy modes, which leave the deformation gradients of the points
    unchanged.

    See Also
    --------
    pdsurrogate.forces.BANOSBForce : stabilized by bond-associated deformation gradients.
    pdsurrogate.BondEnergyForce : has no zero-energy modes.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.forces.NOSBForce()
    >>> model, model.family
    (<NOSBForce nosb>, 'nosb')
    """

    name = family = "nosb"
    # K^-1 needs no correction of incomplete horizons, and P no rotation.
    honors: ClassVar = {
        "precision": ("float64",),
        "correction": ("none",),
        "breakable": (True,),
        "plane": tuple(PLANES),
    }
    several_materials = ("stress",)
    # bonds to images beyond a curve are not mirrored exactly, which excites its zero-energy modes
    mirrors_curves = False

    def terms(self, plane: str) -> tuple[type[Term], ...]:
        return (PointStress,)
