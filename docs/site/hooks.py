"""What mkdocs does not do by itself: equations as MathML, which browsers show without a script, and the pages of the public names."""

import html
import re
import sys
from pathlib import Path

import griffe
from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parent))

from signatures import HOMES, path_of

ROOT = Path(__file__).parents[2]
EQUATION = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
NUMBER = re.compile(r"\\tag\{(\d+)\}")
LEFT = re.compile(r"\\|&(?!#?\w+;)|linebreak=")
"""What no MathML may hold: a backslash command or an ampersand that was not translated, or a line break that browsers do not make."""

TAG = re.compile(r"<.*?>")
LONG = 30
"""Characters of a formula within a line that may not fit a screen of 400 pixels."""

CODE = re.compile(
    r"<(a|autoref|h\d|pre)\b.*?</\1>|<code>(?P<module>pds\.|pdsurrogate\.)?(?P<name>[A-Za-z][\w.]*)(?:\([^<]*\))?</code>", re.DOTALL
)
"""A name in code, with or without arguments; links, headings and blocks of code are passed over."""

CLASSES = {name.rpartition(".")[2]: name for name in HOMES if name.rpartition(".")[2][0].isupper()}
"""Public names that a page may write without the module, as `Scene`."""

API = "reference/api"


def _mathml(match: re.Match) -> str:
    """MathML of an equation; a displayed one with a number gets it at the margin, and an anchor."""
    text, displayed = html.unescape(match[2]), match[1] == "div"
    number = NUMBER.search(text)
    formula = convert(NUMBER.sub("", text).strip(), display="block" if displayed else "inline")
    if found := LEFT.search(formula):
        raise PluginError(f"no MathML for {found[0]!r} in the equation {text.strip()}")
    if not displayed:  # what may be wider than a phone scrolls
        return f'<span class="formula">{formula}</span>' if len(TAG.sub("", formula)) > LONG else formula
    anchor, label = (f' id="eq-{number[1]}"', f"<span>({number[1]})</span>") if number else ("", "")
    return f'<div class="equation"{anchor}><div tabindex="0">{formula}</div>{label}</div>'


def _linked(match: re.Match) -> str:
    """Code that names a public name, or a member of one, as a link to its description."""
    if not match["name"]:
        return match[0]
    first, dot, rest = match["name"].partition(".")
    path = path_of(f"pds.{match['name']}" if match["module"] else f"{CLASSES.get(first)}{dot}{rest}")
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
            above = thing.mro() if thing.is_class else []
            own = {base.canonical_path: base.name for base in above if base.canonical_path not in public and _has_members(base)}
            bases |= own
            derived = own or any(base.canonical_path in public for base in above)
            sections.append(_section(path, name, show_bases=bool(derived)))
        if bases:
            sections.append("The classes above derive from the following ones, which are no public names but define members of theirs.")
            sections += [_section(path, name, show_bases=False) for path, name in sorted(bases.items(), key=lambda base: base[1])]
        about = package[room].docstring.value
        yield room, "\n\n".join([f"# pdsurrogate.{room}", about, _table(rows), *sections]), rows


def _has_members(cls):
    """Whether a class has public methods or properties with a description."""
    functions = [member for name, member in cls.members.items() if not name.startswith(("_", "model_"))]
    return any(member.docstring and (member.is_function or "property" in member.labels) for member in functions)


def _section(path, heading, show_bases):
    """What makes mkdocstrings describe a name."""
    return (
        f"::: {path}\n    options: {{heading: {heading}, toc_label: {heading.rpartition('.')[2]}, show_bases: {str(show_bases).lower()}}}"
    )


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
    """Translate the equations of a page, make names in code links to their descriptions, and give a page of one section all the width."""
    if sum(len(heading.children) for heading in page.toc) < 2:
        page.meta["hide"] = ["toc"]
    content = EQUATION.sub(_mathml, content)
    if 'class="arithmatex"' in content:
        raise PluginError(f"{page.file.src_uri}: an equation was not translated")
    return CODE.sub(_linked, content)


def on_env(env, config, files):
    """Refuse two pages with the same title: readers could not tell them apart in the navigation and in the search."""
    seen = {}
    for file in files.documentation_pages():
        title = str(file.page.title).casefold()
        if title in seen:
            raise PluginError(f"{file.src_uri} and {seen[title]} have the same title, {file.page.title!r}")
        seen[title] = file.src_uri
