"""Finite elements of sheets with cuts, holes and notches: when Griffith's law, the rule of discs
and the coupled criterion break them, and means over discs around the tip of a cut without end.
Nothing of this package is used.

Sheets are neo-Hookean (K = 20 mu) under plane stress, pulled between rollers; lengths are in
l_c = G / W_b. Triangles are linear, of half a sheet (y >= 0) that is graded toward the cut.
"""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import ConvexHull

BULK = 20.0
LAWS = {
    "neo-hookean": lambda i: (i / 2, 0.5 + 0 * i, 0 * i),
    "yeoh": lambda i: (
        i / 2 - 0.005 * i**2 + 0.000125 * i**3,
        0.5 - 0.01 * i + 0.000375 * i**2,
        0.00075 * i - 0.01,
    ),
}
"""Energy densities of I1 - 3, of a volume ratio of 1, with two derivatives; mu is 1."""
SHIFTS = np.linspace(0, 0.6, 13)
"""Centers of discs ahead of a tip, over their radii."""
TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
DISC = np.stack(np.meshgrid(*2 * [np.arange(-24, 24) / 24 + 1 / 48]), axis=-1).reshape(-1, 2)
DISC = DISC[np.hypot(*DISC.T) <= 1]
"""Samples of a disc of radius 1."""


def rubber(bulk=BULK, law="neo-hookean", plane="stress"):
    """A function of tr C and det F in the plane that gives the energy density with its derivatives:
    in plane stress at the volume ratio j of P33 = 0.
    """

    def by(i, one, two, j):
        """Energy density, two derivatives by the invariant, and those by j of the volume."""
        psi, first, second = LAWS[law](i - 3)
        U = bulk / 8 * (j - 1 / j) ** 2
        slope = first * one + bulk / 4 * (j - 1 / j) * (1 + j**-2)
        bend = second * one * one + first * two
        bend += bulk / 4 * ((1 + j**-2) ** 2 - 2 * (j - 1 / j) * j**-3)
        return psi + U, first, second, slope, bend

    def strained(trace, J):
        t, i = J ** (-2 / 3), (trace + 1) * J ** (-2 / 3)
        one, two = -2 / 3 * i / J, 10 / 9 * i / J**2
        psi, first, second, slope, bend = by(i, one, two, J)
        mixed = second * t * one - 2 / 3 * first * t / J
        return psi, first * t, slope, second * t * t, mixed, bend

    def stressed(trace, J):
        j = np.ones_like(J)
        for _ in range(40):
            t, power = j ** (-2 / 3), j ** (4 / 3) / J**2
            one = (-2 / 3 * trace * t + 4 / 3 * power) / j
            two = (10 / 9 * trace * t + 4 / 9 * power) / j**2
            psi, first, second, slope, bend = by(trace * t + power, one, two, j)
            j = j - np.clip(slope / bend, -j / 2, j / 2)
        of_J, t_j, J_j = -2 * power / J, -2 / 3 * t / j, -8 / 3 * power / J / j
        t_j, J_j = second * t * one + first * t_j, second * of_J * one + first * J_j
        mixed, last = second * t * of_J, second * of_J**2 + 6 * first * power / J**2
        seconds = second * t * t - t_j**2 / bend, mixed - t_j * J_j / bend, last - J_j**2 / bend
        return psi, first * t, first * of_J, *seconds

    return {"stress": stressed, "strain": strained}[plane]


SOFT = rubber()


class Sheet:
    """Half of a sheet on a curvilinear grid of nodes X (n, m, 2), whose rows begin at the cut, hole
    or notch and at the line ahead of it; `quarter` if x = 0 is a line of symmetry too.
    """

    def __init__(self, X, quarter=False, energy=SOFT):
        self.energy, self.scale = energy, 1.0
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
        """F, its cofactor and determinant, and the energy density with its derivatives."""
        F = np.einsum("tai,taj->tij", x[self.T], self.g)
        trace, J = np.square(F).sum(axis=(1, 2)), np.linalg.det(F)
        with np.errstate(all="ignore"):  # of elements that turn over
            return F, TURN @ F @ TURN.T, J, self.energy(trace, J)

    def residual(self, x, at):
        """Forces on free components, what stiffnesses are made of, energy and least det F; forces
        are none where a triangle turns over or has no state.
        """
        F, cof, J, found = self.stretched(x)
        if J.min() <= 0 or not np.isfinite(found).all():
            return None, None, np.inf, J.min()
        t, j, *seconds = np.array(found[1:])[:, :, None, None]
        f, c = F.reshape(-1, 4, 1), cof.reshape(-1, 4, 1)
        r = (self.B.mT @ (2 * t * f + j * c))[:, :, 0] * self.A[:, None]
        r = np.bincount(self.dofs.ravel(), r.ravel())[at]
        return r, (t, j, *seconds, f, c), found[0] @ self.A, J.min()

    def equilibrium(self, x, free):
        """Newton's method; steps lower the energy, or the slope along them where rounding hides
        that, and turn no triangle over.
        """
        at = np.flatnonzero(free)
        rows, columns = np.repeat(self.dofs, 6, axis=1).ravel(), np.tile(self.dofs, (1, 6)).ravel()
        r, parts, whole, least = self.residual(x, at)
        for _ in range(100):
            if r is None:
                break
            t, j, tt, tj, jj, f, c = parts
            C = 2 * t * np.eye(4) + j * np.kron(TURN, TURN) + 4 * tt * f @ f.mT
            C += 2 * tj * (f @ c.mT + c @ f.mT) + jj * c @ c.mT
            K = self.B.mT @ C @ self.B * self.A[:, None, None]
            K = sparse.csc_matrix((K.ravel(), (rows, columns)))[at][:, at]
            step, part = np.zeros(x.size), 1.0
            step[at] = -splu(K, permc_spec="MMD_AT_PLUS_A").solve(r)
            slope = abs(step[at] @ r)
            step *= -np.sign(step[at] @ r)  # down also where the stiffness is not positive
            while part > 1e-4:
                r, parts, after, near = self.residual(x + part * step.reshape(-1, 2), at)
                lower = after <= whole * (1 + 1e-9)
                if r is not None and after <= whole + 1e-14 * self.A.sum():
                    lower |= abs(step[at] @ r) <= 0.9 * slope + 1e-12
                if lower and near > min(0.02, least / 2):
                    break
                part /= 2
            x, whole, least = x + part * step.reshape(-1, 2), after, near
            if np.abs(step.reshape(-1, 2) / self.scale).max() < 1e-7:
                return x
        raise ValueError("no equilibrium")

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


