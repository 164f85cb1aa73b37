"""Files of testing machines as tables."""

import itertools
import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from refusals import raising

from pdsurrogate.measurements import read_tables
from pdsurrogate.measurements.quantities import factor, heading_and_unit, quantities_of

DATA = Path(__file__).parents[1] / "data"
MACHINES = DATA / "machines"
INVENTED = tomllib.loads((DATA / "machine_forms.toml").read_text("utf-8"))
RAW, THREE = INVENTED["testXpert"]["blocks"][0].values()

FORMS = {
    "bluehill-raw.csv": ("utf-8", 3, ",", "time/s extension/mm force/N"),
    "bluehill-geometry.csv": (
        "utf-8", 9, ",", "time/s extension/mm force/N engineering-strain/mm/mm nominal-stress/MPa",
    ),
    "bluehill-inch-pound.csv": ("utf-8", 5, ",", "time/s extension/in force/lbf"),
    "bluehill-chinese.csv": ("gbk", 3, ",", "time/s extension/mm force/N"),
    "cycle-in-kN.csv": ("utf-8", 2, ",", "time/s extension/mm force/kN"),
    "decimal-comma.txt": (
        "latin-1", 8, "\t", "time/s extension/mm force/N engineering-strain/%",
    ),
    "lambda-P.csv": ("utf-8", 1, ",", "stretch/ nominal-stress/kPa"),
    "semicolons-and-notes.csv": (
        "utf-8", 6, ";",
        "time/s true-strain/ true-stress/MPa engineering-strain/ nominal-stress/MPa",
    ),
    "strain-percent.csv": ("utf-8", 1, ",", "engineering-strain/% nominal-stress/MPa"),
    "stretch-stress.csv": ("utf-8", 1, ",", "stretch/ nominal-stress/"),
    "stress-first.txt": ("utf-8", 0, " ", "/ /"),
}  # fmt: skip
"""Encoding, lines above the numbers, separator, and quantities with units of files with one table,
by eye.
"""


def meaning(block):
    return " ".join(f"{'|'.join(one.quantities)}/{one.unit or ''}" for one in block.columns)


def numbers(block):
    return np.array([column.values for column in block.columns]).T


def cells(path, encoding, skipped, separator):
    """Numbers of a file by the simplest means."""
    lines = path.read_text(encoding).splitlines()[skipped:]
    return np.array(
        [
            [float(cell.strip('"').replace(",", ".")) for cell in line.split(separator)]
            for line in lines
        ]
    )


@pytest.mark.parametrize("name", FORMS)
def test_files_of_machines_have_the_right_numbers_and_quantities(name):
    *form, expected = FORMS[name]
    (block,) = read_tables(MACHINES / name).blocks
    assert meaning(block) == expected
    there = cells(MACHINES / name, *form)
    np.testing.assert_array_equal(numbers(block), there)
    np.testing.assert_array_equal(block.lines, form[1] + 1 + np.arange(len(there)))


def test_entries_above_a_table_are_its_facts():
    english, german, notes = (
        read_tables(MACHINES / name).blocks[0]
        for name in ("bluehill-geometry.csv", "decimal-comma.txt", "semicolons-and-notes.csv")
    )
    assert english.title == english.facts["specimen"] == "A-7"
    assert german.title == german.facts["specimen"] == "C 3"
    assert english.facts["width"] == "6 mm"
    assert english.facts["thickness"] == "2 mm"
    assert german.facts["gauge length"] == "25 mm"
    assert german.facts["thickness"] == "2 mm"
    assert german.mode == "uniaxial"
    assert notes.facts["width"] == "6 mm"
    assert notes.facts["Standard"] == "ISO 37"


def test_specimens_side_by_side_are_blocks():
    path = MACHINES / "specimens-side-by-side.csv"
    first, second = read_tables(path).blocks
    assert (first.title, second.title) == ("Specimen 1", "Specimen 2")
    assert meaning(first) == meaning(second) == "engineering-strain/- nominal-stress/MPa"
    np.testing.assert_array_equal(
        np.hstack([numbers(first), numbers(second)]), cells(path, "utf-8", 3, ",")
    )


