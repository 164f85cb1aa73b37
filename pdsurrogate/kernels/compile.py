"""How every kernel of the project is compiled, cached and handed around.

Three kinds of compiled code exist:

* ``kernel`` and ``parallel_kernel``: functions on plain arrays, compiled for the types they are called with;
* *block functions*: loops over a block of states, compiled for an explicit signature on pointers and handed to the
  kernels by their address. A kernel that takes one is compiled once, whatever material law or network stands behind
  the address.

All are cached on disk.  numba keys its cache by the file a function stands in and does not see changes in the functions it calls, so the
key used here also carries a digest of all sources of this package.
"""

from __future__ import annotations

import hashlib
import inspect
import time
from collections.abc import Callable
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import event
from numba.core.caching import FunctionCache
from numba.core.ccallback import CFunc
from numba.extending import intrinsic, is_jitted, register_jitable

# `nnan` and `ninf` are left out on purpose: they delete the tests by which the solver finds a diverging run.
FASTMATH = {"nsz", "arcp", "contract", "afn", "reassoc"}

# Without error_model="numpy" every division may raise, and no loop with a division is vectorised.
OPTIONS = {"error_model": "numpy", "fastmath": FASTMATH}

# Functions called within a vectorised loop must carry the same options, and be part of the loop's own code.
INLINE_OPTIONS = {**OPTIONS, "forceinline": True}


