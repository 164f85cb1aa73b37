"""The command ``export``: names of laws and artifacts, files that are written whole, and
messages.
"""

import json
import os

import pytest
from commands import invoke

import pdsurrogate as pds
from pdsurrogate.artifacts import store
from pdsurrogate.export import TARGETS
from pdsurrogate.materials import LAWS
from pdsurrogate.results import files


def export(*words):
    return invoke("export", *words)


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("name", [*LAWS, "neo-hookean-energy", "ogden-isochoric", "full-network@1"])
def test_laws_and_artifacts_are_written(name, target, tmp_path):
    if (name, target) == ("neo-hookean-energy", "calculix-umat"):
        name = "neo-hookean-isochoric"  # the energy of a sheet is refused
    done = export(name, "--to", target, "--out", tmp_path, "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    [path] = tmp_path.iterdir()
    assert found["path"] == str(path)
    assert found["to"] == target
    assert name.partition("@")[0] in found["name"]
    assert found["name"] in path.read_text()
    assert path.name.startswith(name.replace("-", "_").replace("@", "_"))


def test_a_name_of_a_law_means_the_law(tmp_path):
    assert export("gent --set chain_limit=50 --to c --out", tmp_path).exit_code == 0
    assert "chain_limit = 50" in (tmp_path / "gent.h").read_text().replace("\n *", "")
    assert export("gent@1 --to c --out", tmp_path).exit_code == 0
    assert "bond force, which no energy gives" in " ".join(
        (tmp_path / "gent_1.h").read_text().replace("\n *", "").split()
    )


def test_an_identified_energy_is_exported_with_its_terms(tmp_path, monkeypatch):
    """The dictionary of `fit --free` is the law on the card of an artifact with a bond force."""
    law = pds.materials.Polyconvex(
        moduli=(0.31, -0.02), exponents=(1.75, -1.25), first=(0.2, 0.01), second=(0.0,)
    )
    samples = pds.training_samples(law, 400, (0.8, 1.5), random_state=0)
    network = pds.learning.ChebyshevRegressor(6)
    model = pds.surrogate_pipeline(network, features="isochoric").fit(samples.X, samples.y)
    pds.store(model, samples, law, tmp_path / "own", "my-rubber", "1", "from tests")
    monkeypatch.setenv("PDSURROGATE_ARTIFACTS", str(tmp_path / "own"))
    assert export("my-rubber --to c --out", tmp_path).exit_code == 0
    text = (tmp_path / "my_rubber_1.h").read_text()
    assert "{1.75, 1.0, " in text
    assert "{-1.25, 1.0, " in text
    assert f"digest {store.load_card('my-rubber').found_digest()}" in " ".join(
        text.replace("\n *", "").split()
    )


def test_an_existing_file_is_kept_unless_asked(tmp_path):
    path = tmp_path / "yeoh_umat.f"
    assert export("yeoh --to umat --out", tmp_path).exit_code == 0
    assert export("yeoh --to umat --out", tmp_path).exit_code == 0  # the same again
    path.write_text("C     mine\n")
    done = export("yeoh --to umat --out", tmp_path)
    assert done.exit_code == 2
    assert "yeoh_umat.f: the file already exists and differs; add --overwrite" in done.stderr
    assert path.read_text() == "C     mine\n"
    assert export("yeoh --to umat --out", tmp_path, "--overwrite").exit_code == 0
    assert "SUBROUTINE UMAT" in path.read_text()


def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    def full(*paths):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "replace", full)
    assert export("yeoh --to c --out", tmp_path).exit_code == 1
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("gnt --to c", "unknown artifact 'gnt'; did you mean gent"),
        ("bond-energy --to c", "unknown artifact 'bond-energy'"),
        (
            "gent@1 --to c --set chain_limit=3",
            "--set changes parameters of a law, and gent@1 is not one",
        ),
        ("gent --to c --set chain_limit=-1", "chain_limit"),
        ("gent --to matlab", "'matlab' is not one of"),
        ("gent", "--to"),
    ],
)
def test_what_cannot_be_exported_is_refused_in_one_line(words, message, tmp_path):
    done = export(words, "--out", tmp_path)
    assert done.exit_code == 2
    assert message in " ".join(done.stderr.split())
    assert os.listdir(tmp_path) == []
