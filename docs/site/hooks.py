"""What mkdocs does not do by itself: equations as MathML, which browsers show without a script, and the list of public names."""

import html
import re
import sys
from pathlib import Path

from latex2mathml.converter import convert

sys.path.insert(0, str(Path(__file__).parents[2]))

import pdsurrogate

EQUATION = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
NUMBER = re.compile(r"\\tag\{(\d+)\}")


def _mathml(match: re.Match) -> str:
    """MathML of an equation; a displayed one with a number gets it at the margin, and an anchor."""
    text, displayed = html.unescape(match[2]), match[1] == "div"
    number = NUMBER.search(text)
    formula = convert(NUMBER.sub("", text).strip(), display="block" if displayed else "inline")
    if "\\" in formula:
        raise ValueError(f"no MathML for a command in {text}")
    if not displayed:
        return formula
    row = '<div id="eq-{0}" style="display: flex; align-items: center">{1}<span>({0})</span></div>'
    return row.format(number[1], formula.replace("<math ", '<math style="flex: 1" ', 1)) if number else formula


def on_page_content(content, page, config, files):
    """Equations of a page."""
    return EQUATION.sub(_mathml, content)


def on_page_markdown(markdown, page, config, files):
    """On the page of public names: a section for each room, from the table by which the package finds them."""
    if page.file.src_uri != "api.md":
        return markdown
    rooms = pdsurrogate._IN_ROOMS
    homes = pdsurrogate._NAMES | {room: f"{rooms[room]} {pdsurrogate._NAMES.get(room, '')}" for room in rooms}
    sections = (
        f"## {home}\n\n" + "\n\n".join(f"::: pdsurrogate.{home}.{name}" for name in sorted(homes[home].split())) for home in sorted(homes)
    )
    return "\n\n".join([markdown, *sections])
