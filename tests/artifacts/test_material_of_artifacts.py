"""An artifact brings its material into a scene that was told none, and is held against one that
was.
"""

import tomllib

import pytest
from commands import commanded
from polynomials import polynomial
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.artifacts import with_material
from pdsurrogate.artifacts.material import in_words
from pdsurrogate.materials import Branch, Memory, Softening
from pdsurrogate.scenes import MaterialSpec, SceneError

CHAIN_LIMIT = 62.82566463708167


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Stores a small Gent artifact, as `pdsurrogate fit` does."""
    folder = tmp_path_factory.mktemp("artifacts")

    def make(name, law, identification=None):
        samples = pds.training_samples(law, 400, (0.7, 2.0), random_state=0)
        model = polynomial(samples, 5)
        return pds.store(
            model, samples, law, folder, name, "1", pds.CardText("x", identification=identification)
        )

    return make


def test_a_built_in_scene_takes_the_law_of_the_card(store):
    scene = pds.load_scene("pure-shear")
    changed, model = with_material(
        scene, store("mine", pds.materials.Gent(chain_limit=CHAIN_LIMIT))
    )
    law = changed.material.build()
    assert (law.name, law.chain_limit) == ("gent", CHAIN_LIMIT)
    # The default moduli of a law have no unit: the scene's own counts, with the card's K/mu.
    assert law.shear_modulus == 3.06
    assert law.bulk_modulus == pytest.approx(3.06 * pds.materials.Gent().bulk_modulus)
    model.check_material(law)
    assert changed.model_copy(update={"material": scene.material}) == scene


def test_moduli_that_were_identified_come_along(store):
    """In the scene's unit: those of Treloar's rubber are in MPa; those of another file are in the
    unit that its stresses were fitted in, or what the file has.
    """
    law = pds.materials.Gent(0.27, 54.0, CHAIN_LIMIT)
    scene = pds.load_scene("uniaxial")
    assert scene.units.stress == "kPa"
    for number, (data, factor) in enumerate(
        (
            ({"data": "treloar"}, 1000.0),
            ({"data": "mine.csv"}, 1.0),
            ({"data": "mine.csv", "stress_unit": "psi"}, 6.894757293168361),
            ({"data": "mine.csv", "stress_unit": "ksi"}, 6894.757293168361),
            ({"data": "mine.csv", "stress_unit": "bar"}, 100.0),
            ({"data": "mine.csv", "stress_unit": "N/mm2"}, 1000.0),
            ({"data": "mine.csv", "stress_unit": "kgf/cm2"}, 98.0665),
        )
    ):
        changed, _ = with_material(
            scene, store(f"data-{number}", law, {**data, "law": law.describe()})
        )
        found = changed.material.build()
        assert found.shear_modulus == pytest.approx(0.27 * factor, rel=1e-12)
        assert found.bulk_modulus == pytest.approx(54.0 * factor, rel=1e-12)
    psi = store("psi", law, {"data": "mine.csv", "stress_unit": "psi", "law": law.describe()})
    for unit in ("kpa", None):
        other = scene.model_copy(update={"units": pds.scenes.model.Units(stress=unit)})
        with raising(r"units\.stress must be one of Pa, .* from psi, not", SceneError):
            with_material(other, psi)
    terms = pds.materials.Ogden(moduli=(0.63, 0.0012, -0.01))
    changed, model = with_material(
        scene, store("terms", terms, {"data": "treloar", "law": terms.describe()})
    )
    assert changed.material.build().moduli == pytest.approx((630.0, 1.2, -10.0), rel=1e-12)
    model.check_material(changed.material.build())


def test_what_the_scene_is_already_stays_as_it_is():
    for scene, force in (
        ("uniaxial", "neo-hookean"),
        ("tear", "neo-hookean"),
        ("gent", "gent"),
        ("penny", "neo-hookean-isochoric"),
    ):
        loaded = pds.load_scene(scene)
        assert with_material(loaded, force)[0] is loaded
    loaded = pds.load_scene("uniaxial", material="gent")
    assert with_material(loaded, "analytic")[0] is loaded


def test_a_scene_that_was_told_a_material_has_the_last_word(store):
    path = store("told", pds.materials.Gent(chain_limit=CHAIN_LIMIT))
    scene = pds.load_scene("uniaxial", ["material.law=gent", "material.chain_limit=62.83"])
    with raising(
        r"chain_limit = 62\.82566463708167, not 62\.83; .*--set 'material=", SceneError
    ) as error:
        with_material(scene, path)
    flag = str(error.value).split("--set '")[1].split("'")[0]
    # the one flag that resolves it
    _, model = with_material(pds.load_scene("uniaxial", [flag]), path)
    assert model.name == "told@1"


def test_a_material_in_words_is_toml():
    memory = Memory((Branch(0.5, 2.0), Branch(0.3, 40.0)), Softening(2.0, 0.1, 0.2))
    for law in (pds.materials.Ogden(memory=memory), pds.materials.Gent()):
        read = tomllib.loads(f"material={in_words(law)}")["material"]
        assert MaterialSpec.model_validate(read).build() == law


def test_the_command_says_which_material_it_takes(store):
    changes = "--set spacing=0.2 --set stretches=1.2"
    done = commanded(
        "run uniaxial",
        changes,
        "--force",
        store("said", pds.materials.Gent(chain_limit=CHAIN_LIMIT)),
    )
    assert (
        'Material of said@1: {law="gent", shear_modulus=1.0, bulk_modulus=200.0,'
        " chain_limit=62.82566463708167}" in done.output
    )


def test_an_artifact_that_is_off_is_said_at_every_run(tmp_path):
    law = pds.materials.NeoHookean()
    samples = pds.training_samples(
        pds.materials.Gent(chain_limit=40.0), 400, (0.7, 2.0), random_state=0
    )
    model = polynomial(samples, 5)
    with pytest.warns(UserWarning, match=r"RMS error of [\d.]+ % relative to neo-hookean"):
        path = pds.store(model, samples, law, tmp_path, "off", "1", "x")
    with pytest.warns(
        UserWarning, match=r"off@1 has an RMS error of [\d.]+ % relative to neo-hookean"
    ):
        with_material(pds.load_scene("uniaxial"), path)


def test_an_artifact_that_is_not_there_is_no_force():
    scene = pds.load_scene("uniaxial", {"material": {"artifact": "nope"}, "reference": None})
    with raising("unknown artifact 'nope'", pds.ArtifactError):
        with_material(scene, "bond-energy")
