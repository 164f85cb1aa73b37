"""Scenes of a `SceneRegressor`, the spacings at which it simulates them, and the sizes of its
parameters.
"""

from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

import numpy as np

from ..arguments import check_kind
from ..identification import nominal_stress
from ..materials import LAWS
from ..materials.covariance import slopes_of
from ..problem.program import stages_of
from ..scenes import Mesh, Scene, load_scene

REFINED = 3
REFINED_FREE = 6
"""Default ratio of the spacing of a scene to that of the finer simulation, with a law and without.
Chosen: for Carroll's law, fields with a noise of 1e-4 of the length and a sheet 20 points across,
equibiaxial stresses of a free energy are 6 % off with 4 and 4 % with 6.
"""


def stress_derivatives(model, X: np.ndarray) -> np.ndarray:
    """Return the derivatives of `nominal_stress` by the parameters, shape (n_samples,
    n_parameters).
    """
    return slopes_of(
        lambda values: nominal_stress(model.unknown_.law_of(values), X),
        model.parameters_,
        1e-5 * scales_of(model),
    )


def scenes_of(model) -> list[Scene]:
    """Return the scenes, loaded if they are given by name; raise ValueError for none or for
    bodies of different dimension.
    """
    scenes: list[Scene] = []
    given: Sequence = model.scene if isinstance(model.scene, list | tuple) else [model.scene]
    for one in (load_scene(each) if isinstance(each, str | Path) else each for each in given):
        check_kind(one, Scene, "scene", "a Scene, or the name or file of one, or a list of these")
        if ratio_of(model) > 1 and isinstance(one.body, Mesh):
            raise ValueError(
                f"refine: scene {one.name} is a mesh, which has a spacing of its own: set"
                " refine=1 (--refine 1)"
            )
        scenes.append(one)
    if not scenes:
        raise ValueError("scene: the list is empty; give at least one scene")
    if len({one.dimension for one in scenes}) > 1:
        raise ValueError(
            "scene: bodies in the plane and solids cannot share a table, as their places have"
            " different columns"
        )
    return scenes


def ratio_of(model) -> int:
    """Return the ratio of the spacings, `refine` or its default."""
    return (
        (REFINED_FREE if model.law is None else REFINED) if model.refine is None else model.refine
    )


def fine_spacing(model, scene: Scene) -> float | None:
    """Return the spacing of the finer simulation of a scene; None for the scene's own."""
    ratio = ratio_of(model)
    return None if ratio == 1 or scene.spacing is None else scene.spacing / ratio


def times_of(scene: Scene) -> np.ndarray:
    """Return the times of the outputs of a scene, as far as its steps have durations."""
    timed = takewhile(lambda stage: stage.duration is not None, stages_of(scene))
    return np.cumsum(
        [stage.duration / stage.outputs for stage in timed for _ in range(stage.outputs)]
    )


def scales_of(model) -> np.ndarray:
    """Return the sizes of the parameters by which they are compared: their values, or a
    hundredth of the range between bounds.
    """
    if model.law is None:
        return np.abs(model.parameters_)
    spans = [LAWS[model.law].bounds.get(name, (0.0, 0.0)) for name in model.parameter_names_]
    return np.maximum(
        np.abs(model.parameters_), [1e-2 * min(high - low, 1.0) for low, high in spans]
    )
