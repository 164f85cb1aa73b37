"""Cards that were edited by hand: refused in a line with the file, the field and what would be
right, or of no matter to a run.
"""

import copy
import json
import re
import shutil
import warnings

import numpy as np
import pytest
from conftest import SHIPPED, sealed
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.artifacts import ArtifactError, load_card, load_surrogate
from pdsurrogate.artifacts.shipped import SHIPPED_CARDS

LAW = pds.materials.Gent(chain_limit=60.0)


@pytest.fixture(scope="module")
def polynomial(tmp_path_factory):
    """A polynomial, of a law with a shape, as identified from data."""
    samples = pds.training_samples(LAW, 800, (0.6, 2.0), random_state=0)
    regressor = pds.learning.ChebyshevRegressor((10, 5))
    model = pds.surrogate_pipeline(regressor, features="isochoric").fit(samples.X, samples.y)
    text = pds.CardText("x", identification={"data": "mine.csv", "law": LAW.describe()})
    return pds.store(model, samples, LAW, tmp_path_factory.mktemp("edited"), "mine", "1", text)


@pytest.fixture(scope="module")
def isochoric(tmp_path_factory):
    """A learned isochoric energy by itself, with a hull of test data."""
    law = pds.materials.NeoHookean()
    samples = pds.training_samples(law, 300, (0.7, 1.8), random_state=0, target="isochoric-energy")
    samples.design["hull"] = [[1.0, 0.0, 0.5], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.5]]
    regressor = pds.learning.SobolevRegressor(4, "algebraic", max_iter=60, random_state=0)
    model = pds.surrogate_pipeline(regressor, "isochoric-energy").fit(samples.X, samples.y)
    return pds.store(model, samples, law, tmp_path_factory.mktemp("edited"), "iso", "1", "x")


def card_of(folder):
    return json.loads((folder / "card.json").read_text())


def refused(folder, text: str) -> str | None:
    """What is said of an artifact with this for a card; None where it is taken."""
    (kept := folder / "card.json.kept").exists() or shutil.copy(folder / "card.json", kept)
    try:
        (folder / "card.json").write_text(text)
        try:
            load_surrogate(folder)
        except ArtifactError as error:
            return str(error)
        return None
    finally:
        shutil.copy(kept, folder / "card.json")


def changed(card: dict, path: tuple, value) -> dict:
    """A card with another value at a place; `...` takes it away."""
    card = copy.deepcopy(card)
    place = card
    for step in path[:-1]:
        place = place[step]
    if value is ...:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return card


EDITS = [
    (("format",), "another", "format: this is not the card of a pdsurrogate artifact"),
    (
        ("schema_version",),
        True,
        (
            "schema_version: this pdsurrogate reads 2 to 3, not True: upgrade pdsurrogate to read a"
            " newer card"
        ),
    ),
    (("name",), 3, r"name: Input should be a valid string \(given 3\)"),
    (("kind",), ..., "kind: this key is missing"),
    (("color",), "red", "color: unknown key"),
    (
        ("material", "shape", "chain_limit"),
        True,
        r"material.shape.chain_limit: Input should be a valid number \(given True\)",
    ),
    (
        ("training", "identification"),
        "x",
        r"training.identification: must be a table \(given 'x'\)",
    ),
    (
        ("domain", "least_stretch"),
        True,
        r"domain.least_stretch: Input should be a valid number \(given True\)",
    ),
    (
        ("domain", "least_stretch"),
        -1,
        r"domain.least_stretch: Input should be greater than 0 \(given -1\)",
    ),
    (("domain", "hull"), [], "domain.hull: needs at least 3 entries, not 0"),
    (("errors",), {}, "errors.box: this key is missing"),
    (
        ("errors", "box", "on_surface", "rms"),
        -1,
        r"errors.box.on_surface.rms: Input should be greater than or equal to 0 \(given -1\)",
    ),
    (
        ("errors", "box", "n_samples"),
        2.5,
        r"errors.box.n_samples: Input should be a valid integer \(given 2.5\)",
    ),
    (
        ("payloads", "surrogate.npz", "sha256"),
        "0",
        "payloads.surrogate.npz.sha256: String should match pattern",
    ),
    (("members",), 3, r"members: must be a list \(given 3\)"),
]

CONTRADICTIONS = [
    (("kind",), "oracle"),
    (("material", "trained_with", "chain_limit"), 61.0),
    (("material", "shape", "chain_limit"), 61.0),
    (("features", "set"), "symmetric"),
    (("training", "identification", "law", "chain_limit"), 3),
    (("domain", "least_stretch"), 0.5),
    (("domain", "hull"), [[1, 0, 1]] * 3),
    (("errors", "box", "on_surface", "rms"), 0.3),
    (("payloads", "surrogate.npz", "sha256"), "0" * 64),
    (("payloads", "surrogate.npz"), ...),
    (("payloads", "evil.so"), {"contains": "", "sha256": "0" * 64, "bytes": 0}),
    (("members",), [{}]),
]
"""Values of the right type that are not those that were stored."""


