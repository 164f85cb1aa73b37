"""The page of HTML with a result: its data, its size, its viewer, and the viewer in a browser."""

import base64
import hashlib
import json
import os
import re
import shutil
import subprocess
import zlib

import numpy as np
import pytest
from commands import commanded, invoke

import pdsurrogate as pds
from pdsurrogate.cli.show import MARK
from pdsurrogate.results.packing import packed
from pdsurrogate.results.page import MOST_CHARACTERS, VIEWER, html_page
from pdsurrogate.results.places import MEASURED, columns_of_measured, write_columns

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))),
    None,
)
NEEDS_BROWSER = pytest.mark.skipif(BROWSER is None, reason="there is no Chromium on this machine")


@pytest.fixture(scope="module")
def block():
    scene = pds.load_scene("bonded-block", spacing=0.125, stretches=[1.1, 1.2])
    return pds.simulate(scene, "bond-energy")


@pytest.fixture(scope="module")
def page(folder):
    return html_page(pds.load_result(folder), ["displacement", "stress_11"])


def data_of(page):
    return json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])


def array_of(piece):
    """The array of a piece, as the viewer reads it."""
    kind, components, text = piece
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8)
    unsigned = np.dtype(f"<u{kind[1]}")
    changes = planes.reshape(unsigned.itemsize, -1).T.copy().view(unsigned).ravel()
    array = np.cumsum(changes, dtype=unsigned).view(f"<{kind}")
    return array if components == 1 else array.reshape(components, -1).T


def test_the_page_holds_everything_and_fetches_nothing(page):
    data = data_of(page)
    assert MARK in page.encode()  # by which it may be replaced
    assert data["outputs"] == ["stretch 1.2", "stretch 1.5"]
    assert list(data["bodies"]["simulated"]["fields"])[:2] == ["displacement", "stress_11"]
    markup = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r"""(src|href)=["']?(?!data:)\w""", markup)
    assert markup.count('src="data:image/png;base64,') == 4  # two fields, the stress, the energies
    # ... and the browser runs no other script than the viewer, and lets it fetch nothing.
    script = re.search(r"<script>(.*?)</script>", page, re.DOTALL)[1]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert "default-src 'none'; img-src data: blob:" in page
    assert f"script-src 'sha256-{digest}'" in page
    for words in (
        "neo-hookean@2",
        pds.__version__,
        "strain_energy [kPa cm^2]",
        "digests.neo-hookean@2",
        "stretches",
    ):
        assert words in page


def test_the_data_are_those_of_the_result(folder, page):
    result = pds.load_result(folder)
    data = data_of(page)
    body = data["bodies"]["simulated"]
    for level in range(2):
        for name, values in (
            ("stress_11", result.field("stress_11", level)),
            ("displacement", np.linalg.norm(result.field("displacement", level), axis=1)),
        ):
            number, low, high = body["fields"][name]["parts"][level]
            assert [low, high] == [values.min(), values.max()]
            found = low + array_of(data["pieces"][number]) / 65534 * (high - low)
            np.testing.assert_allclose(found, values, rtol=0, atol=(high - low) / 65534)
        cells, moved = result.cells(level)
        state = body["states"][level]
        assert np.array_equal(array_of(data["pieces"][state["faces"][0]]), cells.blocks[0])
        nodes = array_of(data["pieces"][state["nodes"]])
        np.testing.assert_array_equal(nodes, cells.nodes.astype("f4"))
        number, low, high = state["moved"]
        found = low + array_of(data["pieces"][number]) / 65534 * (high - low)
        np.testing.assert_allclose(found, moved, rtol=0, atol=(high - low) / 65534)
    assert body["fields"]["stress_11"]["label"] == "P₁₁ (kPa)"
    # Every field and component is there, and what does not change takes no room again.
    assert len(body["fields"]) == 1 + sum(
        result.field(name)[0].size for name in result.field_names()
    )
    assert len({part[0] for part in body["fields"]["position_1"]["parts"]}) == 1