def test_keywords_of_abaqus_are_blocks_with_the_stress_first():
    path = MACHINES / "abaqus-test-data.inp"
    found = read_tables(path)
    assert [block.mode for block in found.blocks] == ["uniaxial", "equibiaxial", "pure-shear"]
    lines = path.read_text().splitlines()
    for block in found.blocks:
        assert meaning(block) == "nominal-stress/ engineering-strain/"
        there = [[float(cell) for cell in lines[line - 1].split(",")] for line in block.lines]
        np.testing.assert_array_equal(numbers(block), there)
    assert sum(len(block.lines) for block in found.blocks) == len(lines) - 5
    assert found.notes == ("keywords that are not read: 1 *MATERIAL, 1 *HYPERELASTIC",)


def test_sheets_of_a_workbook_are_blocks_and_state_the_mode():
    pytest.importorskip("python_calamine")
    openpyxl = pytest.importorskip("openpyxl")
    found = read_tables(MACHINES / "workbook.xlsx")
    assert [(block.title, block.mode) for block in found.blocks] == [
        ("Uniaxial", "uniaxial"),
        ("Planar", "pure-shear"),
        ("Biaxial", "equibiaxial"),
    ]
    book = openpyxl.load_workbook(MACHINES / "workbook.xlsx")
    for block in found.blocks:
        assert meaning(block) == "engineering-strain/mm/mm nominal-stress/MPa"
        there = np.array(list(book[block.title].values)[2:], dtype=float)
        np.testing.assert_array_equal(numbers(block), there)


@pytest.mark.parametrize("name", INVENTED)
def test_forms_of_machines_have_the_right_numbers_and_quantities(name, tmp_path):
    invented, path = INVENTED[name], tmp_path / "file.dat"
    path.write_bytes(invented["text"].encode(invented["encoding"]))
    found = read_tables(path)
    assert [meaning(block) for block in found.blocks] == [
        block["quantities"] for block in invented["blocks"]
    ]
    for block, expected in zip(found.blocks, invented["blocks"], strict=True):
        if "numbers" in expected:
            np.testing.assert_array_equal(numbers(block), expected["numbers"])
        facts = expected.get("facts", {})
        assert {name: block.facts.get(name, "") for name in facts} == facts
        assert block.title == facts.get("specimen", block.title)


def lines(*columns, separator, decimal, quoted, form):
    """Rows of numbers as text."""
    mark = '"' if quoted else ""
    return "".join(
        separator.join(mark + (form % cell).replace(".", decimal) + mark for cell in row) + "\n"
        for row in zip(*columns, strict=True)
    )


@pytest.mark.parametrize("quoted", [False, True])
@pytest.mark.parametrize(
    ("separator", "decimal"),
    [*itertools.product("\t;| ", ".,"), (",", "."), (",", ",")],
)
def test_numbers_are_those_of_the_text_whatever_the_signs(separator, decimal, quoted, tmp_path):
    if separator == decimal and not quoted:
        return  # refused, see below
    values = np.random.default_rng(7).normal(size=(40, 3)) * 10.0 ** np.arange(-3, 4, 3)
    for form in ("%.3f", "%.6e", "%+.1f"):
        path = tmp_path / "table.txt"
        rows = lines(*values.T, separator=separator, decimal=decimal, quoted=quoted, form=form)
        path.write_text("Strain;Stress;Time\n".replace(";", separator) + rows)
        found = read_tables(path)
        assert meaning(found.blocks[0]) == "engineering-strain/ nominal-stress/ time/"
        rounded = [[float(form % cell) for cell in row] for row in values]
        np.testing.assert_array_equal(numbers(found.blocks[0]), rounded)
        assert found.separator == separator


