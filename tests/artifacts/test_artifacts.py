"""Artifacts: what is written, what is refused, and that nothing in a file runs."""

import dataclasses
import hashlib
import io
import json
import os
import pickle
import shutil
import subprocess
import sys
from contextlib import suppress

import numpy as np
import pytest
from conftest import SHIPPED, sealed
from hypothesis import given
from hypothesis import strategies as st
from polynomials import polynomial
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.array_files import DamagedFile, read_arrays
from pdsurrogate.artifacts import (
    ArtifactError,
    find_artifact,
    list_artifacts,
    load_card,
    load_pipeline,
    load_surrogate,
    surrogate_for,
)
from pdsurrogate.artifacts.store import payload_of, save_artifact
from pdsurrogate.learning.fitting import check_worth_storing

LAW = pds.materials.NeoHookean()


@pytest.fixture(scope="module")
def fitted():
    samples = pds.training_samples(LAW, 800, random_state=0)
    network = pds.LevenbergMarquardtRegressor((8,), "algebraic", max_iter=30, random_state=0)
    return pds.surrogate_pipeline(network).fit(samples.X, samples.y), samples


@pytest.fixture
def stored(fitted, tmp_path):
    model, samples = fitted
    return pds.store(model, samples, LAW, tmp_path, "rubber", "1.2", "a test")


def rewrite(folder, payload: bytes, name="surrogate.npz"):
    """Exchange a payload and make the card match it."""
    (folder / name).write_bytes(payload)
    card = json.loads((folder / "card.json").read_text())
    card["payloads"][name].update(sha256=hashlib.sha256(payload).hexdigest(), bytes=len(payload))
    (folder / "card.json").write_text(sealed(card))


def payload_in(folder):
    return payload_of((folder / "surrogate.npz").read_bytes())


def test_round_trip(stored, fitted):
    model, samples = fitted
    assert sorted(path.name for path in stored.iterdir()) == [
        "card.json",
        "pipeline.joblib",
        "surrogate.npz",
    ]
    force = load_surrogate(stored)
    assert force.name == "rubber@1.2"
    np.testing.assert_allclose(
        force.bond_force(*samples.X.T), model.predict(samples.X), rtol=1e-11, atol=1e-12
    )
    again = load_pipeline(stored, trust=True)
    np.testing.assert_array_equal(again.predict(samples.X), model.predict(samples.X))


def test_card_says_what_one_needs_to_know(stored):
    card = load_card(stored)
    assert card.material.law == "neo-hookean"
    assert card.material.trained_with["bulk_modulus"] == 100.0
    assert card.features["names"] == ["log U_nn", "log U_mm", "log J", "log J3^2"]
    assert card.training["design"]["random_state"] == 0
    assert card.training["parameters"]["hidden_layer_sizes"] == [8]
    assert card.domain.least_stretch == 0.5
    assert {"on_surface", "off_surface", "by_strain", "least_slope"} <= set(card.errors["box"])
    assert {"numpy", "scikit-learn", "joblib", "python"} <= set(card.made_with)
    for name, payload in card.payloads.items():
        assert hashlib.sha256((stored / name).read_bytes()).hexdigest() == payload.sha256


def test_versions_never_change(stored, fitted):
    model, samples = fitted
    before = {path.name: path.read_bytes() for path in stored.iterdir()}
    with raising("already exists", ArtifactError):
        pds.store(model, samples, LAW, stored.parents[1], "rubber", "1.2", "again")
    assert {path.name: path.read_bytes() for path in stored.iterdir()} == before
    assert sorted(path.name for path in stored.parent.iterdir()) == [
        "1.2"
    ]  # no temporary folder is left


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("../evil", "1"),
        ("Rubber", "1"),
        ("", "1"),
        ("rubber", "one"),
        ("rubber", "1/2"),
        ("rubber", "../1"),
    ],
)
def test_names_and_versions_that_are_not_allowed(fitted, tmp_path, name, version):
    model, samples = fitted
    with raising("not allowed", ArtifactError):
        pds.store(model, samples, LAW, tmp_path, name, version, "x")
    assert list(tmp_path.iterdir()) == []