def test_a_value_that_is_no_number_has_a_code_of_its_own(block):
    from pdsurrogate.results.packing import Pieces

    pieces = Pieces()
    number, low, high = pieces.add_coded(np.array([1.0, np.nan, 3.0, np.inf]))
    assert (low, high) == (1.0, 3.0)
    assert array_of(pieces.listed[number]).tolist() == [0, 65535, 65534, 65535]


def test_what_has_no_room_is_left_out_and_told(block):
    def found(share, most=40):
        return packed(block, ["stress_33"], most, every.size * share)

    bodies, shown, every, told = packed(block, ["stress_33"], 40, 10**7)
    assert (shown, told) == ([0, 1], [])
    assert bodies["simulated"]["states"][0]["cells"]
    bodies, shown, pieces, told = found(0.8)
    assert pieces.size <= every.size * 0.8
    assert next(iter(bodies["simulated"]["fields"])) == "stress_33"
    assert shown == [0, 1]
    assert re.fullmatch("the fields .*deformation_gradient_33", told[-1])
    assert bodies["simulated"]["states"][0]["cells"]
    least = packed(block, [], 40, 1)  # no room for anything
    assert least[0] == {}
    assert least[3] == ["the body, which is too large for the viewer"]
    # Below a share at which one field fits in, the inside is left out.
    shares = np.geomspace(0.5, 0.01, 20)
    hollow = next(one for one in map(found, shares) if one[3][0] == "the inside of the solid")
    body = hollow[0]["simulated"]
    assert not body["states"][0]["cells"]
    # The cells at the surface are 8^3 less the 6^3 inside.
    assert len(array_of(hollow[2].listed[body["numbers"]])) == 296
    number, low, high = body["fields"]["stress_33"]["parts"][-1]
    values = low + array_of(hollow[2].listed[number]) / 65534 * (high - low)
    expected = block.field("stress_33")[array_of(hollow[2].listed[body["numbers"]])]
    np.testing.assert_allclose(values, expected, atol=1e-4)
    assert found(1, most=1)[1::2] == ([1], ["1 of 2 outputs"])


MARK_OF_A_USER = "</script><b id=mine>&"


def page_with_markup(block):
    """A page of a result in which a user named the scene, the force and a column with markup."""
    summary = {**block.summary, "scene": MARK_OF_A_USER, "force": MARK_OF_A_USER}
    history = [{MARK_OF_A_USER: 1.0, **row} for row in block.history]
    scene = block.scene.model_copy(update={"title": MARK_OF_A_USER})
    return html_page(pds.Result(scene, block.body, summary, history, block.states), ["von_mises"])


def test_no_text_of_a_user_becomes_markup(block):
    page = page_with_markup(block)
    assert "<b id" not in page
    assert MARK_OF_A_USER in data_of(page)["history"]
    assert page.count("</script>") == 2


def test_a_page_of_a_run_without_outputs_has_tables_alone(folder, tmp_path):
    bare = shutil.copytree(folder, tmp_path / "bare")
    for path in (*bare.glob("*.pvd"), *bare.glob("*.vtu")):
        path.unlink()
    data = data_of(html_page(pds.load_result(bare), ["stress_11"]))
    assert (data["bodies"], data["pieces"], data["outputs"]) == ({}, [], [])


def test_a_file_that_is_no_page_is_not_replaced(folder, tmp_path):
    (tmp_path / "mine.html").write_text("mine")
    done = commanded("show", folder, "--html", tmp_path / "mine.html", status=2)
    assert "was not written by pdsurrogate show and would be overwritten" in done.stderr
    assert (tmp_path / "mine.html").read_text() == "mine"


