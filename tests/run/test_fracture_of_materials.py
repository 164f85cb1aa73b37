"""Scenes of several materials that tear: limits of each material and interface, equal materials,
energy, resuming.
"""

import numpy as np
import pytest
from described import SCENES
from refusals import raising
from runs import started
from stopping import Killed, while_bonds_break

import pdsurrogate as pds
from pdsurrogate.engine.threads import most_threads
from pdsurrogate.problem.fracture import critical_stretch_of
from pdsurrogate.run import checkpoints
from pdsurrogate.scenes.tip_diameter import tip_diameters

LAYERS = SCENES["layers"]
"""Strip of two layers with a precut along their interface."""


def scene(stiffer=None, upper=None, interface=None, **changes):
    """The strip, with another shear modulus and fracture of the upper layer, and an entry for
    the interface.
    """
    data = {**LAYERS, **changes}
    part = {**LAYERS["materials"][0], **({"fracture": upper} if upper else {})}
    if stiffer:
        part["material"] = {
            "law": "neo-hookean",
            "shear_modulus": stiffer,
            "bulk_modulus": 20.0 * stiffer,
        }
    data["materials"] = [part]
    if interface:
        data["fracture"] = {
            **data["fracture"],
            "interfaces": [{"between": ["rest", "upper"], **interface}],
        }
    return pds.Scene.model_validate(data)


def told(result):
    crack = result.summary["crack"]
    return crack["broken_bonds"], crack["peak"], [output["tip"] for output in crack["tips"]]


def test_equal_materials_break_as_one():
    """Two entries for one rubber, and an interface as strong as it: the figures of one material,
    to the last bit.
    """
    faster = {"dynamics": {**LAYERS["dynamics"], "stretch_rate": 0.1}}
    data = {key: value for key, value in LAYERS.items() if key != "materials"} | faster
    expected = told(pds.simulate(pds.Scene.model_validate(data), "bond-energy"))
    assert expected[0] > 0
    same = {"critical_stretch": 2.0}
    assert (
        told(pds.simulate(scene(upper=same, interface=same, **faster), "bond-energy")) == expected
    )


def limits(layers, force="bond-energy"):
    """Critical stretches of the run's bonds, and the materials of their ends."""
    run = started(layers, force)
    bonds, points = run.body.bonds, run.body.all_points
    upper = points[:, 1] > 0.5
    return (
        run.problem.critical_stretches.of_pairs(),
        upper[bonds.first].astype(int) + upper[bonds.second],
    )


@pytest.mark.parametrize("stiffer", [None, 3.0])
def test_bonds_have_the_limits_of_their_materials(stiffer):
    upper, interface = {"critical_stretch": 3.0}, {"critical_stretch": 1.5}
    found, ends = limits(scene(stiffer, upper, interface))
    np.testing.assert_array_equal(found, np.array([2.0, 1.5, 3.0])[ends])
    found, ends = limits(scene(stiffer, upper))
    np.testing.assert_array_equal(found, np.array([2.0, 2.0, 3.0])[ends])  # the smaller of both


def test_energies_become_critical_stretches_by_the_law_of_each_material():
    found, ends = limits(scene(3.0, {"energy": 0.9}, fracture={"energy": 0.3}))
    tip, laws = (
        tip_diameters("stress", 2.2, "bond energy"),
        [pds.materials.NeoHookean(mu, 20 * mu) for mu in (1.0, 3.0)],
    )
    given = zip(laws, (0.3, 0.9), found[[np.argmax(ends == 0), np.argmax(ends == 2)]], strict=True)
    expected = [
        critical_stretch_of(law, energy, 0.22, tip.at(stretch)) for law, energy, stretch in given
    ]
    np.testing.assert_allclose(
        found, np.array([expected[0], min(expected), expected[1]])[ends], rtol=1e-12
    )
    found, ends = limits(scene(interface={"energy": 0.15}, fracture={"energy": 0.3}))
    crossing = found[ends == 1]
    np.testing.assert_allclose(
        crossing, critical_stretch_of(laws[0], 0.15, 0.22, tip.at(crossing[0])), rtol=1e-12
    )


def test_a_summary_has_all_limits():
    layers = scene(
        3.0,
        {"critical_stretch": 3.0},
        {"critical_stretch": 1.5},
        dynamics={**LAYERS["dynamics"], "stretch": 1.21, "outputs": 1},
    )
    summary = pds.simulate(layers, "bond-energy").summary
    assert summary["critical_stretch"] == 2.0
    assert summary["materials"][0]["critical_stretch"] == 3.0
    assert summary["interfaces"] == [{"between": ["rest", "upper"], "critical_stretch": 1.5}]


