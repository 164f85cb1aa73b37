"""Reading scenes: what is accepted, and what a user is told about the rest."""

import copy
import os
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import raising, refused, saying

import pdsurrogate as pds
from pdsurrogate.cli import simulation as run_tables
from pdsurrogate.materials import NeoHookean
from pdsurrogate.results.measures import label_of
from pdsurrogate.results.page import html_page
from pdsurrogate.scenes import Grip, MaterialSpec, SceneError, Units, load_scene, scene_names
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
        "uniaxial",
        [
            "spacing=0.05",
            "stretches=1.5,2",
            "material.shear_modulus=3",
            "solver.method=explicit",
            "support=points",
        ],
    )
    assert scene.spacing == 0.05
    assert scene.stretches == (1.5, 2.0)
    assert scene.material.build() == NeoHookean(3.0, 100.0)
    assert scene.solver.method == "explicit"
    assert scene.support == "points"
    assert load_scene("uniaxial", {"stretches": 2}, spacing=0.1).stretches == (2.0,)
    assert load_scene(
        "uniaxial", ["material=neo-hookean", "material.bulk_modulus=50"]
    ).material.build() == NeoHookean(1.0, 50.0)


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


@refused("changes")
def test_bad_changes_name_the_key(changes, message):
    with saying(message, SceneError) as caught:
        load_scene("uniaxial", changes)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"grips": [{"edge": "lft"}, {"edge": "right", "travel": 1.0}]},
            "grips.0.edge: Input should be 'left', 'right', 'bottom'",
        ),
        (
            {"holds": [{"points": [1], "components": ["x1"], "travel": [0.0, 0.3]}]},
            "holds.0: travel moves the points along x2, which is not among the components",
        ),
        (
            {"holds": [{"points": [1], "components": ["x3"]}]},
            "holds.0.components: a 2D body has no x3, only x1 and x2",
        ),
    ],
)
def test_one_mistake_is_one_problem(changes, message):
    """A wrong entry of a list was followed by "Tuple should have at least 2 items after
    validation, not 1", which is not so.
    """
    with saying(message, SceneError) as caught:
        load_scene("uniaxial", changes)
    assert ";" not in str(caught.value)


def test_entries_of_lists_are_changed_by_their_number():
    scene = load_scene(
        "uniaxial",
        [
            "grips.0.edge=top",
            "grips.1.edge=bottom",
            "grips.0.travel=0.5",
            "grips.1.travel=0.5",
            "stretches.2=3",
        ],
    )
    assert [(grip.edge, grip.travel) for grip in scene.grips] == [("top", 0.5), ("bottom", 0.5)]
    assert scene.stretches == (1.5, 2.0, 3.0)


def test_changes_stay_as_the_caller_gave_them(tmp_path):
    """``load_scene("uniaxial", {"body": body, "body.size": [2.0, 1.0]})`` changed `body`, and a
    scene file's folder went into its file.
    """
    body, material = {"size": [3.0, 1.0]}, {"law": "neo-hookean"}
    changes = {
        "body": body,
        "body.size": [2.0, 1.0],
        "material": material,
        "material.shear_modulus": 5,
    }
    before = copy.deepcopy(changes)
    scene = load_scene("uniaxial", changes)
    assert changes == before
    assert (scene.body.size, scene.material.build().shear_modulus) == ((2.0, 1.0), 5.0)
    grips = {
        "grips": ({"edge": "left"}, {"edge": "right", "travel": 1.0}),
        "grips.0.holds": "normal",
    }
    before = copy.deepcopy(grips)
    assert load_scene("uniaxial", grips).grips[0].holds == "normal"
    assert grips == before
    mesh = {"shape": "mesh", "file": "square.vtu"}
    (tmp_path / "mine.toml").write_text(GOOD)
    for _ in range(2):
        assert load_scene(tmp_path / "mine.toml", body=mesh).body.file == str(
            tmp_path / "square.vtu"
        )
    assert mesh == {"shape": "mesh", "file": "square.vtu"}


