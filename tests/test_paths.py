"""Where artifacts of one's own go, and where the version stands."""

import re
from pathlib import Path

from refusals import raising
from typer.testing import CliRunner

import pdsurrogate as pds
from pdsurrogate.artifacts import ArtifactError, own_folder, places
from pdsurrogate.artifacts.places import next_version
from pdsurrogate.cli import app


def test_own_artifacts_never_go_among_shipped_ones_by_accident(tmp_path, monkeypatch):
    shipped = places.SHIPPED[1]
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
    with raising("which is not a folder", ArtifactError):
        pds.load_surrogate("neo-hookean")


def test_the_version_has_one_home():
    text = (Path(__file__).parents[1] / "pyproject.toml").read_text()
    assert 'dynamic = ["version"]' in text
    assert not re.search(r"^version = ", text, re.MULTILINE)
    assert (Path(pds.__file__).parent / "py.typed").exists()


def test_where_artifacts_go_in_a_checkout_is_said():
    """`store(..., None, ...)` writes to own-artifacts there, which neither the README nor the
    help said.
    """
    readme = (Path(__file__).parents[1] / "README.md").read_text()
    assert "`own-artifacts/`" in readme
    assert "print(path)" in readme
    assert "own-artifacts" in pds.store.__doc__
    help_text = CliRunner().invoke(app, ["fit", "--help"], env={"COLUMNS": "200"}).output
    assert "in a checkout own-artifacts" in " ".join(help_text.split())
