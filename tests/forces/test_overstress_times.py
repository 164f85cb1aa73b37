"""Branches whose relaxation times fall with the overstress, at pairs, against an integration of the
internal variable by SciPy.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from test_pair_memory import MU, PLANES, K, bound, check_gradient, moved

import pdsurrogate as pds
from pdsurrogate.forces.internal_force import dissipated_by, numbers_in_place, settle
from pdsurrogate.materials import Branch, Memory, NeoHookean
from pdsurrogate.testing.subject import forces_at

TIMES = (0.3, 5.0), (1.0, 1.0), (6.0, 0.02)
BRANCHES = Branch(3.0, 5.0, TIMES), Branch(0.5, 20.0)
SHEAR = np.array([[0.5, 0.9, 0.0], [-0.2, 0.0, 0.0], [0.0, 0.0, 0.0]])


def law(branches=BRANCHES):
    return NeoHookean(shear_modulus=MU, bulk_modulus=K, memory=Memory(branches))


def time_of(overstress):
    """Relaxation time of the first branch."""
    return np.exp(np.interp(np.log(overstress), *np.log(TIMES).T))


def unimodular(matrix):
    return matrix / np.cbrt(np.linalg.det(matrix))


def course(plane, C_k, t):
    """Deformation gradient (3, 3) of the course of the tests at a time and states."""
    F = np.eye(3) + t * SHEAR
    if plane != "stress":
        return F

    def across(z):
        G = F.copy()
        G[2, 2] = z
        return stress(G, C_k)[2, 2]

    F[2, 2] = brentq(across, 0.4, 2.0, xtol=1e-14)
    return F


def stress(F, C_k):
    """First Piola-Kirchhoff stress of a material point."""
    C, J, inverse = F.T @ F, np.linalg.det(F), np.linalg.inv(F).T
    M = MU * np.eye(3)
    for branch, one in zip(BRANCHES, C_k, strict=True):
        M = M + branch.modulus * np.linalg.inv(one)
    isochoric = J ** (-2 / 3) * (F @ M - np.trace(M @ C) / 3 * inverse)
    return isochoric + K / 4 * (J**2 - J**-2) * inverse


def exact(plane, end):
    """Stress and dissipated energy per volume after a course of a given duration."""

    def rate(t, y):
        C_k = y[:-1].reshape(2, 3, 3)
        F = course(plane, C_k, t)
        Cb = unimodular(F.T @ F)
        change, lost = [], 0.0
        for branch, one in zip(BRANCHES, C_k, strict=True):
            whole = Cb @ np.linalg.inv(one)
            S = whole - np.trace(whole) / 3 * np.eye(3)
            half = np.trace(S @ S) / 2
            time = (
                time_of(max(branch.modulus * np.sqrt(half), 1e-9)) if branch.times else branch.time
            )
            change.append((Cb - np.trace(whole) / 3 * one) / time)
            lost += branch.modulus * half / time
        return np.r_[np.ravel(change), lost]

    y = solve_ivp(
        rate, (0, end), np.r_[np.eye(3).ravel(), np.eye(3).ravel(), 0.0], rtol=1e-9, atol=1e-11
    ).y[:, -1]
    C_k = y[:-1].reshape(2, 3, 3)
    return stress(course(plane, C_k, end), C_k), y[-1]


def run(plane, end, steps):
    """Mean stress and dissipated energy per volume of a body after a course in equal steps."""
    force = bound(plane, law())
    d = force.body.dimension
    for t in np.linspace(0, end, steps + 1)[1:]:
        force.elapse(end / steps)
        F = (np.eye(3) + t * SHEAR)[:d, :d]
        forces_at(force, force.body.points @ F.T)
        force.accept(force.body.points @ F.T)
    forces_at(force, force.body.points @ F.T)
    return force.mean_stress(), dissipated_by(force)["branches"] / force.body.volumes.sum()


@pytest.mark.parametrize("plane", PLANES)
def test_homogeneous_courses_are_those_of_the_evolution_to_second_order(plane):
    expected, lost = exact(plane, 1.0)
    d = 3 if plane == "space" else 2
    errors = []
    for steps in (20, 40):
        found, dissipated = run(plane, 1.0, steps)
        errors.append(np.abs(found - expected[:d, :d]).max())
        assert dissipated == pytest.approx(lost, rel=2e-2)
    assert errors[1] < 2e-3 * np.abs(expected).max()
    assert 3 < errors[0] / errors[1] < 6


def steep(modulus=3.0):
    """Branch of times that fall by the cube of the overstress."""
    return law((Branch(modulus, 4.0, ((0.1, 4.0), (10.0, 4e-6))),))


@pytest.mark.parametrize("plane", PLANES)
def test_forces_are_the_derivative_of_the_potential_of_a_step(plane):
    force = bound(plane, steep())
    for number, dt in enumerate((0.7, 0.0, np.inf, 1e-3)):
        force.elapse(dt)
        check_gradient(force, moved(force, plane, number % 4))
        force.accept(moved(force, plane, number % 4))
    assert dissipated_by(force)["branches"] > 0


@pytest.mark.parametrize("plane", PLANES)
def test_times_of_a_step_settle_at_its_end(plane):
    """At an equilibrium the forces are those of a step whose first trial was there."""
    force = bound(plane, steep())
    first, second = moved(force, plane, 1), moved(force, plane, 2)
    force.elapse(0.5)
    expected = forces_at(force, second)
    assert not settle(force, second)
    force.elapse(0.5)
    off = forces_at(force, first), forces_at(force, second)
    assert np.abs(off[1] - expected).max() > 1e-3 * np.abs(expected).max()
    while settle(force, second):
        pass
    np.testing.assert_allclose(
        forces_at(force, second), expected, atol=2e-3 * np.abs(expected).max()
    )
    force.elapse(np.inf)
    forces_at(force, first)
    assert not settle(force, second)


def test_pairs_that_a_first_guess_turns_inside_out_relax_as_if_held():
    force = bound("strain", steep())
    force.elapse(0.5)
    with pytest.raises(RuntimeError):
        forces_at(force, force.body.points * [-1.0, 1.0])
    held = moved(force, "strain", 1)
    expected = forces_at(force, held)
    force.elapse(0.5)
    forces_at(force, force.body.points)
    np.testing.assert_allclose(forces_at(force, held), expected, rtol=1e-6)


@pytest.mark.parametrize("plane", PLANES)
def test_equal_times_at_all_overstresses_are_a_constant_time(plane):
    constant, equal = (
        bound(plane, law((Branch(3.0, 4.0, times),))) for times in ((), ((0.1, 4.0), (1.0, 4.0)))
    )
    for number, dt in enumerate((0.7, 3.0)):
        for force in (constant, equal):
            force.elapse(dt)
            forces_at(force, moved(force, plane, number))
            force.accept(moved(force, plane, number))
    found = [forces_at(force, moved(force, plane, 2)) for force in (equal, constant)]
    np.testing.assert_allclose(*found, rtol=1e-8, atol=1e-10)


def test_parameters_can_change():
    force, other = bound("strain", steep(3.0)), bound("strain", steep(2.0))
    places = moved(force, "strain", 1)
    with numbers_in_place(force, [(other.law, pds.BondEnergyForce())]):
        for one in (force, other):
            one.elapse(0.5)
            one.last = forces_at(one, places)
    np.testing.assert_array_equal(force.last, other.last)
