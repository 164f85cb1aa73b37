"""Fracture energies: the table of crack-tip diameters, the cases that it does not have, and G at
the peak of the load of torn strips.
"""

import json
import warnings

import numpy as np
import pytest
import tip_diameters as pipeline
from described import SCENES
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.materials import homogeneous
from pdsurrogate.problem import compile_scene
from pdsurrogate.problem.fracture import CriticalStretches
from pdsurrogate.scenes.tip_diameter import (
    grown_with_bulk,
    measured_diameters,
    tip_diameters,
    tip_diameters_in,
)

STRIP = SCENES["strip with a fracture energy"]
"""Strip in pure shear, of 16 rows, whose G is that of an infinite strip within a percent."""


def test_the_table_is_that_of_the_stored_tears():
    assert json.loads(json.dumps(pipeline.table())) == measured_diameters()


def test_diameters_are_those_of_tears_within_seven_percent():
    """Along a row each spacing: by so much G at the peak misses the prescribed one."""
    for entry in measured_diameters():
        np.testing.assert_allclose(
            [*entry.get("rows", {}).values()], entry["diameter"], rtol=0.07, err_msg=f"{entry}"
        )


def test_a_fracture_energy_is_refused_with_weights_that_were_not_measured():
    pds.Scene.model_validate({**STRIP, "weight": "inverse"})
    pds.Scene.model_validate({**STRIP, "weight": "constant", "fracture": {"critical_stretch": 2.0}})
    with raising(
        r"\(weight=inverse\), not for weight=constant; set fracture.critical_stretch instead"
    ):
        pds.Scene.model_validate({**STRIP, "weight": "constant"})


def test_diameters_are_interpolated_in_the_horizon_and_the_critical_stretch():
    known = {}
    for entry in measured_diameters():
        if (
            entry["family"] == "bond energy"
            and entry["plane"] == "stress"
            and entry["arrangement"] == "lattice"
            and entry["bulk_ratio"] == 20.0
        ):
            known.setdefault(entry["horizon_ratio"], {})[entry["critical_stretch"]] = entry[
                "diameter"
            ]
    low, high = sorted(known)[:2]
    first, second = sorted(known[low].keys() & known[high].keys())[:2]
    for share in (0.0, 0.25, 1.0):
        ratio = (1 - share) * low + share * high
        tip = tip_diameters("stress", ratio, "bond energy")
        parts = (1 - share) * low / ratio, share * high / ratio
        expected = [
            parts[0] * known[low][stretch] + parts[1] * known[high][stretch]
            for stretch in (first, second)
        ]
        assert tip.at(first) == pytest.approx(expected[0], rel=1e-12)
        assert tip.at(0.3 * first + 0.7 * second) == pytest.approx(
            0.3 * expected[0] + 0.7 * expected[1], rel=1e-12
        )


@pytest.mark.parametrize("plane", ["stress", "strain", "space"])
@pytest.mark.parametrize("bulk_ratio", [20.0, 400.0, 1e4])
def test_diameters_are_continuous_in_the_horizon(plane, bulk_ratio):
    """Also at stretches that one neighboring horizon lacks; only the measured range is narrower."""
    ratios = {
        entry["horizon_ratio"]
        for entry in measured_diameters()
        if (entry["family"], entry["plane"], entry["arrangement"])
        == ("bond energy", plane, "lattice")
    }
    ends, step = (min(ratios), max(ratios)), 1e-7
    for ratio in sorted(ratios):
        for stretch in (1.05, 1.3, 1.7, 2.6, 5.0, 16.0):
            at = [
                tip_diameters(plane, one, "bond energy", bulk_ratio=bulk_ratio).at(stretch)
                for one in np.clip((ratio - step, ratio, ratio + step), *ends)
            ]
            np.testing.assert_allclose(at, at[1], rtol=1e-5)
    for near in np.nextafter(3.15, (3.0, 4.0)):
        own = [tip_diameters("stress", one, "bond energy") for one in (3.15, float(near))]
        assert own[0].measured == own[1].measured


