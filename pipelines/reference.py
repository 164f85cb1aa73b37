"""Tables of the reference: keys of scenes, studies and cards, parameters of laws, and commands with
their options.

python pipelines/reference.py     writes the marked blocks of the pages in docs/reference anew
"""

import inspect
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from pkgutil import resolve_name

import typer

from pdsurrogate.artifacts import load_card, load_surrogate
from pdsurrogate.cli import app
from pdsurrogate.forces import FORCES
from pdsurrogate.materials import LAWS, PLANES
from pdsurrogate.results.files import write_text

ROOT = Path(__file__).resolve().parents[1]
PAGES, SHIPPED = (
    ROOT / "docs" / "reference",
    [path for path in (ROOT / "artifacts").glob("*/*") if path.is_dir()],
)

BLOCK = re.compile(r"(<!-- (\w+) ([\w. -]+) -->\n).*?(<!-- /\2 -->)", re.DOTALL)
"""A block of a page, such as ``<!-- keys loads -->``, with the kind and the name of the table
that stands in it.
"""

LISTED = tomllib.loads((ROOT / "pipelines" / "data" / "reference.toml").read_text("utf-8"))
TABLES = {
    page: {name: resolve_name(place) for name, place in tables.items()}
    for page, tables in LISTED.items()
}
"""Models whose keys are on each page, by the names of their tables."""

WHOLE = ("scene", "study", "campaign", "card")
"""Tables of whole files, whose keys have no table before them."""

PLAIN = ("features", "training", "errors")
"""Keys of a card that have a table of their own, which its schema does not name: they are
checked against it and kept as plain values.
"""

ENTRY = re.compile(r"^(\*{0,2}\w[\w, ]*?)(?: : .*)?\n((?:(?:    .*)?\n)+)", re.MULTILINE)
"""An entry of the section Parameters of a docstring: names, type, and indented text."""

FURTHER = "**extra_data"
"""Name that the docstring of a model gives to keys which the model does not declare."""

UNIT = re.compile(r"\s*Unit: (.+)\.$")

METAVARS = {
    "str": "TEXT",
    "list[str]": "TEXT",
    "path": "PATH",
    "int": "INTEGER",
    "int range": "INTEGER",
    "float": "NUMBER",
}
METAVARS |= {"FLOAT": "NUMBER", "INTEGER RANGE": "INTEGER"}
"""Names of the values of options, whatever version of Typer has named them."""


def documented(kind):
    """Return the meanings of parameters by name, as the docstring of a class or of those that it
    derives from says them.
    """
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        text = inspect.cleandoc(base.__dict__.get("__doc__") or "") + "\n"
        section = re.search(
            r"^Parameters\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)", text, re.MULTILINE | re.DOTALL
        )
        for names, meaning in ENTRY.findall(section[1] + "\n" if section else ""):
            found |= dict.fromkeys(names.split(", "), " ".join(meaning.split()))
    return found


def meaning_and_unit(kind, field):
    """Return the meaning of a parameter of a class, and its unit, empty where the docstring
    gives none.
    """
    meaning = documented(kind).get(field, "")
    unit = UNIT.search(meaning)
    return UNIT.sub("", meaning).replace("``", "`"), unit[1] if unit else ""


def slug(table):
    """Return the anchor of the heading of a table."""
    return re.sub(r"[^\w-]", "", table)


def bounds(schema):
    """Return the bounds of a number in words, such as " > 0" and " from 1 to 10000"."""
    above, below = (
        schema.get("gt", schema.get("exclusiveMinimum")),
        schema.get("lt", schema.get("exclusiveMaximum")),
    )
    least, most = schema.get("ge", schema.get("minimum")), schema.get("le", schema.get("maximum"))
    if least is not None and most is not None:
        return f" from {least:g} to {most:g}"
    marks = ((">", above if least is None else None), ("≥", least), ("<", below), ("≤", most))
    return " and".join(f" {mark} {value:g}" for mark, value in marks if value is not None)


