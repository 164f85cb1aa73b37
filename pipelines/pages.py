"""Tables and figures of the documentation: a marked block is replaced by what a pipeline
measured.
"""

from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
FIGURES = DOCS / "figures"


def replace_block(name, text):
    """Put text between ``<!-- NAME -->`` and ``<!-- /NAME -->``, on the one page of the
    documentation that has them.
    """
    begin, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    pages = {path: path.read_text("utf-8") for path in DOCS.rglob("*.md")}
    found = [path for path, content in pages.items() if begin in content and end in content]
    if len(found) != 1:
        raise ValueError(f"{len(found)} pages have a block {name}; there must be one")
    head, rest = pages[found[0]].split(begin, 1)
    found[0].write_text(f"{head}{begin}{text.strip()}\n{end}{rest.split(end, 1)[1]}", "utf-8")


def markdown_table(header, rows):
    """A table, first column to the left and the others to the right."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def shown(value, form):
    """A figure in the format of its column; of several each, and a dash for none."""
    if isinstance(value, list):
        return " / ".join(shown(one, form) for one in value)
    return "-" if value is None else value if isinstance(value, str) else format(value, form)


def rounded(value):
    """A figure, or what contains some, with six digits as JSON has it."""
    if isinstance(value, dict):
        return {key: rounded(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return list(map(rounded, value))
    return float(f"{value:.6g}") if isinstance(value, float) else value