def test_tips_of_nearly_incompressible_material_in_plane_strain_are_larger():
    """Between measured ratios of the moduli diameters are linear in the logarithm, beyond them
    constant.
    """
    known = {
        entry["bulk_ratio"]: entry["diameter"]
        for entry in measured_diameters()
        if (entry["plane"], entry["arrangement"], entry["horizon_ratio"])
        == ("strain", "lattice", 2.2)
        and entry["critical_stretch"] == 1.6
    }
    assert sorted(known) == [20.0, 160.0, 1000.0]
    at = [
        tip_diameters("strain", 2.2, bulk_ratio=ratio).at(1.6)
        for ratio in (1.0, 20.0, np.sqrt(20.0 * 160.0), 160.0, 1000.0, 1e4)
    ]
    expected = [known[20.0], known[20.0], (known[20.0] + known[160.0]) / 2, known[160.0]]
    np.testing.assert_allclose(at, [*expected, known[1000.0], known[1000.0]], rtol=1e-12)
    scene = pds.Scene.model_validate(
        STRIP | {"plane": "strain", "material": STRIP["material"] | {"bulk_modulus": 160.0}}
    )
    (found,) = critical_stretches(scene, "bond energy").of_materials
    density = homogeneous.uniaxial(scene.material.build(), found).energy_density
    own = tip_diameters("strain", 2.2, "bond energy", bulk_ratio=160.0)
    assert density * own.at(found) * 0.1375 == pytest.approx(0.35, rel=1e-9)


@pytest.mark.parametrize(
    ("plane", "ratio", "bulk_ratio", "points", "known"),
    [
        ("strain", 2.2, 20.0, {}, None),
        ("strain", 2.2, 1000.0, {}, None),
        ("strain", 2.2, 1200.0, {}, "20 to 1000"),
        ("strain", 2.2, 5.0, {}, "20 to 1000"),
        ("strain", 4.6, 1000.0, {}, "20"),
        ("strain", 2.2, 100.0, {"arrangement": "relaxed", "seed": 1}, "20"),
        ("stress", 2.2, 1000.0, {}, None),
        ("stress", 2.2, 5.0, {"arrangement": "relaxed", "seed": 1}, None),
    ],
)
def test_a_bulk_modulus_with_which_no_tip_was_measured_is_remarked(
    plane, ratio, bulk_ratio, points, known
):
    """Tips of nearly incompressible material are larger, except in plane stress."""
    law = {"law": "neo-hookean", "shear_modulus": 0.3, "bulk_modulus": 0.3 * bulk_ratio}
    body, energy = STRIP["body"] | points, {"energy": 0.1}
    changes = {"plane": plane, "horizon_ratio": ratio, "body": body, "material": law}
    scene = pds.Scene.model_validate(STRIP | changes | {"fracture": energy})
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        remarks = critical_stretches(scene, "bond energy").summary["fracture_remarks"]
    assert [str(one.message) for one in said] == [f"scene strip: {one}" for one in remarks]
    about = [one for one in remarks if "bulk modulus" in one]
    assert len(about) == (known is not None)
    if known:
        low, high, least, most = grown_with_bulk()
        assert 1.0 < least < most
        assert f"is {bulk_ratio:g} times the shear modulus, but crack" in about[0]
        assert f"measured with {known} times it" in about[0]
        assert (
            f"{least:.1f} to {most:.1f} times as large with {high:g} as with {low:g} " in about[0]
        )


def critical_stretches(scene, force):
    body = pds.Body.rectangle(4.0, 1.0, 0.0625, 0.1375)
    return CriticalStretches(scene, scene.fracture, body, force, np.zeros(len(body), dtype=int))


