"""References for rubber with memory, which no model of the package computes: homogeneous histories
by SciPy at 1e-10, the vibration of a linear viscoelastic bar, and finite elements (`ELEMENTS`).
"""

import itertools
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.polynomial import Polynomial
from scipy.integrate import solve_ivp
from scipy.special import erf

from pdsurrogate.materials import Branch, Memory, NeoHookean, Softening

ELEMENTS = json.loads(
    (Path(__file__).parents[1] / "pipelines" / "data" / "memory.json").read_text("utf-8")
)
"""Figures of FElupe, made by pipelines/memory_elements.py."""

MODES = {
    "uniaxial": (0, None, None),
    "equibiaxial": (0, 0, None),
    "pure-shear": (0, 1, None),
    "plane-strain": (0, None, 1),
}
"""Index of the given value of each axis: 0 the stretch of the program, 1 the stretch 1; the others
are free of stress.
"""


@dataclass(frozen=True)
class Rubber:
    """Neo-Hookean rubber with U = K/8 (J - 1/J)^2, branches (modulus, time) and softening (r, m,
    beta). Branches may be faster by a `factor` of their overstresses (n).
    """

    mu: float = 1.0
    K: float = 100.0
    branches: tuple = ()
    softening: tuple | None = None
    factor: Callable = np.ones_like

    def eta(self, W, peak):
        """Factor of Ogden and Roxburgh."""
        if self.softening is None:
            return 1.0
        r, m, beta = self.softening
        return 1 - erf((max(peak, W) - W) / (m + beta * max(peak, W))) / r

    def solve(self, given, stress, C, peak, start=0.0):
        """Logarithms of stretches at given ones (NaN: a free axis) and, if not None, a nominal
        stress along the axes whose given values are -inf, by Newton's method from `start`. After a
        step of 1e-8 the error is one of rounding.
        """
        e = np.where(np.isfinite(given), given, start)
        free = np.flatnonzero(~np.isfinite(given))
        loaded = np.isneginf(given)
        for _ in range(200):
            tau, slope = self.kirchhoff(e, C, peak)
            residual = tau - np.where(loaded, (stress or 0.0) * np.exp(e), 0.0)
            slope = slope - np.diag(np.where(loaded, (stress or 0.0) * np.exp(e), 0.0))
            step = np.linalg.solve(slope[np.ix_(free, free)], residual[free]) if len(free) else []
            e[free] -= np.clip(step, -0.2, 0.2)
            if not len(free) or np.abs(step).max() < 1e-8:
                break
        return e

    def kirchhoff(self, e, C, peak):
        """Principal Kirchhoff stresses, and their derivatives by the logarithms of stretches."""
        J, deviator = np.exp(e.sum()), np.eye(3) - 1 / 3
        Cbar = np.exp(2 * (deviator @ e))
        W = self.mu / 2 * (Cbar.sum() - 3)
        x = self.mu * Cbar
        dW = deviator @ x
        eta = self.eta(W, peak)
        curvature = 0.0
        if self.softening is not None and peak > W:
            r, m, beta = self.softening
            width = m + beta * peak
            curvature = 2 / np.sqrt(np.pi) / r / width * np.exp(-(((peak - W) / width) ** 2))
        sum_of_branches = sum(
            (m * Cbar / c for (m, _), c in zip(self.branches, C, strict=True)), 0 * x
        )
        total = eta * x + sum_of_branches
        p = self.K / 4 * (J**2 - J**-2)
        slope = deviator @ np.diag(2 * total) @ deviator + curvature * np.outer(dW, dW)
        slope += self.K / 2 * (J**2 + J**-2)
        return deviator @ total + p, slope

    def history(self, mode, times, values, at, control="stretch"):
        """Course of a homogeneous deformation from rest, piecewise linear in time: rows of
        stretches (3), nominal stresses (3) and dissipated energy per volume at the times `at`.

        With control "stretch" `values` are stretches along the first axis, with "stress" nominal
        stresses there. A time that occurs twice is a sudden change. Softening needs values whose
        energies rise or fall between two times.
        """
        axes, n = MODES[mode], len(self.branches)
        taus = np.array([tau for _, tau in self.branches])
        moduli = np.array([modulus for modulus, _ in self.branches])

        near = np.zeros(3)

        def state(value, C, peak):
            nonlocal near
            loads = {0: -np.inf if control == "stress" else np.log(max(value, 1e-9)), 1: 0.0}
            given = np.array([loads.get(axis, np.nan) for axis in axes])
            near = self.solve(given, value if control == "stress" else None, C, peak, near)
            return near

        def cbar(e):
            return np.exp(2 * (e - e.mean()))

        y, peak, rows = np.zeros(3 * n + 1), 0.0, {}

        def row(y, value):
            C = np.exp(y[:-1].reshape(n, 3))
            e = state(value, C, peak)
            tau = self.kirchhoff(e, C, peak)[0]
            return np.r_[np.exp(e), tau * np.exp(-e), y[-1]], self.mu / 2 * (cbar(e).sum() - 3)

        def rate(t, y, begin, end, first, last):
            C = np.exp(y[:-1].reshape(n, 3))
            value = first + (last - first) * (t - begin) / (end - begin)
            overstress = cbar(state(value, C, peak)) / C
            overstress -= overstress.mean(axis=1, keepdims=True)
            squares = (overstress**2).sum(axis=1) / 2
            rates = self.factor(moduli * np.sqrt(squares)) / taus
            return np.r_[(overstress * rates[:, None]).ravel(), (moduli * rates * squares).sum()]

        for (begin, end), (first, last) in zip(
            itertools.pairwise(times), itertools.pairwise(values), strict=True
        ):
            stops = [t for t in at if begin < t <= end]
            if end > begin and n:
                found = solve_ivp(
                    rate,
                    (begin, end),
                    y,
                    "LSODA",
                    t_eval=sorted({*stops, end}),
                    args=(begin, end, first, last),
                    rtol=1e-10,
                    atol=1e-12,
                )
                states = dict(zip(found.t, found.y.T, strict=True))
                y = states[end]
            else:
                states = dict.fromkeys([*stops, end], y)
            for t in stops:
                rows[t], _ = row(states[t], first + (last - first) * (t - begin) / (end - begin))
            peak = max(peak, row(y, last)[1])
            if begin == end in at:
                rows[end] = row(y, last)[0]
        return np.array([rows[t] if t in rows else row(np.zeros_like(y), values[0])[0] for t in at])


