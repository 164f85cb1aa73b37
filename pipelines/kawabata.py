"""How well energies foretell Kawabata's biaxial grid, stress by stress, and what limits it; tables for bring_your_own.py."""

from __future__ import annotations

from itertools import permutations
from math import comb, factorial

import numpy as np
from pages import markdown_table
from scipy.optimize import linprog
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

import pdsurrogate as pds
from pdsurrogate.identification import fitted_laws
from pdsurrogate.identification.energy import half_planes, ordered_logs
from pdsurrogate.learning.bond_force import stiffness_slopes

DATA = pds.load_test_data("kawabata")
X, Y = DATA.stretches, DATA.nominal_stress
LARGE = 0.05 * Y.max() < Y
"""Stresses whose relative error is asked for."""

HALF = np.arange(len(DATA)) // 2 % 2 == 0  # both stresses of a state go together
ALL = np.ones(len(DATA), dtype=bool)
TWO_MODES = (Y > 0) & ((np.abs(np.log(X[:, 1] * np.sqrt(X[:, 0]))) < 0.02) | (np.abs(X[:, 1] - 1) < 1e-9))
PARTS = {"uniaxial and pure shear": TWO_MODES, "half of the grid": HALF, "the other half": ~HALF, "the whole grid": ALL}
"""What is fitted; what is left out is asked for, or what was fitted where that is all."""

LIMIT = 0.05


def of_data() -> str:
    """The grid foretold from parts of it, by an energy without a law and by every law."""

    def scores(model) -> list[str]:
        row = []
        for known in parts.values():
            model.fit(X[known], Y[known])
            asked = ~known if not known.all() else known
            truth, found = Y[asked], model.predict(X[asked])
            r_squared = 1 - ((truth - found) ** 2).sum() / ((truth - truth.mean()) ** 2).sum()
            close = (np.abs(found - truth) <= LIMIT * truth)[LARGE[asked]].mean()
            row.append(f"{r_squared:.4f}, {100 * close:.0f} %")
        return row

    parts = {name: known for name, known in PARTS.items() if known is not PARTS["the other half"]}
    rows = [["`EnergyRegressor`", *scores(pds.identification.EnergyRegressor())]]
    rows += [[law, *scores(pds.identification.LawRegressor(law))] for law in fitted_laws() if law != "full-network"]
    return markdown_table(["model, fitted to", *parts], rows)


def errors_of(predicted: np.ndarray) -> np.ndarray:
    """Relative errors of the large stresses, NaN of the others."""
    return np.where(LARGE, predicted / np.where(LARGE, Y, 1) - 1, np.nan)


def asked_of(known: np.ndarray, model) -> np.ndarray:
    """Large stresses left out, or all of them, that lie within the hull of what was fitted to."""
    return LARGE & (~known if not known.all() else known) & (model.beyond(X) <= 0)


def stress_by_stress() -> str:
    """How far single stresses are from what the free energy foretells, its least stiffness, and what any energy could do."""
    rows, off, left_out = [], {}, np.full(len(Y), np.nan)
    for name, known in PARTS.items():
        model = pds.identification.EnergyRegressor().fit(X[known], Y[known])
        inside, off[name] = asked_of(known, model), errors_of(model.predict(X))
        sizes = np.sort(np.abs(off[name][inside]))
        if name in ("half of the grid", "the other half"):
            left_out[~known] = off[name][~known]
        # Where W is a sum over the stretches, its curvatures by their logarithms are those of the summands.
        stretch, curvature = np.geomspace(0.25, 4.0, 2001), np.full(1, np.nan)
        if all(term.kind == "stretches" for term in model.terms_):
            powers = [weight * stretch**term.number for term, weight in zip(model.terms_, model.weights_, strict=True)]
            curvature = sum(powers) / model.weights_.sum()
        slope = stiffness_slopes(
            pds.AnalyticBondForce(model.law_).bond_force, pds.training_samples(model.law_, 10_000, off_surface=0).X
        ).min()
        asked = LARGE & (~known if not known.all() else known)
        shares = [f"{100 * (sizes <= most).mean():.0f} %" for most in (0.03, LIMIT)]
        greatest = f"{100 * np.median(sizes):.1f} %, {100 * sizes[-1]:.0f} %"
        rows.append(
            [
                name,
                f"{inside.sum()} of {asked.sum()}",
                *shares,
                greatest,
                "" if np.isnan(curvature).any() else f"{curvature.min():.2f}",
                f"{slope:.3f}",
            ]
        )
    header = ["fitted to", "stresses in the hull", "error below 3 %", "error below 5 %", "median and largest error"]
    header += ["least curvature", "least slope"]
    alone = neighbors()
    parts = [
        markdown_table(header, rows),
        of_two_modes(off["uniaxial and pure shear"]),
        of_neighbors(alone, off["the whole grid"], left_out),
    ]
    return "\n\n".join([*parts, of_classes(np.abs(alone) > LIMIT)])


