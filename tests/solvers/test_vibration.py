"""Free vibration of slender bars with branches against linear viscoelasticity."""

import numpy as np
import pytest
from memory_references import vibration

import pdsurrogate as pds
from pdsurrogate.materials import Branch, Memory, NeoHookean
from pdsurrogate.solvers.dynamics import ExplicitDynamics

BRANCHES = (0.5, 12.0), (0.3, 3.0)
PERIODS = 4


def complex_frequency(values, step, terms):
    """The s of the vibration in values at equal steps, which are a sum of `terms` functions exp(s
    t) of a linear solid.
    """
    apart = len(values) // (12 * PERIODS)
    shifted = [values[n * apart : len(values) - (terms - n) * apart] for n in range(terms)]
    factors = np.linalg.lstsq(np.stack(shifted, axis=1), values[terms * apart :], rcond=None)[0]
    roots = np.roots([1.0, *-factors[::-1]])
    return np.log(roots[np.argmax(roots.imag)]) / (apart * step)


@pytest.mark.parametrize(
    ("plane", "sides", "branches"),
    [("stress", (40, 4), BRANCHES), ("space", (24, 3, 3), BRANCHES[:1])],
)
def test_frequency_and_decrement_of_a_bar(plane, sides, branches):
    places = np.meshgrid(*[np.arange(side) + 0.5 for side in sides], indexing="ij")
    points = np.stack(places, axis=-1).reshape(-1, len(sides))
    body = pds.Body(points, np.ones(len(points)), 1.75 if plane == "space" else 3.15, 1.0)
    law = NeoHookean(bulk_modulus=100.0, memory=Memory(tuple(Branch(*one) for one in branches)))
    force = pds.BondEnergyForce().bind(body, law, pds.ForceSettings(plane=plane))
    wave_number = np.pi / sides[0]
    mode = np.cos(wave_number * points[:, 0])
    positions, velocities = points.copy(), np.zeros_like(points)
    velocities[:, 0] = 1e-4 * mode
    still = lambda positions, ahead: None  # noqa: E731
    undamped = {"damping": 0.0, "viscosity": 0.0, "safety": 0.8}
    integrator = ExplicitDynamics(
        force, still, positions, velocities, np.ones_like(points), np.ones(len(points)), **undamped
    )
    integrator.begin()
    step = integrator.longest = 0.98 * integrator.time_step
    expected = vibration(wave_number, 1.0, 100.0, 1.0, branches)
    values = []
    for _ in range(int(PERIODS * 2 * np.pi / expected.imag / step)):
        integrator.move()
        integrator.evaluate()
        force.accept(positions)
        assert integrator.last_step == step
        values.append((positions - points)[:, 0] @ mode)
    found = complex_frequency(np.array(values), step, 2 + len(branches))
    assert found.imag == pytest.approx(expected.imag, rel=0.01)
    assert found.real / found.imag == pytest.approx(expected.real / expected.imag, rel=0.01)
