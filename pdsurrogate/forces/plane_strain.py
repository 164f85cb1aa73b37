"""Bond forces that were learnt under plane stress, in plane strain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..kernels.plane_strain import plane_strain_bond_force
from ..materials import Law, plane_stress
from .protocol import CompiledBondForce


def in_plane_strain(compiled: CompiledBondForce, law: Law, dtype) -> CompiledBondForce:
    """A bond force of a thickness without stress with the pressure that a held one has (theory (42)).

    Only the derivative of U is asked of the law, so that a dear one is not asked in plane strain either.

    Parameters
    ----------
    compiled : CompiledBondForce
        Of a model that knows T_mm.
    law : Law
    dtype : float32 or float64
        Of the bond pass.
    """
    addresses = [compiled.address, plane_stress.volumetric_block(law).address]
    return replace(compiled, address=plane_strain_bond_force(dtype).address, sizes=np.concatenate([addresses, compiled.sizes]))
