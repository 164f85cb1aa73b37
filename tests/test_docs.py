"""The documentation says what the code does: its examples run, its equations are those that the
code cites, its files exist.
"""

import doctest
import inspect
import math
import re
import runpy
import shlex
import tomllib
from operator import attrgetter
from pathlib import Path

import numpydoc.validate
import pytest
import typer
from conftest import PUBLIC_NAMES, needs_torch
from test_pages import PAGES as TYPED_PAGES

import pdsurrogate as pds
from pdsurrogate.cli import app
from pdsurrogate.forces import FORCES
from pdsurrogate.identification.campaign import Campaign
from pdsurrogate.kernels.feature_sets import FEATURE_SETS
from pdsurrogate.materials import LAWS
from pdsurrogate.results.measures import POINT_FIELDS
from pdsurrogate.scenes import load_scene, scene_names
from pdsurrogate.studies.description import parameters_of_runs
from pdsurrogate.studies.runs import tasks_of

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
BLOCKS = {
    kind: re.compile(rf"^```{kind}\n(.*?)^```", re.MULTILINE | re.DOTALL)
    for kind in ("python", "sh", "toml")
}
EXAMPLES = BLOCKS["python"]
TYPED = {DOCS / name for name in TYPED_PAGES}
"""Pages whose Python and commands are run together."""

WITH_EXAMPLES = [page for page in PAGES if EXAMPLES.search(page.read_text()) and page not in TYPED]


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
    """All examples of a page, one after the other, as one script in an empty folder; those that
    check themselves do so at their ends.
    """
    monkeypatch.chdir(tmp_path)
    blocks = EXAMPLES.findall(page.read_text())
    script = tmp_path / f"{page.stem}.py"  # a file, from which numba can cache
    script.write_text("\n".join(blocks))
    runpy.run_path(str(script))


CHECKED = {"PR01", "PR02", "RT01", "EX01", "SS03", "GL08"}
"""Checks of numpydoc: parameters, those that there are, what is returned, an example, the period
of the summary, a docstring at all.
"""


def methods_of(cls):
    """Public methods and properties that a class or a base of ours defines: by full name, the
    class that defines it and the member.
    """
    found = {}
    for base in cls.__mro__:
        for name, member in vars(base).items():
            function = (
                getattr(member, "fget", None)
                or getattr(member, "func", None)
                or getattr(member, "__func__", member)
            )
            ours = (
                inspect.isfunction(function)
                and function.__qualname__ == f"{base.__qualname__}.{name}"
            )
            if (
                ours
                and base.__module__.startswith("pdsurrogate.")
                and not name.startswith(("_", "model_"))
            ):
                found[f"{base.__module__}.{function.__qualname__}"] = base, member
    return found


METHODS = {}
for name in PUBLIC_NAMES:
    if inspect.isclass(cls := attrgetter(name)(pds)):
        METHODS |= methods_of(cls)

DESCRIBED = {
    f"pdsurrogate.{name}": attrgetter(name)(pds)
    for name in sorted(PUBLIC_NAMES)
    if name != "materials.LAWS"
} | {name: member for name, (_, member) in sorted(METHODS.items()) if member.__doc__}
"""What has a docstring of its own: all public names, and all of their methods but those that do
what their base says.
"""


def test_methods_without_a_docstring_do_what_a_base_says():
    def described(cls, name):
        return any(vars(base)[name].__doc__ for base in cls.__mro__ if name in vars(base))

    assert not [
        full for full, (cls, _) in METHODS.items() if not described(cls, full.rpartition(".")[2])
    ]


def test_docstrings_of_public_names_are_complete():
    errors = {name: numpydoc.validate.validate(name)["errors"] for name in DESCRIBED}
    assert not [
        f"{name}: {code}: {message}"
        for name, found in errors.items()
        for code, message in found
        if code in CHECKED
    ]


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=needs_torch if "Torch" in name else ()) for name in DESCRIBED]
)
def test_public_names_have_an_example_that_runs(name, tmp_path, monkeypatch, tables):
    found = doctest.DocTestParser().get_doctest(DESCRIBED[name].__doc__, {}, name, None, None)
    assert found.examples, f"{name} has no example"
    monkeypatch.chdir(tmp_path)
    said = []
    doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(found, out=said.append)
    assert not said, "".join(said)


def test_every_field_is_in_the_table_of_the_reference():
    page = (DOCS / "reference" / "summary.md").read_text()
    rows = re.findall(
        r"^\| `(\w+)` \| (\d) \| (\w*) *\|.* <!-- (tests/.*) --> \|$", page, re.MULTILINE
    )
    assert {name: (int(components), unit or None) for name, components, unit, _ in rows} == {
        name: (field.components, field.unit) for name, field in POINT_FIELDS.items()
    }

    for name, *_, tests in rows:
        assert all(f'"{name}"' in (ROOT / file).read_text() for file in tests.split()), (
            f"{name} is not tested in {tests}"
        )


