"""Material cards of other programs: what is written for a law, what is read, and what neither."""

import dataclasses
import json
import re

import numpy as np
import pytest
from commands import commanded, invoke
from refusals import raising, refused

import pdsurrogate as pds
from pdsurrogate.cards.constants import VOLUMES, constants_of, series_modulus
from pdsurrogate.cards.programs import PROGRAMS
from pdsurrogate.cards.reading import built, read_card
from pdsurrogate.cards.writing import card_of
from pdsurrogate.materials import Branch, Memory, Softening

M = pds.materials
EXAMPLES = {
    "neo-hookean": M.NeoHookean(0.4, 40.0),
    "mooney-rivlin": M.MooneyRivlin(0.4, 40.0, second_share=0.3),
    "yeoh": M.Yeoh(0.4, 40.0, second=-0.02, third=3e-4),
    "gent": M.Gent(0.4, 40.0, chain_limit=60.0),
    "arruda-boyce": M.ArrudaBoyce(0.4, 40.0, chain_links=9.0),
    "ogden": M.Ogden(bulk_modulus=40.0, moduli=(0.3,), exponents=(3.0,)),
    "three terms": M.Ogden(moduli=(0.63, 0.0012, -0.01), exponents=(1.3, 5.0, -2.0)),
}
SOFT = Memory(softening=Softening(2.0, 0.1, 0.05))


def written(law, to, folder, name="RUBBER"):
    path = folder / f"card{PROGRAMS[to].suffix}"
    path.write_text(card_of(law, to, name))
    return path


def body(text, to):
    mark = PROGRAMS[to].comment.split("{}")[0].strip()
    return [line for line in text.splitlines() if line and not line.startswith(mark)]


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.parametrize("to", PROGRAMS)
def test_a_law_comes_back_from_its_card_and_a_card_from_its_law(to, name, tmp_path):
    law, form = EXAMPLES[name], PROGRAMS[to].forms.get(EXAMPLES[name].name)
    if form is None or (form.most and name == "three terms" and form.most < 3):
        with raising("--to umat"):
            card_of(law, to, "RUBBER")
        return
    path = written(law, to, tmp_path)
    found, read, remarks = read_card(path)
    assert remarks == ()
    assert read.U == form.U
    again = built(found)
    assert again.name == law.name
    for key, values in constants_of(law).items():
        assert constants_of(again)[key] == pytest.approx(values, rel=1e-6)
    assert body(card_of(again, to, "RUBBER"), to) == body(path.read_text(), to)
    heading = " ".join(re.sub(r"( -->)?\n\W+", " ", path.read_text()).split())
    for words in (law.name, form.modulus, "Nominal stress in tension at a stretch of 2", "run"):
        assert words in heading


@pytest.mark.parametrize(
    ("to", "name", "lines"),
    [
        ("abaqus-card", "three terms", ["0.4095, 1.3, 0.003, 5, 0.01, -2,"]),  # mu alpha/2
        ("ansys", "neo-hookean", ["TB,HYPER,1,1,2,NEO", "TBDATA,1,0.4,0.05"]),
        ("ansys", "three terms", ["TBDATA,1,0.63,1.3,0.0012,5,-0.01,-2", "TBDATA,7,"]),
        ("ansys", "gent", ["TB,HYPER,1,1,3,GENT", "TBDATA,1,0.4,60,0.05"]),
        ("ls-dyna", "yeoh", ["       0.2         0         0    -0.004         0     6e-05"]),
        ("openradioss", "mooney-rivlin", ["                0.28               -0.12"]),
        ("febio", "ogden", ["  <c1>0.9</c1>", "  <m1>3</m1>", "  <k>40</k>"]),
        ("mfront", "mooney-rivlin", ["@Parameter C01 = 0.14;", "@Parameter C10 = 0.06;"]),
    ],
)
def test_constants_are_those_of_the_program(to, name, lines):
    """W = 2 mu/alpha^2, mu/alpha or c/m^2 times sums of powers; C10 = 0.14 and C01 = 0.06 as powers
    2 and -2; Signorini of MFront, where C01 belongs to I1bar.
    """
    text = card_of(EXAMPLES[name], to, "RUBBER")
    assert all(line in text for line in lines)


def test_the_series_of_chains_has_the_published_modulus():
    m = 3.0
    factors = (1, 3 / 5, 99 / 175, 513 / 875, 42039 / 67375)
    published = sum(factor * m ** (-2 * i) for i, factor in enumerate(factors))
    assert series_modulus(m**2) == pytest.approx(published, rel=1e-12)


@pytest.mark.parametrize("formula", VOLUMES)
def test_volumetric_energies_are_their_formulas(formula):
    J = np.array([0.8, 0.9, 1.0, 1.1, 1.3])
    text = formula.replace("^", "**").replace("(ln J)", "np.log(J)").replace("ln J", "np.log(J)")
    energy = eval(text.replace("K/2 ", "K/2 * "), {"np": np, "J": J, "K": 7.0})
    found = VOLUMES[formula](J3=J, parameters=[7.0])
    assert found[0] == pytest.approx(energy, abs=1e-14)
    for order in (0, 1):
        ahead, behind = (VOLUMES[formula](J + h, [7.0])[order] for h in (1e-5, -1e-5))
        assert found[order + 1] == pytest.approx((ahead - behind) / 2e-5, rel=1e-7, abs=1e-8)