@pytest.mark.parametrize(
    ("part", "fields", "message"),
    [
        (pds.shapes.Circle, {"radius": -1}, "radius: Input should be greater than 0 (given -1)"),
        (
            pds.shapes.Circle,
            {"radi": 1},
            "radius: this key is missing; radi: unknown key; did you mean radius?",
        ),
        (
            pds.shapes.Rectangle,
            {"size": (True, 1.0)},
            "size.0: Input should be a valid number (given True)",
        ),
        (
            pds.shapes.Polygon,
            {"vertices": [(0, 0), (1, 1)]},
            "vertices: needs at least 3 entries, not 2",
        ),
        (pds.shapes.Precut, {"start": (0, 1), "end": (0, 1)}, "a precut needs two different ends"),
        (
            Grip,
            {"edge": "lft"},
            (
                "edge: Input should be 'left', 'right', 'bottom', 'top', 'back' or 'front' (given"
                " 'lft')"
            ),
        ),
        (
            MaterialSpec,
            {"law": "gent", "chain_limt": 3},
            "gent has no parameter 'chain_limt'; did you mean chain_limit?",
        ),
        (
            pds.Scene,
            {**load_scene("uniaxial").model_dump(exclude={"spacing"}), "spacng": 0.1},
            "spacing: this key is missing; spacng: unknown key; did you mean spacing?",
        ),
    ],
)
def test_parts_composed_in_python_are_told_like_those_of_files(part, fields, message):
    for make in (lambda: part(**fields), lambda: part.model_validate(fields)):
        with pytest.raises(SceneError) as caught:
            make()
        assert str(caught.value) == message


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


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_scene_files(tmp_path, encoding):
    path = tmp_path / "mine.toml"
    path.write_text(GOOD, encoding)
    scene = load_scene(path)
    assert scene.loaded_axis == 1
    assert scene.grips[0].holds == "all"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("travel = 1.0", "travel = 0.4", "the travel of the two grips must add up to 1"),
        ('edge = "top"', 'edge = "left"', "two opposite edges"),
        ("size = [1.0, 1.0]", "size = [1.0]", "body.size"),
        ("[body]", "[bodi]", "unknown key"),
        ("= 0.1", "= = 0.1", "not valid TOML"),
        ('law = "neo-hookean"', "", "material.law: this key is missing"),
    ],
)
def test_bad_scene_files(tmp_path, old, new, message):
    path = tmp_path / "mine.toml"
    path.write_text(GOOD.replace(old, new, 1))
    with saying(message, SceneError) as caught:
        load_scene(path)
    assert str(path) in str(caught.value)


def test_scenes_that_are_not_there(tmp_path):
    with raising("unknown scene ''", SceneError):  # "cannot read scene file .: Is a directory"
        load_scene("")
    if os.path.exists("/dev/zero"):
        with raising("the file has more than 16 MiB, so it is not a scene", SceneError):
            load_scene("/dev/zero")  # which was read until memory was full
    with raising("cannot read scene file", SceneError):
        load_scene(tmp_path / "none.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\x00\xfe")
    with raising("not UTF-8", SceneError):
        load_scene(binary)


