"""Reading scenes: what is accepted, and what a user is told about the rest."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pdsurrogate.materials import NeoHookean
from pdsurrogate.scenes import SceneError, load_scene, scene_names
from pdsurrogate.scenes.reading import parse_change


def test_every_built_in_scene_is_valid():
    assert "uniaxial" in scene_names()
    for name in scene_names():
        scene = load_scene(name)
        assert scene.name == name
        assert scene.title


def test_the_papers_section_6_2():
    scene = load_scene("uniaxial")
    assert scene.body.size == (3.0, 1.0)
    assert scene.spacing == 0.02
    assert scene.horizon_ratio == 3.15
    assert scene.stretches == (1.5, 2.0, 2.5)
    assert scene.material.build() == NeoHookean(1.0, 100.0)


def test_changes_by_key():
    scene = load_scene(
        "uniaxial", ["spacing=0.05", "stretches=1.5,2", "material.shear_modulus=3", "solver.method=explicit", "support=points"]
    )
    assert scene.spacing == 0.05
    assert scene.stretches == (1.5, 2.0)
    assert scene.material.build() == NeoHookean(3.0, 100.0)
    assert scene.solver.method == "explicit"
    assert scene.support == "points"
    assert load_scene("uniaxial", {"stretches": 2}, spacing=0.1).stretches == (2.0,)
    assert load_scene("uniaxial", ["material=neo-hookean", "material.bulk_modulus=50"]).material.build() == NeoHookean(1.0, 50.0)


@pytest.mark.parametrize(
    ("change", "key", "value"),
    [
        ("a=1.5", "a", 1.5),
        ("a=1,2", "a", [1, 2]),
        ("a=[1, 2]", "a", [1, 2]),
        ("a=word", "a", "word"),
        ("a.b = 'x'", "a.b", "x"),
        ("a=x,y", "a", ["x", "y"]),
    ],
)
def test_parsing_of_changes(change, key, value):
    assert parse_change(change) == (key, value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["spacing=-1"], "spacing: Input should be greater than 0"),
        (["spacing=nan"], "spacing: Input should be a finite number"),
        (["spacing=inf"], "spacing: Input should be a finite number"),
        (["spacing=wide"], "spacing: Input should be a valid number"),
        (["stretches=0"], "stretches.0: Input should be greater than 0"),
        (["stretches=1.5,-2"], "stretches.1: Input should be greater than 0"),
        (["stretches=[]"], "stretches"),
        (["stretches=1.5,nan"], "stretches.1: Input should be a finite number"),
        (["spcing=0.05"], "spcing: unknown key"),
        (["material.stiffness=1"], "material: neo-hookean has no parameter 'stiffness'; it has bulk_modulus, shear_modulus"),
        (["material.shear_modulus=-1"], "material: neo-hookean: shear_modulus must be positive, not -1"),
        (["material.shear_modulus=soft"], "material: shear_modulus must be a number, not 'soft'"),
        (["material=rubber"], "material: unknown law 'rubber'; there are "),
        (["correction=best"], "correction: Input should be 'tensor', 'scalar' or 'none'"),
        (["support=magnets"], "support: Input should be 'reflected' or 'points'"),
        (["weight=cubic"], "weight: unknown weight function; there are inverse, constant, linear"),
        (["horizon_ratio=0.5"], "horizon_ratio: Input should be greater than 1"),
        (["body.shape=blob"], "body"),
        (["body.size=1,-2"], "body.size.1"),
        (["spacing"], "a change is written key=value"),
        (["=3"], "a change is written key=value"),
        (["spacing.deep=3"], "spacing is not a table"),
    ],
)
def test_bad_changes_name_the_key(changes, message):
    with pytest.raises(SceneError) as caught:
        load_scene("uniaxial", changes)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


GOOD = """
name = "mine"
spacing = 0.1
stretches = 1.2
[body]
size = [1.0, 1.0]
[material]
law = "neo-hookean"
[[grips]]
edge = "bottom"
[[grips]]
edge = "top"
travel = 1.0
"""


def test_scene_files(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(GOOD)
    scene = load_scene(path)
    assert scene.loaded_axis == 1
    assert scene.grips[0].holds == "all"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("travel = 1.0", "travel = 0.4", "the travel of the two grips must add up to 1"),
        ('edge = "top"', 'edge = "left"', "two opposite edges"),
        ('edge = "top"', 'edge = "bottom"', "two opposite edges"),
        ("size = [1.0, 1.0]", "size = [1.0]", "body.size"),
        ("[body]", "[bodi]", "unknown key"),
        ("stretches = 1.2", "", "stretches: Field required"),
        ("= 0.1", "= = 0.1", "not valid TOML"),
        ('law = "neo-hookean"', "", "material.law: Field required"),
    ],
)
def test_bad_scene_files(tmp_path, old, new, message):
    path = tmp_path / "mine.toml"
    path.write_text(GOOD.replace(old, new, 1))
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


def test_scenes_that_are_not_there(tmp_path):
    with pytest.raises(SceneError, match=r"unknown scene 'uniaxal'; built in are .*uniaxial"):
        load_scene("uniaxal")
    with pytest.raises(SceneError, match="cannot read scene file"):
        load_scene(tmp_path / "none.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\x00\xfe")
    with pytest.raises(SceneError, match="not UTF-8"):
        load_scene(binary)


@given(st.text(max_size=200))
def test_any_text_is_a_scene_or_an_error(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("scenes") / "x.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SceneError):
        load_scene(path)


@given(st.data())
def test_damaged_scene_files_are_scenes_or_errors(tmp_path_factory, data):
    """Lines dropped, doubled and mixed up, values exchanged."""
    lines = GOOD.strip().splitlines()
    values = ["0", "-1", '"x"', "[]", "{}", "nan", "1e308", "true", "[[1]]", '["a", 2]']
    for _ in range(data.draw(st.integers(1, 4))):
        k = data.draw(st.integers(0, len(lines) - 1))
        kind = data.draw(st.sampled_from(["drop", "double", "value"]))
        if kind == "drop" and len(lines) > 1:
            del lines[k]
        elif kind == "double":
            lines.insert(k, lines[k])
        elif "=" in lines[k]:
            lines[k] = lines[k].split("=")[0] + "= " + data.draw(st.sampled_from(values))
    path = tmp_path_factory.mktemp("scenes") / "x.toml"
    path.write_text("\n".join(lines))
    try:
        scene = load_scene(path)
    except SceneError as error:
        message = str(error)
    else:
        tomllib.loads(path.read_text())
        message = ""
        assert scene.spacing > 0
    assert "\n" not in message
