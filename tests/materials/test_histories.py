"""Homogeneous histories: against an integration by SciPy, and exact elastic states."""

import numpy as np
import pytest
from memory_references import Rubber
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.kernels.branches import tensors_of
from pdsurrogate.materials import Branch, Memory, Softening, homogeneous
from pdsurrogate.materials.histories import LOGS, stress_history

KNOTS = np.array([0.0, 1.0, 3.0, 4.0])
STRETCHES = np.array([1.0, 2.0, 2.0, 1.2])


@pytest.mark.parametrize("mode", LOGS)
def test_no_step_is_too_long(mode):
    """From one step for a ramp, hold or return to 160 a relaxation time."""
    law = pds.materials.NeoHookean(memory=Memory((Branch(1.0, 1.0), Branch(1.0, 30.0))))
    rubber = Rubber(K=1e8, branches=((1.0, 1.0), (1.0, 30.0)))
    expected = rubber.history(mode, KNOTS, STRETCHES, KNOTS[1:])[:, 3]
    overstress = (
        expected
        - stress_history(pds.materials.NeoHookean(), mode, KNOTS, STRETCHES, True).nominal_stress[
            1:
        ]
    )
    for n, limit in ((1, 1e-3), (10, 1e-4), (160, 1e-6)):
        time = np.linspace(0, 4, 4 * n + 1)
        found = stress_history(law, mode, time, np.interp(time, KNOTS, STRETCHES), True)
        at = np.searchsorted(time, KNOTS[1:] - 1e-9)
        assert np.abs(found.nominal_stress[at] - expected).max() < limit * overstress.max()


@pytest.mark.parametrize(
    ("mode", "incompressible"), [*((one, True) for one in LOGS), ("uniaxial", False)]
)
def test_times_that_fall_with_the_overstress_keep_the_second_order(mode, incompressible):
    """A branch that relaxes by the cube of its overstress, in steps of up to 30 of its times."""
    branch = Branch(2.0, 4.0, ((0.2, 4.0), (20.0, 4e-6)))
    law = pds.materials.NeoHookean(bulk_modulus=50.0, memory=Memory((branch, Branch(0.5, 1.0))))

    def factor(overstress):
        return np.array([np.clip(overstress[0] / 0.2, 1.0, 100.0) ** 3, 1.0])

    rubber = Rubber(
        K=1e6 if incompressible else 50.0, branches=((2.0, 4.0), (0.5, 1.0)), factor=factor
    )
    expected = rubber.history(mode, KNOTS, STRETCHES, KNOTS[1:])[:, 3]
    errors = []
    for n in (8, 16, 32):
        time = np.linspace(0, 4, 4 * n + 1)
        found = stress_history(law, mode, time, np.interp(time, KNOTS, STRETCHES), incompressible)
        off = found.nominal_stress[[n, 3 * n, 4 * n]] - expected
        errors.append(np.abs(off).max() / np.abs(expected).max())
    assert errors[0] < 0.01
    assert errors[2] < 5e-4


@pytest.mark.parametrize(("mode", "u"), [("uniaxial", 0), ("equibiaxial", 3), ("pure-shear", 1)])
@pytest.mark.parametrize("h", [0.5, 4.0, 1e3])
def test_the_error_of_a_straight_path(mode, u, h):
    """Theory (98), at a constant rate of stretch."""
    of, found, increment = tensors_of(3), [], 0.002 / 1.08
    for curved in (0, 1):
        C_k = before = earlier = (1.0, 0.0, 0.0, 1.0, 0.0, 1.0)
        for stretch in np.linspace(1, 1.08, 41)[1:]:
            square = np.exp(2 * np.array(LOGS[mode](np.log(stretch), 0.0)))
            Cb = square[0], 0.0, 0.0, square[1], 0.0, square[2]
            path = (C_k, before, h, earlier, 1.0) if curved else (C_k, before, h)
            begin = of.begin_curved_step if curved else of.begin_step
            C_k = of.end_step(*begin(*path), Cb)
            before, earlier = Cb, before
        found.append(Cb[0] / C_k[0] - Cb[5] / C_k[5])
    expected = u * increment / 2 * (1 / np.tanh(h / 2) - 2 / h)
    assert found[0] / found[1] - 1 == pytest.approx(expected, abs=increment / 25)


@pytest.mark.parametrize("mode", LOGS)
def test_an_elastic_history_consists_of_exact_states(mode):
    law = pds.materials.Gent(chain_limit=30.0, bulk_modulus=50.0)
    exact = {"uniaxial": homogeneous.uniaxial, "equibiaxial": homogeneous.equibiaxial}
    stretches = [1.0, 1.5, 0.8]
    expected = [exact.get(mode, homogeneous.pure_shear)(law, one) for one in stretches]
    found = stress_history(law, mode, range(3), stretches)
    stress = [one.nominal_stress for one in expected]
    assert found.nominal_stress == pytest.approx(stress, rel=1e-8, abs=1e-9)


def test_a_great_bulk_modulus_gives_the_incompressible_history():
    memory = Memory((Branch(0.5, 1.0),), Softening(1.5, 0.1, 0.1))
    law = pds.materials.Yeoh(bulk_modulus=1e7, memory=memory)
    path = [0, 1, 1, 5, 6], [1.0, 2.0, 1.8, 1.8, 2.2]
    kept = stress_history(law, "uniaxial", *path, incompressible=True)
    found = stress_history(law, "uniaxial", *path)
    assert found.nominal_stress == pytest.approx(kept.nominal_stress, rel=1e-6)


def test_what_no_history_has_is_refused():
    law = pds.materials.NeoHookean()
    for mode, time, stretch, words in (
        ("shear", [0, 1], [1, 1], "mode must be uniaxial"),
        ("uniaxial", [0, 2, 1], [1, 1, 1], "1 follows 2"),
        ("uniaxial", [0, 1], [1, -1], "positive"),
        ("uniaxial", [0, 1], [1], "a value for each time"),
        ("uniaxial", [0, np.inf], [1, 1], "finite"),
    ):
        with raising(words):
            stress_history(law, mode, time, stretch)