def test_a_crack_runs_along_a_weak_interface():
    """The precut ends at the interface of equal rubbers: of the rows beside it, both lose the
    same bonds, and the next but one none.
    """
    layers = scene(
        upper={"critical_stretch": 3.0},
        interface={"critical_stretch": 1.7},
        fracture={"critical_stretch": 3.0},
    )
    result = pds.simulate(layers, "bond-energy")
    damage, (x1, x2) = result.field("damage"), result.body.points.T
    rows = [
        damage[(np.abs(x2 - height) < 1e-6) & (x1 > 1.0)]
        for height in (0.35, 0.45, 0.55, 0.65, 0.25, 0.75)
    ]
    assert rows[1].max() > 0.3
    for one, other in ((0, 3), (1, 2)):
        np.testing.assert_allclose(rows[one], rows[other], atol=1e-12)
    assert rows[4].max() == rows[5].max() == 0


QUICK = {
    "stretches": [1.02],
    "dynamics": {**LAYERS["dynamics"], "stretch": 1.4, "stretch_rate": 0.1},
}
"""Tears of unequal layers in a few thousand steps."""


@pytest.mark.parametrize(("plane", "stiffer"), [("stress", 10.0), ("strain", 3.0)])
def test_the_energy_of_torn_layers_is_accounted_for(plane, stiffer):
    """A crack along the interface of unequal layers releases what the body loses: the account
    closes within 0.5 %.
    """
    # In plane strain the free ends bulge over the grips at greater stretches.
    quick = QUICK | {
        "dynamics": QUICK["dynamics"] | {"stretch": 1.4 if plane == "stress" else 1.25}
    }
    layers = scene(
        stiffer, {"critical_stretch": 3.0}, {"critical_stretch": 1.4}, plane=plane, **quick
    )
    summary = pds.simulate(layers, "bond-energy").summary
    assert summary["crack"]["broken_bonds"] > 10
    (account,) = summary["dynamics"]
    assert abs(account["greatest_energy_gap"]) < 0.5


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            {
                "fracture": None,
                "materials": [{**LAYERS["materials"][0], "fracture": {"energy": 1.0}}],
            },
            r"materials\.0\.fracture: needs fracture",
        ),
        (
            {
                "fracture": {
                    "critical_stretch": 2.0,
                    "interfaces": [{"between": ["uper", "rest"], "energy": 1.0}],
                }
            },
            r"fracture\.interfaces\.0\.between: there is no single material 'uper'; .*upper",
        ),
        (
            {
                "fracture": {
                    "critical_stretch": 2.0,
                    "interfaces": [{"between": ["upper", "upper"], "energy": 1.0}],
                }
            },
            "an interface lies between two materials, not within 'upper'",
        ),
        (
            {
                "fracture": {
                    "critical_stretch": 2.0,
                    "interfaces": [
                        {"between": pair, "energy": 1.0}
                        for pair in (["upper", "rest"], ["rest", "upper"])
                    ],
                }
            },
            (
                r"fracture\.interfaces\.1\.between: the interface between rest and upper has two"
                r" entries"
            ),
        ),
        (
            {
                "horizon_ratio": 6.0,
                "fracture": {
                    "critical_stretch": 2.0,
                    "interfaces": [{"between": ["upper", "rest"], "energy": 1.0}],
                },
            },
            "fracture.energy is available only in cases",
        ),
        (
            {"materials": [{"region": "upper", "material": "rigid", "fracture": {"energy": 1.0}}]},
            "fracture does not apply to a rigid region",
        ),
    ],
)
def test_limits_that_make_no_sense_are_refused(data, message):
    with raising(message):
        pds.Scene.model_validate(
            {
                **{key: value for key, value in LAYERS.items() if key not in data},
                **{k: v for k, v in data.items() if v},
            }
        )


@pytest.mark.parametrize(
    ("between", "precut"),
    [
        (("upper", "lower"), LAYERS["precuts"]),
        (("upper", "rest"), [{"start": [-1.0, 0.5], "end": [5.0, 0.5]}]),
    ],
    ids=["apart", "cut"],
)
def test_an_interface_that_no_bond_crosses_is_refused(between, precut):
    regions = LAYERS["regions"] | {"lower": {"box": [[-1, -1], [5, 0.2]]}}
    materials = [*LAYERS["materials"], {**LAYERS["materials"][0], "region": "lower"}]
    fracture = {
        "critical_stretch": 2.0,
        "interfaces": [{"between": between, "critical_stretch": 1.5}],
    }
    layers = LAYERS | {
        "regions": regions,
        "materials": materials,
        "fracture": fracture,
        "precuts": precut,
    }
    with raising(
        r"fracture\.interfaces\.0\.between: no bond crosses from .*leave the entry out",
        pds.SceneError,
    ):
        pds.simulate(pds.Scene.model_validate(layers), "bond-energy")


