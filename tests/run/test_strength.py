"""Strength as a criterion of its own: conversions, means over discs, holes in hulls, uniform
states that break at the strength, and what breaks at fronts alone.
"""

import sys

import numpy as np
import pytest
import scipy
import strength
from described import SCENES
from refusals import raising
from runs import started
from stopping import Killed, while_bonds_break

import pdsurrogate as pds
from pdsurrogate.materials import homogeneous
from pdsurrogate.problem.strength import least_trace_of
from pdsurrogate.problem.tip_factor import factor_of
from pdsurrogate.run import checkpoints
from pdsurrogate.run.damage import Damage
from pdsurrogate.run.strength import StrongDamage

RUBBER = {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 20.0}
LAW = pds.materials.NeoHookean(1.0, 20.0)
WORK = homogeneous.uniaxial(LAW, 4.0).energy_density
SHEET = SCENES["sheet with a strength"]
"""Sheet between rollers, in which discs have a radius of 0.32."""


def scene(**changes):
    return pds.Scene.model_validate({**SHEET, **changes})


def zone(run):
    return run.problem.strengths.zones[0]


def placed(run, *stretches):
    """Move the body to a homogeneous state, with its rollers."""
    run.positions[:] = run.body.points * stretches
    run.loading.apply(stretches[-1], run.force, run.positions)
    run.force.place(run.positions)
    return run.force


def failing(run, stretch, sides=None):
    state = homogeneous.uniaxial(LAW, stretch)
    across = sides or state.lateral_stretch
    thick = [across] if run.body.dimension == 3 else []
    return run.damage.failing(placed(run, across, *thick, stretch))


@pytest.mark.parametrize("given", [{"uniaxial": 4.0 - 4.0**-2}, {"stretch": 4.0}])
def test_stress_and_stretch_at_break_are_those_of_a_neo_hookean_sheet(given):
    """Closed formulas of the incompressible material; K = 2,000 mu."""
    rubber = {**RUBBER, "bulk_modulus": 2e3}
    found = zone(started(scene(material=rubber, fracture={"energy": 9.0, "strength": given})))
    expected = 4.0, 4.0 - 4.0**-2, (16 + 2 / 4 - 3) / 2
    np.testing.assert_allclose((found.stretch, found.uniaxial, found.work), expected, rtol=4e-3)
    np.testing.assert_allclose(found.length, 9.0 / found.work)
    np.testing.assert_allclose(found.radius, found.factor * found.length / np.pi)


def greatest_mean(density):
    """Half of the greatest mean of `density` / r, a function of the angle, over circles of radius 1
    around points ahead of the tip, by a sum over squares.
    """
    x, y = np.meshgrid(*[(np.arange(-800, 800) + 0.5) / 500] * 2)
    field = density(np.arctan2(y, x)) / np.hypot(x, y)
    return max(field[np.hypot(x - to, y) <= 1].mean() for to in np.linspace(0, 0.6, 13)) / 2


@pytest.mark.parametrize(
    ("bulk", "plane", "kappa"), [(1e6, "stress", 5 / 3), (8 / 3, "stress", 2), (1e6, "strain", 1)]
)
def test_the_factor_of_small_strains_is_that_of_the_field_of_williams(bulk, plane, kappa):
    expected = greatest_mean(lambda a: (1 + np.cos(a)) * (kappa - np.cos(a)) / (kappa + 1))
    found = factor_of(pds.materials.NeoHookean(1.0, bulk), 1.0001, plane)
    np.testing.assert_allclose(found, expected, rtol=2e-3)


def test_the_factor_of_large_strains_is_that_of_the_field_of_rice():
    """1 in an incompressible neo-Hookean material. At K = 20 mu energies grow as the stretch to the
    power of 2 n = 3/2, around the tip as (m cos + (1 - m^2 sin^2)^(1/2)) / (n r), m = 1/n - 1.
    """
    np.testing.assert_allclose(
        factor_of(pds.materials.NeoHookean(1.0, 1e12), 1e3, "space"), 1, rtol=2e-3
    )
    expected = greatest_mean(lambda a: (np.cos(a) / 3 + np.sqrt(1 - np.sin(a) ** 2 / 9)) * 4 / 3)
    np.testing.assert_allclose(factor_of(LAW, 1e4, "stress"), expected, rtol=2e-3)


