"""Check that the body of a scene fits into memory, before it is built."""

import math
import os
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..body import MOST_POINTS
from ..scenes import Mesh, Scene, SceneError
from .cells import lattice_of
from .material import material_at
from .meshes import mesh_of

BYTES_PER_BOND = 50
"""Least memory in bytes for every directed bond of a body, with its share of points, forces and
equilibrium.

A sheet of a million points with 28 bonds each needed 1.4 GB (docs/validation/ranks.md). This is a
lower bound: every body that it rejects would not have fitted.
"""

SAMPLED = 32
"""Sampled places along each side of the box around a body: 1,024 of a sheet and 32,768 of a solid
estimate its share of material, which suffices for a bound on memory.
"""


def memory_here() -> float:
    """Return the physical memory of this machine in bytes, or the limit of the process's control
    group if lower; infinite if unknown.
    """
    found = [math.inf]
    with suppress(AttributeError, OSError, ValueError):
        found.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    with suppress(OSError, ValueError):  # "max" where there is no bound
        found.append(float(Path("/sys/fs/cgroup/memory.max").read_text()))
    return min(found)


def estimated_points(scene: Scene) -> float:
    """Return about how many points the body of a scene will have; of a mesh, the number of its
    cells.

    Raises
    ------
    SceneError
        If the file of a mesh cannot be read.
    """
    if isinstance(scene.body, Mesh):
        try:
            return float(len(mesh_of(scene.body).cells))
        except ValueError as error:
            raise SceneError(f"scene {scene.name}: {error}") from None
    lower, upper = (np.array(corner, dtype=float) for corner in scene.body.bounds())
    dimension = len(lower)
    places = lattice_of(*[(np.arange(SAMPLED) + 0.5) / SAMPLED] * dimension)
    return float(
        np.prod((upper - lower) / scene.spacing)
        * material_at(scene, lower + places * (upper - lower)).mean()
    )


def check_size(scene: Scene, memory: float) -> None:
    """Raise SceneError for a body with more points than allowed, or than fit into memory.

    Parameters
    ----------
    scene : Scene
    memory : float
        Available memory in bytes.

    Raises
    ------
    SceneError
        If the body is too large; the message states its number of points and the least possible
        spacing.
    """
    if isinstance(
        scene.body, Mesh
    ):  # its points are the cells of a file, which somebody has had in memory
        return
    lower, upper = (np.array(corner, dtype=float) for corner in scene.body.bounds())
    dimension = len(lower)
    cells = float(np.prod((upper - lower) / scene.spacing))
    ball = math.pi if dimension == 2 else 4 / 3 * math.pi
    bytes_per_point = (ball * scene.horizon_ratio**dimension - 1) * BYTES_PER_BOND
    if cells <= MOST_POINTS and cells * bytes_per_point <= memory:
        return
    points = estimated_points(scene)
    needed = points * bytes_per_point
    # Every cell of the box is tested, so that their number is bounded as well.
    excess = max(cells / MOST_POINTS, needed / memory)
    if excess <= 1:
        return
    why = f"the limit is {MOST_POINTS:.3g}"
    if needed > memory:
        why = (
            f"they need at least {needed / 1e9:.3g} GB of memory, and {memory / 1e9:.3g} GB are"
            " available"
        )
    least = scene.spacing * excess ** (1 / dimension)
    raise SceneError(
        f"scene {scene.name}: spacing {scene.spacing:g} makes {points:.3g} points; {why}; use a"
        f" spacing above {least:.2g}"
    )
