"""Finite element solutions that scenes are compared with, kept with the problem that each belongs to."""

from __future__ import annotations

import json
from functools import cache
from importlib import resources

import numpy as np

from .model import Scene


@cache
def _cases() -> list[dict]:
    return json.loads((resources.files(__package__) / "fem.json").read_text("utf-8"))["cases"]


def finite_element_level(scene: Scene, stretch: float) -> dict[str, float]:
    """The finite element solution of a scene at a stretch.

    Returns
    -------
    dict
        nominal_stress and, where known, greatest_lateral_displacement, in the scene's units; empty if this problem was not solved at
        that stretch.
        Stresses are scaled to the scene's shear modulus, which changes no displacement at the same K/mu.
    """
    law = scene.material.build()
    problem = scene.model_dump(mode="json", include={"body", "holes", "precuts", "grips"})
    for case in _cases():
        same = all(problem[key] == case[key] for key in problem) and not scene.holds
        ratio = case["bulk_modulus"] / case["shear_modulus"]
        if not (same and law.name == case["law"] and np.isclose(law.bulk_modulus / law.shear_modulus, ratio)):
            continue
        for level in case["levels"]:
            if np.isclose(level["stretch"], stretch):
                scale = law.shear_modulus / case["shear_modulus"]
                values = {key: value for key, value in level.items() if key != "stretch"}
                values["nominal_stress"] *= scale
                return values
    return {}