def test_factors_are_those_of_finite_elements():
    """Plane stress within 3 %, plane strain within 5 %."""
    for plane, name, bulk, *found in strength.rows_of(strength.stored("strength-factor")):
        law = strength.law_of(name, bulk)
        own = [factor_of(law, stretch, plane) for stretch in strength.BREAKS]
        np.testing.assert_allclose(own, found, rtol=0.03 if plane == "stress" else 0.05)


def test_no_state_that_is_not_pressed_has_the_work_at_a_smaller_trace():
    """tr C = 2 W / mu + 2 in simple shear of an incompressible neo-Hookean sheet, the least one."""
    stiff = pds.materials.NeoHookean(1.0, 1e4)
    np.testing.assert_allclose(least_trace_of(stiff, 6.0), 14.0, rtol=0.021)
    assert least_trace_of(stiff, 6.0) <= 14.0


def test_means_over_discs_are_those_of_the_field():
    """The mean of x1 is x1 of the center, that of the squared distance R^2/2; a disc that an edge
    cuts has the mean over its half.
    """
    run = started(scene(spacing=0.03))
    damage = run.damage
    within = zone(run)
    points = run.body.points
    centers = points[
        [np.square(points - place).sum(axis=1).argmin() for place in ([0.6, 0.7], [1.2, 0.7])]
    ]
    R = within.radius
    inner, edge = damage.means(within, centers, points[:, 0].take)
    np.testing.assert_allclose(inner, centers[0, 0], atol=1e-12)
    depth = 1.2 - centers[1, 0]
    angle = np.arccos(depth / R)
    area = R**2 * (np.pi - angle + np.sin(2 * angle) / 2)
    np.testing.assert_allclose(
        edge, centers[1, 0] - 2 / 3 * (R * np.sin(angle)) ** 3 / area, rtol=1e-3
    )
    squares = np.square(points - centers[0]).sum(axis=1)
    np.testing.assert_allclose(damage.means(within, centers[:1], squares.take), R**2 / 2, rtol=0.02)


def test_holes_count_as_empty_and_edges_do_not():
    """A round hole within a disc takes its area from the mean; a disc at an edge or a corner has
    none of its surroundings taken.
    """
    hole = {"shape": "circle", "center": [0.6, 0.7], "radius": 0.15}
    run = started(scene(holes=[hole], spacing=0.05))
    R = zone(run).radius
    share = run.damage.share_in_hull
    np.testing.assert_allclose(
        share(zone(run), 0, np.array([0.6, 0.72])), 1 - (0.15 / R) ** 2, atol=0.02
    )
    for number, place in enumerate(([0.01, 0.7], [0.01, 0.01], [0.2, 0.3]), 1):
        assert share(zone(run), number, np.array(place)) == 1


CASES = [
    ("bond-energy", 0.18, 2.2, {}),
    ("bond-energy", 0.09, 3.0, {}),
    ("bond-energy", 0.045, 2.2, {}),
    ("analytic", 0.09, 2.2, {}),
    ("neo-hookean", 0.18, 3.0, {}),
    ("bond-energy", 0.09, 2.2, {"arrangement": "relaxed", "seed": 1}),
]


@pytest.mark.parametrize(("force", "spacing", "horizon", "points"), CASES)
def test_uniform_tension_breaks_at_the_strength(force, spacing, horizon, points):
    """A sheet in uniaxial tension: no bond breaks at 0.98 of the stretch at break, and at 1.02 one
    in each of the discs that do not overlap; below it bonds bear any stretch.
    """
    body = SHEET["body"] | points
    run = started(scene(spacing=spacing, horizon_ratio=horizon, body=body), force)
    assert len(failing(run, 3.92).pairs) == 0
    found = failing(run, 4.08)
    discs = 1.2 * 1.4 / (4 * zone(run).radius ** 2)
    assert 1 <= len(found.pairs) <= 3 * discs
    assert found.by_strength.all()
    np.testing.assert_allclose(found.loads, 1.02, atol=0.01)


