"""The stub that type checkers read of the package declares the names that the package loads on
first use.
"""

import ast
import re
import subprocess
import sys
import tomllib
from operator import attrgetter
from pathlib import Path

import pytest
from conftest import PUBLIC_NAMES
from refusals import raising

import pdsurrogate as pds

SCRIPTS = Path(__file__).parent / "typing"


def test_a_name_of_a_room_says_where_it_is():
    with raising(r"it is pdsurrogate\.shapes\.Rectangle", AttributeError):
        getattr(pds, "Rectangle")  # noqa: B009


def test_a_right_script_uses_every_public_name():
    script = (SCRIPTS / "right.py").read_text(encoding="utf-8")
    assert not [name for name in PUBLIC_NAMES if not re.search(rf"\bpds\.{name}\b", script)]


def test_stub_declares_every_public_name_from_its_home():
    stub = ast.parse(Path(pds.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    declared = {
        name.asname: statement.module
        for statement in stub.body
        if isinstance(statement, ast.ImportFrom)
        for name in statement.names
        if name.asname == name.name
    }
    rooms = {name for name, home in declared.items() if home is None}
    assert rooms == vars(pds)["_ROOMS"]
    assert {name: home for name, home in declared.items() if home is not None} == vars(pds)[
        "_HOMES"
    ]


def test_mypy_checks_the_modules_that_define_public_names():
    modules = {
        getattr(attrgetter(name)(pds), "__module__", "pdsurrogate.materials")
        for name in PUBLIC_NAMES
    }
    root = SCRIPTS.parents[1]
    listed = set(
        tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mypy"][
            "files"
        ]
    )
    assert not [
        module
        for module in modules
        if not {f"{(path := module.replace('.', '/'))}.py", f"{path}/__init__.py"} & listed
    ]


OPTIONS = {
    "mypy": ["--config-file=", "--follow-imports=silent", "--ignore-missing-imports"],
    "pyright": ["--pythonpath", sys.executable],
}


@pytest.fixture(scope="module", params=["pyright", "mypy"])
def lines_with_errors(request):
    """Return, by name of script, the lines in which a type checker finds errors; it checks both
    scripts in one run.
    """
    checker = request.param
    pytest.importorskip(checker)
    if subprocess.run(
        [sys.executable, "-m", checker, "--version"], capture_output=True, check=False
    ).returncode:
        pytest.skip(
            f"{checker} does not start here: pyright fetches its own program from npm on first use"
        )
    command = [
        sys.executable,
        "-m",
        checker,
        *OPTIONS[checker],
        *(str(SCRIPTS / name) for name in ("right.py", "wrong.py")),
    ]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=SCRIPTS.parents[1]
    )
    found = {"right.py": set(), "wrong.py": set()}
    for name, number in re.findall(r"(right\.py|wrong\.py):(\d+):(?:\d+ -)? error", done.stdout):
        found[name].add(int(number))
    # neither checked nothing nor failed to start
    assert done.returncode == 1, done.stdout + done.stderr
    return found


@pytest.mark.slow  # a type checker reads the whole package
def test_right_calls_pass(lines_with_errors):
    assert lines_with_errors["right.py"] == set()


@pytest.mark.slow
def test_each_wrong_call_is_an_error(lines_with_errors):
    lines = (SCRIPTS / "wrong.py").read_text(encoding="utf-8").splitlines()
    assert lines_with_errors["wrong.py"] == {
        number for number, line in enumerate(lines, 1) if line.startswith("pds.")
    }
