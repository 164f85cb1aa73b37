"""Digests of everything that the compiled code of a function depends on, which serve as keys of the
disk cache.

numba keys its cache by the file that holds a function. It does not see changes in called functions
or in imported constants, which it freezes. The digest made here covers the code of the function,
the values of its globals, closures and defaults, and, recursively, the code of every function that
it calls, in whatever file; comments and docstrings are left out. Functions of installed libraries
count by name and version.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import sys
import types as python_types
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from functools import cache

import llvmlite
import numba
import numpy as np
import scipy
from numba.core.dispatcher import Dispatcher
from numba.core.typing.templates import builtin_registry
from numba.extending import _Intrinsic

LIBRARIES = frozenset({"numba", "numpy", "llvmlite", "scipy"})
"""Libraries whose functions enter a digest by name only, together with the versions of numba,
NumPy and llvmlite.
"""


_FOLDERS = (
    "<frozen",
    *(os.path.dirname(module.__file__) + os.sep for module in (numba, np, llvmlite, scipy, os)),
)


class NotKeyable(TypeError):
    """Error for a value whose influence on compiled code cannot be determined."""


def code_digest(*values) -> str:
    """Return a digest of functions with everything that their code depends on, and of plain values.

    Values are functions (plain, compiled by numba, or intrinsics), numbers, texts, arrays, dtypes,
    and tuples, lists, sets and dicts of these. Raise NotKeyable, naming the function and the value,
    for a value of any other kind.
    """
    walk = _Walk()
    versions = (
        numba.__version__,
        np.__version__,
        llvmlite.__version__,
        tuple(sys.version_info[:2]),
    )
    for value in (versions, *values):
        walk.add(value)
    return walk.digest.hexdigest()


class _Walk:
    """Computation of one digest: it visits a function and everything that the function depends
    on, and hashes each function once.
    """

    def __init__(self) -> None:
        self.digest = hashlib.sha256()
        self._numbers: dict[int, int] = {}
        self._kept: list = []
        self._overloads = _overloads(len(builtin_registry.globals))

    def add(self, value) -> None:
        if isinstance(value, np.ndarray):
            if value.dtype.hasobject:
                raise NotKeyable("an array of objects")
            self._write(
                "array", value.dtype.str, value.shape, np.ascontiguousarray(value).tobytes()
            )
        elif (
            value is None
            or value is Ellipsis
            or isinstance(value, bool | int | float | complex | str | bytes | np.generic | np.dtype)
        ):
            self._write(
                type(value).__name__,
                value.tobytes() if isinstance(value, np.generic) else repr(value),
            )
        elif isinstance(value, tuple | list | set | frozenset | dict):
            self._write(type(value).__name__, len(value))
            items = value.items() if isinstance(value, dict) else value
            for item in sorted(items, key=repr) if isinstance(value, set | frozenset) else items:
                self.add(item)
        elif isinstance(value, Dispatcher):
            self._write("compiled")
            self.add(value.targetoptions)
            self.add(value.py_func)
        elif isinstance(value, _Intrinsic):
            self._write("intrinsic")
            self.add(value._defn)
        elif inspect.ismodule(value) and _is_of_library(value):
            self._write("library", value.__name__)
        elif _is_of_library(value):
            self._write(
                "library", value.__module__ or "", getattr(value, "__qualname__", value.__name__)
            )
        elif isinstance(value, python_types.CodeType):
            self._code(value)
        elif isinstance(value, python_types.FunctionType):
            self._function(value)
        elif (
            isinstance(value, numba.types.Type | numba.core.typing.templates.Signature)
            or _root(type(value).__module__) in LIBRARIES
        ):
            shown = repr(value)
            if " at 0x" in shown:
                raise NotKeyable(f"an object of type {type(value).__name__}")
            self._write("described", type(value).__qualname__, shown)
        elif is_dataclass(value) and not isinstance(value, type):
            self._write("record", type(value).__qualname__)
            for field in fields(value):
                self.add(getattr(value, field.name))
        else:
            raise NotKeyable(f"an object of type {type(value).__name__}")

    def _write(self, *parts) -> None:
        for part in parts:
            data = part if isinstance(part, bytes) else str(part).encode()
            self.digest.update(len(data).to_bytes(8, "little") + data)

    def _function(self, function: Callable) -> None:
        if id(function) in self._numbers:
            self._write("function again", self._numbers[id(function)])
            return
        self._numbers[id(function)] = len(self._numbers)
        self._kept.append(function)  # an id is unique only while its object lives
        # The module is included: numba's cached code finds its globals by the module's name.
        self._write("function", function.__module__)
        code = function.__code__
        self._code(code, function.__doc__ is not None and code.co_consts[:1] == (function.__doc__,))
        self.add(function.__defaults__)
        self.add(function.__kwdefaults__)
        closed = dict(
            zip(
                code.co_freevars,
                (cell.cell_contents for cell in function.__closure__ or ()),
                strict=True,
            )
        )
        names = _names(code)
        for name, value in [
            *_values_behind(names | closed.keys(), closed),
            *_values_behind(names, function.__globals__),
        ]:
            self._write(name)
            try:
                self.add(value)
            except NotKeyable as error:
                raise NotKeyable(
                    f"{function.__qualname__} uses {name}: {error}"
                    if "uses" not in str(error)
                    else str(error)
                ) from None
        for implementation in self._overloads.get(id(function), ()):
            self.add(implementation)

    def _code(self, code: python_types.CodeType, documented: bool = False) -> None:
        self._write(
            "code",
            code.co_code,
            code.co_names,
            code.co_varnames,
            code.co_freevars,
            code.co_cellvars,
            code.co_argcount,
            code.co_flags,
        )
        # A docstring is the first constant, where a function without one has None.
        for constant in (None, *code.co_consts[1:]) if documented else code.co_consts:
            self.add(constant)


@cache
def _names(code: python_types.CodeType) -> frozenset[str]:
    """Return the names of all globals and attributes that a code object and the code objects
    nested in it read.
    """
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, python_types.CodeType):
            names |= _names(constant)
    return frozenset(names)


def _values_behind(names: frozenset[str], space: dict) -> Iterator[tuple[str, object]]:
    """Yield (name, value) for each of `names` in the namespace `space`; search modules of the
    project for the names instead.

    A module of the project is not yielded, a module of a library is not searched. Attributes are
    not resolved: a name that several modules define is yielded for each.
    """
    for name in sorted(names & space.keys()):
        value = space[name]
        if inspect.ismodule(value) and not _is_of_library(value):
            yield from _values_behind(names - {name}, vars(value))
        else:
            yield name, value


def _root(module: str | None) -> str:
    return (module or "").partition(".")[0]


def _is_of_library(value) -> bool:
    """Return whether a module, class or function belongs to Python's standard library or to a
    library of `LIBRARIES`.

    Such a value enters a digest by its name, not by its code.
    """
    if inspect.ismodule(value):
        name = value.__name__
        file = getattr(value, "__file__", None)
    elif isinstance(value, python_types.FunctionType):
        name = value.__module__
        file = value.__code__.co_filename
    elif isinstance(value, type | python_types.BuiltinFunctionType | np.ufunc):
        name = getattr(value, "__module__", None) or type(value).__module__
        file = None
    else:
        return False
    root = _root(name)
    # A user's file may share the name of a standard module; a module without a file is built in.
    return (root in LIBRARIES or root in sys.stdlib_module_names) and (
        file is None or file.startswith(_FOLDERS)
    )


@cache
def _overloads(registered: int) -> dict[int, list[Callable]]:
    """Return the compiled-code implementations registered with `numba.extending.overload`, by the
    id of the function that each replaces.

    Functions and implementations of libraries are left out. `registered` is the number of all that
    are registered, which only grows.
    """
    found: dict[int, list[Callable]] = {}
    for function, kind in builtin_registry.globals:
        if isinstance(function, python_types.FunctionType) and not _is_of_library(function):
            for template in getattr(kind, "templates", ()):
                implementation = getattr(template, "_overload_func", None)
                if implementation is not None and not _is_of_library(implementation):
                    found.setdefault(id(function), []).append(implementation)
    return found