def test_the_viewer_belongs_to_its_sources():
    """`npm ci && npm run build` in its folder makes it anew, with the digest of the sources."""
    build = (VIEWER.parent / "build.js").read_text()
    names = json.loads(re.search(r"sources = (\[.*?\])", build)[1])
    assert {path.name for path in VIEWER.parent.glob("*.js*")} == {*names, VIEWER.name}
    sources = b"".join((VIEWER.parent / name).read_bytes() for name in names)
    head, license_, *_ = VIEWER.read_text("utf-8").split("\n", 2)
    assert head == f"// {hashlib.sha256(sources).hexdigest()}"
    assert "three.js" in license_
    packages = json.loads((VIEWER.parent / "package.json").read_text())
    for kind in ("dependencies", "devDependencies"):
        assert all(re.fullmatch(r"[\d.]+", version) for version in packages[kind].values())
    assert len(VIEWER.read_bytes()) < MOST_CHARACTERS / 10


def dom(page, tmp_path, view, *options):
    """The document of a page after its script has run, in a browser that reaches no network."""
    path = tmp_path / "page.html"
    path.write_text(page)
    command = [
        BROWSER,
        "--headless",
        "--no-sandbox",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--proxy-server=127.0.0.1:9",
        "--window-size=1200,900",
        f"--user-data-dir={tmp_path / 'profile'}",
        "--virtual-time-budget=20000",
        *options,
        "--dump-dom",
        f"{path.as_uri()}#{view}",
    ]
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=240,
        check=True,
        env={**os.environ, "HOME": str(tmp_path)},
    ).stdout


def report_of(document):
    assert 'id="viewer"' in document
    return json.loads(re.search(r'id="report">(.*?)</script>', document, re.DOTALL)[1])


@NEEDS_BROWSER
def test_the_viewer_shows_a_sheet_in_a_browser(folder, page, tmp_path):
    result = pds.load_result(folder)
    said = report_of(dom(page, tmp_path, "test&field=displacement_2&output=0&pick=0.5,0.3"))
    values = result.field("displacement_2", 0)
    assert said["colors"] > 20
    assert (said["field"], said["output"]) == ("displacement_2", 0)
    point, x, y, value = re.fullmatch(
        r"point (\d+) at \((.*), (.*)\) cm\nu₂ = (.*) cm",
        said["tip"].replace("\N{MINUS SIGN}", "-"),
    ).groups()
    np.testing.assert_allclose(
        [float(x), float(y)], result.field("position")[int(point), :2], atol=1e-6
    )
    assert float(value) == pytest.approx(values[int(point)], rel=1e-4)
    # The curve of this point over the outputs, and the field as a table.
    (probe,) = said["probes"]
    assert probe["x"] == [1.2, 1.5]
    assert probe["y"] == pytest.approx(
        [result.field("displacement_2", level)[int(point)] for level in range(2)], rel=1e-4
    )
    head, *rows = said["csv"].splitlines()
    assert head == "point,x1 [cm],x2 [cm],displacement_2 [cm]"
    found = np.array([row.split(",") for row in rows], dtype=float)
    np.testing.assert_allclose(found[:, 1:3], result.field("position")[:, :2], atol=1e-6)
    np.testing.assert_allclose(found[:, 3], values, atol=1e-4 * np.ptp(values) + 1e-5)


@NEEDS_BROWSER
@pytest.mark.slow  # a browser once more
def test_without_webgl_the_page_shows_its_pictures(page, tmp_path):
    document = dom(page, tmp_path, "", "--disable-3d-apis")
    assert re.search(r'<section id="viewer" hidden', document)
    assert re.search(r'<p id="why">This browser cannot run the viewer', document)
    assert re.search(r'<details id="drawn" open', document)


@pytest.fixture
def measured(folder, tmp_path):
    """A copy of a run with a field measured at all its points at the second output."""
    copy = shutil.copytree(folder, tmp_path / "out")
    places = pds.load_result(folder).field("position")[:, :2] + 0.01
    u = 0.5 * places[:, 0], -0.1 * places[:, 1]
    columns = zip(columns_of_measured(2), (np.full(len(places), 2), *places.T, *u), strict=True)
    write_columns(copy / MEASURED, dict(columns))
    return copy


