"""Pages run as they are printed: a reader types every block into an empty folder.

`pipelines/tutorials.py` types a page and says what a block is.  A ``text`` block shows the output
of the block before it and is compared with it.  A picture has the size of the one that the page
draws.  What sets up an environment is not run here: with the README's two commands continuous
integration itself begins.  Pages of Python alone are run by `tests/test_docs.py`.
"""

import importlib.util
import json
import os
import struct
import sys
from pathlib import Path

import pytest
from several_ranks import SLEEPING
from tutorials import (
    NOTEBOOKS,
    SETS_UP,
    TUTORIALS,
    blocks_of,
    command_of,
    notebook_of,
    outputs_of,
    pictures_of,
    same_output,
    type_in,
)

import pdsurrogate as pds

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"

TOO_LONG = {
    "start/choose.md": "12 runs, and cracks",
    "guide/cracks.md": "cracks of tens of thousands of points",
    "guide/energies.md": "bodies as fine as they are meant",
    "guide/laws.md": "bodies as fine as they are meant",
    "guide/study.md": "24 runs",
    "guide/test-data.md": "a crack of tens of thousands of points",
}
"""Pages whose commands take minutes: `tests/test_docs.py` runs their Python, and sees that their
commands are understood.
"""


@pytest.mark.slow  # fits, and a sheet that tears
def test_the_readme(tmp_path):
    """One who knows scikit-learn, and one who has a table of tests and wants a torn sheet."""
    page = ROOT / "README.md"
    assert (
        len(
            next(block.text for block in blocks_of(page.read_text()) if block.kind == "python")
            .strip()
            .splitlines()
        )
        <= 15
    )
    printed = type_in(page, tmp_path, **SLEEPING)
    ((before, table),) = outputs_of(page).items()
    assert same_output(table.text, printed[before]), f"{table.text}\n{printed[before]}"
    path, error = next(
        text for block, text in printed.items() if block.kind == "python"
    ).splitlines()
    assert path == "artifacts/my-rubber/1"
    assert abs(float(error.rstrip("%"))) < 0.1
    assert (tmp_path / "stress.png").stat().st_size > 5000
    learned, fitted = (
        pds.load_card(tmp_path / "artifacts" / "my-rubber" / number) for number in "12"
    )
    assert learned.training["cross_validation"][0]["rms"] < 1e-2
    # The table is of this rubber, with a bulk modulus of 1000 shear moduli.
    assert fitted.material.trained_with["shear_modulus"] == pytest.approx(400.0, rel=0.01)
    assert fitted.material.trained_with["chain_limit"] == pytest.approx(60.0, rel=0.02)
    summary = json.loads((tmp_path / "out" / "tear" / "summary.json").read_text())
    assert summary["force"] == "my-rubber@2"
    assert summary["crack"]["broken_bonds"] > 50
    assert (tmp_path / "tear.html").stat().st_size > 50_000
    assert (tmp_path / "cantilever-scene.png").stat().st_size > 5000
    assert json.loads((tmp_path / "out" / "cantilever" / "summary.json").read_text())["converged"]


def test_what_sets_up_an_environment_is_typed_from_its_own_command_on():
    """The README's first command ends with a run, which is typed and compared; its second one is
    the tests themselves.
    """
    first, second = (
        block for block in blocks_of((ROOT / "README.md").read_text()) if SETS_UP.match(block.text)
    )
    assert command_of(first) == "pdsurrogate run uniaxial --out out/uniaxial"
    assert command_of(second) == ""


def two_ranks(folder: Path, printed: list[str]) -> None:
    table, told = printed
    assert "stress (kPa)" in table
    assert "points on 2 ranks" in told
    assert told.count("points on 2 ranks") == 1
    assert (folder / "hole-stress.png").stat().st_size > 5000
    summary = json.loads((folder / "out" / "hole" / "summary.json").read_text())
    assert summary["ranks"] == 2


def six_runs(folder: Path, printed: list[str]) -> None:
    """The study of the file is that of Python: whichever comes second finds all runs done."""
    outcomes = list(folder.glob("out/radius/runs/*/outcome.json"))
    assert len(outcomes) == 6
    assert all(
        path.stat().st_mtime_ns < (folder / "out" / "radius" / "study.csv").stat().st_mtime_ns
        for path in outcomes
    )


def left(*names: str):
    """Return a check that a page has left files, none of them nearly empty."""

    def check(folder: Path, printed: list[str]) -> None:
        assert all((folder / name).stat().st_size > 1000 for name in names)

    return check