def test_a_block_in_space_breaks_at_the_strength():
    block = scene(
        body={"shape": "box", "size": [0.8, 0.8, 1.0]},
        grips=[
            {"edge": "back", "holds": "normal"},
            {"edge": "front", "holds": "normal", "travel": 1},
        ],
        spacing=0.2,
        horizon_ratio=2.2,
    )
    run = started(block)
    assert len(failing(run, 3.92).pairs) == 0
    assert failing(run, 4.08).by_strength.any()


def test_plane_strain_breaks_at_the_same_work():
    run = started(scene(plane="strain"))
    work = zone(run).work
    low, high = (
        scipy.optimize.brentq(
            lambda one, part=part: homogeneous.uniaxial(LAW, one, "strain").energy_density - part,
            1.5,
            9.0,
        )
        for part in (0.96 * work, 1.04 * work)
    )
    sides = [homogeneous.uniaxial(LAW, one, "strain").lateral_stretch for one in (low, high)]
    assert len(failing(run, low, sides[0]).pairs) == 0
    assert failing(run, high, sides[1]).by_strength.any()


def test_equibiaxial_tension_breaks_at_the_same_work():
    """Of one number the work is the limit in any state: 2.83 in both directions."""
    run = started(scene())
    square = (2 * WORK + 3) / 2
    stretch = np.sqrt(square)  # without the thickness, which adds 0.02
    assert len(failing(run, 0.98 * stretch, 0.98 * stretch).pairs) == 0
    assert failing(run, 1.02 * stretch, 1.02 * stretch).by_strength.all()


def test_without_strength_at_grips_no_disc_lies_within_a_radius_of_clamps():
    clamps = [{"edge": "bottom"}, {"edge": "top", "travel": 1}]
    strength = {"stretch": 4.0, "at_grips": False}
    run = started(scene(grips=clamps, fracture={"energy": WORK, "strength": strength}))
    height = run.body.points[:, 1]
    off = np.minimum(height, 1.4 - height) < zone(run).radius
    np.testing.assert_array_equal(zone(run).centers, ~off)
    assert off.any()
    assert not run.problem.strengths.summary[0]["at_grips"]


def test_a_strength_that_would_act_nowhere_is_refused():
    """Discs of a radius of 0.32 in a body of 0.5 between clamps; the radius of a material within
    it that has the same strength is of no account.
    """
    clamps = [{"edge": "bottom"}, {"edge": "top", "travel": 1}]
    fracture = {"energy": WORK, "strength": {"stretch": 4.0, "at_grips": False}}
    short = {"shape": "rectangle", "size": [1.2, 0.5]}
    with raising(r"fracture\.strength: with at_grips = false", pds.scenes.SceneError):
        started(scene(grips=clamps, fracture=fracture, body=short))
    tab = {"regions": {"tab": {"box": [[0, 0], [1.2, 0.2]]}}}
    parts = [{"region": "tab", "material": RUBBER}]
    zones = started(
        scene(grips=clamps, fracture=fracture, materials=parts, **tab)
    ).problem.strengths.zones
    assert [bool(one.centers.any()) for one in zones] == [True, False]
    parts[0]["fracture"] = fracture
    with raising(r"materials\.0\.fracture\.strength: with", pds.scenes.SceneError):
        started(scene(grips=clamps, fracture=fracture, materials=parts, **tab))


