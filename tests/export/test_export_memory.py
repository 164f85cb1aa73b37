"""Exported files of materials with memory, driven through cycles with a hold, against straight
steps in NumPy.
"""

import re
import subprocess
import sys

import numpy as np
import pytest
from memory_references import integrated
from refusals import raising
from scipy.optimize import brentq
from test_export import (
    II,
    JJ,
    UMAT,
    imported,
    jaumann,
    needs_gfortran,
    slope_of,
    soft,
    written,
)

import pdsurrogate as pds
from pdsurrogate.export import exported, source_of_artifact, source_of_law
from pdsurrogate.materials import LAWS, Branch, Memory, Softening
from pdsurrogate.materials.histories import isochoric, softened

BRANCHES = (Branch(0.8, 2.0), Branch(1.7, 0.05))
SOFTENING = Softening(1.5, 0.1, 0.2)
MEMORIES = {
    "branches": Memory(BRANCHES),
    "softening": Memory((), SOFTENING),
    "both": Memory(BRANCHES, SOFTENING),
    "slow": Memory((Branch(0.8, 2.0), Branch(1.7, 0.5))),  # many steps of 1/640 a relaxation time
}
TIMES = np.array([0.0, 0.2, 1.0, 1.0, 4.0, 4.5, 6.0, 9.0, 1e9, 1e9 + 1])
STRETCHES = np.array([1.0, 1.2, 1.8, 2.0, 2.0, 1.5, 1.02, 1.7, 1.7, 2.3])


def remembering(name, kind):
    return type(soft(LAWS[name]))(
        **{key: getattr(soft(LAWS[name]), key) for key in LAWS[name].defaults()},
        memory=MEMORIES[kind],
    )


@pytest.fixture(params=[("gent", "branches"), ("ogden", "softening"), ("yeoh", "both")])
def source(request):
    return source_of_law(remembering(*request.param))


def straight(law):
    """Stretches and Kirchhoff stresses along the first axis of a uniaxial cycle, in steps whose
    path of the isochoric tensor is straight, theory (91).
    """
    states = [np.ones(3) for _ in law.memory.branches]
    before, peak, rows = np.ones(3), 0.0, []
    for elapsed, stretch in zip(np.diff(TIMES, prepend=0.0), STRETCHES, strict=True):

        def at(across, stretch=stretch, elapsed=elapsed, states=states, before=before, peak=peak):
            logs = np.array([np.log(stretch), across, across])
            squares = np.exp(2 * (logs - logs.mean()))
            energy, slopes = isochoric(law, (logs - logs.mean())[None])
            found, total = [], slopes[0]
            if law.memory.softening:
                total = total * softened(law.memory.softening, energy, np.maximum(peak, energy))
            for branch, C in zip(law.memory.branches, states, strict=True):
                h = elapsed / branch.time
                k = h * (before / C).sum() / 3
                mean = -np.expm1(-k) / k if k else 1.0
                last = (1 - mean) / k if k else 0.5
                new = np.exp(-k) * C + h * (mean - last) * before + h * last * squares
                found.append(new / np.cbrt(new.prod()))
                total = total + branch.modulus * squares / found[-1]
            J = np.exp(logs.sum())
            pressure = law.shear_modulus * J * law.volumetric(J, law.parameters)[1]
            return total - total.mean() + pressure, found, squares, energy[0], np.exp(logs)

        across = brentq(lambda x, at=at: at(x)[0][1], -1.0, 1.0, xtol=1e-14)
        stress, states, before, energy, stretches = at(across)
        peak = max(peak, energy)
        rows.append((*stretches, stress[0]))
    return np.array(rows)


@pytest.fixture
def course(source):
    """Durations, gradients and Kirchhoff stresses of a uniaxial cycle whose axes are turned."""
    rows = straight(source.law)
    one, other = np.linalg.qr(np.random.default_rng(5).standard_normal((2, 3, 3)))[0]
    one, other = (turn * np.linalg.det(turn) for turn in (one, other))
    F = one @ (rows[:, :3, None] * other)
    along = one @ np.diag([1.0, 0.0, 0.0]) @ one.T
    kirchhoff = rows[:, 3, None, None] * along
    return np.diff(TIMES, prepend=0.0), F, kirchhoff


def test_felupe_file(source, course, tmp_path):
    path = written(source, "felupe", tmp_path)
    material = imported(path).Material()
    state = np.zeros((*material.x[-1].shape, 1, 1))
    size = abs(course[2]).max()
    for duration, F, kirchhoff in zip(*course, strict=True):
        material.time_step = duration
        before = state

        def stress(G, before=before):
            return material.gradient([G[:, :, None, None], before])[0][..., 0, 0]

        P, state = material.gradient([F[:, :, None, None], before])
        assert np.allclose(P[..., 0, 0] @ F.T, kirchhoff, rtol=0, atol=1e-9 * size)
    # At the last state the energy grows beyond W_max: the curvature jumps there.
    material.time_step, F = 0.3, 0.97 * F + 0.05 * np.eye(3)[::-1]
    tangent = material.hessian([F[:, :, None, None], state])[0][..., 0, 0]
    slopes = [
        slope_of(lambda G: stress(G, state), F, np.eye(3)[:, [k]] * np.eye(3)[m], 1e-4)
        for k in range(3)
        for m in range(3)
    ]
    slopes = np.moveaxis(np.array(slopes).reshape(3, 3, 3, 3), (0, 1), (2, 3))
    assert abs(tangent - slopes).max() <= 1e-8 * abs(tangent).max()
    assert np.allclose(tangent, tangent.transpose(2, 3, 0, 1), atol=1e-12 * abs(tangent).max())
    subprocess.run([sys.executable, path], check=True)


