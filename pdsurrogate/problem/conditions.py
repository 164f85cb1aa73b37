"""Boundary conditions of a body, made from the entries of a scene, and checks of them."""

import warnings
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from ..body.local_fit import text_of
from ..forces import InvalidState
from ..scenes import Scene
from ..solvers.bond_strains import RESOLVED, strain_rounding
from ..solvers.conditions import Loading
from ..solvers.course import Paths
from ..solvers.held import Held
from ..solvers.loads import Loads
from ..solvers.rigid import rigid_motions
from .loads import edge_of, words_for
from .program import NominalStress, Prescription, Stage, known_ends, parameter_of
from .regions import BodyRegions

RIGID = 1e3
"""Stiffness of rigid regions divided by that of the rest of the body, for the first guess of an
equilibrium; the guess is then moved until the regions are rigid. Chosen: strains of the regions are
a thousandth of those beside them; a greater ratio costs digits of the factorization.
"""


def conditions_of(
    scene: Scene,
    prescriptions: list[Prescription],
    regions: BodyRegions,
    loads: Loads,
    stages: tuple[Stage, ...],
    rigid: np.ndarray,
    stress: NominalStress | None,
) -> Loading:
    """Return the boundary conditions and loads of a body (`Loading`), checked, with the first
    guesses of equilibria that follow from them.

    Parameters
    ----------
    scene : Scene
    prescriptions : list of Prescription
    regions : BodyRegions
    loads : Loads
    stages : tuple of Stage
    rigid : ndarray of int
        Points of all rigid regions; those next to a reflection plane are held like the plane.
    stress : NominalStress, optional
        Nominal stress of a body between grips.

    Raises
    ------
    ValueError
        If a region is empty, two entries move a point or plane differently, or an amplitude is not
        zero at the start; the message names the key.
    """
    body = regions.body
    names = tuple(dict.fromkeys(one.holder for one in prescriptions if one.holder is not None))
    edges = [edge_of(plane) for plane in body.planes]
    planes = []
    held = []
    along_planes = []
    # images at which bonds end
    reached = np.unique(body.bonds.second[body.bonds.second >= len(body)]) - len(body)
    for number, (edge, plane) in enumerate(zip(edges, body.planes, strict=True)):
        holding = [one for one in prescriptions if edge in regions.mirrors(one.region)]
        if not body.share.any(body.ghosts.lever[reached, number].any()):
            words = words_for(edge, body)
            why = (
                "precuts run along all of it; move them into the body"
                if len(body.bonds.cut)
                else "no material is there; check the holes"
            )
            raise ValueError(f"{holding[0].key}: no bond crosses the {words} of the body: {why}")
        points = regions.points(edge)
        sources = np.unique(body.ghosts.source[body.ghosts.plane == number])
        feet, _ = plane.mirrored(body.points[sources])
        # a plane's images hold no region that nothing deforms
        rigid_points = np.intersect1d(points, rigid)
        by_component = {component: one for one in holding for component in one.components}
        for one in holding:
            if components := tuple(
                component for component in one.components if by_component[component] is one
            ):
                planes.append(one.held(names, sources, feet, components, plane=number))
            along_planes.append(one.held(names, points, body.points[points]))
            if len(rigid_points):
                held.append(one.held(names, rigid_points, body.points[rigid_points]))
    held += [
        _points_of(one, names, regions, edges)
        for one in prescriptions
        if not _mirrored(one, regions, edges)
    ]
    loading = Loading(
        body,
        *parameter_of(scene),
        names,
        [f"{edge} edge" for edge in edges],
        [*held, *planes],
        loads,
    )
    # A plane moves like its points: two prescriptions may not disagree on either. Holds may move
    # points next to a grip's plane.
    _check_motions(loading, [*along_planes, *held], [loading.rest, *known_ends(stages)])
    _check_counted(loading, prescriptions)
    # a picture of a scene without a material needs none
    stated = scene.material is not None and scene.material.artifact is None
    modulus = scene.law().shear_modulus if stated else 1.0
    springs = np.full(len(body), modulus)
    springs[rigid] *= RIGID
    # grips limit the stretch itself
    strain, pull = (
        (scene.solver.largest_increment, None) if stress is None else (np.inf, stress.pull)
    )
    loading.course = Paths(loading, springs, modulus, strain, pull)
    for support in loading.supports:
        support.response = loading.course.response
    return loading