def words_of(line):
    """Words of a printed command without its comment, from the name of the program on; none of
    another program's.
    """
    words = shlex.split(line, comments=True)
    return words[1:] if words and Path(words[0]).name == "pdsurrogate" else []


def commands_of(page):
    """The commands that a page prints."""
    lines = [
        line for block in BLOCKS["sh"].findall(page.read_text()) for line in block.splitlines()
    ]
    return [words for line in lines for part in line.split(" && ") if (words := words_of(part))]


WITH_COMMANDS = [page for page in (ROOT / "README.md", *PAGES) if commands_of(page)]


@pytest.mark.parametrize("page", WITH_COMMANDS, ids=lambda page: page.stem)
def test_commands_that_are_printed_are_understood(page):
    """Commands, options and, of built-in scenes, every --set; what they do has its tests
    elsewhere.
    """
    group = typer.main.get_command(app)
    for words in commands_of(page):
        if words == ["--version"]:  # printed while options are read, and the program ends
            continue
        with group.make_context("pdsurrogate", list(words)) as context:
            name, command, rest = group.resolve_command(
                context, context._protected_args + context.args
            )
            given = command.make_context(name, rest, parent=context).params
        if given.get("scene") in pds.scene_names() and not given.get("imports"):
            pds.load_scene(given["scene"], given["change"] or [])


def described(page):
    """The scenes and studies that a page prints; what is a part of a scene, in the place of that
    of the scene before.
    """
    whole = {}
    for block in BLOCKS["toml"].findall(page.read_text()):
        found = tomllib.loads(block)
        whole = found if {"name", "scene", "fit"} & set(found) else {**whole, **found}
        yield whole


@pytest.mark.parametrize(
    "page",
    [page for page in (ROOT / "README.md", *PAGES) if BLOCKS["toml"].search(page.read_text())],
    ids=lambda page: page.stem,
)
def test_scenes_studies_and_campaigns_that_are_printed_are_understood(page, tmp_path):
    for number, found in enumerate(described(page)):
        if "parameters" in found:
            study = pds.Study.model_validate(found)
            tasks_of(study, tmp_path, parameters_of_runs(study), math.inf)
        elif "test" in found:
            assert all(one.stated() for one in Campaign.model_validate(found).test)
        else:
            assert pds.Scene.model_validate(found).spacing > 0, number


def test_equations_are_numbered_in_order_and_cited_by_numbers_that_exist():
    theory = (DOCS / "theory.md").read_text()
    numbers = [int(number) for number in re.findall(r"\\tag\{(\d+)\}", theory)]
    assert numbers == list(range(1, len(numbers) + 1))
    sections = {int(number) for number in re.findall(r"^## (\d+)\. ", theory, re.MULTILINE)}
    sources = [
        *(
            path
            for room in ("pdsurrogate", "pipelines", "tests")
            for path in (ROOT / room).rglob("*.py")
        ),
        *PAGES,
    ]
    for path in sources:
        for citation in re.findall(
            r"[Tt]heory((?:,? (?:and )?\(\d+\)(?:[-\u2013]\(\d+\))?)+)", path.read_text()
        ):
            assert {int(number) for number in re.findall(r"\d+", citation)} <= set(numbers), (
                f"{path.name}: {citation}"
            )
        for number in re.findall(r"theory, section (\d+)", path.read_text()):
            assert int(number) in sections, f"{path.name}: section {number}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_files_that_are_named_exist(page):
    """Files stand in backticks, named from the root of the repository or from the package; those
    below `out` are made by a run.
    """
    for name in re.findall(r"`((?!out/)(?:[\w.-]+/)+[\w.-]*)`", page.read_text()):
        assert (ROOT / name).exists() or (ROOT / "pdsurrogate" / name).exists(), name


def test_every_scene_is_in_the_gallery():
    """With its title, its picture, which is a small file, and a command that runs it."""
    page, pictures = (DOCS / "gallery.md").read_text(), DOCS / "figures" / "gallery"
    for name in scene_names():
        assert f"## {name}\n" in page
        assert load_scene(name).title in page
        assert f"](figures/gallery/{name}.png)" in page
        assert f"`pdsurrogate run {name} " in page
        assert 2_000 < (pictures / f"{name}.png").stat().st_size < 80_000
    assert {path.stem for path in pictures.glob("*.png")} == set(scene_names())
