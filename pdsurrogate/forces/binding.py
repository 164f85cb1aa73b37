"""Materials of a body with their force models, and what the terms of an internal force have in
common.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..materials import Law
from .kinematics import Kinematics
from .settings import OUTSIDE, ForceSettings


@dataclass(frozen=True)
class MaterialPart:
    """Points of one material of a body, with its law and its force model.

    Attributes
    ----------
    law : Law
    model : ForceModel
        Any object here: terms and force models are defined with the classes of this module.
    points : ndarray of int or slice
        Numbers of the points in ascending order; ``slice(None)`` if all points are of the material.
    """

    law: Law
    model: Any
    points: np.ndarray | slice


@dataclass(frozen=True)
class Binding:
    """Data that the terms of an internal force have in common: body and kinematics, materials, and
    settings.

    Attributes
    ----------
    kinematics : Kinematics
    portions : sequence of MaterialPart
    settings : ForceSettings
    precision : str
        Precision of the bond pass.
    portion_of : ndarray of int, shape (n + m,), or None
        Number of the material (index into `portions`) of every point and ghost, ``len(portions)``
        for rigid ones; None with one material.
    number : int
        Number of the term that is bound, from 0; the first one of the force may place the points.
    """

    kinematics: Kinematics
    portions: Sequence[MaterialPart]
    settings: ForceSettings
    precision: str
    portion_of: np.ndarray | None
    number: int = 0

    @property
    def outside(self) -> str:
        """Policy of the settings for pairs outside the training domain of a model."""
        return self.settings.outside or OUTSIDE

    @property
    def whole(self) -> bool:
        """Whether all points of the body are of one material."""
        return self.portion_of is None
