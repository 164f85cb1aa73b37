"""The reference says what the code does: its tables are made from the models, and nothing is missing from them."""

import ast
import importlib.util
import math
import re
import tomllib
from operator import attrgetter
from pathlib import Path

import pytest

import pdsurrogate as pds
from pdsurrogate.artifacts.card import KINDS
from pdsurrogate.body import WEIGHT_FUNCTIONS
from pdsurrogate.scenes.strict_model import StrictModel

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "docs" / "reference"
PAGES = sorted(REFERENCE.glob("*.md"))

SPECIFICATION = importlib.util.spec_from_file_location("reference", ROOT / "pipelines" / "reference.py")
reference = importlib.util.module_from_spec(SPECIFICATION)
SPECIFICATION.loader.exec_module(reference)

TABLES = [pytest.param(page, table, id=f"{page}-{table}") for page, tables in reference.TABLES.items() for table in tables]


def subclasses(kind: type) -> set[type]:
    """Return all classes of the package that derive from a class."""
    found = set().union(*({one, *subclasses(one)} for one in kind.__subclasses__()))
    return {one for one in found if one.__module__.startswith("pdsurrogate.")}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_tables_are_those_that_the_script_makes(page):
    """If not: python pipelines/reference.py."""
    assert page.read_text("utf-8") == reference.page(page)


@pytest.mark.parametrize("page", reference.TABLES)
def test_every_table_stands_on_its_page(page):
    assert re.findall(r"^<!-- keys ([\w.]+) -->$", (REFERENCE / page).read_text(), re.MULTILINE) == sorted(
        reference.TABLES[page], key=lambda table: (REFERENCE / page).read_text().find(f"<!-- keys {table} -->")
    )


def test_every_model_has_a_table():
    """All models but bases, whose keys stand in the tables of those that derive from them."""
    known = {kind for tables in reference.TABLES.values() for kind in tables.values()}
    assert {kind for kind in subclasses(StrictModel) if not subclasses(kind)} <= known


@pytest.mark.parametrize(("page", "table"), TABLES)
def test_every_key_has_a_meaning_and_every_number_a_unit(page, table):
    kind = reference.TABLES[page][table]
    for key, schema, _, unit, meaning in reference.rows_of(kind):
        assert meaning.endswith("."), f"{kind.__name__}: the docstring has no meaning for {key}"
        numbers = {"number", "integer"} & reference.kinds_in(schema)
        assert bool(unit) == bool(numbers), f"{kind.__name__}.{key}: Unit: ... belongs to numbers, and to all of them"


@pytest.mark.parametrize(("page", "table"), TABLES)
def test_docstrings_describe_keys_that_exist_and_inherited_ones_alike(page, table):
    kind = reference.TABLES[page][table]
    described = reference.documented(kind)
    assert set(described) == set(kind.model_fields)
    for base in subclasses(StrictModel) & {*kind.__mro__}:
        assert reference.documented(base).items() <= described.items(), base.__name__


@pytest.mark.parametrize("name", reference.LAWS)
def test_every_parameter_of_a_law_has_a_meaning_and_a_unit(name):
    law = reference.LAWS[name]
    rows = reference.parameters("laws.md", name).splitlines()[2:]
    assert [row.split("`")[1] for row in rows] == list(reference.documented(law))
    assert all(re.fullmatch(r"\| `\w+` \|.*\| (stress|none) \|.*\.( \|)", row) for row in rows)


def values_in(value):
    """Yield all parts of a scene, at any depth."""
    if isinstance(value, StrictModel):
        yield value
        value = {name: getattr(value, name) for name in type(value).model_fields}
    for inner in value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else ():
        yield from values_in(inner)


def test_every_table_of_a_scene_has_an_example():
    """That they load is seen by `test_docs.py`."""
    whole, shown = {}, set()
    for block in re.findall(r"^```toml\n(.*?)^```", (REFERENCE / "scene.md").read_text(), re.MULTILINE | re.DOTALL):
        found = tomllib.loads(block)
        whole = found if "name" in found else {**whole, **found}
        shown |= {type(part) for part in values_in(pds.Scene(**whole))}
    assert set(reference.TABLES["scene.md"].values()) <= shown


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_within_the_reference_lead_somewhere(page):
    for place, anchor in re.findall(r"\]\(([\w.-]*\.md|)#([\w.-]+)\)", page.read_text()):
        text = (REFERENCE / (place or page.name)).read_text()
        titles = (re.sub(r"[^\w\s-]", "", title).strip() for title in re.findall(r"^#+ (.*)$", text, re.MULTILINE))
        assert anchor in {title.lower().replace(" ", "-") for title in titles} or f'<a id="{anchor}">' in text, anchor


