"""Evaluation of the formulas that pages print: assignments in the LaTeX of the page of laws, read by a parser of its own."""

import re
from collections.abc import Callable
from typing import Any

import numpy as np

TOKEN = re.compile(r"\\[a-zA-Z]+|\d+(?:\.\d+)?|[A-Za-z]|[{}()|^_+\-=,']")
SPACES = re.compile(r"\\[,;! ]|\\q?quad\b")
Value = Callable[[dict], Any]


def assignments(formula: str) -> list[tuple[str, Value]]:
    """Return name and value of each assignment in a formula; assignments are separated by a comma and a wide space."""
    found = []
    for part in re.split(r",\s*\\qquad", formula):
        reader = _Reader(SPACES.sub(" ", part))
        name = reader.name()
        reader.take("=")
        found.append((name, reader.sum()))
        assert not reader.rest, f"not read: {reader.rest}"
    return found


class _Reader:
    """Recursive descent through the tokens of an expression; every rule returns a function of the values of the names."""

    def __init__(self, text: str) -> None:
        self.rest = TOKEN.findall(text)
        assert re.sub(r"\s", "", text) == "".join(self.rest), f"unknown signs in {text}"

    def ahead(self, *tokens: str) -> bool:
        return bool(self.rest) and self.rest[0] in tokens

    def take(self, *tokens: str) -> str:
        assert not tokens or self.ahead(*tokens), f"{tokens} expected before {self.rest}"
        return self.rest.pop(0)

    def name(self) -> str:
        """Read a name such as \\bar I_1, \\mu_k or \\beta_0'."""
        found = self.take() + " " + self.take() if self.ahead("\\bar") else self.take()
        if self.ahead("_"):
            found += self.take() + self.take()
        return found + self.take() if self.ahead("'") else found

    def sum(self) -> Value:
        sign = -1 if self.ahead("-") and self.take() else 1
        parts = [(sign, self.product())]
        while self.ahead("+", "-"):
            parts.append((1 if self.take() == "+" else -1, self.product()))
        return lambda names: sum(sign * part(names) for sign, part in parts)

    def product(self) -> Value:
        if self.ahead("\\sum"):
            for token in ("\\sum", "_", "k"):
                self.take(token)
            inner = self.product()
            return lambda names: sum(inner(names | {"k": k}) for k in range(1, 1 + self._count(inner, names)))
        factors = [self.power()]
        while self.rest and not self.ahead("+", "-", "}", ")", "\\right", "="):
            factors.append(self.power())
        return lambda names: np.prod(np.broadcast_arrays(*(factor(names) for factor in factors)), axis=0)

    @staticmethod
    def _count(term: Value, names: dict) -> int:
        """Return for how many k a term has values."""
        count = 0
        try:
            while True:
                term(names | {"k": count + 1})
                count += 1
        except IndexError:
            return count

    def power(self) -> Value:
        base = self.atom()
        if not self.ahead("^"):
            return base
        self.take("^")
        exponent = self.atom()
        return lambda names: base(names) ** exponent(names)

    def group(self) -> Value:
        self.take("{")
        inner = self.sum()
        self.take("}")
        return inner

    def atom(self) -> Value:
        if self.ahead("{"):
            return self.group()
        if self.ahead("(", "\\left"):
            opening = self.take() if self.ahead("(") else self.take() + self.take()
            inner = self.sum()
            if opening == "(":
                self.take(")")
            else:
                self.take("\\right")
                self.take(")", "\\rangle")
            return (lambda names: names["mean"](inner(names))) if opening.endswith("\\langle") else inner
        if self.ahead("\\frac", "\\tfrac"):
            self.take()
            above, below = self.group(), self.group()
            return lambda names: above(names) / below(names)
        for command, function in (("\\sqrt", np.sqrt), ("\\ln", np.log), ("\\sinh", np.sinh)):
            if self.ahead(command):
                self.take()
                argument = self.group() if command == "\\sqrt" else self.power()
                return lambda names: function(argument(names))
        if self.ahead("\\mathcal"):
            for token in ("\\mathcal", "{", "L", "}", "^", "{", "-", "1", "}"):
                self.take(token)
            argument = self.atom()
            return lambda names: names["inverse_langevin"](argument(names))
        if self.rest[0][0].isdigit():
            number = float(self.take())
            return lambda names: number
        name = self.name()
        if name.endswith("_k"):
            return lambda names: names[name][int(names["k"]) - 1]
        # An element of a list that has a name only with the index k.
        return lambda names: names[name] if name in names else names[name[:-1] + "k"][int(name[-1]) - 1]
