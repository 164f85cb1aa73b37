"""What is read from a deformed body: its energy, displacements of its edges, fields on its points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..body import Body
from ..forces import InternalForce
from ..materials import PLANES, plane_strain, plane_stress


def strain_energy(force: InternalForce) -> float:
    """Stored energy per unit thickness in the state last evaluated.

    The force's own; of a force map, which has none, that of the points' deformation gradients.
    """
    if force.has_energy:
        return force.energy()
    trace, J = plane_stress.invariants(force.deformation_gradients())
    J3, volumes, response = force.volume_ratios(), force.body.volumes, PLANES[force.plane].response
    energies = (
        law.shear_modulus * (response(law, trace[points], J[points], J3[points])[4] * volumes[points]).sum() for law, points in force.laws
    )
    return float(sum(energies))


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


class PointState:
    """What the fields on the points are functions of.

    Parameters
    ----------
    force : InternalForce
        Asked for deformation gradients and thickness alone.
    positions : ndarray, shape (n, 2)
    damage : ndarray, shape (n,), optional
        Of a run in which bonds break.

    Attributes
    ----------
    F : ndarray, shape (n, 2, 2)
    trace, area : ndarray, shape (n,)
        tr C and det F in the plane.
    volume_ratio : ndarray, shape (n,)
        J3, where the volumetric energy is taken.
    bulk_stress : ndarray, shape (n,)
        What the bonds feel of U' there, in units of mu; in plane strain alone.
    """

    def __init__(self, force: InternalForce, positions: np.ndarray, damage: np.ndarray | None = None) -> None:
        force.place(positions)
        self.laws, self.plane, self.displacement, self.damage = force.laws, force.plane, positions - force.body.points, damage
        self.volume_ratio, self.F = force.volume_ratios(), force.deformation_gradients()
        if self.plane == "strain":
            self.bulk_stress = force.bulk_stresses()
        self.trace, self.area = (self.F * self.F).sum(axis=(1, 2)), np.linalg.det(self.F)

    def greatest_stretch(self) -> np.ndarray:
        """Greatest principal stretch in the plane, shape (n,)."""
        return np.sqrt((self.trace + np.sqrt(np.maximum(self.trace**2 - 4 * self.area**2, 0))) / 2)

    def stress(self) -> np.ndarray:
        """First Piola-Kirchhoff stress, shape (n, 3, 3)."""
        stress = np.zeros((len(self.F), 3, 3))
        for law, points in self.laws:
            if self.plane == "strain":
                stress[points] = plane_strain.full_stress(law, self.F[points], self.bulk_stress[points])
                continue
            p, q, *_ = plane_stress.response(law, self.trace[points], self.area[points], self.volume_ratio[points])
            stress[points, :2, :2] = law.shear_modulus * plane_stress.in_plane_stress(self.F[points], p, q)
        return stress

    def deformation_gradient(self) -> np.ndarray:
        """F with the stretch of the thickness, shape (n, 3, 3)."""
        gradient = np.zeros((len(self.F), 3, 3))
        gradient[:, :2, :2], gradient[:, 2, 2] = self.F, 1.0 if self.plane == "strain" else self.volume_ratio / self.area
        return gradient


@dataclass(frozen=True)
class PointField:
    """A field on the points, for result files.

    Attributes
    ----------
    values : callable
        Function of a `PointState`; None where the field has no meaning.
    components : int
        Of a point; a tensor has 9, row by row.
    unit : {"length", "stress", None}
        Which of the scene's units the values have; None if they have none.
    """

    values: Callable[[PointState], np.ndarray | None]
    components: int = 1
    unit: str | None = None


POINT_FIELDS = {
    "displacement": PointField(lambda state: np.pad(state.displacement, ((0, 0), (0, 1))), 3, "length"),
    "principal_stretch": PointField(PointState.greatest_stretch),
    "volume_ratio": PointField(lambda state: state.volume_ratio.copy()),
    "stress": PointField(PointState.stress, 9, "stress"),
    "deformation_gradient": PointField(PointState.deformation_gradient, 9),
    "damage": PointField(lambda state: state.damage),
}
"""All fields on the points, by their names in result files: a new one is one line."""


def point_fields(state: PointState) -> dict[str, np.ndarray]:
    """The fields of `POINT_FIELDS` that have a meaning in a state, shape (n,) or (n, components)."""
    fields = {}
    for name, field in POINT_FIELDS.items():
        values = field.values(state)
        if values is not None:
            fields[name] = values if field.components == 1 else values.reshape(-1, field.components)
    return fields
