"""Lowest modes of equilibria: against dense eigenvalues, beams, Euler's column and limit loads."""

import numpy as np
import pytest
import scipy
from refusals import raising
from scipy.interpolate import CubicSpline
from test_control import DOWN, NEWTON, PUSHED, arch

import pdsurrogate as pds
from pdsurrogate.artifacts import load_surrogate
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.run.run import Run


def pencil(result):
    """Dense tangent and volumes of the free components in the last state of a result, and which
    components are free.
    """
    scene = result.scene
    run = Run(scene, checked_models(scene, load_surrogate("bond-energy")))
    if run.force.precision != "float64":
        run.take_double()
    run.state.parameter = result.levels[-1]["stretch" if scene.stretched else "t"]
    run.positions[:] = run.body.points + result.displacement()
    run.loading.apply(run.state.parameter, run.loaded, run.positions)
    free = run.loading.free > 0
    tangent = (run.loaded.tangent(run.positions) @ np.eye(free.size)[:, free.ravel()])[free.ravel()]
    return (
        (tangent + tangent.T) / 2,
        np.broadcast_to(run.body.volumes[:, None], free.shape)[free],
        free,
    )


def bar(length, **keys):
    """A solid bar with a square section of the side 1, clamped at its left end, under a force
    across its right end.
    """
    given = {
        "name": "bar",
        "spacing": 0.25,
        "body": {"shape": "box", "size": [length, 1.0, 1.0]},
        "material": "neo-hookean",
        "steps": [1.0],
        "prescribed": [{"region": "left", "x1": 0.0, "x2": 0.0, "x3": 0.0}],
        "loads": [{"region": "right", "force": [0.0, 1e-6, 0.0], "name": "end"}],
        "probes": [{"name": "end", "at": [length, 0.5, 0.5]}],
    }
    return pds.Scene.model_validate(given | keys)


@pytest.mark.parametrize(
    ("scene", "drifts"),
    [
        (pds.load_scene("hole", spacing=0.25, stretches=[1.3]), 0),
        (pds.load_scene("hole", spacing=0.25, stretches=[0.95]), 0),
        (pds.load_scene("traction", spacing=0.1), 0),
        # two equal eigenvalues, of which the search may return any combination
        (pds.load_scene("bonded-block", spacing=0.25), 0),
        (bar(8.0), 0),
        # the grips let the sheet slide along them
        (pds.load_scene("uniaxial", spacing=0.25, stretches=[1.5]), 1),
    ],
    ids=lambda one: getattr(one, "name", one),
)
def test_the_lowest_mode_is_that_of_the_dense_tangent(scene, drifts):
    result = pds.simulate(scene, "bond-energy")
    found = result.lowest_mode()
    tangent, volumes, free = pencil(result)
    values, vectors = scipy.linalg.eigh(tangent, np.diag(volumes))
    rounding = 1e-8 * values[-1]  # of the products, which are differences of forces
    assert abs(found.eigenvalue - values[drifts]) <= found.error + rounding
    assert found.error < 0.02 * found.eigenvalue
    assert found.stable
    assert np.linalg.norm(found.displacements, axis=1).max() == pytest.approx(1.0)
    assert not found.displacements[~free].any()
    assert found.eigenvalue == pytest.approx(values[drifts], rel=1e-5)
    mode = found.displacements[free]
    alike = vectors[:, np.abs(values / values[drifts] - 1) < 0.1]
    shares = alike.T @ (volumes * mode)
    print(
        scene.name,
        found.eigenvalue / values[drifts] - 1,
        shares @ shares / (mode @ (volumes * mode)) - 1,
    )
    assert shares @ shares == pytest.approx(mode @ (volumes * mode), rel=1e-5)


def column(length, thick, steps, **keys):
    """A sheet between clamped grips that approach each other."""
    given = {
        "name": "column",
        "spacing": thick / 6,
        "body": {"size": [length, thick]},
        "material": "neo-hookean",
        "steps": steps,
        "prescribed": [
            {"region": "left", "x1": 0.0, "x2": 0.0},
            {"region": "right", "x1": -1.0, "x2": 0.0},
        ],
    }
    return pds.Scene.model_validate(given | keys)


def test_a_column_vibrates_as_a_beam_and_buckles_as_eulers():
    """Clamped, 20 times as long as thick. By Timoshenko's theory shear lowers the critical strain
    by 2.9 %, and the eigenvalue, the square of a frequency, by some 3.5 %; the change of the
    sections under the load raises the critical strain by four times itself, 3.3 %.
    """
    length, thick, modulus = 4.0, 0.2, 9 * 100 / (3 * 100 + 1)  # E of K = 100 mu
    critical = np.pi**2 * thick**2 / (3 * length**2)
    result = pds.simulate(
        column(length, thick, [share * critical * length for share in (0.01, 0.4, 0.8)]),
        "bond-energy",
    )
    strains = np.array([level["t"] for level in result.levels]) / length
    eigenvalues = [result.lowest_mode(level).eigenvalue for level in range(3)]
    assert eigenvalues[0] == pytest.approx(
        4.730041**4 * modulus * thick**2 / (12 * length**4), rel=0.05
    )
    zero = strains[2] + eigenvalues[2] * (strains[2] - strains[1]) / (
        eigenvalues[1] - eigenvalues[2]
    )
    assert zero == pytest.approx(critical, rel=0.04)


