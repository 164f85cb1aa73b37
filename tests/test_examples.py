"""The scripts in docs/examples run as a reader runs them, each in an empty folder, and are as
short as they promise.
"""

import ast
import runpy
import warnings
from pathlib import Path

import pytest
from conftest import needs_torch

from pdsurrogate.forces import OutsideDomainWarning
from pdsurrogate.materials import LAWS

SCRIPTS = sorted((Path(__file__).parents[1] / "docs" / "examples").glob("*.py"))
LINES, COLUMNS = 40, 100
NEED_TORCH = {"fit_a_torch_network"}


@pytest.fixture
def laws():
    """The table of laws, to which an example may add; afterwards it is as before."""
    kept = dict(LAWS)
    yield
    LAWS.clear()
    LAWS.update(kept)


@pytest.mark.parametrize(
    "script",
    [
        pytest.param(path, id=path.stem, marks=needs_torch if path.stem in NEED_TORCH else ())
        for path in SCRIPTS
    ],
)
def test_an_example_runs_without_remarks_and_writes_nothing(script, laws, tmp_path, monkeypatch):
    """Its assertion is the comparison; warnings of the package would be the first that a reader
    sees.
    """
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("default")
        runpy.run_path(str(script), run_name="__main__")
    remarks = (UserWarning, OutsideDomainWarning)  # those about threads depend on the machine
    assert not [str(one.message) for one in shown if issubclass(one.category, remarks)]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_an_example_is_short_and_ends_with_one_comparison(script):
    text = script.read_text("utf-8")
    lines = text.splitlines()
    assert len(lines) <= LINES
    assert max(map(len, lines)) <= COLUMNS
    module = ast.parse(text)
    assert len(ast.get_docstring(module).splitlines()) <= 2
    assert isinstance(module.body[-1], ast.Assert)
    assert sum(isinstance(node, ast.Assert) for node in ast.walk(module)) == 1
