"""Homogeneous histories and steps of branches against integrations by SciPy at 1e-10, and softening
against FElupe's.
"""

import numpy as np
import pytest
from memory_references import ELEMENTS, Rubber, at_knots, divided, integrated, law_of
from scipy.spatial.transform import Rotation

from pdsurrogate.kernels.branches import tensors_of
from pdsurrogate.materials import Softening
from pdsurrogate.materials.histories import softened, stress_history

KNOTS, STRETCHES = [0.0, 1.0, 3.0, 4.0], [1.0, 2.0, 2.0, 1.2]
MODES = "uniaxial", "equibiaxial", "pure-shear"


@pytest.mark.parametrize("mode", MODES)
def test_cycles_with_branches_and_a_bulk_modulus(mode):
    rubber = Rubber(branches=((1.0, 1.0), (0.5, 0.1), (0.3, 30.0)))
    expected = rubber.history(mode, KNOTS, STRETCHES, KNOTS[1:])
    errors = []
    for parts in (1, 40):
        times, stretches = divided(KNOTS, STRETCHES, parts)
        found = stress_history(law_of(rubber), mode, times, stretches)
        stress = at_knots(times, found.nominal_stress, KNOTS[1:])
        errors.append(np.abs(stress - expected[:, 3]).max() / expected[:, 3].max())
    lateral = at_knots(times, found.stretches[:, 2], KNOTS[1:])
    assert lateral == pytest.approx(expected[:, 2], rel=1e-6)
    assert errors[0] < 2e-4
    assert errors[1] < 3e-6


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("time", [1e-6, 1e6])
def test_moduli_and_times_of_all_magnitudes(scale, time):
    rubber = Rubber(scale, 100 * scale, ((2 * scale, 1.0), (scale, time)))
    expected = rubber.history("uniaxial", KNOTS, STRETCHES, KNOTS[1:])
    times, stretches = divided(KNOTS, STRETCHES, 40)
    found = stress_history(law_of(rubber), "uniaxial", times, stretches)
    stress = at_knots(times, found.nominal_stress, KNOTS[1:])
    assert stress / scale == pytest.approx(expected[:, 3] / scale, abs=2e-4)


def test_softening_of_a_cycle_in_each_mode():
    rubber = Rubber(branches=((0.5, 1.0),), softening=(1.5, 0.1, 0.1))
    knots, stretches = [0, 1, 2, 3, 4], [1.0, 1.8, 1.1, 1.6, 2.0]
    for mode in MODES:
        expected = rubber.history(mode, knots, stretches, knots[1:])
        times, values = divided(knots, stretches, 40)
        found = stress_history(law_of(rubber), mode, times, values)
        stress = at_knots(times, found.nominal_stress, knots[1:])
        assert stress == pytest.approx(expected[:, 3], abs=2e-4)


def test_softening_agrees_with_that_of_felupe():
    found = ELEMENTS["softening"]
    softening = Softening(*(found[key] for key in ("r", "m", "beta")))
    peak, etas = 0.0, []
    for state in found["cycle"]:
        F = np.array(state["F"])
        W = (np.trace(F.T @ F) - 3) / 2
        peak = max(peak, W)
        etas.append(softened(softening, np.array(W), np.array(peak)))
        P = F - np.trace(F.T @ F) / 3 * np.linalg.inv(F).T
        assert etas[-1] * P == pytest.approx(np.array(state["P"]), abs=1e-13)
    assert min(etas) < 0.5


def turning(t):
    """Return Cbar of a history with turning axes."""
    p = np.interp(t, [0.0, 1.0, 2.0], [0.0, 1.0, 0.3])
    F = Rotation.from_rotvec([0.3 * p, 0.2, p]).as_matrix() @ np.diag(
        [1 + p, 1.0, 1 / (1 + p)]
    ) + 0.6 * p * np.outer([1, 0, 0], [0, 1, 0])
    F = F @ Rotation.from_rotvec([p, -0.5 * p, 0.8 * p]).as_matrix()
    C = F.T @ F
    return C / np.linalg.det(C) ** (1 / 3)


def test_steps_with_turning_axes():
    tensors = tensors_of(3)
    expected = integrated(turning, 0.7, [1.0, 2.0])
    upper = np.triu_indices(3)
    errors = []
    for parts in (20, 40, 160):
        C_k, Cb, found = tensors.DIAGONAL, tensors.DIAGONAL, []
        for n in range(1, 2 * parts + 1):
            B, b = tensors.begin_step(C_k, Cb, 1 / parts / 0.7)
            Cb = tuple(turning(n / parts)[upper])
            C_k = tensors.end_step(B, b, Cb)
            found.append(C_k)
        at_ends = np.array([found[parts - 1], found[-1]])
        errors.append(np.abs(at_ends - expected[:, upper[0], upper[1]]).max())
    assert errors[0] / errors[1] == pytest.approx(4, abs=0.4)
    assert errors[2] < 2e-5 * np.abs(expected).max()
