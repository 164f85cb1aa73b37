"""The page of all files of the package: what each is for, by its own docstring, and the names that it defines.

python pipelines/files.py     writes docs/development/files.md anew
"""

import ast
from pathlib import Path

from pdsurrogate.results.files import write_text

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "development" / "files.md"

HEAD = """# Files of the package

This page lists every file of `pdsurrogate/` by subpackage, with its purpose and the public names that it defines. The script
`pipelines/files.py` writes the page from the docstrings; a test compares them. [Architecture](../architecture.md) shows which subpackage
may import which, and where a change belongs.
"""


def names_of(module: ast.Module) -> list[str]:
    """Classes, functions and constants of a module that begin without an underscore, in their order."""
    found = []
    for statement in module.body:
        if isinstance(statement, ast.ClassDef | ast.FunctionDef):
            found.append(statement.name)
        elif isinstance(statement, ast.Assign):
            targets = (name for target in statement.targets for name in ast.walk(target) if isinstance(name, ast.Name))
            found += [name.id for name in targets if name.id.isupper()]
        elif isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name) and statement.target.id.isupper():
            found.append(statement.target.id)
    return [name for name in dict.fromkeys(found) if not name.startswith("_")]


def page() -> str:
    """The text of the page."""
    rooms: dict[str, list[str]] = {}
    for path in sorted((ROOT / "pdsurrogate").rglob("*.py")):
        module = ast.parse(path.read_text("utf-8"))
        place = path.relative_to(ROOT / "pdsurrogate")
        room = place.parts[0] if len(place.parts) > 1 else "at the top"
        what = " ".join((ast.get_docstring(module) or "").split("\n\n")[0].split())
        names = ", ".join(f"`{name}`" for name in names_of(module))
        rooms.setdefault(room, []).append(f"| `{place.as_posix()}` | {what} | {names} |")
    header = "| file | what it is for | defines |\n| --- | --- | --- |\n"
    return HEAD + "".join(f"\n## {room}\n\n{header}" + "\n".join(rows) + "\n" for room, rows in rooms.items())


if __name__ == "__main__":
    write_text(PAGE, page())