def of_two_modes(off: np.ndarray) -> str:
    """Where the energy of two modes is off."""
    model = pds.identification.EnergyRegressor().fit(X[TWO_MODES], Y[TWO_MODES])
    inside = asked_of(TWO_MODES, model)
    kinds = {
        "a lengthened side": X[:, 0] > 1 + 1e-9,
        "the side of constant length in pure shear": np.abs(X[:, 0] - 1) < 1e-9,
        "a shortened side": X[:, 0] < 1 - 1e-9,
    }
    rows = []
    for name, chosen in kinds.items():
        sizes = np.abs(off[inside & chosen])
        rows.append([name, str(len(sizes)), f"{100 * (sizes <= LIMIT).mean():.0f} %", f"{100 * sizes.max():.0f} %"])
    table = markdown_table(["predicted from uniaxial and pure shear: stress along", "number", "error below 5 %", "largest error"], rows)
    return (
        "Measurements of uniaxial tension and pure shear contain the stress along the stretched side only. The largest errors of the first "
        f"fit are therefore in the stress along the other side:\n\n{table}"
    )


def neighbors() -> np.ndarray:
    """Relative error of every large stress by a regression of the others over the two log-stretches that knows of no energy.

    Stresses are divided by those of a Neo-Hookean rubber of unit modulus first, which leaves numbers between 0.30 and 0.73.  Both stresses
    of a state are left out together; the kernel's scales and noise are those of the most likely fit to all.
    """
    rows = np.flatnonzero(LARGE)
    first, thickness, logs = X[rows, 0], 1 / X[rows].prod(axis=1), np.log(X[rows])
    reduced = Y[rows] * first / (first**2 - thickness**2)
    kernel = ConstantKernel() * RBF([0.5, 0.5]) + WhiteKernel(1e-3)
    kernel = GaussianProcessRegressor(kernel, normalize_y=True, n_restarts_optimizer=3, random_state=0).fit(logs, reduced).kernel_
    off, tests = np.full(len(Y), np.nan), DATA.tests[rows]
    for test in np.unique(tests):
        out = tests == test
        process = GaussianProcessRegressor(kernel, optimizer=None, normalize_y=True).fit(logs[~out], reduced[~out])
        off[rows[out]] = process.predict(logs[out]) / reduced[out] - 1
    return off


def of_neighbors(alone: np.ndarray, fitted: np.ndarray, left_out: np.ndarray) -> str:
    """Which measurements a regression of their neighbors misses, and which the energy."""
    found = {"regression of the others": alone, "energy, fitted to all": fitted, "energy, fitted to the other half": left_out}
    rows = [
        [name, *(f"{np.sum(np.abs(off[LARGE]) > most)}" for most in (0.03, LIMIT)), f"{100 * np.nanmax(np.abs(off)):.1f} %"]
        for name, off in found.items()
    ]
    counts = markdown_table([f"prediction of {LARGE.sum()} stresses", "error above 3 %", "error above 5 %", "largest error"], rows)
    missed = np.flatnonzero(np.nanmax(np.abs([np.where(LARGE, off, 0) for off in found.values()]), axis=0) > LIMIT)
    missed = missed[np.argsort(-np.abs(alone[missed]))]
    rows = [[f"({X[n, 0]:g}, {X[n, 1]:g})", f"{Y[n]:g}", *(f"{100 * off[n]:+.1f} %" for off in found.values())] for n in missed]
    return (
        "For comparison, a regression that uses no energy predicts each stress from the others: a Gaussian process of the two "
        "log-stretches for the stress divided by that of Neo-Hookean rubber, fitted without both stresses of the predicted state. The "
        "other rows are the energy fitted to all stresses, and the energy fitted to the half of the grid that does not contain the "
        f"stress:\n\n{counts}\n\nStresses for which one of the three predictions has an error above 5 %:\n\n"
        f"{markdown_table(['stretches', 'stress (MPa)', *found], rows)}"
    )


