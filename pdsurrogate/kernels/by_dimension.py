"""Mapping from the dimension to a kernel that is written once over an algebra."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module


class ByDimension(Mapping):
    """Mapping from a dimension, 2 or 3, to the kernel built for it on first use; a sheet compiles nothing for three dimensions.

    It decorates ``build(algebra)``, which receives `pdsurrogate.kernels.algebra2` or `algebra3`.
    """

    def __init__(self, build: Callable) -> None:
        self._build, self._made = build, {}
        self.__doc__ = build.__doc__

    def __getitem__(self, dimension: int):
        if dimension not in self._made:
            self._made[dimension] = self._build(import_module(f".algebra{dimension}", __package__))
        return self._made[dimension]

    def __iter__(self):
        return iter((2, 3))

    def __len__(self) -> int:
        return 2
