"""Options shared by all commands: verbosity, imported modules with laws, output format and time limit."""

from __future__ import annotations

import importlib.util
import inspect
import logging
import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from .application import app, bad_input, err, out, said_aloud, settings

Verbose = Annotated[
    int, typer.Option("-v", "--verbose", count=True, show_default=False, help="Print log messages; -vv for debug messages.")
]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print only result tables, warnings and errors.")]
Imports = Annotated[
    list[Path] | None, typer.Option("--import", metavar="FILE.py", help="Python module that defines material laws; may be repeated.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Overwrite existing results in DIR even if they come from a different run.")]
MaxTime = Annotated[float | None, typer.Option(metavar="SECONDS", help="Stop a run after this time and write a checkpoint to resume from.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]

_SHARED = {"verbose": (Verbose, 0), "quiet": (Quiet, False), "imports": (Imports, None)}


def command(name: str | None = None) -> Callable[[Callable], Callable]:
    """Register a function as a command and append the shared options to its own."""

    def register(function: Callable) -> Callable:
        signature = inspect.signature(function)

        @wraps(function)
        def with_shared(*arguments, verbose: int = 0, quiet: bool = False, imports=None, **options):
            _listen(verbose)
            settings.quiet = quiet
            out.quiet = options.get("as_json", False)  # tables and remarks; JSON goes by itself
            for path in imports or ():
                with bad_input(ValueError, OSError):
                    import_laws(path)
            from ..forces import CompilerSwitchedOff

            with said_aloud(), bad_input(CompilerSwitchedOff):
                return function(*arguments, **options)

        kind = inspect.Parameter.KEYWORD_ONLY
        shared = [inspect.Parameter(key, kind, default=default, annotation=hint) for key, (hint, default) in _SHARED.items()]
        # Annotations that are text are found in the module of the command, which the wrapper is not in.
        hints = get_type_hints(function, include_extras=True)
        own = [parameter.replace(annotation=hints[key]) for key, parameter in signature.parameters.items()]
        with_shared.__signature__ = signature.replace(parameters=[*own, *shared])
        with_shared.__annotations__ = {**hints, **{key: hint for key, (hint, _) in _SHARED.items()}}
        return app.command(name)(with_shared)

    return register


def _listen(verbose: int) -> None:
    """Print the package's log on standard error: information with `-v`, debug messages with `-vv`."""
    logger = logging.getLogger("pdsurrogate")
    for handler in [handler for handler in logger.handlers if isinstance(handler, _OnStandardError)]:
        logger.removeHandler(handler)
    logger.setLevel({0: logging.NOTSET, 1: logging.INFO}.get(verbose, logging.DEBUG))
    if verbose:
        logger.addHandler(_OnStandardError())


class _OnStandardError(logging.Handler):
    """Logging handler that prints records above the progress bar."""

    def emit(self, record: logging.LogRecord) -> None:
        err.print(f"{record.name}: {record.getMessage()}", markup=False, highlight=False, soft_wrap=True)


def import_laws(path: Path) -> list[str]:
    """Run a module, and put the laws that it defines into the table of laws; returns their names.

    Raises
    ------
    ValueError
        If it is no Python module, fails, defines no law, or one by the name of another.
    """
    from ..materials import LAWS, Law

    if path.suffix != ".py" or not path.is_file():
        raise ValueError(f"--import {path}: there is no such Python file")
    if path.stem in sys.modules:
        module: Any = sys.modules[path.stem]
        if Path(getattr(module, "__file__", None) or "").resolve() != path.resolve():
            raise ValueError(f"--import {path}: a module {path.stem} is loaded already; take another name for the file")
    else:
        specification = importlib.util.spec_from_file_location(path.stem, path)
        module = importlib.util.module_from_spec(specification)
        sys.modules[path.stem] = module
        try:
            specification.loader.exec_module(module)
        except Exception as error:
            del sys.modules[path.stem]
            raise ValueError(f"--import {path}: {type(error).__name__}: {error}") from None
    found = [
        law
        for law in vars(module).values()
        if inspect.isclass(law) and issubclass(law, Law) and law.__module__ == module.__name__ and not inspect.isabstract(law)
    ]
    if not found:
        raise ValueError(f"--import {path}: it defines no law, a class that derives from InvariantLaw or PrincipalStretchLaw")
    for law in found:
        if LAWS.get(law.name, law) is not law:
            raise ValueError(f"--import {path}: there is a law {law.name!r} already; give {law.__name__} another name")
        LAWS[law.name] = law
    return [law.name for law in found]
