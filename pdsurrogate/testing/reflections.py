"""Properties required of forces and loads at planes of symmetry: parts equal their wholes."""

import warnings
from typing import Any

import numpy as np
import scipy

from ..body import ReflectionPlane
from ..problem import compile_scene
from ..problem.materials import checked_models
from .bodies import (
    SPACING,
    plain,
)
from .forces import error_of, tested
from .subject import Subject, forces_at, off


@tested(1e-11)
def reflected_half(subject: Subject) -> float:
    """Return the difference of the forces on half a body at a reflection plane and on that half of
    the whole, symmetrically deformed.

    Ghosts (mirror images) take the place of the other half, so the same bonds are summed in another
    order.
    """
    d = subject.dimension
    half = plain(d, width=0.6, planes=(ReflectionPlane(0, 0.6, 1, (-1, 1, 1)[:d]),))
    whole = plain(d, width=1.2)
    x1, x2, *rest = (whole.points - [0.6, 0, 0][:d]).T
    across = [0.8 * x3 + 0.03 * x2 * x1**2 for x3 in rest]
    positions = np.column_stack(
        [0.6 + 1.4 * x1 + 0.1 * x1 * np.cos(3 * x2), 0.9 * x2 + 0.05 * x1**2, *across]
    )
    left = whole.points[:, 0] < 0.6
    force = subject.bind(whole)
    expected = forces_at(force, positions)
    found = forces_at(subject.bind(half), positions[left])
    return error_of(force, found, expected[left])


CUTS = {
    2: (
        {"start": (0.0, -0.3), "end": (0.42, -0.3)},
        {"start": (-0.42, -0.3), "end": (0.42, -0.3)},
        {"start": (0.1, 0.1), "end": (0.1, 0.5)},
        {"start": (-0.1, 0.5), "end": (-0.1, 0.1)},
    ),
    3: (
        *({"center": (0.0, -0.3, 0.0), "radius": 0.35, "normal": (0.0, 1.0, 0.0)},) * 2,
        {"center": (0.1, 0.2, 0.0), "radius": 0.3, "normal": (1.0, 0.0, 0.0)},
        {"center": (-0.1, 0.2, 0.0), "radius": 0.3, "normal": (-1.0, 0.0, 0.0)},
    ),
}
"""Cuts of `reflected_parts`, by dimension: one that meets the plane x1 = 0, of the half and of the
whole, and one a cell beside the plane, with its image.
"""


@tested(1e-6)
def reflected_parts(subject: Subject) -> float:
    """Return the difference of the forces and loads on a half with cuts and a quarter with a hole,
    at or beside planes of symmetry, and on these parts of the wholes.

    Weights that balance the boundary are solutions to 1e-8, and the ends of faces of cuts follow
    places some 1e-6 cells inside.
    """
    d = subject.dimension
    errors = []
    hole = {"radius": 0.33} if d == 2 else {"radius": 0.33, "base": (0, 0, -0.2), "length": 0.4}
    holed = {
        "holes": [{"shape": subject.sized("circle", "cylinder"), **hole}],
        "loads": [{"region": "holes", "pressure": 0.2}],
    }
    met, all_met, near, image = CUTS[d]
    for axes, of_part, of_whole in (
        ((0, 1), holed, holed),
        ((0,), {"precuts": [met, near]}, {"precuts": [all_met, near, image]}),
    ):
        part, own = _deformed_at(subject, axes, of_part)
        whole, expected = _deformed_at(subject, (), of_whole)
        errors.append(off(own, expected[scipy.spatial.cKDTree(whole).query(part)[1]]))
    return np.max(errors)


def _deformed_at(
    subject: Subject, axes: tuple[int, ...], described: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (n, d) of a body 1.6 wide, or of its part between planes of symmetry
    normal to `axes`, and the forces and loads on it in a state symmetric about these.
    """
    d = subject.dimension
    lower = np.array([-0.8 * (axis not in axes) for axis in (0, 1)] + [-0.2])[:d]
    upper = np.array([0.8, 0.8, 0.2])[:d]
    corner = {"box": ((upper - 0.2).tolist(), upper.tolist())}
    scene = subject.scene(
        (),
        spacing=SPACING,
        steps=1.0,
        body={"shape": subject.sized("rectangle", "box"), "size": upper - lower, "lower": lower},
        prescribed=[
            *({"region": ("left", "bottom")[axis], f"x{axis + 1}": 0.0} for axis in axes),
            subject.held_at(corner),
        ],
        **described,
    )
    with warnings.catch_warnings(action="ignore"):
        problem = compile_scene(scene, checked_models(scene, subject.model))
        _, force = problem.bind("float64")
    x1, x2, *rest = points = problem.body.points.T
    stretched = [
        1.1 * x1 + 0.05 * x1 * np.cos(2 * x2),
        0.95 * x2 + 0.05 * x2 * x1**2,
        *(0.9 * x3 + 0.05 * x2**2 for x3 in rest),
    ]
    force.loads.set(1.0)
    return points.T, forces_at(force, np.column_stack(stretched))