def type_of(schema, anchors, many=False):
    """Return the type of a value by its JSON schema in the words of TOML, in the plural for
    `many`.
    """
    s = "s" if many else ""
    if "$ref" in schema:
        return f"[table{s}]({anchors[named(schema)]})"
    if variants := [
        one for one in schema.get("anyOf") or schema.get("oneOf") or [] if one.get("type") != "null"
    ]:
        if len(variants) > 1 and all("$ref" in one for one in variants):
            places = (anchors[named(one)] for one in variants)
            return f"table{s}: " + ", ".join(
                f"[{re.split('#|precuts', place)[-1]}]({place})" for place in places
            )
        return " or ".join(type_of(one, anchors, many) for one in variants)
    if "const" in schema:
        return f'`"{schema["const"]}"`'
    if "enum" in schema:
        *others, last = (
            f'`"{value}"`' if isinstance(value, str) else f"`{value}`" for value in schema["enum"]
        )
        return f"{', '.join(others)} or {last}"
    kind = schema.get("type")
    if kind in ("number", "integer"):
        return f"{'number' if kind == 'number' else 'whole number'}{s}{bounds(schema)}"
    if kind == "array":
        inner = schema.get("prefixItems") or [schema.get("items", {})]
        least, most = schema.get("minItems", 0), schema.get("maxItems")
        count = (
            ""
            if most is None and not least
            else f"{least} "
            if least == most
            else f"{least} or more "
            if most is None
            else ""
        )
        count = f"{least} or {most} " if most is not None and most == least + 1 else count
        entries = dict.fromkeys(type_of(one, anchors, many=True) for one in inner)
        alike = len(entries) == 1
        of = next(iter(entries)) if alike else type_of({"type": "number"}, anchors, many=True)
        return f"list{s} of {count}{of}"
    if kind == "object":
        values = schema.get("additionalProperties")
        return (
            f"table{s} of {type_of(values, anchors, many=True)} by name"
            if isinstance(values, dict) and values
            else f"table{s}"
        )
    return {"string": f"text{s}", "boolean": "`true` or `false`"}.get(kind, f"value{s}")


def named(schema):
    """Return the name of the model to which a JSON schema refers."""
    return schema["$ref"].rpartition("/")[2]


def kinds_in(schema):
    """Return the types of the plain values in a JSON schema, at any depth but for those of other
    models.
    """
    inner = [*schema.get("anyOf", []), *schema.get("oneOf", []), *schema.get("prefixItems", [])]
    inner += [
        schema[key]
        for key in ("items", "additionalProperties")
        if isinstance(schema.get(key), dict)
    ]
    return {str(schema.get("type"))}.union(*map(kinds_in, inner))


def rows_of(kind):
    """Yield key, JSON schema, default (``...`` for none), unit and meaning of every field of a
    model; of a shape its name first.
    """
    schema = kind.model_json_schema(by_alias=True)
    schema = schema if "properties" in schema else schema["$defs"][named(schema)]
    for name, field in sorted(
        kind.model_fields.items(),
        key=lambda item: "const" not in schema["properties"].get(item[0], {}),
    ):
        key = field.alias or name
        found = schema["properties"][key]
        meaning, unit = meaning_and_unit(kind, name)
        # A table without a shape is a rectangle.
        required = field.is_required() or found.get("const", "rectangle") != "rectangle"
        yield (
            key,
            found,
            ... if required else found.get("default"),
            unit or ("none" if "integer" in kinds_in(found) else ""),
            meaning,
        )


def keys(page, table):
    """Return the table of the keys of a model."""
    anchors = {
        kind.__name__: f"{place}#{slug(name)}"
        for place, tables in TABLES.items()
        for name, kind in tables.items()
    }
    anchors |= {kind.__name__: f"#{slug(name)}" for name, kind in TABLES[page].items()}
    lines = ["| key | type | default | unit | meaning |", "| --- | --- | --- | --- | --- |"]
    for key, schema, default, unit, meaning in rows_of(TABLES[page][table]):
        dotted = key if table in WHOLE else f"{table.removesuffix('.settings')}.{key}"
        name = (
            f"[`{key}`](#{slug(dotted)})"
            if dotted in TABLES[page]
            else f'<a id="{dotted}"></a>`{key}`'
        )
        typed = (
            f"[table](#{key})" if page == "card.md" and key in PLAIN else type_of(schema, anchors)
        )
        cells = name, typed, default_in_words(default), unit, meaning
        lines.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
    if FURTHER in documented(TABLES[page][table]):
        lines.append(
            f"| further keys |  |  |  | {meaning_and_unit(TABLES[page][table], FURTHER)[0]} |"
        )
    return "\n".join(lines)


def default_in_words(default):
    """Return the default of a key as TOML writes it; nothing for keys that may be left out, such
    as empty lists.
    """
    if default is ...:
        return "required"
    if default is None or isinstance(default, dict) or default in ("", [], ()):
        return ""
    text = (
        f"[{', '.join(f'{value:.4g}' for value in default)}]"
        if isinstance(default, list)
        else f"{default}"
    )
    return f'`"{text}"`' if isinstance(default, str) else f"`{text.lower()}`"


