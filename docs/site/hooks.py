"""What mkdocs does not do by itself: equations as MathML, which browsers show without a script, and the pages of the public names."""

import html
import re
import sys
from pathlib import Path

import griffe
from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

import pdsurrogate

EQUATION = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
NUMBER = re.compile(r"\\tag\{(\d+)\}")
LEFT = re.compile(r"\\|&(?!#?\w+;)|linebreak=|arithmatex")
"""What no MathML may hold: a backslash command or an ampersand that was not translated, or a line break that browsers do not make."""

HOMES = {f"pds.{name}": f"pdsurrogate.{home}.{name}" for name, home in pdsurrogate._HOMES.items()} | {
    f"pds.{room}.{name}": f"pdsurrogate.{room}.{name}" for room, names in pdsurrogate._IN_ROOMS.items() for name in names.split()
}
"""Path of every public name, by the name that scripts write."""

CODE = re.compile(r"<a\b.*?</a>|<h\d\b.*?</h\d>|<pre\b.*?</pre>|<code>(?:pds|pdsurrogate)\.([\w.]+)(\([^<]*\))?</code>", re.DOTALL)
API = "reference/api"


def _mathml(match: re.Match) -> str:
    """MathML of an equation; a displayed one with a number gets it at the margin, and an anchor."""
    text, displayed = html.unescape(match[2]), match[1] == "div"
    number = NUMBER.search(text)
    formula = convert(NUMBER.sub("", text).strip(), display="block" if displayed else "inline")
    if found := LEFT.search(formula):
        raise PluginError(f"no MathML for {found[0]!r} in the equation {text.strip()}")
    if not displayed:
        return formula
    anchor, label = (f' id="eq-{number[1]}"', f"<span>({number[1]})</span>") if number else ("", "")
    return f'<div class="equation"{anchor}><div tabindex="0">{formula}</div>{label}</div>'


def _linked(match: re.Match) -> str:
    """Code that names a public name, or a member of one, as a link to its description."""
    known = f"pds.{match[1]}"
    path = HOMES.get(known)
    if path is None and (cls := HOMES.get(known.rpartition(".")[0])):
        path = f"{cls}.{known.rpartition('.')[2]}"
    return f'<autoref identifier="{path}" optional>{match[0]}</autoref>' if path else match[0]


def _api_pages():
    """The text of the page of every room with public names, by its name, and the rows of all of them for the index."""
    package = griffe.load("pdsurrogate", search_paths=[ROOT])
    public = set(HOMES.values()) | {package[path.partition(".")[2]].canonical_path for path in HOMES.values()}
    rooms = {}
    for name, path in sorted(HOMES.items(), key=lambda item: item[0].lower()):
        rooms.setdefault(path.split(".")[1], []).append((name, path))
    for room in sorted(rooms):
        rows, sections, bases = [], [], {}
        for name, path in rooms[room]:
            thing = package[path.partition(".")[2]]
            what = " ".join(thing.docstring.value.split("\n\n")[0].split())
            rows.append(f"| [`{name}`][{path}] | {what} |")
            sections.append(f"::: {path}\n    options:\n      heading: {name}\n      toc_label: {name.rpartition('.')[2]}")
            if thing.is_class:
                bases |= {base.canonical_path: base.name for base in thing.mro() if base.canonical_path not in public}
        if bases:
            sections.append("The classes above derive from the following ones, which are no public names but define members of theirs.")
            sections += [f"::: {path}\n    options:\n      heading: {name}" for path, name in sorted(bases.items(), key=lambda base: base[1])]
        about = package[room].docstring.value
        yield room, "\n\n".join([f"# pdsurrogate.{room}", about, _table(rows), *sections]), rows


def _table(rows):
    return "\n".join(["| name | what it is |", "| --- | --- |", *rows])


def on_files(files, config):
    """Add the pages of public names, from the table by which the package finds them."""
    for room, text, rows in _api_pages():
        files.append(File.generated(config, f"{API}/{room}.md", content=text))
        config.extra.setdefault("rooms", {})[room] = rows
    return files


def on_page_markdown(markdown, page, config, files):
    """Append the list of all public names to their first page."""
    if page.file.src_uri != f"{API}/index.md":
        return markdown
    rooms = config.extra["rooms"]
    return "\n\n".join([markdown, *(f"## [pdsurrogate.{room}]({room}.md)\n\n{_table(rooms[room])}" for room in rooms)])


def on_page_content(content, page, config, files):
    """Translate the equations of a page, and make names in code links to their descriptions."""
    return CODE.sub(lambda match: _linked(match) if match[1] else match[0], EQUATION.sub(_mathml, content))


def on_env(env, config, files):
    """Refuse two pages with the same title: readers could not tell them apart in the navigation and in the search."""
    seen = {}
    for file in files.documentation_pages():
        title = str(file.page.title).casefold()
        if title in seen:
            raise PluginError(f"{file.src_uri} and {seen[title]} have the same title, {file.page.title!r}")
        seen[title] = file.src_uri