def test_softening_is_a_card_of_abaqus(tmp_path):
    law = dataclasses.replace(EXAMPLES["yeoh"], memory=SOFT)
    path = written(law, "abaqus-card", tmp_path)
    assert path.read_text().endswith("*MULLINS EFFECT\n2, 0.1, 0.05\n")
    assert built(read_card(path)[0]).memory == SOFT


def test_the_refusal_of_branches_states_how_they_relax():
    """In a hold, of which a convolution with exp(-t/time) keeps 1/e of the first stress."""
    law = M.NeoHookean(memory=Memory((Branch(1.0, 1.0),)))
    time = np.linspace(0, 1, 201)
    found = M.histories.stress_history(
        law, "uniaxial", time, np.full(201, 2.0), True
    ).nominal_stress
    elastic = 2 - 1 / 4
    left = (found[-1] - elastic) / (found[0] - elastic)
    with raising(f"{left:.2f} of its stress .* {np.exp(-1):.2f};"):
        card_of(law, "abaqus-card", "RUBBER")


@pytest.mark.parametrize(
    "law",
    [
        M.MooneyRivlin(0.4, 40.0, second_share=1.0),
        M.Ogden(moduli=(1.0, -0.2), exponents=(2.0, -2.0)),
        M.Yeoh(second=0.0, third=0.0),
    ],
)
def test_laws_that_are_another_one_are_written(law, tmp_path):
    again = built(read_card(written(law, "ls-dyna", tmp_path))[0])
    for stretch in (0.7, 1.6):
        found, wanted = (M.homogeneous.uniaxial(one, stretch) for one in (again, law))
        assert found.nominal_stress == pytest.approx(wanted.nominal_stress, rel=1e-5)


class Own(M.NeoHookean):
    pass


@pytest.mark.parametrize(
    ("law", "to", "reason"),
    [
        (M.FullNetwork(), "ansys", "Ansys Mechanical APDL has no such law, only neo-hookean"),
        (Own(), "ansys", "has no such law"),
        (
            M.NeoHookean(memory=Memory((Branch(0.4, 2.0),))),
            "abaqus-card",
            r"its branches are not the convolutions of \*VISCOELASTIC",
        ),
        (M.NeoHookean(memory=SOFT), "calculix-card", "its softening is no card of CalculiX"),
        (M.ArrudaBoyce(), "ls-dyna", "a whole number of links, not 26.5"),
        (M.NeoHookean(1.0, 1.234e6), "ls-dyna", "too few characters for K"),
        (EXAMPLES["three terms"], "mfront", "at most 1 terms, and this law 3"),
    ],
)
def test_what_a_program_cannot_say_is_refused(law, to, reason):
    with raising(reason):
        card_of(law, to, "RUBBER")


READ = {
    "*Material, name=A\n*Density\n1e-9\n*Hyperelastic, n=1\n .2, .1, 0.05\n": M.MooneyRivlin(
        0.6, 40.0, second_share=1 / 3
    ),
    "*MATERIAL,\nNAME=A\n*HYPERELASTIC,\n OGDEN,\n N=1\n.45, 3., .05\n*MATERIAL,\nNAME=B\n"
    "*VISCOELASTIC\n": EXAMPLES["ogden"],
    '*material, name="My rubber"\n**\n*HYPERELASTIC, Reduced polynomial, N=2\n.2,2.D-2,.05': M.Yeoh(
        0.4, 40.0, second=0.1, third=0.0
    ),
    "*HYPERELASTIC, MODULI=LONG TERM, OGDEN\n.45, 3., .05": EXAMPLES["ogden"],
    "TB,HYPE,2,,,OGDE\nTBTEMP,22.\nTBDATA,1,0.3 ! mu\nTBDATA,,3,.05,,,\nMP,DENS,1,1.\n": EXAMPLES[
        "ogden"
    ],
    "*MAT_077_O_TITLE\nseal\n$ mid\n1, 1.E-9, 0.495\n0.3\n3.\n": M.Ogden(
        bulk_modulus=0.45 * 2 * 1.495 / 0.03, moduli=(0.3,), exponents=(3.0,)
    ),
    "/MAT/LAW42/7/1\nfilm\n#  rho\n"
    + f"{1e-9:20}\n{0.495:20}{0:20}{0:20}{1:20}{0:10}{1:10}\n{0.4:20}{0:20}\n{0:20}\n{2:20}\n\n": (
        M.NeoHookean(0.4, 0.4 * 2 * 1.495 / 0.03)
    ),
    '<material id="2" type="Gent">\n<G>0.4</G>\n<Jm>60</Jm>\n<k>40</k>\n<density>1</density>': (
        EXAMPLES["gent"]
    ),
    "<Material><material name='a' type='Mooney-Rivlin'><!-- b --> <c1>.1</c1><c2>.1</c2><!--\n"
    "<c1>9</c1> --><k>40</k></material><x/></Material>": M.MooneyRivlin(
        0.4, 40.0, second_share=0.5
    ),
    "@Behaviour Signorini;\n@Parameter C01 = 0.2; // mu/2\n/*\n@Parameter C10 = 0.1;\n*/\n"
    "@Parameter K = 40;\n": EXAMPLES["neo-hookean"],
    "TB,PRONY,2,1,1\nTBDATA,1,.5,1\nTB,HYPER,1,1,2,NEO\nTBDATA,1,.4,.05\n": EXAMPLES["neo-hookean"],
}


