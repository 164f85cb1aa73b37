"""What is drawn of a saved run and of a scene before it runs, and the page of HTML in a browser."""

import json
import os
import re
import shutil
import subprocess

import numpy as np
import pytest
from matplotlib import image
from typer.testing import CliRunner

import pdsurrogate as pds
from pdsurrogate.cli import app
from pdsurrogate.cli.show import MARK
from pdsurrogate.results import figures
from pdsurrogate.results.drawings import html_page

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))),
    None,
)


def invoke(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def picture_of(path):
    picture = image.imread(path)[..., :3]
    assert picture.std() > 0.05
    return picture


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("saved") / "out"
    pds.simulate(pds.load_scene("uniaxial", spacing=0.1, stretches=[1.2, 1.5]), "neo-hookean").save(
        folder
    )
    return folder


def test_pictures_of_a_saved_run(folder, tmp_path):
    done = invoke(
        "show",
        folder,
        "--field",
        "stress_11",
        "--field",
        "displacement",
        "--level",
        0,
        "--out",
        tmp_path,
    )
    assert done.exit_code == 0, done.output
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


def test_a_state_in_space_is_drawn_from_its_files(tmp_path):
    pds.simulate(pds.load_scene("bonded-block", spacing=0.25, stretches=1.1), "bond-energy").save(
        tmp_path / "out"
    )
    done = invoke("show", tmp_path / "out", "--field", "von_mises", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    picture_of(tmp_path / "bonded-block-von_mises.png")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["show", "nowhere"], "not a folder with results of a run"),
        (["show", "{folder}", "--field", "wizardry"], "the state has no field 'wizardry'"),
        (["show", "{folder}", "--field", "stress"], "give one of them, such as stress_22"),
        (
            ["show", "{folder}", "--level", "7"],
            "level 7: the result has no such output; there are 0 to 1",
        ),
        (
            ["show", "{folder}", "--html", "x.html", "--field", "wizardry"],
            "the state has no field 'wizardry'",
        ),
        (["show", "{folder}", "--html", "x.html", "--level", "0"], "leave out --out and --level"),
        (["scenes", "uniaxal"], "unknown scene 'uniaxal'"),
        (["scenes", "--plot"], "--plot needs a scene"),
        (["scenes", "uniaxial", "--plot", "--set", "spacing=5"], "larger than the body"),
        (["scenes", "bimaterial", "--plot", "--set", "probes.0.at=9,9"], "lies outside the body"),
    ],
)
def test_what_cannot_be_drawn_is_told_in_one_line(
    folder, tmp_path, monkeypatch, arguments, message
):
    monkeypatch.chdir(tmp_path)
    done = invoke(*(argument.format(folder=folder) for argument in arguments))
    assert done.exit_code == 2, done.output
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
    done = invoke("scenes", name, "--plot", "--set", f"spacing={spacing}", "--out", tmp_path)
    assert done.exit_code == 0, done.output
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


@pytest.fixture(scope="module")
def page(folder):
    return html_page(pds.load_result(folder), ["displacement", "stress_11"])


def test_the_page_holds_everything_and_fetches_nothing(page):
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])
    assert MARK in page.encode()  # by which it may be replaced
    assert list(data["pictures"]) == ["displacement", "stress_11"]
    assert all(
        picture.startswith("data:image/png;base64,")
        for pictures in data["pictures"].values()
        for picture in pictures
    )
    assert data["titles"] == ["stretch 1.2", "stretch 1.5"]
    assert not re.search(r"""(src|href)=["']?(?!data:)\w""", page)
    assert "http" not in re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)
    for words in (
        "neo-hookean@2",
        pds.__version__,
        "strain_energy [kPa cm^2]",
        "digests.neo-hookean@2",
        "stretches",
    ):
        assert words in page


def test_a_page_of_a_run_without_outputs_has_no_pictures(folder, tmp_path):
    bare = shutil.copytree(folder, tmp_path / "bare")
    for path in (*bare.glob("*.pvd"), *bare.glob("*.vtu")):
        path.unlink()
    page = html_page(pds.load_result(bare), ["stress_11"])
    data = re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1]
    assert json.loads(data) == {"pictures": {}, "titles": [], "labels": {}}


def test_a_file_that_is_no_page_is_not_replaced(folder, tmp_path):
    (tmp_path / "mine.html").write_text("mine")
    done = invoke("show", folder, "--html", tmp_path / "mine.html")
    assert done.exit_code == 2
    assert "was not written by pdsurrogate show and would be overwritten" in done.stderr
    assert (tmp_path / "mine.html").read_text() == "mine"


def dom(page, tmp_path):
    """The document of a page after its scripts have run, in a browser that reaches no network."""
    path = tmp_path / "page.html"
    path.write_text(page)
    options = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--proxy-server=127.0.0.1:9",
        f"--user-data-dir={tmp_path / 'profile'}",
    ]
    command = [BROWSER, *options, "--virtual-time-budget=2000", "--dump-dom", path.as_uri()]
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
        env={**os.environ, "HOME": str(tmp_path)},
    ).stdout


@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium on this machine")
def test_the_slider_of_the_page_shows_the_outputs_in_a_browser(page, tmp_path):
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])

    def shown(document):
        picture = re.search(r'<img id="picture"[^>]*>', document)[0]
        return (
            re.search(r'src="([^"]*)"', picture)[1],
            re.search(r'<output id="title">([^<]*)<', document)[1],
        )

    assert shown(dom(page, tmp_path)) == (data["pictures"]["displacement"][1], "stretch 1.5")
    moved = """<script>
    output.value = 0; output.dispatchEvent(new Event("input"));
    field.value = "stress_11"; field.dispatchEvent(new Event("change"));
    </script></body>"""
    assert shown(dom(page.replace("</body>", moved), tmp_path)) == (
        data["pictures"]["stress_11"][0],
        "stretch 1.2",
    )
