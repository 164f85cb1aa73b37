"""The pages of all files of the package and of all examples: what each is for, by its own
docstring.

python pipelines/files.py     writes docs/development/files.md and docs/examples/index.md anew
"""

import ast
from pathlib import Path

from pdsurrogate.results.files import write_text

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "docs" / "examples"

HEAD = """# Files of the package

This page lists every file of `pdsurrogate/` by subpackage, with its purpose and the public names
that it defines. The script `pipelines/files.py` writes the page from the docstrings; a test
compares them. [Architecture](../architecture.md) shows which subpackage may import which, and where
a change belongs.
"""


HEAD_OF_EXAMPLES = """# Examples

Each example is a script of at most 40 lines that runs in a few seconds, once its kernels are
compiled, and ends by comparing one number with a closed solution, finite elements, a test or an
exact law. Copy one to start from, or run it from a checkout: `python docs/examples/own_scene.py`.
The script `pipelines/files.py` writes this page from the docstrings.

| example | what it shows |
| --- | --- |
"""


def what_for(module):
    """The first paragraph of a module's docstring, in one line."""
    return " ".join((ast.get_docstring(module) or "").split("\n\n")[0].split())


def names_of(module):
    """Classes, functions and constants of a module that begin without an underscore, in their
    order.
    """
    found = []
    for statement in module.body:
        if isinstance(statement, ast.ClassDef | ast.FunctionDef):
            found.append(statement.name)
        elif isinstance(statement, ast.Assign | ast.AnnAssign):
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            inside = (name for target in targets for name in ast.walk(target))
            found += [
                name.id for name in inside if isinstance(name, ast.Name) and name.id.isupper()
            ]
    return [name for name in dict.fromkeys(found) if not name.startswith("_")]


def files():
    """The page of the files."""
    rooms: dict[str, list[str]] = {}
    for path in sorted((ROOT / "pdsurrogate").rglob("*.py")):
        module = ast.parse(path.read_text("utf-8"))
        place = path.relative_to(ROOT / "pdsurrogate")
        room = place.parts[0] if len(place.parts) > 1 else "at the top"
        names = ", ".join(f"`{name}`" for name in names_of(module))
        rooms.setdefault(room, []).append(
            f"| `{place.as_posix()}` | {what_for(module)} | {names} |"
        )
    header = "| file | what it is for | defines |\n| --- | --- | --- |\n"
    return HEAD + "".join(
        f"\n## {room}\n\n{header}" + "\n".join(rows) + "\n" for room, rows in rooms.items()
    )


def examples():
    """The page of the examples."""
    shown = {
        path.name: what_for(ast.parse(path.read_text("utf-8")))
        for path in sorted(EXAMPLES.glob("*.py"))
    }
    return HEAD_OF_EXAMPLES + "".join(
        f"| [`{name}`]({name}) | {what} |\n" for name, what in shown.items()
    )


PAGES = {ROOT / "docs" / "development" / "files.md": files, EXAMPLES / "index.md": examples}

if __name__ == "__main__":
    for path, page in PAGES.items():
        write_text(path, page())
