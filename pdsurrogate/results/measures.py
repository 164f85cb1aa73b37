"""What is read from a deformed body: stresses, displacements of its edges, fields on its points."""

from __future__ import annotations

import numpy as np

from ..body import Body
from ..forces import InternalForce
from ..materials import plane_stress


def mean_stress(force: InternalForce) -> np.ndarray:
    """Volume mean of the first Piola-Kirchhoff stress, work-conjugate to the mean deformation gradient, shape (2, 2).

    (1/V) sum of f (x) x over the bonds; of a bond with an image, half lies within the body.  A force with an energy gives its derivative.
    """
    if hasattr(force, "mean_stress"):
        return force.mean_stress()
    bonds, points = force.body.bonds, force.body.all_points
    share = np.where(bonds.second < len(force.body), 1.0, 0.5)
    vectors = points[bonds.second] - points[bonds.first]
    return np.einsum("b,bi,bj->ij", share, force.pair_forces(), vectors) / force.body.volumes.sum()


def edge_displacements(body: Body, displacements: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement along `axis` of the two edges that bound the body along it, extrapolated to them.

    Points are taken line by line across the body, the lines one cell wide; the two outermost points of each line
    are continued linearly to the outermost coordinate of the body plus half a cell.

    Returns
    -------
    position, lower, upper : ndarray, shape (lines,)
        Coordinate of each line along the other axis, and the displacement of its lower and upper end.
    """
    along = body.points[:, 1 - axis]
    line = np.floor((along - along.min()) / body.cell[1 - axis] + 0.5).astype(int)
    order = np.lexsort((body.points[:, axis], line))
    starts = np.flatnonzero(np.r_[True, np.diff(line[order]) > 0])
    stops = np.r_[starts[1:], len(order)]
    full = stops - starts >= 2
    starts, stops = starts[full], stops[full]
    x, u = body.points[order, axis], displacements[order, axis]
    low, high = x.min() - body.cell[axis] / 2, x.max() + body.cell[axis] / 2

    def continued(outer, inner, place):
        return u[outer] + (u[outer] - u[inner]) * (place - x[outer]) / (x[outer] - x[inner])

    return along[order][starts], continued(starts, starts + 1, low), continued(stops - 1, stops - 2, high)


def roughness(body: Body, displacements: np.ndarray, axis: int) -> float:
    """Roughness of the lateral displacement along the loaded axis: zero-energy modes show in it.

    Root mean square of its second differences between neighbouring points, over its greatest value.  A smooth field
    of wavelength L gives about (2 pi cell/L)^2 / 2; a mode that changes sign from point to point, of order 1.
    """
    lateral = 1 - axis
    line = np.floor((body.points[:, lateral] - body.points[:, lateral].min()) / body.cell[lateral] + 0.5).astype(int)
    order = np.lexsort((body.points[:, axis], line))
    u, x, line = displacements[order, lateral], body.points[order, axis], line[order]
    neighbours = (line[2:] == line[:-2]) & (np.abs(x[2:] - x[:-2] - 2 * body.cell[axis]) < 0.1 * body.cell[axis])
    second = (u[2:] - 2 * u[1:-1] + u[:-2])[neighbours]
    greatest = np.abs(u).max()
    return float(np.sqrt((second**2).mean()) / greatest) if len(second) and greatest > 0 else 0.0


def point_fields(force: InternalForce, positions: np.ndarray) -> dict[str, np.ndarray]:
    """Fields on the points, for result files.

    ``displacement`` (n, 3), ``stretch`` (greatest principal stretch), ``J`` (three-dimensional volume ratio),
    ``stress`` (first Piola-Kirchhoff, in the scene's unit) and ``deformation_gradient``, the last two 3 x 3 row by
    row.
    """
    kinematics, law, n = force.kinematics, force.law, len(force.body)
    kinematics.update(positions)  # a model may have no use for the points' own gradients
    F = kinematics.deformation_gradients()
    trace, area = (F * F).sum(axis=(1, 2)), np.linalg.det(F)
    J3 = kinematics.volume_ratios[:n]
    p, q, *_ = plane_stress.response(law, trace, area, J3)
    cofactor = np.stack([F[:, 1, 1], -F[:, 1, 0], -F[:, 0, 1], F[:, 0, 0]], axis=1).reshape(n, 2, 2)
    stress = np.zeros((n, 3, 3))
    stress[:, :2, :2] = law.shear_modulus * (p[:, None, None] * F + (q / area)[:, None, None] * cofactor)
    gradient = np.zeros((n, 3, 3))
    gradient[:, :2, :2] = F
    gradient[:, 2, 2] = J3 / area
    displacement = np.zeros((n, 3))
    displacement[:, :2] = positions - force.body.points
    return {
        "displacement": displacement,
        "stretch": np.sqrt((trace + np.sqrt(np.maximum(trace**2 - 4 * area**2, 0))) / 2),
        "J": J3.copy(),
        "stress": stress.reshape(n, 9),
        "deformation_gradient": gradient.reshape(n, 9),
    }
