"""Passes over a body: functions that work on one chunk of it, run on all of numba's threads by one small parallel driver.

numba compiles a function with ``prange`` twice and its arrays' handling besides, which takes as long as all else.  A pass is therefore a
serial function of a chunk; the driver, compiled once for all of them, calls it by its address.  The arrays of a pass are handed over
once, when it is bound: a call costs a microsecond or two, whatever it works on.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from importlib import import_module

import numba
import numpy as np
from llvmlite import ir
from numba import prange, types
from numba.core import cgutils
from numba.core.ccallback import CFunc
from numba.extending import intrinsic, overload

from .compile import INLINE_OPTIONS, compile_block_function, compiled_digest, inlined, kernel, parallel_kernel, plain_function
from .threads import threads_in_use

CHUNK_FUNCTION = types.int64(types.CPointer(types.int64), types.int64, types.int64)
"""``function(arguments, chunk, chunks)``: what the driver calls; returns a count."""


@intrinsic
def _call_chunk(typingctx, address, arguments, chunk, chunks):
    """Call the function at an address on one chunk; see `CHUNK_FUNCTION`."""
    signature = types.int64(address, arguments, types.int64, types.int64)

    def codegen(context, builder, signature, values):
        data = context.make_array(signature.args[1])(context, builder, values[1]).data
        function = ir.FunctionType(ir.IntType(64), [data.type, ir.IntType(64), ir.IntType(64)])
        return builder.call(builder.inttoptr(values[0], function.as_pointer()), [data, values[2], values[3]])

    return signature, codegen


@parallel_kernel
def _run_on_threads(address, arguments, counts):
    """Run a pass, its chunks in parallel; returns the sum of their counts."""
    for chunk in prange(counts.shape[0]):
        counts[chunk] = _call_chunk(address, arguments, chunk, counts.shape[0])
    total = 0
    for chunk in range(counts.shape[0]):
        total += counts[chunk]
    return total


@kernel
def _run_here(address, arguments):
    """Run a pass as one chunk, on the thread that calls."""
    return _call_chunk(address, arguments, 0, 1)


def _count(found):
    """What a pass has counted; 0 where it counts nothing."""
    return found


@overload(_count, jit_options=INLINE_OPTIONS)
def _count_of(found):
    if isinstance(found, types.NoneType):
        return lambda found: 0
    return lambda found: found


def _unpacker(kinds: tuple):
    """An intrinsic that reads the arguments of a pass from the words that `BoundPass` wrote: of an array its address and shape."""

    @intrinsic
    def unpack(typingctx, words):
        def codegen(context, builder, signature, values):
            at, found = 0, []

            def word():
                nonlocal at
                value = builder.load(builder.gep(values[0], [ir.Constant(ir.IntType(64), at)], inbounds=True))
                at += 1
                return value

            for kind in kinds:
                if not isinstance(kind, types.Array):
                    value = word()
                    found.append(value if kind == types.int64 else builder.bitcast(value, ir.DoubleType()))
                    continue
                size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
                data = builder.inttoptr(word(), context.get_data_type(kind.dtype).as_pointer())
                shape = [word() for _ in range(kind.ndim)]
                strides, stride = [], ir.Constant(ir.IntType(64), size)
                for extent in reversed(shape):
                    strides.insert(0, stride)
                    stride = builder.mul(stride, extent)
                array = context.make_array(kind)(context, builder)
                context.populate_array(
                    array,
                    data=data,
                    shape=cgutils.pack_array(builder, shape),
                    strides=cgutils.pack_array(builder, strides),
                    itemsize=ir.Constant(ir.IntType(64), size),
                    meminfo=None,
                    parent=None,
                )
                found.append(array._getvalue())
            return context.make_tuple(builder, signature.return_type, found)

        return types.Tuple(kinds)(words), codegen

    return unpack


class Pass:
    """A function of a chunk, compiled for the arrays that it is bound to.

    Parameters
    ----------
    function : callable
        ``function(chunk, chunks, ...)`` works on its share of the body and returns a count, or nothing.
    """

    def __init__(self, function: Callable) -> None:
        self.function = function
        self.__doc__, self.__name__ = function.__doc__, function.__name__
        self.names = tuple(inspect.signature(function).parameters)[2:]
        self._code: dict[tuple, CFunc] = {}
        self._compiled = plain_function(function)

    def bind(self, *arguments, chunks: int | None = None) -> BoundPass:
        """Hand over the arguments, arrays in C order and numbers.

        Parameters
        ----------
        *arguments
            As the function takes them after chunk and chunks.
        chunks : int, optional
            By default as many as numba has threads now.
        """
        return BoundPass(self, arguments, chunks or threads_in_use())

    def __call__(self, *arguments):
        """Run once."""
        return self.bind(*arguments)()

    def address(self, kinds: tuple) -> int:
        """Of the code for arguments of the given numba types."""
        if kinds not in self._code:
            function, unpack = self._compiled, _unpacker(kinds)
            digest = compiled_digest(self.function, unpack, _count, [str(kind) for kind in kinds])

            def entry(arguments, chunk, chunks):
                return _count(function(chunk, chunks, *unpack(arguments)))

            entry.__qualname__ = self.function.__qualname__
            self._code[kinds] = compile_block_function(entry, CHUNK_FUNCTION, digest)
        return self._code[kinds].address


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


@inlined
def share_of(size, chunk, chunks):
    """First and last but one of what falls to a chunk of so many things."""
    return chunk * size // chunks, (chunk + 1) * size // chunks


class BoundPass:
    """A pass with the arrays that it works on; called, it runs over all chunks and returns the sum of their counts."""

    def __init__(self, what: Pass, arguments: tuple, chunks: int) -> None:
        if len(arguments) != len(what.names):
            raise TypeError(f"{what.__name__} takes {len(what.names)} arguments, not {len(arguments)}")
        self._pass, self._kept, self._places = what, dict(zip(what.names, arguments, strict=True)), {}
        kinds, words = [], []
        for name, value in self._kept.items():
            self._places[name] = len(words)
            kind = numba.typeof(value)
            if isinstance(value, np.ndarray):
                if kind.layout != "C" or not value.flags.c_contiguous:
                    raise TypeError(f"{what.__name__}: {name} must be an array in C order")
                words += [_address(value), *value.shape]
            elif isinstance(value, float | np.floating):
                kind = types.float64
                words.append(int(np.float64(value).view(np.int64)))
            else:
                kind = types.int64
                words.append(int(value))
            # Whether an array may be written to says nothing about the code.
            kinds.append(types.Array(kind.dtype, kind.ndim, "C") if isinstance(kind, types.Array) else kind)
        self._words = np.array(words, dtype=np.int64)
        self._counts = np.zeros(chunks, dtype=np.int64)
        self._code = what.address(tuple(kinds))

    def __call__(self) -> int:
        if len(self._counts) == 1:
            return _run_here(self._code, self._words)
        return _run_on_threads(self._code, self._words, self._counts)

    def give(self, name: str, array: np.ndarray) -> None:
        """Put another array of the same kind in the place of an argument."""
        before = self._kept[name]
        if array is before:
            return
        if array.dtype != before.dtype or array.shape != before.shape or not array.flags.c_contiguous:
            raise TypeError(f"{self._pass.__name__}: {name} must be an array like the one before, in C order")
        self._kept[name] = array
        self._words[self._places[name]] = _address(array)


def _address(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]
