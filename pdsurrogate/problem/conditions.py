"""Conditions of a body made from the prescriptions of a scene: held points, planes of reflection and supports, and checks of them."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from functools import partial
from itertools import pairwise

import numpy as np

from ..body import Body
from ..forces import InvalidState
from ..scenes import Scene
from ..scenes.regions import EDGES
from ..solvers.conditions import HeldPlane, HeldPoints, Loading, place_of
from ..solvers.course import Paths, Pull
from ..solvers.loads import Loads
from ..solvers.supports import SupportAtPlace
from .prescriptions import Prescription
from .programme import Stage
from .regions import BodyRegions

RIGID = 1e3
"""Stiffness of rigid regions over that of the rest in a first guess, which is then brought to where they can be."""

SAMPLES = 5
"""Values of the parameter in each stage at which prescriptions are compared: amplitudes that agree at all of these are the same."""

LEAST_SPREAD = 1e-6
"""Singular value of the constraints below which a rigid motion is free: two points a thousandth of the body apart yield more."""


def conditions_of(
    scene: Scene,
    prescriptions: list[Prescription],
    regions: BodyRegions,
    loads: Loads | None,
    stages: tuple[Stage, ...],
    rigid: Iterable[np.ndarray] = (),
) -> Loading:
    """Return the conditions of a body.

    Parameters
    ----------
    scene : Scene
    prescriptions : list of Prescription
    regions : BodyRegions
    loads : Loads or None
    stages : tuple of Stage
    rigid : iterable of ndarray of int
        Points of every region that moves as one body; those next to a plane are held as the plane is.

    Raises
    ------
    ValueError
        If a region is empty, two entries move a point or plane differently, an amplitude is not zero at rest, or nothing keeps a piece of
        the body where it is; names the key.
    """
    body, stretched = regions.body, scene.stretched
    of_rigid = np.concatenate([np.empty(0, dtype=np.int64), *rigid])
    names = tuple(dict.fromkeys(one.holder for one in prescriptions if one.holder is not None))
    planes, held, along_planes, keys, reflected = [], [], [], [], []
    for edge, holding in _reflected(scene, prescriptions, regions).items():
        points = regions.along_edge(edge)
        planes.append(_plane_of(f"{edge} {'grip' if stretched else 'edge'}", holding, names, body.dimension))
        keys.append(holding[0].key)
        reflected += holding
        rigid_points = np.intersect1d(points, of_rigid)
        for one in holding:
            along_planes.append(HeldPoints(one.name, None, points, one.components, one.of_places(body.points[points])))
            if len(rigid_points):  # its images hold no region that nothing deforms
                moves = one.of_places(body.points[rigid_points])
                held.append(HeldPoints(one.name, names.index(one.holder), rigid_points, one.components, moves))
    moving = any(stage.inertia is not None for stage in stages)
    held += [_points_of(one, names, regions, moving) for one in prescriptions if not any(one is other for other in reflected)]
    parameter, rest = ("stretch", 1.0) if stretched else ("t", 0.0)
    loading = Loading(body, parameter, rest, names, tuple(planes), tuple(held), loads)
    # A plane moves like its points: two prescriptions may not disagree on either. Holds may move points next to a grip's plane.
    _check_motions(body, [*([] if stretched else along_planes), *held], [rest, *(stage.to for stage in stages)])
    _check_planes(loading, keys)
    if stretched:
        axis, travels = scene.loaded_axis, np.array([one.displacement for one in prescriptions[len(scene.holds) :]])
        loading.course = Pull(loading, axis, regions.lower[axis], float(regions.upper[axis] - regions.lower[axis]), travels)
        _check_held(loading, "grips", "add a hold", f"moving along x{axis + 1}")
        return loading
    modulus = 1.0 if scene.material is None else scene.law().shear_modulus  # a picture of a scene without a material needs none
    springs: float | np.ndarray = modulus
    if len(of_rigid):
        springs = np.full(len(body), modulus)
        springs[of_rigid] *= RIGID
    loading.course = Paths(loading, springs, modulus, scene.solver.largest_increment, partial(_turned, prescriptions))
    if loading.supports is not None:
        loading.supports.response = loading.course.response
    if any(stage.inertia is None for stage in stages):
        ways = "x1 or x2" if body.dimension == 2 else "x1, x2 or x3"
        _check_held(loading, "prescribed", f"hold {ways} of a region by 0 against it, or let the steps be in dynamics")
    return loading


def _reflected(scene: Scene, prescriptions: list[Prescription], regions: BodyRegions) -> dict[str, list[Prescription]]:
    """Return the edges that are held by reflection, in the order of the body's planes, each with the prescriptions that hold it."""
    edges: dict[str, list[Prescription]] = {}
    for one in prescriptions if scene.support == "reflected" else ():
        if edge := regions.edge(one.region):
            edges.setdefault(edge, []).append(one)
    return {edge: holding for edge, holding in edges.items() if any(EDGES[edge][0] in one.components for one in holding)}


