"""Where materials meet the deformation gradient jumps: the jump, and the body as either material sees it."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from ..body import Body
from .kinematics import Kinematics

CENTRINGS = 3
"""Times that the straight interface beside a point is fitted, each time about the place found before."""

REACH = 2
"""Horizons about a place on an interface within which the slopes of either side are fitted.

With one alone the fit hangs on the three nearest rows, and points are seen where they would not move with their own displacement: beside a
material thirty times as stiff that leaves bond forces without equilibrium.  With two, `bimaterial` is as good, and a hundred times goes.
"""


class Interfaces:
    """Interfaces between the materials of a body, as far as they are straight within a horizon.

    Of two materials that are bonded F jumps by c (x) N across the interface, N its normal: the displacement is continuous, its slope
    along N is not.  Beside every point at an interface the jump c is the difference of two linear fits to the positions of either side,
    theory (54), a linear function of the positions.  It carries the motion of a material on beyond the interface: there the points of the
    other are seen where they would be if their side moved as this one.

    A point that sees more than two materials, or no straight interface, has none: c = 0 there, and its own place is seen by all.  In plane
    strain no point has one: errors of c make errors of det F, and K times those of the pressure.

    Parameters
    ----------
    body : Body
    kinematics : Kinematics
        Of the body.
    portion_of : ndarray of int, shape (n + m,)
        Material of every point and image.

    Attributes
    ----------
    depths : ndarray, shape (n + m,)
        Distance of the points from their interface; 0 of those that have none.
    normals : ndarray, shape (n + m, 2)
        From every point towards its interface.
    """

    def __init__(self, body: Body, kinematics: Kinematics, portion_of: np.ndarray) -> None:
        self._body = body
        n, total, bonds = len(body), len(body.all_points), body.bonds
        owners = np.repeat(np.arange(n), np.diff(bonds.pointers).astype(np.int64))
        across = np.flatnonzero(portion_of[owners] != portion_of[bonds.neighbours])
        self.depths, self.normals = np.zeros(total), np.zeros((total, 2))
        near = np.unique(np.concatenate([owners[across], _sources(body)[bonds.neighbours[across]]])) if kinematics.plane == "stress" else []
        rows, columns, values = [], [], []
        tree, everywhere = cKDTree(body.points), cKDTree(body.all_points)
        for i in near:
            found = _interface_beside(body, everywhere, portion_of, i)
            if found is None:
                continue
            depth, normal, other = found
            around = np.array(tree.query_ball_point(body.points[i] + depth * normal, REACH * body.horizon * (1 + 1e-9)))
            sides = [around[portion_of[around] == number] for number in (portion_of[i], other)]
            slopes = [_slope(body.points[side], body.volumes[side], normal) for side in sides]
            if slopes[0] is None or slopes[1] is None:
                continue
            self.depths[i], self.normals[i] = depth, normal
            for side, slope, sign in zip(sides, slopes, (-1, 1), strict=True):
                rows.append(np.full(len(side), i))
                columns.append(side)
                values.append(sign * slope)
        empty = [np.empty(0, dtype=np.int64)]
        entries = np.concatenate(values or [np.empty(0)]), (np.concatenate(rows or empty), np.concatenate(columns or empty))
        self._jump = sparse.csr_array(entries, shape=(n, n))
        self._jump_back = self._jump.T.tocsr()
        ghosts = body.ghosts
        body.ghosts.fill(self.depths)
        if len(ghosts):
            self.normals[n:] = ghosts.reflection * self.normals[ghosts.source]
        weights = kinematics.gradient_weights()[across] * self.depths[bonds.neighbours[across], None]
        shape = (n, total)
        self._corrections = [sparse.csr_array((weights[:, b], (owners[across], bonds.neighbours[across])), shape=shape) for b in (0, 1)]
        self._corrections_back = [matrix.T.tocsr() for matrix in self._corrections]
        self.jumps = np.zeros((total, 2))
        self.seen_positions, self.seen_gradients = np.zeros((total, 2)), np.zeros((total, 4))

    def correct(self, positions: np.ndarray, gradients: np.ndarray) -> None:
        """Find the jumps, and take from the points' gradients what they have of the other side.

        Parameters
        ----------
        positions : ndarray, shape (n + m, 2)
        gradients : ndarray, shape (n + m, 4)
            Of the points, as (11, 21, 12, 22), changed in place.
        """
        n, ghosts = len(self._body), self._body.ghosts
        self.jumps[:n] = self._jump @ positions[:n]
        if len(ghosts):
            self.jumps[n:] = ghosts.parity * self.jumps[ghosts.source]
        for b, matrix in enumerate(self._corrections):
            gradients[:n, 2 * b : 2 * b + 2] -= matrix @ self.jumps

    def see(self, positions: np.ndarray, gradients: np.ndarray) -> None:
        """Find places and gradients of all points as the other material sees them."""
        self.seen_positions[:] = positions - self.depths[:, None] * self.jumps
        self.seen_gradients[:] = gradients
        for b in (0, 1):
            self.seen_gradients[:, 2 * b : 2 * b + 2] += self.jumps * self.normals[:, b, None]

    def hand_on(self, forces: np.ndarray, moments: np.ndarray, own_moments: np.ndarray) -> np.ndarray:
        """Forces on the points from what an energy says about the jumps, shape (n, 2): the transpose of `correct` and `see`.

        Parameters
        ----------
        forces, moments : ndarray, shapes (n + m, 2) and (n + m, 4)
            Minus the derivative by the seen positions, and the derivative by the seen gradients.
        own_moments : ndarray, shape (n, 4)
            Derivative by the points' own gradients.
        """
        n, ghosts = len(self._body), self._body.ghosts
        on_jumps = -self.depths[:, None] * forces
        for b, matrix in enumerate(self._corrections_back):
            on_jumps -= moments[:, 2 * b : 2 * b + 2] * self.normals[:, b, None]
            on_jumps += matrix @ own_moments[:, 2 * b : 2 * b + 2]
        own = on_jumps[:n]
        if len(ghosts):
            np.add.at(own, ghosts.source, ghosts.parity * on_jumps[n:])
        return self._jump_back @ own


def _sources(body: Body) -> np.ndarray:
    return np.concatenate([np.arange(len(body)), body.ghosts.source.astype(np.int64)])


def _interface_beside(body: Body, tree: cKDTree, portion_of: np.ndarray, i: int) -> tuple[float, np.ndarray, int] | None:
    """Distance and direction of the straight interface beside a point, and the material beyond it; None where there is none."""
    points, volumes, own = body.all_points, body.all_volumes, portion_of[i]
    place = points[i]
    for _ in range(CENTRINGS):
        around = np.array(tree.query_ball_point(place, body.horizon * (1 + 1e-9)), dtype=np.int64)
        others = portion_of[around] != own
        kinds = np.unique(portion_of[around[others]])
        if len(kinds) != 1 or others.all():
            return None
        V = volumes[around]
        x = points[around] - V @ points[around] / V.sum()
        second = np.einsum("k,ka,kb->ab", V, x, x)
        if np.linalg.det(second) < 1e-3 * np.trace(second) ** 2:
            return None
        normal = np.linalg.solve(second, (V * (others - V @ others / V.sum())) @ x)
        normal /= np.linalg.norm(normal)
        # The line that leaves as much volume beyond it as the other material has.
        along = points[around] @ normal
        order = np.argsort(along, kind="stable")
        behind = np.searchsorted(np.cumsum(V[order]), V[~others].sum() * (1 + 1e-9))
        if not 0 < behind < len(order):
            return None
        depth = (along[order[behind - 1]] + along[order[behind]]) / 2 - points[i] @ normal
        place = points[i] + depth * normal
    return (float(depth), normal, int(kinds[0])) if depth > 0 else None


def _slope(points: np.ndarray, volumes: np.ndarray, normal: np.ndarray) -> np.ndarray | None:
    """Weights of values at points in the slope along a direction of the linear function that fits them best; None if there is none."""
    x = points - volumes @ points / volumes.sum()
    second = np.einsum("k,ka,kb->ab", volumes, x, x)
    if np.linalg.det(second) < 1e-3 * np.trace(second) ** 2:
        return None
    return volumes * (x @ np.linalg.solve(second, normal))
