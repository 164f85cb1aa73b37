"""What pictures show: scales, color maps, axes, outlines and labels, and loading curves of what
was loaded.
"""

import numpy as np
import pytest
import pyvista
from matplotlib.collections import LineCollection

import pdsurrogate as pds
from pdsurrogate.results import figures
from pdsurrogate.results.loading_curve import loading_curve
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


def test_solids_have_a_triad_and_a_section_with_axes(block):
    figure = block.figure()
    outside, section, *_ = figure.axes
    assert {text.get_text() for text in outside.texts} == {"x₁", "x₂", "x₃"}
    assert (section.get_xlabel(), section.get_ylabel()) == ("x₁ (cm)", "x₂ (cm)")
    scales = {
        drawn.get_clim()
        for axis in figure.axes[1:4:2]
        for drawn in axis.collections
        if drawn.get_array() is not None
    }
    assert len(scales) == 1
    # The edges of the cube at rest: twelve, of four cells each.
    at_rest = figures.creases(block.cells()[0])
    assert len(at_rest) == 12 * 4


def test_residuals_have_one_color(stretched):
    """The shear stress of a tension is a residual of some 1e-6 of the stress: its scale is that
    of the stress.
    """
    shear = stretched.plot("stress_12").axes[0].collections[0]
    low, high = shear.get_clim()
    assert high - low >= 1e-4 * np.abs(stretched.field("stress")).max()


def rows_of(**columns):
    return [
        dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)
    ]


def test_a_turned_plate_has_torque_over_angle(block):
    x, curves, xlabel, ylabel = loading_curve(block.scene, block.history)
    assert (xlabel, ylabel) == ("angle (°)", "torque on right (kPa·cm³)")
    assert x == [0.0, 30.0, 60.0]
    # Its work is the energy, but for the trapezoidal rule over two steps.
    work = np.trapezoid(curves["right"], np.radians(x))
    assert work == pytest.approx(block.history[-1]["strain_energy"], rel=0.02)
    axis = block.loading_figure().axes[0]
    assert (axis.get_xlabel(), axis.get_ylabel()) == (xlabel, ylabel)
    assert axis.lines[0].get_marker() != "None"


def test_a_pressed_ring_has_radii_over_pressure():
    scene = pds.load_scene("ring-pressure")
    moved = {
        f"{probe.name}_displacement_{k + 1}": [0.1 * place]
        for probe in scene.probes
        for k, place in enumerate(probe.at)
    }
    forces = {"force_holes_1": [1e-7], "force_east_2": [-1e-6]}
    x, curves, xlabel, ylabel = loading_curve(scene, rows_of(t=[0.3], **forces, **moved))
    assert (x, xlabel, ylabel) == ([0.0, 0.3], "pressure (kPa)", "radius (cm)")
    assert set(curves) == {"inner", "outer", "inner-diagonal", "outer-diagonal"}
    np.testing.assert_allclose(curves["inner"], [1.0, 1.1])
    np.testing.assert_allclose(curves["outer-diagonal"], [2.0, 2.2], rtol=1e-7)


def test_what_an_obstacle_presses_has_its_force_over_its_motion():
    """It was drawn over t, with the force of the support."""
    punch = {
        "half_plane": {"point": (0.0, 1.0), "normal": (0.0, 1.0)},
        "x2": -0.05,
        "name": "punch",
    }
    fixed = {"region": "bottom", "x1": 0.0, "x2": 0.0}
    fields = {
        "spacing": 0.25,
        "body": {"size": (1.0, 1.0)},
        "material": "neo-hookean",
        "units": {"length": "mm", "stress": "MPa"},
    }
    scene = pds.Scene(name="pressed", prescribed=[fixed], obstacles=[punch], steps=[1.0], **fields)
    columns = {
        "force_bottom_2": [0.1, 0.3],
        "force_punch_1": [1e-9, 1e-9],
        "force_punch_2": [-0.1, -0.3],
    }
    x, curves, xlabel, ylabel = loading_curve(scene, rows_of(t=[0.5, 1.0], **columns))
    assert (x, xlabel, ylabel) == (
        [0.0, -0.025, -0.05],
        "prescribed displacement (mm)",
        "force on punch, x₂ (MPa·mm)",
    )
    np.testing.assert_allclose(curves["punch, x₂"], [0.0, -0.1, -0.3])
    assert set(pds.simulate(scene, "bond-energy").history[0]) >= {"force_punch_1", "force_punch_2"}


@pytest.mark.parametrize(
    ("name", "spacing", "force"),
    [
        ("hole", 0.1, "neo-hookean"),
        ("disc-torsion", 0.125, "neo-hookean"),
        ("inflation", 0.125, "nosb"),
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
