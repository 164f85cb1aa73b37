"""What the evaluations of all force models share: the points' kinematics, and the domain of a model."""

from __future__ import annotations

import warnings

import numpy as np

from ..body import Body
from ..body.share import SERIAL, Share
from ..materials import Law
from ..materials.stretches import principal_stretches
from .kinematics import Kinematics, matrices
from .protocol import InternalForce, OutsideDomain, OutsideDomainWarning
from .settings import ForceSettings


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
        settings.check_body(body)
        super().__init__(body, law, precision, correction, settings.breakable, settings.plane)
        self._kinematics = Kinematics(body, law, precision, settings.rotation, settings.plane)
        self._n_pairs = len(body.bonds.first)

    def place(self, positions: np.ndarray) -> None:
        self._kinematics.place(positions)

    def move_plane(self, plane: int, displacement, turn: np.ndarray | None = None) -> None:
        self._kinematics.move_plane(plane, displacement, turn)

    @property
    def positions(self) -> np.ndarray:
        return self._kinematics.positions

    def deformation_gradients(self) -> np.ndarray:
        return self._kinematics.deformation_gradients()

    def principal_stretches(self) -> np.ndarray:
        """Of the points at the positions last given, in the plane those within it, shape (n, d)."""
        return principal_stretches(self.deformation_gradients())

    def gradients_at(self, numbers) -> np.ndarray:
        """F of the points and images of the given numbers as last formed, shape (k, d, d)."""
        return matrices(self._kinematics.gradients[numbers])

    def volume_ratios(self) -> np.ndarray:
        self._kinematics.find_states()
        return self._kinematics.volume_ratios[: len(self.body)]

    @property
    def supported(self) -> np.ndarray:
        return self._kinematics.supported[: len(self.body)] != 0

    def state_arrays(self) -> dict[str, np.ndarray]:
        return {"volume_ratios": self._kinematics.volume_ratios}


def usual_precision(model, settings: ForceSettings) -> str:
    """The precision asked for, or else the model's own; in plane strain and space, where pressures stand against stresses, double."""
    return settings.precision or (model.default_precision if settings.plane == "stress" else "float64")


class DomainWatch:
    """What is done about the pairs outside a model's domain, beside counting them: it stops or warns where that was asked for.

    Parameters
    ----------
    model : ForceSurrogate or EnergySurrogate
        Whose `domain` is watched.
    n_pairs : int
        Pairs in one evaluation of the model.
    outside : str
        See `ForceSettings`.
    quantity, stand_in : str
        What the model gives, and what would stand in for it, for messages.
    share : Share
        Of the body.
    """

    def __init__(self, model, n_pairs: int, outside: str, quantity: str, stand_in: str, share: Share = SERIAL) -> None:
        self._model, self._n_pairs, self._share = model, n_pairs, share
        self._stops, self._tells = outside == "raise", outside in ("raise", "warn")
        self._quantity, self._stand_in, self._warned = quantity, stand_in, False
        self._found = 0

    def report(self, found: int) -> None:
        """Say how many pairs were outside in one evaluation; of a body in parts, once all of them have come through it.

        Raises
        ------
        OutsideDomain
            If there are any, and the policy is to stop.
        """
        if self._share.divided:
            self._found = found
        elif found and self._tells:
            self._tell(found, self._n_pairs)

    def settle(self) -> None:
        """Of a body in parts, say how many pairs were outside in all of them.

        Raises
        ------
        OutsideDomain
            As `report`.
        """
        if self._share.divided and self._tells:
            found = self._share.total(self._found)
            if found:
                self._tell(found, self._share.total(self._n_pairs))

    def _tell(self, found: int, of: int) -> None:
        what = f"{found} of {of} bonds are outside the domain of {self._model.name}, {self._model.domain}"
        if self._stops:
            raise OutsideDomain(f"{what}; outside=fallback would use the exact {self._stand_in} for them")
        if not self._warned:
            self._warned = True
            warnings.warn(f"{what}: its {self._quantity} there is extrapolated", OutsideDomainWarning, stacklevel=5)