@pytest.mark.parametrize(
    ("path", "value"),
    CONTRADICTIONS,
    ids=[f"{'.'.join(map(str, path))}={value}"[:60] for path, value in CONTRADICTIONS],
)
def test_what_a_run_depends_on_is_as_it_was_stored(polynomial, path, value):
    said = refused(polynomial, json.dumps(changed(card_of(polynomial), path, value)))
    assert re.search(
        f"mine.*card.json: digest: .*{path[0]}.* have changed since .*: restore the card", said
    )


@pytest.mark.parametrize(
    ("path", "value", "message"),
    EDITS,
    ids=[f"{'.'.join(map(str, path))}={value}"[:60] for path, value, _ in EDITS],
)
def test_what_is_said_of_an_edit(polynomial, path, value, message):
    said = refused(polynomial, json.dumps(changed(card_of(polynomial), path, value)))
    assert said is not None
    assert re.search(message, said), said
    assert "\n" not in said
    assert "mine" in said
    assert not re.search("pydantic|Traceback|For further", said)


def test_contradictions_with_the_weights(polynomial):
    """A card with a digest of its own, of another material than its weights."""
    card = card_of(polynomial)
    other = changed(card, ("material", "trained_with", "chain_limit"), 30.0)
    other = changed(
        changed(other, ("material", "shape", "chain_limit"), 30.0),
        ("training", "identification"),
        ...,
    )
    said = refused(polynomial, sealed(other))
    assert re.search(
        "card.json: material: surrogate.npz does not match the material that the card states:"
        " mine@1 differs from the forces of gent",
        said,
    )
    for path, value, message in (
        (("kind",), "oracle", "kind: unknown kind 'oracle'; there are bond-force-network"),
        (
            ("kind",),
            "bond-force-network",
            "surrogate.npz does not contain a bond-force-network, as the card states: ",
        ),
        (
            ("payloads", "surrogate.npz", "bytes"),
            2**40,
            "surrogate.npz: the card states 1099511627776 bytes, but files of more than",
        ),
        (("payloads", "surrogate.npz"), ..., "surrogate.npz: the artifact has no such file"),
        (
            ("payloads", "surrogate.npz", "sha256"),
            "0" * 64,
            "surrogate.npz: the file is damaged or was replaced",
        ),
        (
            ("material", "trained_with", "chain_limit"),
            "60",
            "the card's material.trained_with: chain_limit must be a number",
        ),
        (
            ("material", "trained_with", "color"),
            1.0,
            "material.trained_with: gent has no parameter 'color'",
        ),
    ):
        said = refused(polynomial, sealed(changed(card, path, value)))
        assert re.search(message, said), said


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (
            lambda text: text.replace('"least_stretch": 0.6', '"least_stretch": 1e999', 1),
            "domain.least_stretch: must be a finite number, .* not inf",
        ),
        (lambda text: text[:-40], "not valid JSON"),
        (
            lambda text: text.replace(
                '"scaling": {', '"scaling": {"deep": ' + "[" * 900 + "]" * 900 + ", ", 1
            ),
            None,
        ),
    ],
)
def test_json_that_means_something_else_than_it_says(polynomial, edit, message):
    said = refused(polynomial, edit((polynomial / "card.json").read_text()))
    assert (said is None) if message is None else re.search(message, said)


def everywhere(text: str) -> dict:
    """The chain limit that it was stored with times ten, in every place, and errors that allow
    for it.
    """
    card = json.loads(text.replace("60.0", "600.0"))
    card["errors"]["box"]["on_surface"] = {"rms": 0.09, "max": 0.5}
    return card


def moduli(text: str) -> dict:
    card = json.loads(text)
    for law in (card["material"]["trained_with"], card["training"]["identification"]["law"]):
        law |= {"shear_modulus": 7.0, "bulk_modulus": 700.0}
    return card


def range_of_stretches(text: str) -> dict:
    card = json.loads(text)
    card["domain"]["greatest_stretch"] = card["errors"]["box"]["stretch_range"][1] = 2.5
    return changed(card, ("errors", "box", "on_surface"), {"rms": 0.09, "max": 0.5})


@pytest.mark.parametrize("edit", [everywhere, moduli, range_of_stretches])
def test_what_is_edited_in_the_same_way_everywhere_is_not_believed(polynomial, edit):
    """A card that agrees with itself and with its weights to the errors that it states: all of
    these were taken.
    """
    text = json.dumps(edit((polynomial / "card.json").read_text()))
    said = refused(polynomial, text)
    assert "card.json: digest: kind, material" in said
    assert "restore the card, or store the artifact again" in said
    (polynomial / "card.json").write_text(text)
    try:
        for load in (load_card, lambda folder: pds.load_pipeline(folder, trust=True)):
            with raising("digest", ArtifactError):
                load(polynomial)
    finally:
        shutil.copy(polynomial / "card.json.kept", polynomial / "card.json")