PAGES = {
    "start/first-steps.md": left(
        "out/uniaxial/summary.json", "out/hole/summary.json", "out/hole-energy/summary.json"
    ),
    "start/installation.md": lambda folder, printed: None,
    "tutorial/first-sheet.md": left("sheet.html", "out/first-sheet/summary.json"),
    "tutorial/own-scene.md": left("out/hanger/summary.json"),
    "tutorial/own-law.md": left("artifacts/biderman/1/card.json"),
    "tutorial/own-data.md": left("artifacts/tested-rubber/1/card.json", "out/tests/identify.json"),
    "tutorial/field.md": left("torn.png"),
    "tutorial/crack.md": left("crack.html", "out/crack/summary.json"),
    "tutorial/energy-model.md": lambda folder, printed: None,
    "tutorial/relaxing-seal.md": left("out/cycles/identify.json", "out/seal/seal.pvd"),
    "tutorial/ranks.md": two_ranks,
    "tutorial/study.md": six_runs,
    "guide/export.md": left(
        "gent_umat.f", "out/export/ogden_isochoric_1_felupe.py", "yeoh_ufl.py", "gent_1.h"
    ),
    "guide/will-it-tear.md": left("artifacts/torn-rubber/1/card.json", "out/part/summary.json"),
    "guide/results.md": left("uniaxial-stress_22.png", "sheet.html", "hole-scene.png"),
}
"""Pages that are typed, and what must be there then besides what they print and the pictures on
them.
"""

PICTURES = {
    "start/first-steps.md": 3,
    "tutorial/first-sheet.md": 1,
    "tutorial/own-scene.md": 2,
    "tutorial/own-data.md": 1,
    "tutorial/field.md": 1,
    "tutorial/crack.md": 2,
    "tutorial/ranks.md": 1,
    "tutorial/study.md": 1,
}
"""Number of pictures on a page that it draws itself."""


def size_of(picture: Path) -> tuple[int, int]:
    """Return width and height of a PNG file in pixels, which differ a little with the fonts and
    the version of matplotlib.
    """
    return struct.unpack(">II", picture.read_bytes()[16:24])


NEEDS_MPI = pytest.mark.skipif(
    importlib.util.find_spec("mpi4py") is None,
    reason='no MPI is installed: pip install -e ".[mpi]"',
)


def _marked(name: str, *others):
    marks = [
        *others,
        *([NEEDS_MPI] if name in ("start/installation.md", "tutorial/ranks.md") else []),
    ]
    return pytest.param(name, marks=marks, id=Path(name).stem)


@pytest.mark.slow  # pictures, fits, processes, cracks
@pytest.mark.parametrize("name", [_marked(name) for name in PAGES])
def test_pages_do_what_they_say(name, tmp_path):
    page = DOCS / name
    printed = type_in(page, tmp_path, **SLEEPING)
    for before, block in outputs_of(page).items():
        assert same_output(block.text, printed[before]), (
            f"{name} shows\n{block.text}\nbut this is printed:\n{printed[before]}"
        )
    pictures = pictures_of(page, tmp_path)
    assert len(pictures) == PICTURES.get(name, 0)
    for target, drawn in pictures.items():
        assert drawn.stat().st_size > 5000
        assert size_of(target) == pytest.approx(size_of(drawn), rel=0.03), (
            f"{target.name} is not what {name} draws"
        )
    PAGES[name](tmp_path, list(printed.values()))


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_notebooks_are_those_of_the_tutorials(page):
    """The script makes them; a change of a tutorial by hand alone would leave its notebook as it
    was.
    """
    pytest.importorskip("nbformat")
    assert (NOTEBOOKS / f"{page.stem}.ipynb").read_text("utf-8") == notebook_of(page), (
        "python pipelines/tutorials.py makes them"
    )
    assert {path.stem for path in NOTEBOOKS.iterdir()} == {page.stem for page in TUTORIALS}


@pytest.mark.slow  # as long as typing the page
def test_a_notebook_runs(tmp_path, monkeypatch):
    """All cells run in an empty folder, in an environment that is active; a command that fails ends
    the notebook too.

    Of one notebook, with files, commands and pictures: the blocks of all are those of pages, which
    are typed above.
    """
    name = "tutorial/own-scene.md"
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    for variable, value in SLEEPING.items():
        monkeypatch.setenv(variable, value)
    notebook = nbformat.read(NOTEBOOKS / f"{Path(name).stem}.ipynb", as_version=4)
    for cell in notebook.cells:
        if cell.cell_type == "code" and cell.source.startswith("!"):
            cell.source = "\n".join(
                f"{line}\nassert _exit_code == 0" for line in cell.source.splitlines()
            )
    nbclient.NotebookClient(
        notebook,
        timeout=600,
        kernel_name="python3",
        resources={"metadata": {"path": str(tmp_path)}},
    ).execute()
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert sum(
        "image/png" in output.get("data", {}) for cell in cells for output in cell.outputs
    ) == PICTURES.get(name, 0)
    commands = [cell.outputs for cell in cells if cell.source.startswith("!")]
    PAGES[name](
        tmp_path,
        [
            "".join(output.text for output in outputs if output.output_type == "stream")
            for outputs in commands
        ],
    )


def test_every_page_with_commands_is_typed_or_too_long():
    """Indented blocks and the lines of measured pages and of contributing, which set up
    environments or take hours, are read alone.
    """
    with_commands = {
        str(page.relative_to(DOCS))
        for room in ("start", "tutorial", "guide", "development")
        for page in (DOCS / room).glob("*.md")
        if any(block.kind == "sh" and command_of(block) for block in blocks_of(page.read_text()))
    }
    assert with_commands == set(PAGES) - {"tutorial/energy-model.md", "tutorial/field.md"} | set(
        TOO_LONG
    )
