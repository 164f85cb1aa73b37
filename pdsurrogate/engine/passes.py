"""Passes over a body: functions that work on one chunk of its points or pairs, run on all of
numba's threads by one parallel driver.

numba compiles a function with ``prange`` twice, and code that unpacks its array arguments, which
takes as long as all other compilation. A pass is therefore a serial function of a chunk, which the
driver, compiled once for all passes, calls by its address. A pass receives its arrays once, when it
is bound: a call costs a microsecond or two in addition to the work itself.
"""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numba
import numpy as np
from llvmlite import ir
from numba import prange, types
from numba.core.ccallback import CFunc
from numba.extending import intrinsic

from .block_arrays import CACHE_LINE, add_to, aligned_rows, array_over
from .compile import (
    compile_block_function,
    compiled_digest,
    expanded,
    inlined,
    kernel,
    parallel_kernel,
)
from .threads import Chunks, chunks_of, threads_are_lost

CHUNK_FUNCTION = types.int64(types.CPointer(types.int64), types.int64, types.int64, types.int64)
"""Signature ``function(arguments, thread, chunk, chunks)`` of the functions that the driver calls;
they return a count, such as the number of invalid states in the chunk.
"""


@intrinsic
def _call_chunk(typingctx, code, arguments, thread, chunk, chunks):
    """Call the compiled function at address `code` on one chunk and return its count, see
    `CHUNK_FUNCTION`.

    `arguments` is the address of an array of 64-bit words, the arguments of the function.
    """
    signature = types.int64(*[types.int64] * 5)

    def codegen(context, builder, signature, values):
        word = ir.IntType(64)
        function = ir.FunctionType(word, [word.as_pointer(), word, word, word])
        arguments = builder.inttoptr(values[1], word.as_pointer())
        return builder.call(
            builder.inttoptr(values[0], function.as_pointer()), [arguments, *values[2:]]
        )

    return signature, codegen


@parallel_kernel
def _run_on_threads(calls, following, counts, found, times):
    """Run passes one after another, the chunks of each pass in parallel on threads; again and again
    as `_run_here` does.

    A row of `calls` holds the addresses of the code and of the arguments of a pass, and its number
    of chunks. Each thread has the same share of the chunks in every pass, so that its data stay in
    its cache. A thread that has finished takes over chunks that others have not begun: a late
    thread delays the others by at most one chunk, not by its whole share. `following` and `counts`
    are working memory; `found` receives the count that each pass returns.
    """
    threads = following.shape[0]
    done = 0
    while done < max(times, 1):
        for number in range(calls.shape[0]):
            code = calls[number, 0]
            arguments = calls[number, 1]
            chunks = calls[number, 2]
            for owner in range(threads):
                following[owner, 0] = owner * chunks // threads
            for thread in prange(threads):
                count = 0
                for step in range(threads):
                    owner = (thread + step) % threads
                    end = (owner + 1) * chunks // threads
                    chunk = add_to(following[owner], 0, 1)
                    while chunk < end:
                        count += _call_chunk(code, arguments, thread, chunk, chunks)
                        chunk = add_to(following[owner], 0, 1)
                counts[number, thread] = count
            found[number] = 0
            for thread in range(threads):
                found[number] += counts[number, thread]
            if times > 0 and found[number] != 0:
                return done
        done += 1
    return done


@kernel
def _run_here(calls, found, times):
    """Run passes one after another, chunk by chunk, on the calling thread; once if `times` is 0,
    else so many times, or until a pass returns a count. Return how many times all passes have run.

    A row of `calls` holds the addresses of the code and of the arguments of a pass, and its number
    of chunks; `found` receives the count that each pass returns.
    """
    done = 0
    while done < max(times, 1):
        for number in range(calls.shape[0]):
            found[number] = 0
            for chunk in range(calls[number, 2]):
                found[number] += _call_chunk(
                    calls[number, 0], calls[number, 1], 0, chunk, calls[number, 2]
                )
            if times > 0 and found[number] != 0:
                return done
        done += 1
    return done


Kind: TypeAlias = "type | tuple"
"""Kind of an argument of a pass, on which its code depends: ``int``, ``float``, type and number of
dimensions of an array, or a tuple of kinds. While bonds break many passes are bound, and a kind is
found and compared faster than the numba type of the argument.
"""