def page_of(folder):
    path = folder / "page.html"
    commanded("show", folder, "--html", path)
    return path.read_text()


def contracted(result, x2):
    """Displacement of a sheet that contracts to its middle at 0.5, in its exact solution."""
    return result.levels[1]["greatest_lateral_displacement_reference"] * (1 - 2 * x2)


def test_measured_displacements_are_beside_the_simulated_ones(measured):
    data = data_of(page_of(measured))
    entry = data["bodies"]["measured"]
    places = array_of(data["pieces"][entry["places"]])
    simulated = contracted(pds.load_result(measured), places[:, 1])
    found = []
    for number, low, high in entry["states"][1]:
        found.append(low + array_of(data["pieces"][number]) / 65534 * (high - low))
    given = -0.1 * places[:, 1]
    np.testing.assert_allclose(found[0], 0.5 * places[:, 0], atol=1e-4)
    np.testing.assert_allclose(found[1], given, atol=1e-4)
    np.testing.assert_allclose(found[2], 0, atol=1e-4)
    np.testing.assert_allclose(found[3], given - simulated, atol=1e-4)
    assert (array_of(data["pieces"][entry["states"][0][0][0]]) == 65535).all()  # nothing there
    (measured / MEASURED).write_text("step,x1,x2\n1,2,3\n")
    done = commanded("show", measured, "--html", measured / "page.html", status=2)
    assert "the columns must be step,x1,x2,u1,u2" in done.stderr


@pytest.mark.parametrize(
    ("rows", "code", "message"),
    [
        ("1,0.5,0.5,,\n2,0.5,0.5,0,0\n", 0, ""),  # an empty entry is a lost point
        ("3,0.5,0.5,0,0\n", 0, "the run has the outputs 1 to 2"),
        ("", 2, "measured.csv: there are no rows"),
        ("1,a,0,0,0\n", 2, "measured.csv: could not convert"),
    ],
)
def test_rows_of_measured_displacements_are_checked(rows, code, message, measured, monkeypatch):
    monkeypatch.setattr("pdsurrogate.cli.show.html_page", lambda *_: "")
    (measured / MEASURED).write_text(f"step,x1,x2,u1,u2\n{rows}")
    done = invoke("show", measured, "--html", measured / "page.html")
    assert (done.exit_code, message in " ".join(done.stderr.split())) == (code, True)


@NEEDS_BROWSER
@pytest.mark.slow  # a browser once more
def test_the_viewer_shows_the_difference_in_a_browser(measured, tmp_path):
    view = "test&source=difference&field=displacement_2&scale=0&pick=0.4,0.5"
    said = report_of(dom(page_of(measured), tmp_path, view))
    assert "u₂ difference = " in said["tip"]
    _, *rows = said["csv"].splitlines()
    _, _, x2, off = np.array([row.split(",") for row in rows], dtype=float).T
    expected = -0.1 * x2 - contracted(pds.load_result(measured), x2)
    np.testing.assert_allclose(off, expected, atol=1e-4)
    assert said["probes"][0]["y"][0] is None


@NEEDS_BROWSER
@pytest.mark.slow  # a browser once more
def test_the_viewer_cuts_a_solid_in_a_browser(block, tmp_path):
    document = dom(page_with_markup(block), tmp_path, "test&cut=0,0.6&pick=0.45,0.5")
    assert '<b id="' not in document  # not in the menus of the viewer either
    assert "&lt;b id=mine&gt;&amp;</option>" in document
    said = report_of(document)
    assert said["section"] > 0
    point = int(re.match(r"point (\d+)", said["tip"])[1])
    # The cut at 0.6 goes through the cells between 0.5 and 0.625.
    assert block.field("position")[point, 0] == pytest.approx(0.5625)
    assert said["probes"][0]["y"][1] == pytest.approx(block.field("von_mises")[point], rel=1e-3)
