"""Tables and figures of the README: a marked block is replaced by what a pipeline measured."""

from __future__ import annotations

from pathlib import Path

from pdsurrogate.results.files import write_text

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "pipelines" / "figures"


def replace_block(name: str, text: str) -> None:
    """Put text between ``<!-- NAME -->`` and ``<!-- /NAME -->`` of the README."""
    path = ROOT / "README.md"
    content = path.read_text("utf-8")
    begin, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    if begin not in content or end not in content:
        raise ValueError(f"README.md has no block {name}")
    head, rest = content.split(begin, 1)
    _, tail = rest.split(end, 1)
    write_text(path, f"{head}{begin}{text.strip()}\n{end}{tail}")


def markdown_table(header: list[str], rows: list[list[str]]) -> str:
    """A table, first column to the left and the others to the right."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
