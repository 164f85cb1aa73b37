"""Areas of the plane sections of a body at its grips."""

from collections.abc import Callable

import numpy as np

from ..body.cell_mesh import outward
from ..body.surface import IN_PLANE
from ..scenes import Box, Mesh, Rectangle, Scene, SceneError
from ..scenes.model import EDGES
from .cells import RASTER
from .material import material_at
from .meshes import boundary_of_mesh, faces_of_groups, mesh_of
from .planes import reflected_edges

ACCURACY = 1e-9
"""Change of the integral over an interval, relative to the whole, below which it is not halved
further: above rounding, and far below 1e-6, by which the areas of two grips are told apart.
"""


def grip_areas(scene: Scene, lower: np.ndarray, upper: np.ndarray) -> dict[str, float]:
    """Return the cross-sectional area of the body at every grip or reflected edge, by the name of
    the edge, in 2D at unit thickness.

    Parameters
    ----------
    scene : Scene
    lower, upper : ndarray, shape (d,)
        Corners of the bounding box of the body.

    Raises
    ------
    SceneError
        If the body has no straight edge or flat face at such an end, or no material there.
    """
    areas = {}
    faces = faces_of_groups(scene, lower, upper)
    if isinstance(scene.body, Mesh):
        sides, parts, _ = boundary_of_mesh(scene, lower, upper)
        sizes = np.linalg.norm(outward(mesh_of(scene.body).cells.nodes[sides]), axis=1)
    for edge in [grip.edge for grip in scene.grips] or reflected_edges(scene, faces):
        if isinstance(scene.body, Mesh):
            areas[edge] = float(sizes[parts == edge].sum())
            near = 0.0
        else:
            axis, side = EDGES[edge]
            shifts = side * IN_PLANE * (upper - lower).max() * np.array([1, 2])
            near, far = (
                _section_inside(scene, axis, (lower, upper)[side > 0][axis] - shift, lower, upper)
                for shift in shifts
            )
            # Linear in the distance below a straight edge; below a round or a pointed end all of it
            # is due to the distance.
            areas[edge] = 2 * near - far
        if not areas[edge] > 0.9 * near:
            key = "grips" if scene.grips else "prescribed"
            raise SceneError(
                f"scene {scene.name}: {key}: the body has no straight edge with material at its"
                f" {edge} end that could be held"
            )
    return areas


def _section_inside(
    scene: Scene, axis: int, position: float, lower: np.ndarray, upper: np.ndarray
) -> float:
    """Return the area (length in the plane) of material on the section of a body where
    coordinate `axis` equals `position`.
    """
    others = [other for other in range(scene.dimension) if other != axis]
    if isinstance(scene.body, Rectangle | Box) and not scene.holes:
        return float(np.prod((upper - lower)[others]))
    low = lower[others[0]]
    high = upper[others[0]]
    count = int(np.ceil(RASTER * (high - low) / scene.spacing))
    # A round body may end between the last place of the raster and the end of its box.
    asked = np.concatenate([[low], low + (high - low) * (np.arange(count) + 0.5) / count, [high]])

    def inside(along: np.ndarray, strips: np.ndarray) -> np.ndarray:
        places = np.empty((len(along), scene.dimension))
        places[:, axis] = position
        places[:, others[0]] = along
        places[:, others[1:]] = strips
        return material_at(scene, places)

    def lengths(strips: np.ndarray) -> np.ndarray:
        """Return the length of material on each of several parallel lines in the section, shape
        (lines,).

        Each row of `strips` holds the third coordinate of a line; in the plane, where there is one
        line, the row is empty.
        """
        there = inside(np.tile(asked, len(strips)), np.repeat(strips, len(asked), axis=0)).reshape(
            len(strips), -1
        )
        line, ends = np.nonzero(there[:, 1:] != there[:, :-1])
        starts = asked[ends]
        stops = asked[ends + 1]
        before = there[line, ends]
        for _ in range(50):  # bisection, to rounding
            halves = (starts + stops) / 2
            same = inside(halves, strips[line]) == before
            starts = np.where(same, halves, starts)
            stops = np.where(same, stops, halves)
        found = np.bincount(line, np.where(before, stops, -stops), len(strips))
        return found + np.where(there[:, -1], high, 0) - np.where(there[:, 0], low, 0)

    if scene.dimension == 2:
        return float(lengths(np.zeros((1, 0)))[0])
    return _integral(lambda strips: lengths(strips[:, None]), lower[others[1]], upper[others[1]])


def _integral(values: Callable[[np.ndarray], np.ndarray], low: float, high: float) -> float:
    """Integrate the function `values`, which may have kinks and steps, from `low` to `high`.

    Intervals are halved until their integrals by the four-place Lobatto rule change by at most
    `ACCURACY` of the whole.
    """
    places = np.array([-1, -(0.2**0.5), 0.2**0.5, 1])
    weights = np.array([1, 5, 5, 1]) / 6

    def sums(starts: np.ndarray, widths: np.ndarray) -> np.ndarray:
        at = starts[:, None] + widths[:, None] * (places + 1) / 2
        return values(at.ravel()).reshape(at.shape) @ weights * widths / 2

    # Sixteen parts find every step that is wider than one of them; forty halvings reach rounding.
    starts = low + (high - low) / 16 * np.arange(16)
    widths = np.full(16, (high - low) / 16)
    whole = sums(starts, widths)
    total = 0.0
    least = ACCURACY * whole.sum()
    for _ in range(40):
        starts = np.stack([starts, starts + widths / 2], 1).ravel()
        widths = np.repeat(widths / 2, 2)
        halves = sums(starts, widths)
        left = np.repeat(np.abs(halves.reshape(-1, 2).sum(axis=1) - whole) > least, 2)
        total += halves[~left].sum()
        starts = starts[left]
        widths = widths[left]
        whole = halves[left]
        if not len(whole):
            break
    return float(total + whole.sum())