def check_supports(
    loading: Loading, stages: tuple[Stage, ...], stress: NominalStress | None
) -> None:
    """Raise ValueError if the supports do not fit the stages: if nothing keeps a piece of the body
    where it is, or one holds a place between points in dynamics.
    """
    between = next((part for part in loading.held if part.count > 1), None)
    if between and any(stage.inertia is not None for stage in stages):
        why = (
            f"{between.count} points are equally near to this place, and dynamics cannot hold a"
            " place between points"
        )
        raise ValueError(
            f"{between.name}.region: {why}; give the numbers of points, or a box around them"
        )
    if stress is not None:
        _check_held(loading, "grips", "add a hold", f"moving along x{stress.axis + 1}")
    elif any(stage.inertia is None for stage in stages):
        ways = "x1 or x2" if loading.body.dimension == 2 else "x1, x2 or x3"
        _check_held(
            loading, "prescribed", f"prescribe {ways} = 0 on a region, or run the steps in dynamics"
        )


def warn_of_points(scene: Scene, boundaries: Mapping[str, str]) -> None:
    """Warn of boundaries that are held at their points, see `held_at_points`."""
    for name, why in boundaries.items():
        warnings.warn(
            f"scene {scene.name}: prescribed: {name} is held at its points, half a cell inside it,"
            " which makes the body too stiff there (a bushing by 16 % with 20 points through its"
            f" wall): {why}",
            stacklevel=3,
        )


def _mirrored(one: Prescription, regions: BodyRegions, mirrors: list[str]) -> bool:
    """Return whether mirrored points hold the whole region of a prescription; `mirrors` are the
    parts of the boundary that they hold.
    """
    parts = regions.mirrors(one.region)
    return bool(parts) and {*parts} <= {*mirrors}


def _check_counted(loading: Loading, prescriptions: list[Prescription]) -> None:
    """Raise ValueError for a support that has no effect along a component, since later
    prescriptions hold all of its points along it.

    Results would report the force of such a support along this component as zero.
    """
    holder, _, component = loading.counted
    counted = np.zeros((len(loading.names), loading.body.dimension), dtype=bool)
    counted[holder, component] = True
    for part in loading.held:
        if part.plane is not None and part.holder is not None:
            counted[part.holder, list(part.components)] = True
    for one in prescriptions:
        for axis in one.components if one.holder is not None else ():
            if not loading.body.share.any(counted[loading.names.index(one.holder), axis]):
                raise ValueError(
                    f"{one.key}: later entries hold all of its points along x{axis + 1} as well;"
                    " remove one of the entries"
                )


def _points_of(
    one: Prescription,
    names: tuple[str, ...],
    regions: BodyRegions,
    mirrors: list[str],
) -> Held:
    """Return the points that a prescription holds, as a held part of the body; `names` are the
    supports whose forces are reported.

    Parts of the boundary that mirrored points hold, `mirrors`, are left out. A region that is a
    place equally near to several points is held at the mean of these points.
    """
    body = regions.body
    share = regions.body.share
    points = regions.points(
        one.region, f"{one.key}.region" if one.key.startswith("prescribed") else one.key
    )
    parts = regions.mirrors(one.region)
    if set(parts) & set(mirrors):  # mirrored points hold the other parts
        points = np.unique(
            np.concatenate([regions.points(part) for part in parts if part not in mirrors])
        )
    found = {}
    if regions.is_place(one.region):
        rows = [(int(share.numbers[point]), tuple(body.points[point])) for point in points]
        found = dict(sorted(row for of_part in share.everywhere(rows) for row in of_part))
    if len(found) < 2:
        return one.held(names, points, body.points[points])
    others = share.local(np.array(list(found)[1:]))
    place = np.mean(list(found.values()), axis=0, keepdims=True)
    return one.held(names, np.setdiff1d(points, others), place, others=others, count=len(found))


