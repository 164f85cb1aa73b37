"""The documentation says what the code does: its examples run, its equations are those that the code cites, its files exist."""

import doctest
import importlib.util
import re
import runpy
from pathlib import Path

import pytest

import pdsurrogate as pd
from pdsurrogate.forces import FORCES
from pdsurrogate.kernels.feature_sets import FEATURE_SETS
from pdsurrogate.materials import LAWS
from pdsurrogate.results.measures import POINT_FIELDS

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
EXAMPLES = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
WITH_EXAMPLES = [page for page in (ROOT / "README.md", *PAGES) if EXAMPLES.search(page.read_text())]


@pytest.fixture
def tables():
    """The tables that examples add to; afterwards they are as before."""
    kept = [(table, dict(table)) for table in (LAWS, FORCES, FEATURE_SETS, POINT_FIELDS)]
    yield
    for table, entries in kept:
        table.clear()
        table.update(entries)


@pytest.mark.slow  # laws, features and force models of their own have to be compiled
@pytest.mark.parametrize("page", WITH_EXAMPLES, ids=lambda page: page.stem)
def test_examples_run(page, tables, tmp_path, monkeypatch):
    """All examples of a page, one after the other, as one script in an empty folder; those that check themselves do so at their ends."""
    monkeypatch.chdir(tmp_path)
    blocks = EXAMPLES.findall(page.read_text())
    script = tmp_path / f"{page.stem}.py"  # a file, from which numba can cache
    script.write_text("\n".join(blocks))
    runpy.run_path(str(script))


PUBLIC = sorted(set(pd.__all__) - {"LAWS"})


def examples_of(name):
    """The examples in the docstring of a public name."""
    thing = getattr(pd, name)
    return doctest.DocTestParser().get_doctest(thing.__doc__, {}, name, None, None)


@pytest.mark.parametrize("name", PUBLIC)
def test_public_names_have_an_example_that_runs(name, tmp_path, monkeypatch, tables):
    found = examples_of(name)
    assert found.examples, f"{name} has no example"
    if "torch" in name.lower() and importlib.util.find_spec("torch") is None:
        pytest.skip("torch is not installed")
    monkeypatch.chdir(tmp_path)
    said = []
    doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(found, out=said.append)
    assert not said, "".join(said)


def test_every_field_is_in_the_table_of_the_guide():
    rows = re.findall(r"^\| `(\w+)` \| (\d) \| (\w*) *\|.*\| (`tests/.*`) \|$", (DOCS / "guide" / "results.md").read_text(), re.MULTILINE)
    assert {name: (int(components), unit or None) for name, components, unit, _ in rows} == {
        name: (field.components, field.unit) for name, field in POINT_FIELDS.items()
    }


@pytest.mark.slow  # they train, and compile a force that is not otherwise taken
@pytest.mark.parametrize("script", sorted((ROOT / "pipelines" / "examples").glob("*.py")), ids=lambda script: script.stem)
def test_notebooks_run(script, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = runpy.run_path(str(script))
    checks = {
        "first_sheet": lambda: found["difference"] < 1e-3,
        "own_rubber": lambda: abs(found["error"]) < 1e-3,
        "tear": lambda: abs(found["gap"]) < 0.02 * found["last"]["work"] and Path("tear.html").exists(),
    }
    assert checks[script.stem]()


def test_equations_are_numbered_in_order_and_cited_by_numbers_that_exist():
    theory = (DOCS / "theory.md").read_text()
    numbers = [int(number) for number in re.findall(r"\\tag\{(\d+)\}", theory)]
    assert numbers == list(range(1, len(numbers) + 1))
    sections = {int(number) for number in re.findall(r"^## (\d+)\. ", theory, re.MULTILINE)}
    sources = [*(path for room in ("pdsurrogate", "pipelines", "tests") for path in (ROOT / room).rglob("*.py")), *PAGES]
    for path in sources:
        for citation in re.findall(r"[Tt]heory((?:,? (?:and )?\(\d+\)(?:[-\u2013]\(\d+\))?)+)", path.read_text()):
            assert {int(number) for number in re.findall(r"\d+", citation)} <= set(numbers), f"{path.name}: {citation}"
        for number in re.findall(r"theory, section (\d+)", path.read_text()):
            assert int(number) in sections, f"{path.name}: section {number}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_files_that_are_named_exist(page):
    """Files stand in backticks, named from the root of the repository or from the package."""
    for name in re.findall(r"`((?:[\w.-]+/)+[\w.-]*)`", page.read_text()):
        assert (ROOT / name).exists() or (ROOT / "pdsurrogate" / name).exists(), name