@given(st.text(max_size=200))
def test_any_text_is_a_scene_or_an_error(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("scenes") / "x.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SceneError):
        load_scene(path)


def test_a_step_of_too_many_increments_is_refused():
    """It asked for terabytes."""
    with raising(r"steps.0.largest_increment: .*100,000 increments", SceneError):
        load_scene("traction", {"steps": [{"to": 0.4, "largest_increment": 1e-12}]})


def test_a_tear_in_dynamics_asks_for_a_step_with_dynamics():
    fracture = {"critical_stretch": 2.0, "process": "dynamics"}
    with raising("process: needs a step with dynamics, or process", SceneError):
        load_scene("traction", {"fracture": fracture})


def test_blanks_around_an_amplitude_do_not_count():
    assert load_scene("traction", {"loads.0.amplitude": " ramp "}).loads[0].amplitude == "ramp"


@pytest.mark.parametrize(
    "amplitude",
    [
        *("t.real", "__import__('os')", "(lambda: t)()", "'t'", "True", "max(t, key=abs)", "speed"),
        *(3, None, {"t": 1}, [[0, 0]], [[0, 0], [0, 1]], [[0, 0, 0], [1, 1, 1]]),
        *([[0, "0"], [1, "a"]], [[0, 0], [1, 10**400]]),
    ],
)
def test_what_is_no_amplitude_is_refused(amplitude):
    """An integer beyond all floats ended in an error of NumPy."""
    with raising(r"loads\.0\.amplitude: .*an expression of t", SceneError):
        load_scene("traction", {"loads.0.amplitude": amplitude})


PLAIN = {
    "name": "plain",
    "spacing": 0.25,
    "stretches": 1.2,
    "body": {"shape": "rectangle", "size": [3.0, 1.0]},
    "grips": [
        {"edge": "left", "holds": "normal"},
        {"edge": "right", "holds": "normal", "travel": 1.0},
    ],
}
"""Without a material and without units."""


def test_what_has_no_units_claims_none(tmp_path, monkeypatch):
    """All headers said kPa and cm."""
    scene = pds.Scene.model_validate({**PLAIN, "material": "neo-hookean"})
    assert repr(scene) == "<Scene plain: rectangle, spacing 0.25, neo-hookean, 1 stretch>"
    result = pds.simulate(scene, "analytic")
    result.save(tmp_path)
    texts = [path.read_text() for path in tmp_path.glob("*.csv")] + [
        html_page(result, ["stress_11"]),
        label_of("stress_11", scene.units),
    ]
    for printed in (run_tables.print_levels, run_tables.print_cells):
        with run_tables.out.capture() as said:
            printed(result)
        texts.append(said.get())
    figure = result.loading_figure()
    texts += [figure.axes[0].get_ylabel(), *(text.get_text() for text in pds.preview(scene).texts)]
    for text in texts:
        text = re.sub(
            r"<script>.*</script>|base64,[^\"]+|\"pieces\":.*?\]\]", "", text, flags=re.DOTALL
        )
        assert not re.search(r"kPa|\bcm\b|\[s\]|None", text)
    named = Units(length="mm", stress="MPa")
    assert (named.force, named.time, named.label("time", "time")) == ("MPa mm^2", None, "time")
    assert named.amount(2.0, "length", ".1f", "^2") == "2.0 mm^2"
    # What a force's material is converted to is known of scenes that name their unit.
    assert load_scene("uniaxial").units.stress == "kPa"


def test_a_material_may_be_left_to_the_force():
    """A scene had to state a material, though the force brought its own."""
    scene = pds.Scene.model_validate(PLAIN)
    found = pds.simulate(scene, "gent")
    card = pds.load_card("gent").material.trained_with
    assert found.summary["material"] == card
    stated = pds.simulate(pds.Scene.model_validate({**PLAIN, "material": card}), "gent")
    assert found.levels[0]["nominal_stress"] == stated.levels[0]["nominal_stress"]
    for force in (None, "analytic", "bond-energy", pds.AnalyticBondForce()):
        with raising(r"scene plain: material: missing; add one, or choose an artifact", SceneError):
            pds.simulate(scene, force)


def test_a_slip_that_is_repeated_does_not_fill_the_screen():
    slip = [{"region": {"disk": i}, "material": "neo-hookean"} for i in range(1000)]
    with raising(r"materials\.0\.region\.disk: .*and 990 problems more", SceneError) as caught:
        load_scene("uniaxial", {"materials": slip})
    assert len(str(caught.value)) < 2500
