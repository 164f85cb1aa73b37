"""Probes: displacement, stress and deformation gradient at given places of a body."""

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
        Number of the material of every point, in a body of several materials.
    share : Share
        Part of the body on this rank.

    Raises
    ------
    ValueError
        If a place lies outside the body, or has too few points around it; the message names the key.
    """

    def __init__(self, body: Body, probes: tuple[Probe, ...], portion_of: np.ndarray | None = None, share: Share | None = None) -> None:
        self._names, self._rows, self._share = [probe.name for probe in probes], [], share or body.share
        for number, probe in enumerate(probes):
            try:
                rows = fields_at(body, np.array([probe.at]), portion_of)
            except ValueError as error:
                raise ValueError(f"probes.{number}.at: {error}") from None
            # A row that serves several components is restricted once.
            own = {id(row): self._share.own_columns(row) for of_kind in rows for row in of_kind}
            self._rows.append([[own[id(row)] for row in of_kind] for of_kind in rows])

    def __len__(self) -> int:
        return len(self._names)

    def read(self, state: PointState) -> dict[str, dict[str, list]]:
        """Return the values at the probes in a state.

        One linear fit to the surrounding points extrapolates displacements, stresses and gradients to the place.

        Returns
        -------
        dict
            For each name of a probe ``displacement`` (d components), ``stress`` (first Piola-Kirchhoff, 3 by 3) and ``F`` (3 by 3).
        """
        stress, gradient = (field.reshape(len(field), 9) for field in (state.stress, state.deformation_gradient))
        return {
            name: {
                # The weights of a row sum to 1 and reproduce the place, so they apply to displacements as to positions.
                "displacement": self._share.total(_read(moved, state.displacement)).tolist(),
                "stress": self._share.total(_read(tensors, stress)).reshape(3, 3).tolist(),
                "F": self._share.total(_read(tensors, gradient)).reshape(3, 3).tolist(),
            }
            for name, (moved, tensors) in zip(self._names, self._rows, strict=True)
        }

    def columns(self, displacements: np.ndarray) -> dict[str, float]:
        """Return the displacements at the probes from those of the points (n, d), for a row of the history."""
        return {
            f"{name}_displacement_{component}": float(value)
            for name, (moved, _) in zip(self._names, self._rows, strict=True)
            for component, value in enumerate(self._share.total(_read(moved, displacements)), 1)
        }


def _read(rows: Sequence[sparse.csr_array], values: np.ndarray) -> np.ndarray:
    """Return values at a place, shape (m,), from those at the points (n, m); rows that are one object serve any number of components."""
    if all(row is rows[0] for row in rows):
        return (rows[0] @ values)[0]
    return np.array([(row @ values[:, component])[0] for component, row in enumerate(rows)])