@pytest.mark.parametrize("force", ["bond energy", "bond force"])
@pytest.mark.parametrize("energy", [0.1, 0.2, 0.35])
def test_a_scene_has_the_critical_stretch_of_its_diameter(force, energy):
    scene = pds.Scene.model_validate(STRIP | {"fracture": {"energy": energy}})
    law, tip = scene.material.build(), tip_diameters("stress", 2.2, force)
    critical = critical_stretches(scene, force)
    (found,) = critical.of_materials
    assert homogeneous.uniaxial(law, found).energy_density * tip.at(
        found
    ) * 0.1375 == pytest.approx(energy, rel=1e-9)
    assert tip.measured[0] < found < tip.measured[1]
    assert critical.summary["fracture_remarks"] == []


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("tear", {"plane": "strain", "horizon_ratio": 2.2, "fracture": {"energy": 274.0}}),
        ("tear", {"plane": "strain", "horizon_ratio": 3.15, "fracture": {"energy": 274.0}}),
        ("tear", {"horizon_ratio": 5.0, "fracture": {"energy": 274.0}}),
        ("trousers", {}),
    ],
)
def test_a_cloud_has_the_diameter_of_clouds(name, changes):
    """Clouds need more energy than a row of the lattice at the same critical stretch, along
    which bonds break together.
    """
    lattice, cloud = (
        pds.load_scene(name, changes | points)
        for points in ({}, {"body.arrangement": "relaxed", "body.seed": 1})
    )
    straight, relaxed = (tip_diameters_in(scene, "bond energy") for scene in (lattice, cloud))
    shared = [
        stretch
        for stretch in relaxed.stretches
        if straight.stretches[0] <= stretch <= straight.stretches[-1]
    ]
    assert len(shared) >= 2
    for stretch in shared:
        assert 1.0 < relaxed.at(stretch) / straight.at(stretch) < 1.6


@pytest.mark.parametrize("energy", [0.002, 40.0])
def test_a_critical_stretch_at_which_no_tip_was_measured_is_remarked(energy):
    scene, tip = (
        pds.Scene.model_validate(STRIP | {"fracture": {"energy": energy}}),
        tip_diameters("stress", 2.2, "bond energy"),
    )
    measured = (
        rf"measured for critical stretches from {tip.measured[0]:g} to {tip.measured[1]:g}: the"
        r" diameter is taken as constant beyond the last measured one "
    )
    with pytest.warns(
        UserWarning,
        match=(
            rf"scene strip: fracture\.energy gives a critical stretch of .* {measured}.*; .*set"
            r" critical_stretch"
        ),
    ):
        critical = critical_stretches(scene, "bond energy")
    (remark,) = critical.summary["fracture_remarks"]
    assert remark.startswith(
        f"fracture.energy gives a critical stretch of {critical.of_materials[0]:.3g}, "
    )
    end = 0 if energy < 1 else -1
    density = homogeneous.uniaxial(scene.material.build(), critical.of_materials[0]).energy_density
    assert density * tip.diameters[end] * 0.1375 == pytest.approx(energy, rel=1e-9)


@pytest.mark.parametrize(
    ("scene", "changes", "force", "here"),
    [
        ("tear", {}, "nosb", "nosb, plane=stress, horizon_ratio 3.15"),
        ("tear", {"horizon_ratio": 6.0}, "analytic", "plane=stress, horizon_ratio 6"),
        ("tear", {"horizon_ratio": 2.0}, "bond-energy", "plane=stress, horizon_ratio 2"),
        (
            "tear",
            {"plane": "strain", "horizon_ratio": 6.0},
            "bond-energy",
            "plane=strain, horizon_ratio 6",
        ),
        ("trousers", {"horizon_ratio": 3.2}, "bond-energy", "plane=space, horizon_ratio 3.2"),
        ("trousers", {}, "nosb", "nosb, plane=space, horizon_ratio 2.2"),
    ],
)
def test_a_fracture_energy_is_refused_where_the_tip_was_not_measured(scene, changes, force, here):
    known = r"\(bond energy, plane=.*; bond force, plane=stress, horizon_ratio 2.2 to 5.*\)"
    with raising(
        rf"fracture\.energy .*{known}, not for {here}; set fracture\.critical_stretch",
        pds.SceneError,
    ):
        pds.simulate(pds.load_scene(scene, {"fracture": {"energy": 274.0}} | changes), force)