def _plane_of(name: str, holding: list[Prescription], names: tuple[str, ...], dimension: int) -> HeldPlane:
    """Return the reflection plane that the prescriptions of an edge move, as a `HeldPlane`."""
    by_component = {component: one for one in holding for component in one.components}
    holders = tuple(names.index(by_component[axis].holder) if axis in by_component else None for axis in range(dimension))
    components = tuple(sorted(by_component))
    turned = next((one for one in reversed(holding) if one.rotation is not None), None)
    if turned is not None:
        # Its displacement is that of the origin.
        return HeldPlane(name, holders, components, lambda t: turned.shift(t) - turned.turn(t) @ turned.about, turned.turn)

    def displacement(parameter: float) -> np.ndarray:
        moved = np.zeros(dimension)
        for component, one in by_component.items():
            moved[component] = one.shift(parameter)[component]
        return moved

    return HeldPlane(name, holders, components, displacement)


def _points_of(one: Prescription, names: tuple[str, ...], regions: BodyRegions, moving: bool) -> HeldPoints:
    """Return the points that a prescription holds, in a programme that may be `moving` in dynamics."""
    body = regions.body
    points = regions.points(one.region, f"{one.key}.region" if one.key.startswith("prescribed") else one.key)
    holder, places = None if one.holder is None else names.index(one.holder), body.points[points]
    support = _support(body, points) if regions.is_place(one.region) else None
    if support is None:
        return HeldPoints(one.name, holder, points, one.components, one.of_places(places))
    if moving:
        why = f"{support.count} points are equally near to this place, and a support between points is not followed in dynamics"
        raise ValueError(f"{one.key}.region: {why}; give points by their numbers, or a box around them")
    held = np.setdiff1d(points, support.others)
    return HeldPoints(one.name, holder, held, one.components, one.of_places(support.place[None]), support)


def _support(body: Body, points: np.ndarray) -> SupportAtPlace | None:
    """Return the support that points near to a place make, if there are several."""
    share = body.share
    rows = [(int(share.numbers[point]), tuple(body.points[point])) for point in points]
    found = dict(sorted(row for of_part in share.everywhere(rows) for row in of_part))
    if len(found) == 1:
        return None
    return SupportAtPlace(np.mean(list(found.values()), axis=0), len(found), share.local(np.array(list(found)[1:])))


def _turned(prescriptions: list[Prescription], before: float, after: float) -> float:
    """Return the greatest angle in degrees by which a region turns between two values of the parameter."""
    turns = [abs(one.rotation * (one.factor(after) - one.factor(before))) for one in prescriptions if one.rotation]
    return max(turns, default=0.0)


def _check_motions(body: Body, held: list[HeldPoints], ends: list[float]) -> None:
    """Refuse amplitudes that are not zero at rest, and conditions that move a point differently: it would go with the later one."""
    samples = np.unique(np.concatenate([np.linspace(a, b, SAMPLES) for a, b in pairwise(ends)])).tolist()
    try:
        for part in held:
            if np.abs(part.displacement(ends[0])[..., list(part.components)]).max(initial=0.0) > 1e-9 * body.spacing:
                raise ValueError(f"{part.name}.amplitude: it must be 0 at t = 0, where the body is at rest, as ramp and sine are")
        for component in range(body.dimension):
            for sample in samples:
                _check_agreement(body, [part for part in held if component in part.components], component, sample)
    except InvalidState as error:
        raise ValueError(str(error)) from None


def _check_agreement(body: Body, held: list[HeldPoints], component: int, parameter: float) -> None:
    """Refuse two conditions on a component that move a point differently at a value of the parameter."""
    travel, holder = np.zeros(len(body)), np.full(len(body), -1)
    for number, part in enumerate(held):
        goes = np.broadcast_to(part.displacement(parameter)[..., component], len(part.points))
        apart = np.abs(travel[part.points] - goes) > 1e-9 * body.spacing
        twice = part.points[(holder[part.points] >= 0) & apart]
        if len(twice):
            names = f"{held[holder[twice[0]]].name} and {part.name}"
            raise ValueError(f"{names} move point {twice[0]} at {place_of(body, twice[0])} differently along x{component + 1}")
        travel[part.points], holder[part.points] = goes, number


