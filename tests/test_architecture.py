"""Who imports whom: the table of docs/architecture.md against the imports of all modules."""

import ast
import re
import runpy
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "pdsurrogate"
ROWS = re.findall(
    r"^\| `(\w+)` \|[^|]*\|([^|]*)\|$",
    (ROOT / "docs" / "architecture.md").read_text(),
    re.MULTILINE,
)
ALLOWED = {room: set(re.findall(r"`(\w+)`", imports)) for room, imports in ROWS}
TRAINING = ("sklearn", "skorch", "torch", "dask", "distributed")
ROOMS_WITH_TRAINING = {"learning", "identification", "calibration", "testing"}
COMMANDS_WITH_TRAINING = {
    f"pdsurrogate.cli.{name}" for name in ("calibrate", "data", "evaluate", "fit", "identify")
}


def name_of(path):
    """Name of the module in a file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {name_of(path): path for path in PACKAGE.rglob("*.py")}


AT_ONCE, LATER, FOR_CHECKERS = (
    "as soon as the module is loaded",
    "inside a function",
    "by type checkers only",
)


def import_statements(node, when=AT_ONCE):
    """Yield the import statements under a node of a syntax tree, each with when it runs."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield child, when
        inner = when
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            inner = FOR_CHECKERS
        elif when == AT_ONCE and isinstance(
            child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda
        ):
            inner = LATER
        yield from import_statements(child, inner)


@cache
def imports_of(module):
    """Return the names that a module imports: all, those at once, and those that are not for
    type checkers only.
    """
    package = module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]
    every, at_once, run = set(), set(), set()
    for statement, when in import_statements(ast.parse(MODULES[module].read_text())):
        if isinstance(statement, ast.Import):
            source = ""
        else:
            base = package.rsplit(".", statement.level - 1)[0] if statement.level else ""
            source = ".".join(filter(None, (base, statement.module))) + "."
        names = {source + alias.name for alias in statement.names}
        every |= names
        at_once |= names if when == AT_ONCE else set()
        run |= names if when != FOR_CHECKERS else set()
    return every, at_once, run


def room_of(name):
    """Room that an imported name of the package belongs to; none for those of the package
    itself.
    """
    parts = name.split(".")
    return (
        parts[1]
        if parts[0] == PACKAGE.name and len(parts) > 1 and not parts[1].startswith("__")
        else None
    )


def loaded_with(module):
    """All modules and foreign names that are loaded as soon as a module is."""
    loaded, waiting = set(), [module]
    while waiting:
        name = waiting.pop()
        # A module brings the packages that it stands in; an imported name that is no module, the
        # module that has it.
        for part in (name.rsplit(".", number)[0] for number in range(name.count(".") + 1)):
            if part not in loaded:
                loaded.add(part)
                waiting += imports_of(part)[1] if part in MODULES else ()
    return loaded


def test_the_files_that_the_page_names_exist():
    page = (ROOT / "docs" / "architecture.md").read_text()
    assert {
        name
        for name in re.findall(r"`(\w+/\w+\.py)`", page)
        if not any((root / name).exists() for root in (PACKAGE, ROOT))
    } == set()


def test_every_room_is_in_the_table():
    rooms = {room_of(module) for module in MODULES} - {None}
    assert rooms == set(ALLOWED)


def test_no_arrow_of_the_table_points_up():
    below = set()
    for room, imports in ALLOWED.items():
        assert imports <= below, (
            f"{room} imports {', '.join(sorted(imports - below))}, which stand below it"
        )
        below.add(room)


@pytest.mark.parametrize("room", ALLOWED)
def test_rooms_import_what_the_table_allows(room):
    modules = [module for module in MODULES if room_of(module) == room]
    for module in modules:
        arrows = {other for name in imports_of(module)[0] if (other := room_of(name))} - {room}
        assert arrows <= ALLOWED[room], (
            f"{module} imports {', '.join(sorted(arrows - ALLOWED[room]))}"
        )


