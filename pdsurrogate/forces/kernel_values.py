"""The kernel face of a bond-force model, called from Python on vectors of bonds: for checking, not for speed."""

from __future__ import annotations

import numpy as np

from ..engine.block_arrays import BLOCK, SCRATCH_ROWS, TRACTION_ROWS
from ..engine.compile import call_block, kernel
from ..kernels.bond_state import lateral_stretch
from ..kernels.energy_density import ENERGY_ROWS
from ..materials import Law, plane_stress
from .analytic import bond_arrays
from .bond_energy import EnergySurrogate
from .bond_force import ForceSurrogate


def kernel_tractions(model: ForceSurrogate, law: Law, dtype, stretch, rotation, length, C33, J) -> np.ndarray:
    """T_nn, T_nm and T_mm (theory (11)) as the bond pass gets them, shape (n, 3), in double.

    Parameters
    ----------
    model : ForceSurrogate
    law : Law
        Behind models that are computed from it.
    dtype : float32 or float64
        Precision of the bond pass.
    stretch, rotation, length, C33, J : array_like, shape (n,)
        As for `ForceSurrogate.bond_force`.
    """
    stretch, rotation, length, C33, J = bond_arrays(stretch, rotation, length, C33, J)
    a, b = stretch * np.cos(rotation), stretch * np.sin(rotation)
    full = np.stack([a, b, lateral_stretch(a, b, J), J, C33, length])
    at_rest = np.array([1.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    return _by_blocks(model, law, dtype, full, at_rest, TRACTION_ROWS).T


def kernel_bond_force(model: ForceSurrogate, law: Law, dtype):
    """A function like `ForceSurrogate.bond_force` that evaluates the model's kernel in the given precision."""

    def bond_force(stretch, rotation, length, C33, J) -> np.ndarray:
        stretch, rotation, length, C33, J = bond_arrays(stretch, rotation, length, C33, J)
        T_nn, T_nm, _ = kernel_tractions(model, law, dtype, stretch, rotation, length, C33, J).T
        cos, sin = np.cos(rotation), np.sin(rotation)
        return np.stack([T_nn * cos + T_nm * sin, T_nm * cos - T_nn * sin], axis=1)

    return bond_force


@kernel
def _call(bond_force, states, sizes, weights, response, parameters, work, scratch, traction):
    call_block(bond_force, states, sizes, weights, response, parameters, work, scratch, traction)


def kernel_energy(model: EnergySurrogate, law: Law, dtype, trace, area_ratio) -> np.ndarray:
    """Energy and its derivatives by tr C and J as the pass over the pairs gets them, shape (3, n), in double.

    Parameters
    ----------
    model : EnergySurrogate
    law : Law
        Behind models that are computed from it.
    dtype : float32 or float64
        Precision of the pass.
    trace, area_ratio : array_like, shape (n,)
    """
    full = np.stack([np.asarray(trace, dtype=float), np.asarray(area_ratio, dtype=float)])
    return _by_blocks(model, law, dtype, full, np.array([2.0, 1.0]), ENERGY_ROWS)


def _by_blocks(model: ForceSurrogate | EnergySurrogate, law: Law, dtype, full: np.ndarray, at_rest: np.ndarray, n_rows: int) -> np.ndarray:
    """Result rows (n_rows, n) of a model's block function for states (rows, n); the rest of the last block is `at_rest`."""
    compiled = model.compiled(dtype)
    work = np.zeros((max(1, compiled.work_rows), BLOCK), dtype=dtype)
    constants = compiled.sizes, compiled.weights, plane_stress.response.block(law).address, law.parameters
    results = np.empty((n_rows, full.shape[1]))
    for at in range(0, full.shape[1], BLOCK):
        size = min(BLOCK, full.shape[1] - at)
        states, result = np.empty((len(full), BLOCK), dtype=dtype), np.zeros((n_rows, BLOCK), dtype=dtype)
        states[:] = at_rest[:, None]
        states[:, :size] = full[:, at : at + size]
        _call(compiled.address, states, *constants, work, np.zeros((SCRATCH_ROWS, BLOCK)), result)
        results[:, at : at + size] = result[:, :size]
    return results
