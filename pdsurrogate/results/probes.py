"""Probes: what is read at given places of a body at every output."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from ..body import Body, fields_at
from ..ranks import Share
from ..scenes import Probe
from .measures import PointState


class Probes:
    """Places in a body at which displacement, stress and deformation gradient are read.

    Parameters
    ----------
    body : Body
    probes : sequence of Probe
    portion_of : ndarray of int, shape (n,), optional
        Material of every point of a body of several.
    share : Share
        What is here of the body.

    Raises
    ------
    ValueError
        If a place lies outside the body, or too few points are beside it; names the key.
    """

    def __init__(self, body: Body, probes: tuple[Probe, ...], portion_of: np.ndarray | None = None, share: Share | None = None) -> None:
        self._names, self._rows, self._share = [probe.name for probe in probes], [], share or body.share
        for number, probe in enumerate(probes):
            try:
                rows = fields_at(body, np.array([probe.at]), portion_of)
            except ValueError as error:
                raise ValueError(f"probes.{number}.at: {error}") from None
            # One row for several components stays one.
            own = {id(row): self._share.own_columns(row) for of_kind in rows for row in of_kind}
            self._rows.append([[own[id(row)] for row in of_kind] for of_kind in rows])

    def __len__(self) -> int:
        return len(self._names)

    def read(self, state: PointState) -> dict[str, dict[str, list]]:
        """Return the values at the probes in a state.

        Positions, stresses and gradients of the points are continued to the place by one linear fit to those around it.

        Returns
        -------
        dict
            By name of the probe: ``displacement`` (d components), ``stress`` (first Piola-Kirchhoff, 3 rows of 3) and ``F`` (3 rows of 3).
        """
        stress, gradient = (field.reshape(len(field), 9) for field in (state.stress, state.deformation_gradient))
        return {
            name: {
                # Rows are 1 in sum and have the place as their first moment, so displacements may be fitted in the place of positions.
                "displacement": self._share.total(_read(moved, state.displacement)).tolist(),
                "stress": self._share.total(_read(tensors, stress)).reshape(3, 3).tolist(),
                "F": self._share.total(_read(tensors, gradient)).reshape(3, 3).tolist(),
            }
            for name, (moved, tensors) in zip(self._names, self._rows, strict=True)
        }

    def columns(self, displacements: np.ndarray) -> dict[str, float]:
        """Displacements that the probes read from those of the points (n, d), for a row of the history."""
        return {
            f"{name}_displacement_{component}": float(value)
            for name, (moved, _) in zip(self._names, self._rows, strict=True)
            for component, value in enumerate(self._share.total(_read(moved, displacements)), 1)
        }


def _read(rows: Sequence[sparse.csr_array], values: np.ndarray) -> np.ndarray:
    """At a place, shape (m,), from components at the points (n, m); one row serves all where it is the same for all."""
    if all(row is rows[0] for row in rows):
        return (rows[0] @ values)[0]
    return np.array([(row @ values[:, component])[0] for component, row in enumerate(rows)])
