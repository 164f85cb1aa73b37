"""Amplitudes, by which prescribed values follow the loading parameter t: a ramp, a sine, a
table, or an expression of t.
"""

import ast
import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from types import CodeType
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from .strict_model import Finite

FUNCTIONS = {
    name: getattr(math, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "tanh")
}
FUNCTIONS |= {"abs": abs, "min": min, "max": max}
"""Functions that an expression of t may call."""

_NODES = (
    *(ast.Expression, ast.Name, ast.Constant, ast.Call, ast.Load),
    *(ast.BinOp, ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow, ast.UnaryOp, ast.UAdd, ast.USub),
)
"""Parts of the syntax of Python that an expression of t may have."""

NAMED = {"ramp": "t", "sine": "sin(2*pi*t)"}
"""Expressions of t for the amplitudes that have a name."""

LONGEST = 200
"""Greatest number of characters of an expression of t. Chosen: enough for sums of a few functions;
longer functions are given as tables, and Python's parser is kept from endless text.
"""


def _checked(value: Any) -> Any:
    """Return a valid amplitude, without spaces around text; raise ValueError unless it is ramp,
    sine, an expression of t, or a table.
    """
    if isinstance(value, str):
        value = value.strip()
        for t in (0.0, 1.0):
            amplitude_of(value)(t)
    elif isinstance(value, list | tuple):
        rows = [row for row in value if isinstance(row, list | tuple) and len(row) == 2]
        numbers = [number for row in rows for number in row]
        valid = all(
            isinstance(n, int | float) and not isinstance(n, bool) and math.isfinite(n)
            for n in numbers
        )
        if len(rows) < max(2, len(value)) or not valid:
            raise ValueError("a table needs at least two rows [t, value] of numbers")
        if any(later[0] <= earlier[0] for earlier, later in pairwise(value)):
            raise ValueError("the first column of a table, t, must increase from row to row")
    else:
        raise ValueError(
            f"must be ramp, sine, an expression of t, or a table of rows [t, value], not {value!r}"
        )
    return value


Amplitude = Annotated[str | tuple[tuple[Finite, Finite], ...], BeforeValidator(_checked)]
"""``"ramp"`` (t itself), ``"sine"`` (sin 2 pi t), an expression such as ``"1 - exp(-t)"``, or a
table of rows [t, value].
"""


@cache
def amplitude_of(amplitude: str | tuple) -> Callable[[float], float]:
    """Return the function of the loading parameter t that an amplitude describes; equal amplitudes
    share one function object.

    A table is linear between its rows and constant beyond them. The function raises ValueError at a
    t where an expression has no finite value.

    Examples
    --------
    >>> (
    ...     amplitude_of("ramp")(0.25),
    ...     amplitude_of("2*t**2")(0.5),
    ...     amplitude_of(((0, 0), (1, 2)))(0.25),
    ... )
    (0.25, 0.5, 0.5)
    """
    if not isinstance(amplitude, str):
        times, values = np.array(amplitude, dtype=float).T
        return lambda t: float(np.interp(t, times, values))
    code, names = (
        _compiled(NAMED.get(amplitude, amplitude)),
        {
            "__builtins__": {},
            "pi": math.pi,
            **FUNCTIONS,
        },
    )

    def value_at(t: float) -> float:
        try:
            value = float(eval(code, names, {"t": float(t)}))
        except (ArithmeticError, ValueError, TypeError) as error:
            raise ValueError(
                f"the amplitude {amplitude!r} has no value at t = {t:g}: {error}"
            ) from None
        if not math.isfinite(value):
            raise ValueError(f"the amplitude {amplitude!r} is not finite at t = {t:g}")
        return value

    return value_at


def _compiled(text: str) -> CodeType:
    """Return the compiled code of an expression of t, which is safe to run.

    Anything but numbers, + - * / **, parentheses, t, pi and `FUNCTIONS` raises ValueError.
    """
    if len(text) > LONGEST:
        raise ValueError(f"an expression of t has at most {LONGEST} characters")
    try:
        tree = ast.parse(text, mode="eval")
        for node in ast.walk(tree):
            _check_node(node, text)
        return compile(tree, "<amplitude>", "eval")
    except (SyntaxError, MemoryError, RecursionError):
        raise ValueError(
            f"{text!r} is not an expression of t; write ramp, sine, or for example 1 - exp(-t)"
        ) from None


def _check_node(node: ast.AST, text: str) -> None:
    """Raise ValueError if a node of the syntax tree of `text` is not allowed in an expression of t.

    A number is turned in place into a float, because powers of integers would grow without bound.
    """
    if isinstance(node, ast.Name) and node.id not in ("t", "pi", *FUNCTIONS):
        known = f"t, pi and {', '.join(FUNCTIONS)}; ramp and sine are complete amplitudes"
        raise ValueError(
            f"{text!r}: unknown name {node.id!r}; an expression of t may contain {known}"
        )
    if isinstance(node, ast.Call) and (
        not isinstance(node.func, ast.Name) or node.func.id not in FUNCTIONS or node.keywords
    ):
        raise ValueError(f"{text!r}: only {', '.join(FUNCTIONS)} can be called")
    if not isinstance(node, _NODES):
        raise ValueError(
            f"{text!r}: an expression of t may contain only numbers, + - * / **, parentheses and"
            " functions"
        )
    if isinstance(node, ast.Constant):
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            raise ValueError(f"{text!r}: {node.value!r} is not a number")
        node.value = float(node.value)