def test_finding(stored, fitted, monkeypatch):
    model, samples = fitted
    root = stored.parents[1]
    pds.store(model, samples, LAW, root, "rubber", "1.10", "newer")
    monkeypatch.setenv("PDSURROGATE_ARTIFACTS", str(root))
    assert find_artifact("rubber").name == "1.10"  # versions are compared as numbers
    assert find_artifact("rubber@1.2") == stored
    assert find_artifact(stored) == stored
    assert find_artifact(str(stored.parent)).name == "1.10"
    assert [f"{path.parent.name}@{path.name}" for path in list_artifacts()][-2:] == [
        "rubber@1.2",
        "rubber@1.10",
    ]
    with raising(r"unknown force 'robber'; did you mean rubber", ArtifactError):
        find_artifact("robber")
    with raising("unknown force 'rubber@7'", ArtifactError):
        find_artifact("rubber@7")


@pytest.fixture
def working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PDSURROGATE_ARTIFACTS", raising=False)
    return tmp_path


def test_a_folder_of_results_is_no_artifact(working_folder):
    """``pdsurrogate run pure-shear --out neo-hookean`` twice: the second run silently took the
    analytic force.
    """
    (working_folder / "neo-hookean").mkdir()
    (working_folder / "neo-hookean" / "summary.json").write_text("{}")
    assert surrogate_for(LAW).name == "neo-hookean@2"
    assert load_surrogate("neo-hookean").name == "neo-hookean@2"
    for path in ("./neo-hookean", "neo-hookean/", working_folder / "neo-hookean"):
        with raising("not the folder of an artifact", ArtifactError):
            load_surrogate(path)


def test_a_folder_that_holds_a_card_is_a_path(working_folder, fitted):
    model, samples = fitted
    pds.store(model, samples, LAW, working_folder, "mine", "1", "in the working folder")
    assert load_surrogate("mine").name == "mine@1"
    shutil.copytree("mine/1", "neo-hookean")
    with raising(r"artifacts/neo-hookean/2.* the folder neo-hookean contains", ArtifactError):
        load_surrogate("neo-hookean")
    assert load_surrogate("./neo-hookean").name == "neo-hookean (mine@1 by its card)"
    assert load_surrogate("neo-hookean@2").name == surrogate_for(LAW).name == "neo-hookean@2"


@pytest.mark.parametrize("damage", ["no card", "bad card", "no payload"])
def test_what_cannot_be_read_is_never_another_model(working_folder, damage):
    """A damaged ``artifacts/neo-hookean/3`` was passed over: an older version or the analytic
    force ran in its place.
    """
    folder = working_folder / "artifacts" / "neo-hookean" / "3"
    shutil.copytree(SHIPPED / "neo-hookean" / "2", folder)
    if damage == "bad card":
        (folder / "card.json").write_text("{")
    else:
        (folder / ("card.json" if damage == "no card" else "surrogate.npz")).unlink()
    for load in (
        lambda: surrogate_for(LAW),
        lambda: load_surrogate("neo-hookean"),
        lambda: pds.simulate("uniaxial"),
    ):
        with raising(
            r"neo-hookean/3/card.json: cannot be read|not valid JSON|surrogate\.npz: ",
            ArtifactError,
        ):
            load()
    assert load_surrogate("neo-hookean@1").name == "neo-hookean@1"


def test_a_missing_folder_of_artifacts_is_named(working_folder, monkeypatch):
    monkeypatch.setenv("PDSURROGATE_ARTIFACTS", "nowhere")
    with raising("PDSURROGATE_ARTIFACTS is 'nowhere', which is not a folder", ArtifactError):
        surrogate_for(LAW)


def test_materials_that_an_artifact_does_not_describe_are_told_apart_in_full_digits():
    with raising(r"with chain_limit = 120\.0, not 120\.00001; fit"):
        load_surrogate("gent").check_material(pds.materials.Gent(chain_limit=120.00001))
    with raising(r"ogden with parameters .*exponent_1.*modulus_3.*, not .*modulus_1.*; use"):
        load_surrogate("ogden").check_material(pds.materials.Ogden(moduli=(1.0,), exponents=(2.0,)))


def test_shipped_artifacts_are_small_and_complete():
    for name in ("neo-hookean/1", "neo-hookean/2", "neo-hookean-paper"):
        folder = find_artifact(SHIPPED / name)
        assert sum(path.stat().st_size for path in folder.iterdir()) < 2**20
        assert load_card(folder).training["cross_validation"]
    assert isinstance(load_surrogate("neo-hookean"), pds.forces.NetworkForce)