def test_the_critical_stretch_acts_at_fronts_alone():
    """Bonds beyond their critical stretch break only at points of a cut, or that have lost bonds,
    also after a checkpoint was read.
    """
    cut = [{"start": [-1, 0.7], "end": [0.4, 0.7]}]
    run = started(scene(precuts=cut, fracture={"energy": 3 * WORK, "strength": {"stretch": 4.0}}))
    body = run.body
    damage = StrongDamage(body, 1.2, run.problem.strengths)
    force = placed(run, 0.9, 1.5)

    def at(pairs):
        return np.isin(np.arange(len(body)), [body.bonds.first[pairs], body.bonds.second[pairs]])

    found = damage.failing(force)
    flanks = np.isin(np.arange(len(body)), body.bonds.cut)
    assert len(found.pairs) > 0
    assert not found.by_strength.any()
    ends = np.stack([body.bonds.first[found.pairs], body.bonds.second[found.pairs]])
    assert np.isin(ends, np.flatnonzero(flanks)).any(axis=0).all()
    far = np.flatnonzero(~at(found.pairs)[body.bonds.first] & (body.bonds.second < len(body)))[:1]
    damage.break_bonds(far)
    more = damage.failing(force).pairs
    assert set(found.pairs) < set(more)
    again = StrongDamage(body, 1.2, run.problem.strengths)
    again.broken[:] = damage.broken
    again.restore()
    np.testing.assert_array_equal(again.failing(force).pairs, more)
    assert set(Damage(body, 1.2).failing(force).pairs) > set(more)


REFUSED = [
    (
        {"stretch": 4.0},
        {"spacing": 0.25},
        r"fracture.strength: .* use a smaller spacing; 0.192 or less would do",
    ),
    ({"uniaxial": 2.0, "stretch": 4.0}, {}, "exactly one of uniaxial, stretch"),
    ({"stretch": 0.9}, {}, "greater than 1"),
    (
        {"uniaxial": 90.0},
        {"material": {"law": "gent", "bulk_modulus": 20.0, "chain_limit": 10.0}},
        "fracture.strength: gent reaches its limit",
    ),
    (
        {"stretch": 4.0},
        {"material": {**RUBBER, "softening": {"r": 2.0, "m": 1.0}}},
        "fracture.strength: the material has branches",
    ),
]


@pytest.mark.parametrize(("strength", "changes", "told"), REFUSED)
def test_a_strength_that_cannot_act_is_refused(strength, changes, told):
    with raising(told, pds.SceneError):
        started(scene(fracture={"energy": WORK, "strength": strength}, **changes))
    if "spacing" in changes:
        started(scene(spacing=0.172))


def test_a_strength_needs_an_energy():
    with raising("strength needs energy in place of critical_stretch", pds.SceneError):
        scene(fracture={"critical_stretch": 4.0, "strength": {"stretch": 4.0}})


TWO = {
    "regions": {"upper": {"box": [[-1, 0.7], [5, 2]]}},
    "materials": [{"region": "upper", "material": RUBBER, "fracture": {"energy": WORK}}],
}


def test_each_material_and_interface_has_its_own_strength():
    """A material with its own fracture and no strength does not break; an interface with a strength
    breaks bonds that cross it, at its own stretch.
    """
    run = started(scene(**TWO))
    body = run.body
    found = failing(run, 4.2)
    assert found.by_strength.all()
    assert body.all_points[body.bonds.first[found.pairs], 1].max() < 0.7
    entry = {"between": ["rest", "upper"], "energy": 0.5 * WORK, "strength": {"stretch": 3.0}}
    fracture = {**SHEET["fracture"], "interfaces": [entry]}
    run = started(scene(**TWO, fracture=fracture))
    found = failing(run, 3.06)
    heights = run.body.all_points[:, 1]
    across = (heights[run.body.bonds.first] < 0.7) != (heights[run.body.bonds.second] < 0.7)
    assert found.by_strength.all()
    assert across[found.pairs].all()
    assert len(failing(run, 2.94).pairs) == 0
    assert [one["of"] for one in run.problem.strengths.summary] == ["rest and upper", "rest"]


