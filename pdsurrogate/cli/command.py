"""Building of commands from functions, and the options and checks that several commands share."""

import importlib
import inspect
import logging
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, get_type_hints

import typer
from pydantic import BaseModel
from rich.markup import escape
from typer import Option

from ..errors import CompilerSwitchedOff, OutsideDomainWarning
from ..materials import LAWS, Law
from ..ranks import NotUnderMPI
from ..run.interruption import heard
from ..scenes import MaterialSpec
from ..scenes.reading import parse_change
from .terminal import HELP_OPTIONS, WARNING, bad_input, complain, on_standard_error, out, settings

Overwrite = Annotated[
    bool,
    Option(
        "--overwrite",
        help="Overwrite existing results in DIR, even if they come from a different run.",
    ),
]
MaxTime = Annotated[
    float | None,
    Option(
        metavar="SECONDS", help="Stop a run after this time and write a checkpoint to resume from."
    ),
]
SetScene = Annotated[
    list[str] | None,
    Option("--set", metavar="KEY=VALUE", help="Override a key of the scene; may be repeated."),
]
SetLaw = Annotated[
    list[str] | None,
    Option("--set", metavar="KEY=VALUE", help="Override a parameter of the law; may be repeated."),
]
ReportFolder = Annotated[
    Path | None,
    Option("--out", metavar="DIR", help="Folder for the report (default: none is written)."),
]
PictureFolder = Annotated[
    Path | None,
    Option("--out", metavar="DIR", help="Folder for the pictures (default: the current one)."),
]
OneLaw = Annotated[str | None, Option(metavar="LAW", help="Material law (default: neo-hookean).")]
SCENE_HELP = "Name of a built-in scene, or path of a scene file (.toml)"
REF_HELP = (
    "Force model: NAME (pdsurrogate artifacts lists them), NAME@VERSION of an artifact, or its path"
)


def command(function: Callable, text: str) -> typer.core.TyperCommand:
    """Return the Typer command of a function, with help text; its own options are followed by
    those of all commands, such as --json.
    """
    own, shared = (_command(one, text) for one in (function, _begin))
    body = own.callback

    def both(**given) -> None:
        with warnings_as_lines(), bad_input(ValueError, CompilerSwitchedOff, NotUnderMPI):
            shared.callback(**{option.name: given.pop(option.name) for option in shared.params})
            body(**given)

    own.params = [*own.params, *shared.params]
    own.callback = both
    return own


def _command(function: Callable, text: str) -> typer.core.TyperCommand:
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    alone.command(function.__name__.replace("_", "-"), help=text, context_settings=HELP_OPTIONS)(
        function
    )
    return typer.main.get_command(alone)


def _begin(
    as_json: Annotated[bool, Option("--json", help="Print JSON instead of tables.")] = False,
    verbose: Annotated[
        int,
        Option(
            "-v",
            "--verbose",
            count=True,
            show_default=False,
            help="Print log messages (-vv: all of them).",
        ),
    ] = 0,
    quiet: Annotated[
        bool, Option("-q", "--quiet", help="Print only result tables, warnings and errors.")
    ] = False,
    imports: Annotated[
        list[Path] | None,
        Option(
            "--import",
            metavar="FILE.py",
            help="Python file that defines material laws; may be repeated.",
        ),
    ] = None,
) -> None:
    settings.quiet = quiet
    settings.as_json = as_json
    heard.clear()
    out.quiet = as_json  # no tables; JSON is written to the stream directly
    logger = logging.getLogger("pdsurrogate")
    logger.setLevel({0: logging.NOTSET, 1: logging.INFO}.get(verbose, logging.DEBUG))
    logger.removeHandler(_log)
    if verbose:
        logger.addHandler(_log)
    for path in imports or ():
        with bad_input(OSError):
            _import_laws(path)