BASIS = np.array([[1, -1, 0], [1, 1, -2]]).T / np.sqrt([2, 6])
"""Orthonormal coordinates of the log-stretches of states that keep their volume: at rest W is as stiff in all directions of them."""


class SymmetricExponentials:
    """W as a sum of weights times symmetric sums of l1^p l2^q l3^r over all orders of the three exponents.

    Parameters
    ----------
    exponents : iterable of tuple of float
    """

    def __init__(self, exponents):
        self.terms = [np.array(sorted(set(permutations(one)))) for one in exponents]

    def stresses(self, stretches: np.ndarray) -> np.ndarray:
        """Nominal stresses of every term, shape (n, n_terms)."""
        logs = np.column_stack([np.log(stretches), -np.log(stretches).sum(axis=1)])
        return np.stack([np.exp(logs @ one.T) @ (one[:, 0] - one[:, 2]) for one in self.terms], axis=1) / stretches[:, :1]

    def curvatures(self, logs: np.ndarray, angle: float) -> np.ndarray:
        """Second derivatives of every term along a direction of `BASIS`, shape (n, n_terms)."""
        along = BASIS @ (np.cos(angle), np.sin(angle))
        return np.stack([np.exp(logs @ one.T) @ (one @ along) ** 2 for one in self.terms], axis=1)

    def least_curvature(self, weights: np.ndarray, side: float, order: int = 6) -> float:
        """A lower bound of the least curvature over the hull of the data, over its value at rest.

        Of every cell of a grid over the hull the Hessian at its center, less what Taylor's series lets it change in the cell: the norms
        of its derivatives up to an order, and the rest by the sizes of all terms.
        """
        centers, radius = grid(side) @ BASIS, side * np.sqrt(1.5)  # half of the diagonal of a cell, at most stretched by sqrt(3)
        derivatives = {n: np.zeros((n + 1, len(centers))) for n in range(2, order + 2)}
        rest = np.zeros(len(centers))
        for term, weight in zip(self.terms, weights, strict=True):
            exponents = term @ BASIS
            sizes, values = np.linalg.norm(exponents, axis=1), weight * np.exp(centers @ exponents.T)
            for n, tensor in derivatives.items():
                for j in range(n + 1):
                    tensor[j] += values @ (exponents[:, 0] ** (n - j) * exponents[:, 1] ** j)
            rest += np.abs(values) @ (sizes ** (order + 2) * np.exp(radius * sizes)) * radius**order / factorial(order)
        xx, xy, yy = derivatives[2]
        least = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
        for n in range(3, order + 2):
            norm = np.sqrt(sum(comb(n, j) * derivatives[n][j] ** 2 for j in range(n + 1)))
            least = least - radius ** (n - 2) / factorial(n - 2) * norm
        at_rest = sum(weight * ((term @ BASIS)[:, 0] ** 2).sum() for term, weight in zip(self.terms, weights, strict=True))
        return float((least - rest).min() / at_rest)


def grid(side: float) -> np.ndarray:
    """Log-stretches of centers of cells that cover the hull of the data, of states with their stretches in order, shape (n, 3)."""
    planes, logs = half_planes(X), ordered_logs(X)
    first, second = (np.arange(low, logs[:, n].max() + side, side) for n, low in enumerate((0.0, logs[:, 1].min() - side)))
    cells = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    third = -cells.sum(axis=1)
    near = (cells @ planes[:, :2].T + planes[:, 2]).max(axis=1) <= side
    cells = cells[near & (cells[:, 0] >= cells[:, 1] - side) & (cells[:, 1] >= third - side)]
    return np.column_stack([cells, -cells.sum(axis=1)])


