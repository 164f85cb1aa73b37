"""What all parts of a scene's description have in common."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from .problems import SceneError, explain


def _no_switch_or_text(value: Any) -> Any:
    """Refuse what Pydantic would turn into a number: true into 1, and "1" too."""
    if isinstance(value, bool | str | bytes):
        raise ValueError("Input should be a valid number")
    return value


Finite = Annotated[float, Field(allow_inf_nan=False), BeforeValidator(_no_switch_or_text)]
Positive = Annotated[Finite, Field(gt=0)]
Whole = Annotated[int, BeforeValidator(_no_switch_or_text)]
Point = tuple[Finite, Finite]


class _PartType(type(BaseModel)):
    def __call__(cls, *args: Any, **fields: Any) -> Any:
        try:
            return super().__call__(*args, **fields)
        except ValidationError as error:
            raise SceneError(explain(error, cls)) from None


class StrictModel(BaseModel, metaclass=_PartType):
    """Base of all parts of a scene: unknown keys are errors, and nothing changes once read.

    Composed in Python, a part that makes no sense is told like one in a file.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