@pytest.mark.parametrize("room", [room for room in ALLOWED if room not in ROOMS_WITH_TRAINING])
def test_a_simulation_loads_neither_scikit_learn_nor_torch_nor_dask(room):
    for module in MODULES:
        if room_of(module) == room and module not in COMMANDS_WITH_TRAINING:
            found = {name for name in loaded_with(module) if name.split(".")[0] in TRAINING}
            assert not found, f"{module} loads {', '.join(sorted(found))}"


def files_reached_from(module):
    """Return the files that a file imports, directly or not, at once, inside functions, or for
    annotations.
    """
    reached, waiting = set(), [module]
    while waiting:
        for name in imports_of(waiting.pop())[0]:
            file = name if name in MODULES else name.rpartition(".")[0]
            # A package is not a step of a circle: files of a room import each other through it.
            if file in MODULES and file not in reached and MODULES[file].name != "__init__.py":
                reached.add(file)
                waiting.append(file)
    return reached


def test_no_file_imports_itself_in_a_circle():
    """Nor in annotations alone."""
    circles = {module for module in MODULES if module in files_reached_from(module)}
    assert not circles, sorted(circles)


def functions_of(module):
    """Yield the functions of a module with how many arguments they take by position, apart from
    self and cls.
    """
    for node in ast.walk(ast.parse(MODULES[module].read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            names = [argument.arg for argument in (*node.args.posonlyargs, *node.args.args)]
            yield node, len(names) - (names[:1] in (["self"], ["cls"]))


def test_functions_take_at_most_eight_arguments_by_position():
    """Apart from kernels, whose arguments are arrays."""
    for module in MODULES:
        if room_of(module) != "kernels":
            assert not [function.name for function, count in functions_of(module) if count > 8], (
                module
            )


def test_classes_have_at_most_twenty_public_methods():
    for module, path in MODULES.items():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                public = [
                    part.name
                    for part in node.body
                    if isinstance(part, ast.FunctionDef) and not part.name.startswith("_")
                ]
                assert len(public) <= 20, f"{module}: {node.name}"


def test_forces_and_loads_are_not_searched_for_what_they_may_have():
    """What one lacks is an empty part with the same methods; no class forwards all that it does
    not have.
    """
    for module, path in MODULES.items():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                assert "__getattr__" not in [
                    part.name for part in node.body if isinstance(part, ast.FunctionDef)
                ], f"{module}: {node.name}"
            if isinstance(node, ast.Call) and ast.unparse(node.func) in (
                "getattr",
                "hasattr",
                "setattr",
            ):
                asked = ast.unparse(node.args[0])
                assert not re.search(
                    r"\b(force|forces|loaded|loads|loading|controlled|internal|term|terms)$", asked
                ), f"{module}: {asked}"


SLOW = {
    *("cli.simulation", "forces.pair_memory", "forces.sheet_memory", "kernels.rates"),
    *("learning", "results", "run.followed", "run.preview", "problem.strength", "run.strength"),
    *("run.relaxing", "run.tear_account", "run.tearing", "cards"),
}
"""What functions import of our own: rooms and files that load numba, scikit-learn, torch or
matplotlib, or are for few materials.
"""


def test_functions_import_none_of_our_own_but_what_is_slow():
    """For nothing else: an import inside a function hides a circle."""
    for module in MODULES:
        _every, at_once, run = imports_of(module)
        later = {name for name in run - at_once if name.startswith(f"{PACKAGE.name}.")}
        rooms = {".".join(name.split(".")[1:]) for name in later}
        assert (
            all(name.startswith(tuple(SLOW)) for name in rooms)
            or module == f"{PACKAGE.name}.__main__"
        ), f"{module}: {rooms}"


def test_torch_is_loaded_on_request_alone():
    asked_for = {"learning.torch_training"}
    for module in MODULES:
        if module.removeprefix(f"{PACKAGE.name}.") not in asked_for:
            assert not {
                name for name in loaded_with(module) if name.split(".")[0] in ("skorch", "torch")
            }, module


def test_the_pages_of_files_and_examples_are_those_of_their_docstrings():
    for path, page in runpy.run_path(str(ROOT / "pipelines" / "files.py"))["PAGES"].items():
        assert path.read_text("utf-8") == page(), "python pipelines/files.py makes it anew"
