"""What users ask of a result: fields, pictures, tables, where it comes from, and the same of one
read back from its folder.
"""

import csv
import json
import sys

import numpy as np
import pytest
from described import SCENES
from matplotlib.figure import Figure
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.results.drawings import title_of
from pdsurrogate.results.files import write_json
from pdsurrogate.results.folder import FolderTaken
from pdsurrogate.results.provenance import git_state

PULLED = SCENES["pulled bar"]


@pytest.fixture(scope="module")
def stretched():
    return pds.simulate(
        pds.load_scene("uniaxial", spacing=0.1, stretches=[1.2, 1.5]), "neo-hookean"
    )


@pytest.fixture(scope="module")
def loaded():
    return pds.simulate(pds.Scene.model_validate(PULLED), "bond-energy")


def test_fields_by_name_and_component(stretched):
    stress = stretched.field("stress")
    assert stress.shape == (300, 3, 3)
    np.testing.assert_array_equal(stretched.field("stress_21", level=1), stress[:, 1, 0])
    np.testing.assert_array_equal(stretched.field("displacement")[:, :2], stretched.displacement())
    np.testing.assert_array_equal(
        stretched.field("principal_stretches_1"), stretched.field("principal_stretch")
    )
    np.testing.assert_array_equal(stretched.field("position")[:, :2], stretched.body.points)
    assert stretched.field("C33", level=0).shape == (300,)
    for name, message in (
        ("wizardry", "the state has no field 'wizardry'; there are position, displacement"),
        ("stress_2", "stress has components such as stress_22"),
        (
            "displacement_12",
            "'displacement_12' does not exist: displacement has components such as displacement_1",
        ),
        ("von_mises_1", "von_mises has no components"),
    ):
        with raising(message):
            stretched.field(name)
    with raising("level 2: the result has no such output; there are 0 to 1", IndexError):
        stretched.field("stress", level=2)


def test_plots(stretched, tmp_path):
    for field in ("stress_11", "displacement", "von_mises"):
        figure = stretched.plot(field, level=0)
        assert isinstance(figure, Figure)
        figure.savefig(tmp_path / "x.png")
    body, bar = stretched.plot("stress_11").axes
    assert (body.get_title(), bar.get_ylabel()) == (title_of(stretched, 1), "P₁₁ (kPa)")
    square = pds.simulate(
        pds.load_scene("uniaxial", {"body.size": [1.0, 1.0], "spacing": 0.25, "stretches": [1.2]}),
        "neo-hookean",
    )
    body, bar = square.plot().axes
    assert (body.get_title(), bar.get_ylabel()) == (title_of(square, 0), "|u| (cm)")
    values = stretched.field("displacement_2")
    greatest = np.abs(values).max()
    for limits, expected in ((None, (-greatest, greatest)), ((-1.0, 2.0), (-1.0, 2.0))):
        drawn = stretched.plot("displacement_2", limits=limits).axes[0].collections[0]
        np.testing.assert_array_equal(drawn.get_array(), values)
        assert drawn.get_clim() == pytest.approx(expected)
    with raising("stress has nine components; give one of them, such as stress_22"):
        stretched.plot("stress")


def test_the_history_has_forces_displacements_and_energies_of_all_that_holds_or_loads(
    stretched, loaded
):
    """Displacements are what the scene prescribes, and the work of a dead load is what the body
    stores, as it grows.
    """
    rows = stretched.history
    assert [row["stretch"] for row in rows] == [1.2, 1.5]
    assert [row["displacement_left_1"] for row in rows] == [0, 0]
    assert [row["displacement_right_1"] for row in rows] == pytest.approx([0.6, 1.5])
    for row, level in zip(rows, stretched.levels, strict=True):
        assert row["force_right_1"] == pytest.approx(level["nominal_stress"])
        assert row["displacement_right_1"] == level["displacements"]["right"][0]
    assert (
        0
        < rows[0]["evaluations"]
        < rows[1]["evaluations"]
        == stretched.summary["n_force_evaluations"]
    )
    # Neo-Hookean rubber in simple tension, nearly incompressible: mu/2 (lambda^2 + 2/lambda - 3) V,
    # to mu/K.
    assert rows[-1]["strain_energy"] == pytest.approx(0.5 * (1.5**2 + 2 / 1.5 - 3) * 3.0, rel=0.01)

    first, second = loaded.history
    assert (first["step"], first["t"], second["step"], second["t"]) == (0, 0.5, 1, 1.0)
    assert second["force_right_1"] == pytest.approx(0.2)
    assert second["force_left_1"] == pytest.approx(-0.2, rel=1e-5)
    assert first["displacement_left_1"] == 0
    # Work of a force that grows from 0 by way of two outputs, by Simpson's rule in the
    # displacement: the strain energy.
    u = np.array([0, first["displacement_right_1"], second["displacement_right_1"]])
    force = np.polynomial.Polynomial.fit(u, [0.0, 0.1, 0.2], 2).integ()
    assert second["strain_energy"] == pytest.approx(force(u[2]) - force(0.0), rel=1e-3)


