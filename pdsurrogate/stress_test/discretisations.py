"""Awkward discretisations: jittered points, short and long horizons, loose points, folded bonds, the tip of a notch."""

from __future__ import annotations

import numpy as np

from ..body import Body, ReflectionPlane, grid
from ..forces import InvalidState
from ..materials import homogeneous, plane_stress
from ..solvers import Automatic, Diverging, NotConverged
from .case import PASS, SPACING, STOPS, WEAK, Case, Outcome, Subject, middle_point, square_sheet
from .deformations import MOST_ERROR, force_densities, turn, why_inaccurate
from .tangents import resistance

HORIZONS = (2.015, 3.015, 3.15, 4.0, 6.0)


def _stretch_2(subject: Subject) -> np.ndarray:
    return np.diag([2.0, homogeneous.uniaxial(subject.law, 2.0).lateral_stretch])


def _patch_error(subject: Subject, body: Body, F: np.ndarray) -> float:
    """Error of the mean stress of a body in a homogeneous state, over the greatest component of the exact one."""
    force = subject.bind(body)
    force(body.points @ F.T, np.empty_like(body.points))
    exact = plane_stress.first_piola_stress(subject.law, F)
    return float(np.abs(force.mean_stress() - exact).max() / np.abs(exact).max())


def jitter(subject: Subject) -> Outcome:
    """Points moved by up to 30 % of the spacing in each direction: mean stress and stability at stretch 2, the worst of three draws.

    The least resistance is held against a tenth of a membrane's: beside what the horizon takes off (see
    `tangents.least_eigenvalue`), single horizons are now lopsided.
    """
    points, F = grid((0, 0), (10 * SPACING, 10 * SPACING), SPACING), _stretch_2(subject)
    errors, least = [], []
    for seed in range(3):
        shift = 0.3 * SPACING * np.random.default_rng(seed).uniform(-1, 1, points.shape)
        body = Body(points + shift, np.full(len(points), SPACING**2), 3.15 * SPACING, SPACING)
        errors.append(_patch_error(subject, body, F))
        least.append(resistance(subject, body, F))
    error, resisted = max(errors), min(least)
    figure = f"{error:.1e}, resistance {resisted:.2g}"
    if resisted < 0.1:
        return Outcome(WEAK, figure, resisted, 0.1, "zero-energy modes" if resisted > -0.1 else "loses stability")
    if error > MOST_ERROR:
        return Outcome(WEAK, figure, error, MOST_ERROR, why_inaccurate(subject))
    return Outcome(PASS, figure, error, MOST_ERROR)


def horizons(subject: Subject) -> Outcome:
    """Horizons of 2.015 to 6 spacings: stability at uniaxial stretch 2, the least over all.

    Twelve spacings of sheet leave the longest horizon nothing but edges; a tenth of a membrane's resistance is asked, as for
    jittered points.
    """
    least = {ratio: resistance(subject, square_sheet(12, ratio), _stretch_2(subject)) for ratio in HORIZONS}
    ratio = min(least, key=least.get)
    weakness = "zero-energy modes" if least[ratio] > -0.1 else "loses stability"
    return Outcome.above(least[ratio], 0.1, weakness, f"{{:.2g}} ({ratio:g} dx)")


def loose_points(subject: Subject) -> Outcome:
    """A sheet with a point on a single bond, and beside it three points, two, and one: each turned by 180 degrees in its own place.

    Nothing is deformed, so nothing may be pushed, and nothing may come out that is not a number.  Greatest force density in mu/dx.
    """
    sheet = grid((0, 0), (8 * SPACING, 8 * SPACING), SPACING)
    # Within reach of the corner alone: 2.9 spacings along the diagonal.
    dangling = sheet.max(axis=0) + 2.9 * SPACING / np.sqrt(2)
    three, two = SPACING * np.array([[20, 0], [21, 0], [20, 1]]), SPACING * np.array([[20, 10], [21, 10]])
    points = np.vstack([sheet, dangling, three, two, SPACING * np.array([[20.0, 20.0]])])
    body = Body(points, np.full(len(points), SPACING**2), 3.15 * SPACING, SPACING)
    pieces = np.split(np.arange(len(points)), np.cumsum([len(sheet) + 1, 3, 2]))
    positions = points.copy()
    for piece in pieces:
        middle = points[piece].mean(axis=0)
        positions[piece] = middle + (points[piece] - middle) @ turn(180).T
    force = subject.bind(body)
    greatest = np.abs(force_densities(force, positions)).max()
    return Outcome.below(greatest, 1e-9, "force at rest")