def least_error(energy: SymmetricExponentials, known: np.ndarray, greatest: bool, positive: bool, convex: float = 0.0) -> np.ndarray:
    """Weights with the least greatest relative error of stresses, or the least sum of these, by a linear program.

    Weights may be held positive, or W to a curvature of at least so much (in MPa) in twelve directions on a grid.
    """
    columns = energy.stresses(X[known]) / Y[known, None]
    size = np.abs(columns).max(axis=0)
    rows, terms = columns.shape
    errors = np.ones((rows, 1)) if greatest else np.eye(rows)
    matrix = [np.hstack([columns / size, -errors]), np.hstack([-columns / size, -errors])]
    bounds = [np.ones(rows), -np.ones(rows)]
    if convex:
        curvature = np.vstack([energy.curvatures(grid(0.05), angle) for angle in np.pi * np.arange(12) / 12]) / size
        scale = np.abs(curvature).max(axis=1)
        matrix.append(np.hstack([-curvature / scale[:, None], np.zeros((len(scale), errors.shape[1]))]))
        bounds.append(-convex / scale)
    limits = [(0.0 if positive else None, None)] * terms + [(0.0, None)] * errors.shape[1]
    found = linprog(
        np.repeat([0.0, 1.0], (terms, errors.shape[1])),
        A_ub=np.vstack(matrix),
        b_ub=np.concatenate(bounds),
        bounds=limits,
        method="highs-ipm",
    )
    if found.x is None:
        raise ValueError(f"the linear program has no solution: {found.message}")
    return found.x[:terms] / size


def of_classes(scattered: np.ndarray) -> str:
    """What classes of energies could do at best, and what they foretell; with and without measurements that their neighbors deny."""
    powers = SymmetricExponentials((float(one), 0.0, 0.0) for one in (*np.arange(-6, -0.9, 0.25), *np.arange(1, 12.1, 0.25)))
    # Closer exponents, or more of them, differ by too little for weights of any sign.
    whole = SymmetricExponentials((float(one), 0.0, 0.0) for one in (*range(-4, 0), *range(1, 7)))
    classes = {"powers, nonnegative weights": (powers, True), "powers, Hencky-convex": (whole, False)}
    for most in (3, 4, 5):
        mixed = SymmetricExponentials((p, q, 0) for p in range(1, most + 1) for q in range(p + 1))
        classes[f"mixed powers up to {most}, Hencky-convex"] = (mixed, False)
    rows = []
    for name, (energy, positive) in classes.items():
        convex, row = 0.0 if positive else 0.1, [name, str(len(energy.terms))]
        for known in (LARGE, LARGE & ~scattered):
            weights = least_error(energy, known, True, positive, convex)
            off = errors_of(energy.stresses(X) @ weights)[known]
            row.append(f"{100 * np.abs(off).max():.1f} %")
            if known is LARGE:
                sides = (0.01 / 2**n for n in range(4))
                curvature = next((bound for side in sides if (bound := energy.least_curvature(weights, side)) > 0), np.nan)
        row.append(f"{curvature:.2f}")
        for half in (HALF, ~HALF):
            model = pds.identification.EnergyRegressor().fit(X[half], Y[half])  # for its hull
            weights = least_error(energy, LARGE & half, False, positive, convex)
            sizes = np.abs(errors_of(energy.stresses(X) @ weights)[asked_of(half, model)])
            row.append(f"{100 * (sizes <= LIMIT).mean():.0f} %, {100 * sizes.max():.0f} %")
        rows.append(row)
    header = ["class", "terms", "all", f"all but {scattered.sum()}", "least curvature"]
    header += ["predicted from one half", "from the other half"]
    return (
        "The last table shows the best possible fit of several classes of energies. *All* is the smallest possible value of the "
        f"largest relative error for all of these stresses, and *all but {scattered.sum()}* the same without the {scattered.sum()} "
        "stresses that the regression of the others misses by more than 5 %. *Least curvature* is a lower bound of the curvature of "
        "the first of these fits over the hull, divided by the curvature in the undeformed state. For the last two columns the "
        "weights minimize the sum of the relative errors in one half of the grid; the columns give the share of the other half with "
        "an error below 5 %, and its largest error. Mixed powers are sums of l1^p l2^q l3^r over all permutations, with p up to the "
        "given number; sums over the stretches and polynomials of the two invariants are special cases:\n\n"
        f"{markdown_table(header, rows)}"
    )