def _check_motions(loading: Loading, held: list[Held], ends: list[float]) -> None:
    """Raise ValueError if a prescribed displacement is not zero at the start, or two held parts
    prescribe different motions of a point.

    The later part would otherwise override the earlier one without notice. `ends` are the values of
    the loading parameter at the start and at the ends of all stages; motions are compared at
    `SAMPLES` values in each stage. Motions that alone drive the body, and are lost in the rounding
    of its positions, are refused too.
    """
    body = loading.body
    # Motions are compared at five values in each stage: amplitudes are smooth or tables, and two
    # different ones that agree at five values are not written by accident.
    samples = np.unique(
        np.concatenate([ends[:1], *(np.linspace(a, b, 5) for a, b in pairwise(ends))])
    ).tolist()
    every = Loading(body, "t", 0.0, (), [], held, Loads(body, []))
    error = 1e-9 * body.spacing
    try:
        moves = np.array([every.moves(sample) for sample in samples])
        at_rest = np.abs(every.moves(ends[0])) > error
    except InvalidState as invalid:
        raise ValueError(str(invalid)) from None
    if at_rest.any():
        name = held[every.part[at_rest.argmax()]].name
        raise ValueError(
            f"{name}.amplitude: must be 0 at t = 0, where the body is undeformed (as ramp and sine"
            " are)"
        )
    # Conditions on one component of a point stand next to each other, in the order of `held`.
    order = np.lexsort((every.point, every.component))
    one = order[:-1]
    other = order[1:]
    apart = (every.point[one] == every.point[other]) & (
        every.component[one] == every.component[other]
    )
    apart &= (np.abs(moves[:, one] - moves[:, other]) > error).any(axis=0)
    if apart.any():
        one, other = min(
            zip(one[apart], other[apart], strict=True),
            key=lambda pair: (every.component[pair[1]], pair[1]),
        )
        point = every.point[other]
        raise ValueError(
            f"{held[every.part[one]].name} and {held[every.part[other]].name} move point {point}"
            f" at {text_of(body.points[point])} differently along x{every.component[other] + 1}"
        )
    greatest = max(body.share.greatest(np.abs(loading.moves(sample))) for sample in samples)
    least = RESOLVED * strain_rounding(body, body.points) * body.spacing
    if 0 < greatest < least and not len(loading.loads):
        key = "prescribed" if loading.parameter == "t" else "stretches"
        raise ValueError(
            f"{key}: the greatest displacement, {greatest:.2g}, is too small for double precision,"
            f" which resolves {least:.1g} here; apply larger ones and scale the results, or"
            " describe the body nearer to the origin"
        )


def _check_held(loading: Loading, key: str, advice: str, only: str | None = None) -> None:
    """Raise ValueError if a piece of the body can move or turn as a whole: it would have no
    equilibrium, or many.

    If `only` is given, one of the descriptions that `_free_motions` returns, no other rigid motion
    is checked. `key` and `advice` appear in the message.
    """
    body = loading.body
    share = loading.body.share
    count, piece = loading.pieces()
    extent = body.extent or body.spacing  # of a single point
    middle = np.array([share.sum(column) for column in body.points.T]) / share.size
    motions_there = rigid_motions((loading.place - middle) / extent)
    rows = share.joined(
        motions_there[np.arange(len(loading.point)), loading.component], loading.point
    )
    pieces = share.joined(piece[loading.point], loading.point)
    for number in range(count):
        motions = [
            motion
            for motion in _free_motions(rows[pieces == number], body.dimension)
            if only in (None, motion)
        ]
        if not motions:
            continue
        loose = np.flatnonzero((piece == number) & share.own)
        size = share.total(len(loose))
        where = f", at {text_of(body.points[loose[0]])}," if len(loose) else ""
        what = "the body" if count == 1 else f"a piece of {size} points of the body{where}"
        if count > 1:
            advice = (
                f"the body consists of {count} pieces without bonds between them, for example"
                f" because a wall is thinner than the spacing {body.spacing:.3g}, or a cut goes"
                f" all the way through: use {body.finer}, or {advice}"
            )
        raise ValueError(f"{key}: nothing keeps {what} from {' or '.join(motions)}; {advice}")
    if count > 1 and share.is_first:
        warnings.warn(
            f"the body consists of {count} pieces without bonds between them, for example because"
            " a cut goes all the way through, or a wall is thinner than the spacing"
            f" {body.spacing:.3g}; each piece is held by itself",
            stacklevel=2,
        )


def _free_motions(rows: np.ndarray, dimension: int) -> list[str]:
    """Return descriptions of the rigid motions (see `rigid_motions`) that constraints, rows of
    shape (k, motions), leave free.
    """
    # The rank of R with R^T R = A^T A, which is small however many places there are.
    # A motion is free below this singular value; two held points that are a thousandth of the body
    # apart yield more.
    rank = np.linalg.matrix_rank(
        np.linalg.qr(rows / np.sqrt(max(1, len(rows))), mode="r"), tol=1e-6
    )
    if rank == rows.shape[1]:
        return []
    words = [
        f"moving along x{axis + 1}"
        for axis in range(dimension)
        if not (np.abs(rows[:, axis]) > 0).any()
    ]
    return [*words, "turning"] if rows.shape[1] - rank > len(words) else words
