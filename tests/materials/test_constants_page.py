"""The page of constants of other programs: every conversion in the law that it gives, against the
energy beside it.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from refusals import refused, saying

import pdsurrogate as pds
from pdsurrogate.cards.constants import as_read
from pdsurrogate.cards.programs import PROGRAMS as CARDS
from pdsurrogate.materials import LAWS, PLANES
from pdsurrogate.scenes import load_scene

PAGE = Path(__file__).parents[2] / "docs/guide/constants.md"


def tables():
    """Rows of the tables of the page, by the names of their first two columns, as dictionaries."""
    found = {}
    for block in re.findall(r"(?:^\|.*\n)+", PAGE.read_text(), re.MULTILINE):
        rows = [[cell.strip() for cell in line[1:-1].split("|")] for line in block.splitlines()]
        found[" ".join(rows[0][:2])] = [dict(zip(rows[0], row, strict=True)) for row in rows[2:]]
    return found


TABLES = tables()
FORMS = {row["form"]: row for row in TABLES["form energy"]}
PARSED = {"log": np.log, "sum": np.sum, "sqrt": np.sqrt}


def value(text, **names):
    return eval(text.strip("`"), PARSED, names)


def constants_in(text):
    """Constants of a row, as "`mu = 1`, `alpha = [3]`"; those that belong to terms are arrays."""
    found = (code.split("=", 1) for code in re.findall(r"`([^`]*)`", text))
    values = {name.strip(): eval(value) for name, value in found}
    return {
        name: np.array(v, dtype=float) if isinstance(v, list) else v for name, v in values.items()
    }


def law_here(row, constants, bulk=50.0):
    """The law that a row gives for constants."""
    return LAWS[row["`law` here"]](
        **{
            name.strip(): tuple(np.atleast_1d(found))
            if np.ndim(found := value(text, **constants))
            else found
            for name, text in (
                c.split("=", 1) for c in re.findall(r"`([^`]*)`", row["parameters here"])
            )
        },
        bulk_modulus=bulk,
    )


def energy(row, constants, l1, l2, l3):
    """Energy of a row at principal stretches, which are divided by J^(1/3)."""
    stretches = np.array([l1, l2, l3])
    l1, l2, l3 = stretches / np.prod(stretches, axis=0) ** (1 / 3)
    squares = l1**2, l2**2, l3**2
    sums = {"I1": sum(squares), "I2": sum(1 / one for one in squares)}
    return value(row["energy"], **constants, **sums, l1=l1, l2=l2, l3=l3)


def difference(row, constants, *stretches):
    """Difference of the Kirchhoff stresses along the first two axes, by complex steps."""
    step = 1e-30
    slopes = []
    for axis in range(2):
        moved = [one * np.exp(1j * step * (axis == k)) for k, one in enumerate(stretches)]
        slopes.append(np.imag(energy(row, constants, *moved)) / step)
    return slopes[0] - slopes[1]


def difference_here(law, *stretches):
    F = np.diag(stretches)
    P = PLANES["space"].exact(law, F)[1]
    kirchhoff = np.diag(P @ F.T)
    return kirchhoff[0] - kirchhoff[1]


EXAMPLES = {row["form"]: row for row in TABLES["form constants"]}
VOLUMES = {row["U"]: row for row in TABLES["U energy"]}
TENSION = (2.0, 2**-0.5, 2**-0.5)


@pytest.mark.parametrize("form", FORMS)
def test_a_conversion_gives_the_law_of_the_energy(form):
    row = FORMS[form]
    constants = constants_in(EXAMPLES[form]["constants"])
    law = law_here(row, constants)
    modulus = value(row["initial shear modulus"], **constants)
    assert law.shear_modulus == pytest.approx(modulus, rel=1e-12)
    h = 1e-5
    slope = (
        sum(
            difference(row, constants, 1 + sign * h, (1 + sign * h) ** -0.5, (1 + sign * h) ** -0.5)
            / np.log1p(sign * h)
            for sign in (1, -1)
        )
        / 6
    )
    assert slope == pytest.approx(modulus, rel=1e-9)
    found = difference(row, constants, *TENSION), difference_here(law, *TENSION)
    told = float(EXAMPLES[form]["stress difference"]), float(EXAMPLES[form]["of the law here"])
    assert [f"{one:.4f}" for one in found] == [f"{one:.4f}" for one in told]
    assert f"{modulus:.4f}" == EXAMPLES[form]["initial shear modulus"]
    states = np.exp(np.random.default_rng(3).uniform(-0.5, 0.6, (20, 3)))
    if form == "A1":  # a series in the place of the law here: alike at small strains
        states = 1 + 1e-3 * states
    for stretches in states:
        exact = difference(row, constants, *stretches)
        scale = abs(exact) + modulus * (form != "A1")
        assert abs(difference_here(law, *stretches) - exact) <= 1e-9 * scale


@pytest.mark.parametrize("row", VOLUMES.values(), ids=VOLUMES)
def test_volumetric_energies_are_those_of_the_laws(row):
    def mean(J):
        return np.imag(value(row["energy"], K=1.0, J=J + 1e-30j)) / 1e-30

    assert f"{mean(0.9):.4f}" == row["mean stress over K at J = 0.9"]
    assert f"{mean(1.1):.4f}" == row["at J = 1.1"]
    assert (mean(1 + 1e-6) - mean(1 - 1e-6)) / 2e-6 == pytest.approx(1.0, rel=1e-9)
    here = {"no law": [], "all others": [name for name in LAWS if name != "gent"]}
    for name in here.get(row["here"], [row["here"].strip("`")]):
        law = LAWS[name]()
        for J in (0.7, 0.9, 1.1, 1.5):
            U, slope, _ = law.volumetric(J, law.parameters)
            K = law.bulk_modulus / law.shear_modulus
            assert pytest.approx(value(row["energy"], K=1.0, J=J), rel=1e-9) == U / K
            assert slope / K == pytest.approx(mean(J), rel=1e-9)


@pytest.mark.parametrize("row", TABLES["constant as in"], ids=lambda row: row["constant"])
def test_bulk_moduli_are_the_curvatures_of_the_energies(row):
    constants = {row["constant"]: 0.3, "mu": 1.3}

    def slope(J):
        return np.imag(value(row["as in"], **constants, J=J + 1e-30j)) / 1e-30

    found = (slope(1 + 1e-6) - slope(1 - 1e-6)) / 2e-6
    assert found == pytest.approx(value(row["`bulk_modulus` here"], **constants), rel=1e-9)


PROGRAMS = TABLES["program law there"]


def row_of(row):
    return f"{row['program']} {row['law there']}"


@pytest.mark.parametrize(
    "row",
    [row for row in PROGRAMS if row["program"][:6] == "FElupe" and row["known by"] == "tested"],
    ids=row_of,
)
def test_felupe_means_what_the_page_says(row):
    """As tested: the difference of stresses at a stretch of 2, and the mean stress where the volume
    changes.
    """
    constants = constants_in(EXAMPLES[row["form"]]["constants"])
    K = 50.0
    felupe = pytest.importorskip("felupe", reason="needs felupe")
    volume = {"bulk": K} if row["U"] == "V1" else {"lmbda": K - 2 / 3 * constants["mu"]}
    material = getattr(felupe, row["law there"].strip("`"))(**constants, **volume)

    def cauchy(F):
        P = material.gradient([F[:, :, None, None], None])[0][..., 0, 0]
        return P @ F.T / np.linalg.det(F)

    stress = cauchy(np.diag(TENSION))
    told = float(EXAMPLES[row["form"]]["stress difference"])
    assert stress[0, 0] - stress[1, 1] == pytest.approx(told, abs=6e-5)
    for J, column in ((0.9, "mean stress over K at J = 0.9"), (1.1, "at J = 1.1")):
        mean = np.trace(cauchy(J ** (1 / 3) * np.eye(3))) / 3
        if row["U"] != "coupled":
            told = float(VOLUMES[row["U"]][column]) if row["U"] else 0.0
            assert mean / K == pytest.approx(told, abs=6e-5)
    if row["U"] == "coupled":
        assert np.trace(stress) / 3 == pytest.approx(0.6667, abs=1e-4)
        h = 1e-5
        ahead, behind = (np.trace(cauchy((1 + s) ** (1 / 3) * np.eye(3))) / 3 for s in (h, -h))
        assert (ahead - behind) / (2 * h) == pytest.approx(K, rel=1e-8)


CONVENTIONS = {name.removesuffix("-card"): program for name, program in CARDS.items()}


def convention_of(row):
    return row["program"].split()[0].strip(",").lower()


@pytest.mark.parametrize(
    "row",
    [
        row
        for row in PROGRAMS
        if convention_of(row) in CONVENTIONS and row["law there"] != "`LAW82`"
    ],
    ids=row_of,
)
def test_scenes_take_the_constants_by_their_names(row):
    form = FORMS[row["form"]]
    constants = constants_in(EXAMPLES[row["form"]]["constants"])
    K, mu = 50.0, value(form["initial shear modulus"], **constants)
    bulk = {"K": K, "D": 2 / K, "D1": 2 / K, "nu": (3 * K - 2 * mu) / (6 * K + 2 * mu)}
    letters = {key + "1" * (np.ndim(found) > 0): np.sum(found) for key, found in constants.items()}
    given = {
        name: float(value(meaning or name, **letters, **bulk))
        for name, meaning in re.findall(r"`(\w+)`(?: \(([^)]*)\))?", row["its constants"])
    }
    given |= {"law": form["`law` here"], "convention": convention_of(row)}
    if row["program"].startswith("OpenRadioss") and given["law"] == "ogden":
        given["law"] = "LAW42"
    scene = load_scene("uniaxial", {"material": given})
    found, wanted = scene.material.build(), law_here(form, constants, K)
    assert type(found) is type(wanted)
    assert found.shear_modulus == pytest.approx(mu, rel=1e-9)
    assert found.bulk_modulus == pytest.approx(K, rel=1e-9)
    assert found.shape == pytest.approx(wanted.shape, rel=1e-9)


@refused("constants")
def test_what_is_no_constant_of_the_program_is_refused(given, message):
    material = {"law": "neo-hookean", "convention": "calculix", "C10": 0.5, "D1": 0.02}
    with saying(message, pds.SceneError):
        load_scene("uniaxial", {"material": material | given})


@refused("constants that are missing")
def test_constants_that_are_missing_or_of_another_law_are_refused(given, message):
    with saying(message, pds.SceneError):
        load_scene("uniaxial", {"material": {"convention": "abaqus"} | given})


@pytest.mark.parametrize(
    "row", [row for row in PROGRAMS if convention_of(row) == "calculix"], ids=row_of
)
def test_cards_that_calculix_runs_have_the_energies_of_the_page(row):
    """tests/cards and tests/export compare CalculiX with these laws."""
    form = FORMS[row["form"]]
    constants = constants_in(EXAMPLES[row["form"]]["constants"])
    law = law_here(form, constants)
    read = as_read(law, CARDS["calculix-card"].forms[law.name].U)
    exact = difference(form, constants, *TENSION)
    assert difference_here(read, *TENSION) == pytest.approx(exact, rel=1e-9)
    scale = law.bulk_modulus / law.shear_modulus
    U = [read.volumetric(J, read.parameters)[0] / scale for J in (0.9, 1.1)]
    told = [value(VOLUMES[row["U"]]["energy"], K=1.0, J=J) for J in (0.9, 1.1)]
    assert pytest.approx(told, rel=1e-9) == U


def test_the_table_of_programs_refers_to_the_others():
    laws = {
        (convention_of(row), FORMS[row["form"]]["`law` here"]) for row in PROGRAMS if row["form"]
    }
    assert laws >= {(name, law) for name, each in CONVENTIONS.items() for law in each.forms}
    bulk = {row["constant"] for row in TABLES["constant as in"]}
    for row in PROGRAMS:
        assert set(filter(None, row["form"].split(", "))) <= set(FORMS), row
        assert set(re.findall(r"\w+", row["bulk modulus"])) <= bulk, row
        assert row["U"] in ("", "coupled", *VOLUMES), row
        assert row["known by"] in ("tested", "run", "read", "names read"), row
        if row["known by"] == "tested":
            assert row["program"].split()[0] in ("CalculiX", "FElupe")
