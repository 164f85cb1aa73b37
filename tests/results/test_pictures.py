"""What pictures show: scales, color maps, axes, outlines and labels, and loading curves."""

import matplotlib
import numpy as np
import pytest
import pyvista
from matplotlib.collections import LineCollection

import pdsurrogate as pds
from pdsurrogate.results import figures
from pdsurrogate.results.measures import label_of

CM = pds.load_scene("uniaxial").units


@pytest.fixture(scope="module")
def stretched():
    return pds.simulate(
        pds.load_scene("uniaxial", spacing=0.1, stretches=[1.2, 1.5]), "neo-hookean"
    )


@pytest.fixture(scope="module")
def block():
    return pds.simulate(pds.load_scene("torsion", spacing=0.25), "bond-energy")


@pytest.mark.parametrize(
    ("field", "label"),
    [
        *(
            ("displacement", "|u| (cm)"),
            ("displacement_2", "u₂ (cm)"),
            ("stress_11", "P₁₁ (kPa)"),
            ("cauchy_stress_12", "σ₁₂ (kPa)"),
        ),
        *(
            ("von_mises", "von Mises stress (kPa)"),
            ("principal_stretches_3", "λ₃"),
            ("deformation_gradient_12", "F₁₂"),
            ("volume_ratio", "volume ratio J"),
        ),
        *(("own_field", "own field"), ("own_field_2", "own field₂")),
    ],
)
def test_labels_are_symbols_with_units(field, label):
    assert label_of(field, CM) == label


def test_a_pixel_shows_the_cell_that_covers_its_middle():
    """Of cells smaller than two pixels an image is drawn: here of a sheared and turned lattice of
    30 x 20 cells, in fewer pixels and in more.
    """
    cells = pds.Body.rectangle(30.0, 20.0, 1.0, 1.5).cells
    F = np.array([[0.8, -0.5], [0.9, 0.7]])
    for size in (0.41, 2.93):
        places = size * (cells.nodes @ F.T) + [12.0 * size, 0.0]
        counts = np.ceil(places.max(axis=0)).astype(int)
        image = figures.image_of(cells, places, np.arange(600.0), counts)
        middles = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in counts)), axis=-1)
        x = np.linalg.solve(F, (middles / size - [12.0, 0.0])[..., None])[..., 0]
        inside = ((x > 0) & (x < [30.0, 20.0])).all(axis=-1)
        column, row = np.floor(x).astype(int).transpose(2, 0, 1)
        np.testing.assert_array_equal(image, np.where(inside, row * 30 + column, np.nan))


def test_a_large_body_is_drawn_as_an_image(monkeypatch, stretched):
    drawn = []
    for pixels in (150, 10):
        monkeypatch.setitem(figures.STYLE, "figure.dpi", pixels)
        axis = stretched.figure().axes[0]
        drawn.append((len(axis.images), len(axis.collections)))
        low, high = axis.get_xlim()
        assert high - low > 3.5
    assert drawn == [(0, 3), (1, 2)]


def test_units_are_printed_as_in_print():
    """In the plane per unit of thickness: forces in MPa and mm, which are in N/mm, were labeled
    MPa·mm².
    """
    solid = pds.load_scene("bonded-block").units
    assert (CM.label("force", "force"), CM.label("energy", "energy")) == (
        "force (kPa·cm)",
        "energy (kPa·cm²)",
    )
    assert (solid.label("force", "force"), solid.energy) == ("force (kPa·cm²)", "kPa cm^3")
    assert (CM.area, solid.area) == ("cm", "cm^2")
    assert type(CM)().label("u₂", "length") == "u₂"


@pytest.mark.parametrize(
    ("values", "limits", "colors"),
    [
        ([0.0, 1.0, 3.0], (0.0, 3.0), "viridis"),
        ([-3.0, -1.0], (-3.0, -1.0), "viridis"),
        ([-1.0, 3.0], (-3.0, 3.0), "RdBu_r"),
        # A little below zero, as overshoot of a field that is positive.
        ([-0.01, 1.0], (-0.01, 1.0), "viridis"),
    ],
)
def test_signed_fields_have_a_diverging_map_about_zero(values, limits, colors):
    found = figures.limits_of(np.array(values))
    assert found == limits
    assert figures.colors_of(found)["cmap"] == colors


