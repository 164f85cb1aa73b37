"""Strength and tearing energy on a card replace "artifact" in a scene, in its units."""

import pytest
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.artifacts import with_material
from pdsurrogate.scenes import SceneError

LAW = pds.materials.NeoHookean(0.5, 50.0)
TESTS = {
    "data": "tests.toml",
    "law": LAW.describe(),
    "stress_unit": "MPa",
    "at_break": {
        "uniaxial": {
            "specimens": 6,
            "stretch": [3.0, 0.2],
            "nominal_stress": [2.0, 0.2],
            "work": [2.2, 0.3],
            "weibull_modulus": [12.0, 5.4],
        }
    },
    "tearing": {
        "trouser": {"specimens": 3, "energy": [10.0, 1.0]},
        "pure-shear-tear": {"specimens": 1, "energy": [14.0, None]},
    },
}
FRACTURE = {
    "energy": "artifact",
    "strength": {
        "uniaxial": "artifact",
        "scatter": {"modulus": "artifact", "length": 1.0, "specimen": [25.0, 4.0]},
    },
}


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Stores a small artifact with what is said of its tests."""
    folder = tmp_path_factory.mktemp("artifacts")
    samples = pds.training_samples(LAW, 400, (0.7, 2.0), random_state=0)
    model = pds.surrogate_pipeline(pds.learning.ChebyshevRegressor(5), features="isochoric").fit(
        samples.X, samples.y
    )

    def make(name, tests):
        text = pds.CardText("x", identification=tests)
        return pds.store(model, samples, LAW, folder, name, "1", text)

    return make


def sheet(fracture, length="mm", stress="MPa"):
    return pds.Scene.model_validate(
        {
            "name": "sheet",
            "spacing": 0.5,
            "body": {"size": [6.0, 6.0]},
            "stretches": [1.1],
            "grips": [{"edge": "bottom"}, {"edge": "top", "travel": 1.0}],
            "dynamics": {"stretch": 3.0, "stretch_rate": 0.1, "density": 1.0},
            "units": {"length": length, "stress": stress},
            "fracture": fracture,
        }
    )


def test_a_scene_takes_the_means_of_the_tests_in_its_units(store):
    artifact = store("torn", TESTS)
    changed, _ = with_material(sheet(FRACTURE), artifact)
    assert changed.fracture.energy == pytest.approx(11.0)  # of four specimens
    assert changed.fracture.strength.uniaxial == 2.0
    assert changed.fracture.strength.scatter.modulus == 12.0
    changed, _ = with_material(sheet(FRACTURE, "m", "kPa"), artifact)
    assert changed.fracture.energy == pytest.approx(11.0)  # kPa m are MPa mm
    assert changed.fracture.strength.uniaxial == pytest.approx(2000.0)
    stretch = {"energy": 3.0, "strength": {"stretch": "artifact"}}
    changed, _ = with_material(sheet(stretch), artifact)
    assert (changed.fracture.energy, changed.fracture.strength.stretch) == (3.0, 3.0)
    assert pds.Scene.model_validate(sheet(FRACTURE).model_dump()) == sheet(FRACTURE)


def test_what_a_card_does_not_have_is_said(store):
    untorn = {key: value for key, value in TESTS.items() if key != "tearing"}
    few = {**TESTS, "at_break": {"uniaxial": {**TESTS["at_break"]["uniaxial"]}}}
    del few["at_break"]["uniaxial"]["weibull_modulus"]
    for name, tests, length, message in (
        ("untorn", untorn, "mm", "fracture.energy: the card has no tear tests"),
        ("few", few, "mm", "fracture.strength.scatter.modulus: the card has no five tests"),
        ("torn2", TESTS, None, "fracture.energy: units.length must be one of um, mm"),
        ("none", None, "mm", "fracture.energy: the card has no tear tests"),
    ):
        with raising(message, SceneError):
            with_material(sheet(FRACTURE, length), store(name, tests))


def test_an_exact_force_takes_law_and_means_of_an_artifact(store):
    """By its material, of the body and of a part, in the units of the scene."""
    artifact = {"artifact": str(store("source", TESTS))}
    second = {**TESTS["at_break"], "equibiaxial": TESTS["at_break"]["uniaxial"]}
    second["equibiaxial"]["nominal_stress"] = [1.4, 0.1]
    other = {"artifact": str(store("second", {**TESTS, "at_break": second}))}
    weak = {"energy": 1.0, "strength": {"stretch": 2.0, "equibiaxial": "artifact"}}
    part = {"region": {"box": [[0, 3], [6, 6]]}, "material": other, "fracture": weak}
    data = sheet(FRACTURE, "m", "kPa").model_dump()
    scene = pds.Scene.model_validate(data | {"material": artifact, "materials": [part]})
    assert pds.Scene.model_validate(scene.model_dump()) == scene
    for force in ("bond-energy", None):
        found, model = with_material(scene, force)
        assert model.name == "bond-energy"
        assert found.law() == LAW.scaled(1000.0)
        assert found.fracture.strength.uniaxial == pytest.approx(2000.0)
        assert found.materials[0].material.build() == LAW.scaled(1000.0)
        assert found.materials[0].fracture.strength.equibiaxial == pytest.approx(1400.0)
    with raising(r"material: it is that of the artifact .*, which only", SceneError):
        scene.law()
    assert "material of" in repr(scene)
    with raising("of the artifact: leave shear_modulus out", SceneError):
        pds.Scene.model_validate(data | {"material": artifact | {"shear_modulus": 2.0}})
    bare = pds.Scene.model_validate(data | {"material": {"artifact": str(store("bare", None))}})
    with raising(r"fracture\.energy: the card has no tear", SceneError):
        with_material(bare, "bond-energy")
