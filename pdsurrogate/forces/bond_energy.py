"""Force models that map the invariants of a bond's deformation gradient to its energy."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping

import numpy as np

from ..kernels.energy_density import analytic_energy_density
from ..materials import PLANES, Law, plane_stress
from .isochoric import IsochoricEnergy
from .pair_energy import PairEnergy
from .pair_passes import EnergyDerivatives
from .protocol import CompiledBondForce, Domain, ForceModel
from .settings import OUTSIDE_POLICIES, PRECISIONS
from .term import Term


class EnergySurrogate(ForceModel):
    """Force model that maps the invariants of a bond's deformation gradient to its energy: a surrogate, or the exact energy.

    Attributes
    ----------
    domain : Domain or None
        Bounds of the principal stretches in training; None if the model is valid everywhere.
    default_precision : str

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> isinstance(pds.load_surrogate("neo-hookean-energy"), pds.forces.EnergySurrogate)
    True
    """

    family = "bond energy"
    several_materials = tuple(PLANES)
    domain: Domain | None
    default_precision: str

    @property
    def honours(self) -> Mapping[str, tuple]:
        # The energy is exact on incomplete horizons, and its invariants do not depend on rotations. The learnt energy is that of a sheet.
        honours = {"precision": PRECISIONS, "correction": ("none",), "breakable": (True,), "plane": ("stress",)}
        return honours | ({} if self.domain is None else {"outside": tuple(OUTSIDE_POLICIES)})

    def terms(self, plane: str) -> tuple[type[Term], ...]:
        return (PairEnergy,)

    @abstractmethod
    def energy_derivatives(self, law: Law, trace, area_ratio) -> EnergyDerivatives:
        """Return energy and derivatives in NumPy, for checks and for the tangent."""

    @abstractmethod
    def compiled(self, dtype) -> CompiledBondForce:
        """Return energy and first derivatives for the pass over the pairs (`pdsurrogate.kernels.energy_density`)."""


class BondEnergyForce(EnergySurrogate):
    """Exact stored energy of any law, from the deformation gradients of the bonds.

    Under plane stress every bond contributes its whole energy, and every evaluation solves for C33. In plane strain and in three
    dimensions the isochoric part is evaluated at the bonds and the volumetric part at the points, which avoids locking
    (`pdsurrogate.forces.volume_energy`).

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> body = pds.Body.rectangle(1.0, 1.0, 0.25, 0.7875)
    >>> force = pds.BondEnergyForce().bind(body, pds.materials.NeoHookean(), pds.ForceSettings(precision="float64"))
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
        # In a selective energy, single precision of the pairs' forces and moments would save only 4 per cent of the time.
        return self.honours if plane == "stress" else {**self.honours, "precision": ("float64",)}

    def isochoric_energy(self, law: Law, plane: str, outside: str, precision: str) -> IsochoricEnergy:
        """Return the isochoric energy of the bonds for plane strain and three dimensions, in double precision and without a domain."""
        return IsochoricEnergy.exact(law, plane)

    def energy_derivatives(self, law: Law, trace, area_ratio) -> EnergyDerivatives:
        return EnergyDerivatives(*plane_stress.energy_derivatives(law, trace, area_ratio))

    def compiled(self, dtype) -> CompiledBondForce:
        """Return the block function of the exact energy, whose law the pass supplies."""
        return CompiledBondForce(analytic_energy_density(dtype).address, np.zeros(1, dtype=np.int64), np.zeros(1, dtype=dtype), 0)
