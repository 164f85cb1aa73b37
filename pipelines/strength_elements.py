"""Finite elements of sheets with cuts, holes and notches: when Griffith's law, the rule of discs
and the coupled criterion break them. Nothing of this package is used.

Sheets are neo-Hookean (K = 20 mu) under plane stress, pulled between rollers; lengths are in
l_c = G / W_b. Triangles are linear, of half a sheet (y >= 0) that is graded toward the cut.
"""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import ConvexHull

BULK = 20.0
TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
DISC = np.stack(np.meshgrid(*2 * [np.arange(-24, 24) / 24 + 1 / 48]), axis=-1).reshape(-1, 2)
DISC = DISC[np.hypot(*DISC.T) <= 1]
"""Samples of a disc of radius 1."""


def energy(trace, J):
    """Energy density by tr C and det F, with its derivatives: at the volume ratio j of P33 = 0."""
    j = np.ones_like(J)
    for _ in range(30):
        slope = -trace / 3 * j ** (-5 / 3) + 2 / 3 * j ** (1 / 3) / J**2
        slope += BULK / 4 * (j - 1 / j) * (1 + j**-2)
        bend = 5 / 9 * trace * j ** (-8 / 3) + 2 / 9 * j ** (-2 / 3) / J**2
        bend += BULK / 4 * ((1 + j**-2) ** 2 - 2 * (j - 1 / j) * j**-3)
        j = j - np.clip(slope / bend, -j / 2, j)
    psi = (trace * j ** (-2 / 3) + j ** (4 / 3) / J**2 - 3) / 2 + BULK / 8 * (j - 1 / j) ** 2
    tj, Jj = -(j ** (-5 / 3)) / 3, -4 / 3 * j ** (1 / 3) / J**3
    seconds = -tj * tj / bend, -tj * Jj / bend, 3 * j ** (4 / 3) / J**4 - Jj * Jj / bend
    return psi, j ** (-2 / 3) / 2, -(j ** (4 / 3)) / J**3, *seconds


class Sheet:
    """Half of a sheet on a curvilinear grid of nodes X (n, m, 2), whose rows begin at the cut, hole
    or notch and at the line ahead of it; `quarter` if x = 0 is a line of symmetry too.
    """

    def __init__(self, X, quarter=False):
        n, m = X.shape[:2]
        number = np.arange(n * m).reshape(n, m)
        a, b, c, d = (
            q.ravel() for q in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
        )
        even = np.add.outer(np.arange(n - 1), np.arange(m - 1)).ravel() % 2 == 0
        halves = ((a, a), (b, b), (c, d)), ((a, b), (c, c), (d, d))
        self.T = T = np.concatenate(
            [np.stack([np.where(even, *q) for q in half], axis=1) for half in halves]
        )
        self.X = X = X.reshape(-1, 2)
        D = np.stack([X[T[:, 1]] - X[T[:, 0]], X[T[:, 2]] - X[T[:, 0]]], axis=2)
        inverse = np.linalg.inv(D)
        self.g = np.stack([-inverse.sum(axis=1), *inverse.transpose(1, 0, 2)], axis=1)
        self.B = np.einsum("ik,taj->tijak", np.eye(2), self.g).reshape(len(T), 4, 6)
        self.A, self.centers = np.abs(np.linalg.det(D)) / 2, X[T].mean(axis=1)
        self.dofs = (2 * T[:, :, None] + [0, 1]).reshape(len(T), 6)
        self.free = np.ones(X.shape, dtype=bool)
        self.free[X[:, 1] > X[:, 1].max() - 1e-9, 1] = False
        self.free[np.abs(X[:, 0]) < 1e-9 if quarter else np.argmax(X[:, 0] - X[:, 1]), 0] = False

    def stretched(self, x):
        """F, its cofactor, and the energy density with its derivatives."""
        F = np.einsum("tai,taj->tij", x[self.T], self.g)
        trace, J = np.square(F).sum(axis=(1, 2)), np.linalg.det(F)
        return F, TURN @ F @ TURN.T, energy(trace, J)

    def equilibrium(self, x, free):
        """Newton's method; steps lower the energy and turn no triangle over."""
        at = np.flatnonzero(free)
        rows, columns = np.repeat(self.dofs, 6, axis=1).ravel(), np.tile(self.dofs, (1, 6)).ravel()
        for _ in range(100):
            F, cof, (_, t, j, tt, tj, jj) = self.stretched(x)
            f, c = F.reshape(-1, 4, 1), cof.reshape(-1, 4, 1)
            t, j, tt, tj, jj = np.array([t, j, tt, tj, jj])[:, :, None, None]
            r = (self.B.mT @ (2 * t * f + j * c))[:, :, 0] * self.A[:, None]
            r = np.bincount(self.dofs.ravel(), r.ravel())[at]
            C = 2 * t * np.eye(4) + j * np.kron(TURN, TURN) + 4 * tt * f @ f.mT
            C += 2 * tj * (f @ c.mT + c @ f.mT) + jj * c @ c.mT
            K = self.B.mT @ C @ self.B * self.A[:, None, None]
            K = sparse.csc_matrix((K.ravel(), (rows, columns)))[at][:, at]
            step = np.zeros(x.size)
            step[at] = -splu(K, permc_spec="MMD_AT_PLUS_A").solve(r)
            step = step.reshape(-1, 2)
            least, whole = self.least_and_energy(x)
            whole_step = np.abs(step).max()
            for _ in range(12):
                near, after = self.least_and_energy(x + step)
                if near > min(0.02, least / 2) and after <= whole * (1 + 1e-9):
                    break
                step /= 2
            x = x + step
            if whole_step < 1e-7:
                return x
        raise ValueError("no equilibrium")

    def least_and_energy(self, x):
        """Least det F, and the energy."""
        F = np.einsum("tai,taj->tij", x[self.T], self.g)
        J = np.linalg.det(F)
        if J.min() <= 0:
            return J.min(), np.inf
        return J.min(), energy(np.square(F).sum(axis=(1, 2)), J)[0] @ self.A

    def means(self, W, places, R, inside):
        """Means of W over discs around places of y = 0; what is not inside the sheet counts as
        empty within the hull of the rest.
        """
        for place in places:
            away = np.hypot(self.centers[:, 0] - place, self.centers[:, 1])
            part = np.clip((R - away) / np.sqrt(2 * self.A) + 0.5, 0, 1) * self.A
            samples = R * DISC + [place, 0.0]
            there = inside(samples)
            hull = ConvexHull(samples[there]).equations
            whole = (samples @ hull[:, :2].T + hull[:, 2] <= 1e-9).all(axis=1)
            yield part @ W / part.sum() * there.sum() / whole.sum()