HEADINGS = {
    "engineering-strain": "Strain|Tensile strain (Extension)|Dehnung|Déformation"
    "|Deformación unitaria|应变|工程应变|ひずみ|伸び率 (%)|Elongation (%)|eng_strain|ε"
    "|Nominal strain|Technische Dehnung",
    "true-strain": "True strain|Wahre Dehnung|Hencky strain|log strain|Déformation vraie"
    "|Deformación verdadera|真应变|真ひずみ",
    "stretch": "Stretch|lambda|λ|λ1|Stretch ratio|Extension ratio|Streckung|Taux d'étirement"
    "|Relación de estiramiento|伸长比|伸長比",
    "nominal-stress": "Stress|Engineering stress|Zugspannung|Nennspannung|Contrainte nominale"
    "|Esfuerzo|Tensión (MPa)|应力|工程应力|公称応力|P (kPa)",
    "true-stress": "True stress|Cauchy stress|Wahre Spannung|Contrainte vraie|Tensión verdadera"
    "|真应力|真応力",
    "force": "Load|Force|Kraft|Standardkraft|Prüfkraft|Charge|Effort|Fuerza|Carga|力|载荷"
    "|试验力|荷重|試験力|F (N)|P (N)|Axial Force",
    "extension": "Extension|Displacement|Crosshead|Stroke|Position|Weg|Traversenweg|Verfahrweg"
    "|Längenänderung|Déplacement|Allongement (mm)|Desplazamiento|Alargamiento (mm)|位移|变形(mm)"
    "|変位|伸び (mm)|Strain (mm)|Standardweg",
    "time": "Time|Zeit|Prüfzeit|Temps|Tiempo|时间|時間|t|Elapsed time",
    "lateral-strain": "Transverse strain|Lateral strain|Querdehnung|横向应变",
    "lateral-stretch": "lateral_stretch|lambda2|λ_2",
    "cycle": "Cycle|Total cycle count|Zyklus|Ciclo|循环|サイクル回数",
    "temperature": "Temperature (°C)|Temperatur|Température|温度",
    "extension|engineering-strain": "Elongation|Allongement|Alargamiento|Verformung|伸び",
    "force|nominal-stress": "P",
    "nominal-stress|true-stress": "σ|sigma",
    "stretch|engineering-strain": "Stretch (%)",
    "": "Maximum Load|Strain rate|Green strain|E-Modul|Bruchdehnung|Contrainte à la rupture"
    "|最大力|断裂伸长率|Comment|Strain energy",
}  # fmt: skip


@pytest.mark.parametrize("quantities", HEADINGS)
def test_headings_in_six_languages(quantities):
    for text in HEADINGS[quantities].split("|"):
        heading, unit = heading_and_unit(text)
        assert "|".join(quantities_of(heading, unit)) == quantities, text


@pytest.mark.parametrize(
    ("unit", "to", "expected"),
    [
        ("kN", "N", 1000.0),
        ("lbf", "N", 4.4482216152605),
        ("(kgf)", "N", 9.80665),
        ("in", "m", 0.0254),
        ("[mm]", "m", 1e-3),
        ("psi", "Pa", 6894.757293168),
        ("ksi", "Pa", 6894757.293168),
        ("kgf/cm2", "Pa", 98066.5),
        ("kgf/cm²", "Pa", 98066.5),
        ("N/mm^2", "Pa", 1e6),
        ("Mpa", "Pa", 1e6),
        ("bar", "Pa", 1e5),
        ("%", "1", 0.01),
        ("mm/mm", "1", 1.0),
        ("min", "s", 60.0),
        ("兆帕", "MPa", 1.0),
    ],
)
def test_units_are_converted(unit, to, expected):
    assert factor(unit, to) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("unit", "to"), [("N", "Pa"), ("furlong per", "m"), ("P/MPa", "s")])
def test_units_of_another_kind_are_refused(unit, to):
    with raising(f"{unit} is no unit like {to}; known are N, kN"):
        factor(unit, to)


