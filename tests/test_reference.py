"""The reference says what the code does: its tables are made from the models, and nothing is
missing from them.
"""

import ast
import importlib.util
import re
import tomllib
from operator import attrgetter
from pathlib import Path

import pytest

import pdsurrogate as pds
from pdsurrogate.artifacts.card import KINDS
from pdsurrogate.kernels.weights import WEIGHT_FUNCTIONS
from pdsurrogate.scenes.strict_model import StrictModel

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "docs" / "reference"
PAGES = sorted(REFERENCE.glob("*.md"))

SPECIFICATION = importlib.util.spec_from_file_location(
    "reference", ROOT / "pipelines" / "reference.py"
)
reference = importlib.util.module_from_spec(SPECIFICATION)
SPECIFICATION.loader.exec_module(reference)

TABLES = [
    pytest.param(page, table, id=f"{page}-{table}")
    for page, tables in reference.TABLES.items()
    for table in tables
]


def subclasses(kind: type) -> set[type]:
    """Return all classes of the package that derive from a class."""
    found = set().union(*({one, *subclasses(one)} for one in kind.__subclasses__()))
    return {one for one in found if one.__module__.startswith("pdsurrogate.")}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_tables_are_those_that_the_script_makes(page):
    """If not: python pipelines/reference.py."""
    assert page.read_text("utf-8") == reference.page(page)


def test_every_model_has_a_table():
    """All models but bases, whose keys stand in the tables of those that derive from them, and
    internal ones, which add no key.
    """
    known = {kind for tables in reference.TABLES.values() for kind in tables.values()}
    internal = {kind for kind in subclasses(StrictModel) if kind.__name__.startswith("_")}
    assert all(kind.model_fields.keys() == kind.__base__.model_fields.keys() for kind in internal)
    assert {
        kind for kind in subclasses(StrictModel) - internal if not subclasses(kind) - internal
    } <= known


@pytest.mark.parametrize(("page", "table"), TABLES)
def test_every_key_has_a_meaning_and_every_number_a_unit(page, table):
    kind = reference.TABLES[page][table]
    for key, schema, _, unit, meaning in reference.rows_of(kind):
        assert meaning.endswith("."), f"{kind.__name__}: the docstring has no meaning for {key}"
        numbers = {"number", "integer"} & reference.kinds_in(schema)
        assert bool(unit) == bool(numbers), (
            f"{kind.__name__}.{key}: Unit: ... belongs to numbers, and to all of them"
        )


@pytest.mark.parametrize(("page", "table"), TABLES)
def test_docstrings_describe_keys_that_exist_and_inherited_ones_alike(page, table):
    kind = reference.TABLES[page][table]
    described = reference.documented(kind)
    assert set(described) == {
        *kind.model_fields,
        *([reference.FURTHER] if kind.model_config["extra"] == "allow" else []),
    }
    for base in subclasses(StrictModel) & {*kind.__mro__}:
        assert reference.documented(base).items() <= described.items(), base.__name__


@pytest.mark.parametrize("name", reference.LAWS)
def test_every_parameter_of_a_law_has_a_meaning_and_a_unit(name):
    law = reference.LAWS[name]
    rows = reference.parameters("laws.md", name).splitlines()[2:]
    described = [key for key in reference.documented(law) if key != "memory"]
    assert [row.split("`")[1] for row in rows] == described
    assert all(re.fullmatch(r"\| `\w+` \|.*\| (stress|none) \|.*\.( \|)", row) for row in rows)


def values_in(value):
    """Yield all parts of a scene, at any depth."""
    if isinstance(value, StrictModel):
        yield value
        value = {name: getattr(value, name) for name in type(value).model_fields}
    for inner in (
        value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else ()
    ):
        yield from values_in(inner)


