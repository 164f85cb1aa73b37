"""Files of testing machines as tables."""

from pathlib import Path

import numpy as np
import pytest

from pdsurrogate.measurements import read_tables

MACHINES = Path(__file__).parents[1] / "data" / "machines"

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