def _unpacker(numba_types: tuple[types.Type, ...]):
    """Return an intrinsic that reads the arguments of a pass, of the given numba types, from a
    vector of 64-bit words.

    `_described` makes the words.
    """

    @intrinsic
    def unpack(typingctx, words):
        def codegen(context, builder, signature, values):
            places = itertools.count()

            def word():
                return builder.load(
                    builder.gep(
                        values[0], [ir.Constant(ir.IntType(64), next(places))], inbounds=True
                    )
                )

            def read(one):
                if isinstance(one, types.BaseTuple):
                    return context.make_tuple(builder, one, [read(item) for item in one.types])
                if isinstance(one, types.Array):
                    data = builder.inttoptr(word(), context.get_data_type(one.dtype).as_pointer())
                    return array_over(
                        context, builder, one, data, [word() for _ in range(one.ndim)]
                    )
                return word() if one == types.int64 else builder.bitcast(word(), ir.DoubleType())

            return read(signature.return_type)

        return types.Tuple(numba_types)(words), codegen

    return unpack


def _described(name: str, value) -> tuple[Kind, list[int]]:
    """Return the kind of an argument of a pass, and the 64-bit words that hold it: an array's
    address and shape, or a number.

    A tuple has the words of its items. Raise TypeError, with the argument's name, for an array that
    is not in C order.
    """
    if isinstance(value, tuple):
        kinds, words = zip(*(_described(name, item) for item in value), strict=True)
        return kinds, list(itertools.chain(*words))
    if isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise TypeError(f"{name} must be an array in C order")
        return (value.dtype, value.ndim), [_address(value), *value.shape]
    if isinstance(value, float | np.floating):
        return float, [int(np.float64(value).view(np.int64))]
    return int, [int(value)]


def _type_of(kind: Kind) -> types.Type:
    """Return the numba type of the arguments of a kind; read-only arrays share the code of
    writable ones.
    """
    if kind in (int, float):
        return types.int64 if kind is int else types.float64
    if isinstance(kind[0], np.dtype):
        return types.Array(numba.from_dtype(kind[0]), kind[1], "C")
    return types.Tuple([_type_of(item) for item in kind])


class Chunk(NamedTuple):
    """Chunk of a body that a pass works on: its number, the number of all chunks, and the number
    of the thread that runs the pass.
    """

    number: int
    of: int
    thread: int


ENTRY = """
def entry(arguments, thread, number, of):
    items = unpack(arguments)
    found = function(Chunk(number, of, thread), {})
    return 0 if found is None else found
"""
"""Function that reads the arguments of a pass and runs the pass. Numba copies the code of the pass
into it, since it would optimize a pass that is called twice. It copies only functions whose
arguments are listed one by one.
"""


class Pass:
    """Function that works on one chunk of a body, compiled for the types of the arrays that it is
    bound to; used as a decorator.

    ``function(chunk, ...)`` works on a `Chunk` and returns a count, such as the number of invalid
    states in the chunk, or nothing. It can use working memory of the chunk's thread.
    """

    def __init__(self, function: Callable) -> None:
        self.function = function
        self.__doc__ = function.__doc__
        self.__name__ = function.__name__
        self.names = tuple(inspect.signature(function).parameters)[1:]
        self._code: dict[tuple, CFunc] = {}
        self._compiled = expanded(function)

    def bind(self, *arguments, chunks: Chunks | None = None) -> BoundPass:
        """Return the pass bound to `arguments`, the values of its parameters after `chunk`; by
        default it has one chunk for each thread.

        An argument is an array in C order, a number, or a tuple of these.
        """
        return BoundPass(self, arguments, chunks or chunks_of(0))

    def __call__(self, *arguments):
        """Run the pass once on all chunks with the given arguments, and return the sum of the
        counts of its chunks.
        """
        return self.bind(*arguments)()

    def address(self, kinds: tuple[Kind, ...]) -> int:
        """Return the address of the pass's code for arguments of the given kinds; the code is
        compiled at the first request.
        """
        if kinds not in self._code:
            numba_types = tuple(map(_type_of, kinds))
            unpack = _unpacker(numba_types)
            source = ENTRY.format(", ".join(f"items[{number}]" for number in range(len(kinds))))
            digest = compiled_digest(
                self.function, unpack, [str(one) for one in numba_types], source
            )
            # The entry counts as code of the module of the pass, beside which it is cached.
            names = {
                "unpack": unpack,
                "function": self._compiled,
                "Chunk": Chunk,
                "__name__": self.function.__module__,
            }
            exec(compile(source, self.function.__code__.co_filename, "exec"), names)
            names["entry"].__qualname__ = self.function.__qualname__
            self._code[kinds] = compile_block_function(names["entry"], CHUNK_FUNCTION, digest)
        return self._code[kinds].address


