"""The reference says what the code does: its tables are made from the models, and nothing is missing from them."""

import ast
import importlib.util
import math
import re
import tomllib
from operator import attrgetter
from pathlib import Path

import latex
import numpy as np
import pytest
from scipy.optimize import brentq

import pdsurrogate as pds
from pdsurrogate.artifacts.card import KINDS
from pdsurrogate.kernels.weights import WEIGHT_FUNCTIONS
from pdsurrogate.materials import ArrudaBoyce, FullNetwork, Gent, MooneyRivlin, NeoHookean, Ogden, Polyconvex, Yeoh
from pdsurrogate.materials.law import InvariantLaw
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
    """All models but bases, whose keys stand in the tables of those that derive from them, and internal ones, which add no key."""
    known = {kind for tables in reference.TABLES.values() for kind in tables.values()}
    internal = {kind for kind in subclasses(StrictModel) if kind.__name__.startswith("_")}
    assert all(kind.model_fields.keys() == kind.__base__.model_fields.keys() for kind in internal)
    assert {kind for kind in subclasses(StrictModel) - internal if not subclasses(kind) - internal} <= known


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
    assert set(described) == {*kind.model_fields, *([reference.FURTHER] if kind.model_config["extra"] == "allow" else [])}
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


def langevin(beta):
    return 1 / np.tanh(beta) - 1 / beta


def inverse_langevin(y):
    """By bisection; the package iterates from an approximation."""
    flat = np.atleast_1d(y)
    found = np.array(
        [brentq(lambda beta, value=value: langevin(beta) - value, 1e-9, 1e4, xtol=1e-14, rtol=1e-14) for value in flat.ravel()]
    )
    return found.reshape(flat.shape) if np.ndim(y) else float(found[0])


def directions_of_chains():
    """Return a quadrature over directions, Gauss's in height and even in angle; the package takes Lebedev's."""
    heights, weights = np.polynomial.legendre.leggauss(24)
    angles = (np.arange(24) + 0.5) * np.pi / 24
    across = np.sqrt(1 - heights**2)[:, None]
    r = [(across * np.cos(angles)).ravel(), (across * np.sin(angles)).ravel(), np.repeat(heights, 24)]
    return r, np.repeat(weights, 24) / 48


LAWS_PAGE = (REFERENCE / "laws.md").read_text()
SECTIONS = dict(re.findall(r"^## `([\w-]+)`\n(.*?)(?=^## )", LAWS_PAGE, re.MULTILINE | re.DOTALL))
COMPARED = [
    NeoHookean(2.5, 25.0),
    MooneyRivlin(0.7, 70.0, 0.3),
    Yeoh(0.34, 50.0, -0.02, 2e-3),
    Gent(0.4, 40.0, 60.0),
    ArrudaBoyce(0.27, 54.0, 12.0),
]
COMPARED += [Ogden(), Ogden(moduli=(0.5,), exponents=(2.0,), bulk_modulus=20.0), FullNetwork(0.3, 30.0, 25.0)]
COMPARED += [
    Polyconvex(
        moduli=(0.4, -0.1),
        exponents=(1.5, -2.0),
        first=(0.2, 0.02, 1e-3, 1e-4),
        second=(0.04, 1e-3, 1e-4),
        roots=(0.1, 0.3),
        logarithms=(0.2, 0.1),
        limits=(30.0, 60.0),
    )
]
COMPARED += [law() for name, law in reference.LAWS.items() if name not in {compared.name for compared in COMPARED}]


def test_every_law_has_a_section():
    assert list(SECTIONS) == re.findall(r"<!-- parameters ([\w-]+) -->", LAWS_PAGE)
    assert set(SECTIONS) == set(reference.LAWS)


