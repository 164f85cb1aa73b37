"""Functions of pipelines with a readable ``repr`` and the names of their columns."""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper


class NamedFunction:
    """Function of a module whose ``repr`` is its name, with the names of the columns of X and y that it reads, None for any.

    A pickle holds the module and the name only, as that of a plain function does.
    """

    def __init__(self, function: Callable, columns: tuple[str, ...] | None = None, targets: tuple[str, ...] | None = None) -> None:
        update_wrapper(self, function)
        self.columns, self.targets = columns, targets

    def __call__(self, *args, **kwargs):
        return self.__wrapped__(*args, **kwargs)

    def __repr__(self) -> str:
        return self.__name__

    def __reduce__(self) -> str:
        return self.__qualname__


def named(columns: tuple[str, ...] | None = None, targets: tuple[str, ...] | None = None) -> Callable[[Callable], NamedFunction]:
    """Return a decorator that makes a `NamedFunction`."""
    return lambda function: NamedFunction(function, columns, targets)


def columns_read(function) -> tuple[tuple[str, ...] | None, tuple[str, ...] | None]:
    """Return the names of the columns of X and y that a function, or a partial of one, reads; None where it has no names."""
    function = getattr(function, "func", function)
    return getattr(function, "columns", None), getattr(function, "targets", None)
