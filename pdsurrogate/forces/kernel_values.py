"""Values of a model's compiled block function at vectors of bonds, for checks."""

import numpy as np

from ..engine.block_arrays import TRACTION_ROWS
from ..kernels.bond_force import lateral_stretch
from ..kernels.energy_density import ENERGY_ROWS
from ..materials import Law, plane_stress
from .bond_energy import EnergySurrogate
from .bond_force import ForceSurrogate, bond_arrays


def kernel_tractions(model: ForceSurrogate, law: Law, dtype, stretch, rotation, length, C33, J) -> np.ndarray:
    """Return T_nn, T_nm and T_mm (theory (11)) as the bond pass finds them, shape (n, 3), in double.

    Parameters
    ----------
    model : ForceSurrogate
    law : Law
        Law behind models that are computed from it.
    dtype : float32 or float64
        Precision of the bond pass.
    stretch, rotation, length, C33, J : array_like, shape (n,)
        As for `ForceSurrogate.bond_force`.
    """
    stretch, rotation, length, C33, J = bond_arrays(stretch, rotation, length, C33, J)
    a, b = stretch * np.cos(rotation), stretch * np.sin(rotation)
    return _evaluate(model, law, dtype, (a, b, lateral_stretch(a, b, J), J, C33, length), TRACTION_ROWS).T


def kernel_bond_force(model: ForceSurrogate, law: Law, dtype):
    """Return a function like `ForceSurrogate.bond_force` that evaluates the model's block function in the given precision."""

    def bond_force(stretch, rotation, length, C33, J) -> np.ndarray:
        T_nn, T_nm, _ = kernel_tractions(model, law, dtype, stretch, rotation, length, C33, J).T
        cos, sin = np.cos(rotation), np.sin(rotation)
        return np.stack([T_nn * cos + T_nm * sin, T_nm * cos - T_nn * sin], axis=1)

    return bond_force


def kernel_energy(model: EnergySurrogate, law: Law, dtype, trace, area_ratio) -> np.ndarray:
    """Return an energy and its derivatives by tr C and J as the pass over the pairs finds them, shape (3, n), in double.

    Parameters
    ----------
    model : EnergySurrogate
    law : Law
        Law behind models that are computed from it.
    dtype : float32 or float64
        Precision of the pass.
    trace, area_ratio : array_like, shape (n,)
    """
    return _evaluate(model, law, dtype, (trace, area_ratio), ENERGY_ROWS)


def _evaluate(model: ForceSurrogate | EnergySurrogate, law: Law, dtype, states: tuple, n_rows: int) -> np.ndarray:
    """Return the result of a model's block function at states of n numbers each, shape (n_rows, n)."""
    response = plane_stress.response.block(law).address
    return model.compiled(dtype).evaluate(np.stack(states).astype(float), n_rows, response, law.parameters)