def folded_bond(subject: Subject) -> Outcome:
    """A point pushed through its neighbour to the far side, 2 spacings: the bond between them is folded back through 180 degrees.

    On the way the force must push it back, or the run must stop and say where.  Then the body is let go from 1.2 spacings: it must come
    back to rest within a thousandth of a spacing, the tolerance of the solver in positions with room to spare, or stop clearly.
    """
    body = square_sheet(12)
    force = subject.bind(body)
    point = middle_point(body) + 1
    restoring, stop = [], None
    for distance in np.linspace(0.1, 2.0, 20):
        positions = body.points.copy()
        positions[point, 0] -= distance * SPACING
        try:
            restoring.append(force_densities(force, positions)[point, 0])
        except InvalidState as error:
            stop = f"at {distance:.1f} dx: {error}"
            break
    least = min(restoring, default=np.inf)
    if least <= 0:
        return Outcome(WEAK, f"pushed on with {-least:.1g} mu/dx", least, 0.0, "zero-energy modes")
    margin = np.minimum(body.points - body.points.min(axis=0), body.points.max(axis=0) - body.points).min(axis=1)
    free = np.repeat((margin > 0.5 * SPACING)[:, None], 2, axis=1).astype(float)
    positions = body.points.copy()
    positions[point, 0] -= 1.2 * SPACING
    try:
        Automatic(free, body.volumes, 1e-6, 20_000).solve(subject.bind(body), positions)
    except InvalidState as error:
        return Outcome(STOPS, stop or f"does not return from 1.2 dx: {error}")
    except (NotConverged, Diverging) as error:
        return Outcome(WEAK, str(error), None, None, "does not converge")
    away = np.abs(positions - body.points).max() / SPACING
    return Outcome.below(away, 1e-3, "zero-energy modes", f"at least {least:.2g} mu/dx back; returns to {{:.0e}} dx")


def notch_tip(subject: Subject) -> Outcome:
    """A notch of 3 spacings in the edge of a square that is stretched to 2: equilibrium, no point turned inside out, and a smooth field.

    The figure is the root mean square of the part of the displacements that changes sign from point to point in both
    directions, over the greatest displacement.  The field near a tip goes with the root of the distance, which gives this filter a few
    thousandths; a mode of zero energy gives tenths.  0.02 is asked.
    """
    cells, notch = 20, 3
    size = cells * SPACING
    planes = tuple(ReflectionPlane(1, place, side, (-1, -1)) for place, side in ((0.0, -1), (size, 1)))

    def cut(start, end):
        middle = size / 2
        crosses = (start[:, 1] - middle) * (end[:, 1] - middle) < 0
        share = (middle - start[:, 1]) / np.where(crosses, end[:, 1] - start[:, 1], 1.0)
        return crosses & (start[:, 0] + share * (end[:, 0] - start[:, 0]) < notch * SPACING)

    body = Body.rectangle(size, size, SPACING, 3.15 * SPACING, planes=planes, separates=cut)
    force = subject.bind(body)
    free, positions = np.ones_like(body.points), body.points.copy()
    reached = 1.0
    try:
        for target in (1.25, 1.5, 1.75, 2.0):
            positions[:, 1] *= target / reached
            force.move_plane(1, [0.0, (target - 1) * size])
            Automatic(free, body.volumes, 1e-6, 20_000).solve(force, positions)
            reached = target
    except (InvalidState, NotConverged, Diverging) as error:
        return Outcome(WEAK, f"stretch {target:g}: {error}", None, None, "does not converge")
    moved = (positions - body.points).reshape(cells, cells, 2)
    second = moved[:-2] - 2 * moved[1:-1] + moved[2:]
    rough = (second[:, :-2] - 2 * second[:, 1:-1] + second[:, 2:]) / 16
    # Not across the notch, where the displacement jumps.
    rows = np.arange(1, cells - 1)
    smooth = np.ones((cells - 2, cells - 2), dtype=bool)
    smooth[np.ix_(np.abs(rows + 0.5 - cells / 2) < 2, rows <= notch + 1)] = False
    figure = np.sqrt((rough[smooth] ** 2).mean()) / np.abs(moved).max()
    return Outcome.below(figure, 0.02, "zero-energy modes")


CASES = (
    Case("points jittered by 30 % of dx", "stress within 0.1 %, and stable, at stretch 2", jitter),
    Case("horizon 2.015, 3.015, 3.15, 4, 6 dx", "stable at stretch 2", horizons),
    Case("one-bond point, fragments, isolated point", "each turned by 180 degrees: forces below 1e-9 mu/dx", loose_points),
    Case("bond folded back through 180 degrees", "pushed back all the way, and back to rest, or a clear stop", folded_bond),
    Case("notch tip of 3 spacings, stretch 2", "equilibrium, sign-changing part below 0.02", notch_tip),
)