def with_fields(**models: type[BaseModel]) -> Callable[[Callable], Callable]:
    """Return a decorator of commands: in the place of each argument that is named here the command
    has an option for every field of a model, and receives the model.
    """

    def decorated(command: Callable[..., None]) -> Callable[..., None]:
        parameters: list[Parameter] = []
        for own in signature(command).parameters.values():
            model = models.get(own.name)
            kinds = get_type_hints(model, include_extras=True) if model else {}
            parameters += [
                Parameter(key, Parameter.KEYWORD_ONLY, default=one.default, annotation=kinds[key])
                for key, one in (model.model_fields.items() if model else ())
            ] or [own]

        @wraps(command)
        def run(**given) -> None:
            built = {
                name: model(**{key: given.pop(key) for key in model.model_fields})
                for name, model in models.items()
            }
            command(**built, **given)

        run.__signature__ = Signature(parameters)
        run.__annotations__ = {one.name: one.annotation for one in parameters}
        return run

    return decorated


class _OnStandardError(logging.Handler):
    """Logging handler that prints log messages on standard error, above the progress bar."""

    def emit(self, record: logging.LogRecord) -> None:
        on_standard_error(escape(f"{record.name}: {record.getMessage()}"))


_log = _OnStandardError()


def _import_laws(path: Path) -> None:
    """Import a Python file, and add the material laws that it defines to `LAWS`; raise
    ValueError for no law or a taken name.
    """
    if path.suffix != ".py" or not path.is_file():
        raise ValueError(f"--import {path}: this Python file does not exist")
    folder = str(path.parent.resolve())
    sys.path.insert(0, folder)
    try:
        importlib.invalidate_caches()
        module = importlib.import_module(path.stem)
    except Exception as error:
        raise ValueError(f"--import {path}: {type(error).__name__}: {error}") from None
    finally:
        sys.path.remove(folder)
    if Path(getattr(module, "__file__", None) or "").resolve() != path.resolve():
        raise ValueError(
            f"--import {path}: a module named {path.stem} is already loaded; rename the file"
        )
    classes = [
        found
        for found in vars(module).values()
        if inspect.isclass(found) and found.__module__ == module.__name__
    ]
    laws = [found for found in classes if issubclass(found, Law) and not inspect.isabstract(found)]
    if not laws:
        raise ValueError(
            f"--import {path}: the file defines no law, that is, no class derived from InvariantLaw"
            " or PrincipalStretchLaw"
        )
    for law in laws:
        if LAWS.get(law.name, law) is not law:
            raise ValueError(
                f"--import {path}: a law named {law.name!r} already exists; give {law.__name__}"
                " another name"
            )
        LAWS[law.name] = law


@contextmanager
def warnings_as_lines() -> Iterator[None]:
    """Print, during a context, UserWarnings and warnings of this package as single lines,
    without the file and line that issued them.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("always", OutsideDomainWarning)
        before = warnings.showwarning

        def print_warning(message, category, *where) -> None:
            if issubclass(category, UserWarning) or category.__module__.startswith(
                __package__.partition(".")[0]
            ):
                complain(str(message), WARNING)
            else:
                before(message, category, *where)

        warnings.showwarning = print_warning
        yield


def law_of(name: str, changes: list[str] | None = None) -> Law:
    """Return the material law of a given name, with parameters changed by texts KEY=VALUE."""
    given = dict(parse_change(item) for item in changes or [])
    if "law" in given:
        raise ValueError(
            f"--set law={given['law']}: --set changes parameters of the law; choose the law with"
            f" --law {given['law']}"
        )
    return MaterialSpec(law=name, **given).build()


def check_folder(folder: Path | None, report: str = "", overwrite: bool = False) -> None:
    """Check, before any work, that files can be written to a folder, if one is given, and that a
    `report` of this name is not there yet, unless `overwrite` is set.
    """
    if folder is not None:
        from ..results.files import check_writable

        with bad_input(OSError):
            check_writable(folder)
        if report and not overwrite and (folder / report).exists():
            raise ValueError(f"{folder / report} exists: use another folder, or --overwrite")