def of_schema_2(card: dict) -> str:
    """The card as it was written before cards had a digest."""
    return json.dumps(changed({**card, "schema_version": 2}, ("digest",), ...))


def test_a_card_without_a_digest_is_read_with_a_remark(polynomial):
    card = card_of(polynomial)
    assert card["schema_version"] == 3
    assert "digest: this entry is missing" in refused(
        polynomial, json.dumps(changed(card, ("digest",), ...))
    )
    with pytest.warns(UserWarning, match=r"mine@1.* no digest .*store it again"):
        assert refused(polynomial, of_schema_2(card)) is None


def test_shipped_cards_are_known_without_a_digest(tmp_path):
    """Their bytes are unchanged and say nothing of a digest; a copy is held to them wherever it
    lies.
    """
    folders = sorted(path.parent for path in SHIPPED.glob("*/*/card.json"))
    assert {load_card(folder).payloads["surrogate.npz"].sha256 for folder in folders} == set(
        SHIPPED_CARDS
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for folder in folders:
            assert load_surrogate(folder).domain
    copied = shutil.copytree(SHIPPED / "gent" / "1", tmp_path / "copy" / "4")
    text = (copied / "card.json").read_text().replace("120.0", "119.999999")
    assert "card.json: digest: kind, material" in refused(copied, text)


def test_what_is_stored_is_identified_by_its_own_law(isochoric, tmp_path):
    model, law = pds.load_pipeline(isochoric, trust=True), pds.materials.NeoHookean()
    samples = pds.training_samples(law, 300, (0.7, 1.8), random_state=0, target="isochoric-energy")
    text = pds.CardText("x", identification={"data": "mine.csv", "law": LAW.describe()})
    with raising(
        r"training.identification.law: must be the law in material.trained_with,"
        r" .*neo-hookean.*, not .*gent",
        ArtifactError,
    ):
        pds.store(model, samples, law, tmp_path, "iso", "1", text)
    samples.design["hull"] = [[1.0, 0.0, 0.5], [-1.0, 0.0, -0.1], [0.0, 1.0, 0.5]]
    with raising(r"domain.hull.1.2: .* greater than or equal to 0", ArtifactError):
        pds.store(model, samples, law, tmp_path, "iso", "1", "x")
    assert list(tmp_path.iterdir()) == []


FREE = {"name", "version", "description", "weight_function", "scaling", "training", "made_with"}
"""Parts that no run is changed by, but for the name of the artifact; the identification is
digested.
"""

VALUES = st.one_of(
    st.none(), st.booleans(), st.integers(-3, 3), st.text(max_size=3),
    st.floats(allow_nan=False, allow_infinity=False),
    st.just([]), st.just({}), st.just(10**400), st.just([[]]), st.just(...), st.just({"": None}),
)  # fmt: skip


def places(value, path=()):
    """Every place of a card."""
    if path:
        yield path
    for key, inner in (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    ):
        yield from places(inner, (*path, key))


def as_run(folder):
    """All of a surrogate that a run depends on."""
    model, card = load_surrogate(folder), load_card(folder)
    payload = {
        key: value.tolist() if isinstance(value, np.ndarray) else value
        for key, value in model.payload().items()
    }
    read = type(model), payload, model.domain, model.law, dict(model.shape)
    return read, card.material.trained_with


@settings(max_examples=100)
@given(data=st.data())
def test_any_edit_is_refused_with_its_field_or_changes_nothing(polynomial, isochoric, data):
    folder = data.draw(st.sampled_from([polynomial, isochoric]))
    card = card_of(folder)
    path = data.draw(st.sampled_from([*places(card)]))
    if data.draw(st.booleans()) and isinstance(path[-1], str):
        path = (*path[:-1], data.draw(st.sampled_from(["extra", "nmae"])))
        value = data.draw(VALUES.filter(lambda value: value is not ...))
    else:
        value = data.draw(VALUES)
    before = as_run(folder)
    text = json.dumps(changed(card, path, value))
    message = refused(folder, text)
    words = [str(step) for step in path if isinstance(step, str)]
    if message is not None:
        assert "\n" not in message
        assert folder.parent.name in message
        assert any(word in message for word in words) or path[0] in message, message
        assert not re.search("pydantic", message), message
    elif path[0] not in FREE:
        (folder / "card.json").write_text(text)
        try:
            assert as_run(folder) == before
        finally:
            shutil.copy(folder / "card.json.kept", folder / "card.json")
