"""Maps from images to the scenes of a calibration: their starts, which points count, and what is
stored of them.
"""

import numpy as np

from ..scenes import Mesh, Scene
from .causes import BAD, DOUBTFUL, FEWEST, SURELY, cause_of, trial_of
from .image_map import ImageMap
from .kinematics import Kinematics
from .search import failing
from .starts import first_values

MOST_OUTSIDE = 0.5
"""Greatest share of measured places outside the body: what is around it in the image may be
measured, too, but not most of it.
"""


def start_maps(model, y: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Give the maps from images to scenes their starts; return the roots of the weights, 0 for
    points beside the body or whose subset crosses an edge.
    """
    root = root.copy()
    model.left_out_ = 0
    for test, here in model.tests_ if model.frame == "image" else ():
        law = model.unknown_.law_of(first_values(model))
        with failing(f"the search cannot start at {law.describe()}"):
            motion = test.motion(law)
        sight = test.rows.sight(test.steps, y[here], root[here])[0]
        if len(test.image_places) < FEWEST:
            raise ValueError(f"a map from an image needs at least {FEWEST} measured places")
        trial = trial_of(model, test, motion, sight)
        fit, deviations = trial.start(sight)
        outside = _beside(test.scene, motion, fit.map, test.image_places, 0.0)
        size = np.sqrt(np.nanmean((sight.root * sight.displacements) ** 2))
        bad = fit.rms > max(BAD, DOUBTFUL * size) or outside.mean() > MOST_OUTSIDE
        if bad and (cause := cause_of(trial, SURELY)):
            raise ValueError(f"y: {cause}")
        if outside.mean() > MOST_OUTSIDE:
            raise ValueError(
                f"{outside.sum()} of {len(outside)} measured places lie outside the body of the"
                " scene: give the scale and the origin of the image (--pixels-per, --origin)"
            )
        half = 0.0 if model.subset is None else model.subset / 2
        beside = _beside(test.scene, motion, fit.map, test.image_places, half)
        test.take(fit.map, deviations, beside)
        out = test.at(beside)
        model.left_out_ += int(out.sum()) // test.scene.dimension
        root[here[out]] = 0.0
        test.weigh(y[here], root[here])
        if not (root[here][test.rows.is_field] > 0).any():
            raise ValueError("subset: all measured places are nearer to an edge than half of it")
    return root


def _beside(
    scene: Scene, motion: Kinematics, start: ImageMap, places: np.ndarray, half: float
) -> np.ndarray:
    """Return which places of an image (n, d) lie outside the body, or nearer to its edges than
    half a subset.
    """
    d = places.shape[1]
    ways = np.stack(np.meshgrid(*[(-half, 0.0, half)] * d), axis=-1).reshape(-1, d)
    corners = start.to_scene((places[:, None] + ways).reshape(-1, d))
    if isinstance(scene.body, Mesh):
        out = motion.outside(corners)
    else:
        out = ~scene.body.contains(corners)
        for hole in scene.holes:
            out |= hole.contains(corners)
    return out.reshape(len(places), -1).any(axis=1)


def store_maps(model, sizes: np.ndarray) -> None:
    """Store the fitted maps with their standard errors, by the covariance of the parameters, whose
    derivatives by the variables of the search are `sizes`.
    """
    model.maps_ = {}
    if model.frame != "image":
        return
    covariance = model.covariance_ / np.outer(sizes, sizes)
    covariance[~np.isfinite(covariance)] = 0.0
    for test, _ in model.tests_:
        model.maps_[test.number] = test.fitted_map(covariance, max(1.0, model.lack_of_fit_))
