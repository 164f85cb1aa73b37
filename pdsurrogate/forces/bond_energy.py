"""Force models that compute the energy of a bond from invariants of its deformation gradient,
exact or learned.
"""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Self

import numpy as np

from ..kernels.energy_density import analytic_energy_density
from ..kernels.isochoric_energy import N_SIZES, OUTSIDE
from ..kernels.selective_energy import RESULT_ROWS, evaluate_isochoric_energy
from ..materials import PLANES, Law, plane_stress
from .compiled_force import CompiledBondForce, by_blocks
from .domain import Domain
from .pair_energy import PairEnergy
from .pair_passes import EnergyDerivatives
from .protocol import ForceModel
from .settings import OUTSIDE_POLICIES, PRECISIONS
from .term import Term


@dataclass(frozen=True)
class IsochoricEnergy:
    """Isochoric energy W of the bonds, exact or learned, in the form that compiled kernels
    evaluate.

    The result at a state is (p, q, r, energy) as in `pdsurrogate.materials.response`.

    Attributes
    ----------
    response : int
        Address of the law's isochoric response (`pdsurrogate.engine.compile.STRESS_RESPONSE`).
    parameters : ndarray
        Parameters of the law.
    address : int
        Address of the compiled function of a learned energy
        (`pdsurrogate.kernels.isochoric_energy`); 0 for the exact energy.
    sizes : ndarray of int64, shape (N_SIZES,)
        Integer constants of a learned energy, and the number of states found outside its domain.
    weights : ndarray
        Floating-point constants of a learned energy.
    precision : {"float32", "float64"}
        Precision of states and results.
    """

    response: int
    parameters: np.ndarray
    address: int = 0
    sizes: np.ndarray = field(default_factory=lambda: np.zeros(N_SIZES, dtype=np.int64))
    weights: np.ndarray = field(default_factory=lambda: np.zeros(1))
    precision: str = "float64"

    @classmethod
    def exact(cls, law: Law, plane: str) -> Self:
        """Return the exact isochoric energy of a law; `plane` is "strain" or "space" (three
        dimensions).
        """
        return cls(PLANES[plane].isochoric_response.block(law).address or 0, law.parameters.copy())

    @property
    def arguments(self) -> tuple:
        """Arguments of kernels that evaluate the energy."""
        return self.address, (self.sizes, self.weights, self.response, self.parameters)

    def count_outside(self) -> int:
        """Return the number of states found outside the domain of a learned energy since the
        last call, and reset it.
        """
        count = int(self.sizes[OUTSIDE])
        self.sizes[OUTSIDE] = 0
        return count

    def evaluate(self, *state) -> np.ndarray:
        """Return (p, q, r, energy), shape (4, n), at n states given as three vectors;
        `count_outside` does not count these states.
        """
        counted = self.sizes.copy()
        found = by_blocks(
            partial(evaluate_isochoric_energy, *self.arguments),
            np.stack(state),
            RESULT_ROWS,
            self.precision,
        )
        self.sizes[:] = counted
        return found


class EnergyModel(ForceModel):
    """Base class of force models whose forces are minus the derivative of the energy of the bonds.

    The planes in `several_materials` are also those that the model accepts for a body of one
    material.

    Attributes
    ----------
    domain : Domain or None
        Bounds of the principal stretches in training; None if the model is valid everywhere.
    """

    family = "bond energy"
    remembers: tuple[str, ...] = ("strain", "space")
    domain: Domain | None

    @property
    def isochoric_weights(self) -> np.ndarray:
        """Floating-point constants of the isochoric energy, shape (k,); a number without effect for
        the exact energy.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.BondEnergyForce().isochoric_weights
        array([0.])
        """
        return np.zeros(1)

    @property
    def honors(self) -> Mapping[str, tuple]:
        # Gradients are balanced on incomplete horizons, and the energy's invariants do not depend
        # on rotations.
        honors = {"precision": PRECISIONS, "breakable": (True,), "plane": self.several_materials}
        return honors | ({} if self.domain is None else {"outside": tuple(OUTSIDE_POLICIES)})

    def terms(self, plane: str) -> tuple[type[Term], ...]:
        return (PairEnergy,)


