"""Kernels that are written once over an algebra and compiled for two or three dimensions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module


class ByDimension(Mapping):
    """What is written once over an algebra, made for a dimension when it is first asked for: a sheet compiles nothing of space.

    Parameters
    ----------
    build : callable
        ``build(algebra)``, given `pdsurrogate.kernels.algebra2` or `algebra3`.
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
