"""Evaluation of a model's compiled function (which simulations use) at given bonds, for checks
against NumPy.
"""

import numpy as np

from ..engine.block_arrays import TRACTION_ROWS
from ..kernels.bond_force import lateral_stretch
from ..kernels.energy_density import ENERGY_ROWS
from ..materials import Law, plane_stress
from .bond_energy import EnergySurrogate
from .bond_force import ForceSurrogate, bond_arrays


def kernel_tractions(
    model: ForceSurrogate, law: Law, dtype, stretch, rotation, length, C33, J
) -> np.ndarray:
    """Return the stress components T_nn, T_nm and T_mm of bonds (theory (11)) from a model's
    compiled function, shape (n, 3), in double.

    The axes n and m lie along and across the undeformed bond, turned with the material around it.

    Parameters
    ----------
    model : ForceSurrogate
    law : Law
        Law that exact models evaluate.
    dtype : float32 or float64
        Precision of the compiled function.
    stretch, rotation, length, C33, J : array_like, shape (n,)
        As for `ForceSurrogate.bond_force`.
    """
    stretch, rotation, length, C33, J = bond_arrays(stretch, rotation, length, C33, J)
    a = stretch * np.cos(rotation)
    b = stretch * np.sin(rotation)
    return _evaluate(
        model, law, dtype, (a, b, lateral_stretch(a, b, J), J, C33, length), TRACTION_ROWS
    ).T


def kernel_bond_force(model: ForceSurrogate, law: Law, dtype):
    """Return a function with the arguments and result of `ForceSurrogate.bond_force` that
    evaluates the model's compiled function.
    """

    def bond_force(stretch, rotation, length, C33, J) -> np.ndarray:
        T_nn, T_nm, _ = kernel_tractions(model, law, dtype, stretch, rotation, length, C33, J).T
        cos = np.cos(rotation)
        sin = np.sin(rotation)
        return np.stack([T_nn * cos + T_nm * sin, T_nm * cos - T_nn * sin], axis=1)

    return bond_force


def kernel_energy(model: EnergySurrogate, law: Law, dtype, trace, area_ratio) -> np.ndarray:
    """Return the energy and its derivatives by tr C and J from a model's compiled function, shape
    (3, n), converted to double.

    Parameters
    ----------
    model : EnergySurrogate
    law : Law
        Law that exact models evaluate.
    dtype : float32 or float64
        Precision of the compiled function.
    trace, area_ratio : array_like, shape (n,)
        tr C, and J = det F in the plane.
    """
    return _evaluate(model, law, dtype, (trace, area_ratio), ENERGY_ROWS)


def _evaluate(
    model: ForceSurrogate | EnergySurrogate, law: Law, dtype, states: tuple, n_rows: int
) -> np.ndarray:
    """Return the result of a model's compiled function, shape (n_rows, n), at `states`, a tuple
    of vectors of length n.
    """
    response = plane_stress.response.block(law).address
    return model.compiled(dtype).evaluate(
        np.stack(states).astype(float), n_rows, response, law.parameters
    )
