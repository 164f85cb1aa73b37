"""What the solver asks of a force model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from ..body import Body
from ..kernels.bond_state import LEAST_NORMAL_STRETCH
from ..materials import Law
from .settings import ForceSettings


class OutsideDomain(RuntimeError):
    """Bonds left the domain of a surrogate, and the policy is to stop."""


class OutsideDomainWarning(RuntimeWarning):
    """Bonds left the domain of a surrogate, and it is extrapolated."""


class InvalidState(RuntimeError):
    """A deformation for which the material law has no answer: det F <= 0, a limit passed, or numbers that are not finite."""


@dataclass(frozen=True)
class Domain:
    """Where a surrogate was trained.

    Attributes
    ----------
    least_stretch, greatest_stretch : float
        Bounds of both principal stretches in the plane, of the stretch tensor that (lambda_b, dtheta, J) define (theory (10)).
    least_bulk, greatest_bulk : float
        Bounds of J3^2 = J^2 C33.
    """

    least_stretch: float
    greatest_stretch: float
    least_bulk: float
    greatest_bulk: float

    @property
    def interior(self) -> Domain:
        """The part of the domain in which the surrogate alone counts; between the two its force goes over into the exact one.

        Every bound lies a tenth nearer to rest, on a logarithmic scale.  A domain that rest is no part of has no such band.
        """
        bounds = (self.least_stretch, self.greatest_stretch, self.least_bulk, self.greatest_bulk)
        if not (bounds[0] < 1 < bounds[1] and bounds[2] < 1 < bounds[3]):
            return self
        return Domain(*(bound**0.9 for bound in bounds))

    def limits(self, dtype) -> np.ndarray:
        """Constants of `pdsurrogate.kernels.bond_state.is_outside`."""
        low, high = np.float64(self.least_stretch) ** 2, np.float64(self.greatest_stretch) ** 2
        with np.errstate(divide="ignore"):
            return np.array([low, high, 1 / low, 1 / high, self.least_bulk, self.greatest_bulk, LEAST_NORMAL_STRETCH], dtype=dtype)


EVERYWHERE = Domain(0.0, np.inf, 0.0, np.inf)
"""All states in which a bond has a stretch tensor."""


@dataclass(frozen=True)
class CompiledBondForce:
    """A bond force ready for the bond pass.

    Attributes
    ----------
    address : int
        Of the block function (`pdsurrogate.kernels.compile.bond_force_signature`).
    sizes : ndarray of int64
    weights : ndarray, in the precision of the bond pass
    work_rows : int
        Rows of working memory that it needs, in that precision.
    needs_length : bool
        Whether it reads the last row of its states, l/horizon, which is filled for nobody else.
    """

    address: int
    sizes: np.ndarray
    weights: np.ndarray
    work_rows: int
    needs_length: bool = False


@dataclass(frozen=True)
class Release:
    """What bonds had held when they broke.

    Attributes
    ----------
    energy : float
        Stored energy that the body lost.
    forces : ndarray, shape (n, 2)
        Force that went with it.
    """

    energy: float
    forces: np.ndarray


class InternalForce(Protocol):
    """A force model bound to a body: what a solver calls."""

    body: Body
    law: Law
    evaluations: int

    def __call__(self, positions: np.ndarray, out: np.ndarray) -> None:
        """Internal force on every point per unit thickness at positions (n, 2), written to `out` (n, 2)."""

    def move_plane(self, plane: int, displacement) -> None:
        """Displace a reflection plane of the body."""

    def break_bonds(self, pairs: np.ndarray) -> Release | None:
        """Take pairs out of everything: horizons, corrections and forces.  Needs `ForceSettings.breakable`.

        Says what is released, where the force has an energy.
        """

    def pair_forces(self) -> np.ndarray:
        """Force on the first point of every pair in the state last evaluated, shape (n_pairs, 2)."""

    def state_arrays(self) -> dict[str, np.ndarray]:
        """Arrays of doubles that the next evaluation starts from, beside positions and broken bonds.

        A solution saved with copies of them, and copied back into them, goes on to the same bits.
        """


class ForceModel(Protocol):
    """Any force model: it can be bound to a body.

    Attributes
    ----------
    name : str
    honours : mapping
        The values that it can honour of every field of `ForceSettings` that it has a use for; `bind` refuses others.
    """

    name: str
    honours: Mapping[str, tuple]

    def bind(self, body: Body, law: Law, settings: ForceSettings) -> InternalForce:
        """Prepare the evaluation of this model on a body of a material.

        Raises
        ------
        ValueError
            If the model does not fit the material, or cannot honour a setting.
        """


@runtime_checkable
class ForceSurrogate(Protocol):
    """A force model that maps bond quantities to the force of the bond: a surrogate, or the exact map.

    Attributes
    ----------
    name : str
    features : tuple of str
        What the model sees of a bond.
    domain : Domain or None
        Where it was trained; None if it holds everywhere.
    gives_transverse : bool
        Whether it knows T_mm, which the tensor correction needs.
    default_precision : str
    """

    name: str
    features: tuple[str, ...]
    domain: Domain | None
    gives_transverse: bool
    default_precision: str

    def bond_force(self, stretch, rotation, length, C33, J) -> np.ndarray:
        """Dimensionless bond force, theory (9), in NumPy, for checking.

        Parameters
        ----------
        stretch : array_like, shape (n,)
            lambda_b.
        rotation : array_like, shape (n,)
            dtheta in radians: turn of the bond relative to its horizon, counter-clockwise.
        length : array_like, shape (n,)
            l_b/delta.
        C33 : array_like, shape (n,)
        J : array_like, shape (n,)
            det F in the plane.

        Returns
        -------
        ndarray, shape (n, 2)
            t_n and t_tau, along and across the deformed bond, times kappa/(w l mu).
        """

    def compiled(self, dtype) -> CompiledBondForce:
        """The same for the bond pass, in the given precision."""

    def check_material(self, law: Law) -> None:
        """Raise ValueError if the model does not describe this material."""

    def bind(self, body: Body, law: Law, settings: ForceSettings) -> InternalForce:
        """Prepare the evaluation of this model on a body of a material."""