class EnergySurrogate(EnergyModel):
    """Force model that maps the invariants of a bond's deformation gradient to its energy: a
    surrogate, or the exact energy.

    Attributes
    ----------
    default_precision : str
        Precision of the bond energies and forces under plane stress, unless the settings give one.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> isinstance(pds.load_surrogate("neo-hookean-energy"), pds.forces.EnergySurrogate)
    True
    """

    several_materials: tuple[str, ...] = ("stress",)

    @abstractmethod
    def energy_derivatives(self, law: Law, trace, area_ratio) -> EnergyDerivatives:
        """Return the plane-stress energy with its first and second derivatives by tr C and J in
        NumPy, for checks and for the tangent.

        Parameters
        ----------
        law : Law
        trace : array_like, shape (n,)
            tr C in the plane.
        area_ratio : array_like, shape (n,)
            J, det F in the plane.

        Returns
        -------
        EnergyDerivatives
            Vectors ``psi``, ``by_trace``, ``by_area``, ``by_trace_trace``, ``by_trace_area`` and
            ``by_area_area``, in units of mu.

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> found = pds.BondEnergyForce().energy_derivatives(
        ...     pds.materials.NeoHookean(), np.array([2.0, 2.5]), np.array([1.0, 1.1])
        ... )
        >>> found.psi.round(4).tolist()
        [0.0, 0.1628]
        """

    @abstractmethod
    def compiled(self, dtype) -> CompiledBondForce:
        """Return the energy and its first derivatives as a function compiled for blocks of bonds
        (`pdsurrogate.kernels.energy_density`).

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
        >>> pds.BondEnergyForce().compiled("float64").work_rows
        0
        """


class BondEnergyForce(EnergySurrogate):
    """Exact stored energy of any law, from the deformation gradients of the bonds.

    Under plane stress every bond contributes its whole energy, and every evaluation solves for C33.
    In plane strain and in three dimensions the isochoric part is evaluated at the bonds and the
    volumetric part at the points, which avoids locking (`pdsurrogate.forces.volume_energy`).

    See Also
    --------
    pdsurrogate.AnalyticBondForce : exact bond force, which derives from no energy.
    pdsurrogate.load_surrogate : loads a learned energy.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> body = pds.Body.rectangle(1.0, 1.0, 0.25, 0.7875)
    >>> force = pds.BondEnergyForce().bind(
    ...     body, pds.materials.NeoHookean(), pds.ForceSettings(precision="float64")
    ... )
    >>> force.place(body.points * [1.1, 1.0])
    >>> bool(force.stress_and_energy()[1].min() > 0)
    True
    """

    name = "bond-energy"
    remembers = several_materials = tuple(PLANES)
    domain = None

    def honored(self, plane: str) -> Mapping[str, tuple]:
        # In a selective energy, single precision of the pairs' forces and moments would save only 4
        # percent of the time.
        honors = super().honored(plane)
        return honors if plane == "stress" else {**honors, "precision": ("float64",)}

    def isochoric_energy(
        self, law: Law, plane: str, outside: str, precision: str
    ) -> IsochoricEnergy:
        """Return the exact isochoric energy of the bonds.

        Parameters
        ----------
        law : Law
        plane : {"strain", "space"}
        outside, precision : str
            Without effect: the exact energy has no domain and is in double precision.

        Returns
        -------
        IsochoricEnergy

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.BondEnergyForce().isochoric_energy(
        ...     pds.materials.NeoHookean(), "space", "fallback", "float64"
        ... ).precision
        'float64'
        """
        return IsochoricEnergy.exact(law, plane)

    def energy_derivatives(self, law: Law, trace, area_ratio) -> EnergyDerivatives:
        return EnergyDerivatives(*plane_stress.energy_derivatives(law, trace, area_ratio))

    def compiled(self, dtype) -> CompiledBondForce:
        return CompiledBondForce(
            analytic_energy_density(dtype).address,
            np.zeros(1, dtype=np.int64),
            np.zeros(1, dtype=dtype),
            0,
        )
