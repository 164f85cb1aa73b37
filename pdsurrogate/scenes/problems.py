"""Error messages for invalid scenes."""

import difflib
from collections.abc import Iterable, Iterator
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, Tag, ValidationError
from pydantic.fields import FieldInfo


class SceneError(ValueError):
    """A scene that cannot be run as described; the message names the key.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> try:
    ...     pds.load_scene("uniaxial", spcing=0.1)
    ... except pds.SceneError as error:
    ...     print(error)
    scene uniaxial: spcing: unknown key; did you mean spacing?
    """


CLOSE = 0.78
"""Similarity of two words, from 0 to 1, above which one may be a misspelling of the other: elipse and ellipse are similar (0.92), cube and
tube are not (0.75)."""


def suggestion(word: str, known: Iterable[str], otherwise: str = "there are") -> str:
    """Return the end of a message about an unknown word: "did you mean", with a similar known word, or else a list of all known words."""
    known = list(known)
    nearest = difflib.get_close_matches(word, known, 1, CLOSE)
    return f"did you mean {nearest[0]}?" if nearest else f"{otherwise} {', '.join(known)}"


PLAIN = {"tuple_type": "must be a list", **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "must be a table")}
"""Messages in the place of Pydantic's, which uses the words of Python; a description is written in TOML."""


def explain(error: ValidationError, model: type[BaseModel] | None = None) -> str:
    """Return one line of text for all problems that Pydantic found in a description, each with its dotted key.

    Parameters
    ----------
    error : ValidationError
    model : type, optional
        Model as which a scene or a study was read; with it, messages list the known keys, and say what belongs to the plane or to space.
    """
    problems = error.errors()
    return "; ".join(line for problem in problems if (line := _line(problem, problems, model)))


def _line(problem: Any, problems: list, model: type[BaseModel] | None) -> str | None:
    """Return the message for one entry of Pydantic's list of errors (`problems`); None if another entry explains the problem better."""
    loc, kind, given, context = problem["loc"], problem["type"], problem.get("input"), problem.get("ctx", {})
    if kind in ("too_short", "too_long") and any(other["loc"] != loc == other["loc"][: len(loc)] for other in problems):
        return None  # Pydantic counts the entries that remain without the invalid ones.
    if kind == "missing" and isinstance(loc[-1], int) and model is not None:
        if any(other["type"] == "missing" and other["loc"][:-1] == loc[:-1] and other["loc"] > loc for other in problems):
            return None  # The last one missing shows how many there should be.
        count = f"needs {loc[-1] + 1} entries, not {len(given)}"
        return f"{_place_of(model, loc[:-1])[0]}: {count}; it belongs to space, and two components to what is in the plane"
    key, keys = _place_of(model, loc)
    message = PLAIN.get(kind, problem["msg"].removeprefix("Value error, "))
    if kind == "extra_forbidden":
        message, given = "unknown key" + (f"; {suggestion(str(loc[-1]), keys)}" if keys else ""), None
    elif kind in ("too_short", "too_long"):
        bound = f"at least {context['min_length']}" if kind == "too_short" else f"at most {context['max_length']}"
        message = f"needs {bound} entries, not {context['actual_length']}"
        if model is not None and (context.get("max_length"), context["actual_length"]) == (2, 3):
            message += "; it belongs to the plane, and three components to a solid"
    elif kind == "union_tag_invalid":
        shapes = context["expected_tags"].replace("'", "").split(", ")
        message = f"unknown shape {context['tag']!r}; {suggestion(context['tag'], shapes)}"
    text = repr(given)
    if isinstance(given, str | int | float) and not message.endswith(text) and not (isinstance(given, str) and text in message):
        message += f" (given {text if len(text) <= 80 else text[:77] + '...'})"
    return f"{key}: {message}" if key else message


def _place_of(model: Any, loc: tuple) -> tuple[str, list[str]]:
    """Return the dotted key, as written in a description, of the location `loc` of a Pydantic error, and the known keys of its table.

    Pydantic adds to `loc` the tag of the variant that it tried, such as a shape; the author's file has no such key.
    """
    steps, keys, place = [], [], model
    for step in loc:
        options = list(_options(place))
        chosen = next((option for option, tag in options if tag == step), None)
        if chosen is None:
            tables = [option for option, _ in options if isinstance(option, type) and issubclass(option, BaseModel)]
            keys = [key for table in tables for key in _fields(table)]
            if step != "[key]":  # of a table whose keys are names
                steps.append(str(step))
            chosen = next((inner for option, _ in options if (inner := _inside(option, step)) is not None), None)
        place = chosen
    return ".".join(steps), keys


def _options(place: Any, tag: str | None = None) -> Iterator[tuple[Any, str | None]]:
    """Yield the alternatives of a type annotation, each with its tag in Pydantic's errors, or None if it has no tag."""
    if get_origin(place) is Annotated:
        place, *notes = get_args(place)
        tag = next((note.tag for note in notes if isinstance(note, Tag)), tag)
    if get_origin(place) in (Union, UnionType):
        for option in get_args(place):
            yield from _options(option, tag)
    else:
        shape = getattr(place, "model_fields", {}).get("shape")
        yield place, tag or (shape and shape.default)


def _inside(place: Any, step: str | int) -> Any:
    """Return the type of the entry `step` of a list or table whose type is `place`; None if there is no such entry."""
    if get_origin(place) is tuple and isinstance(step, int):
        return get_args(place)[0]
    if get_origin(place) is dict:
        return get_args(place)[1]
    if isinstance(step, str) and isinstance(place, type) and issubclass(place, BaseModel):
        field = _fields(place).get(step) or place.model_fields.get(step)
        return field and field.annotation
    return None


def _fields(table: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields of a Pydantic model by their keys in a scene file: the alias if there is one, else the name."""
    return {field.alias or name: field for name, field in table.model_fields.items()}
