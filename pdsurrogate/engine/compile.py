"""Compilation of all numerical code of the project, its cache on disk, and calls of compiled code
by address.

There are three kinds of compiled code:

* ``kernel`` and ``parallel_kernel``: functions on plain arrays, compiled for the types they are
  called with;
* *passes* (`pdsurrogate.engine.passes`): functions on a chunk of a body, bound to their arrays and
  run on threads;
* *block functions*: loops over a block of states, compiled for an explicit signature on pointers
  and called by their address. A pass that calls a block function is compiled once, whatever
  material law or network the address belongs to.

All are cached on disk, in files named by a digest of everything that their code depends on
(`pdsurrogate.engine.keys`): a change of a called function or of a constant recompiles the function,
and nothing else does.
"""

from __future__ import annotations

import logging
import pickle
import sys
import time
import types as python_types
import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NoReturn

import numba
import numpy as np
from llvmlite import ir
from numba import carray, types
from numba.core import event
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.ccallback import CFunc
from numba.core.runtime import rtsys
from numba.extending import is_jitted, register_jitable

from ..errors import CompilerSwitchedOff
from .block_arrays import BLOCK, SCRATCH_ROWS, STATE_ROWS, TRACTION_ROWS
from .intrinsics import writes
from .keys import NotKeyable, code_digest
from .threads import start_threads

logger = logging.getLogger(__name__)

LONGEST_WAIT = 60.0
"""Greatest number of seconds that a process waits for another one to compile a function. Chosen:
ten times what the slowest function takes on a free core. The lock of a process that has ended is
free.
"""

# `nnan` and `ninf` are left out on purpose: they delete the tests by which the solver detects a
# diverging run.
FASTMATH = {"nsz", "arcp", "contract", "afn", "reassoc"}

# Without error_model="numpy" every division may raise, and no loop with a division is vectorized.
OPTIONS = {"error_model": "numpy", "fastmath": FASTMATH}

# Functions called within a vectorized loop must have the same options and be inlined into the loop.
INLINE_OPTIONS = {**OPTIONS, "forceinline": True}


def compiled_digest(*values) -> str:
    """Return the digest of the compiler options and of `values`, functions and plain values on
    which compiled code depends.
    """
    return code_digest(*values, OPTIONS, INLINE_OPTIONS)


class CacheFile(IndexDataCacheFile):
    """Files of numba's disk cache for one function, with a checksum; only one process at a time
    compiles the function.

    Files that cannot be read, as after a full disk or a power cut, count as missing and are written
    again.
    """

    def __init__(self, *arguments) -> None:
        super().__init__(*arguments)
        self._mark = Path(f"{self._index_path}.compiling")
        self._lock = None

    def load(self, key):
        """Return the code stored under a key; wait for it while another process compiles the
        function and has the lock, or return None if this one has to.
        """
        if (found := super().load(key)) is not None:
            return found
        from filelock import FileLock, Timeout  # here, because only missing code needs it

        self._lock = self._lock or FileLock(self._mark, timeout=0.02)
        until = time.monotonic() + LONGEST_WAIT
        while found is None and time.monotonic() < until:
            try:
                self._lock.acquire()
                until = 0.0
            except Timeout:
                pass
            except OSError:  # a folder that cannot be written to
                until = 0.0
            # Another process may have stored the code before.
            found = super().load(key)
        if found is not None:
            self._release()
        return found

    def save(self, key, data):
        try:
            super().save(key, data)
        finally:
            self._release()

    def _release(self) -> None:
        if self._lock is not None:
            self._mark.unlink(missing_ok=True)
            self._lock.release(force=True)

    def _load_index(self):
        with suppress(Exception):  # whatever a damaged pickle raises
            return super()._load_index()
        return {}

    def _save_data(self, name, data):
        data = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(_checksum(data) + data)

    def _load_data(self, name):
        kept = Path(self._data_path(name)).read_bytes()
        if _checksum(kept[4:]) != kept[:4]:
            raise OSError(f"{name} is damaged")  # numba treats this error as a missing file
        return pickle.loads(kept[4:])


