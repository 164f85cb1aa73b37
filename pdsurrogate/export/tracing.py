"""Tracing of elementwise Python expressions, such as those of material laws, and their printing as
statements of other languages.

A function that is called with `Value` objects instead of numbers records its operations. The
recorded values are printed as statements, those that are used more than once as variables. Laws of
users are traced like those of the package.
"""

import math
import operator
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

BINARY = {"+": 1, "-": 1, "*": 2, "/": 2}
"""Arithmetic operators of two operands, with their precedence."""

COMPARISONS = ("<", "<=", ">", ">=", "==")
ARITHMETIC = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "neg": operator.neg,
    "power": operator.pow,
    **dict(
        zip(
            COMPARISONS,
            (operator.lt, operator.le, operator.gt, operator.ge, operator.eq),
            strict=True,
        )
    ),
}
"""Operations of numbers and of `Value` objects by their names in `Value.operation`."""

FUNCTIONS = {np.exp: "exp", np.log: "log", np.sqrt: "sqrt", np.tanh: "tanh", np.where: "where"}
"""Functions of NumPy that can be traced, by their names in `Value.operation`."""

UFUNCS = {
    np.add: "+",
    np.subtract: "-",
    np.multiply: "*",
    np.divide: "/",
    np.negative: "neg",
    np.power: "power",
    np.less: "<",
    np.less_equal: "<=",
    np.greater: ">",
    np.greater_equal: ">=",
    np.equal: "==",
    **FUNCTIONS,
}


@dataclass(frozen=True, eq=False)
class Value:
    """A value of a traced function: a number, a symbol, or the result of an operation on other
    values; equal values are one object.
    """

    operation: str
    operands: tuple

    def __array_ufunc__(self, function, method, *operands, **options):
        return _result(UFUNCS.get(function, function.__name__), *operands)

    def __array_function__(self, function, types, operands, options):
        if function is np.clip:  # `exponential` clips where the result would overflow
            return operands[0]
        return _result(FUNCTIONS.get(function, function.__name__), *operands)

    def __bool__(self):
        raise ValueError(
            "its expressions branch on a value: write np.where instead of if, min or max"
        )


def _operator(name: str, reflected: bool = False) -> Callable:
    return (
        (lambda one, other: _result(name, other, one))
        if reflected
        else lambda *operands: _result(name, *operands)
    )


for _name, _operation in ARITHMETIC.items():
    setattr(Value, f"__{_operation.__name__}__", _operator(_name))
    if _name in BINARY or _name == "power":
        setattr(Value, f"__r{_operation.__name__}__", _operator(_name, reflected=True))


@cache
def _stored(operation: str, *operands) -> Value:
    return Value(operation, operands)


def symbol(name: str) -> Value:
    """Return the value with a name, an argument of a traced function."""
    return _stored("symbol", name)


def constant(number) -> Value:
    """Return the value of a number; a value is returned unchanged."""
    if isinstance(number, Value):
        return number
    return _stored("number", np.nan if np.isnan(number) else float(number))


def _result(operation: str, *operands) -> Value:
    """Return the value of an operation; operations on numbers are carried out, and sums and
    products with 0 and 1 are shortened.
    """
    if operation not in (*ARITHMETIC, *FUNCTIONS.values()):
        raise ValueError(f"its expressions use {operation}, which cannot be exported")
    operands = tuple(map(constant, operands))
    numbers = [one.operands[0] if one.operation == "number" else None for one in operands]
    if operation in ARITHMETIC and None not in numbers:
        return constant(ARITHMETIC[operation](*numbers))
    if operation in ARITHMETIC and np.nan in numbers:
        return constant(np.nan)
    if operation == "where" and numbers[0] is not None:
        return operands[1] if numbers[0] else operands[2]
    if (operation in "+-" and numbers[-1] == 0) or (operation in "*/" and numbers[-1] == 1):
        return operands[0]
    if (operation == "+" and numbers[0] == 0) or (operation == "*" and numbers[0] == 1):
        return operands[1]
    # Laws multiply values by 0 in order to pass NaN on; an argument has none to pass.
    if operation == "*" and 0 in numbers and "symbol" in (one.operation for one in operands):
        return constant(0)
    if operation == "-" and numbers[0] == 0:
        return _result("neg", operands[1])
    return _stored(operation, *operands)