def test_a_cycle_of_shear_is_that_of_an_independent_integration(tmp_path):
    """The principal axes turn; the equation of C_k is integrated by SciPy at 1e-11."""
    law, N, ends = remembering("gent", "slow"), 640, [0.0, 1.0, 2.0, 3.0]
    source = source_of_law(law)
    module, moduli = imported(written(source, "felupe", tmp_path)), source.moduli

    def gradient(t):
        shear = np.interp(t, ends, [0, 0.8, 0.8, 0.2])
        return np.diag([1 + shear / 2, 1 - shear / 8, 1.0]) + shear * np.eye(3, k=1)

    def isochoric(t):
        F = gradient(t)
        return np.linalg.det(F) ** (-2 / 3) * F.T @ F

    branches = law.memory.branches
    expected = [integrated(isochoric, branch.time, ends[1:]) for branch in branches]
    state, now = np.zeros(module.STATE), 0.0
    for place, end in enumerate(ends[1:]):
        for _ in range(N):
            now += 1 / N
            _, P, _, state = module.evaluate(gradient(now), state, 1 / N, *moduli)
        F = gradient(end)
        over = np.zeros((3, 3))
        for branch, states in zip(branches, expected, strict=True):
            mixed = isochoric(end) @ np.linalg.inv(states[place])
            over += branch.modulus * np.linalg.inv(F).T @ (mixed - np.trace(mixed) / 3 * np.eye(3))
        relaxed = module.evaluate(F, np.zeros(module.STATE), np.inf, *moduli)[1]
        assert np.allclose(P - relaxed, over, rtol=0, atol=1e-6)


@needs_gfortran
def test_umat(source, course, tmp_path):
    umat = UMAT(source, tmp_path)
    state = np.zeros(source.n_state)
    for duration, F, kirchhoff in zip(*course, strict=True):
        stress, *_ = umat(F, 6, state, duration)
        exact = kirchhoff[II, JJ] / np.linalg.det(F)
        assert abs(stress - exact).max() <= 1e-9 * max(abs(exact).max(), source.law.shear_modulus)
    F = 0.97 * F + 0.05 * np.eye(3)[::-1]
    order = np.arange(6)

    def kirchhoff(G):
        values = umat(G, 6, state.copy(), 0.3)[0] * np.linalg.det(G)
        return values[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]

    tangent = umat(F, 6, state.copy(), 0.3)[1]
    difference = tangent - jaumann(kirchhoff, F, order) / np.linalg.det(F)
    assert abs(difference).max() <= 1e-7 * abs(tangent).max()


@needs_gfortran
def test_umat_of_sheets_finds_the_thickness(tmp_path):
    law = remembering("gent", "both")
    umat = UMAT(source_of_law(law), tmp_path)
    state = np.zeros(umat_size := source_of_law(law).n_state)
    assert umat_size == 19
    for duration, (*stretches, kirchhoff) in zip(
        np.diff(TIMES, prepend=0.0), straight(law), strict=True
    ):
        stress, *_ = umat(np.diag(stretches[:2]), 3, state, duration)
        exact = kirchhoff / np.prod(stretches)
        assert np.allclose(stress, [exact, 0, 0], rtol=0, atol=1e-8 * law.shear_modulus)


def test_checks_of_files_know_the_durations(tmp_path):
    path = written(source_of_law(remembering("yeoh", "both")), "felupe", tmp_path)
    text = path.read_text()
    path.write_text(text.replace("0.32, 2.0]", "0.32, 2.001]"))
    assert path.read_text() != text
    assert subprocess.run([sys.executable, path], capture_output=True).returncode == 1


@pytest.mark.parametrize("target", ["ufl", "c"])
def test_energies_alone_are_refused(target):
    with raising(r"an energy alone has no memory.*branches and softening"):
        exported(source_of_law(remembering("gent", "both")), target)


def test_times_that_depend_on_the_overstress_are_refused():
    branch = Branch(0.5, 2.0, ((0.1, 2.0), (1.0, 0.1)))
    with raising("depend on the overstress are not exported"):
        exported(source_of_law(pds.materials.NeoHookean(memory=Memory((branch,)))), "felupe")


def test_learned_energies_of_sheets_are_refused():
    source = source_of_artifact("neo-hookean-energy")
    law = pds.materials.NeoHookean(memory=MEMORIES["branches"])
    with raising("has no thickness"):
        exported(type(source)(source.title, law, source.network, ()), "umat")


def test_a_learned_isochoric_energy_remembers(tmp_path):
    found = source_of_artifact("neo-hookean-isochoric")
    law = type(found.law)(
        **{key: getattr(found.law, key) for key in found.law.defaults()}, memory=MEMORIES["both"]
    )
    source = type(found)(found.title, law, found.network, ())
    subprocess.run([sys.executable, written(source, "felupe", tmp_path)], check=True)
    text = exported(source, "umat")
    assert max(map(len, text.splitlines())) <= 72
    assert "STATEV(2:20)" in text
    assert re.search(r"STATEV\(2:20\) = NEW", text)