REFUSED = {
    "empty": (b" \n", "the file is empty"),
    "picture": (b"\x89PNG\r\n\x1a\n" + bytes(40), r"a picture \(PNG\); a table of text"),
    "document": (b"%PDF-1.7\n", "a PDF document"),
    "binary": (bytes(range(256)) * 20, "a binary file"),
    "archive": (b"PK\x03\x04" + bytes(60), "no workbook that can be read"),
    "page": (b"<html><table></table></html>", "an HTML or XML document"),
    "one column": (b"1.0\n2.0\n3.0\n", "no line has two numbers"),
    "prose": (b"This is no table.\nNot at all.\n", "no line has two numbers"),
    "two signs": (b"Strain;Stress\n0.5;1,5\n0.6;1,6\n", "comma in 1,5 and a point in 0.5"),
    "unclear sign": (
        b"Strain;Stress\n1,125;2,250\n2,125;3,250\n",
        r"3,250 can be 3.250 or 3250.*settles it",
    ),
    "commas for everything": (b"Strain,Stress\n0,5,1,5\n0,6,1,6\n", "4 values for 2 columns"),
    "a cell": (b"Strain,Stress\n0.5,1.5\n0.6,1.6x\n0.7,1.7\n", "line 3: '1.6x' is no number"),
    "a first cell": (b"Strain,Stress\n0.5,1.5\n0.6x,1.6\n0.7,1.7\n", "line 3: '0.6x' is no"),
    "a first word": (b"Strain,Stress\n0.5,1.5\nx0.6,1.6\n0.7,1.7\n", "line 3: 'x0.6' is no number"),
    "stress in newtons": (b"Strain,Stress (N)\n0.5,1.5\n0.6,1.6\n", "'Stress' is in N, which"),
    "time in millimetres": (b"Time (mm),Load\n0.5,1.5\n0.6,1.6\n", "'Time' is in mm"),
    "deck with text": (b"*Uniaxial test data\n0.1, 0.1\n0.2, x\n", "line 3: '0.2, x' is no row"),
    "deck with more": (b"*Uniaxial test data\n0.1, 0.1\n0.2\n", "line 3: '0.2' is no row of"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_table_is_refused_in_one_line_that_says_what_it_is(name, tmp_path):
    data, message = REFUSED[name]
    path = tmp_path / "file.csv"
    path.write_bytes(data)
    with raising(f"^{re.escape(str(path))}.*{message}"):
        read_tables(path)


def test_files_that_are_not_there_or_too_large_are_refused(tmp_path):
    with raising(r"cannot read .*: No such file"):
        read_tables(tmp_path / "none.csv")
    with raising(r"cannot read .*: Is a directory"):
        read_tables(tmp_path)
    path = tmp_path / "large.csv"
    with path.open("wb") as file:
        file.truncate(2_000_000_000)  # sparse
    with raising(r"a file of 2.0 GB is no table"):
        read_tables(path)


def test_columns_and_units_of_the_user_are_honored():
    (block,) = read_tables(
        MACHINES / "stress-first.txt",
        columns={"stress": 1, "stretch": "2"},
        units={"stress": "kPa"},
    ).blocks
    assert meaning(block) == "nominal-stress/kPa stretch/"
    (block,) = read_tables(
        MACHINES / "decimal-comma.txt", columns={"true-strain": "dehnung"}
    ).blocks
    assert meaning(block) == "time/s extension/mm force/N true-strain/%"
    (block,) = read_tables(
        MACHINES / "semicolons-and-notes.csv", columns={"nominal-stress": "True Stress (MPa)"}
    ).blocks
    assert meaning(block).split()[2] == "nominal-stress/MPa"
    assert meaning(block).split()[-1] == "/MPa"  # of two, the one that is named


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"columns": {"force": "Last"}}, "no column Last; there are Zeit, Standardweg, Standard"),
        ({"columns": {"force": "9"}}, "there is no column 9"),
        ({"columns": {"forces": "Zeit"}}, "no quantity forces; did you mean"),
        ({"columns": {"force": "Dehnung"}}, "Dehnung is in %, which is no unit of force"),
        ({"units": {"stress": "MPa"}}, "no column of stress; there are Zeit"),
        ({"units": {"force": "mm"}}, "mm is no unit like N"),
        ({"units": {"force": "stones"}}, "stones is no unit like N; known are N, kN"),
    ],
)
def test_columns_and_units_that_the_file_does_not_have_are_refused(options, message):
    with raising(message):
        read_tables(MACHINES / "decimal-comma.txt", **options)


