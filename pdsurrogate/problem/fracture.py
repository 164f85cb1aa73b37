"""Fracture: the bond stretch at which bonds break, from a fracture energy."""

import logging
import warnings
from collections.abc import Callable

import numpy as np
import scipy

from ..body import Body
from ..materials import Law, homogeneous
from ..materials.tearing import check_positive, stretch_at
from ..scenes import Mesh, Scene
from ..scenes.loading_checks import criteria_give, names_of_materials, tears_slowly
from ..scenes.model import Criterion, Fracture
from ..scenes.tip_diameter import (
    TIP_DIAMETER,
    TipDiameters,
    grown_with_bulk,
    tip_diameters_in,
)

logger = logging.getLogger(__name__)

LEAST_LAYERS = 4
ONE_LAYER = 2.0
"""Fewest points across a wall of a solid with a fracture energy, if bonds reach one layer of the
lattice, at horizons below two spacings.

In three layers, a pair of points of the middle one can leave both flanks of a crack and hold it:
strips tore at up to 1.7 times the energy of strips of four and five layers, which had no such pair.
"""

ROUNDING = 1e-6
"""Relative difference within which a ratio of moduli, which are computed, is a measured one."""

MOST_IN_WALLS = 0.1
INSIDE = 0.75
"""Part of a solid that may lie in walls of too few points, since every rounded body has thin edges;
and distance in spacings from the nearest point within which a point of a grid counts as inside a
body: in clouds most are within it.
"""


def critical_stretch_of(
    law: Law, fracture_energy: float, horizon: float, tip_diameter: float = TIP_DIAMETER
) -> float:
    """Return the critical bond stretch with which a crack grows when its energy release rate
    reaches the fracture energy.

    At a blunted tip rubber fails in uniaxial tension, and the fracture energy G is the energy
    density psi at the stretch lambda_c of failure times an effective diameter d of the tip (Thomas
    1955).  Here d is `tip_diameter` times the horizon:

        G = psi_uniaxial(lambda_c) d,

    so that at constant fracture energy the critical stretch decreases as the horizon grows.

    Parameters
    ----------
    law : Law
    fracture_energy : float
        Energy per unit area of crack in the undeformed state, in units of stress times length.
    horizon : float
    tip_diameter : float
        Diameter in horizons. The default, 1.15, is near that of sheets with force models whose
        `family` is "bond force". Diameters of all cases, by critical stretch, are in
        `pdsurrogate/scenes/tip_diameters.json` and in the documentation (validation, crack tips).

    Returns
    -------
    float

    Raises
    ------
    ValueError
        If the energy, the horizon or the diameter is not positive, or no stretch up to the law's
        limit stores as much energy.

    References
    ----------
    Thomas, J. Polym. Sci. 18 (1955) 177-188.

    See Also
    --------
    pdsurrogate.tearing_energy : fracture energy from the force of a trouser tear.
    pdsurrogate.greatest_bond_stretch : critical stretch from the equilibrium in which a crack
        starts.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> print(
    ...     round(
    ...         pds.critical_stretch_of(
    ...             pds.materials.NeoHookean(720.0, 72_000.0), fracture_energy=274.0, horizon=0.063
    ...         ),
    ...         3,
    ...     )
    ... )
    3.624
    """
    check_positive(
        {
            "fracture energy": fracture_energy,
            "horizon": horizon,
            "diameter of the tip": tip_diameter,
        }
    )
    return _stretch_of_energy(law, fracture_energy / horizon, lambda stretch: tip_diameter)


def _stretch_of_energy(law: Law, wanted: float, diameter: Callable[[float], float]) -> float:
    """Return the stretch at which the uniaxial energy density times the diameter of a tip, in
    horizons, has a wanted value.
    """
    return stretch_at(
        law,
        lambda one: homogeneous.uniaxial(law, one).energy_density * diameter(one),
        wanted,
        "that fracture energy",
    )


