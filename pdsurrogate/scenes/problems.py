"""Error messages for invalid scenes."""

from __future__ import annotations

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
"""How alike two words are, from 0 to 1, of which one may be the other with an error in it: elipse and ellipse are (0.92), cube and tube
are not (0.75)."""


def suggestion(word: str, known: Iterable[str], otherwise: str = "there are") -> str:
    """Return a suggestion for an unknown word: the nearest known word, or all of them."""
    known = list(known)
    nearest = difflib.get_close_matches(word, known, 1, CLOSE)
    return f"did you mean {nearest[0]}?" if nearest else f"{otherwise} {', '.join(known)}"


PLAIN = {
    "tuple_type": "must be a list",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "dict_type": "must be a table",
    "missing": "Field required",
}
"""Pydantic's problems, by type, that it tells in the words of Python; a description is written in TOML."""


def explain(error: ValidationError, model: type[BaseModel] | None = None) -> str:
    """One line for all problems, each with its dotted key.

    Parameters
    ----------
    error : ValidationError
    model : type, optional
        What the description was read as; with it, unknown keys are told with what there is.
    """
    problems, lines = error.errors(), []
    for problem in problems:
        loc, kind, given = problem["loc"], problem["type"], problem.get("input")
        if kind in ("too_short", "too_long") and any(other["loc"] != loc == other["loc"][: len(loc)] for other in problems):
            continue  # Pydantic counts the entries that are left when the wrong ones are taken out.
        if kind == "missing" and isinstance(loc[-1], int):
            if any(other["type"] == "missing" and other["loc"][:-1] == loc[:-1] and other["loc"] > loc for other in problems):
                continue  # The last one missing tells how many there should be.
            message = f"needs {loc[-1] + 1} entries, not {len(given)}; it belongs to space, and two components to what is in the plane"
            lines.append(f"{_place_of(model, loc[:-1])[0]}: {message}")
            continue
        key, keys = _place_of(model, loc)
        message = PLAIN.get(kind, problem["msg"].removeprefix("Value error, "))
        if kind == "extra_forbidden":
            message = "unknown key" + (f"; {suggestion(str(loc[-1]), keys)}" if keys else "")
            given = None
        elif kind in ("too_short", "too_long"):
            bound = f"at least {problem['ctx']['min_length']}" if kind == "too_short" else f"at most {problem['ctx']['max_length']}"
            message = f"needs {bound} entries, not {problem['ctx']['actual_length']}"
            if (problem["ctx"].get("max_length"), problem["ctx"]["actual_length"]) == (2, 3):
                message += "; it belongs to the plane, and three components to what is in space"
        elif kind == "union_tag_invalid":
            shapes = problem["ctx"]["expected_tags"].replace("'", "").split(", ")
            message = f"unknown shape {problem['ctx']['tag']!r}; {suggestion(problem['ctx']['tag'], shapes)}"
        text = repr(given)
        told = message.endswith(text) or (isinstance(given, str) and text in message)
        shown = f" (given {text if len(text) <= 80 else text[:77] + '...'})" if isinstance(given, str | int | float) and not told else ""
        lines.append(f"{key}: {message}{shown}" if key else message)
    return "; ".join(lines)


def _place_of(model: Any, loc: tuple) -> tuple[str, list[str]]:
    """The dotted key of a place as its author wrote it, and the keys of the table that it is in.

    Pydantic adds which of several shapes it took a part for; the author's file has no such key.
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
    """The types that a place may be read as, each with the tag that it goes by."""
    if get_origin(place) is Annotated:
        place, *notes = get_args(place)
        tag = next((note.tag for note in notes if isinstance(note, Tag)), tag)
    if get_origin(place) in (Union, UnionType):
        for option in get_args(place):
            yield from _options(option, tag)
    else:
        yield place, tag


def _inside(place: Any, step: str | int) -> Any:
    """The type of an entry of a list, or of a key of a table; None where there is no such thing."""
    if get_origin(place) is tuple and isinstance(step, int):
        return get_args(place)[0]
    if get_origin(place) is dict:
        return get_args(place)[1]
    if isinstance(place, type) and issubclass(place, BaseModel):
        field = _fields(place).get(step) or place.model_fields.get(step)
        return field and field.annotation
    return None


def _fields(table: type[BaseModel]) -> dict[str, FieldInfo]:
    """The fields of a table by the keys that an author writes."""
    return {field.alias or name: field for name, field in table.model_fields.items()}
