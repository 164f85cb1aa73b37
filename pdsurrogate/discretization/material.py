"""Where the material of a scene lies: within the outline of its body and outside its holes."""

import numpy as np
import scipy

from ..body import Body
from ..scenes import Box, Mesh, Rectangle, Scene


def material_at(scene: Scene, places: np.ndarray) -> np.ndarray:
    """Return flags of the places (k, d) that lie in material: outside holes, and within the outline
    unless this is that of a mesh, a rectangle or a box.
    """
    return _outside_holes(scene, places) & (
        isinstance(scene.body, Mesh | Rectangle | Box) or scene.body.contains(places)
    )


def inside(scene: Scene, places: np.ndarray) -> np.ndarray:
    """Return flags of the places that lie in the body; unlike `material_at` none beyond a rectangle
    or box.
    """
    return _outside_holes(scene, places) & (
        isinstance(scene.body, Mesh) or scene.body.contains(places)
    )


def contained(scene: Scene, body: Body, places: np.ndarray) -> np.ndarray:
    """Return flags of the places (k, d) that lie in the body of a scene; of a mesh, those within
    3/4 of a spacing of its points.
    """
    if isinstance(scene.body, Mesh):
        return scipy.spatial.cKDTree(body.points).query(places)[0] <= 0.75 * body.spacing
    return inside(scene, places)


def points_in_material(scene: Scene, points: np.ndarray) -> np.ndarray:
    """Return flags of the points that lie in material.

    Raise ValueError if a hole contains none of the points within the outline, or no point is left.
    """
    within = material_at(scene.model_copy(update={"holes": ()}), points)
    for number, hole in enumerate(scene.holes):
        if not (hole.contains(points) & within).any():
            raise ValueError(
                f"holes.{number}: the hole contains no point of the body; it is outside, or smaller"
                " than the spacing"
            )
    kept = material_at(scene, points)
    if not kept.any():
        raise ValueError(
            "body: no point is left"
            + (": the holes cover all" if scene.holes else f" at the spacing {scene.spacing:g}")
        )
    return kept


def _outside_holes(scene: Scene, places: np.ndarray) -> np.ndarray:
    outside = np.ones(len(places), dtype=bool)
    for hole in scene.holes:
        outside &= ~hole.contains(places)
    return outside