class CriticalStretches:
    """Critical stretches of the bonds within and between the materials of a scene with fracture.

    Parameters
    ----------
    scene : Scene
    rest : Fracture
        Criterion of the scene, for all materials that have none of their own.
    body : Body
    family : str
        Family of the force models, on which the effective diameter of a crack tip depends.
    of_points : ndarray of int, shape (n,)
        Number of the material of every point of the body: 0 for the rest of the body, then those of
        `materials`, counted from 1.

    Attributes
    ----------
    of_materials : list of float
        Critical stretch within each material.
    of_interfaces : dict of float
        Critical stretch of the bonds between two materials with an entry of their own, by their
        numbers, the smaller first.
    summary : dict
        Entries of a run's summary: the critical stretch of the rest of the body, those of
        interfaces, if any, and remarks on fracture energies.

    Warns
    -----
    UserWarning
        If the critical stretch of a fracture energy, or the ratio of bulk and shear modulus, is
        outside those for which crack tips were measured; the message is also a remark.

    Raises
    ------
    ValueError
        If no critical stretch follows from a fracture energy, or no bond crosses an interface; the
        message names the key.
    """

    def __init__(
        self, scene: Scene, rest: Fracture, body: Body, family: str, of_points: np.ndarray
    ) -> None:
        self._body = body
        self._of_points = of_points
        self._scene = scene
        self._remarks = list[str]()
        self._family = family
        if criteria_give(scene, "energy") and isinstance(scene.body, Mesh):
            self._say(
                "fracture.energy: crack tips were measured on lattices and relaxed points, not on"
                " meshes, so that the energy release rate at the peak of the load may differ from"
                " the given energy; compare a finer mesh, or set critical_stretch"
            )
        laws = [scene.law(), *(part.material.build() for part in scene.materials)]
        own = [
            (None, ""),
            *(
                (part.fracture, f"materials.{number}.")
                for number, part in enumerate(scene.materials)
            ),
        ]
        self.of_materials = [
            self._critical(given or rest, (law, law), f"{key if given else ''}fracture")
            for (given, key), law in zip(own, laws, strict=True)
        ]
        names = names_of_materials(scene)
        ends = (
            np.sort(ends_of_pairs(self._body, self._of_points))
            if rest.interfaces
            else np.zeros((0, 2))
        )
        self.of_interfaces = {}
        for number, entry in enumerate(rest.interfaces):
            one, other = sorted(names.index(name) for name in entry.between)
            key = f"fracture.interfaces.{number}"
            self.of_interfaces[one, other] = self._critical(entry, (laws[one], laws[other]), key)
            if not body.share.any(np.equal(ends, (one, other)).all(axis=1).any()):
                raise ValueError(
                    f"{key}.between: no bond crosses from {names[one]} to {names[other]}: they do"
                    " not touch, or precuts separate them; leave the entry out"
                )
        self.summary: dict = {
            "critical_stretch": self.of_materials[0],
            "fracture_remarks": self._remarks,
        }
        if rest.interfaces:
            found = zip(rest.interfaces, self.of_interfaces.values(), strict=True)
            self.summary["interfaces"] = [
                {"between": list(entry.between), "critical_stretch": stretch}
                for entry, stretch in found
            ]

    def of_pairs(self) -> np.ndarray:
        """Return the critical stretch of every pair of the body, shape (n_pairs,).

        A pair between two materials without an entry in `of_interfaces` has the smaller of their
        critical stretches.
        """
        least = np.minimum.outer(self.of_materials, self.of_materials)
        for (one, other), stretch in self.of_interfaces.items():
            least[one, other] = least[other, one] = stretch
        return least[tuple(ends_of_pairs(self._body, self._of_points).T)]

    def _critical(self, given: Criterion, laws: tuple[Law, Law], key: str) -> float:
        """Return the critical stretch of bonds between two materials, given as such or by a
        fracture energy.

        Raise ValueError, with the key, if no stretch stores as much energy, or the two materials
        have different laws. Warn of a critical stretch at which no tip was measured.
        """
        if given.critical_stretch is not None:
            return given.critical_stretch
        assert given.energy is not None  # exactly one of the two is given
        law = laws[0]
        bulk_ratio = law.bulk_modulus / law.shear_modulus
        tip = tip_diameters_in(self._scene, self._family, bulk_ratio)
        try:
            if law != laws[1]:
                raise ValueError(
                    "no crack between two different laws was measured; set critical_stretch instead"
                )
            stretch = _stretch_of_energy(law, given.energy / self._body.horizon, tip.at)
        except ValueError as error:
            raise ValueError(f"{key}.energy: {error}") from None
        if not tip.measured[0] <= stretch <= tip.measured[1]:
            self._remark(stretch, tip, key)
        low, high = tip.bulk_ratios
        if not low * (1 - ROUNDING) <= bulk_ratio <= high * (1 + ROUNDING):
            self._remark_bulk(bulk_ratio, tip, key)
        return stretch

    def _remark(self, stretch: float, tip: TipDiameters, key: str) -> None:
        """Warn of a critical stretch at which no crack tip was measured, and keep the warning
        for the summary.
        """
        low, high = tip.measured
        known = tip.stretches[(tip.stretches >= low) & (tip.stretches <= high)]
        end, inner = (known[0], known[1]) if stretch < low else (known[-1], known[-2])
        change = 100 * (tip.at(end) / tip.at(inner) - 1)
        remark = (
            f"{key}.energy gives a critical stretch of {stretch:.3g}, but crack tips were measured"
            f" for critical stretches from {low:g} to {high:g}: the diameter is taken as constant"
            f" beyond the last measured one (from {inner:g} to {end:g} it changes by"
            f" {change:+.0f} %), so that the energy release rate at the peak of the load may differ"
            " from the given energy by more than 7 %; to be sure, set critical_stretch"
        )
        self._say(remark)

    def _remark_bulk(self, bulk_ratio: float, tip: TipDiameters, key: str) -> None:
        """Warn of a ratio of bulk and shear modulus with which no crack tip was measured."""
        low, high, least, most = grown_with_bulk()
        ends = " to ".join(dict.fromkeys(f"{ratio:g}" for ratio in tip.bulk_ratios))
        self._say(
            f"{key}.energy: the bulk modulus is {bulk_ratio:.4g} times the shear modulus, but crack"
            f" tips were measured with {ends} times it for these points, this plane and this"
            f" horizon, and the diameter of the nearest one is used. Diameters grow with the bulk"
            f" modulus: in plane strain on the lattice they are {least:.1f} to {most:.1f} times as"
            f" large with {high:g} as with {low:g} times the shear modulus, and the energy release"
            " rate at the peak of the load may be off by as much; to be sure, set critical_stretch"
        )

    def say_process(self, process: str, why: str) -> None:
        """Note in log and summary how bonds break, and why; remark it where dynamics that a scene
        states are left out.
        """
        self.summary["process"] = {"name": process, "reason": why}
        logger.info("scene %s: bonds break by process %s, %s", self._scene.name, process, why)
        if process == "quasi-static" and not tears_slowly(self._scene):
            self._say(
                f"fracture.process: {process}, {why}, so that density, damping and viscosity have"
                ' no effect; set process = "dynamics" for inertia'
            )

    def _say(self, remark: str) -> None:
        """Warn, and keep the text for the summary."""
        self._remarks.append(remark)
        warnings.warn(f"scene {self._scene.name}: {remark}", stacklevel=3)