def _checksum(data: bytes) -> bytes:
    return zlib.crc32(data).to_bytes(4, "little")


class _Stored(CompileResultCacheImpl):
    """Form in which compiled code is stored: as numba stores it, without environments of called
    functions that hold no constants.

    Only constants are read from an environment, and loading it imports the module of its function:
    parts of the compiler.
    """

    form = "no environments without constants"

    def reduce(self, cres):
        """Return the parts of a compiled function that are stored."""
        *parts, environments = super().reduce(cres)
        return *parts, tuple(environment for environment in environments if environment.consts)


class DigestCache(FunctionCache):
    """Disk cache of numba for one function, in files named by the digest of everything that the
    code of the function depends on.

    Without a given `digest` the cache computes it at the first look-up, when everything that the
    function calls is defined. A `parallel` function needs numba's threads started before it is
    compiled or loaded.
    """

    _impl_class = _Stored

    def __init__(
        self, function: Callable, digest: str | None = None, parallel: bool = False
    ) -> None:
        super().__init__(function)
        self._digest = digest
        self._parallel = parallel
        self._cache_file = None

    def _open(self) -> None:
        """Open the file of the cache, named by the digest; disable the cache for a function whose
        dependencies cannot be determined.

        For a `parallel` function also start the threads.
        """
        if self._parallel:
            start_threads()
        if self._cache_file is not None or not self._enabled:
            return
        try:
            digest = self._digest or compiled_digest(self._py_func)
        except NotKeyable:
            self.disable()
            return
        name = self._py_func.__qualname__.replace("<", "").replace(">", "")
        python = f"py{sys.version_info[0]}{sys.version_info[1]}"
        self._cache_file = CacheFile(self._cache_path, f"{name}-{digest[:20]}.{python}", digest)

    def _index_key(self, sig, codegen):
        # The digest covers all that the function closes over; code stored in another form is
        # compiled again.
        return sig, codegen.magic_tuple(), _Stored.form

    def load_overload(self, sig, target_context):
        """Return the code stored for a signature, or None.

        Unlike numba's caches, this one does not fill the compiler's registries of types and
        functions first (a quarter of a second): only compilation reads them, and fills them itself.
        Stored code needs the runtime that allocates arrays.
        """
        self._open()
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    def save_overload(self, sig, data):
        self._open()
        try:
            super().save_overload(sig, data)
        except OSError as error:
            self.disable()
            log_not_kept(self._cache_path, error.strerror or str(error))


@cache
def log_not_kept(folder: str, why: str) -> None:
    """Log once per folder and reason that compiled code is not kept on disk."""
    logger.warning(
        "compiled code cannot be cached in %s, so every process compiles it again: %s", folder, why
    )


def cache_folder(function: Callable) -> Path | None:
    """Return the folder in which compiled code of the file of a function is cached; None if no
    folder can be written to.
    """
    with suppress(RuntimeError):
        return Path(FunctionCache(function).cache_path)
    return None


def _enable_cache(compiled, function: Callable, digest: str | None = None, parallel: bool = False):
    # Without a source file (an interactive session) or a writable folder nothing is cached, and
    # each process compiles anew.
    with suppress(RuntimeError):
        compiled._cache = DigestCache(function, digest, parallel)
    return compiled


def kernel(function: Callable) -> Callable:
    """Compile a function on plain arrays, cached on disk.

    A function that a pass calls should be `inline` instead. Numba optimizes a copy of a called
    `kernel` within the pass; whether this copy or the kernel itself runs depends on what was
    compiled or loaded before, and the last bits of their results may differ.
    """
    if numba.config.DISABLE_JIT:
        return _refuse_switched_off
    return _enable_cache(numba.njit(**OPTIONS)(function), function)