class Malice:
    """Unpickling this touches a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize(
    "place", ["a pickle", "a pickled array", "an array of objects", "a record with objects"]
)
def test_malicious_payload_with_a_matching_digest_does_not_run(stored, tmp_path, place):
    trap = tmp_path / "trap"
    good, file = payload_in(stored), io.BytesIO()
    if place == "a pickle":
        pickle.dump(Malice(trap), file)
    elif place == "a pickled array":
        np.save(file, np.array([Malice(trap)], dtype=object))
    elif place == "an array of objects":
        np.savez(file, **{**good, "at_rest": np.array([Malice(trap)], dtype=object)})
    else:
        np.savez(
            file,
            **{
                **good,
                "at_rest": np.array(
                    [(0.0, Malice(trap))], dtype=[("number", float), ("thing", object)]
                ),
            },
        )
    rewrite(stored, file.getvalue())
    with raising("file of plain arrays", ArtifactError):
        load_surrogate(stored)
    assert not trap.exists()
    # The same file does run where one trusts it: the trap is a real one.
    found = np.load(stored / "surrogate.npz", allow_pickle=True)
    if isinstance(found, np.lib.npyio.NpzFile):
        found["at_rest"]
    assert trap.exists()


def test_a_compressed_payload_is_refused(stored):
    """Squeezed, a file of kilobytes could fill the memory."""
    file = io.BytesIO()
    np.savez_compressed(file, **payload_in(stored))
    rewrite(stored, file.getvalue())
    with raising("compressed", ArtifactError):
        load_surrogate(stored)


@given(st.binary(max_size=300))
def test_any_bytes_are_refused_or_arrays(data):
    with suppress(DamagedFile):
        assert all(
            isinstance(array, np.ndarray) for array in read_arrays(io.BytesIO(data)).values()
        )


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda text: "", "not valid JSON"),
        (lambda text: "[1, 2]", "not the card"),
        (
            lambda text: text.replace('"schema_version": 3', '"schema_version": 99'),
            "upgrade pdsurrogate",
        ),
        (
            lambda text: text.replace('"schema_version": 3', '"schema_version": 0'),
            "older card again",
        ),
        (
            lambda text: text.replace('"least_stretch": 0.5', '"least_stretch": NaN'),
            "least_stretch: must be a finite number",
        ),
        (lambda text: "[" * 100_000, "not valid JSON"),
        (lambda text: " " * (2**20 + 10), "not a card"),
    ],
)
def test_damaged_cards(stored, damage, message):
    card = stored / "card.json"
    card.write_text(damage(card.read_text()))
    with raising(message, ArtifactError):
        load_surrogate(stored)


def test_card_that_is_not_text(stored):
    (stored / "card.json").write_bytes(b"\xff\xfe\x00")
    with raising("not valid JSON", ArtifactError):
        load_card(stored)


def test_pipeline_needs_trust_and_its_digest(stored, tmp_path):
    with raising("trust=True", ArtifactError):
        load_pipeline(stored)
    trap = tmp_path / "trap"
    (stored / "pipeline.joblib").write_bytes(pickle.dumps(Malice(trap)))
    with raising("SHA-256 differs", ArtifactError):
        load_pipeline(stored, trust=True)
    assert not trap.exists()


def test_bytes_are_reproduced_in_another_process(tmp_path, monkeypatch):
    code = """