def test_every_table_of_a_scene_has_an_example():
    """That they load is seen by `test_docs.py`."""
    whole, shown = {}, set()
    for block in re.findall(
        r"^```toml\n(.*?)^```", (REFERENCE / "scene.md").read_text(), re.MULTILINE | re.DOTALL
    ):
        found = tomllib.loads(block)
        whole = found if "name" in found else {**whole, **found}
        shown |= {type(part) for part in values_in(pds.Scene(**whole))}
    assert set(reference.TABLES["scene.md"].values()) <= shown


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_within_the_reference_lead_somewhere(page):
    for place, anchor in re.findall(r"\]\(([\w.-]*\.md|)#([\w.-]+)\)", page.read_text()):
        text = (REFERENCE / (place or page.name)).read_text()
        titles = (
            re.sub(r"[^\w\s-]", "", title).strip()
            for title in re.findall(r"^#+ (.*)$", text, re.MULTILINE)
        )
        assert (
            anchor in {title.lower().replace(" ", "-") for title in titles}
            or f'<a id="{anchor}">' in text
        ), anchor


def test_choices_that_are_checked_elsewhere_are_all_described():
    described = reference.documented(pds.Scene)["weight"]
    assert re.findall(r'``"(\w+)"``', described) == list(WEIGHT_FUNCTIONS)
    assert re.findall(
        r"[\w]+-[\w-]+", reference.documented(reference.TABLES["card.md"]["card"])["kind"]
    ) == list(KINDS)


def test_every_error_that_a_card_reports_is_described():
    """Of all shipped artifacts, which have every kind of report."""
    written = re.findall(
        r"`(\w+)`",
        "".join(
            re.findall(r"^\| (`\w+`.*?) \|", (REFERENCE / "card.md").read_text(), re.MULTILINE)
        ),
    )
    declared = set(reference.TABLES["card.md"]["errors.report"].model_fields)
    for path in sorted((ROOT / "artifacts").glob("*/*/card.json")):
        assert set(pds.load_card(path.parent).errors["box"]) <= declared | set(written), path


def messages_of_the_package():
    """Return all texts in the source but docstrings, with … in the place of values."""

    def text_of(node):
        if isinstance(node, ast.Constant):
            return node.value if isinstance(node.value, str) else ""
        return re.sub(
            "…+",
            "…",
            "".join(part.value if isinstance(part, ast.Constant) else "…" for part in node.values),
        )

    nodes = [
        node
        for path in (ROOT / "pdsurrogate").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
    ]
    docstrings = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    return {
        text_of(node)
        for node in nodes
        if isinstance(node, ast.Constant | ast.JoinedStr) and id(node) not in docstrings
    }


def test_messages_on_the_page_of_errors_are_those_of_the_package():
    """Each is a part of one text of the source, with … for a value; at its ends other texts may
    stand in the place of values.
    """
    rows = re.findall(
        r"^\| `([^`]+)` \| [^|]+ \| [^|]+ \|$", (REFERENCE / "errors.md").read_text(), re.MULTILINE
    )
    messages = [row for row in rows if " " in row and not row.startswith("pds.")]
    assert len(messages) > 70
    known = messages_of_the_package()
    for message in messages:
        end = message.strip("….")
        assert any(message in text or (len(end) > 15 and end in text) for text in known), message


def test_classes_on_the_page_of_errors_exist():
    for name in re.findall(
        r"^\| `pds\.([\w.]+)`", (REFERENCE / "errors.md").read_text(), re.MULTILINE
    ):
        assert issubclass(attrgetter(name)(pds), Exception)


LAWS_PAGE = (REFERENCE / "laws.md").read_text()
SECTIONS = dict(re.findall(r"^## `([\w-]+)`\n(.*?)(?=^## )", LAWS_PAGE, re.MULTILINE | re.DOTALL))


def test_every_law_has_a_section():
    assert list(SECTIONS) == re.findall(r"<!-- parameters ([\w-]+) -->", LAWS_PAGE)
    assert set(SECTIONS) == set(reference.LAWS)