def test_an_energy_between_different_laws_is_refused():
    with raising(
        r"fracture\.interfaces\.0\.energy: no crack between two different laws was measured",
        pds.SceneError,
    ):
        pds.simulate(scene(3.0, interface={"energy": 0.1}), "bond-energy")


def test_two_threads_leave_the_same_bits():
    pulled = QUICK | {"dynamics": QUICK["dynamics"] | {"stretch": 1.2}}
    layers = scene(3.0, {"critical_stretch": 3.0}, {"critical_stretch": 1.25}, **pulled)
    one, two = (
        pds.simulate(layers, "bond-energy", threads=threads)
        for threads in (1, min(2, most_threads()))
    )
    assert told(one)[0] > 10
    assert one.history == two.history
    np.testing.assert_array_equal(one.displacement(), two.displacement())


def test_resuming_leaves_the_same_bits(tmp_path, monkeypatch):
    layers = scene(3.0, {"critical_stretch": 3.0}, {"critical_stretch": 1.4}, **QUICK)
    whole = pds.simulate(layers, "bond-energy")
    monkeypatch.setattr(checkpoints, "SECONDS_BETWEEN_CHECKPOINTS", 0.0)
    monkeypatch.setattr(checkpoints, "PAUSE_SHARE", 0.0)
    with pytest.raises(Killed), while_bonds_break(5):
        pds.simulate(layers, "bond-energy", folder=tmp_path)
    resumed = pds.simulate(layers, "bond-energy", folder=tmp_path, resume=True)
    assert resumed.history == whole.history
    assert resumed.summary["crack"] == whole.summary["crack"]
    np.testing.assert_array_equal(resumed.displacement(), whole.displacement())


RELAXED = SCENES["relaxed layers"]
"""Two materials side by side, each with a precut from its edge, of relaxed points."""

SOLID = SCENES["layers in space"]
"""The same in space."""


@pytest.mark.parametrize("layers", [RELAXED, SOLID], ids=["relaxed", "solid"])
def test_relaxed_points_and_solids_of_two_materials_tear(layers):
    """Each material loses bonds by its own limit, and the account closes; two equal materials
    leave the bits of one.
    """
    torn = pds.simulate(scene(2.0, {"critical_stretch": 1.45}, **layers), "bond-energy")
    (account,), x1 = torn.summary["dynamics"], torn.body.points[:, 0]
    assert abs(account["greatest_energy_gap"]) < 0.5
    lost = torn.field("damage") - torn.field("damage", 0)
    assert lost[x1 < 0.9].max() > 0.1
    assert lost[x1 > 1.1].max() > 0.1
    alone = pds.Scene.model_validate(
        {
            key: value
            for key, value in (LAYERS | layers).items()
            if key not in ("materials", "regions")
        }
    )
    one, two = (
        pds.simulate(each, "bond-energy")
        for each in (alone, scene(upper=layers["fracture"], **layers))
    )
    assert told(one)[0] > 0
    assert told(one) == told(two)
    np.testing.assert_array_equal(one.displacement(), two.displacement())


@pytest.mark.slow
def test_the_energy_of_a_disc_that_comes_loose_from_relaxed_points_is_accounted_for():
    """Within 0.1 %, as on the lattice: the time step was that of bonds long broken, and 1.1 %
    were made.
    """
    disc = {"disc": {"center": [0.6, 0.5], "radius": 0.3}}
    loose = pds.Scene.model_validate(
        {
            **LAYERS,
            "name": "disc",
            "spacing": 1 / 12,
            "horizon_ratio": 3.15,
            "stretches": [1.1],
            "body": {"shape": "rectangle", "size": [1.2, 1.0], "arrangement": "relaxed", "seed": 1},
            "precuts": [],
            "regions": {"disc": disc},
            "materials": [
                {
                    "region": "disc",
                    "material": {"law": "neo-hookean", "shear_modulus": 3.0, "bulk_modulus": 60.0},
                }
            ],
            "fracture": {
                "critical_stretch": 3.0,
                "interfaces": [{"between": ["rest", "disc"], "critical_stretch": 1.25}],
            },
            "dynamics": {"stretch": 1.8, "stretch_rate": 0.1, "density": 1.0, "outputs": 6},
        }
    )
    result = pds.simulate(loose, "bond-energy")
    assert result.summary["crack"]["broken_bonds"] > 200
    assert all(abs(stage["greatest_energy_gap"]) < 0.1 for stage in result.summary["dynamics"])
