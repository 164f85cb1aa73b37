"""Obstacles of a scene with the boundary that they can touch, and the stiffness of their
contact.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import scipy

from ..body import Body
from ..body.local_fit import text_of
from ..materials import Law
from ..scenes import Scene
from ..scenes.amplitudes import amplitude_of
from ..solvers.conditions import ON_A_PLANE, Loading
from ..solvers.obstacles import ContactNodes, Obstacle
from .regions import BodyRegions

THIN = 20.0
"""Stiffness of the contact: pressure over penetration, times the spacing and divided by the modulus
of the material against strain along one axis. Contact is then as stiff as a layer of the material,
a twentieth of a spacing thick, that cannot bulge. Chosen for dynamics, where a sheet of 32 points
pressed by 20 % has a force 0.2 % too low; with 10 it is 0.4 %, and with 50 there are 1.5 times the
steps.
"""

LEAST_RADIUS = 2.0
"""Least radius of an obstacle in spacings; between the nodes of the boundary, a spacing apart, a
smaller one could enter unnoticed.
"""


OVERLAP = 0.02
"""Overlap of an obstacle with the undeformed body, in spacings, up to which they only touch: nodes
of a round boundary lie as far from it, since its polygon has the area of the circle.
"""

GAUSS = {2: 0.5 + 3**-0.5 / 2, 3: 2 / 3}
"""Greatest shape function at the Gauss points of a facet, by dimension: with equal weights they
integrate quadratic functions exactly.
"""


def obstacles_of(
    scene: Scene, body: Body, regions: BodyRegions, laws: Sequence[Law]
) -> list[Obstacle]:
    """Return the obstacles of a scene.

    Raises
    ------
    ValueError
        If an obstacle overlaps the undeformed body at t = 0, or is too small for the spacing; the
        message names the key.
    """
    if not scene.obstacles:
        return []
    nodes = _nodes_of(body, regions)
    found = []
    stiffness = THIN * max((_modulus(law, scene.plane) for law in laws), default=1.0) / body.spacing
    for number, entry in enumerate(scene.obstacles):
        key = f"obstacles.{number}"
        shape = getattr(entry, entry.shape)
        radius = getattr(shape, "radius", None)
        direction = None
        center = np.array(shape.point if radius is None else shape.center)
        if radius is None or entry.shape == "cylinder":
            direction = -np.array(shape.normal) if radius is None else np.array(shape.axis)
            direction /= np.linalg.norm(direction)
        if radius is not None and radius < LEAST_RADIUS * body.spacing:
            raise ValueError(
                f"{key}.{entry.shape}.radius: {radius:g} is less than {LEAST_RADIUS:g} spacings"
                f" ({LEAST_RADIUS * body.spacing:.4g}), so that it would slip through the"
                f" boundary; use {body.finer}"
            )
        travel = np.array([entry.x1, entry.x2, entry.x3 or 0.0])[: body.dimension]
        one = Obstacle(
            entry.name or key,
            amplitude_of(entry.amplitude),
            nodes,
            center,
            radius,
            direction,
            travel,
            stiffness,
        )
        places = np.vstack([nodes.nodes, body.points])
        gaps, _ = one.gaps(places, one.amplitude(0.0))
        deepest = int(gaps.argmin())
        error = None
        if gaps[deepest] < -OVERLAP * body.spacing:
            turned = (
                ", or turn its normal, which points into the obstacle" if radius is None else ""
            )
            error = ValueError(
                f"{key}.{entry.shape}: at t = 0 the obstacle overlaps the body, by"
                f" {-gaps[deepest]:.3g} at {text_of(places[deepest])}; begin outside, and move it"
                f" toward the body with x1, x2 or x3{turned}"
            )
        body.share.agree(error)
        found.append(one)
    return found


def bar_rigid_regions(
    loading: Loading, rigid: Mapping[str, np.ndarray], ends: Sequence[float]
) -> None:
    """Bar the obstacles of a body from its rigid regions: where these touched, single places would
    carry the whole force.

    A flat rigid side that stands on one place of a round obstacle is not stable. `rigid` are the
    points of the regions by name, and `ends` the ends of the stages.

    Raises
    ------
    ValueError
        If an obstacle reaches the undeformed place of a region that may move freely; the message
        names the key.
    """
    body = loading.body
    # Rigid regions are looked for in the way at so many places of each stage.
    times = np.unique([np.linspace(*ends, 33) for ends in pairwise([0.0, *ends])])
    for number, one in enumerate(loading.loads.obstacles if rigid else ()):
        of_points = scipy.spatial.cKDTree(body.points).query(one.surface.nodes)[1]
        nodes = one.surface.nodes
        one.barred = {
            name: np.flatnonzero(np.isin(of_points, points)) for name, points in rigid.items()
        }
        for name, places in one.barred.items():
            deepest = [
                -one.gaps(nodes[places], one.amplitude(t))[0].min(initial=0.0) for t in times
            ]
            if max(deepest) > OVERLAP * body.spacing and loading.free[rigid[name]].all():
                raise ValueError(
                    f"obstacles.{number}: the obstacle {one.name} reaches the rigid region {name};"
                    " obstacles push on deformable materials alone, since rigid bodies would touch"
                    f" at single places: prescribe the motion of {name} in the place of the"
                    " obstacle, or give it a stiff law"
                )


def _nodes_of(body: Body, regions: BodyRegions) -> ContactNodes:
    """Return the places at which obstacles push: nodes of the boundary, and others at edges and
    beside bonded corners.

    A node stands for its part of the facets around it. At an edge of the body a side that does not
    touch would count there too, so that facets at edges have Gauss points instead. Facets in planes
    of reflection do not touch obstacles, and nodes in bonded planes are not pushed. Where a free
    side folds over such a plane, the linear fit of the nodes beside the corner does not follow, and
    the outermost points there stop at an obstacle themselves.
    """
    surface = regions.surface()
    share = body.share
    d = body.dimension
    kept = regions.facets("body", "obstacles")
    bonded = np.zeros(len(surface.nodes), dtype=bool)
    corner = np.zeros(len(body), dtype=bool)
    for plane in body.planes:
        if plane.axis is None:
            on_plane = np.isin(
                np.arange(len(surface.nodes)), surface.facets[surface.parts == plane.name]
            )
        else:
            on_plane = np.abs(plane.mirrored(surface.nodes)[1]) < ON_A_PLANE * body.spacing
        kept = kept[~on_plane[surface.facets[kept]].all(axis=1)]
        if max(plane.parity) < 0:
            bonded |= on_plane
            corner |= plane.mirrored(body.points)[1] < body.horizon
    used, facets = np.unique(surface.facets[kept], return_inverse=True)
    facets = facets.reshape(-1, d)
    bonded = bonded[used]
    of_facets = surface.areas()[kept]
    mean = np.zeros((len(used), d))
    np.add.at(mean, facets, (surface.normals()[kept] / of_facets[:, None])[:, None])
    # Half of the angle between two normals is then 18 degrees, more than between facets of a round
    # boundary.
    sharp = np.linalg.norm(mean, axis=1) < 0.95 * np.bincount(facets.ravel(), minlength=len(used))
    at_edge = sharp[facets].any(axis=1) & ~bonded[facets].any(axis=1)
    areas = (
        np.bincount(facets[~at_edge].ravel(), np.repeat(of_facets[~at_edge] / d, d), len(used))
        * ~bonded
    )
    edges = facets[at_edge]
    # Row i of the shape functions is that of the Gauss point near corner i.
    shape = GAUSS[d] * np.eye(d) + (1 - GAUSS[d]) / (d - 1) * (1 - np.eye(d))
    columns = np.repeat(edges, d, axis=0).ravel()
    gauss = scipy.sparse.csr_array(
        (np.tile(shape.ravel(), len(edges)), columns, d * np.arange(len(columns) // d + 1)),
        shape=(d * len(edges), len(used)),
    )
    beside = np.flatnonzero(
        corner & share.own & np.isfinite(surface.distances(body.points, body.cell.max()))
    )
    numbers = share.joined(share.numbers[beside], beside)
    order = np.argsort(numbers)
    rows = np.searchsorted(numbers[order], share.numbers[beside])
    themselves = scipy.sparse.csr_array(
        (np.ones(len(beside)), (rows, beside)), shape=(len(numbers), len(body))
    )
    nodes = surface.nodes[used]
    own = surface.interpolation.rows
    nothing = themselves * 0.0
    follow = surface.interpolation.changed(
        lambda rows: scipy.sparse.vstack(
            [rows[used], gauss @ rows[used], themselves if rows is own else nothing], format="csr"
        )
    )
    places = np.vstack([nodes, gauss @ nodes, share.joined(body.points[beside], beside)[order]])
    sides = share.joined(body.volumes[beside] / body.spacing, beside)[order]
    areas = np.concatenate([areas, np.repeat(of_facets[at_edge] / d, d), sides])
    first = len(places) - len(sides)
    distance, nearest = (
        scipy.spatial.cKDTree(places[first:]).query(nodes[facets].mean(axis=1))
        if len(sides)
        else (np.full(len(facets), np.inf), 0)
    )
    stops = np.where(distance < body.cell.max(), first + nearest, -1)
    return ContactNodes(share, follow, places, areas, facets, bonded, stops, body.spacing)


def _modulus(law: Law, plane: str) -> float:
    """Return the modulus of a law against small strain along one axis, with none across it in
    the plane or in space.
    """
    mu = law.shear_modulus
    K = law.bulk_modulus
    return 4 * mu * (3 * K + mu) / (3 * K + 4 * mu) if plane == "stress" else K + 4 * mu / 3
