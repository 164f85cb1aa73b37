"""Forces with branches and softening in homogeneous motions, whose stretches and stresses an
integration by SciPy gives.
"""

import numpy as np
import pytest
from memory_references import MODES, Rubber, at_knots, divided, law_of

import pdsurrogate as pds
from pdsurrogate.forces.internal_force import dissipated_by
from pdsurrogate.testing.bodies import lattice, of_points

KNOTS, STRETCHES = [0.0, 1.0, 3.0, 4.0], [1.0, 2.0, 2.0, 1.2]
RUBBER = Rubber(branches=((1.0, 1.0), (0.4, 0.2)))


class Motion:
    """A small body under a force with memory, in motions that are homogeneous.

    Bodies in the plane have the stretches 1 and 2 of a row of stretches, solids all.
    """

    def __init__(self, plane, law, force="bond-energy", **settings):
        self.plane = plane
        self.dimension = 3 if plane == "space" else 2
        self.body = of_points(lattice(*(0.4, 0.4, 0.4)[: self.dimension]))
        settings = pds.ForceSettings(plane=plane, **settings)
        self.force = pds.load_surrogate(force).bind(self.body, law, settings)
        self.out = np.empty_like(self.body.points)

    def step(self, stretches, elapsed):
        """Return the principal nominal stresses after a step, and the stored energy and what was
        dissipated per volume.
        """
        positions = self.body.points * stretches[: self.dimension]
        self.force.elapse(elapsed)
        self.force(positions, self.out)
        stress = np.diag(self.force.mean_stress())
        self.force.accept(positions)
        lost = dissipated_by(self.force)
        return stress, np.array([lost.get(key, 0.0) for key in ("branches", "softening")])


def driven(motion, rubber, mode, parts, knots=KNOTS, values=STRETCHES):
    """Return expected and found nominal stresses at the knots, and dissipated energies per volume
    at the end, found by cause and expected.

    The sides have the stretches that a free side should have; the stress found there is a pressure
    that a free side would release, and is taken from the stress along the first axis. In a sheet
    under plane stress the thickness releases it.
    """
    times, _ = divided(knots, values, parts)
    reference = rubber.history(mode, knots, values, list(times))
    found = []
    for row, elapsed in zip(reference[1:], np.diff(times), strict=True):
        stress, lost = motion.step(row[:3], elapsed)
        found.append(stress)
    expected = at_knots(times, reference, knots[1:])
    stress = at_knots(times[1:], np.array(found), knots[1:])
    free = MODES[mode].index(None)
    if free < motion.dimension and motion.plane != "stress":
        stress[:, 0] -= stress[:, free] * expected[:, free] / expected[:, 0]
    return expected[:, 3], stress[:, 0], lost / motion.body.volumes.sum(), expected[-1, 6]


CASES = [("space", "uniaxial"), ("space", "equibiaxial"), ("space", "pure-shear")]
CASES += [("strain", "plane-strain")]
ALL = ["space", "strain", pytest.param("stress", marks=pytest.mark.slow)]
CASES += [("stress", mode) for mode in ("uniaxial", "equibiaxial", "pure-shear")]


@pytest.mark.parametrize(("plane", "mode"), CASES)
def test_cycles_are_those_of_an_integration(plane, mode):
    errors = []
    for parts in (20, 40):
        motion = Motion(plane, law_of(RUBBER))
        expected, found, lost, dissipated = driven(motion, RUBBER, mode, parts)
        errors.append(np.abs(found - expected).max() / np.abs(expected).max())
        assert lost == pytest.approx([dissipated, 0.0], rel=0.01)
    assert errors[0] / errors[1] > 3.5
    assert errors[1] < 3e-4


@pytest.mark.slow
@pytest.mark.parametrize(("plane", "mode"), CASES)
def test_cycles_by_160_steps_a_relaxation_time(plane, mode):
    rubber = Rubber(branches=((1.0, 1.0),))
    motion = Motion(plane, law_of(rubber))
    expected, found, _, _ = driven(motion, rubber, mode, 160)
    # Theory (98): 1.5 and 0.3 times the square of an increment, of overstresses of 2 to 3.
    bound = {"uniaxial": 1e-6, "equibiaxial": 2e-5}.get(mode, 3e-6)
    assert np.abs(found - expected).max() < bound * np.abs(expected).max()


@pytest.mark.parametrize("plane", ALL)
@pytest.mark.parametrize("step", [0.03, 1.0, 30.0, 1e4])
def test_overstress_of_steps_of_all_lengths(plane, step):
    rubber = Rubber(branches=((1.0, 1.0),))
    mode = "plane-strain" if plane == "strain" else "uniaxial"
    knots = list(np.array([0, 60, 80, 140]) * step)
    values = [1.0, 2.0, 2.0, 1.0]
    motion = Motion(plane, law_of(rubber))
    expected, found, _, _ = driven(motion, rubber, mode, 1 / step, knots, values)
    relaxed = Rubber(K=100.0).history(mode, [0, 1, 2, 3], values, [1, 2, 3])
    greatest = np.abs(expected - relaxed[:, 3]).max()
    # The straight path of a step: theory (98), u = 0 in uniaxial tension.
    bound = 1e-3 if mode == "uniaxial" else 1e-3 + 1 / 120
    assert np.abs(found - expected).max() < bound * max(greatest, 1e-3)


@pytest.mark.parametrize(
    ("plane", "mode"),
    [("space", "uniaxial"), ("strain", "plane-strain"), ("stress", "uniaxial")],
)
def test_softening_of_a_cycle(plane, mode):
    rubber = Rubber(softening=(1.5, 0.1, 0.1), branches=((0.3, 1.0),))
    motion = Motion(plane, law_of(rubber))
    knots, values = [0.0, 1.0, 2.0, 3.0, 4.0], [1.0, 1.8, 1.1, 1.6, 2.0]
    expected, found, _, _ = driven(motion, rubber, mode, 20, knots, values)
    assert found == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
@pytest.mark.parametrize("time", [1e-6, 1e6])
@pytest.mark.parametrize("plane", ALL)
def test_moduli_and_times_of_all_magnitudes(plane, scale, time):
    rubber = Rubber(scale, 100 * scale, ((2 * scale, 1.0), (scale, time)))
    mode = "plane-strain" if plane == "strain" else "uniaxial"
    expected, found, _, _ = driven(Motion(plane, law_of(rubber)), rubber, mode, 20)
    assert found / scale == pytest.approx(expected / scale, abs=1e-3)


@pytest.mark.parametrize("modulus", [1e-6, 1e6])
@pytest.mark.parametrize("plane", ["space", "strain", "stress"])
def test_branches_much_softer_and_stiffer_than_the_elastic_part(plane, modulus):
    rubber = Rubber(branches=((modulus, 1.0),), K=100 * max(modulus, 1.0))
    mode = "plane-strain" if plane == "strain" else "uniaxial"
    expected, found, _, _ = driven(Motion(plane, law_of(rubber)), rubber, mode, 20)
    assert found == pytest.approx(expected, abs=1e-3 * max(modulus, 1.0))
