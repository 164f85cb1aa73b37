"""Strength of the materials of a scene: works at break, and the radii of the discs over which they
must be reached in the mean, theory, section 32.
"""

import logging
import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy

from ..body import Body
from ..discretization import contained
from ..materials import PLANES, Law, homogeneous
from ..materials.states import invariants
from ..materials.tearing import stretch_at_stress
from ..scenes import Scene
from ..scenes.loading_checks import names_of_materials
from ..scenes.model import Criterion
from ..solvers.conditions import Loading
from .fracture import ends_of_pairs
from .random_strength import random_works
from .strength_surface import Surface, surface_of
from .tip_factor import factor_of

logger = logging.getLogger(__name__)

LEAST_RADIUS = 1.5
"""Least radius of a disc in spacings: a smaller one holds too few points for a mean around the tip
of a crack. Sheets of linear bonds tore within 12 % of Griffith's load at 1.6.
"""

TRACE_STEP, SAMPLES = 1.02, 9
"""Ratio of the traces of C at which energies are compared with the work at break, and number of
area ratios at each. Chosen: the bound needs no precision, and no energy has several maxima there.
"""

REPORTED = ("stretch", "uniaxial", "work", "length", "factor", "radius")
SURFACE = ("equibiaxial", "hydrostatic")
"""Attributes of a `Zone` and of its surface in the summary of a run."""


@dataclass(frozen=True)
class Zone:
    """Strength within one material, or of the interface between two.

    Attributes
    ----------
    key, name : str
        Key of the scene with its strength, and name for results.
    stretch, uniaxial : float
        Stretch and nominal stress at break in uniaxial tension.
    work : float
        Energy density W_b there.
    length : float
        Fracture energy divided by the work at break.
    factor : float
        Mean energy density of a disc around the tip of a long crack times pi times the radius,
        divided by the energy release rate.
    radius : float
        Radius of the discs, or balls in space.
    off : float
        Distance from clamped boundaries within which no disc is centered.
    centers : ndarray of bool, shape (n,)
        Points around which discs may lie.
    pairs : ndarray of bool, shape (n_pairs,)
        Pairs that its discs may break.
    of_points : bool
        Whether the energies of points are divided by the works of their own materials, and not by
        that of the zone: within a material.
    surface : Surface, optional
        Strength surface of two numbers.
    least : ndarray, shape (n,), optional
        Share of the work that must be reached in the disc around a point, of random strengths.
    """

    key: str
    name: str
    stretch: float
    uniaxial: float
    work: float
    length: float
    factor: float
    radius: float
    off: float
    centers: np.ndarray
    pairs: np.ndarray
    of_points: bool
    surface: Surface | None = None
    least: np.ndarray | None = None

    def least_at(self, points: np.ndarray) -> np.ndarray:
        """Return the shares of the work that must be reached in the discs around points."""
        return np.ones(len(points)) if self.least is None else self.least[points]