@pytest.mark.parametrize("points", [{}, {"arrangement": "relaxed", "seed": 1}])
@pytest.mark.parametrize(
    ("height", "fin", "layers"),
    [
        (0.4, True, 3),
        (0.7, True, 2),
        (0.3, False, 3),
        (0.2, False, 2),
        (0.4, False, None),
        (0.7, False, None),
    ],
)
def test_a_fracture_energy_is_refused_in_walls_whose_bonds_reach_one_layer(
    points, height, fin, layers
):
    """A plate of three layers was refused, with a fin (here two points thick) a warning: points
    of the middle one can hold a crack.
    """
    holes = (
        [{"shape": "box", "lower": [-0.1, -0.1, 0.3], "size": [1.9, 1.2, height]}] if fin else []
    )
    body = {"shape": "box", "size": [2.0, 1.0, height], **points}
    changes = {
        "body": body,
        "holes": holes,
        "plane": "space",
        "horizon_ratio": 1.75,
        "spacing": 0.1,
        "precuts": [],
    }
    model = pds.load_surrogate("bond-energy")
    if layers is not None:
        mended = f"horizon_ratio to 2.2 or 3, or spacing to {layers / 40:.3g} or less"
        with raising(
            rf"fracture\.energy needs walls .* thinner ones, down to {layers}: .*; set {mended}",
            pds.SceneError,
        ):
            compile_scene(pds.Scene.model_validate(STRIP | changes), [model])
        changes["fracture"] = {"critical_stretch": 2.0}
    assert (
        compile_scene(pds.Scene.model_validate(STRIP | changes), [model]).critical_stretches
        is not None
    )


def test_walls_beside_a_plane_of_symmetry_are_as_thick_as_with_their_image():
    body = {
        "body": {"shape": "box", "size": [1.0, 1.0, 0.2]},
        "plane": "space",
        "horizon_ratio": 1.75,
        "spacing": 0.1,
    }
    ends = [{"region": "bottom", "x1": 0.0, "x2": 0.0}, {"region": "top", "x1": 0.0, "x2": 0.2}]
    motion = {
        "prescribed": [{"region": "back", "x3": 0.0}, *ends],
        "steps": [{"to": 1.0, "dynamics": {"duration": 9.0, "density": 1.0}}],
    }
    scene = pds.Scene.model_validate(
        {key: STRIP[key] for key in ("name", "material", "fracture")} | body | motion
    )
    assert compile_scene(scene, [pds.load_surrogate("bond-energy")]).critical_stretches is not None


def test_an_arrangement_that_was_not_measured_is_refused():
    with raising(r"not for bond energy, plane=stress, arrangement=hexagonal, horizon_ratio 3\.15"):
        tip_diameters("stress", 3.15, "bond energy", "hexagonal")


@pytest.mark.slow  # 5 and 2 seconds each
@pytest.mark.parametrize(("force", "energy"), [("bond-energy", 0.35), ("neo-hookean", 0.18)])
def test_at_the_peak_of_the_load_a_strip_has_its_fracture_energy(force, energy):
    """G = W h of pure shear at the peak. The table is the mean over spacings, of which this is one:
    7 %.

    The energies are between those of the tears of the table, whose critical stretches are 2.2 and
    2.8.
    """
    result = pds.simulate(pds.Scene.model_validate(STRIP | {"fracture": {"energy": energy}}), force)
    peak = result.summary["crack"]["peak"]["stretch"]
    assert homogeneous.pure_shear(
        result.scene.material.build(), peak
    ).energy_density == pytest.approx(energy, rel=0.07)
