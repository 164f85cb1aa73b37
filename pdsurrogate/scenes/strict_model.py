"""Base class, number types and vector types of all parts of a scene's description."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    ValidationError,
    WrapValidator,
    model_validator,
)

from .problems import Problems, SceneError


def refused(wrong: Callable[[Any], bool], message: str) -> Callable[[Any], Any]:
    """Return a validator that raises ValueError with a message for values for which the function
    `wrong` returns True.
    """

    def checked(value: Any) -> Any:
        if wrong(value):
            raise ValueError(message)
        return value

    return checked


NUMBER = BeforeValidator(
    refused(lambda value: isinstance(value, bool | str | bytes), "Input should be a valid number")
)
"""Reject values that Pydantic would convert into a number, such as true and "1"."""

Finite = Annotated[float, Field(allow_inf_nan=False), NUMBER]
Positive = Annotated[Finite, Field(gt=0)]
Whole = Annotated[int, NUMBER]
ARTIFACT = "artifact"
"""Text in the place of a number that the tests behind the artifact of a run have determined."""

MEASURED = (
    WrapValidator(lambda value, number: value if value == ARTIFACT else number(value)),
    PlainSerializer(lambda value: value),
)
"""Annotations of numbers for which `ARTIFACT` may stand, which a run with an artifact replaces
before all else.
"""

Point = tuple[Finite, Finite]
"""A place or a direction in the plane, for parts that lie in the plane alone."""

SpacePoint = tuple[Finite, Finite, Finite]
"""Place in three dimensions."""


_not_zero = refused(lambda value: not any(value), "it is a direction, of any length but zero")
Direction = Annotated[Point, AfterValidator(_not_zero)]
SpaceDirection = Annotated[SpacePoint, AfterValidator(_not_zero)]


class Components(tuple):
    """Components of a place, a direction or a force: two in a scene with a body in the plane,
    three in a scene with a solid.
    """


Vector = Annotated[
    tuple[Finite, ...], Field(min_length=2, max_length=3), AfterValidator(Components)
]
"""Components for parts of two- or three-dimensional bodies; `vectors_in` finds them, and `Scene`
checks their number.
"""


@contextmanager
def _in_one_line() -> Iterator[None]:
    """Raise SceneError in the place of Pydantic's ValidationError."""
    try:
        yield
    except ValidationError as error:
        raise SceneError(str(error.errors()[0]["ctx"]["error"])) from None


class _PartType(type(BaseModel)):
    def __call__(cls, /, *args: Any, **fields: Any) -> Any:
        with _in_one_line():
            return super().__call__(*args, **fields)


class StrictModel(BaseModel, metaclass=_PartType):
    """Base class of all parts of a scene: unknown keys are errors, and fields of an object cannot
    be changed.

    Invalid parts raise SceneError with the same message, whether they are composed in Python or
    read from a file. Subclasses check fields against each other in `model_post_init`: Pydantic
    reports a ValueError from there with the key of the part.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    @classmethod
    def model_validate(cls, described: Any, **options: Any) -> Self:
        """Return the part of a scene that a mapping describes.

        Raises
        ------
        SceneError
            If it is invalid, in one line that names the key.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.shapes.Precut.model_validate({"start": [0.0, 1.0], "end": [3.0, 1.0]}).end
        (3.0, 1.0)
        """
        with _in_one_line():
            return super().model_validate(described, **options)

    @model_validator(mode="wrap")
    @classmethod
    def _explained(cls, value: Any, read: Callable[[Any], Any]) -> Any:
        try:
            return read(value)
        except ValidationError as error:
            raise Problems(error, cls) from None


def left_to_artifact(part: StrictModel, key: str = "") -> list[str]:
    """Return the keys of the numbers of a part that the tests behind an artifact determine."""
    found = []
    for name, value in part:
        if isinstance(value, StrictModel):
            found += left_to_artifact(value, f"{key}{name}.")
        elif value == ARTIFACT:
            found.append(f"{key}{name}")
    return found


def the_one(part: StrictModel, names: Iterable[str]) -> str:
    """Return which one of some fields a part of a scene has; raise ValueError unless it is one."""
    keys = {name: type(part).model_fields[name].alias or name for name in names}
    given = [name for name in keys if getattr(part, name) is not None]
    if len(given) != 1:
        raise ValueError(f"needs exactly one of {', '.join(keys.values())}")
    return given[0]


def vectors_in(value: Any, key: str = "") -> Iterator[tuple[str, Components]]:
    """Yield all vectors (`Components`) in a part of a scene, at any depth, each preceded by its
    dotted key.
    """
    if isinstance(value, Components):
        yield key, value
        return
    if isinstance(value, StrictModel):
        value = {
            field.alias or name: getattr(value, name)
            for name, field in type(value).model_fields.items()
        }
    elif isinstance(value, tuple):
        value = dict(enumerate(value))
    for step, inner in value.items() if isinstance(value, Mapping) else ():
        yield from vectors_in(inner, f"{key}.{step}" if key else str(step))