def test_tables_with_pandas_and_without(stretched, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    table = stretched.table()
    assert table == stretched.history
    assert table[0] is not stretched.history[0]
    monkeypatch.undo()
    pytest.importorskip("pandas")
    table = stretched.table()
    assert list(table["stretch"]) == [1.2, 1.5]
    assert table.attrs["units"]["force_right_1"] == "kPa cm"
    assert table.attrs["units"]["displacement_right_1"] == "cm"


def test_results_scenes_laws_and_models_are_short_in_text_and_have_tables_for_notebooks(
    stretched, loaded
):
    assert repr(stretched) == "<Result of uniaxial with neo-hookean@2: 300 points, 2 states>"
    assert (
        repr(stretched.scene)
        == "<Scene uniaxial: rectangle, spacing 0.1 cm, neo-hookean, 2 stretches>"
    )
    assert repr(loaded.scene) == "<Scene pulled: rectangle, spacing 0.2 cm, neo-hookean, 2 steps>"
    model = pds.load_surrogate("neo-hookean@1")
    assert repr(model) == "<NetworkForce neo-hookean@1 of neo-hookean>"
    things = (
        stretched,
        stretched.scene,
        pds.materials.Gent(),
        model,
        pds.load_surrogate("analytic"),
        pds.load_card("neo-hookean@1"),
    )
    for thing in things:
        text = thing._repr_html_()
        assert text.startswith("<table>")
        assert len(repr(thing)) < 160
        assert 100 < len(text) < 6000
    assert "0.1 &lt;" not in stretched._repr_html_()


def test_where_a_result_comes_from(stretched, loaded):
    summary = json.loads(json.dumps(stretched.summary, allow_nan=False))
    origin = summary["provenance"]
    assert origin["version"] == pds.__version__
    assert origin["date"].startswith("20")
    assert set(origin["machine"]) == {"processor", "cores", "system"}
    assert origin["git"] == git_state()
    assert set(summary["digests"]) == {"neo-hookean@2"}
    assert pds.Scene.model_validate(summary["scene_as_run"]) == stretched.scene
    assert pds.Scene.model_validate(loaded.summary["scene_as_run"]) == loaded.scene
    # A learned model is told from another by its numbers alone.
    other = pds.simulate(stretched.scene, "neo-hookean-paper").summary["digests"][
        "neo-hookean-paper@1"
    ]
    assert summary["digests"]["neo-hookean@2"] != other


@pytest.mark.parametrize("name", pds.scene_names())
def test_every_scene_comes_back_from_a_summary(name):
    scene = pds.load_scene(name)
    assert (
        pds.Scene.model_validate(
            json.loads(json.dumps(scene.model_dump(mode="json", by_alias=True, exclude_none=True)))
        )
        == scene
    )


def test_a_result_is_read_back(stretched, loaded, tmp_path):
    for number, result in enumerate((stretched, loaded)):
        folder = tmp_path / str(number)
        result.save(folder)
        found = pds.load_result(folder)
        assert repr(found) == repr(result)
        assert found.scene == result.scene
        assert found.summary == json.loads(json.dumps(result.summary))
        for row, expected in zip(found.history, result.history, strict=True):
            assert row == pytest.approx(expected)
        assert found.states.moments == result.states.moments
        np.testing.assert_array_equal(found.displacement(0), result.displacement(0))
        np.testing.assert_allclose(found.field("stress_11"), result.field("stress_11"), rtol=1e-6)
        cells, moved = found.cells(-1)
        expected = result.cells(-1)
        np.testing.assert_allclose(
            cells.nodes + moved, expected[0].nodes + expected[1], rtol=1e-6, atol=1e-7
        )
        assert isinstance(found.plot("von_mises"), Figure)
        assert isinstance(found.figure(), Figure)
        assert isinstance(found.loading_figure(), Figure)
        assert found._repr_html_()
        header = next(csv.reader((folder / "history.csv").read_text().splitlines()))
        assert "strain_energy [kPa cm^2]" in header
        assert "displacement_right_1 [cm]" in header


def test_what_cannot_be_read_back_is_told(stretched, tmp_path):
    with raising("not a folder with results of a run", FileNotFoundError):
        pds.load_result(tmp_path)
    stretched.save(tmp_path)
    older = {key: value for key, value in stretched.summary.items() if key != "scene_as_run"}
    write_json(tmp_path / "summary.json", older)
    with raising("older version and does not contain the scene: run the scene again"):
        pds.load_result(tmp_path)
    # What such a folder holds is not known, and is not replaced unasked.
    with raising(r"results of uniaxial.*; use another folder, or --overwrite", FolderTaken):
        stretched.save(tmp_path)
    stretched.save(tmp_path, overwrite=True)
    (tmp_path / "uniaxial.pvd").write_text("<VTKFile")
    with raising("the result cannot be read"):
        pds.load_result(tmp_path)