import sys, pdsurrogate as pds
law = pds.materials.NeoHookean()
samples = pds.training_samples(law, 600, random_state=0)
network = pds.LevenbergMarquardtRegressor((6,), "algebraic", max_iter=25, random_state=0)
model = pds.surrogate_pipeline(network).fit(samples.X, samples.y)
text = pds.CardText("reproduced", pds.cross_validate(model, samples, 2))
pds.store(model, samples, law, sys.argv[1], "rubber", "1", text)
"""
    folders = [tmp_path / "a", tmp_path / "b"]
    monkeypatch.setattr(sys, "argv", ["", str(folders[0])])
    exec(code, {})
    environment = {**os.environ, "PYTHONHASHSEED": "1", "OPENBLAS_NUM_THREADS": "2"}
    subprocess.run([sys.executable, "-c", code, str(folders[1])], check=True, env=environment)
    for name in ("card.json", "surrogate.npz", "pipeline.joblib"):
        assert (folders[0] / "rubber/1" / name).read_bytes() == (
            folders[1] / "rubber/1" / name
        ).read_bytes(), name


def test_saving_leaves_nothing_behind_when_it_fails(fitted, tmp_path, monkeypatch):
    model, samples = fitted
    from pdsurrogate.artifacts import store as module

    def full(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module.np, "savez", full)
    with raising("No space left", OSError):
        pds.store(model, samples, LAW, tmp_path, "rubber", "1", "x")
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_read_again_is_not_kept(stored):
    card = load_card(stored).model_dump()
    for key in ("format", "schema_version", "payloads"):
        del card[key]
    force = load_surrogate(stored)
    deep = dataclasses.replace(
        force, layers=(*force.layers[:-1], *[(np.eye(8), np.zeros(8))] * 3, force.layers[-1])
    )
    before = sorted(stored.parents[1].rglob("*"))
    with raising("one to 3 hidden layers", ArtifactError):
        save_artifact(stored.parents[1], {**card, "version": "2"}, deep)
    assert sorted(stored.parents[1].rglob("*")) == before


def test_an_artifact_binds_no_law_that_has_changed_since(tmp_path):
    """A constant within a law's expressions is in no card: forces are compared instead."""
    from pdsurrogate.materials import InvariantLaw

    def law_with(b):
        @dataclasses.dataclass(frozen=True)
        class Exponential(InvariantLaw):
            name = "expo"
            reference = "Demiray 1972"

            @property
            def parameters(self):
                return np.array([self.bulk_modulus / self.shear_modulus])

            @staticmethod
            def isochoric(I1, I2, parameters):
                growth, zero = np.exp(b * (I1 - 3)), 0 * I1
                return (growth - 1) / (2 * b), growth / 2, zero, b * growth / 2, zero, zero

        return Exponential()

    law = law_with(0.05)
    samples = pds.training_samples(law, 1000, (0.6, 2.5))
    model = polynomial(samples, (8, 4))
    path = pds.store(model, samples, law, tmp_path, "expo", "1", "a user's own law")
    load_surrogate(path).check_material(law)
    with raising(r"expo@1 differs .*: the law has changed since"):
        load_surrogate(path).check_material(law_with(0.5))
    unsaved = dataclasses.replace(load_surrogate(path), stated=None)
    unsaved.check_material(law)
    with raising("of the greatest force, more than 5 %: the law has changed since"):
        unsaved.check_material(law_with(0.5))
    with pytest.warns(UserWarning, match=r"expo@1 deviates from expo by [1-5]"):
        unsaved.check_material(law_with(0.062))
    with pytest.warns(UserWarning, match=r"expo@3 has an RMS error of .* % relative to expo,"):
        pds.store(model, samples, law_with(0.06), tmp_path, "expo", "3", "samples of a law nearby")
    with raising(r"expo@2 has an RMS error of .* more than 10 %; it is not written: fit it"):
        pds.store(model, samples, law_with(0.5), tmp_path, "expo", "2", "samples of another law")
    assert not (tmp_path / "expo" / "2").exists()


def test_what_is_far_off_at_small_strains_alone_is_said():
    """Beside enormous forces at the end of its range all errors look small."""
    bins = [{"strain": [0.01, 0.02], "rms": 0.4}, {"strain": [1, 3], "rms": 1e-3}]
    errors = {"on_surface": {"rms": 1e-3}, "by_strain": bins, "stretch_range": [0.4, 4.0]}
    with pytest.warns(UserWarning, match="x has an RMS error of 40 % at strains from 0.01 to 0.02"):
        check_worth_storing(errors, "x", LAW)


@pytest.mark.parametrize("bulk", [10.0, 1000.0])
def test_shipped_bond_forces_serve_every_bulk_modulus(bulk):
    for name in ("neo-hookean@1", "neo-hookean@2", "neo-hookean-paper"):
        load_surrogate(name).check_material(pds.materials.NeoHookean(2.0, 2.0 * bulk))


def test_names_and_versions_of_artifacts_that_would_be_misread(fitted, tmp_path):
    model, samples = fitted
    with raising(
        "'analytic' is not allowed: it is the name of an exact force model", ArtifactError
    ):
        pds.store(model, samples, LAW, tmp_path, "analytic", "1", "x")
    with raising("version 1 is not allowed: it must be text", ArtifactError):
        pds.store(model, samples, LAW, tmp_path, "rubber", 1, "x")