class Strengths:
    """Strengths of the materials and interfaces of a scene on a body.

    Parameters
    ----------
    scene : Scene
    body, whole : Body
        This rank's share of the body, and the whole body.
    loading : Loading
    of_points : ndarray of int, shape (n,)
        Number of the material of every point, as of `CriticalStretches`.

    Attributes
    ----------
    zones : list of Zone
    works : ndarray, shape (n,)
        Work at break of every point's own material, infinite where it has no strength.
    limits : ndarray, shape (n_pairs,)
        Stretch at break in uniaxial tension of the material of a pair, the mean of those of its two
        ends; infinite if an end has none, and 1 across an interface that has its own entry.
    least_trace : float
        Least tr C of a state of a sheet under plane stress that is not pressed together, det F >=
        1, and has the work at break of a zone.
    inside : callable
        ``inside(places)`` returns flags of the places (k, d) that lie in the body.
    summary : list of dict
        Entries of a run's summary.

    Raises
    ------
    ValueError
        If a material does not reach its strength, has branches or softening, if the spacing is
        too coarse, or if no disc lies away from clamps; the message names the key.
    """

    def __init__(
        self, scene: Scene, body: Body, whole: Body, loading: Loading, of_points: np.ndarray
    ) -> None:
        rest = scene.fracture
        assert rest is not None  # has a strength
        names = names_of_materials(scene)
        laws = [scene.law(), *(part.material.build() for part in scene.materials)]
        self.inside = partial(contained, scene, whole)
        self.works = np.full(len(body), np.inf)
        self._plane = scene.plane
        self._zone_of = np.full(len(body), -1)
        of_laws = np.full(len(laws), np.inf)
        self.zones = list[Zone]()
        clamped = clamped_distances(body, loading)
        ends = np.sort(ends_of_pairs(body, of_points))
        across = np.zeros(len(ends), dtype=bool)
        for number, entry in enumerate(rest.interfaces):
            one, other = sorted(names.index(name) for name in entry.between)
            pairs = np.equal(ends, (one, other)).all(axis=1)
            across |= pairs
            if entry.strength is None:
                continue
            beside = np.zeros(len(body.all_points), dtype=bool)
            beside[body.bonds.first[pairs]] = beside[body.bonds.second[pairs]] = True
            self._add(
                f"fracture.interfaces.{number}",
                " and ".join(entry.between),
                entry,
                laws[one],
                (body, scene.plane, clamped),
                (beside[: len(body)], pairs, False),
            )
        for number, law in enumerate(laws):
            own = scene.materials[number - 1].fracture if number else None
            key = f"materials.{number - 1}.fracture" if own else "fracture"
            given = own or rest
            if given.strength is None or (number and scene.materials[number - 1].material.rigid):
                continue
            within = of_points == number
            zone = self._add(
                key,
                names[number],
                given,
                law,
                (body, scene.plane, clamped),
                (within, ~across, True),
            )
            self.works[within] = zone.work
            of_laws[number] = zone.stretch
            self._zone_of[within] = len(self.zones) - 1
            if given.strength.scatter is not None:
                least = np.full(len(body), zone.work)
                try:
                    least[within] = random_works(
                        given.strength.scatter, law, zone.uniaxial, whole, body.points[within]
                    )
                except ValueError as error:
                    raise ValueError(f"{key}.strength.scatter: {error}") from None
                self.zones[-1] = replace(zone, least=least / zone.work)
        self.limits = np.where(across, 1.0, of_laws[ends].mean(axis=1))
        self._check_reach(body, clamped)
        self.least_trace = (
            min(
                least_trace_of(
                    law,
                    zone.work * zone.least_at(np.arange(len(body))).min(initial=1),
                    zone.surface,
                )
                for law in laws
                for zone in self.zones
            )
            if scene.plane == "stress"
            else 0.0
        )
        self.summary = [
            {
                "of": zone.name,
                **{key: getattr(zone, key) for key in REPORTED},
                **({key: getattr(zone.surface, key) for key in SURFACE} if zone.surface else {}),
                "radius_in_spacings": zone.radius / body.spacing,
                "at_grips": not zone.off,
            }
            for zone in self.zones
        ]
        for zone in self.zones:
            logger.info(
                "strength of %s: stretch at break %.4g, G / W_b %.4g; discs of radius %.4g,"
                " %.3g spacings",
                zone.name,
                zone.stretch,
                zone.length,
                zone.radius,
                zone.radius / body.spacing,
            )

    def energies(
        self, zone: Zone, points: np.ndarray, law: Law, F: np.ndarray, volume_ratio: np.ndarray
    ) -> np.ndarray:
        """Return the energy densities of points of a law, shape (k,), with deformation gradients
        (k, d, d) and volume ratios (k,); where the strength is a surface, those in uniaxial tension
        that are as near to break.
        """
        found = PLANES[self._plane].energy_at(law, F, volume_ratio)
        for number, one in enumerate(self.zones) if zone.of_points else [(None, zone)]:
            if one.surface is not None:
                of = np.full(len(points), number is None) | (self._zone_of[points] == number)
                found[of] = one.surface.energy(law, self._plane, F[of], volume_ratio[of])
        return found

    def _add(
        self,
        key: str,
        name: str,
        given: Criterion,
        law: Law,
        where: tuple[Body, str, np.ndarray],
        members: tuple[np.ndarray, np.ndarray, bool],
    ) -> Zone:
        """Add the strength of a criterion in a material with a law, and return it.

        `where` are the body, its plane, and the distances of its points from clamps; `members` the
        points at which discs may be centered, the pairs that they may break, and `of_points`.
        """
        body, plane, clamped = where
        strength = given.strength
        assert strength is not None  # asked about only then
        assert given.energy is not None  # needed beside a strength
        try:
            if law.memory:
                raise ValueError(
                    "the material has branches or softening, so that its work at break depends on"
                    " how it is loaded; leave them or the strength out"
                )
            stretch = strength.stretch or stretch_at_stress(law, strength.uniaxial or 0.0)
            state = homogeneous.uniaxial(law, stretch)
            surface = surface_of(law, stretch, strength)
            length = given.energy / state.energy_density
            factor = factor_of(law, stretch, plane, surface)
            radius = factor * length * (3 / 8 if plane == "space" else 1 / math.pi)
            if radius < LEAST_RADIUS * body.spacing:
                raise ValueError(
                    f"it must be exceeded in the mean over a radius of {radius:.3g}, which is"
                    f" {radius / body.spacing:.2g} spacings and must be {LEAST_RADIUS:g} at least;"
                    f" use {body.finer}; {0.9 * radius / LEAST_RADIUS:.3g} or less would do"
                )
        except ValueError as error:
            raise ValueError(f"{key}.strength: {error}") from None
        off = 0.0 if strength.at_grips else radius
        numbers = stretch, state.nominal_stress, state.energy_density, length, factor, radius, off
        centers, *others = members
        zone = Zone(key, name, *numbers, centers & (clamped >= off), *others, surface)
        self.zones.append(zone)
        return zone

    def _check_reach(self, body: Body, clamped: np.ndarray) -> None:
        """Raise ValueError if a strength that does not act at grips acts nowhere."""
        reached = dict[str, np.ndarray]()
        for zone in self.zones:
            reached[zone.key] = reached.get(zone.key, False) | zone.centers
        for zone in self.zones:
            if zone.off and not body.share.any(bool(reached[zone.key].any())):
                farthest = body.share.greatest(clamped)
                raise ValueError(
                    f"{zone.key}.strength: with at_grips = false it acts from the radius of its"
                    f" discs on, {zone.radius:.3g}, away from clamps, where no point of"
                    f" {zone.name} lies (the body has points up to {farthest:.3g} away): use a"
                    " body that is longer between its clamps (two of them"
                    f" {2 * zone.radius + body.spacing:.3g} apart would do), or leave at_grips out"
                )