def test_discs_beside_a_plane_of_symmetry_continue_beyond_it():
    """Means of a half are those of the whole, and a bond to an image breaks with its own image."""

    def of_steps(size, lower):
        data = {key: SHEET[key] for key in ("name", "spacing", "material", "fracture")}
        steps = [{"to": 1.0, "dynamics": {"duration": 1.0, "density": 1.0}}]
        prescribed = [
            {"region": "bottom", "x2": 0.0},
            {"region": "top", "x2": 1.0},
            {"region": "left", "x1": 0.0},
        ]
        body = {"shape": "rectangle", "size": size, "lower": lower}
        data |= {"steps": steps, "body": body, "prescribed": prescribed}
        return started(pds.Scene.model_validate(data))

    whole = of_steps([1.2, 1.4], [-0.6, 0.0])
    half = of_steps([0.6, 1.4], [0.0, 0.0])
    place = np.array([[0.05, 0.75]])
    means = [
        run.damage.means(zone(run), place, (np.cosh(3 * points[:, 0]) + points[:, 1]).take)
        for run in (whole, half)
        for points in [run.body.points]
    ]
    np.testing.assert_allclose(*means, rtol=1e-12)
    assert half.damage.share_in_hull(zone(half), 0, place[0]) == 1
    bonds = half.body.bonds
    count = len(half.body)
    sources = np.concatenate([np.arange(count), half.body.ghosts.source])
    half.damage.break_bonds(np.flatnonzero(sources[bonds.first] == sources[bonds.second]))
    x1, x2 = half.body.points.T
    half.force.place(np.stack([6 * x1 - 3 * x1**3, x2], axis=1))  # steepest at the plane
    found, loads = half.damage.by_strength(half.force)
    assert (loads >= 1).all()
    found = found[bonds.second[found] >= count]
    assert len(found) > 0
    ends = np.sort([sources[bonds.first[found]], sources[bonds.second[found]]], axis=0)
    assert (np.unique(ends, axis=1, return_counts=True)[1] == 2).all()


def test_a_scene_without_strength_does_not_load_it(monkeypatch):
    for name in ("run.strength", "problem.strength", "problem.random_strength"):
        monkeypatch.delitem(sys.modules, f"pdsurrogate.{name}", raising=False)
    run = started(scene(fracture={"energy": WORK}))
    assert run.problem.strengths is None
    assert not any(
        name.endswith("strength") and ".scenes." not in name
        for name in sys.modules
        if name.startswith("pdsurrogate.")
    )


def test_a_slow_tear_without_a_cut_begins_in_one_disc_at_the_strength():
    """In equilibrium one disc breaks at a time, at the stretch at break; the account of the tear
    closes, though strands of single bonds may be left between the parts.
    """
    data = {key: value for key, value in SHEET.items() if key != "dynamics"}
    data |= {"spacing": 0.18, "stretches": [3.8, 4.2]}
    summary = pds.simulate(pds.Scene.model_validate(data), "bond-energy", threads=1).summary
    crack = summary["crack"]
    assert crack["start"]["cause"] == "strength"
    assert abs(crack["start"]["stretch"] / 4.0 - 1) < 0.02
    assert len(crack["start"]["tips"]) == 1
    assert crack["peak"]["stretch"] == crack["start"]["stretch"]
    assert crack["through"]
    assert abs(summary["quasi_static"]["greatest_energy_gap"]) < 0.5
    assert summary["strength"][0]["radius_in_spacings"] > 1.5


def in_equilibrium(stretch, fracture=SHEET["fracture"], **changes):
    """The elastic sheet in equilibrium at a stretch."""
    data = {key: value for key, value in SHEET.items() if key not in ("dynamics", "fracture")}
    data |= {"stretches": [stretch], **changes}
    run = started(pds.Scene.model_validate(data | {"fracture": fracture}))
    parts = [{**part, "fracture": None} for part in data.get("materials", [])]
    elastic = pds.Scene.model_validate(data | {"materials": parts})
    found = pds.simulate(elastic, "bond-energy", threads=1)
    run.positions[:] = run.body.points + found.displacement()
    run.loading.apply(stretch, run.force, run.positions)
    run.force.place(run.positions)
    return run