def parameters(page, name):
    """Return the table of the parameters of a material law."""
    law = LAWS[name]
    lines = [
        "| parameter | default | unit | bounds | `identify` searches | meaning |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    least = {"shear_modulus": 0, "bulk_modulus": 0, **law.above}
    for key, default in law.defaults().items():
        meaning, unit = meaning_and_unit(law, key)
        bound = f"> {least[key]:g}" if key in least else ""
        searched = "{:g} to {:g}".format(*law.bounds[key]) if key in law.bounds else ""
        shown = list(default) if isinstance(default, tuple) else default
        cells = f"`{key}`", default_in_words(shown), unit, bound, searched, meaning
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def forces(page, what):
    """Return the table of the force models, built in and shipped, with the law and the planes
    that they serve.
    """
    lines = [
        "| force model | law | plane stress | plane strain | space |",
        "| --- | --- | --- | --- | --- |",
    ]
    built_in = [(name, "every law", kind()) for name, kind in sorted(FORCES.items())]
    shipped = [
        (
            f"{path.parent.name}@{path.name}",
            f"`{load_card(path).material.law}`",
            load_surrogate(path),
        )
        for path in sorted(SHIPPED)
    ]
    for name, law, force in [*built_in, *shipped]:
        served = [
            "yes" if plane in force.honored(plane).get("plane", ()) else "" for plane in PLANES
        ]
        lines.append(f"| `{name}` | {law} | {' | '.join(served)} |")
    return "\n".join(lines)


def commands():
    """Yield name, command and context of every command."""
    group = typer.main.get_command(app)
    with typer.Context(group, info_name="pdsurrogate") as context:
        yield "", group, context
        for name in group.list_commands(context):
            _, command, _ = group.resolve_command(context, [name])
            with typer.Context(command, info_name=name, parent=context) as inner:
                yield name, command, inner


def records(command, context):
    """Return name and help of the arguments and options of a command, alike for all versions of
    Typer.
    """
    found = []
    for parameter in command.params:
        name, text = parameter.get_help_record(context)
        name, _, value = name.partition(" ") if not name.startswith("-v") else (name, "", "")
        value = (
            re.sub(r"^[<[](.*)[]>]$", r"\1", value) if parameter.param_type_name == "option" else ""
        )
        name = name if parameter.param_type_name == "option" or "." in name else name.upper()
        found.append(
            (
                f"{name} {METAVARS.get(value, value)}".strip(),
                " ".join(text.removesuffix("  [required]").split()),
            )
        )
    return found


def options(page, what):
    """Return the commands with their options; those that all commands take stand first."""
    (_, group, top), *each = commands()
    common = [
        record
        for record in records(each[0][1], each[0][2])
        if all(record in records(one, context) for _, one, context in each)
    ]
    parts = [
        f"## All commands\n\n{option_table(records(group, top))}\n\nEvery command"
        f" takes\n\n{option_table(common)}"
    ]
    for name, command, context in each:
        own = [record for record in records(command, context) if record not in common]
        arguments = [name for name, _ in own if not name.startswith("-")]
        usage = " ".join(["pdsurrogate", name, *arguments, "[OPTIONS]"])
        parts.append(
            f"## `{name}`\n\n{command.help}\n\n    {usage}\n\n{option_table(own)}".rstrip()
        )
    return "\n\n".join(parts)


def option_table(rows):
    """Return a table of options, or nothing if there are none."""
    lines = [
        f"| `{name.replace('|', chr(92) + '|')}` | {text.replace('|', chr(92) + '|')} |"
        for name, text in rows
    ]
    return "\n".join(["| argument or option | meaning |", "| --- | --- |", *lines]) if rows else ""


MAKERS: dict[str, Callable[[str, str], str]] = {
    "keys": keys,
    "parameters": parameters,
    "forces": forces,
    "commands": options,
}
"""Functions that make the blocks of a page, by kind."""


def page(path):
    """Return the text of a page with its blocks made anew."""
    return BLOCK.sub(
        lambda m: f"{m[1]}\n{MAKERS[m[2]](path.name, m[3])}\n\n{m[4]}", path.read_text("utf-8")
    )


if __name__ == "__main__":
    for path in sorted(PAGES.glob("*.md")):
        write_text(path, page(path))
