"""Steps that control the displacement of a probe and find the factor of the loads, beyond its
maximum.
"""

import numpy as np
import pytest
from refusals import raising, refused
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root
from stopping import killed_with_levels

import pdsurrogate as pds
from pdsurrogate import simulate
from pdsurrogate.artifacts import load_surrogate
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.run.differentiated import differentiated
from pdsurrogate.run.sensitivity import jacobian

INNER, OUTER, K = 1.0, 2.0, 100.0

TIP, NEAR = (0.96, 0.396), {"near": (0.96, 0.396)}
HELD = [{"region": "left", "x1": 0, "x2": 0}, {"region": "right", "x1": 0}]
PUSHED = [{"region": NEAR, "force": (0, -1.0), "name": "top"}]
DOWN = "probes.tip.displacement.1"
NEWTON = {"solver": {"method": "newton", "tolerance": 1e-9}, "precision": "float64"}


def arch(**keys):
    """Half of a shallow arch that snaps through under a force at its top."""
    given = {
        "name": "arch",
        "spacing": 0.04,
        "body": {"shape": "polygon", "vertices": [(0, 0), (1, 0.35), (1, 0.47), (0, 0.12)]},
        "material": {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": K},
        "prescribed": HELD,
        "probes": [{"name": "tip", "at": TIP}],
    }
    return pds.Scene.model_validate(given | keys)


def snapped(**keys):
    return arch(loads=PUSHED, steps=[{"to": -0.6, "outputs": 6, "control": DOWN}], **keys)


def stresses(stretches):
    """Nominal stresses of the neo-Hookean law of the scene, mu = 1, at three principal
    stretches.
    """
    x = np.asarray(stretches)
    J = x.prod()
    return (J ** (-2 / 3) * (x**2 - (x**2).sum() / 3) + K / 4 * (J - 1 / J) * (1 + J**-2) * J) / x


def pressure(displacement, deformed):
    """Pressure on a ring in plane stress at a displacement of its inner boundary: d(P_R)/dR =
    (P_theta - P_R)/R, shot to P_R = 0.
    """
    hoop = 1 + displacement / INNER

    def left_over(load):
        def inside(pair):
            radial, _, across = stresses((pair[0], hoop, pair[1]))
            return [radial + load * hoop * (pair[1] if deformed else 1.0), across]

        pair = root(inside, [hoop**-0.5, hoop**-0.5], tol=1e-13).x

        def slopes(R, state):
            nonlocal pair

            def off(pair):
                radial, _, across = stresses((pair[0], state[0] / R, pair[1]))
                return [radial - state[1], across]

            pair = root(off, pair, tol=1e-13).x
            return [pair[0], (stresses((pair[0], state[0] / R, pair[1]))[1] - state[1]) / R]

        begin = [INNER + displacement, stresses((pair[0], hoop, pair[1]))[0]]
        return solve_ivp(slopes, (INNER, OUTER), begin, rtol=1e-8, atol=1e-10).y[1, -1]

    return brentq(left_over, 0.5, 0.75, xtol=1e-9)


def test_an_arch_snaps_through_as_under_a_prescribed_displacement():
    """The two runs have the same discrete equilibria: the force that one finds is the reaction
    of the other.
    """
    result = simulate(snapped(**NEWTON), "bond-energy")
    factors = [level["t"] for level in result.levels]
    assert max(factors) > 2 * factors[3]  # beyond the maximum, before the load grows again
    assert factors[5] > 2 * factors[3]
    for level in (result.levels[2], result.levels[5]):
        assert level["method"] == "displacement-control"
        top = {"region": NEAR, "x2": level["displacements"]["top"][1], "name": "top"}
        other = simulate(
            arch(prescribed=[*HELD, top], steps=(0.25, 0.5, 0.75, 1.0), **NEWTON), "bond-energy"
        ).levels[-1]
        assert level["t"] == pytest.approx(-other["forces"]["top"][1], rel=1e-5)
        assert other["probes"]["tip"]["displacement"] == pytest.approx(
            level["probes"]["tip"]["displacement"], rel=1e-5
        )
    assert [row["t"] for row in result.history] == factors
    assert [row["tip_displacement_2"] for row in result.history] == pytest.approx(
        np.linspace(-0.1, -0.6, 6), abs=1e-12
    )


@pytest.mark.parametrize(("thickness", "greatest"), [("deformed", 3.5), ("undeformed", 4.0)])
def test_a_ring_is_followed_beyond_its_greatest_pressure(thickness, greatest):
    """The exact maxima are 0.7164 and 0.6634, at displacements of about 3.5 and 4 inner radii."""
    steps = [
        {"to": to, "control": "probes.inner.displacement.0"} for to in (1.0, 3.0, greatest, 6.0)
    ]
    scene = pds.load_scene(
        "ring-pressure", {"spacing": 0.2, "steps": steps, "loads.0.thickness": thickness}
    )
    levels = simulate(scene, "bond-energy").levels
    assert levels[2]["t"] > levels[3]["t"]
    for level in levels:
        along = (
            level["probes"]["inner"]["displacement"][0],
            np.hypot(*level["probes"]["inner-diagonal"]["displacement"][:2]),
        )
        assert level["t"] == pytest.approx(
            pressure(np.mean(along), thickness == "deformed"), rel=5e-3
        )


def test_a_step_of_t_can_follow_and_resumes_to_the_same_bits(tmp_path):
    scene = arch(loads=PUSHED, steps=[{"to": -0.3, "outputs": 3, "control": DOWN}, 0.001])
    whole = simulate(scene, "bond-energy", folder=tmp_path / "whole")
    assert whole.levels[3]["t"] == 0.001
    for count in (1, 3):
        with killed_with_levels(count):
            simulate(scene, "bond-energy", folder=tmp_path / f"cut-{count}")
        resumed = simulate(scene, "bond-energy", folder=tmp_path / f"cut-{count}", resume=True)
        assert resumed.levels == whole.levels
        assert resumed.history == whole.history
    assert [moment.t for moment in whole.states.moments] == [level["t"] for level in whole.levels]


INWARD = "probes.inner.displacement.0"


def test_derivatives_keep_the_controlled_displacement_before_at_and_beyond_the_maximum():
    """The load answers. At the maximum, where dt/dU = 0, derivatives at a given load do not exist.
    The reference is Richardson's extrapolation from four equilibria with a residual of 1e-10, over
    1e-3 of the parameter, and 2e-2 of the bulk modulus, which matters little: errors of 1e-7 by the
    residual, and of 1e-7 by curvature.
    """
    values = (2.0, 3.0, 3.6, 4.2, 5.0)
    steps = [{"to": to, "control": INWARD} for to in values]
    keys = {
        "spacing": 0.25,
        "steps": steps,
        "loads.0.thickness": "undeformed",
        "material.bulk_modulus": 100.0,
    }
    result = simulate(pds.load_scene("ring-pressure", keys), "bond-energy")
    levels = [0, int(np.argmax([level["t"] for level in result.levels])), 4]
    assert levels[1] in (1, 2, 3)
    parameters = ["material.shear_modulus", "material.bulk_modulus", "loads.0.pressure", INWARD]
    outputs = ["t", "probes", "displacements", "energy"]
    body, slopes = (
        differentiated(result.scene, checked_models(result.scene, load_surrogate("bond-energy"))),
        [],
    )
    for level in levels:
        found = result.sensitivity(outputs, parameters, level)
        at, start = result.levels[level]["t"], result.displacement(level)
        for number, parameter in enumerate(parameters):
            value = values[level] if parameter == INWARD else body.numbers[parameter]
            step = (1e-2 if parameter.endswith("bulk_modulus") else 5e-4) * value
            sides = {}
            for way in (-2, -1, 1, 2):
                beside = (
                    body if parameter == INWARD else body.changed({parameter: value + way * step})
                )
                moved = start + way * step * found.displacements[number] * (parameter == INWARD)
                sides[way] = jacobian(beside, at, moved, outputs, [], INWARD).values
            near, far = (sides[1] - sides[-1]) / (2 * step), (sides[2] - sides[-2]) / (4 * step)
            expected = (4 * near - far) / 3
            assert (
                np.abs(found.derivatives[:, number] - expected).max()
                < 1e-6 * np.abs(expected).max()
            ), (level, parameter)
        column = found.outputs.index(INWARD)
        assert found.derivatives[column] == pytest.approx([0.0, 0.0, 0.0, 1.0], abs=1e-9)
        assert found.displacements.shape == (4, *result.body.points.shape)
        slopes.append(found.derivatives[0, 3])
    assert slopes[0] > 0 > slopes[2]
    assert abs(slopes[1]) < 0.1 * slopes[0]


def test_derivatives_of_controlled_steps_are_by_the_displacement_and_not_by_t():
    result = simulate(
        arch(loads=PUSHED, steps=[{"to": -0.1, "control": DOWN}, 0.001]), "bond-energy"
    )
    with raising(
        r"t is an unknown of a step that controls probes.tip.displacement.1: differentiate by"
        r" 'probes"
    ):
        result.sensitivity(["t"], ["t"], 0)
    with raising(r"there is no number 'prescribed.0.x1'"):
        result.sensitivity(["t"], ["prescribed.0.x1"], 0)
    with raising(r"there is no number 'probes.tip.displacement.1'"):
        result.sensitivity(["energy"], [DOWN], 1)
    assert result.sensitivity([DOWN], ["t"], 1).derivatives[0, 0] < 0


@refused("controlled steps")
def test_what_cannot_be_controlled_is_refused(changes, message):
    given = {"loads": PUSHED, "steps": [{"to": -0.6, "control": DOWN}]} | changes
    with raising(message):
        arch(**given)


def test_solvers_and_precisions_that_cannot_control_are_refused():
    with raising(
        r"steps\.0\.control needs solver\.method=automatic or newton, not relaxation",
        pds.SceneError,
    ):
        simulate(snapped(solver={"method": "relaxation"}), "bond-energy")
    with raising(
        r"needs forces in double precision, but the scene sets precision=float32", pds.SceneError
    ):
        simulate(snapped(precision="float32"), "bond-energy")
