"""Functions that pipelines are made of: shown, copied and stored by their names."""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper


class NamedFunction:
    """A function of a module whose ``repr`` is its name, with the names of the columns that it reads.

    A pickle holds the module and the name, as that of a plain function does.

    Attributes
    ----------
    columns, targets : tuple of str, or None
        Names of the columns of X and of y; None where the function does not care.
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
    """Return names of the columns of X and y that a function, or a partial of one, reads; None where it names none."""
    function = getattr(function, "func", function)
    return getattr(function, "columns", None), getattr(function, "targets", None)
