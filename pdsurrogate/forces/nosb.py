"""Non-ordinary state-based force model, theory (2), which evaluates the exact law at points and
has zero-energy modes.
"""

from typing import ClassVar

import numpy as np

from ..body.body import lengths_of
from ..engine.block_arrays import aligned_rows
from ..kernels import nosb
from ..materials import PLANES
from .binding import Binding
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
        sums = (
            self._stresses,
            bonds.pointers,
            bonds.neighbors,
            kinematics.starts,
            kinematics.weighted_bonds,
            body.volumes,
        )
        to_points = kinematics.bind(nosb.nosb_forces[d], *sums, np.empty_like(body.points))
        self.bind_steps(*passes, *gather, to_points)

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
        return factor[:, None] * np.einsum(
            "bij,bj->bi", matrices(self._stresses[first] + self._stresses[second]), bond
        )

    def break_bonds(self, pairs: np.ndarray, changed: np.ndarray) -> None:
        self._broken[pairs] = True
        for numbers, shapes in self._shapes:
            shapes[:] = self.kinematics.inverse_shape[numbers]


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
