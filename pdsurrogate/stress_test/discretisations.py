"""Awkward discretisations: jittered points, meshes, short and long horizons, loose points, folded bonds, the tip of a notch."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..body import Body, ReflectionPlane
from ..forces import InternalForce, InvalidState
from ..solvers.automatic import Automatic
from ..solvers.equilibrium import Diverging, NotConverged
from .bodies import HORIZONS, SPACING, crack, inner_points, middle_point, of_points, of_simplices
from .case import STOPS, WEAK, Ended, Outcome, Subject, case
from .deformations import force_densities, judged_patches, turn
from .tangents import CELLS, resistance, why_not_resisted

RATIOS = (2.015, 3.015, 3.15, 4.0, 6.0), (1.5, 1.75, 2.015, 2.5, 3.015)
"""Horizons in spacings, in the plane and in three dimensions."""


def _awkward_patches(subject: Subject, make: Callable[[np.random.Generator], Body]) -> Outcome:
    """Test random bodies at stretch 2 by mean stress and stability, the worst of three.

    The resistance must be a tenth of a continuum's: besides the effect of the horizon (see `tangents.least_eigenvalue`), single horizons
    are asymmetric.
    """
    bodies = [make(np.random.default_rng(seed)) for seed in range(3)]
    return judged_patches(subject, bodies, subject.uniaxial(2.0), 0.1)


@case("points jittered by 30 % of dx", "stress within 0.1 %, and stable, at stretch 2")
def jitter(subject: Subject) -> Outcome:
    """Test points moved by up to 30 % of the spacing in each direction by mean stress and stability at stretch 2, the worst of three."""
    points = subject.body(10, 6).points
    return _awkward_patches(subject, lambda random: of_points(points + 0.3 * SPACING * random.uniform(-1, 1, points.shape)))


@case("triangles or tetrahedra", "stress within 0.1 %, and stable, at stretch 2")
def mesh(subject: Subject) -> Outcome:
    """Test points of triangles or tetrahedra, all different, by mean stress and stability at stretch 2, the worst of three draws."""
    return _awkward_patches(subject, lambda random: of_simplices(random, subject.dimension, subject.sized(8, 4)))


@case("short and long horizons", "stable at stretch 2")
def horizons(subject: Subject) -> Outcome:
    """Test horizons of 2.015 to 6 spacings, 1.5 to 3.015 in three dimensions, by the least stability at uniaxial stretch 2.

    In twelve spacings of sheet, or seven of a cube, the longest horizon is cut by an edge everywhere; a tenth of a continuum's resistance
    is required, as for jittered points.
    """
    F = subject.uniaxial(2.0)
    least = {f"{ratio:g} dx": resistance(subject, subject.body(*CELLS, ratio), F) for ratio in subject.sized(*RATIOS)}
    return Outcome.above(least, 0.1, why_not_resisted(min(least.values()), 0.1))


@case("one-bond point, fragments, isolated point", "each turned by 180 degrees: forces below 1e-9 mu/dx")
def loose_points(subject: Subject) -> Outcome:
    """Test a body with a point on a single bond, and three, two and one separate points, each turned by 180 degrees in place.

    Nothing is deformed, so the forces must vanish, without NaN. The figure is the greatest force density in mu/dx.
    """
    d, whole = subject.dimension, subject.body(8, 5).points
    # Nearly a horizon along the diagonal, so that only the corner is within reach.
    dangling = whole.max(axis=0) + (HORIZONS[d] - 0.25) * SPACING / np.sqrt(d)
    across, up = SPACING * np.eye(d)[:2]
    three, two, one = 20 * across + [0 * up, across, up], 20 * across + 10 * up + [0 * up, across], 20 * across + [20 * up]
    body = of_points(np.vstack([whole, dangling, three, two, one]))
    positions = body.points.copy()
    for piece in np.split(np.arange(len(body)), np.cumsum([len(whole) + 1, 3, 2])):
        middle = positions[piece].mean(axis=0)
        positions[piece] = middle + (positions[piece] - middle) @ turn(180, d).T
    return Outcome.below(np.abs(force_densities(subject.bind(body), positions)).max(), 1e-9, "force at rest")


@case("bond folded back through 180 degrees", "pushed back all the way, and back to rest, or a clear stop", failing="does not converge")
def folded_bond(subject: Subject) -> Outcome:
    """Test a point pushed through its neighbour to the far side, by 2 spacings, which folds the bond between them back by 180 degrees.

    On the way the force must push it back, or the run must stop and say where. Then the body is released from 1.2 spacings: it must return
    to rest within a thousandth of a spacing, well above the solver's tolerance in positions, or stop clearly.
    """
    body = subject.body(*CELLS)
    force, point = subject.bind(body), middle_point(body) + 1

    def pushed(distance: float) -> np.ndarray:
        positions = body.points.copy()
        positions[point, 0] -= distance * SPACING
        return positions

    restoring, stop = [], None
    for distance in np.linspace(0.1, 2.0, 20):
        try:
            restoring.append(force_densities(force, pushed(distance))[point, 0])
        except InvalidState as error:
            stop = f"at {distance:.1f} dx: {error}"
            break
    least = min(restoring, default=np.inf)
    if least <= 0:
        return Outcome(WEAK, f"pushed on with {-least:.1g} mu/dx", least, 0.0, "zero-energy modes")
    positions = pushed(1.2)
    try:
        _relax(subject.bind(body), positions, inner_points(body)[:, None] * np.ones_like(positions))
    except InvalidState as error:
        return Outcome(STOPS, stop or f"does not return from 1.2 dx: {error}")
    away = np.abs(positions - body.points).max() / SPACING
    return Outcome.below(away, 1e-3, "zero-energy modes", f"at least {least:.2g} mu/dx back; returns to {{:.0e}} dx")


def _relax(force: InternalForce, positions: np.ndarray, free: np.ndarray) -> None:
    """Move the free points to equilibrium."""
    Automatic(free, force.body.volumes, 1e-6, 20_000).solve(force, positions)


@case("notch tip of 3 spacings, stretch 2", "equilibrium, sign-changing part below 0.02")
def notch_tip(subject: Subject) -> Outcome:
    """Test a square, or plate, with a notch of 3 spacings at stretch 2: equilibrium, no point inside out, and a smooth field.

    The figure is the root mean square of the part of the displacements that alternates in sign from point to point in all directions, over
    the greatest displacement. The field near a tip varies with the root of the distance, which gives a few thousandths; a zero-energy mode
    gives tenths. The limit is 0.02.
    """
    d, notch = subject.dimension, 3
    counts = subject.sized((20, 20), (12, 12, 4))
    cells = counts[0]
    size = cells * SPACING
    planes = tuple(ReflectionPlane(1, place, side, (-1,) * d) for place, side in ((0.0, -1), (size, 1)))
    body = subject.body(counts, counts, planes=planes, separates=crack(size / 2, notch * SPACING))
    force, positions, reached = subject.bind(body), body.points.copy(), 1.0
    for target in (1.25, 1.5, 1.75, 2.0):
        positions[:, 1] *= target / reached
        force.move_plane(1, (target - 1) * size * np.eye(d)[1])
        try:
            _relax(force, positions, np.ones_like(positions))
        except (InvalidState, NotConverged, Diverging) as error:
            raise Ended(WEAK, f"stretch {target:g}: {error}", "does not converge") from error
        reached = target
    # x1 varies fastest in the order of the points.
    moved = (positions - body.points).reshape(*counts[::-1], d)
    rough = moved
    for axis in range(d):
        rough = np.moveaxis(rough, axis, 0)
        rough = np.moveaxis((rough[:-2] - 2 * rough[1:-1] + rough[2:]) / 4, 0, axis)
    # Differences across the notch, where the displacement jumps, are left out.
    rows = np.arange(1, cells - 1)
    smooth = np.ones((cells - 2, cells - 2), dtype=bool)
    smooth[np.ix_(np.abs(rows + 0.5 - cells / 2) < 2, rows <= notch + 1)] = False
    figure = np.sqrt((rough[..., smooth, :] ** 2).mean()) / np.abs(moved).max()
    return Outcome.below(figure, 0.02, "zero-energy modes")


CASES = (jitter, mesh, horizons, loose_points, folded_bond, notch_tip)
