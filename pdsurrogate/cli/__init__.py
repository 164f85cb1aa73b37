"""Command line of pdsurrogate: the table of its commands, each loaded only when it is called, and
the exit statuses.

Exit status 0: done; 1: the run failed, and what it reached is saved; 2: bad input, one line on
standard error; 130: interrupted, or ended by --max-time, and a checkpoint is left.
"""

import gc
import os
import sys
from importlib import import_module
from typing import Annotated

import typer
from typer.core import TyperCommand, TyperGroup

from .. import __version__
from .terminal import (
    FAILED,
    HELP_OPTIONS,
    INTERRUPTED,
    WARNING,
    complain,
    end_soon_after_interrupts,
    ended,
    error_as_json,
    out,
    settings,
)

COMMANDS = {
    "materials": ("lists", "List the material laws with their parameters."),
    "data": (
        "data",
        "Say and draw what files of testing machines, cameras and mesh programs are.",
    ),
    "identify": ("identify", "Identify the parameters of material laws from test data."),
    "calibrate": (
        "calibrate",
        "Fit a law to displacement fields and forces measured on a body that a scene describes.",
    ),
    "run": (
        "run",
        "Run a scene, and compare the result with the reference of the scene if it has one.",
    ),
    "scenes": ("lists", "List the built-in scenes, or show (and plot) one of them."),
    "new": ("lists", "Create a commented scene file to start from."),
    "show": (
        "show",
        "Plot a field of saved results, or write one HTML page with fields, curves and tables.",
    ),
    "study": (
        "study",
        (
            "Run a scene with many parameters, or fit many surrogates, in parallel; finished runs"
            " are reused."
        ),
    ),
    "fit": (
        "fit",
        (
            "Fit a surrogate to the bond force or the isochoric energy of a law, and store it as an"
            " artifact."
        ),
    ),
    "evaluate": (
        "evaluate",
        (
            "Measure the errors of a bond force or an energy by strain, and its state at rest and"
            " stiffness."
        ),
    ),
    "export": (
        "export",
        (
            "Write the energy of a law or an artifact as source code for FElupe, Abaqus, FEniCS or"
            " C, or its constants as a material card."
        ),
    ),
    "convert": (
        "export",
        "Say what law the material card of another program states, as a scene takes it.",
    ),
    "artifacts": (
        "lists",
        "List the exact force models and the artifacts, or print the card of an artifact.",
    ),
}
"""Commands in the order of the help: the module of each, which has a function of that name with
``_`` for ``-``, and its help.
"""


class Commands(TyperGroup):
    """Group of commands that loads only the called command, and reports wrong arguments as JSON
    if ``--json`` is given.
    """

    def __init__(self, **options) -> None:
        super().__init__(**options)
        self.commands = {
            name: TyperCommand(name, help=text) for name, (_, text) in COMMANDS.items()
        }

    def resolve_command(self, ctx, args):
        """Return the name of the called command, the command itself, loaded from its module, and
        the arguments that follow.
        """
        name, command, rest = super().resolve_command(ctx, args)
        if command is not None:
            module, text = COMMANDS[name]
            if name == "run":
                # A run uses one thread of BLAS. That others are started with NumPy would take a
                # twelfth of the time of a small run.
                os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
            function = getattr(import_module(f".{module}", __package__), name.replace("-", "_"))
            command = import_module(".command", __package__).command(function, text)
            if not gc.isenabled():
                gc.freeze()
                gc.enable()
        return name, command, rest

    def invoke(self, ctx):
        """Run the called command; with ``--json`` print errors in its arguments as JSON, too."""
        settings.as_json = "--json" in (*getattr(ctx, "_protected_args", ()), *ctx.args)
        settings.printed = False
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise ended(INTERRUPTED, "interrupted", WARNING) from None
        except Exception as error:
            if hasattr(error, "format_message"):
                error_as_json(error.exit_code, error.format_message())
            raise
        finally:
            out.quiet = False  # `--json` had set it


app = typer.Typer(
    name="pdsurrogate",
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings=HELP_OPTIONS,
)


def _version(asked: bool) -> None:
    if asked:
        out.print(f"pdsurrogate {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def _before(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Learned bond forces of rubber-like materials, and a peridynamic solver that runs on them."""


def main() -> None:
    """Run the command given on the command line; a standard output that cannot be written ends
    with exit status 1.
    """
    end_soon_after_interrupts()
    try:
        try:
            app()
        finally:
            # Flushed here, not at the exit of the interpreter: this may fail, too.
            sys.stdout.flush()
            # An interpreter that ends searches all objects for unused ones, several times; the
            # system frees them all at once.
            gc.freeze()
    except (
        OSError
    ) as error:  # standard output on a full disk; commands name the folders that they write to
        complain(f"{error.filename or 'standard output'}: {error.strerror}")
        # The interpreter shall not try again to write what is left in the buffer.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(FAILED)
