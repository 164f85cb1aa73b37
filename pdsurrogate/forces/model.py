"""What all force models share: how they are bound to a body."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from ..body import Body
from ..materials import Law
from .protocol import InternalForce
from .settings import ForceSettings


class BindableForce(ABC):
    """A force model that says which settings it honours, and is bound with none that it does not.

    Attributes
    ----------
    name : str
    honours : mapping
        The values that it can honour of every field of `ForceSettings` that it has a use for.
    """

    name: str
    honours: ClassVar[Mapping[str, tuple]]

    def bind(self, body: Body, law: Law, settings: ForceSettings) -> InternalForce:
        """Prepare the evaluation of this model on a body of a material.

        Raises
        ------
        ValueError
            If the model does not fit the material, or cannot honour a setting.
        """
        settings.check(self.name, self.honours)
        return self.evaluation(body, law, settings)

    @abstractmethod
    def evaluation(self, body: Body, law: Law, settings: ForceSettings) -> InternalForce:
        """The evaluation on a body, with settings that it can honour."""
