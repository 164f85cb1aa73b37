"""Plain data in joblib files: written by joblib, read through an allow-list.

A joblib file is a pickle, and a pickle is a program.  The reader here runs only that part of the language that builds
dicts, lists, tuples, text, numbers and arrays of numbers; the three names that a joblib array needs are answered by
stand-ins of its own, so no class of anybody's is ever looked up, called or built.
"""

from __future__ import annotations

import io
import math
import pickle
from pathlib import Path
from typing import ClassVar

import joblib
import numpy as np

MOST_BYTES = 64 * 2**20
"""Size of the largest payload that is read."""

_ARRAY_TYPES = {"f4": np.float32, "f8": np.float64, "i4": np.int32, "i8": np.int64}

_OPCODES = (
    *(pickle.PROTO, pickle.FRAME, pickle.STOP, pickle.MARK, pickle.MEMOIZE),
    *(pickle.BINPUT, pickle.LONG_BINPUT, pickle.BINGET, pickle.LONG_BINGET),
    *(pickle.EMPTY_DICT, pickle.EMPTY_LIST, pickle.EMPTY_TUPLE, pickle.SETITEM, pickle.SETITEMS, pickle.APPEND, pickle.APPENDS),
    *(pickle.TUPLE, pickle.TUPLE1, pickle.TUPLE2, pickle.TUPLE3),
    *(pickle.SHORT_BINUNICODE, pickle.BINUNICODE, pickle.BININT, pickle.BININT1, pickle.BININT2, pickle.LONG1, pickle.BINFLOAT),
    *(pickle.NONE, pickle.NEWTRUE, pickle.NEWFALSE, pickle.GLOBAL, pickle.STACK_GLOBAL, pickle.NEWOBJ, pickle.REDUCE, pickle.BUILD),
)


class UnsafePayload(ValueError):
    """A payload that holds anything but plain data."""


def dump_plain(value, path: Path) -> None:
    """Write plain data as an uncompressed joblib file.

    Raises
    ------
    UnsafePayload
        If the value holds anything but dicts with text keys, lists, text, numbers, None and arrays of numbers.
    """
    _check_plain(value)
    joblib.dump(value, path, compress=0, protocol=4)


def load_plain(data: bytes):
    """Read plain data from the bytes of a joblib file.

    Raises
    ------
    UnsafePayload
        If the file is damaged, or asks for anything but plain data.
    """
    if len(data) > MOST_BYTES:
        raise UnsafePayload(f"the payload has {len(data)} bytes; at most {MOST_BYTES} are read")
    file = io.BytesIO(data)
    try:
        value = _PlainUnpickler(file).load()
        if file.read(1):
            raise UnsafePayload("there is more in the file than its data")
        _check_plain(value)
        return value
    except UnsafePayload:
        raise
    except Exception as error:  # whatever a damaged stream can provoke in the pure-Python machine below
        raise UnsafePayload(f"the payload is damaged: {type(error).__name__}: {error}") from None


def _check_plain(value, depth: int = 0) -> None:
    if depth > 20:
        raise UnsafePayload("the data are nested too deeply")
    if value is None or type(value) in (bool, int, float, str):
        return
    if type(value) is dict:
        for key, inner in value.items():
            if type(key) is not str:
                raise UnsafePayload(f"a key is {type(key).__name__}, not text")
            _check_plain(inner, depth + 1)
    elif type(value) is list:
        for inner in value:
            _check_plain(inner, depth + 1)
    elif type(value) is np.ndarray:
        if value.dtype not in _ARRAY_TYPES.values() or not value.flags.c_contiguous:
            raise UnsafePayload(f"an array is of type {value.dtype}; only contiguous arrays of {', '.join(_ARRAY_TYPES)} are plain")
    else:
        raise UnsafePayload(f"the data hold a {type(value).__module__}.{type(value).__qualname__}")


class _ArrayType:
    """Stand-in for numpy.dtype(code, False, True), its state set by BUILD."""

    def __init__(self, code, *rest) -> None:
        if code not in _ARRAY_TYPES:
            raise UnsafePayload(f"an array of type {code!r} is not plain")
        self.type = np.dtype(_ARRAY_TYPES[code]).newbyteorder("<")

    def set_state(self, state) -> None:
        if not isinstance(state, tuple) or len(state) < 2 or state[1] not in ("<", "|", "="):
            raise UnsafePayload("an array has an unknown byte order")


class _Array:
    """Stand-in for joblib's NumpyArrayWrapper: what it says of the array whose bytes follow."""

    keys = frozenset({"subclass", "shape", "order", "dtype", "allow_mmap", "numpy_array_alignment_bytes"})

    def read(self, state, file: io.BytesIO) -> np.ndarray:
        if not isinstance(state, dict) or not set(state) <= self.keys or state.get("subclass") is not _NDARRAY:
            raise UnsafePayload("an array is not described as joblib describes arrays")
        kind, shape = state.get("dtype"), state.get("shape")
        if not isinstance(kind, _ArrayType) or not isinstance(shape, tuple) or len(shape) > 4:
            raise UnsafePayload("an array has no plain type and shape")
        if not all(type(size) is int and 0 <= size <= MOST_BYTES for size in shape):
            raise UnsafePayload("an array has an impossible shape")
        if state.get("numpy_array_alignment_bytes") is not None:
            padding = file.read(1)
            file.read(padding[0] if padding else 0)
        wanted = math.prod(shape) * kind.type.itemsize
        data = file.read(wanted) if wanted <= MOST_BYTES else b""
        if len(data) != wanted:
            raise UnsafePayload("an array is cut short")
        array = np.frombuffer(data, dtype=kind.type).astype(kind.type.newbyteorder("="))
        if state.get("order") == "F":
            return np.ascontiguousarray(array.reshape(shape[::-1]).T)
        return array.reshape(shape)


_NDARRAY = object()

_ALLOWED = {
    ("joblib.numpy_pickle", "NumpyArrayWrapper"): _Array,
    ("numpy", "ndarray"): _NDARRAY,
    ("numpy", "dtype"): _ArrayType,
}


class _PlainUnpickler(pickle._Unpickler):
    """pickle's pure-Python machine, reduced to the opcodes of plain data."""

    dispatch: ClassVar = {opcode[0]: pickle._Unpickler.dispatch[opcode[0]] for opcode in _OPCODES}

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file)
        self._bytes = file

    def find_class(self, module, name):
        if (module, name) not in _ALLOWED:
            raise UnsafePayload(f"the file asks for {module}.{name}, which is not plain data")
        return _ALLOWED[module, name]

    def _load_newobj(self):
        arguments, made = self.stack.pop(), self.stack.pop()
        if made is not _Array or arguments != ():
            raise UnsafePayload("the file builds an object, which is not plain data")
        self.append(_Array())

    def _load_reduce(self):
        arguments, called = self.stack.pop(), self.stack.pop()
        if called is not _ArrayType or not isinstance(arguments, tuple):
            raise UnsafePayload("the file calls a function, which is not plain data")
        self.append(_ArrayType(*arguments))

    def _load_build(self):
        state, target = self.stack.pop(), self.stack.pop()
        if isinstance(target, _ArrayType):
            target.set_state(state)
            self.append(target)
        elif isinstance(target, _Array):
            self.append(target.read(state, self._bytes))
        else:
            raise UnsafePayload("the file sets the state of an object, which is not plain data")

    dispatch[pickle.NEWOBJ[0]] = _load_newobj
    dispatch[pickle.REDUCE[0]] = _load_reduce
    dispatch[pickle.BUILD[0]] = _load_build
