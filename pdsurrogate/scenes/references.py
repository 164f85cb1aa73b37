"""Reference solutions with which results of scenes are compared: exact homogeneous tension, and
stored finite element solutions.
"""

import json
from functools import cache
from importlib import resources

import numpy as np

from ..materials import homogeneous
from .scene import Scene
from .shapes import Rectangle


@cache
def _cases() -> list[dict]:
    return json.loads((resources.files(__package__) / "fem.json").read_text("utf-8"))["cases"]


def reference_level(scene: Scene, stretch: float) -> dict[str, float]:
    """Return the values at a stretch of the reference solution that a scene names; empty if it
    names none, or one that does not apply.
    """
    if scene.reference is None:
        return {}
    return {"uniaxial": uniaxial_level, "finite-elements": finite_element_level}[scene.reference](
        scene, stretch
    )


def uniaxial_level(scene: Scene, stretch: float) -> dict[str, float]:
    """Return the exact homogeneous tension at a stretch, for a rectangle that only its grips hold,
    free to narrow.

    Returns
    -------
    dict
        nominal_stress, lateral_displacement and greatest_lateral_displacement, in the scene's
        units; the two displacements are equal. Empty if the scene's problem is not homogeneous, or
        its law has no such state.
    """
    others = scene.holes or scene.precuts or scene.holds or scene.fracture or scene.materials
    if (
        others
        or not isinstance(scene.body, Rectangle)
        or any(grip.holds != "normal" for grip in scene.grips)
    ):
        return {}
    try:
        exact = homogeneous.uniaxial(scene.law(), stretch, scene.plane)
    except ValueError:
        return {}
    narrowing = (1 - exact.lateral_stretch) / 2 * scene.body.size[1 - scene.loaded_axis]
    displacements = dict.fromkeys(
        ("lateral_displacement", "greatest_lateral_displacement"), narrowing
    )
    return {"nominal_stress": exact.nominal_stress, **displacements}


def finite_element_level(scene: Scene, stretch: float) -> dict[str, float]:
    """Return the stored finite element solution of a scene at a stretch.

    Returns
    -------
    dict
        nominal_stress and, where known, greatest_lateral_displacement, in the scene's units; empty
        if this problem was not solved at that stretch. Stresses are scaled to the scene's shear
        modulus; displacements depend on the law by its ratio K/mu of bulk and shear modulus alone.
    """
    law = scene.law()
    keys = {"body", "holes", "precuts", "grips", "materials"}
    points = {"arrangement", "seed"}
    body_alone = {"body": points, "holes": {"__all__": points}}
    problem = scene.model_dump(
        mode="json", include=keys, exclude=body_alone, exclude_none=True, by_alias=True
    )
    ratio = law.bulk_modulus / law.shear_modulus
    for case in [] if scene.holds else _cases():
        scale = law.shear_modulus / case["shear_modulus"]
        same = all(
            problem[key] == case.get(key, []) for key in problem
        ) and scene.plane == case.get("plane", "stress")
        same = (
            same
            and law.name == case["law"]
            and np.isclose(ratio, case["bulk_modulus"] / case["shear_modulus"])
        )
        if not same or (scene.materials and scale != 1):
            continue
        for level in case["levels"]:
            if np.isclose(level["stretch"], stretch):
                return {
                    key: value * scale if key == "nominal_stress" else value
                    for key, value in level.items()
                    if key != "stretch"
                }
    return {}