def graded(h, fine, length, ratio=1.15):
    """Lines from 0 to a length, h apart up to `fine`, then ever farther apart."""
    lines, step = [0.0], h
    while lines[-1] < length:
        step *= 1.0 if lines[-1] < fine else ratio
        lines.append(lines[-1] + step)
    return np.array(lines) * length / lines[-1]


def cut(a, size, h):
    """Nodes of a sheet with an edge cut."""
    left, right = (graded(h, min(0.6, a), one) for one in (a, size[0] - a))
    x = np.append(a - left[:0:-1], a + right)
    return np.stack(np.meshgrid(x, graded(h, 0.6, size[1] / 2), indexing="ij"), axis=-1)


def notch(a, radius, size, h):
    """Nodes of a sheet with a notch of a round end, or with half a hole of a = radius."""
    width, height = size[0], size[1] / 2
    turn = np.linspace(np.pi / 2, 0, int(np.ceil(np.pi / 2 * radius / h)) + 1)
    arc = np.stack([a - radius + radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    flat = graded(h, 0.6, a - radius)[:0:-1] if a > radius else np.empty(0)
    straight = np.stack([a - radius - flat, radius + 0 * flat], axis=1)
    reach = np.array([width - a + radius, height])
    way = np.stack([np.cos(turn), np.sin(turn)], axis=1) / reach
    outer = [a - radius, 0] + way * reach / way.max(axis=1)[:, None]
    corner = np.abs(way[:, 0] - way[:, 1]).argmin()
    outer[corner] = width, height
    inner = np.concatenate([straight, arc])
    outer = np.concatenate([np.stack([straight[:, 0], height + 0 * flat], axis=1), outer])
    part = graded(h, 0.6, height - radius)[None, :, None] / (height - radius)
    return inner[:, None] + part * (outer - inner)[:, None]


def crossing(stretches, values):
    """Stretch at which values reach 1, or none."""
    at = int(np.argmax(np.array(values) >= 1))
    if not at:
        return None
    low, high = np.log(values[at - 1 : at + 1])
    return stretches[at - 1] - low / (high - low) * (stretches[at] - stretches[at - 1])


def pulled(sheet, tip, stretches):
    """Equilibria at stretches, with the nodes ahead of a tip, and what is free."""
    X = sheet.X
    ahead = np.flatnonzero((X[:, 1] < 1e-9) & (X[:, 0] > tip - 1e-9))
    ahead = ahead[np.argsort(X[ahead, 0])]
    free = sheet.free.copy()
    free[ahead, 1] = False
    x, last, side = X.copy(), 1.0, X[:, 0].max()
    for stretch in stretches:
        for one in np.geomspace(last, stretch, int(np.ceil(np.log(stretch / last) / 0.12)) + 1)[1:]:
            x[:, 1] *= one / last
            x[free[:, 0], 0] = side + (x[free[:, 0], 0] - side) * (last / one) ** 0.5
            last = one
            x = sheet.equilibrium(x, free)
        yield x, ahead, free


def onset(sheet, tip, stretches, work, R, inside, length=None):
    """Stretches at which Griffith's law breaks a cut of a `length`, or the edge of a hole has the
    work at break; at which a disc around a point that has the work at break has it in the mean;
    and at which the coupled criterion holds: the work at break over some length, on which as much
    energy is released as tears take.
    """
    X, rows = sheet.X, []
    for x, ahead, free in pulled(sheet, tip, stretches):
        W, t = sheet.stretched(x)[2][0] / work, sheet.T.ravel()
        ends = np.bincount(t, np.repeat(W * sheet.A, 3)) / np.bincount(t, np.repeat(sheet.A, 3))
        over = np.append(ends[ahead] >= 1, False)
        over[0] |= length is not None
        over = min(int(np.argmin(over)), len(ahead) - 2)
        near = ahead[X[ahead, 0] < tip + 0.6]
        means = np.fromiter(sheet.means(W, X[near, 0], R, inside), dtype=float)
        own = np.where(length and near == near[0], np.inf, ends[near])
        rule = np.minimum(means, own).max()

        def released(nodes, x=x, W=W, ahead=ahead, free=free):
            torn = free.copy()
            torn[ahead[:nodes], 1] = True
            try:
                less = W - sheet.stretched(sheet.equilibrium(x, torn))[2][0] / work
            except ValueError:
                return np.nan  # elements at the new tip turn over
            return 2 * less @ sheet.A / (X[ahead[nodes], 0] - tip)

        first = released(1) if length else ends[ahead[0]]
        rows.append((first, rule, released(over) if over else 0.0))
        if min(rows[-1][1:]) >= 1 and (rows[-1][0] >= 1 or not length):
            break
    return [crossing(stretches, list(one)) for one in zip(*rows, strict=True)]