def _refuse_switched_off(*_, **__) -> NoReturn:
    """Raise the error of a compiler that is switched off."""
    raise CompilerSwitchedOff(
        "NUMBA_DISABLE_JIT is set in the environment, but forces need compiled code: unset it"
    )


def inline(function: Callable) -> Callable:
    """Compile an elementwise function that is inlined into every kernel that calls it."""
    return _enable_cache(numba.njit(**INLINE_OPTIONS)(function), function)


def expanded(function: Callable) -> Callable:
    """Compile a function whose code is copied into its callers before they are optimized, so
    that its loops use the vector width there.
    """
    return numba.njit(inline="always", **OPTIONS)(function)


def parallel_kernel(function: Callable) -> Callable:
    """Compile a function like `kernel`, with its ``prange`` loops spread over numba's threads."""
    return _enable_cache(numba.njit(parallel=True, **OPTIONS)(function), function, parallel=True)


_real = types.CPointer(types.float64)
_sizes = types.CPointer(types.int64)


MOST_VALUES = 1 << 40
"""Nominal length that compiled code gives to the arrays of a model's constants and working memory:
only the model knows their true length.
"""

STRESS_RESPONSE = types.void(_real, _real, _real)
"""Signature ``response(states, parameters, result)`` of the block functions that return the stress
response of a law, in double precision.

`pdsurrogate.materials.response` lists the rows.
"""


def isochoric_energy_signature(dtype):
    """Return the signature ``energy(states, sizes, weights, response, parameters, result)`` of
    compiled learned isochoric energies.

    States and results are in `dtype`, weights in double precision; ``response`` and ``parameters``
    belong to the exact energy.
    """
    real = types.CPointer(types.float32 if np.dtype(dtype) == np.float32 else types.float64)
    return types.void(real, _sizes, _real, types.int64, _real, real)


def bond_force_signature(dtype):
    """Return the signature ``bond_force(states, sizes, weights, response, parameters, work,
    scratch, traction)`` of compiled bond forces.

    ``states``, ``weights``, ``work`` and ``traction`` are in `dtype`, the precision of the model.
    ``sizes`` and ``weights`` are the constants of the model; ``response`` and ``parameters`` belong
    to the material law, for models computed from it; ``work`` and ``scratch`` are rows for
    intermediate values, in the precision of the model and in double precision. See
    `pdsurrogate.forces.protocol`.
    """
    real = types.CPointer(types.float32 if np.dtype(dtype) == np.float32 else types.float64)
    return types.void(real, _sizes, real, types.int64, _real, real, _real, real)


@writes
def call_block(builder, address, *arguments):
    """Call the compiled block function at an address; pass arrays as pointers to their data, and
    each item of a tuple as an argument.

    numba's first-class functions would work, but need some 40 microseconds of unpacking at every
    call of a kernel. The arguments are not checked: they must fit the signature that the function
    was compiled for.
    """
    passed = []
    for argument in arguments:
        passed += argument if isinstance(argument, list) else [argument]
    function = ir.FunctionType(ir.VoidType(), [value.type for value in passed])
    builder.call(builder.inttoptr(address, function.as_pointer()), passed)


@writes
def widest_vectors(builder):
    """Let LLVM use the processor's widest vectors in the calling function, and align spilled
    registers.

    LLVM limits itself to 256 bits on processors with AVX-512, because in most code a few wide
    instructions would lower the clock of all the rest; here they are most of the work. On other
    processors nothing changes.
    """
    # llvmlite does not support attributes with a value; added without its check they are written
    # out verbatim.  An inlined function would lose them.
    set.update(
        builder.function.attributes, {'"prefer-vector-width"="512"', '"stackrealign"', "noinline"}
    )


_BLOCK_FUNCTIONS: dict[object, CFunc] = {}
"""Block functions compiled or loaded in this process, by digest and signature; a function without a
digest has a key of its own.

They live as long as the process, since their addresses are in use.
"""


