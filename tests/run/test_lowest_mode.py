"""Lowest modes of equilibria: against dense eigenvalues, beams, Euler's column and limit loads."""

import numpy as np
import pytest
import scipy
from scipy.interpolate import CubicSpline
from test_control import DOWN, NEWTON, PUSHED, arch

import pdsurrogate as pds
from pdsurrogate.artifacts import load_surrogate
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.run.run import Run, Silent


def pencil(result):
    """Dense tangent and volumes of the free components in the last state of a result, and which components are free."""
    scene = result.scene
    run = Run(scene, checked_models(scene, load_surrogate("bond-energy")), Silent())
    if run.force.precision != "float64":
        run.take_double()
    run.state.parameter = result.levels[-1]["stretch" if scene.stretched else "t"]
    run.positions[:] = run.body.points + result.displacement()
    run.loading.apply(run.state.parameter, run.loaded, run.positions)
    free = run.loading.free > 0
    tangent = (run.loaded.tangent(run.positions) @ np.eye(free.size)[:, free.ravel()])[free.ravel()]
    return (tangent + tangent.T) / 2, np.broadcast_to(run.body.volumes[:, None], free.shape)[free], free


@pytest.mark.parametrize(
    ("scene", "keys", "drifts"),
    [
        ("hole", {"spacing": 0.25, "stretches": [1.3]}, 0),
        ("hole", {"spacing": 0.25, "stretches": [0.95]}, 0),
        ("traction", {"spacing": 0.1}, 0),
        ("bonded-block", {"spacing": 0.25}, 0),  # two equal eigenvalues
        ("uniaxial", {"spacing": 0.25, "stretches": [1.5]}, 1),  # the grips let the sheet slide along them
    ],
)
def test_the_lowest_mode_is_that_of_the_dense_tangent(scene, keys, drifts):
    result = pds.simulate(pds.load_scene(scene, **keys), "bond-energy")
    found = result.lowest_mode()
    tangent, volumes, free = pencil(result)
    values, vectors = scipy.linalg.eigh(tangent, np.diag(volumes))
    rounding = 1e-8 * values[-1]  # of the products, which are differences of forces
    assert abs(found.eigenvalue - values[drifts]) <= found.error + rounding
    assert found.error < 0.02 * found.eigenvalue
    assert found.stable
    assert np.linalg.norm(found.displacements, axis=1).max() == pytest.approx(1.0)
    assert not found.displacements[~free].any()
    if values[drifts + 1] > 1.1 * values[drifts]:
        mode, exact = found.displacements[free], vectors[:, drifts]
        assert abs(mode @ (volumes * exact)) == pytest.approx(np.sqrt(mode @ (volumes * mode)), rel=1e-3)
        assert found.eigenvalue == pytest.approx(values[drifts], rel=1e-4)


def test_a_column_vibrates_as_a_beam_and_buckles_as_eulers():
    """Clamped, 20 times as long as thick. By Timoshenko's theory shear lowers the critical strain by 2.9 %, and the eigenvalue, the square
    of a frequency, by some 3.5 %; the change of the sections under the load raises the critical strain by four times itself, 3.3 %."""
    length, thick, modulus = 4.0, 0.2, 9 * 100 / (3 * 100 + 1)  # E of K = 100 mu
    critical = np.pi**2 * thick**2 / (3 * length**2)
    scene = pds.Scene.model_validate(
        {
            "name": "column",
            "spacing": thick / 6,
            "body": {"size": [length, thick]},
            "material": "neo-hookean",
            "steps": [0.01 * critical * length, 0.4 * critical * length, 0.8 * critical * length],
            "prescribed": [{"region": "left", "x1": 0.0, "x2": 0.0}, {"region": "right", "x1": -1.0, "x2": 0.0}],
        }
    )
    result = pds.simulate(scene, "bond-energy")
    strains = np.array([level["t"] for level in result.levels]) / length
    eigenvalues = [result.lowest_mode(level).eigenvalue for level in range(3)]
    assert eigenvalues[0] == pytest.approx(4.730041**4 * modulus * thick**2 / (12 * length**4), rel=0.05)
    zero = strains[2] + eigenvalues[2] * (strains[2] - strains[1]) / (eigenvalues[1] - eigenvalues[2])
    assert zero == pytest.approx(critical, rel=0.04)


def test_an_arch_is_unstable_between_its_limit_loads():
    """The eigenvalue vanishes where the load along the path is greatest and least; the outputs are 0.05 apart."""
    result = pds.simulate(arch(loads=PUSHED, steps=[{"to": -0.6, "outputs": 12, "control": DOWN}], **NEWTON), "bond-energy")
    down = [-level["probes"]["tip"]["displacement"][1] for level in result.levels]
    modes = [result.lowest_mode(number) for number in range(12)]
    limits = CubicSpline(down, [level["t"] for level in result.levels]).derivative().roots(extrapolate=False)
    zeros = CubicSpline(down, [mode.eigenvalue for mode in modes]).roots(extrapolate=False)
    np.testing.assert_allclose(zeros, limits, atol=1e-3)
    clear = [all(abs(at - limit) > 0.01 for limit in limits) for at in down]
    assert [mode.stable for mode, far in zip(modes, clear, strict=True) if far] == [True] * 2 + [False] * 5 + [True] * 4


@pytest.mark.parametrize(
    ("scene", "keys", "force", "message"),
    [
        ("uniaxial", {"spacing": 0.25}, "neo-hookean", r"lowest_mode: neo-hookean@2 is a bond force without energy.*use .*bond-energy"),
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
    with pytest.raises((ValueError, IndexError), match=message):
        result.lowest_mode(7 if "number 7" in message else -1)


def test_a_result_from_files_has_no_lowest_mode(tmp_path):
    pds.simulate(pds.load_scene("uniaxial", spacing=0.25, stretches=[1.1]), "bond-energy").save(tmp_path / "out")
    with pytest.raises(ValueError, match="lowest_mode: a result that was read from files has no force model"):
        pds.load_result(tmp_path / "out").lowest_mode()
