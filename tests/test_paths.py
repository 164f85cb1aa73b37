"""The first hour of two users, as they would type it: one who knows scikit-learn, one who has test data and wants a torn sheet."""

import importlib.util
import json
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pdsurrogate as pd
from pdsurrogate.artifacts import ArtifactError, next_version, own_folder, store
from pdsurrogate.materials import homogeneous

README = (Path(__file__).parents[1] / "README.md").read_text()


@pytest.mark.slow
def test_a_user_of_scikit_learn_twice_in_one_folder(tmp_path, monkeypatch):
    """The README's own block: at most 15 lines; a second run stores the next version."""
    block = re.search(r"^```python\n(.*?)^```", README, re.MULTILINE | re.DOTALL)[1]
    assert len(block.strip().splitlines()) <= 15
    monkeypatch.chdir(tmp_path)
    Path("first.py").write_text(block)
    for version in ("1", "2"):
        found = runpy.run_path("first.py")
        assert abs(found["result"].levels[-1]["nominal_stress_error"]) < 1e-3
        assert (tmp_path / "artifacts" / "my-rubber" / version / "card.json").is_file()
        assert pd.load_card("my-rubber").training["cross_validation"][0]["rms"] < 1e-2
    assert (tmp_path / "stress.png").stat().st_size > 5000


@pytest.mark.slow
def test_an_engineer_from_a_table_of_tests_to_a_torn_sheet(tmp_path):
    """The README's own commands, each to the letter; the sheet alone is coarser, and tears sooner."""
    law = pd.Gent(shear_modulus=400.0, bulk_modulus=40_000.0, chain_limit=60.0)
    modes = {"uniaxial": homogeneous.uniaxial, "equibiaxial": homogeneous.equibiaxial, "pure-shear": homogeneous.pure_shear}
    rows = [
        f"{mode},{stretch},{stressed(law, float(stretch)).nominal_stress}"
        for mode, stressed in modes.items()
        for stretch in np.linspace(1.1, 3.5, 9).round(2)
    ]
    (tmp_path / "tests.csv").write_text("\n".join(["mode,stretch,nominal_stress", *rows]) + "\n")
    coarse = ["--set", "spacing=0.1", "--set", "stretches=1.1,1.2", "--set", "dynamics.stretch=1.6", "--set", "dynamics.outputs=6"]
    block = re.search(r"^```sh\n(pdsurrogate identify .*?)^```", README, re.MULTILINE | re.DOTALL)[1]
    commands = [shlex.split(line, comments=True)[1:] for line in block.splitlines()]
    assert [command[0] for command in commands] == ["identify", "fit", "run", "show"]
    commands[2] += [*coarse, "--set", "fracture.critical_stretch=2.0"]
    for command in commands:
        done = subprocess.run([sys.executable, "-m", "pdsurrogate", *command], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{command}: {done.stderr}"
    summary = json.loads((tmp_path / "out" / "tear" / "summary.json").read_text())
    assert summary["force"] == "my-rubber@1"
    assert summary["material"]["law"] == "ogden"
    assert summary["material"]["shear_modulus"] == pytest.approx(400.0, rel=0.05)
    assert summary["crack"]["broken_bonds"] > 0
    assert (tmp_path / "tear.html").stat().st_size > 50_000


def blocks_of(page, kind):
    """Blocks of a page of the tutorial, of one kind."""
    text = (Path(__file__).parents[1] / "docs" / "tutorial" / page).read_text()
    return re.findall(rf"^```{kind}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def run_commands(page, folder):
    """Run all commands of a page but those that install, in a folder; returns what each has printed."""
    bin_of = Path(sys.executable).parent
    places = {"python": sys.executable, "mpiexec": str(bin_of / "mpiexec")}
    printed = []
    for line in "".join(blocks_of(page, "sh")).splitlines():
        if line.startswith("pip "):
            continue
        words = shlex.split(line)
        command = [sys.executable, "-m", *words] if words[0] == "pdsurrogate" else [places.get(word, word) for word in words]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600, check=False)
        assert done.returncode == 0, f"{line}: {done.stderr}"
        printed.append(done.stdout)
    return printed


@pytest.mark.slow  # four processes
@pytest.mark.skipif(importlib.util.find_spec("mpi4py") is None, reason='no MPI is installed: pip install "pdsurrogate[mpi]"')
def test_the_tutorial_on_ranks_as_it_is_typed(tmp_path):
    (script,) = blocks_of("ranks.md", "python")
    (tmp_path / "sheet.py").write_text(script)
    table, _, told = run_commands("ranks.md", tmp_path)
    assert "stress (kPa)" in table
    assert "points on 2 ranks" in told
    assert told.count("ranks") == 1
    assert (tmp_path / "sheet.png").stat().st_size > 5000
    assert json.loads((tmp_path / "out" / "hole" / "summary.json").read_text())["ranks"] == 2


@pytest.mark.slow  # workers are started
def test_the_tutorial_on_studies_as_it_is_typed(tmp_path, monkeypatch):
    (description,) = blocks_of("study.md", "toml")
    (tmp_path / "radius.toml").write_text(description)
    run_commands("study.md", tmp_path)
    assert (tmp_path / "out" / "radius" / "study.png").stat().st_size > 5000
    # The study of Python is the same: it finds all runs done.
    written = {path: path.stat().st_mtime_ns for path in tmp_path.glob("out/radius/runs/*/outcome.json")}
    assert len(written) == 6
    monkeypatch.chdir(tmp_path)
    (script,) = blocks_of("study.md", "python")
    exec(script, {})
    assert written == {path: path.stat().st_mtime_ns for path in tmp_path.glob("out/radius/runs/*/outcome.json")}


def test_own_artefacts_never_go_among_shipped_ones_by_accident(tmp_path, monkeypatch):
    shipped = store.SHIPPED[1]
    monkeypatch.delenv("PDSURROGATE_ARTIFACTS", raising=False)
    monkeypatch.chdir(tmp_path)
    assert own_folder() == Path("artifacts")
    assert next_version(own_folder(), "x") == "1"
    (tmp_path / "artifacts" / "x" / "1").mkdir(parents=True)
    (tmp_path / "artifacts" / "x" / "10.2").mkdir()
    assert next_version(own_folder(), "x") == "11"
    monkeypatch.chdir(shipped.parent)
    assert own_folder().resolve() != shipped
    monkeypatch.setenv("PDSURROGATE_ARTIFACTS", str(tmp_path / "elsewhere"))
    assert own_folder() == tmp_path / "elsewhere"
    with pytest.raises(ArtifactError, match="which is not a folder"):
        pd.load_surrogate("neo-hookean")


def test_the_version_has_one_home():
    text = (Path(__file__).parents[1] / "pyproject.toml").read_text()
    assert 'dynamic = ["version"]' in text
    assert not re.search(r"^version = ", text, re.MULTILINE)
    assert (Path(pd.__file__).parent / "py.typed").exists()
