"""The plane-stress condition solved with the learnt bond force, for laws that cost more than it."""

from __future__ import annotations

import numpy as np

from ..engine.block_arrays import BLOCK, aligned_rows
from ..engine.passes import BoundPass
from ..engine.threads import Chunks
from ..kernels import surrogate_thickness
from ..materials import plane_stress
from .material_points import MaterialPoints
from .protocol import CompiledBondForce, Domain

TOLERANCE = {"float32": 1e-6, "float64": 1e-9}
"""Relative step of J3 at which the iteration ends, a few times what rounding in the force leaves of it at K = 10 mu."""


def surrogate_states(points: MaterialPoints, compiled: CompiledBondForce, domain: Domain, precision: str, chunks: Chunks) -> BoundPass:
    """Bind the pass that finds volume ratios and records of points with a learnt force, and counts the points without a state.

    The model of the force knows T_mm; points outside its domain are left to the law.
    """
    return surrogate_thickness.surrogate_node_states.bind(
        points.gradients,
        points.volume_ratios,
        plane_stress.volumetric_block(points.law).address,
        compiled.address,
        (compiled.sizes, compiled.weights, points.response.address, points.parameters),
        np.stack([domain.limits("float64"), domain.interior.limits("float64")]),
        TOLERANCE[str(np.dtype(precision))],
        (
            aligned_rows((chunks.threads, surrogate_thickness.BUFFER_ROWS, BLOCK), precision, 1),
            compiled.memory(chunks.threads, precision),
            aligned_rows((chunks.threads, surrogate_thickness.SCRATCH_ROWS, BLOCK), value=1),
        ),
        points.records,
        chunks=chunks,
    )