def compile_block_function(function: Callable, signature, digest: str | None = None) -> CFunc:
    """Compile a function for one signature, to be called by its ``address`` (see `call_block`), and
    cache the code on disk.

    `digest` names the file of the cache; by default it is the digest of the function.
    """
    if numba.config.DISABLE_JIT:
        _refuse_switched_off()
    compiled = CFunc(
        function,
        numba.core.sigutils.normalize_signature(signature),
        locals={},
        options=dict(OPTIONS),
    )
    _enable_cache(compiled, function, digest)
    compiled.compile()
    return compiled


def compile_bond_force(
    function: Callable, dtype, state_rows: int = STATE_ROWS, result_rows: int = TRACTION_ROWS
) -> CFunc:
    """Compile a function of blocks of bonds for the arguments of `bond_force_signature`, which it
    receives as arrays, not as pointers.

    `dtype` is the precision of the model, `state_rows` and `result_rows` are the numbers of rows of
    its states and of its result. The arrays ``sizes``, ``weights`` and ``work`` are declared with
    the length `MOST_VALUES`: only the model knows how long they really are.
    """
    body = expanded(function)

    def bond_force(states, sizes, weights, response, parameters, work, scratch, traction):
        widest_vectors()
        states = carray(states, (state_rows, BLOCK))
        traction = carray(traction, (result_rows, BLOCK))
        sizes = carray(sizes, (MOST_VALUES,))
        weights = carray(weights, (MOST_VALUES,))
        work = carray(work, (MOST_VALUES, BLOCK))
        body(
            states,
            sizes,
            weights,
            response,
            parameters,
            work,
            carray(scratch, (SCRATCH_ROWS, BLOCK)),
            traction,
        )

    return compile_block_function(bond_force, bond_force_signature(dtype))


def block_function_of(build: Callable, signature, *parts) -> CFunc:
    """Return the compiled function that ``build(*parts)`` defines, compiled anew if the builder or
    any part has changed.

    The parts are elementwise functions, which the builder receives ready to be called from compiled
    code, and plain values.
    """
    try:
        digest = compiled_digest(build, *parts)
        key = digest, str(signature)
    except NotKeyable:
        # It is unknown whether previously compiled code is still valid.
        digest = None
        key = object()
    if key not in _BLOCK_FUNCTIONS:
        _BLOCK_FUNCTIONS[key] = compile_block_function(build(*_ready(parts)), signature, digest)
    return _BLOCK_FUNCTIONS[key]


def _ready(parts: tuple) -> list:
    # Copies are needed because numba keeps the code that it compiled for a function, with the
    # constants of that time.
    return [inlined(_copy(part)) if callable(part) else part for part in parts]


def _copy(function: Callable) -> Callable:
    function = function.py_func if is_jitted(function) else function
    copy = python_types.FunctionType(
        function.__code__,
        function.__globals__,
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    copy.__kwdefaults__ = function.__kwdefaults__
    copy.__qualname__ = function.__qualname__
    return copy


def inlined(function: Callable) -> Callable:
    """Make a plain elementwise function callable from compiled code, inlined into its callers; a
    call from Python runs it uncompiled.
    """
    function = function.py_func if is_jitted(function) else function
    return register_jitable(**INLINE_OPTIONS)(function)


class CompilationClock(event.TimingListener):
    """Clock that sums the seconds spent compiling, and announces the first compilation by calling
    `announce`.

    Loading from the disk cache runs no compiler pass and counts as zero.
    """

    def __init__(self, announce: Callable[[], None] | None = None) -> None:
        super().__init__()
        self._announce = announce

    @property
    def seconds(self) -> float:
        return self.duration if self.done else 0.0

    def on_start(self, event) -> None:
        super().on_start(event)
        if self._announce is not None:
            announce = self._announce
            self._announce = None
            announce()


def compilation_clock(announce: Callable[[], None] | None = None):
    """Return a context manager that measures the time spent compiling within it, and yields the
    `CompilationClock`.

    `announce` is called at the first compilation.
    """
    return event.install_listener("numba:run_pass", CompilationClock(announce))