def least_trace_of(law: Law, work: float, surface: Surface | None = None) -> float:
    """Return a lower bound of tr C of the states of a sheet under plane stress with det F >= 1
    whose energy density, or that of a strength surface, is `work`, within 2 %.
    """
    states = PLANES["stress"]
    trace = 2.0
    with np.errstate(all="ignore"):  # of states beyond the limit of the law
        while True:
            J = np.linspace(1.0, TRACE_STEP * trace / 2, SAMPLES)
            half = TRACE_STEP * trace / 2
            root = np.sqrt(np.maximum(half**2 - J**2, 0.0))
            F = np.sqrt(np.column_stack([half + root, half - root]))[:, :, None] * np.eye(2)
            if not states.has_state(law, F).all():
                return trace
            J3 = states.volume_ratio(law, *invariants(F))
            at = (law, "stress", F, J3)
            if (surface.energy(*at) if surface else states.energy_at(law, F, J3)).max() >= work:
                return trace
            trace *= TRACE_STEP


def clamped_distances(body: Body, loading: Loading) -> np.ndarray:
    """Return the distance of every point from the nearest boundary or point that is held in all
    directions, shape (n,); infinite without any.
    """
    share = body.share
    found = np.full(len(body), np.inf)
    for plane in body.planes:
        if not plane.symmetric:
            np.minimum(found, np.abs(plane.mirrored(body.points)[1]), out=found)
    held = share.own & (loading.free == 0).all(axis=1)
    places = np.concatenate(share.everywhere(body.points[held]))
    if len(places):
        np.minimum(found, scipy.spatial.cKDTree(places).query(body.points)[0], out=found)
    return found