class Tip(Sheet):
    """Half of the surroundings of the tip of a cut without end; mu is 1, and G rises to 1."""

    def __init__(self, bulk, law, plane, parts=48, inner=1e-4, outer=1e3):
        angles = np.linspace(0, np.pi, parts + 1)
        radii = np.geomspace(inner, outer, 1 + int(np.log(outer / inner) * parts / np.pi))
        around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        super().__init__(radii[:, None, None] * around, energy=rubber(bulk, law, plane))
        nu = (3 * bulk - 2) / (6 * bulk + 2)
        kappa = (3 - nu) / (1 + nu) if plane == "stress" else 3 - 4 * nu
        r = np.hypot(*self.X.T)
        half = np.arctan2(self.X[:, 1], self.X[:, 0]) / 2
        size = np.sqrt(r / np.pi / (kappa + 1)) * (kappa - np.cos(2 * half))
        self.williams = size[:, None] * np.stack([np.cos(half), np.sin(half)], axis=1)
        self.scale = np.sqrt(r)[:, None]
        self.free[:] = (r < outer * (1 - 1e-9))[:, None]
        self.free[half == 0, 1] = False
        self.radii = np.geomspace(50 * inner, outer / 8, 100)

    def solved(self):
        """The equilibrium at G = 1, from states of smaller ones."""
        last = here = self.X
        G, before = 0.006 * self.radii[0], 0.0
        while before < 1:
            guess = here + (here - last) / 2 if before else here
            x = np.where(self.free, guess, self.X + G**0.5 * self.williams)
            last, here = here, self.equilibrium(x, self.free)
            G, before = min(1.0, 1.4 * G), G
        return here

    def factors(self, works):
        """Factors c by the works at break: pi R W_b / G for the radius R of discs of which the one
        with the greatest mean of the energy density has W_b.
        """
        F, cof, _, found = self.stretched(self.solved())
        stress = 2 * found[1][:, None, None] * F + found[2][:, None, None] * cof
        slopes = found[0][:, None] * [1, 0] - np.einsum("tij,ti->tj", stress, F[:, :, 0] - [1, 0])
        within = np.clip(2 - np.hypot(*self.X.T), 0, 1)
        rate = -2 * np.einsum("ta,taj,tj,t", within[self.T], self.g, slopes, self.A)
        means = [
            max(
                next(self.means(found[0], [shift * R], R, lambda at: at[:, 0] < np.inf))
                for shift in SHIFTS
            )
            for R in self.radii
        ]
        radii = np.exp(np.interp(-np.log(works), -np.log(means), np.log(self.radii)))
        return np.pi * radii * works / rate


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


def released(sheet, x, ahead, free):
    """Energy of the whole sheet that is released if a cut grows to the last of the nodes ahead. The
    triangles are the same again after two nodes, so that an odd number of them is 5 % off.
    """
    torn = free.copy()
    torn[ahead[:-1], 1] = True
    try:
        after = sheet.equilibrium(x, torn)
    except ValueError:
        return np.nan  # elements at the new tip turn over
    return 2 * (sheet.stretched(x)[3][0] - sheet.stretched(after)[3][0]) @ sheet.A


def onset(sheet, tip, stretches, work, R, inside, length=None):
    """Stretches at which Griffith's law breaks a cut of a `length`, or the edge of a hole has the
    work at break; at which a disc around a point that has the work at break has it in the mean;
    and at which the coupled criterion holds: the work at break over some length, on which as much
    energy is released as tears take.
    """
    X, rows = sheet.X, []
    for x, ahead, free in pulled(sheet, tip, stretches):
        W, t = sheet.stretched(x)[3][0] / work, sheet.T.ravel()
        ends = np.bincount(t, np.repeat(W * sheet.A, 3)) / np.bincount(t, np.repeat(sheet.A, 3))
        over = np.append(ends[ahead] >= 1, False)
        over[0] |= length is not None
        over = min(int(np.argmin(over)), len(ahead) - 2)
        near = ahead[X[ahead, 0] < tip + 0.6]
        means = np.fromiter(sheet.means(W, X[near, 0], R, inside), dtype=float)
        own = np.where(length and near == near[0], np.inf, ends[near])
        rule = np.minimum(means, own).max()
        over += over % 2
        gained = [
            released(sheet, x, ahead[: nodes + 1], free) / work / (X[ahead[nodes], 0] - tip)
            for nodes in (2, over)[: 1 + (over > 0)]
        ]
        first = gained[0] if length else ends[ahead[0]]
        rows.append((first, rule, gained[1] if over else 0.0))
        if min(rows[-1][1:]) >= 1 and (rows[-1][0] >= 1 or not length):
            break
    return [crossing(stretches, list(one)) for one in zip(*rows, strict=True)]