@pytest.mark.parametrize("text", READ)
def test_cards_of_others_are_read(text, tmp_path):
    path = tmp_path / "other.inp"
    path.write_text(text)
    found, wanted = built(read_card(path)[0]), READ[text]
    assert found.name == wanted.name
    assert found.parameters == pytest.approx(wanted.parameters)
    assert found.shear_modulus == pytest.approx(wanted.shear_modulus)


HEAD = "*MATERIAL, NAME=A\n*HYPERELASTIC, NEO HOOKE\n"


@refused("cards")
def test_what_no_law_here_says_is_refused_with_its_line(text, message, tmp_path):
    path = tmp_path / "other.inp"
    path.write_text(text)
    with raising(message):
        read_card(path)


def test_what_a_card_states_beside_is_named(tmp_path):
    path = tmp_path / "other.inp"
    path.write_text("*HYPERELASTIC, YEOH\n.2, 0., 0., .05, .05\n20.\n")
    with raising("line 3"):
        read_card(path)
    path.write_text("*HYPERELASTIC, YEOH\n.2, 0., 0., .05, .05, , 20.\n")
    assert read_card(path)[2] == (
        "line 2: 20. is left out",
        "D2 and further are left out, 2.0% of the pressure at J = 0.9",
    )
    long = "0.2000000000000000000D-2"
    path.write_text(HEAD + f"{long}, .05\n*EXPANSION\n1.\n*DAMAGE INITIATION\n*ELEMENT\n")
    assert read_card(path)[2] == (
        "line 4: *EXPANSION is left out",
        "line 6: *DAMAGE INITIATION is left out",
        f"line 3: of {long}, CalculiX would read {long[:20]} alone",
    )


def test_a_scene_takes_a_card(tmp_path):
    (tmp_path / "seal.inp").write_text(HEAD + ".2, .05\n*MULLINS EFFECT\n2., .1\n")
    (tmp_path / "soft.inp").write_text(HEAD + ".1, 0.\n" + HEAD.replace("=A", "=B") + ".3, 0.\n")
    scene = tmp_path / "scene.toml"
    scene.write_text(
        'name = "s"\nspacing = 0.25\nbody = {size = [2.0, 1.0]}\nstretches = [1.5]\n'
        'grips = [{edge = "top"}, {edge = "bottom", travel = 1.0}]\n'
        'material = {card = "seal.inp", bulk_modulus = 80}\n'
        '[[materials]]\nregion = "left"\nmaterial = {card = "soft.inp", name = "b",'
        " bulk_modulus = 30}\n"
    )
    found = pds.load_scene(scene)
    assert found.material.build() == M.NeoHookean(
        0.4, 80.0, memory=Memory(softening=Softening(2.0, 0.1))
    )
    assert found.materials[0].material.build() == M.NeoHookean(0.6, 30.0)
    for change, message in (
        ({"materials.0.material": {"card": "soft.inp", "name": "A"}}, "no bulk modulus"),
        ({"material.law": "gent"}, "card states the law"),
        ({"material.card": "none.inp"}, "none.inp: No such file"),
    ):
        with raising(message, pds.SceneError):
            pds.load_scene(scene, change)


def test_commands_convert_cards(tmp_path):
    card = tmp_path / "seal.inp"
    card.write_text(HEAD + ".2, .05\n")
    done = commanded("convert", card, "--json")
    assert json.loads(done.stdout) == EXAMPLES["neo-hookean"].describe()
    shown = commanded("convert", card)
    assert 'material = { law = "neo-hookean", shear_modulus = 0.4' in shown.stdout
    assert "U(J) = K/2 (J - 1)^2: the mean stress at J = 0.9 and 1.1" in shown.stderr
    commanded("export", card, "--to febio --out", tmp_path)
    assert read_card(tmp_path / "seal.feb.xml")[0] == EXAMPLES["neo-hookean"].describe()
    several = tmp_path / "two.inp"
    several.write_text(HEAD + ".2, 0.\n" + HEAD.replace("=A", "=B") + ".1, 0.\n")
    set_both = "--set name=A --set bulk_modulus=40"
    commanded("export", several, "--to ansys --out", tmp_path, set_both)
    assert read_card(tmp_path / "two_ansys.inp")[0] == EXAMPLES["neo-hookean"].describe()
    refused = invoke("export ogden-isochoric --to febio --out", tmp_path)
    assert "a learned energy has no constants for a card" in " ".join(refused.stderr.split())
