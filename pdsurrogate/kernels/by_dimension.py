"""Kernels that are written once over an algebra and compiled for a dimension on first use."""

from collections.abc import Callable

from .algebra import algebra_of


class ByDimension(dict):
    """Table of the kernels that ``build(algebra)`` makes, by dimension, 2 or 3; it decorates `build`.

    The algebra is a module made by `pdsurrogate.kernels.algebra`. Each kernel is made on first use: a sheet compiles nothing for three
    dimensions.
    """

    def __init__(self, build: Callable) -> None:
        super().__init__()
        self._build = build
        self.__doc__ = build.__doc__

    def __missing__(self, dimension: int):
        """Return the kernel of a dimension, made now and kept."""
        self[dimension] = self._build(algebra_of(dimension))
        return self[dimension]