def printed(law, stretches):
    """Return W and U as the page prints them, at principal stretches, each an array."""
    J = np.prod(stretches, axis=0)
    isochoric = stretches / np.cbrt(J)
    (r1, r2, r3), weights = directions_of_chains()
    names = {"J": J, "\\bar I_1": (isochoric**2).sum(axis=0), "\\bar I_2": (isochoric**-2).sum(axis=0)}
    names |= {f"\\bar \\lambda_{a + 1}": isochoric[a] for a in range(3)}
    if "\\left\\langle" in SECTIONS[law.name]:
        names = {name: value[:, None] for name, value in names.items()}
    names |= {"r_1": r1, "r_2": r2, "r_3": r3, "mean": lambda values: (values @ weights)[:, None], "inverse_langevin": inverse_langevin}
    symbols = re.findall(r"\$([^$]+)\$ = `(\w+)`", LAWS_PAGE.split("## `")[0] + SECTIONS[law.name])
    names |= {symbol: getattr(law, field) for symbol, field in symbols}
    for formula in re.findall(r"^\$\$\n(.*?)^\$\$", SECTIONS[law.name], re.MULTILINE | re.DOTALL):
        for name, value in latex.assignments(formula):
            names[name] = value(names)
            if name == "\\beta_0":
                at_rest = law.chain_links**-0.5
                names["\\beta_0'"] = (inverse_langevin(at_rest + 1e-5) - inverse_langevin(at_rest - 1e-5)) / 2e-5
    return np.ravel(names["W"]), np.ravel(names["U"])


def isochoric_energy(law, stretches):
    """Return W of a law, in units of its shear modulus, at isochoric stretches of shape (3, n)."""
    if isinstance(law, InvariantLaw):
        return law.isochoric((stretches**2).sum(axis=0), (stretches**-2).sum(axis=0), law.parameters)[0]
    return law.sums((*np.log(stretches), *stretches**2), law.parameters)[0]


@pytest.mark.parametrize("law", COMPARED, ids=lambda law: law.name)
def test_printed_energies_are_those_of_the_law(law, random):
    stretches = np.exp(random.uniform(-0.5, 0.5, (3, 20)))
    J = np.prod(stretches, axis=0)
    isochoric = stretches / np.cbrt(J)
    W = isochoric_energy(law, isochoric)
    U = law.volumetric(J, law.parameters)[0]
    found = printed(law, stretches)
    assert found[0] == pytest.approx(law.shear_modulus * W, rel=1e-7, abs=1e-9 * law.shear_modulus)
    assert found[1] == pytest.approx(law.shear_modulus * U, rel=1e-12)
    assert W.max() > 0.05


@pytest.mark.parametrize("law", COMPARED, ids=lambda law: law.name)
def test_printed_energies_have_the_moduli_of_the_law(law):
    """Second derivatives at rest: W at constant volume has 4 mu along (1, -1/2, -1/2) times 3/4, U has K."""
    e = 1e-3 if law.name != "full-network" else 1e-2
    pulled = np.array([[math.exp(s), math.exp(-s / 2), math.exp(-s / 2)] for s in (-e, e)]).T
    W, _ = printed(law, pulled)
    assert W.sum() / e**2 == pytest.approx(3 * law.shear_modulus, rel=1e-3)
    grown = np.array([[math.exp(s / 3)] * 3 for s in (-1e-3, 1e-3)]).T
    _, U = printed(law, grown)
    assert U.sum() / 1e-6 == pytest.approx(law.bulk_modulus, rel=1e-5)


@pytest.mark.parametrize("name", ["gent", "arruda-boyce", "full-network"])
def test_stretches_at_which_laws_end_are_those_printed(name):
    """In uniaxial tension at constant volume; the page rounds to a hundredth."""
    law = reference.LAWS[name]()
    (end,) = re.findall(
        r"(?:at a stretch of|greatest isochoric stretch of \$\\sqrt\{N\}\$:) ([\d.]+) with the default", " ".join(SECTIONS[name].split())
    )
    for stretch, finite in ((float(end) - 0.01, True), (float(end) + 0.01, False)):
        s = np.array([[stretch], [stretch**-0.5], [stretch**-0.5]])
        assert np.isfinite(isochoric_energy(law, s)).all() == finite


def test_the_glossary_is_in_alphabetical_order():
    words = re.findall(r"^\| \*\*(.+?)\*\* \|", (REFERENCE / "glossary.md").read_text(), re.MULTILINE)
    assert words == sorted(words, key=lambda word: word.lower().replace("-", " "))
    assert len(words) == len(set(words)) > 50