@pytest.mark.parametrize("slender", [8.0, 20.0, 40.0])
@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_a_run_finds_that_a_slender_column_buckles(plane, slender):
    """At Euler's strain, which is the same in plane strain: E/(1 - nu^2) resists both the
    compression and the bending. Timoshenko's shear lowers it by 3.6 times itself, and the change of
    the sections raises it by four times itself. The increments are 0.005 of it.
    """
    thick, share = 0.2, np.pi**2 / (3 * slender**2)
    critical = share * slender * thick
    with raising("is not stable, so the body buckles", pds.SimulationFailed) as caught:
        pds.simulate(
            column(slender * thick, thick, [0.9 * critical, 1.2 * critical], plane=plane),
            "bond-energy",
        )
    stable, last = (level["t"] / critical for level in caught.value.result.levels)
    assert stable == pytest.approx(0.9)
    assert last == pytest.approx((1 + 4 * share) / (1 + 3.6 * share), abs=0.05)


@pytest.mark.parametrize("length", [8.0, 20.0])
def test_a_slender_solid_cantilever_vibrates_as_a_beam_of_its_own_flexibility(length):
    """From the static deflection 1/c under a force F = 1 the stiffness against bending is c L^3/3,
    with which a beam has the eigenvalue 1.875104^4/3 c/(L A). Shear and rotary inertia (Timoshenko)
    lower it by 0.9/L^2; the force acts on the last layer of points, whose middle lies 1/8 within
    the end, so that the deflection is less by up to 3/2 1/(8 L).
    """
    result = pds.simulate(bar(length), "bond-energy")
    found = result.lowest_mode()
    deflection = result.levels[-1]["probes"]["end"]["displacement"][1] / 1e-6
    share = found.eigenvalue / (1.875104**4 / (3 * deflection * length))
    assert 1 - 0.9 / length**2 - 3 / (16 * length) < share < 1
    assert found.stable
    assert found.error < 1e-3 * found.eigenvalue
    along = np.linalg.norm(found.displacements, axis=1)
    assert along.argmax() in np.flatnonzero(result.body.points[:, 0] > length - 0.25)


def test_a_bent_cantilever_is_stable():
    """Under a force across its end, which moves by half the length. The preconditioner of the check
    is an iteration here: with Lanczos' method for a linear one its values are -0.1 and -0.9.
    """
    loads = [{"region": "right", "force": [0.0, 0.006, 0.002], "name": "end"}]
    material = {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 20.0}
    result = pds.simulate(bar(8.0, loads=loads, material=material, steps=[1.0, 2.0]), "bond-energy")
    moved = [np.linalg.norm(level["probes"]["end"]["displacement"]) for level in result.levels]
    assert 0.4 * 8 < moved[0] < moved[1]


def test_an_arch_is_unstable_between_its_limit_loads():
    """The eigenvalue vanishes where the load along the path is greatest and least; the outputs
    are 0.05 apart.
    """
    result = pds.simulate(
        arch(loads=PUSHED, steps=[{"to": -0.6, "outputs": 12, "control": DOWN}], **NEWTON),
        "bond-energy",
    )
    down = [-level["probes"]["tip"]["displacement"][1] for level in result.levels]
    modes = [result.lowest_mode(number) for number in range(12)]
    limits = (
        CubicSpline(down, [level["t"] for level in result.levels])
        .derivative()
        .roots(extrapolate=False)
    )
    zeros = CubicSpline(down, [mode.eigenvalue for mode in modes]).roots(extrapolate=False)
    np.testing.assert_allclose(zeros, limits, atol=1e-3)
    clear = [all(abs(at - limit) > 0.01 for limit in limits) for at in down]
    assert [mode.stable for mode, far in zip(modes, clear, strict=True) if far] == [True] * 2 + [
        False
    ] * 5 + [True] * 4


@pytest.mark.parametrize(
    ("scene", "keys", "force", "message"),
    [
        (
            "uniaxial",
            {"spacing": 0.25},
            "neo-hookean",
            r"lowest_mode: neo-hookean@2 is a bond force without energy.*use .*bond-energy",
        ),
        (
            "ring-pressure",
            {"spacing": 0.25, "steps": [0.1]},
            "bond-energy",
            "lowest_mode: the loads have no energy: the pressure on holes acts on the deformed",
        ),
        ("zero-energy", {}, "bond-energy", "outputs, none with the number 7"),
    ],
)
def test_what_has_no_lowest_mode_is_refused(scene, keys, force, message):
    result = pds.simulate(pds.load_scene(scene, **keys), force)
    with raising(message, (ValueError, IndexError)):
        result.lowest_mode(7 if "number 7" in message else -1)
