"""Amplitudes, by which prescribed values follow the loading parameter t: a ramp, a sine, a table, or an expression of t."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from .strict_model import Finite

FUNCTIONS = {
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "exp": math.exp,
    "log": math.log,
    "sqrt": math.sqrt,
    "tanh": math.tanh,
    "abs": abs,
    "min": min,
    "max": max,
}
"""Functions that an expression of t may call."""

_OPERATORS = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}

NAMED = {"ramp": "t", "sine": "sin(2*pi*t)"}
"""Amplitudes that have a name."""

LONGEST = 200
"""Characters of an expression."""


def _checked(value: Any) -> Any:
    """Refuse amplitudes that make no sense, before any work."""
    if isinstance(value, str):
        value = value.strip()
        compiled = _expression(value)
        for t in (0.0, 1.0):
            _value(compiled, value, t)
    elif isinstance(value, list | tuple):
        times = [row[0] for row in value if isinstance(row, list | tuple) and len(row) == 2]
        if len(times) != len(value) or len(times) < 2:
            raise ValueError("a table needs two rows [t, value] or more")
        numbers = [number for row in value for number in row]
        if not all(isinstance(n, int | float) and not isinstance(n, bool) and math.isfinite(n) for n in numbers):
            raise ValueError("a table holds numbers alone, in rows [t, value]")
        if any(later <= earlier for earlier, later in pairwise(times)):
            raise ValueError("the t of a table must rise from row to row")
    else:
        raise ValueError(f"must be ramp, sine, an expression of t, or a table of rows [t, value], not {value!r}")
    return value


Amplitude = Annotated[str | tuple[tuple[Finite, Finite], ...], BeforeValidator(_checked)]
"""``"ramp"`` (t itself), ``"sine"`` (sin 2 pi t), an expression such as ``"1 - exp(-t)"``, or a table of rows [t, value]."""


def amplitude_of(amplitude: str | tuple) -> Callable[[float], float]:
    """The amplitude as a function of t; a table is linear between its rows and constant beyond them.

    Examples
    --------
    >>> amplitude_of("ramp")(0.25), amplitude_of("2*t**2")(0.5), amplitude_of(((0, 0), (1, 2)))(0.25)
    (0.25, 0.5, 0.5)
    """
    if isinstance(amplitude, str):
        compiled = _expression(amplitude)
        return lambda t: _value(compiled, amplitude, t)
    times, values = np.array(amplitude, dtype=float).T
    return lambda t: float(np.interp(t, times, values))


def _expression(text: str) -> ast.expr:
    """Read an expression of t: numbers, + - * / **, parentheses, pi and `FUNCTIONS`; nothing else can be said."""
    text = NAMED.get(text, text)
    if len(text) > LONGEST:
        raise ValueError(f"an expression of t has at most {LONGEST} characters")
    try:
        tree = ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError):
        raise ValueError(f"{text!r} is no expression of t; written are ramp, sine, or for example 1 - exp(-t)") from None
    for node in ast.walk(tree):
        _check_node(node, text)
    return tree


def _check_node(node: ast.AST, text: str) -> None:
    if isinstance(node, ast.Name) and node.id not in ("t", "pi", *FUNCTIONS):
        raise ValueError(
            f"{text!r}: there is no {node.id!r}; an expression knows t, pi, {', '.join(FUNCTIONS)}, and the names ramp and sine"
        )
    if isinstance(node, ast.Constant) and (isinstance(node.value, bool) or not isinstance(node.value, int | float)):
        raise ValueError(f"{text!r}: {node.value!r} is no number")
    if isinstance(node, ast.Call) and (not isinstance(node.func, ast.Name) or node.func.id not in FUNCTIONS or node.keywords):
        raise ValueError(f"{text!r}: only {', '.join(FUNCTIONS)} can be called")
    known = ast.Name, ast.Constant, ast.Call, ast.BinOp, ast.UnaryOp, ast.UAdd, ast.USub, ast.Load, *_OPERATORS
    if not isinstance(node, known):
        raise ValueError(f"{text!r}: an expression of t has numbers, + - * / **, parentheses and functions alone")


def _value(tree: ast.expr, text: str, t: float) -> float:
    """The value at t.

    Raises
    ------
    ValueError
        If there is none, or it is not finite.
    """
    try:
        value = float(_evaluate(tree, t))
    except (ArithmeticError, ValueError, TypeError, RecursionError) as error:
        raise ValueError(f"the amplitude {text!r} has no value at t = {t:g}: {error}") from None
    if not math.isfinite(value):
        raise ValueError(f"the amplitude {text!r} is not finite at t = {t:g}")
    return value


def _evaluate(node: ast.expr, t: float) -> float:
    if isinstance(node, ast.Constant):
        return float(node.value)
    if isinstance(node, ast.Name):
        if node.id in FUNCTIONS:
            raise ValueError(f"{node.id} needs an argument")
        return t if node.id == "t" else math.pi
    if isinstance(node, ast.UnaryOp):
        value = _evaluate(node.operand, t)
        return -value if isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.BinOp):
        return _OPERATORS[type(node.op)](_evaluate(node.left, t), _evaluate(node.right, t))
    return FUNCTIONS[node.func.id](*(_evaluate(argument, t) for argument in node.args))