def test_choices_that_are_checked_elsewhere_are_all_described():
    described = reference.documented(pds.Scene)["weight"]
    assert re.findall(r'``"(\w+)"``', described) == list(WEIGHT_FUNCTIONS)
    assert re.findall(r"[\w]+-[\w-]+", reference.documented(reference.TABLES["card.md"]["card"])["kind"]) == list(KINDS)


def test_every_error_that_a_card_reports_is_described():
    """Of all shipped artifacts, which have every kind of report."""
    written = re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`\w+`.*?) \|", (REFERENCE / "card.md").read_text(), re.MULTILINE)))
    declared = set(reference.TABLES["card.md"]["errors.report"].model_fields)
    for path in sorted((ROOT / "artifacts").glob("*/*/card.json")):
        assert set(pds.load_card(path.parent).errors["box"]) <= declared | set(written), path


def messages_of_the_package():
    """Return all texts in the source but docstrings, with … in the place of values."""

    def text_of(node):
        if isinstance(node, ast.Constant):
            return node.value if isinstance(node.value, str) else ""
        return re.sub("…+", "…", "".join(part.value if isinstance(part, ast.Constant) else "…" for part in node.values))

    nodes = [node for path in (ROOT / "pdsurrogate").rglob("*.py") for node in ast.walk(ast.parse(path.read_text("utf-8")))]
    docstrings = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    return {text_of(node) for node in nodes if isinstance(node, ast.Constant | ast.JoinedStr) and id(node) not in docstrings}


def test_messages_on_the_page_of_errors_are_those_of_the_package():
    """Each is a part of one text of the source, with … for a value; at its ends other texts may stand in the place of values."""
    rows = re.findall(r"^\| `([^`]+)` \| [^|]+ \| [^|]+ \|$", (REFERENCE / "errors.md").read_text(), re.MULTILINE)
    messages = [row for row in rows if " " in row and not row.startswith("pds.")]
    assert len(messages) > 70
    known = messages_of_the_package()
    for message in messages:
        end = message.strip("….")
        assert any(message in text or (len(end) > 15 and end in text) for text in known), message


def test_classes_on_the_page_of_errors_exist():
    for name in re.findall(r"^\| `pds\.([\w.]+)`", (REFERENCE / "errors.md").read_text(), re.MULTILINE):
        assert issubclass(attrgetter(name)(pds), Exception)


SYSTEMS = {"Pa, m, s": (1.0, 1.0, 1.0), "kPa, cm, s": (1e3, 1e-2, 1.0), "MPa, mm, s": (1e6, 1e-3, 1.0), "MPa, mm, ms": (1e6, 1e-3, 1e-3)}
"""Units of stress, length and time of the systems on the page of units, in Pa, m and s."""

TYPICAL = {
    "shear modulus": (4e5, (1, 0, 0)),
    "bulk modulus": (4e8, (1, 0, 0)),
    "density": (1000.0, (1, -2, 2)),
    "speed of shear waves": (20.0, (0, 1, -1)),
    "fracture energy": (3000.0, (1, 1, 0)),
    "weight per volume": (9810.0, (1, -1, 0)),
    "force": (1.0, (1, 2, 0)),
    "energy": (1.0, (1, 3, 0)),
}
"""Values in SI units, and the powers of stress, length and time in their unit."""


def test_typical_values_are_alike_in_all_systems():
    text = (REFERENCE / "units.md").read_text().split("## Consistent systems")[1]
    header, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in re.findall(r"^\|.*\|$", text, re.MULTILINE)]
    assert header[1:] == list(SYSTEMS)
    seen = set()
    for name, *cells in rows:
        quantity = name.partition(",")[0]
        value, powers = TYPICAL[quantity]
        seen.add(quantity)
        for cell, units in zip(cells, SYSTEMS.values(), strict=True):
            unit = math.prod(one**power for one, power in zip(units, powers, strict=True))
            if quantity in ("force", "energy"):  # how much one unit is, in N or J
                assert float(cell.split()[0] if " " in cell else 1) == pytest.approx(unit)
            else:
                assert float(cell) == pytest.approx(value / unit)
    assert seen == set(TYPICAL)


def test_units_of_keys_are_those_of_the_reference_of_scenes():
    known = {}
    for table, kind in reference.TABLES["scene.md"].items():
        known |= {key if table == "scene" else f"{table}.{key}": unit for key, _, _, unit, _ in reference.rows_of(kind)}
    known["body.size"] = known["rectangle.size"]
    text = (REFERENCE / "units.md").read_text().split("## Consistent systems")[0]
    compared = 0
    for unit, keys in re.findall(r"^\| [^|]+ \| ([^|]+) \| ([^|]+) \|$", text, re.MULTILINE):
        for key in set(re.findall(r"`([\w.]+)`", keys)) & set(known):
            assert known[key] == {"stress length²": "force", "stress time²/length²": "stress time^2/length^2"}.get(unit, unit), key
            compared += 1
    assert compared > 12