def failing_in_equilibrium(*args, **changes):
    """What breaks in the equilibrium of the elastic sheet at a stretch."""
    run = in_equilibrium(*args, **changes)
    return run.damage.failing(run.force)


@pytest.mark.parametrize("of_rest", [{}, {"strength": {"stretch": 5.0}}])
def test_strength_breaks_the_material_that_has_reached_it(of_rest):
    """A stiff, weak half in series with a soft, strong one, whose bonds are stretched more: discs
    around points of the weak half reach across the interface.
    """
    stiff = {**RUBBER, "shear_modulus": 2.0, "bulk_modulus": 40.0}
    weak = {"energy": WORK / 3, "strength": {"stretch": 2.0}}
    parts = [{"region": "upper", "material": stiff, "fracture": weak}]
    two = {"regions": TWO["regions"], "materials": parts}
    run = in_equilibrium(3.0, {"energy": 2 * WORK, **of_rest}, **two)
    body = run.body
    found = run.damage.failing(run.force)
    torn = found.pairs[found.by_strength]
    assert len(torn) > 0
    assert body.all_points[[body.bonds.first[torn], body.bonds.second[torn]], 1].min() > 0.7


def test_pure_shear_between_clamps_breaks_at_the_strength_away_from_them():
    """Where pure shear has the work at break, within 2 %."""
    expected = scipy.optimize.brentq(
        lambda one: homogeneous.pure_shear(LAW, one).energy_density - WORK, 3, 4
    )
    changes = {
        "spacing": 0.18,
        "body": {"shape": "rectangle", "size": [4.0, 1.44]},
        "grips": [{"edge": "bottom"}, {"edge": "top", "travel": 1}],
        "fracture": {"energy": WORK, "strength": {"stretch": 4.0, "at_grips": False}},
    }
    assert len(failing_in_equilibrium(0.98 * expected, **changes).pairs) == 0
    assert failing_in_equilibrium(1.02 * expected, **changes).by_strength.any()


def test_a_cut_of_a_fifth_of_the_length_breaks_as_by_finite_elements():
    """At 3.55 by the rule (`pipelines/strength_elements.py`), where Griffith's law has no break
    below the strength; a cut acts half a spacing longer than drawn.
    """
    spacing = 0.2 / 1.125
    side = 14 * spacing
    drawn = {"start": [-1.0, side / 2], "end": [0.2 - spacing / 2, side / 2]}
    body = {"shape": "rectangle", "size": [side, side]}
    changes = {"spacing": spacing, "body": body, "precuts": [drawn]}
    assert len(failing_in_equilibrium(0.96 * 3.55, **changes).pairs) == 0
    found = failing_in_equilibrium(1.04 * 3.55, **changes)
    assert len(found.pairs) > 0
    assert found.by_strength.all()


@pytest.mark.slow
def test_a_killed_tear_by_strength_resumes_to_the_same_bits(tmp_path, monkeypatch):
    """Fronts, broken bonds and the time of the next search are those of the checkpoint."""
    dynamics = {"stretch": 4.05, "stretch_rate": 0.1, "density": 1.0, "outputs": 4}
    short = scene(spacing=0.18, stretches=[3.9], dynamics=dynamics)
    whole = pds.simulate(short, "bond-energy", threads=1)
    assert whole.summary["crack"]["start"]["cause"] == "strength"
    monkeypatch.setattr(checkpoints, "SECONDS_BETWEEN_CHECKPOINTS", 0.0)
    monkeypatch.setattr(checkpoints, "PAUSE_SHARE", 0.0)
    with pytest.raises(Killed), while_bonds_break(5):
        pds.simulate(short, "bond-energy", threads=1, folder=tmp_path)
    resumed = pds.simulate(short, "bond-energy", threads=1, folder=tmp_path, resume=True)
    assert resumed.summary["crack"] == whole.summary["crack"]
    np.testing.assert_array_equal(resumed.displacement(), whole.displacement())