def _check_planes(loading: Loading, keys: list[str]) -> None:
    """Refuse planes that no bond crosses; `keys` name them."""
    for number, (key, plane) in enumerate(zip(keys, loading.planes, strict=True)):
        if not loading.body.share.any((loading.crossing[1] == number).any()):
            name, edge = plane.name.split()[0], "edge" if loading.body.dimension == 2 else "face"
            raise ValueError(f"{key}: no bond of the body crosses its {name} {edge}; do holes take all that is there?")


def _check_held(loading: Loading, key: str, advice: str, only: str | None = None) -> None:
    """Refuse pieces of the body that can move or turn as a whole, or make one motion only: they have no equilibrium, or many."""
    body, share = loading.body, loading.body.share
    count, piece = loading.pieces()
    extent = body.extent
    middle = np.array([share.sum(column) for column in body.points.T]) / share.size
    places, components, owners = _constraints(loading)
    rows = share.joined(_rigid_motions((places - middle) / extent, components), owners)
    pieces = share.joined(piece[owners], owners)
    for number in range(count):
        motions = [motion for motion in _free_motions(rows[pieces == number], body.dimension) if only in (None, motion)]
        if not motions:
            continue
        loose = np.flatnonzero((piece == number) & share.own)
        size = share.total(len(loose))
        where = f", at {place_of(body, loose[0])}," if len(loose) else ""
        what = "the body" if count == 1 else f"a piece of {size} points of the body{where}"
        if count > 1:
            thin = f"as where a wall is thinner than the spacing, {body.spacing:.3g}, or a cut goes all the way"
            advice = f"there are {count} pieces with no bonds between them, {thin}: take {body.finer}, or {advice}"
        raise ValueError(f"{key}: nothing keeps {what} from {' or '.join(motions)}; {advice}")
    if count > 1 and share.leads:
        why = f"as where a cut goes all the way, or a wall is thinner than the spacing, {body.spacing:.3g}"
        warnings.warn(f"the body is in {count} pieces with no bonds between them, {why}; each is held by itself", stacklevel=2)


def _constraints(loading: Loading) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the places (k, d) and components (k,) that are held at rest, and the point of the body that each belongs to."""
    body = loading.body
    rows = [(np.zeros((0, body.dimension)), np.zeros(0, dtype=int), np.zeros(0, dtype=int))]
    for part in loading.held:
        there = body.points[part.points] if part.support is None else np.tile(part.support.place, (len(part.points), 1))
        rows += [(there, np.full(len(there), component), part.points) for component in part.components]
    for plane, held, sources in zip(body.planes, loading.planes, loading.beside_planes, strict=True):
        there = body.points[sources].copy()
        there[:, plane.axis] = plane.position
        rows += [(there, np.full(len(there), component), sources) for component in held.components]
    return tuple(map(np.concatenate, zip(*rows, strict=True)))


def _rigid_motions(arms: np.ndarray, components: np.ndarray) -> np.ndarray:
    """Return the rigid motions in components (k,) of places at arms (k, d): d translations along the axes, then one rotation or three."""
    count, dimension = arms.shape
    turns = [(0, 1)] if dimension == 2 else [(1, 2), (2, 0), (0, 1)]
    rows = np.zeros((count, dimension + len(turns)))
    rows[np.arange(count), components] = 1.0
    for number, (a, b) in enumerate(turns, dimension):
        rows[:, number] = np.where(components == a, -arms[:, b], np.where(components == b, arms[:, a], 0.0))
    return rows


def _free_motions(rows: np.ndarray, dimension: int) -> list[str]:
    """Return words for the rigid motions of `_rigid_motions` that constraints, shape (k, motions), leave free."""
    if len(rows) == 0:
        return [*(f"moving along x{axis + 1}" for axis in range(dimension)), "turning"]
    # Singular values of R with R^T R = A^T A, which is small however many places there are.
    _, sizes, directions = np.linalg.svd(np.linalg.qr(rows / np.sqrt(len(rows)), mode="r"), full_matrices=True)
    sizes = np.concatenate([sizes, np.zeros(rows.shape[1] - len(sizes))])
    free = directions[sizes < LEAST_SPREAD]
    if not len(free):
        return []
    words = [f"moving along x{axis + 1}" for axis in range(dimension) if not (np.abs(rows[:, axis]) > 0).any()]
    return [*words, "turning"] if len(free) > len(words) else words
