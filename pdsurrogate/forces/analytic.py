"""The analytic bond force: the exact version of what a network learns, in the same features (theory (7), (11))."""

from __future__ import annotations

import numpy as np

from ..kernels.analytic import analytic_bond_force
from ..kernels.bond_state import along_and_across
from ..materials import Law, NeoHookean, plane_stress
from .bond_force import ForceSurrogate
from .protocol import CompiledBondForce, Domain


class AnalyticBondForce(ForceSurrogate):
    """Exact bond force of a material law.

    Parameters
    ----------
    law : Law, optional
        Used by `bond_force` alone; in a simulation the scene's own law counts.  Neo-Hookean by default.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.AnalyticBondForce()
    >>> model, model.family
    (<AnalyticBondForce analytic>, 'bond force')
    """

    name = "analytic"
    features = ("stretch", "rotation", "length", "C33", "J")
    domain: Domain | None = None
    gives_transverse = True
    default_precision = "float64"

    def __init__(self, law: Law | None = None) -> None:
        self.law = law or NeoHookean()

    def bond_force(self, stretch, rotation, length, C33, J) -> np.ndarray:
        """Dimensionless (t_n, t_tau) of theory (9); see `ForceSurrogate.bond_force`."""
        stretch, rotation, _, C33, J = bond_arrays(stretch, rotation, length, C33, J)
        a, b = stretch * np.cos(rotation), stretch * np.sin(rotation)
        T_nn, T_nm, _ = plane_stress.bond_traction(self.law, a, b, J, C33)
        return along_and_across(T_nn, T_nm, a, b, stretch)

    def compiled(self, dtype) -> CompiledBondForce:
        """Block function of the exact bond force, whose law the bond pass supplies."""
        none = np.zeros(1, dtype=np.int64), np.zeros(1, dtype=dtype)
        return CompiledBondForce(analytic_bond_force(dtype).address, *none, 0, asks_law=True)


def bond_arrays(stretch, rotation, length, C33, J) -> list[np.ndarray]:
    """The five bond quantities as equally long vectors of doubles.

    Raises
    ------
    ValueError
        If they do not broadcast to one vector, are not finite, or a stretch, C33 or J is not positive.
    """
    arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(value, dtype=float)) for value in (stretch, rotation, length, C33, J)))
    if arrays[0].ndim != 1:
        raise ValueError(f"bond quantities must be vectors, not of shape {arrays[0].shape}")
    for name, array in zip(("stretch", "rotation", "length", "C33", "J"), arrays, strict=True):
        if not np.isfinite(array).all():
            raise ValueError(f"{name} has a value that is not finite")
        if name in ("stretch", "C33", "J") and not (array > 0).all():
            raise ValueError(f"{name} must be positive; the least given is {array.min():g}")
    return arrays
