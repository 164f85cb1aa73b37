"""What all commands share: the application, its two consoles, and how bad input ends."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import typer
from rich.console import Console
from rich.markup import escape

app = typer.Typer(
    name="pdsurrogate",
    help="Learnt bond forces of rubber-like materials, and a peridynamic solver that runs on them.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
out = Console()
err = Console(stderr=True)


@contextmanager
def bad_input(*kinds: type[Exception]) -> Iterator[None]:
    """Turn errors about what the user gave into one line and exit status 2."""
    try:
        yield
    except kinds as error:
        err.print(f"[red]pdsurrogate:[/] {escape(' '.join(str(error).split()))}", soft_wrap=True)
        raise typer.Exit(2) from None


@contextmanager
def writing(folder) -> Iterator[None]:
    """Turn errors of writing results, a full disk above all, into one line and exit status 1."""
    try:
        yield
    except OSError as error:
        err.print(f"[red]pdsurrogate:[/] could not write {escape(str(folder))}: {error.strerror or error}", soft_wrap=True)
        raise typer.Exit(1) from None


@contextmanager
def said_aloud() -> Iterator[None]:
    """Print warnings of the package as lines of its own."""
    from ..forces import OutsideDomainWarning

    with warnings.catch_warnings():
        warnings.simplefilter("always", OutsideDomainWarning)
        before = warnings.showwarning

        def show(message, category, *where) -> None:
            if issubclass(category, OutsideDomainWarning):
                err.print(f"[yellow]pdsurrogate:[/] {escape(str(message))}", soft_wrap=True)
            else:
                before(message, category, *where)

        warnings.showwarning = show
        yield


def law_of(name: str, changes: list[str] | None):
    """A law by name with parameters given as KEY=VALUE."""
    from pydantic import ValidationError

    from ..scenes import MaterialSpec
    from ..scenes.reading import explain, parse_change

    try:
        return MaterialSpec.model_validate({"law": name, **dict(parse_change(item) for item in changes or [])}).build()
    except ValidationError as error:
        raise ValueError(explain(error)) from None
