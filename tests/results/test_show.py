"""What is drawn of a saved run and of a scene before it runs."""

import json

import numpy as np
import pytest
from commands import commanded, invoke
from matplotlib import image

import pdsurrogate as pds
from pdsurrogate.results import figures


def picture_of(path):
    picture = image.imread(path)[..., :3]
    assert picture.std() > 0.05
    return picture


def test_pictures_of_a_saved_run(folder, tmp_path):
    done = commanded(
        "show",
        folder,
        "--field stress_11 --field displacement --level 0 --out",
        tmp_path,
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "uniaxial-displacement.png",
        "uniaxial-stress_11.png",
    ]
    for path in tmp_path.iterdir():
        picture_of(path)
    assert "Fields: position, displacement" in done.stdout
    assert all(
        f"{row['strain_energy']:.4g}" in done.stdout for row in pds.load_result(folder).history
    )
    assert set(json.loads(invoke("show", folder, "--out", tmp_path, "--json").stdout)) == {
        "fields",
        "history",
    }


def test_equilibria_and_the_end_of_dynamics_are_printed(tmp_path):
    scene = {"spacing": 0.25, "stretches": [1.1]}
    dynamics = {"stretch": 1.12, "stretch_rate": 2.0, "density": 1e-4}
    result = pds.simulate(pds.load_scene("uniaxial", scene, dynamics=dynamics), "bond-energy")
    result.save(tmp_path / "out")
    shown = invoke("show", tmp_path / "out", "--out", tmp_path).stdout
    rows = [row for row in result.history if "time" not in row]
    rows += [row for row in result.history if "time" in row][-10:]
    assert len(rows) > len([row for row in rows if "time" in row]) > 0
    assert all(f"{row['strain_energy']:.4g}" in shown for row in rows)


def test_a_state_in_space_is_drawn_from_its_files(tmp_path):
    pds.simulate(pds.load_scene("bonded-block", spacing=0.25, stretches=1.1), "bond-energy").save(
        tmp_path / "out"
    )
    commanded("show", tmp_path / "out", "--field von_mises --out", tmp_path)
    picture_of(tmp_path / "bonded-block-von_mises.png")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("show {folder} --field stress", "give one of them, such as stress_22"),
        (
            "show {folder} --level 7",
            "level 7: the result has no such output; there are 0 to 1",
        ),
        (
            "show {folder} --html x.html --field wizardry",
            "the state has no field 'wizardry'",
        ),
        ("show {folder} --html x.html --level 0", "leave out --out and --level"),
        ("scenes --plot", "--plot needs a scene"),
        ("scenes uniaxial --plot --set spacing=5", "larger than the body"),
        ("scenes bimaterial --plot --set probes.0.at=9,9", "lies outside the body"),
    ],
)
def test_what_cannot_be_drawn_is_told_in_one_line(
    folder, tmp_path, monkeypatch, arguments, message
):
    monkeypatch.chdir(tmp_path)
    done = commanded(arguments.format(folder=folder), status=2)
    assert message in done.stderr
    assert "Traceback" not in done.output
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["ring-pressure", "tear", "bimaterial", "torsion", "zero-energy"])
def test_a_scene_is_drawn_before_it_is_run(name, tmp_path, monkeypatch):
    drawn, save = [], figures.save
    monkeypatch.setattr(
        figures, "save", lambda figure, path: drawn.append(figure) or save(figure, path)
    )
    spacing = {"torsion": 0.25, "tear": 0.1}.get(name, 0.1)
    commanded("scenes", name, "--plot --set", f"spacing={spacing}", "--out", tmp_path)
    picture = picture_of(tmp_path / f"{name}-scene.png")
    scene = pds.load_scene(name, spacing=spacing)
    [figure] = drawn
    said = [text.get_text().split(":")[0] for text in figure.legends[0].get_texts()]
    for grip in scene.grips:
        assert grip.edge in said
    for entry in (*scene.prescribed, *scene.loads):
        assert entry.name or entry.region in said
    assert ("cut" in said) == bool(scene.precuts)
    # Every region has its color in the picture: that of the legend, on the body as well.
    colors = {
        tuple(np.round(np.array(patch.get_facecolor()[:3]), 2))
        for patch in figure.legends[0].get_patches()
    }
    assert len(colors) == len(figure.legends[0].get_patches())
    assert len(np.unique((picture * 50).round() @ [1, 100, 10_000])) > len(colors)
