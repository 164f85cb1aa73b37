"""Tables and figures of the documentation: a marked block is replaced by what a pipeline
measured.
"""

from __future__ import annotations

from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
FIGURES, VALIDATION = DOCS / "figures", DOCS / "validation"


def replace_block(name: str, text: str) -> None:
    """Put text between ``<!-- NAME -->`` and ``<!-- /NAME -->``, on the one page of
    ``docs/validation`` that has them.
    """
    page, head, _, tail = _parts(name)
    page.write_text(f"{head}{text.strip()}\n{tail}", "utf-8")


def block(name: str) -> str:
    """What is between the marks of that name."""
    return _parts(name)[2]


def _parts(name: str) -> tuple[Path, str, str, str]:
    """The page of a block, and its content before, within and after it; the marks belong to what
    is before and after.
    """
    begin, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    pages = {path: path.read_text("utf-8") for path in VALIDATION.glob("*.md")}
    found = [path for path, content in pages.items() if begin in content and end in content]
    if len(found) != 1:
        raise ValueError(
            f"{len(found)} pages of docs/validation have a block {name}; there must be one"
        )
    head, rest = pages[found[0]].split(begin, 1)
    within, tail = rest.split(end, 1)
    return found[0], head + begin, within, end + tail


def markdown_table(header: list[str], rows: list[list[str]]) -> str:
    """A table, first column to the left and the others to the right."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