@lru_cache(maxsize=1)
def source_digest() -> str:
    """Digest of all sources of `pdsurrogate.kernels`, part of every cache key."""
    folder = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted(folder.glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


class SourceKeyedCache(FunctionCache):
    """numba's disk cache with the package's source digest in the key."""

    def _index_key(self, sig, codegen):
        return (*super()._index_key(sig, codegen), source_digest())


def _enable_cache(compiled, function: Callable) -> None:
    # Without a source file (an interactive session) or a writable folder there is no cache, and each process compiles anew.
    with suppress(RuntimeError):
        compiled._cache = SourceKeyedCache(function)


def kernel(function: Callable) -> Callable:
    """Compile a function on plain arrays, cached on disk."""
    dispatcher = numba.njit(**OPTIONS)(function)
    _enable_cache(dispatcher, function)
    return dispatcher


def inline(function: Callable) -> Callable:
    """Compile an elementwise function into the code of every kernel that calls it."""
    dispatcher = numba.njit(**INLINE_OPTIONS)(function)
    _enable_cache(dispatcher, function)
    return dispatcher


def parallel_kernel(function: Callable) -> Callable:
    """As `kernel`, with ``prange`` loops spread over numba's threads."""
    dispatcher = numba.njit(parallel=True, **OPTIONS)(function)
    _enable_cache(dispatcher, function)
    return dispatcher


_real = types.CPointer(types.float64)

STRESS_RESPONSE = types.void(_real, _real, _real)
"""``response(states, parameters, result)`` over the rows of a block; see `pdsurrogate.materials.law` for the rows."""


def bond_force_signature(dtype):
    """``bond_force(states, sizes, weights, response, parameters, work, scratch, traction)``; see `pdsurrogate.forces.protocol`.

    ``sizes`` and ``weights`` are the model's own constants; ``response`` and ``parameters`` are the material law's,
    for models computed from it; ``work`` and ``scratch`` are rows for intermediate values, in the model's precision
    and in double.
    """
    real = types.CPointer(types.float32 if np.dtype(dtype) == np.float32 else types.float64)
    return types.void(real, types.CPointer(types.int64), real, types.int64, _real, real, _real, real)


@intrinsic
def call_block(typingctx, address, *arguments):
    """Call the block function at an address; arrays are handed over as pointers to their data.

    numba's own first-class functions would do, but take some 40 microseconds to unpack at every call of a kernel.  Nothing checks that the
    arguments fit: the signatures above are the contract.
    """
    arguments = arguments[0] if len(arguments) == 1 and isinstance(arguments[0], types.BaseTuple) else arguments
    signature = types.void(address, types.StarArgTuple(arguments))

    def codegen(context, builder, signature, values):
        passed = []
        for position, kind in enumerate(signature.args[1].types):
            value = builder.extract_value(values[1], position)
            if isinstance(kind, types.Array):
                value = context.make_array(kind)(context, builder, value).data
            passed.append(value)
        function = ir.FunctionType(ir.VoidType(), [value.type for value in passed])
        builder.call(builder.inttoptr(values[0], function.as_pointer()), passed)
        return context.get_dummy_value()

    return signature, codegen


@intrinsic
def widest_vectors(typingctx):
    """Let LLVM use the processor's widest vectors in the function this stands in.

    LLVM keeps to 256 bits on processors with AVX-512, for the sake of code whose few wide instructions would lower the clock of all else;
    here they are most of the work.  Where there are none wider, this changes nothing.  Spilled registers are aligned, too.
    """

    def codegen(context, builder, signature, arguments):
        # llvmlite knows no attributes with a value; added past its check they are written out as they stand.  Inlined, the function would
        # lose them.
        set.update(builder.function.attributes, {'"prefer-vector-width"="512"', '"stackrealign"', "noinline"})
        return context.get_dummy_value()

    return types.void(), codegen


def compile_block_function(function: Callable, signature) -> CFunc:
    """Compile a block function for one signature, cached on disk; its ``address`` is what kernels take."""
    compiled = CFunc(function, numba.core.sigutils.normalize_signature(signature), locals={}, options=dict(OPTIONS))
    _enable_cache(compiled, function)
    compiled.compile()
    return compiled


def inlined(function: Callable) -> tuple[Callable, str]:
    """Prepare a plain elementwise function for use inside a block function written around it.

    Returns
    -------
    function : callable
        The function itself, now callable from compiled code (and still from Python, on arrays).
    fingerprint : str
        Digest of the function and of the file it stands in.  A block function that closes over both is cached on disk under a key that
        changes when the function does.
    """
    if is_jitted(function):
        function = function.py_func
    code = function.__code__
    digest = hashlib.sha256(code.co_code + repr((code.co_consts, code.co_names)).encode())
    # A function defined in an interactive session has no file: its own code is all there is.
    with suppress(OSError, TypeError):
        digest.update(Path(inspect.getfile(function)).read_bytes())
    return register_jitable(**INLINE_OPTIONS)(function), digest.hexdigest()


class CompilationClock(event.Listener):
    """Sums the seconds spent compiling, and says once that compiling has begun.

    Loading from the disk cache runs no compiler pass and counts as nothing.
    """

    def __init__(self, announce: Callable[[], None] | None = None) -> None:
        self.seconds = 0.0
        self._depth = 0
        self._began = 0.0
        self._announce = announce

    def on_start(self, event) -> None:
        if self._depth == 0:
            self._began = time.perf_counter()
            if self._announce is not None:
                self._announce()
                self._announce = None
        self._depth += 1

    def on_end(self, event) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._began


@contextmanager
def compilation_clock(announce: Callable[[], None] | None = None):
    """Context in which compile time is measured; yields the `CompilationClock`."""
    clock = CompilationClock(announce)
    event.register("numba:run_pass", clock)
    try:
        yield clock
    finally:
        event.unregister("numba:run_pass", clock)


@contextmanager
def thread_count(threads: int | None):
    """Context in which the kernels use `threads` threads (all that numba was started with if None); yields their number.

    Raises
    ------
    ValueError
        If there are not so many.
    """
    most = numba.config.NUMBA_NUM_THREADS
    if threads is not None and not 1 <= threads <= most:
        raise ValueError(f"threads must be between 1 and {most} on this machine, not {threads}")
    before = numba.get_num_threads()
    numba.set_num_threads(threads or most)
    try:
        yield threads or most
    finally:
        numba.set_num_threads(before)
