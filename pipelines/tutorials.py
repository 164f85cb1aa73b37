"""Output, pictures and notebooks of the pages that a reader can type: the README, two of
docs/start, and the tutorials.

python pipelines/tutorials.py [PAGE ...]     types the pages (default: all) into empty folders and
updates what depends on it

A ``text`` block of a page is the output of the command or Python block before it, and a picture
with the name of a file that the page draws is that file: both are replaced if the commands now
print or draw something else.  `same_output` says what counts as the same. The notebooks in
docs/notebooks are made from the pages of docs/tutorial, without running them.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from pdsurrogate.results.files import write_text

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
NOTEBOOKS = DOCS / "notebooks"
TUTORIALS = sorted(page for page in (DOCS / "tutorial").glob("*.md") if page.stem != "index")

BLOCK = re.compile(r"^```(python|sh|toml|csv|text)\n(.*?)^```\n", re.MULTILINE | re.DOTALL)

PICTURE = re.compile(r"^!\[[^]]*\]\(([^)]+\.png)\)$", re.MULTILINE)

ENDINGS = {"python": ".py", "toml": ".toml", "csv": ".csv"}

SETS_UP = re.compile(r"(python3[\d.]* -m venv|(\.venv/bin/)?pip )")
"""How a block begins that sets up an environment; of such a block only the `pdsurrogate` command
at its end is typed.
"""

AFTER_SETUP = re.compile(r"&& \.venv/bin/(pdsurrogate .*)$", re.MULTILINE)

BETWEEN = "\x1e"
"""Printed between two blocks of Python, to separate their output."""

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")

RELATIVE = 1e-3
"""Relative difference up to which two printed numbers are the same, beyond one unit of the last
printed digit.  Chosen: processors and versions of libraries round differently, and an equilibrium
is only as exact as its tolerance.
"""

FACTOR = 2.0
"""Factor between two printed numbers below `SMALL` that are the same: an error of 1e-8 is mostly
rounding, and only its order is the same on another processor.
"""

SMALL = 1e-5
"""Absolute value below which only the order of a number is compared.  Chosen: on these pages
only errors are as small.
"""

DURATION = re.compile(r"\d (s|ms|ns|min|GiB)\b")
"""Mark of a line with a time or a memory size, which depend on the machine: such a line is not
compared.
"""


@dataclass(frozen=True)
class Block:
    """A fenced block of a page: its kind, its text, the file that it is the content of ("" if
    none), and where its text stands.
    """

    kind: str
    text: str
    file: str
    start: int
    end: int


def blocks_of(page):
    """Return the blocks of a page; a block is the content of the file that the paragraph before
    it names, as in "This is `sheet.py`:".
    """
    found = []
    for match in BLOCK.finditer(page):
        kind, text = match.groups()
        before = page[: match.start()].rstrip().rpartition("\n\n")[2]
        named = [
            name
            for name in re.findall(r"`([\w./-]+)`", before)
            if kind in ENDINGS and name.endswith(ENDINGS[kind])
        ]
        file = Path(named[-1]).name if named and before.endswith(":") else ""
        found.append(Block(kind, text, file, match.start(2), match.end(2)))
    return found


def command_of(block):
    """Return what is typed of a block of commands: all of it, or the end of one that sets up an
    environment.
    """
    if SETS_UP.match(block.text):
        return "\n".join(AFTER_SETUP.findall(block.text))
    return block.text


def type_in(page, folder, **variables):
    """Do in a folder what a page says, and return what its blocks of Python and of commands print.

    First the files are written, then all Python runs as one script, then the commands.  A block
    that fails is an error.
    """
    blocks = blocks_of(page.read_text("utf-8"))
    for block in blocks:
        if block.file:
            (folder / block.file).write_text(block.text, "utf-8")
    typed = [block for block in blocks if block.kind == "python" and not block.file]
    commands = [block for block in blocks if block.kind == "sh" and command_of(block)]
    # The commands of the environment that this runs in, as if it were active, on a terminal of 80
    # columns.
    paths = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": paths, "COLUMNS": "80", "MPLBACKEND": "agg", **variables}

    def printed_by(command):
        done = subprocess.run(
            command,
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        if done.returncode:
            raise RuntimeError(f"{page.name}: {command[-1]}\n{done.stdout}\n{done.stderr}")
        return done.stdout

    printed = {}
    if typed:
        (folder / "typed.py").write_text(
            f"print({BETWEEN!r}, flush=True)\n".join(block.text for block in typed), "utf-8"
        )
        printed = dict(
            zip(typed, printed_by([sys.executable, "typed.py"]).split(f"{BETWEEN}\n"), strict=True)
        )
    for block in commands:
        printed[block] = printed_by(["bash", "-euo", "pipefail", "-c", command_of(block)])
    return printed


def outputs_of(page):
    """Return the output that a page shows: each ``text`` block by the block of Python or of
    commands before it.
    """
    blocks = blocks_of(page.read_text("utf-8"))
    return {before: block for before, block in pairwise(blocks) if block.kind == "text"}


def _unit(number):
    """Return one unit of the last digit of a printed number."""
    digits, _, exponent = number.partition("e")
    return 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2]))


def _same_number(shown, printed):
    a, b = float(shown), float(printed)
    if 0 < abs(a) < SMALL:
        return 1 / FACTOR <= b / a <= FACTOR
    return abs(a - b) <= 1.01 * _unit(shown) + RELATIVE * abs(a)


def _same_line(shown, printed):
    if DURATION.search(shown):
        return bool(DURATION.search(printed))
    # A number with more digits moves what follows it, and the lines of a table.
    words, others = (
        re.sub(r"[\s─━]+", " ", NUMBER.sub("#", line)).strip() for line in (shown, printed)
    )
    return words == others and all(
        map(_same_number, NUMBER.findall(shown), NUMBER.findall(printed))
    )


def same_output(shown, printed):
    """Return whether a page shows what was printed, numbers within the tolerances above; a line
    ``...`` stands for any number of lines.

    Lines with a time or a memory size are there in both, but are not compared.
    """

    def same(shown, printed):
        if not shown:
            return not printed
        if shown[0] == "...":
            return any(same(shown[1:], printed[start:]) for start in range(len(printed) + 1))
        return bool(printed) and _same_line(shown[0], printed[0]) and same(shown[1:], printed[1:])

    return same(
        *([line.rstrip() for line in text.strip("\n").splitlines()] for text in (shown, printed))
    )


def pictures_of(page, folder):
    """Return the pictures on a page, as files of the documentation, that the page has drawn in
    the folder, with what it has drawn.
    """
    targets = [(page.parent / name).resolve() for name in PICTURE.findall(page.read_text("utf-8"))]
    return {target: drawn for target in targets for drawn in sorted(folder.rglob(target.name))[:1]}


def update(page):
    """Type a page, and replace the output and the pictures on it that are no longer those of its
    commands.
    """
    with tempfile.TemporaryDirectory() as name:
        folder, content = Path(name), page.read_text("utf-8")
        printed = type_in(page, folder)
        for before, block in reversed(outputs_of(page).items()):
            if not same_output(block.text, printed[before]):
                text = "".join(
                    f"{line.rstrip()}\n" for line in printed[before].strip("\n").splitlines()
                )
                content = content[: block.start] + text + content[block.end :]
        write_text(page, content)
        for target, drawn in pictures_of(page, folder).items():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(drawn, target)


def notebook_of(page):
    """Return a tutorial as a notebook without output: Python and files as cells, commands with
    ``!``, and the pictures they draw.
    """
    import nbformat
    from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

    content, cells = page.read_text("utf-8"), []

    def add_text(text):
        """Add a cell of text, and one for each picture on it; links lead nowhere from a notebook
        that stands alone.
        """
        place = 0
        for match in [*PICTURE.finditer(text), None]:
            words = re.sub(
                r"\[([^]]+)\]\([^)]+\)", r"\1", text[place : match.start() if match else None]
            ).strip()
            if words:
                cells.append(new_markdown_cell(words))
            if match:
                place, picture = match.end(), Path(match[1]).name
                files = re.findall(rf"[\"`]((?:[\w.-]+/)*{re.escape(picture)})[\"`]", content)
                if files:
                    cells.append(
                        new_code_cell(f'from IPython.display import Image\n\nImage("{files[-1]}")')
                    )

    place = 0
    for block in blocks_of(content):
        opening = content.rindex("```", 0, block.start)
        add_text(content[place:opening])
        place = content.index("\n", block.end) + 1
        if block.file:
            cells.append(new_code_cell(f"%%writefile {block.file}\n{block.text.strip()}"))
        elif block.kind == "python":
            cells.append(new_code_cell(block.text.strip()))
        elif block.kind == "sh" and not SETS_UP.match(block.text):
            cells.append(
                new_code_cell("\n".join(f"!{line}" for line in block.text.strip().splitlines()))
            )
        elif block.kind != "text":
            cells.append(new_markdown_cell(content[opening:place].strip()))
    add_text(content[place:])
    for number, cell in enumerate(cells):
        cell["id"] = f"{page.stem}-{number}"
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook = new_notebook(
        cells=cells,
        nbformat_minor=5,
        metadata={"kernelspec": kernel, "language_info": {"name": "python"}},
    )
    nbformat.validate(notebook)
    return nbformat.writes(notebook) + "\n"


if __name__ == "__main__":
    typed = [
        ROOT / "README.md",
        DOCS / "start/installation.md",
        DOCS / "start/first-steps.md",
        *TUTORIALS,
    ]
    for page in [Path(name).resolve() for name in sys.argv[1:]] or typed:
        print(page.relative_to(ROOT), flush=True)
        update(page)
        if page in TUTORIALS:
            write_text(NOTEBOOKS / f"{page.stem}.ipynb", notebook_of(page))
