"""Pages run as they are printed: a reader types every block into an empty folder, and the README a second time into the same one.

`pipelines/tutorials.py` types a page and says what a block is.  A ``text`` block shows the output of the block before it, and is compared with
it; so are the names of pictures with those of the files that a page draws.  What sets up an environment is not run here: with the README's two
commands continuous integration itself begins.  Pages of Python alone are run by `tests/test_docs.py`.
"""

import importlib.util
import json
import os
import sys
from pathlib import Path

import pytest
from several_ranks import SLEEPING
from tutorials import AFTER_SETUP, NOTEBOOKS, SETS_UP, blocks_of, command_of, notebook_of, outputs_of, pictures_of, same_output, type_in

import pdsurrogate as pds

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
TUTORIALS = sorted((DOCS / "tutorial").glob("*.md"))

TOO_LONG = {
    "guide/cracks.md": "cracks of tens of thousands of points",
    "guide/energies.md": "bodies as fine as they are meant",
    "guide/laws.md": "bodies as fine as they are meant",
    "guide/study.md": "24 runs",
    "guide/test-data.md": "a crack of tens of thousands of points",
}
"""Pages whose commands take minutes: `tests/test_docs.py` runs their Python, and sees that their commands are understood."""


def typed(page: Path, folder: Path) -> str:
    """Do what a page says, compare its output and its pictures with those of the page, and return all that it printed."""
    printed = type_in(page, folder, **SLEEPING)
    for before, block in outputs_of(page).items():
        assert same_output(block.text, printed[before]), f"{page.name} shows\n{block.text}\nbut this is printed:\n{printed[before]}"
    return "".join(printed.values())


@pytest.mark.slow  # fits, and a sheet that tears
def test_the_readme_twice_in_one_folder(tmp_path):
    """One who knows scikit-learn, and one who has a table of tests and wants a torn sheet; a second time new versions are stored."""
    page = ROOT / "README.md"
    assert len(next(text for _, kind, text in blocks_of(page) if kind == "python").strip().splitlines()) <= 15
    for version in (1, 3):
        printed = type_in(page, tmp_path)
        path, error = printed[0].splitlines()
        assert path == f"artifacts/my-rubber/{version}"
        assert abs(float(error)) < 1e-3
        assert (tmp_path / "stress.png").stat().st_size > 5000
        learned, fitted = (pds.load_card(tmp_path / "artifacts" / "my-rubber" / str(number)) for number in (version, version + 1))
        assert learned.training["cross_validation"][0]["rms"] < 1e-2
        # The table is of this rubber, with a bulk modulus of 1000 shear moduli.
        assert fitted.material.trained_with["shear_modulus"] == pytest.approx(400.0, rel=0.01)
        assert fitted.material.trained_with["chain_limit"] == pytest.approx(60.0, rel=0.02)
        summary = json.loads((tmp_path / "out" / "tear" / "summary.json").read_text())
        assert summary["force"] == f"my-rubber@{version + 1}"
        assert summary["crack"]["broken_bonds"] > 50
        assert (tmp_path / "tear.html").stat().st_size > 50_000
        assert (tmp_path / "cantilever-scene.png").stat().st_size > 5000
        assert json.loads((tmp_path / "out" / "cantilever" / "summary.json").read_text())["converged"]


def two_ranks(folder: Path, printed: list[str]) -> None:
    _, table, told = printed
    assert "stress (kPa)" in table
    assert "points on 2 ranks" in told
    assert told.count("ranks") == 1
    assert (folder / "sheet.png").stat().st_size > 5000
    assert json.loads((folder / "out" / "hole" / "summary.json").read_text())["ranks"] == 2


def six_runs(folder: Path, printed: list[str]) -> None:
    """The study of the file is that of Python: it finds all runs done."""
    assert (folder / "out" / "radius" / "study.png").stat().st_size > 5000
    outcomes = list(folder.glob("out/radius/runs/*/outcome.json"))
    assert len(outcomes) == 6
    assert all(path.stat().st_mtime_ns < (folder / "out" / "radius" / "study.csv").stat().st_mtime_ns for path in outcomes)


def drawn(*names: str):
    def check(folder: Path, printed: list[str]) -> None:
        assert all((folder / name).stat().st_size > 2000 for name in names)

    return check


PAGES = {
    "tutorial/first-sheet.md": drawn("sheet.png", "sheet.html"),
    "tutorial/own-scene.md": drawn("hanger-scene.png"),
    "tutorial/own-law.md": drawn("artifacts/biderman/1/card.json"),
    "tutorial/crack.md": drawn("crack.png", "crack.html"),
    "tutorial/ranks.md": two_ranks,
    "tutorial/study.md": six_runs,
    "guide/results.md": drawn("uniaxial-stress_22.png", "sheet.html", "hole-scene.png"),
}
"""Pages that are typed, and what must be there then."""

QUICK = ("tutorial/own-scene.md",)

NEEDS_MPI = pytest.mark.skipif(importlib.util.find_spec("mpi4py") is None, reason='no MPI is installed: pip install "pdsurrogate[mpi]"')


def _marked(name: str):
    marks = [] if name in QUICK else [pytest.mark.slow]  # pictures and pages, fits, processes, cracks
    return pytest.param(name, marks=[*marks, NEEDS_MPI] if name == "tutorial/ranks.md" else marks, id=Path(name).stem)


@pytest.mark.parametrize("name", [_marked(name) for name in PAGES])
def test_pages_do_what_they_say(name, tmp_path):
    PAGES[name](tmp_path, type_in(DOCS / name, tmp_path))


def test_every_page_with_commands_is_typed_or_too_long():
    """Indented blocks and the lines of measured pages and of contributing, which set up environments or take hours, are read alone."""
    with_commands = {
        str(page.relative_to(DOCS))
        for room in ("tutorial", "guide", "development")
        for page in (DOCS / room).glob("*.md")
        if any(kind == "sh" for _, kind, _ in blocks_of(page))
    }
    assert with_commands == {name for name in PAGES if name != "tutorial/own-scene.md"} | set(TOO_LONG)
