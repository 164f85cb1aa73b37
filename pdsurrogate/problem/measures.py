"""Measures that results report in addition to forces, displacements and energies, as the loading of a scene determines them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..scenes import Rectangle, Scene
from ..scenes.model import EDGES
from ..scenes.references import reference_level


@dataclass(frozen=True)
class NominalStress:
    """Pull of a grip outwards along the loaded axis over its cross-section.

    Attributes
    ----------
    edge : str
        Edge of the grip: of the two that which travels further, or the right or top one of two that travel alike.
    area : float
    number : int
        Number of the grip among the holders.
    """

    edge: str
    area: float
    number: int

    def of(self, forces: np.ndarray) -> float:
        """Return the stress from the forces of the grips, shape (2, d)."""
        axis, side = EDGES[self.edge]
        return float(side * forces[self.number, axis] / self.area)


@dataclass(frozen=True)
class Measures:
    """Measures that results of a problem report.

    Attributes
    ----------
    nominal_stress : NominalStress or None
        Measure of a body between two grips; other results report moments, and their outputs in dynamics among the levels.
    lateral : int or None
        Axis across the load whose edges move straight, of a rectangle between grips.
    areas : dict of float
        Cross-section of the body at every grip or reflected edge.
    reference : callable
        Known values of measures at a value of the loading parameter, by name.
    """

    nominal_stress: NominalStress | None
    lateral: int | None
    areas: dict[str, float]
    reference: Callable[[float], dict[str, float]]


def measures_of(scene: Scene, areas: dict[str, float]) -> Measures:
    """Return the measures of a scene, for cross-sections at its grips."""
    if not scene.stretched:
        return Measures(None, None, areas, lambda parameter: {})
    grip = max(scene.grips, key=lambda grip: (grip.travel, EDGES[grip.edge][1]))
    stress = NominalStress(grip.edge, areas[grip.edge], scene.grips.index(grip))
    # Other outlines have no straight edges to read displacements from.
    lateral = 1 - scene.loaded_axis if isinstance(scene.body, Rectangle) else None
    return Measures(stress, lateral, areas, partial(reference_level, scene))