def test_a_column_whose_unit_contradicts_its_heading_is_what_the_user_says(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("sep=,\nStrain,Stress (N)\n0,0\n0.1,0.2\n")
    (block,) = read_tables(path, columns={"force": "Stress"}).blocks
    assert meaning(block) == "engineering-strain/ force/N"


def test_decks_have_lateral_strains_and_keywords_of_any_case(tmp_path):
    path = tmp_path / "rubber.txt"
    path.write_text(
        "** a deck\n*heading\n 1, 2, 3\n*HYPERFOAM, TEST DATA INPUT\n"
        "*uniaxial test data, smooth=3\n 0.1, 0.11, -0.05\n** between\n 0.2, 0.22, -0.09,\n"
        "*VOLUMETRIC TEST DATA\n1e2, 0.99\n*Simple Shear Test Data\n0.1, 0.1\n*elset, elset=a\n"
        "1, 2\n"
    )
    found = read_tables(path)
    uniaxial, volumetric = found.blocks
    assert meaning(uniaxial) == "nominal-stress/ engineering-strain/ lateral-strain/"
    np.testing.assert_array_equal(numbers(uniaxial), [[0.1, 0.11, -0.05], [0.2, 0.22, -0.09]])
    np.testing.assert_array_equal(uniaxial.lines, [6, 8])
    assert meaning(volumetric) == "/ volume-ratio/"
    assert volumetric.mode == "volumetric"
    assert "1 *HEADING, 1 *HYPERFOAM, 1 *SIMPLE SHEAR TEST DATA, 1 *ELSET" in found.notes[0]


def test_a_workbook_of_specimens_with_results_and_sheets_of_other_content(tmp_path):
    pytest.importorskip("python_calamine")
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheets = {
        "Parameter": [["Prüfnorm", "ISO 37"], ["Messlänge", 25, "mm"], ["Datum", "30.11.2026"]],
        "Ergebnisse": [
            ["", "Dicke", "Breite", "Fmax"],
            ["", "mm", "mm", "N"],
            ["Probe 1", 2, 6, 12.5],
            ["Probe 2", 2.1, 6, 13.5],
        ],
        "Statistik": [["Serie", "Fmax"], ["n = 2", "N"], ["x", 13], ["s", 0.5]],
        "Probe 1": [
            ["Probe 1", None, None],
            ["Prüfzeit", "Standardweg", "Standardkraft"],
            ["s", "mm", "N"],
            *THREE,
        ],
        "Probe 2": [
            [],
            [None, "Zeit", "Weg", "Kraft"],
            [None, "s", "mm", "N"],
            *([None, *row] for row in THREE),
        ],
    }
    for title, rows in sheets.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    book.save(tmp_path / "book.dat")
    found = read_tables(tmp_path / "book.dat")
    assert [(block.title, meaning(block)) for block in found.blocks] == [
        ("Probe 1", RAW),
        ("Probe 2", RAW),
    ]
    for block, thickness in zip(found.blocks, ("2 mm", "2.1 mm"), strict=True):
        np.testing.assert_array_equal(numbers(block), THREE)
        assert block.facts["thickness"] == thickness
        assert block.facts["gauge length"] == "25 mm"
        assert block.facts["sheet"] == block.title
        np.testing.assert_array_equal(block.lines, 4 + np.arange(6))


def test_letters_are_headings_rather_than_units(tmp_path):
    path = tmp_path / "table.csv"
    for heading in ("a,b", "s,e", "d,F"):
        path.write_text(f"{heading}\n0,0\n0.1,0.2\n")
        (block,) = read_tables(path).blocks
        assert [column.heading for column in block.columns] == heading.split(",")
        assert [column.unit for column in block.columns] == [None, None]


def test_a_workbook_without_calamine_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "python_calamine", None)
    with raising(r"pip install pdsurrogate\[xlsx\]"):
        read_tables(MACHINES / "workbook.xlsx")


