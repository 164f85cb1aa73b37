"""What the evaluations of all force models share: the points' kinematics, and the domain of a model."""

from __future__ import annotations

import warnings

import numpy as np

from ..body import Body
from ..materials import Law
from .kinematics import Kinematics
from .protocol import InternalForce, OutsideDomain, OutsideDomainWarning
from .settings import OUTSIDE, ForceSettings


class Evaluation(InternalForce):
    """A force on the kinematics of a body's points.

    Parameters
    ----------
    body : Body
    law : Law
    precision, correction : str
        See `InternalForce`.
    settings : ForceSettings
    """

    def __init__(self, body: Body, law: Law, precision: str, correction: str, settings: ForceSettings) -> None:
        super().__init__(body, law, precision, correction, settings.breakable, settings.plane)
        self._kinematics = Kinematics(body, law, precision, settings.rotation, settings.plane)
        self._n_pairs = len(body.bonds.first)

    def place(self, positions: np.ndarray) -> None:
        self._kinematics.place(positions)

    def move_plane(self, plane: int, displacement) -> None:
        self._kinematics.move_plane(plane, displacement)

    @property
    def positions(self) -> np.ndarray:
        return self._kinematics.positions

    def deformation_gradients(self) -> np.ndarray:
        return self._kinematics.deformation_gradients()

    def volume_ratios(self) -> np.ndarray:
        self._kinematics.find_states()
        return self._kinematics.volume_ratios[: len(self.body)]

    @property
    def supported(self) -> np.ndarray:
        return self._kinematics.supported[: len(self.body)] != 0

    def state_arrays(self) -> dict[str, np.ndarray]:
        return {"volume_ratios": self._kinematics.volume_ratios}


class ModelEvaluation(Evaluation):
    """The evaluation of a model that has a domain, or none: it counts the pairs outside, and stops or warns where that was asked for.

    Parameters
    ----------
    model : ForceSurrogate or EnergySurrogate
        Whose `domain` is watched.
    quantity, stand_in : str
        What the model gives, and what would stand in for it, for messages.

    Attributes
    ----------
    model
    outside : str
        What is done about pairs outside, see `ForceSettings`.
    """

    def __init__(self, model, body: Body, law: Law, correction: str, settings: ForceSettings, quantity: str, stand_in: str) -> None:
        # In plane strain the pressure follows from det F as it is rounded, times K.
        usual = model.default_precision if settings.plane == "stress" else "float64"
        super().__init__(body, law, settings.precision or usual, correction, settings)
        self.model, self.outside = model, settings.outside or OUTSIDE
        self._quantity, self._stand_in, self._warned = quantity, stand_in, False

    def _report_outside(self, found: int) -> None:
        """Take note of the pairs outside in one evaluation.

        Raises
        ------
        OutsideDomain
            If there are any, and the policy is to stop.
        """
        self.pairs_outside += found
        if not found or self.outside not in ("raise", "warn"):
            return
        what = f"{found} of {self._n_pairs} bonds are outside the domain of {self.model.name}, {self.model.domain}"
        if self.outside == "raise":
            raise OutsideDomain(f"{what}; outside=fallback would use the exact {self._stand_in} for them")
        if not self._warned:
            self._warned = True
            warnings.warn(f"{what}: its {self._quantity} there is extrapolated", OutsideDomainWarning, stacklevel=4)
