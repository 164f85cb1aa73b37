"""What mkdocs does not do by itself: equations as MathML, which browsers show without a script,
and the pages of the public names.
"""

import html
import re
import sys
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parent))

import api_pages
from signatures import HOMES, path_of

EQUATION = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
NUMBER = re.compile(r"\\tag\{(\d+)\}")
LEFT = re.compile(r"\\|&(?!#?\w+;)|linebreak=")
"""What no MathML may hold: a backslash command or an ampersand that was not translated, or a
line break that browsers do not make.
"""

TAG = re.compile(r"<.*?>")
LONG = 30
"""Characters of a formula within a line that may not fit a screen of 400 pixels."""

CODE = re.compile(
    r"<(a|autoref|h\d|pre)\b.*?</\1>|<code>(?P<module>pds\.|pdsurrogate\.)?(?P<name>[A-Za-z][\w.]*)(?:\([^<]*\))?</code>",
    re.DOTALL,
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
        return (
            f'<span class="formula">{formula}</span>'
            if len(TAG.sub("", formula)) > LONG
            else formula
        )
    anchor, label = (f' id="eq-{number[1]}"', f"<span>({number[1]})</span>") if number else ("", "")
    return f'<div class="equation"{anchor}><div tabindex="0">{formula}</div>{label}</div>'


def linked(match: re.Match) -> str:
    """Code that names a public name, or a member of one, as a link to its description."""
    if not match["name"]:
        return match[0]
    first, dot, rest = match["name"].partition(".")
    path = path_of(
        f"pds.{match['name']}" if match["module"] else f"{CLASSES.get(first)}{dot}{rest}"
    )
    return f'<autoref identifier="{path}" optional>{match[0]}</autoref>' if path else match[0]


def on_files(files, config):
    """Add the pages of public names, from the table by which the package finds them."""
    for name, text in api_pages.pages():
        files.append(File.generated(config, f"{API}/{name}.md", content=text))
    return files


def on_page_markdown(markdown, page, config, files):
    """Append the list of all public names to their first page."""
    return (
        f"{markdown}\n\n{api_pages.index()}" if page.file.src_uri == f"{API}/index.md" else markdown
    )


def on_page_content(content, page, config, files):
    """Translate the equations of a page, make names in code links to their descriptions, and
    give a page of one section all the width.
    """
    if sum(len(heading.children) for heading in page.toc) < 2:
        page.meta["hide"] = ["toc"]
    content = EQUATION.sub(_mathml, content)
    if 'class="arithmatex"' in content:
        raise PluginError(f"{page.file.src_uri}: an equation was not translated")
    return CODE.sub(linked, content)


def on_env(env, config, files):
    """Refuse two pages with the same title: readers could not tell them apart in the navigation
    and in the search.
    """
    seen = {}
    for file in files.documentation_pages():
        title = str(file.page.title).casefold()
        if title in seen:
            raise PluginError(
                f"{file.src_uri} and {seen[title]} have the same title, {file.page.title!r}"
            )
        seen[title] = file.src_uri
