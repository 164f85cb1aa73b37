"""Pages of the public names of the package, one for each room, as Markdown for mkdocstrings."""

from functools import cache
from pathlib import Path

import griffe
from signatures import HOMES, Signatures

NAMES = sorted(HOMES, key=str.lower)
ROOMS = sorted({path.split(".")[1] for path in HOMES.values()})


@cache
def _things():
    """Public names by what scripts write, as Griffe reads them, and the package."""
    package = griffe.load(
        "pdsurrogate",
        search_paths=[Path(__file__).parents[2]],
        extensions=griffe.load_extensions(Signatures),
    )
    return {name: package[HOMES[name].partition(".")[2]] for name in NAMES}, package


@cache
def _public():
    return {thing.canonical_path for thing in _things()[0].values()}


def index() -> str:
    """Return the lists of all public names, room by room."""
    return "\n\n".join(f"## [pdsurrogate.{room}]({room}.md)\n\n{_table(room)}" for room in ROOMS)


def pages():
    """Yield the name of each room and the text of its page: its public names, and other classes
    that these derive from, take or return.
    """
    things, package = _things()
    needed = {
        room: {path for name in _names_in(room) for path in _needed(things[name])} for room in ROOMS
    }
    for room in ROOMS:
        sections = [
            _section(HOMES[name], name, 2, any(map(_is_described, _bases(things[name]))))
            for name in _names_in(room)
        ]
        others = {
            path for found in needed.values() for path in found if _page_of(path, needed) == room
        }
        if others:
            sections.append(
                "## Other classes\n\nThe names above derive from these classes, take them or return"
                " them."
            )
            sections += [
                _section(path, path.rpartition(".")[2], 3, False) for path in sorted(others)
            ]
        yield (
            room,
            "\n\n".join(
                [f"# pdsurrogate.{room}", package[room].docstring.value, _table(room), *sections]
            ),
        )


def _names_in(room: str) -> list[str]:
    return [name for name in NAMES if HOMES[name].split(".")[1] == room]


def _table(room: str) -> str:
    summaries = {
        name: " ".join(_things()[0][name].docstring.value.split("\n\n")[0].split())
        for name in _names_in(room)
    }
    rows = [f"| [`{name}`][{HOMES[name]}] | {summary} |" for name, summary in summaries.items()]
    return "\n".join(["| name | what it is |", "| --- | --- |", *rows])


def _section(path: str, heading: str, level: int, show_bases: bool) -> str:
    """What makes mkdocstrings describe a name."""
    options = {
        "heading": heading,
        "toc_label": heading.rpartition(".")[2],
        "heading_level": level,
        "show_bases": str(show_bases).lower(),
    }
    return (
        f"::: {path}\n    options:"
        f" {{{', '.join(f'{key}: {value}' for key, value in options.items())}}}"
    )


def _bases(thing):
    return thing.mro() if thing.is_class else []


def _is_described(base) -> bool:
    """Whether a page describes a base: public ones, and others with methods or properties."""
    functions = [
        member for name, member in base.members.items() if not name.startswith(("_", "model_"))
    ]
    return base.canonical_path in _public() or any(
        member.docstring and (member.is_function or "property" in member.labels)
        for member in functions
    )


def _types(thing):
    """Classes of the package in the signature of a function or of a constructor."""
    function = thing.members.get("__init__") if thing.is_class else thing
    if function is None or not function.is_function:
        return
    for annotation in [
        *(parameter.annotation for parameter in function.parameters),
        function.returns,
    ]:
        for part in annotation.iterate(flat=True) if isinstance(annotation, griffe.Expr) else ():
            if isinstance(part, griffe.ExprName) and part.canonical_path.startswith("pdsurrogate."):
                found = _things()[1][part.canonical_path.partition(".")[2]]
                if found.is_class:
                    yield found


def _needed(thing):
    """Return the paths of the classes, other than public ones, that a name derives from, takes
    or returns, and of those that they take.
    """
    todo, found = [thing], set()
    while todo:
        thing = todo.pop()
        for one in [*filter(_is_described, _bases(thing)), *_types(thing)]:
            if one.canonical_path not in found and one.canonical_path not in _public():
                found.add(one.canonical_path)
                todo.append(one)
    return found


def _page_of(path: str, needed) -> str:
    """Return the room on whose page a class is: the only one that needs it, or else its own."""
    rooms = [room for room, found in needed.items() if path in found]
    return rooms[0] if len(rooms) == 1 else path.split(".")[1]
