"""Where artefacts of one's own go, and where the version stands."""

import re
from pathlib import Path

import pytest

import pdsurrogate as pd
from pdsurrogate.artifacts import ArtifactError, next_version, own_folder, store


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