def ends_of_pairs(body: Body, of_points: np.ndarray) -> np.ndarray:
    """Return the numbers of the materials at both ends of every pair of a body, shape (n_pairs,
    2); `of_points` are those of its points.
    """
    numbers = np.concatenate([of_points, of_points[body.ghosts.source]])
    return np.column_stack([numbers[body.bonds.first], numbers[body.bonds.second]])


def check_walls(scene: Scene, body: Body) -> None:
    """Raise ValueError if a fracture energy is given for a solid in which bonds reach one layer,
    and too much of it lies in thin walls.
    """
    if not (
        scene.plane == "space"
        and scene.horizon_ratio < ONE_LAYER
        and criteria_give(scene, "energy")
    ):
        return
    share = share_in_walls(body, LEAST_LAYERS)
    if share > MOST_IN_WALLS:
        layers = next(
            layers
            for layers in range(LEAST_LAYERS - 1, 0, -1)
            if share_in_walls(body, layers) <= MOST_IN_WALLS
        )
        raise ValueError(
            f"fracture.energy needs walls of at least {LEAST_LAYERS} points in a solid with"
            f" horizon_ratio {scene.horizon_ratio:g}, but {share:.0%} of the body lies in thinner"
            f" ones, down to {layers}: points of the middle one of three layers can hold a crack;"
            " set horizon_ratio to 2.2 or 3, or spacing to"
            f" {layers / LEAST_LAYERS * body.spacing:.3g} or less, or set fracture.critical_stretch"
            " instead"
        )


def share_in_walls(body: Body, layers: int) -> float:
    """Return the part of a grid's points in the body that lie in walls of fewer than `layers`
    points.

    Walls are counted along the axes of the grid, which has the spacing of the body, so that clouds
    count as lattices.
    """
    lowest = body.all_points.min(axis=0)
    counts = np.rint(np.ptp(body.all_points, axis=0) / body.spacing).astype(int) + 1
    grid = lowest + body.spacing * np.stack(
        np.meshgrid(*(np.arange(count) for count in counts), indexing="ij"), axis=-1
    )
    distances, _ = scipy.spatial.cKDTree(body.all_points).query(
        grid, distance_upper_bound=body.spacing
    )
    inside = distances < INSIDE * body.spacing
    thick = np.ones_like(inside)
    for axis in range(body.dimension):
        along = (layers if number == axis else 1 for number in range(body.dimension))
        thick &= scipy.ndimage.binary_opening(inside, np.ones(tuple(along)))
    return float(np.count_nonzero(inside & ~thick) / np.count_nonzero(inside))