@inlined
def share_of(size, chunk):
    """Return the `range` of the indices of the items that belong to a chunk, where all chunks
    share `size` items.
    """
    return range(chunk.number * size // chunk.of, (chunk.number + 1) * size // chunk.of)


class BoundPass:
    """Pass bound to its arguments; a call runs it on all chunks, and returns the sum of the counts
    that it returns for them.

    A count is, for example, the number of invalid states in a chunk. A pass that runs often is
    called through a `Chain`, which keeps its working memory.
    """

    def __init__(self, what: Pass, arguments: tuple, chunks: Chunks) -> None:
        if len(arguments) != len(what.names):
            raise TypeError(
                f"{what.__name__} takes {len(what.names)} arguments, not {len(arguments)}"
            )
        self._pass = what
        self.arguments = dict(zip(what.names, arguments, strict=True))
        self._places = {}
        kinds = []
        words = []
        for name, value in self.arguments.items():
            self._places[name] = len(words)
            kind, of_value = _described(f"{what.__name__}: {name}", value)
            kinds.append(kind)
            words += of_value
        self._words = np.array(words, dtype=np.int64)
        self.threads = chunks.threads
        self.call = what.address(tuple(kinds)), _address(self._words), chunks.number

    def __call__(self) -> int:
        return Chain(self)()[0]

    def bound_to(self, **others) -> BoundPass:
        """Return the pass bound to the same arguments but some others."""
        chunks = Chunks(self.threads, self.call[2])
        return self._pass.bind(*(self.arguments | others).values(), chunks=chunks)

    def give(self, name: str, array: np.ndarray) -> None:
        """Replace the argument `name` of the bound pass by another array of the same type and
        shape; raise TypeError for others.
        """
        before = self.arguments[name]
        if array is before:
            return
        if (
            array.dtype != before.dtype
            or array.shape != before.shape
            or not array.flags.c_contiguous
        ):
            raise TypeError(
                f"{self._pass.__name__}: {name} must be an array in C order with the type and shape"
                " of the one it replaces"
            )
        self.arguments[name] = array
        self._words[self._places[name]] = _address(array)

    def give_number(self, name: str, number: float) -> None:
        """Replace the argument `name` of the bound pass, a floating-point number, by another
        one.
        """
        self.arguments[name] = number
        (self._words[self._places[name]],) = _described(name, float(number))[1]


class Chain:
    """Passes, bound for the same number of threads, that run one after another in a single call,
    which returns the count of each pass.

    Threads that wait between two passes do so more briefly than between two calls from Python, and
    do not fall asleep.
    """

    def __init__(self, *passes: BoundPass) -> None:
        self.passes = passes  # they keep code and arrays alive
        (threads,) = {bound.threads for bound in passes}
        self._calls = np.array([bound.call for bound in passes], dtype=np.int64)
        # the counter of each thread has a cache line
        self._following = aligned_rows((threads, CACHE_LINE // 8), np.int64)
        self._counts = np.zeros((len(passes), threads), dtype=np.int64)
        self._found = np.zeros(len(passes), dtype=np.int64)

    def __call__(self) -> list[int]:
        self.repeat(0)
        return self._found.tolist()

    def repeat(self, times: int) -> int:
        """Run the passes so many times in a single call, which ends with the first pass that
        returns a count; return how many times all of them have run.
        """
        if len(self._following) == 1 or threads_are_lost():
            return _run_here(self._calls, self._found, times)
        return _run_on_threads(self._calls, self._following, self._counts, self._found, times)


def _address(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]