def test_points_between_thousands_beside_numbers_without_decimals_are_refused(tmp_path):
    path = tmp_path / "test.csv"
    path.write_text("Extension (mm);Load (mN)\n0;0\n1;542\n2;946\n3;1.310\n4;1.720\n")
    with raising(r"1\.310 can be 1\.310 or 1310"):
        read_tables(path)


def test_specimens_that_share_a_column_are_said(tmp_path):
    path = tmp_path / "test.csv"
    path.write_text("Extension (mm);Load (N);Load (N)\n0;0;0\n1;5;6\n2;9;10\n")
    assert read_tables(path).notes == ("2 specimens side by side share 'Extension'",)


def test_text_in_no_known_encoding_keeps_its_numbers(tmp_path):
    path = tmp_path / "test.csv"
    path.write_bytes("Путь;Усилие\n0;0\n1,5;2,5\n3,0;4,5\n".encode("cp1251"))
    assert read_tables(path).blocks[0].columns[1].values.tolist() == [0, 2.5, 4.5]


@pytest.mark.parametrize(
    ("heading", "unit"), [("Strain percent", "%"), ("Strain (µε)", "um/m"), ("载荷(牛顿)", "N")]
)
def test_units_in_words(tmp_path, heading, unit):
    path = tmp_path / "test.csv"
    path.write_text(f"{heading};Stress (MPa);Tempo (s)\n0;0;0\n1;5;6\n2;9;10\n", "utf-8")
    column, _, time = read_tables(path).blocks[0].columns
    assert factor(column.unit, unit) == 1
    assert time.quantities == ("time",)


SIZES = (
    "Dicke;{};mm", "Dicke;{} mm", "Dicke: {} mm", "Dicke = {}mm", "Dicke {} mm", "Dicke (mm);{}",
    "Dicke in mm;{}", "Dicke/mm: {}", '"Dicke";"{}";"[mm]"', "# Dicke: {} mm",
    "Datum;01.02.2024\nBreite;4,0;mm;Dicke;{};mm",
)  # fmt: skip


@pytest.mark.parametrize("size", ["2,068", "2,07", "2,7", "12,07", "0,5", "2,0700", "2"])
@pytest.mark.parametrize("form", SIZES)
def test_sizes_have_the_decimal_sign_of_their_file(form, size, tmp_path):
    path = tmp_path / "test.csv"
    path.write_text(f"{form.format(size)}\n\nWeg (mm);Kraft (N)\n0,0;0\n0,380;1\n0,759;2\n")
    found = read_tables(path).blocks[0].facts["thickness"]
    assert found == f"{float(size.replace(',', '.')):.12g} mm"


@pytest.mark.parametrize("form", SIZES)
def test_sizes_settle_the_decimal_sign_where_no_column_does(form, tmp_path):
    path = tmp_path / "test.csv"
    table = "\n\nWeg (mm);Kraft (N)\n0;0\n1;1\n2;2\n"
    path.write_text(form.format("2,07") + table)
    assert read_tables(path).blocks[0].facts["thickness"] == "2.07 mm"
    path.write_text(form.format("2,068") + table)
    if "4,0" in form:
        assert read_tables(path).blocks[0].facts["thickness"] == "2.068 mm"
        return
    with raising(r"2,068 can be 2\.068 or 2068"):
        read_tables(path)


def test_sizes_with_another_decimal_sign_than_their_table_are_not_taken_for_thousands(tmp_path):
    path = tmp_path / "test.csv"
    table = "\n\nWeg (mm);Kraft (N)\n0.0;0\n0.38;1\n0.75;2\n"
    path.write_text(f"Breite;4,05;mm\nDicke;2,068;mm{table}")
    with raising("2,068 can be two numbers: use one decimal sign"):
        read_tables(path)


def test_entries_keep_units_of_rates(tmp_path):
    path = tmp_path / "test.csv"
    path.write_text("Rate;200;mm/min\n\nWeg (mm);Kraft (N)\n0,0;0\n0,5;1\n1,0;2\n")
    assert read_tables(path).blocks[0].facts == {"Rate": "200 mm/min"}
