"""Branches and softening of pairs, against a material point integrated in NumPy."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import erf

import pdsurrogate as pds
from pdsurrogate.forces import ForceSettings, MaterialPart, bind_portions
from pdsurrogate.forces.internal_force import dissipated_by, numbers_in_place, stored_by
from pdsurrogate.materials import Branch, Memory, NeoHookean, Softening
from pdsurrogate.testing.bodies import lattice, of_points
from pdsurrogate.testing.subject import forces_at

HELD = ("strain", "space")
PLANES = (*HELD, "stress")
SOFTENING = Softening(1.6, 0.1, 0.2)
BRANCHES = (Branch(3.0, 1.0), Branch(0.5, 20.0))
MU, K = 2.0, 60.0


def law(branches=BRANCHES, softening=SOFTENING, shear_modulus=MU):
    memory = Memory(tuple(branches), softening)
    return NeoHookean(shear_modulus=shear_modulus, bulk_modulus=K, memory=memory)


def bound(plane, *laws, breakable=False, precision="float64"):
    """A small body whose force describes the laws, the second one beyond the middle."""
    body = of_points(lattice(*((0.5, 0.4, 0.4) if plane == "space" else (0.6, 0.5))))
    beyond = body.points[:, 0] > 0.3
    points = [slice(None)] if len(laws) == 1 else [np.flatnonzero(~beyond), np.flatnonzero(beyond)]
    settings = ForceSettings(plane=plane, precision=precision, breakable=breakable)
    parts = zip(laws, points, strict=True)
    model = pds.BondEnergyForce()
    if len(laws) == 1:
        return model.bind(body, laws[0], settings)
    return bind_portions(body, [MaterialPart(one, model, at) for one, at in parts], settings)


def unimodular(matrix):
    return matrix / np.cbrt(np.linalg.det(matrix))


def gradients(plane, count=4):
    rng = np.random.default_rng(7)
    d = 3 if plane == "space" else 2
    return [np.eye(d) + 0.2 * rng.normal(size=(d, d)) for _ in range(count)]


def moved(force, plane, seed=0):
    """Positions far from at rest and from homogeneous ones."""
    rng = np.random.default_rng(seed)
    points = force.body.points
    return points @ gradients(plane)[seed].T + 0.01 * rng.normal(size=points.shape)


def check_gradient(force, positions, rtol=1e-8, step=1e-6):
    """Forces are minus the derivative of the energy, and have no resultant and no moment."""
    rng = np.random.default_rng(5)
    found = forces_at(force, positions)
    motion = rng.normal(size=positions.shape)
    energies = []
    for sign in (1, -1):
        forces_at(force, positions + sign * step * motion)
        energies.append(force.energy())
    derivative = (energies[0] - energies[1]) / (2 * step)
    scale = np.linalg.norm(found) * np.linalg.norm(motion)
    assert abs(derivative + (found * motion).sum()) < rtol * scale
    moments = positions.T @ found
    assert np.abs(found.sum(axis=0)).max() < 1e-12 * np.abs(found).sum()
    assert np.abs(moments - moments.T).max() < 1e-11 * np.abs(found).sum()


def step_of_point(F, dt, C_k, before):
    """Stress of the branches and of the elastic law (unsoftened, isochoric, and of the volume) of a
    material point after a step, its isochoric strain, internal variables, and energy of branches.
    """
    C = F.T @ F
    Cb = unimodular(C)
    states, M, energy = [], np.zeros((3, 3)), 0.0
    for begun, branch in zip(C_k, BRANCHES, strict=True):
        h = dt / branch.time
        x = np.trace(before @ np.linalg.inv(begun)) / 3 * h
        state = begun
        if h == np.inf:
            state = Cb
        elif h > 0:
            m, q = -np.expm1(-x) / x, (x + np.expm1(-x)) / x**2
            state = unimodular(np.exp(-x) * begun + h * (m - q) * before + h * q * Cb)
        states.append(state)
        M += branch.modulus * np.linalg.inv(state)
        energy += branch.modulus * (np.trace(Cb @ np.linalg.inv(state)) - 3) / 2
    inverse, J = np.linalg.inv(F).T, np.linalg.det(F)

    def isochoric(M):
        return J ** (-2 / 3) * (F @ M - np.trace(M @ C) / 3 * inverse)

    parts = isochoric(M), isochoric(MU * np.eye(3)), K / 4 * (J**2 - J**-2) * inverse
    return parts, Cb, states, energy


@pytest.mark.parametrize("plane", PLANES)
def test_homogeneous_motion_is_that_of_a_material_point(plane):
    """Stress, thickness, stored and dissipated energies."""
    force = bound(plane, law())
    d = force.body.dimension
    volume = force.body.volumes.sum()
    C_k, before, most = [np.eye(3) for _ in BRANCHES], np.eye(3), 0.0
    for F, dt in zip(gradients(plane), (0.3, 0.0, 4.0, np.inf), strict=True):
        force.elapse(dt)
        forces_at(force, force.body.points @ F.T)

        def stress_at(G, dt=dt, C_k=C_k, before=before, most=most):
            (branches, elastic, volumetric), Cb, *_ = step_of_point(G, dt, C_k, before)
            W = MU / 2 * (np.trace(Cb) - 3)
            scale = SOFTENING.m + SOFTENING.beta * most
            eta = 1 - erf(max(most - W, 0) / scale) / SOFTENING.r
            return branches + eta * elastic + volumetric

        def full(thickness, F=F):
            G = np.diag([1.0, 1.0, thickness])
            G[:d, :d] = F
            return G

        G = full(1.0)
        if plane == "stress":
            first = 1 / np.linalg.det(F)
            across = [0.7 * first, 1.5 * first]
            G = full(brentq(lambda x: stress_at(full(x))[2, 2], *across, xtol=1e-14))
        expected = stress_at(G)
        np.testing.assert_allclose(force.mean_stress(), expected[:d, :d], atol=1e-9)
        of_points, density = force.stress_and_energy()
        np.testing.assert_allclose(of_points, np.broadcast_to(expected, of_points.shape), atol=1e-9)
        J3 = np.linalg.det(G)
        np.testing.assert_allclose(force.volume_ratios(), J3, rtol=1e-11)
        _, Cb, C_k, energy = step_of_point(G, dt, C_k, before)
        before = Cb
        W = MU / 2 * (np.trace(Cb) - 3)
        most = max(most, W)
        scale = SOFTENING.m + SOFTENING.beta * most
        softened = quad(lambda w, s=scale, m=most: erf((m - w) / s) / SOFTENING.r, 0, W)[0]
        stored = W - softened + energy + K / 8 * (J3 - 1 / J3) ** 2
        np.testing.assert_allclose(stored_by(force), stored * volume, rtol=1e-10)
        np.testing.assert_allclose(density, stored, rtol=1e-9)
        force.accept(force.body.points @ F.T)
        forces_at(force, force.body.points @ F.T)
        np.testing.assert_allclose(force.energy(), stored_by(force), rtol=1e-12)
        lost = quad(lambda w, s=scale, m=most: erf((m - w) / s) / SOFTENING.r, 0, most)[0]
        np.testing.assert_allclose(dissipated_by(force)["softening"], lost * volume, rtol=1e-10)


@pytest.mark.parametrize("plane", PLANES)
def test_forces_are_the_derivative_of_the_potential(plane):
    force = bound(plane, law())
    for number, dt in enumerate((0.7, 0.0, np.inf)):
        force.elapse(dt)
        check_gradient(force, moved(force, plane, number))
        force.accept(moved(force, plane, number))


@pytest.mark.parametrize("plane", PLANES)
def test_trials_leave_no_trace_and_histories_can_be_restored(plane):
    force = bound(plane, law())
    first, second = moved(force, plane, 1), moved(force, plane, 2)
    force.elapse(0.5)
    force.accept(first)
    kept = {name: array.copy() for name, array in force.history.items()}
    force.elapse(2.0)
    expected = forces_at(force, second)
    forces_at(force, first)
    for name, array in force.history.items():
        assert np.array_equal(array, kept[name])
    assert np.array_equal(forces_at(force, second), expected)
    force.accept(second)
    assert not np.array_equal(forces_at(force, second), expected)
    for name, array in force.history.items():
        array[:] = kept[name]
    force.elapse(2.0)
    assert np.array_equal(forces_at(force, second), expected)


@pytest.mark.parametrize("plane", PLANES)
def test_turning_the_body_turns_the_forces(plane):
    rng = np.random.default_rng(2)
    d = 3 if plane == "space" else 2
    Q = np.linalg.qr(rng.normal(size=(d, d)))[0]
    Q[0] *= np.linalg.det(Q)
    force, turned = bound(plane, law()), bound(plane, law())
    positions = [moved(force, plane, number) for number in range(2)]
    for one, turn in ((force, np.eye(d)), (turned, Q)):
        one.elapse(0.5)
        one.accept(positions[0])  # rotations between accepted states do not count either
        one.elapse(0.5)
        one.last = forces_at(one, positions[1] @ turn.T)
    np.testing.assert_allclose(turned.last, force.last @ Q.T, atol=1e-12)


@pytest.mark.parametrize("plane", PLANES)
def test_relaxed_states_are_those_of_the_elastic_law(plane):
    force = bound(plane, law(softening=None))
    elastic = bound(plane, NeoHookean(shear_modulus=MU, bulk_modulus=K))
    positions = moved(force, plane)
    force.elapse(np.inf)
    np.testing.assert_allclose(
        forces_at(force, positions), forces_at(elastic, positions), atol=1e-12
    )
    np.testing.assert_allclose(stored_by(force), elastic.energy(), rtol=1e-12)


@pytest.mark.parametrize("plane", PLANES)
def test_sudden_states_are_those_of_the_glassy_law(plane):
    force = bound(plane, law(softening=None))
    glassy = bound(plane, NeoHookean(shear_modulus=MU + 3.5, bulk_modulus=K))
    expected = forces_at(glassy, moved(force, plane))
    np.testing.assert_allclose(forces_at(force, moved(force, plane)), expected, atol=1e-11)
    np.testing.assert_allclose(force.energy(), glassy.energy(), rtol=1e-12)
    assert force.stiffness_moduli == glassy.stiffness_moduli


@pytest.mark.parametrize(("precision", "rounding"), [("float64", 3e-7), ("float32", 3e-6)])
def test_learned_isochoric_energies_have_histories_in_doubles(precision, rounding):
    settings = ForceSettings(plane="space", precision=precision)
    exact = bound("space", law())
    learned = pds.load_surrogate("neo-hookean-isochoric").bind(exact.body, law(), settings)
    for number, dt in enumerate((0.7, 0.0, 3.0)):
        for force in (exact, learned):
            force.elapse(dt)
            force.last = forces_at(force, moved(exact, "space", number))
            force.accept(moved(exact, "space", number))
        difference = np.abs(learned.last - exact.last).max()
        assert difference < rounding * np.abs(exact.last).max()
        assert stored_by(learned) == pytest.approx(stored_by(exact), rel=rounding)
    before = [force.history["branch_states"].copy() for force in (exact, learned)]
    np.testing.assert_allclose(*before, atol=rounding / 30)
    for force in (exact, learned):  # shorter than what single precision resolves
        for _ in range(20):
            force.elapse(1e-8)
            force.accept(moved(exact, "space", 2))
    changes = [
        force.history["branch_states"] - begun
        for force, begun in zip((exact, learned), before, strict=True)
    ]
    np.testing.assert_allclose(changes[1], changes[0], atol=1e-6 * np.abs(changes[0]).max())


@pytest.mark.parametrize("plane", PLANES)
def test_two_materials(plane):
    """Each material has the memory of its own bonds; one without memory keeps none."""
    force = bound(plane, law(), NeoHookean(shear_modulus=5.0, bulk_modulus=K))
    assert {name[-2:] for name in force.history} == {"_0"}
    force.elapse(0.7)
    force.accept(moved(force, plane))
    force.elapse(0.4)
    check_gradient(force, moved(force, plane, 1))
    both = bound(plane, law(), law())
    alone = bound(plane, law())
    for one in (both, alone):
        one.elapse(0.7)
        one.accept(moved(force, plane))
        one.elapse(0.2)
        one.last = forces_at(one, moved(force, plane, 1))
    assert np.array_equal(both.last, alone.last)  # equal materials are merged


@pytest.mark.parametrize("plane", PLANES)
def test_broken_pairs_have_no_branches(plane):
    force = bound(plane, law(), breakable=True)
    force.elapse(0.7)
    force.accept(moved(force, plane))
    dissipated = dissipated_by(force)
    pairs = np.arange(0, len(force.body.bonds.first), 7)
    force.break_bonds(pairs)
    assert dissipated_by(force) == dissipated
    force.elapse(0.7)
    check_gradient(force, moved(force, plane, 1))
    force.accept(moved(force, plane, 1))
    changed = force.history["dissipated_energies"][pairs].sum(axis=0)
    again = bound(plane, law(), breakable=True)
    again.elapse(0.7)
    again.accept(moved(force, plane))
    np.testing.assert_array_equal(changed, again.history["dissipated_energies"][pairs].sum(axis=0))


@pytest.mark.parametrize("plane", PLANES)
def test_numbers_in_place(plane):
    other = law((Branch(1.0, 3.0), Branch(0.2, 0.1)), Softening(2.0, 0.3, 0.1), 3.0)
    force, expected = bound(plane, law()), bound(plane, other)
    model = pds.BondEnergyForce()
    with numbers_in_place(force, [(other, model)]):
        for one in (force, expected):
            one.elapse(0.5)
            one.accept(moved(force, plane, 1))
            one.elapse(0.5)
            one.last = forces_at(one, moved(force, plane, 2))
    assert np.array_equal(force.last, expected.last)


def test_elastic_materials_load_nothing_for_memory():
    code = """
import sys
import numpy as np
import pdsurrogate as pds
body = pds.Body.rectangle(1.0, 1.0, 0.25, 0.7875)
for plane in ("strain", "stress"):
    settings = pds.ForceSettings(plane=plane)
    force = pds.BondEnergyForce().bind(body, pds.materials.NeoHookean(), settings)
    force(body.points, np.empty_like(body.points))
    assert not force.history
words = "branches", "_memory", "softening"
assert not [name for name in sys.modules if any(word in name for word in words)]
memory = pds.materials.Memory((pds.materials.Branch(1.0, 1.0),))
pds.BondEnergyForce().bind(body, pds.materials.NeoHookean(memory=memory), settings)
assert "pdsurrogate.kernels.rates" not in sys.modules  # times that depend on the overstress
"""
    subprocess.run([sys.executable, "-c", code], check=True)
