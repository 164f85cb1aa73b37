"""The plane-stress condition solved with the learnt bond force, for laws that cost more than it."""

from __future__ import annotations

import numpy as np

from ..engine.block_arrays import BLOCK, aligned_rows
from ..engine.passes import BoundPass
from ..engine.threads import Chunks
from ..kernels import surrogate_thickness
from ..materials import Law, plane_stress
from .protocol import CompiledBondForce, Domain

TOLERANCE = {"float32": 1e-6, "float64": 1e-9}
"""Relative step of J3 at which the iteration ends, a few times what rounding in the force leaves of it at K = 10 mu."""


class SurrogateThickness:
    """J3 of all points from a learnt bond force (`pdsurrogate.kernels.surrogate_thickness`).

    Parameters
    ----------
    compiled : CompiledBondForce
        Of a model that knows T_mm.
    domain : Domain
        Its domain; points outside are left to the law.
    law : Law
    precision : str
        Of the model.
    chunks : Chunks
        Of the pass.
    """

    def __init__(self, compiled: CompiledBondForce, domain: Domain, law: Law, precision: str, chunks: Chunks) -> None:
        self._compiled = compiled
        self._domain = np.stack([domain.limits("float64"), domain.interior.limits("float64")])
        self._volumetric = plane_stress.volumetric_block(law)
        self._tolerance = TOLERANCE[str(np.dtype(precision))]
        self._buffers = aligned_rows((chunks.threads, surrogate_thickness.BUFFER_ROWS, BLOCK), precision, 1)
        self._work = aligned_rows((chunks.threads, max(compiled.work_rows, 1), BLOCK), precision)
        self._scratch = aligned_rows((chunks.threads, surrogate_thickness.SCRATCH_ROWS, BLOCK), value=1)

    def bind(self, gradients, volume_ratios, response: int, parameters, records, chunks: Chunks) -> BoundPass:
        """The pass that brings `volume_ratios` and `records` up to date, and counts the points without a state."""
        return surrogate_thickness.surrogate_node_states.bind(
            gradients,
            volume_ratios,
            self._volumetric.address,
            self._compiled.address,
            (self._compiled.sizes, self._compiled.weights, response, parameters),
            self._domain,
            self._tolerance,
            (self._buffers, self._work, self._scratch),
            records,
            chunks=chunks,
        )
