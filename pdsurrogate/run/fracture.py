"""Damage: bonds that break for good beyond a critical stretch (paper, Eqs. (29)-(31)), and what that stretch should be."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from ..body import Body
from ..engine.block_arrays import BLOCK
from ..engine.threads import chunks_of
from ..kernels.damage import find_overstretched
from ..materials import Law, homogeneous
from ..materials.law import check_number, checked_law
from ..scenes import Scene
from ..scenes.model import TIP_DIAMETER, tip_diameter


class Damage:
    """Damage of a body: its broken bonds.

    Parameters
    ----------
    body : Body
    critical_stretch : float
        Bond stretch above 1 at which a bond breaks.

    Attributes
    ----------
    broken : ndarray of bool, shape (n_pairs,)
    """

    def __init__(self, body: Body, critical_stretch: float) -> None:
        if not (np.isfinite(critical_stretch) and critical_stretch > 1):
            raise ValueError(f"the critical stretch must be finite and greater than 1, not {critical_stretch}")
        self.body, self.critical_stretch = body, float(critical_stretch)
        bonds = body.bonds
        self.broken = np.zeros(len(bonds.first), dtype=bool)
        first, second = bonds.ends_in_blocks(BLOCK)
        length = _lengths(body, bonds.first, bonds.second)
        self._weights = body.weigh(length)
        self._limits = np.full(len(first), np.inf)
        self._limits[: len(length)] = (self.critical_stretch * length) ** 2
        self._found = np.empty(len(first), dtype=np.uint32)
        chunks = chunks_of(len(bonds.first))
        self._counts = np.zeros(chunks.number, dtype=np.int64)
        self._find = find_overstretched[body.dimension].bind(
            body.all_points,
            first,
            second,
            self._limits.reshape(-1, BLOCK),
            np.zeros((chunks.threads, body.dimension, BLOCK)),
            self._found,
            self._counts,
            chunks=chunks,
        )
        self._whole = self._sum(np.ones(len(self.broken))) + _cut_weights(body)

    def overstretched(self, positions: np.ndarray) -> np.ndarray:
        """Numbers of the intact pairs whose stretch exceeds the critical one, rising.

        Parameters
        ----------
        positions : ndarray, shape (n + m, d)
            Of the points and their images.
        """
        self._find.give("positions", positions)
        if not self._find():
            return self._found[:0]
        chunks, blocks = len(self._counts), len(self._limits) // BLOCK
        starts = [chunk * blocks // chunks * BLOCK for chunk in range(chunks)]
        return np.concatenate([self._found[start : start + count] for start, count in zip(starts, self._counts, strict=True)])

    def break_bonds(self, pairs: np.ndarray) -> None:
        """Mark pairs as broken."""
        self.broken[pairs] = True
        self._limits[pairs] = np.inf

    def at_points(self) -> np.ndarray:
        """Damage (31) of every point, shape (n,): share of its bonds, by weight and volume, that are cut or broken."""
        return 1 - self._sum(~self.broken) / self._whole

    def _sum(self, intact: np.ndarray) -> np.ndarray:
        bonds, body, n = self.body.bonds, self.body, len(self.body)
        shares = self._weights * intact
        total = np.bincount(bonds.first, shares * body.all_volumes[bonds.second], n)
        within = bonds.second < n
        return total + np.bincount(bonds.second[within], (shares * body.all_volumes[bonds.first])[within], n)


def _lengths(body: Body, first, second) -> np.ndarray:
    return np.linalg.norm(body.all_points[second] - body.all_points[first], axis=1)


def _cut_weights(body: Body) -> np.ndarray:
    """Sum of w V over the bonds that were cut from the outset, for every point."""
    n, cut = len(body), body.bonds.cut
    weights = body.weigh(_lengths(body, cut[:, 0], cut[:, 1]))
    total = np.zeros(len(body.all_points))
    for end in (0, 1):
        np.add.at(total, cut[:, end], weights * body.all_volumes[cut[:, 1 - end]])
    return total[:n]


def critical_stretch_of(law: Law, fracture_energy: float, horizon: float, tip_diameter: float = TIP_DIAMETER) -> float:
    """Critical bond stretch at which a crack runs once its energy release rate reaches the fracture energy.

    At a blunted tip rubber fails in uniaxial tension, and the fracture energy is the energy density at failure times an effective diameter
    of the tip (Thomas 1955).  Here the horizon sets that diameter, d = `tip_diameter` delta:

        G = psi_uniaxial(lambda_c) d,

    so the stretch falls with the horizon while the energy stays.

    Parameters
    ----------
    law : Law
    fracture_energy : float
        Energy per unit area of crack in the undeformed state, in units of stress times length.
    horizon : float
    tip_diameter : float
        In horizons; by default that of sheets whose bonds have forces and no energy.  By `bond-energy` in space it is 1.2 with a
        horizon of 1.75 spacings, and 0.83 with one of 2.2.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        If the energy, the horizon or the diameter is not positive, or no stretch up to the law's limit holds as much.

    References
    ----------
    Thomas, J. Polym. Sci. 18 (1955) 177-188.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> print(round(pds.critical_stretch_of(pds.NeoHookean(720.0, 72_000.0), fracture_energy=274.0, horizon=0.063), 3))
    3.624
    """
    checked_law(law)
    for name, value in (("fracture energy", fracture_energy), ("horizon", horizon), ("diameter of the tip", tip_diameter)):
        check_number(value, f"the {name}")
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"the {name} must be positive and finite, not {value}")
    wanted = fracture_energy / (tip_diameter * horizon)

    def excess(stretch: float) -> float:
        return homogeneous.uniaxial(law, stretch).energy_density - wanted

    return float(brentq(excess, 1.0, _first_above(excess, law, "that fracture energy"), xtol=1e-12))


def critical_stretch_in(scene: Scene, law: Law, horizon: float, family: str) -> float:
    """Return the critical stretch of a scene: the one that it gives, or that of its fracture energy."""
    spec = scene.fracture
    if spec.critical_stretch is not None:
        return spec.critical_stretch
    return critical_stretch_of(law, spec.energy, horizon, tip_diameter(scene.plane, scene.horizon_ratio, family))


def tearing_energy(law: Law, force: float, leg_width: float, thickness: float) -> float:
    """Energy per undeformed area that a trouser tear takes at a force on its legs.

    While the tear goes on by dc each leg, in simple tension lambda, grows longer by lambda dc under the force F, and 2 b h dc of unstrained
    material comes into the legs (Rivlin and Thomas 1953):

        T = 2 F lambda / h - w(lambda),   w = 2 b psi(lambda),

    with F = b h P(lambda).  For legs that hardly stretch T = 2 F / h.

    Parameters
    ----------
    law : Law
    force : float
        On each leg.
    leg_width, thickness : float
        b and h of a leg, undeformed.

    Returns
    -------
    float
        In units of stress times length.

    Raises
    ------
    ValueError
        If one of the numbers is not positive and finite, or the law holds no such stress.

    References
    ----------
    Rivlin and Thomas, J. Polym. Sci. 10 (1953) 291-318.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> print(round(pds.tearing_energy(pds.NeoHookean(), force=1.0, leg_width=8.0, thickness=2.0), 4))
    1.0106
    """
    checked_law(law)
    for name, value in (("force", force), ("leg's width", leg_width), ("thickness", thickness)):
        check_number(value, f"the {name}")
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"the {name} must be positive and finite, not {value}")
    wanted = force / (leg_width * thickness)

    def excess(stretch: float) -> float:
        return homogeneous.uniaxial(law, stretch).nominal_stress - wanted

    stretch = brentq(excess, 1.0, _first_above(excess, law, "that stress"), xtol=1e-12)
    return 2 * force * stretch / thickness - 2 * leg_width * homogeneous.uniaxial(law, stretch).energy_density


def _first_above(excess: Callable[[float], float], law: Law, what: str) -> float:
    """A stretch at which a rising function of it is no longer negative; ValueError where the law ends before."""
    upper = 1.1
    while excess(upper) < 0:
        lower, upper = upper, 1.1 * upper
        try:
            excess(upper)
        except ValueError:
            raise ValueError(f"{law.name} reaches its limit at stretch {lower:.3g}, before it holds {what}") from None
    return upper


def greatest_bond_stretch(body: Body, positions: np.ndarray) -> float:
    """Greatest stretch of the bonds between points of a body at positions (n, d).

    With the equilibrium of a precut body at the loading at which its crack is seen to start, this is the critical stretch that
    makes it start there: the paper's calibration from a loading curve.

    Raises
    ------
    ValueError
        If the positions are not those of the body's points.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> body = pds.Body.rectangle(1.0, 1.0, 0.25, 0.7875)
    >>> print(round(pds.greatest_bond_stretch(body, body.points * [1.5, 1.0]), 6))
    1.5
    """
    positions = np.asarray(positions, dtype=float)
    if positions.shape != body.points.shape:
        raise ValueError(f"positions must be those of the body's points, of shape {body.points.shape}, not {positions.shape}")
    bonds, n = body.bonds, len(body)
    within = bonds.second < n
    first, second = bonds.first[within], bonds.second[within]
    deformed = np.linalg.norm(positions[second] - positions[first], axis=1)
    return float((deformed / _lengths(body, first, second)).max())