def integrated(Cbar, tau, at):
    """Internal variables (3, 3) of one branch, from rest, at times `at` of a history Cbar(t), whose
    axes may turn; the times must contain its kinks.
    """
    C, found = np.eye(3), []

    def rate(t, c):
        C, here = c.reshape(3, 3), Cbar(t)
        return ((here - np.trace(here @ np.linalg.inv(C)) / 3 * C) / tau).ravel()

    for begin, end in itertools.pairwise([0.0, *at]):
        if end > begin:
            C = solve_ivp(rate, (begin, end), C.ravel(), "LSODA", rtol=1e-11, atol=1e-13).y[:, -1]
            C = C.reshape(3, 3)
        found.append(C)
    return np.array(found)


def vibration(wave_number, density, K, mu, branches, kind="bar"):
    """Complex frequency s of free vibration, exp(s t), of the given wave number in a linear
    viscoelastic bar with free sides ("bar") or in shear ("shear").
    """
    s = Polynomial([0.0, 1.0])
    below = Polynomial([1.0])
    for _, tau in branches:
        below *= 1 + tau * s
    above = mu * below
    for modulus, tau in branches:
        above += modulus * tau * s * (below // (1 + tau * s))
    if kind == "shear":
        stiffness, scale = above, below
    else:
        stiffness, scale = 9 * K * above, 3 * K * below + above
    roots = (density * s * s * scale + wave_number**2 * stiffness).roots()
    return max(roots, key=lambda root: root.imag)


def law_of(rubber):
    """Return the law of a `Rubber`."""
    memory = Memory(
        tuple(Branch(*each) for each in rubber.branches),
        rubber.softening and Softening(*rubber.softening),
    )
    return NeoHookean(shear_modulus=rubber.mu, bulk_modulus=rubber.K, memory=memory)


def divided(knots, values, parts):
    """Return times and values of a piecewise linear program with steps of 1 / parts."""
    times, found = [knots[0]], [values[0]]
    for first, last, begin, end in zip(knots, knots[1:], values, values[1:], strict=False):
        n = max(1, round((last - first) * parts))
        times.extend(np.linspace(first, last, n + 1)[1:])
        found.extend(np.linspace(begin, end, n + 1)[1:])
    return np.array(times), np.array(found)


def at_knots(times, values, knots):
    """Return the last of the values at each knot."""
    return np.array([values[np.flatnonzero(np.isclose(times, t))[-1]] for t in knots])
