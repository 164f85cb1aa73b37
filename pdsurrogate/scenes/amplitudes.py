"""Amplitudes, by which prescribed values follow the loading parameter t: a ramp, a sine, a
table, or an expression of t.
"""

import ast
import math
from collections.abc import Callable
from functools import cache, lru_cache
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
    *(ast.Expression, ast.Name, ast.Call, ast.Load),
    *(ast.BinOp, ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow, ast.UnaryOp, ast.UAdd, ast.USub),
)
"""Parts of the syntax of Python that an expression of t may have."""

NAMED = {"ramp": "t", "sine": "sin(2*pi*t)"}
"""Expressions of t for the amplitudes that have a name."""

SAMPLES = 1001
"""Values of an expression among which `turns_of` searches: a turn is off by a thousandth of the
interval at most, where the value is off by the square of that.
"""

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
        return value
    try:
        table = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        table = np.empty(0)
    if (
        table.ndim != 2
        or table.shape[1] != 2
        or len(table) < 2
        or (np.diff(table[:, 0]) <= 0).any()
    ):
        raise ValueError(
            "must be ramp, sine, an expression of t, or a table of at least two rows [t, value] of"
            f" numbers whose first column increases, not {value!r}"
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
    code = _compiled(NAMED.get(amplitude, amplitude))
    names = {"__builtins__": {}, "pi": math.pi, **FUNCTIONS}

    # of several supports and loads at the same times
    @lru_cache
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


def turns_of(amplitude: str | tuple, begin: float, end: float) -> list[float]:
    """Return the values of t between two others at which an amplitude may turn: rows of a table,
    or where `SAMPLES` values of an expression are greatest or least among their neighbors.

    Examples
    --------
    >>> turns_of(((0, 0), (1, 2), (3, 0)), 0.0, 2.0), turns_of("ramp", 0.0, 1.0)
    ([1.0], [])
    """
    if not isinstance(amplitude, str):
        return [float(t) for t, _ in amplitude if begin < t < end]
    t = np.linspace(begin, end, SAMPLES)
    slopes = np.diff(list(map(amplitude_of(amplitude), t)))
    return t[1:-1][slopes[1:] * slopes[:-1] < 0].tolist()


def values_of(amplitude: str, begin: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Return `SAMPLES` values of an expression between two values of t, and where they are, from 0
    to 1: unevenly, so that no oscillation falls in with them.

    Examples
    --------
    >>> where, values = values_of("sin(1000*pi*t)**2", 0.0, 1.0)
    >>> bool(where[0] == 0 and where[-1] == 1), float(values.max().round(3))
    (True, 1.0)
    """
    number = np.arange(SAMPLES)
    where = (number + number * (5**0.5 - 1) / 2 % 1) / SAMPLES
    where[-1] = 1.0
    return where, np.array(list(map(amplitude_of(amplitude), begin + where * (end - begin))))


def _compiled(text: str) -> CodeType:
    """Return the compiled code of an expression of t, which is safe to run.

    Anything but numbers, + - * / **, parentheses, t, pi and `FUNCTIONS` raises ValueError. Numbers
    become floats, because powers of integers would grow without bound.
    """
    if len(text) > LONGEST:
        raise ValueError(f"an expression of t has at most {LONGEST} characters")
    try:
        tree = ast.parse(text, mode="eval")
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and type(node.value) in (int, float):
                node.value = float(node.value)
            elif (
                not isinstance(node, _NODES)
                or (isinstance(node, ast.Name) and node.id not in ("t", "pi", *FUNCTIONS))
                or (isinstance(node, ast.Call) and node.keywords)
            ):
                raise SyntaxError
        return compile(tree, "<amplitude>", "eval")
    except (SyntaxError, MemoryError, RecursionError, OverflowError):
        raise ValueError(
            f"{text!r} is not an expression of t: write ramp, sine, or for example 1 - exp(-t); it"
            " may have numbers, + - * / **, parentheses, t, pi and the functions"
            f" {', '.join(FUNCTIONS)}"
        ) from None