def test_panels_have_one_scale_axes_and_outlines(stretched):
    figure = stretched.figure()
    *panels, bar = figure.axes
    assert [panel.get_title() for panel in panels] == ["stretch 1.2", "stretch 1.5"]
    assert "u₂ (cm)" in (bar.get_xlabel(), bar.get_ylabel())
    greatest = max(np.abs(stretched.field("displacement_2", level)).max() for level in (0, 1))
    for level, panel in enumerate(panels):
        cells, outline, rest = panel.collections
        assert cells.get_clim() == pytest.approx((-greatest, greatest))
        assert cells.get_cmap().name == "RdBu_r"
        np.testing.assert_array_equal(cells.get_array(), stretched.field("displacement_2", level))
        assert isinstance(outline, LineCollection)
        assert isinstance(rest, LineCollection)
        segments = np.array(rest.get_segments())
        assert np.ptp(segments, axis=(0, 1)) == pytest.approx([3.0, 1.0])
        assert np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum() == pytest.approx(8.0)
        assert np.ptp(np.array(outline.get_segments())[..., 0]) == pytest.approx(
            3.0 * stretched.levels[level]["stretch"], rel=1e-3
        )
        assert panel.get_xlim()[1] > 4.5  # one scale of length
    assert panels[-1].get_xlabel() == "x₁ (cm)"
    assert panels[0].get_ylabel() == "x₂ (cm)"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["undeformed"]


def test_solids_are_seen_from_outside_with_axes_and_one_scale(block):
    *panels, bar = block.figure().axes
    assert "|u| (cm)" in (bar.get_xlabel(), bar.get_ylabel())
    cells, _ = block.cells()
    for panel in panels:
        assert (panel.get_xlabel(), panel.get_zlabel()) == ("x₁ (cm)", "x₃ (cm)")
        (sides,) = panel.collections
        assert len(sides.get_facecolor()) == len(cells.outer_sides[0]) == 6 * 16
    colors = [{tuple(color) for color in panel.collections[0].get_facecolor()} for panel in panels]
    # The greatest displacement of both states is in the second.
    greatest = matplotlib.colormaps["viridis"](1.0)
    assert [greatest in found for found in colors] == [False, True]


def test_residuals_have_one_color(stretched):
    """The shear stress of a tension is a residual of some 1e-6 of the stress: its scale is that
    of the stress.
    """
    shear = stretched.plot("stress_12").axes[0].collections[0]
    low, high = shear.get_clim()
    assert high - low >= 1e-4 * np.abs(stretched.field("stress")).max()
    assert not figures.STYLE["axes.formatter.useoffset"]  # numbers have no offset beside the bar


def test_loading_curves_show_forces_where_motion_is_prescribed(block):
    (axis,) = block.loading_figure().axes
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("loading parameter t", "force (kPa·cm²)")
    held = [f"force_right_{component}" for component in (1, 2, 3)]
    greatest = max(abs(row[name]) for row in block.history for name in row if "force_" in name)
    drawn = {line.get_label(): line.get_ydata() for line in axis.lines}
    for name in held:
        values = [row[name] for row in block.history]
        if max(map(abs, values)) > 1e-3 * greatest:
            np.testing.assert_array_equal(
                drawn[name.removeprefix("force_").replace("_", " ")], [0, *values]
            )
    assert axis.lines[0].get_marker() != "None"


def test_loading_curves_show_displacements_where_loads_alone_drive():
    result = pds.simulate(pds.load_scene("ring-pressure", spacing=0.2, steps=[0.1]), "bond-energy")
    (axis,) = result.loading_figure().axes
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("loading parameter t", "displacement (cm)")
    drawn = {line.get_label(): line.get_ydata() for line in axis.lines}
    np.testing.assert_array_equal(
        drawn["inner displacement 1"], [0.0, result.history[-1]["inner_displacement_1"]]
    )


@pytest.mark.parametrize(
    ("name", "spacing", "force"),
    [
        ("hole", 0.1, "neo-hookean"),
        ("disc-torsion", 0.125, "neo-hookean"),
        ("inflation", 0.2, "nosb"),
        ("uniaxial", 0.25, "nosb"),
    ],
)
def test_an_integral_over_the_file_is_the_energy_of_the_history(name, spacing, force, tmp_path):
    """As ParaView's Integrate Variables; energies are written in single precision."""
    changes = {"steps": [0.25]} if name == "inflation" else {}
    result = pds.simulate(
        pds.load_scene(name, {"spacing": spacing, **changes}), force, folder=tmp_path
    )
    for number, row in enumerate(result.history):
        integral = pyvista.read(tmp_path / f"{name}-{number:03d}.vtu").integrate_data()
        assert integral["energy_density"][0] == pytest.approx(row["strain_energy"], rel=1e-6)
        assert integral[{2: "Area", 3: "Volume"}[result.scene.dimension]][0] == pytest.approx(
            result.body.volumes.sum(), rel=1e-9
        )
    grid = pyvista.read(tmp_path / f"{name}-000.vtu")
    np.testing.assert_array_equal(grid.cell_data["volume"], result.body.volumes)