@dataclass(frozen=True)
class Language:
    """Form of numbers, statements and tables in a language.

    Attributes
    ----------
    functions : dict of str
        Forms of functions that differ from ``name(operands)``, with ``{0}`` for the first operand,
        and of NaN as ``nan``; ``sum``, if given, is that of a sum of more than two parts.
    line : callable
        ``line(statement)`` returns the lines of a statement in a function.
    row : callable
        ``row(number, literals)`` returns the lines of a row of a table; rows are counted from 1.
    number : callable
        ``number(text)`` returns the literal of a positive number from its shortest decimal text.
    assignment : str
        Assignment of ``{1}`` to a new local variable ``{0}``.
    element : callable, optional
        ``element(array, number)`` returns an element of an array, counted from 0; without it
        functions return single values.
    declaration : str, optional
        Declaration of the local variables ``{0}``.
    """

    functions: dict[str, str]
    line: Callable[[str], str]
    row: Callable[[int, list[str]], str]
    number: Callable[[str], str] = str
    assignment: str = "{0} = {1}"
    element: Callable[[str, int], str] | None = None
    declaration: str = ""

    def literal(self, number: float) -> str:
        """Return a number, with all its digits, as a literal."""
        text = (
            self.functions["nan"] if math.isnan(number) else self.number(repr(abs(float(number))))
        )
        return f"-{text}" if number < 0 else text

    def table(self, rows: np.ndarray) -> str:
        """Return the lines of a table of numbers."""
        return "\n".join(
            self.row(at, [self.literal(number) for number in row]) for at, row in enumerate(rows, 1)
        )

    def body(self, function: Callable, arguments: str, results: str, *more) -> str:
        """Return the statements of a function that is traced; names of arguments and results are
        separated by blanks.

        The array in which the results stand has the name of the first one. `more` are arguments
        after the named ones.
        """
        names = results.split()
        if self.element:
            names = [self.element(names[0], number) for number in range(len(names))]
        found = [constant(value) for value in function(*map(symbol, arguments.split()), *more)]
        order: dict[Value, None] = {}
        uses = Counter(found)

        def visit(value: Value) -> None:
            if value not in order and value.operation not in ("symbol", "number"):
                for one in value.operands:
                    uses[one] += 1
                    visit(one)
                order[value] = None

        for value in found:
            visit(value)
        local: dict[Value, str] = {}
        lines = []
        for value in order:
            # A comparison has no name of its own, since it is no number.
            if value.operation not in COMPARISONS and uses[value] > 1:
                name = f"t{len(local) + 1}"
                lines.append(self.assignment.format(name, _text(value, local, self)))
                local[value] = name
        if self.declaration and local:
            lines.insert(0, self.declaration.format(", ".join(local.values())))
        lines += [
            f"{name} = {_text(value, local, self)}"
            for name, value in zip(names, found, strict=True)
        ]
        if not self.element:
            lines.append(f"return {', '.join(names)}")
        return "\n".join(map(self.line, lines))


def _text(value: Value, local: dict[Value, str], language: Language, least: int = 0) -> str:
    """Return the expression of a value, in brackets if its operator has a lower precedence than
    `least`; `local` are named values.
    """
    if value in local:
        return local[value]
    operation = value.operation
    operands = value.operands
    if operation == "symbol":
        return operands[0]
    if operation == "number":
        text = language.literal(operands[0])
        return f"({text})" if operands[0] < 0 else text
    parts = _parts_of_sum(value, local) if "sum" in language.functions else ()
    if len(parts) > 2:
        texts = ", ".join(_text(part, local, language) for part in parts)
        return language.functions["sum"].format(texts)
    if operation in BINARY:
        precedence = BINARY[operation]
        left = _text(operands[0], local, language, precedence)
        right = _text(operands[1], local, language, precedence + (operation in "-/"))
        text = f"{left} {operation} {right}"
        return f"({text})" if precedence < least else text
    inner = [_text(one, local, language, 3 if operation == "neg" else 0) for one in operands]
    if operation == "neg":
        return f"(-{inner[0]})"
    if operation in COMPARISONS:
        return f"{inner[0]} {operation} {inner[1]}"
    form = language.functions.get(
        operation, f"{operation}({', '.join(f'{{{number}}}' for number in range(len(inner)))})"
    )
    return form.format(*inner)


def _parts_of_sum(value: Value, local: dict[Value, str]) -> list[Value]:
    """Return the parts of a sum of sums, up to values with names; else the value alone."""
    if value.operation != "+" or value in local:
        return [value]
    return [part for one in value.operands for part in _parts_of_sum(one, local)]
