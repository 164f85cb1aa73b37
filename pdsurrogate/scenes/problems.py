"""Error messages for invalid scenes: `SceneError`, and the conversion of Pydantic's validation
errors.
"""

from typing import Any, get_origin

from pydantic import BaseModel, ValidationError

from ..arguments import suggestion


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


PLAIN = dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "must be a table")
PLAIN |= {"missing": "this key is missing", "tuple_type": "must be a list"}
"""Messages by type of error in the place of Pydantic's, which uses the words of Python; a
description is written in TOML.
"""


FEW = 10
"""Number of problems that one message lists."""


class Problems(ValueError):
    """All problems that Pydantic found in one part of a description, in one line of text.

    Attributes
    ----------
    lines : list of (str, str)
        For each problem its dotted key within the part, and the message about it.
    """

    def __init__(self, error: ValidationError, part: type[BaseModel]) -> None:
        problems = error.errors()
        self.lines = [line for problem in problems for line in _lines(problem, problems, part)]
        shown = [f"{key}: {message}" if key else message for key, message in self.lines]
        # One slip repeated in a thousand inclusions is one slip.
        more = [f"and {len(shown) - FEW} problems more"] if len(shown) > FEW else []
        super().__init__("; ".join(shown[:FEW] + more))


def _lines(problem: Any, problems: list, part: type[BaseModel]) -> list[tuple[str, str]]:
    """Return pairs of dotted key and message for one of the `problems` that Pydantic lists for a
    `part` of a description.

    The list is empty if another of the problems explains the trouble better.
    """
    loc = problem["loc"]
    kind = problem["type"]
    given = problem.get("input")
    context = problem.get("ctx", {})
    fields = {field.alias or name: field for name, field in part.model_fields.items()}
    # Pydantic adds the tag of the variant that it tried, such as a shape; the author's file has no
    # such key.
    named = 1 + bool(loc and loc[0] in fields and get_origin(fields[loc[0]].annotation) is dict)
    key = ".".join(
        str(step) for place, step in enumerate(loc) if place < named or isinstance(step, int)
    )
    if isinstance(context.get("error"), Problems):  # of a part of this part
        return [
            (".".join(filter(None, (key, inner))), message)
            for inner, message in context["error"].lines
        ]
    if kind in ("too_short", "too_long") and any(
        other["loc"] != loc == other["loc"][: len(loc)] for other in problems
    ):
        return []  # Pydantic counts the entries that remain without the invalid ones.
    message = PLAIN.get(kind, problem["msg"].removeprefix("Value error, "))
    if kind == "missing" and isinstance(loc[-1], int):
        message = f"this entry is missing, of {len(given)} given"
    elif kind == "extra_forbidden":
        message = f"unknown key; {suggestion(str(loc[-1]), fields)}"
        given = None
    elif kind in ("too_short", "too_long"):
        least = context.get("min_length")
        most = context.get("max_length")
        bound = f"at least {least}" if kind == "too_short" else f"at most {most}"
        message = f"needs {bound} entries, not {context['actual_length']}"
    elif kind == "union_tag_invalid":
        shapes = context["expected_tags"].replace("'", "").split(", ")
        message = f"unknown shape {context['tag']!r}; {suggestion(context['tag'], shapes)}"
    text = repr(given)
    if (
        isinstance(given, str | int | float)
        and not message.endswith(text)
        and not (isinstance(given, str) and text in message)
    ):
        message += f" (given {text if len(text) <= 80 else text[:77] + '...'})"
    return [(key, message)]
