"""Measures of a deformed body: its energy, displacements of its edges, fields on its points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..body import Body
from ..forces import InternalForce
from ..materials import PLANES
from ..materials.stretches import principal_stretches


def strain_energy(force: InternalForce) -> float:
    """Stored energy in the state last evaluated, in the plane per unit thickness.

    The force's own; of a force map, which has none, that of the points' deformation gradients.
    """
    if force.has_energy:
        return force.energy()
    F, J3, energy_at = force.deformation_gradients(), force.volume_ratios(), PLANES[force.plane].energy_at
    volumes = force.body.share.counted(force.body.volumes)
    energies = (law.shear_modulus * (energy_at(law, F[points], J3[points]) * volumes[points]).sum() for law, points in force.laws)
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
    """State of the points, from which the fields are computed.

    Parameters
    ----------
    force : InternalForce
        Asked for what it says of the points at these positions, without forces.
    positions : ndarray, shape (n, d)
    damage : ndarray, shape (n,), optional
        Of a run in which bonds break.

    Attributes
    ----------
    plane : str
        What the thickness does, or "space".
    laws : list of tuple
        The laws, each with the points that are of it.
    position, displacement : ndarray, shape (n, d)
        In the undeformed body, and since.
    F : ndarray, shape (n, d, d)
    volume_ratio : ndarray, shape (n,)
        Where the volumetric energy is taken: J3 under plane stress, det F or what a selective energy has in its place otherwise.
    stress : ndarray, shape (n, 3, 3)
        First Piola-Kirchhoff stress, see `InternalForce.stress_and_energy`.
    energy_density : ndarray, shape (n,)
        Per volume of the undeformed body.
    deviation : ndarray, shape (n,), or None
        See `InternalForce.learnt`.
    member_deviation : ndarray, shape (n,), or None
        See `InternalForce.learnt`.
    kept : dict of str
        Arrays of state that the force declares as shown, by name, see `pdsurrogate.forces.term.Kept`.
    """

    def __init__(self, force: InternalForce, positions: np.ndarray, damage: np.ndarray | None = None) -> None:
        force.place(positions)
        self.laws, self.plane, self.displacement, self.damage = force.laws, force.plane, positions - force.body.points, damage
        self.position = force.body.points
        self.volume_ratio, self.F = force.volume_ratios(), force.deformation_gradients()
        self.stress, self.energy_density = force.stress_and_energy()
        self.deviation, self.member_deviation = force.learnt.domain_deviation(), force.learnt.member_deviation()
        self.kept = {array.name: array.at_points(force.body) for array in force.states if array.shown}

    @cached_property
    def deformation_gradient(self) -> np.ndarray:
        """F, in the plane with the stretch of the thickness, shape (n, 3, 3)."""
        if self.plane == "space":
            return self.F
        gradient = np.zeros((len(self.F), 3, 3))
        gradient[:, :2, :2] = self.F
        gradient[:, 2, 2] = 1.0 if self.plane == "strain" else self.volume_ratio / np.linalg.det(self.F)
        return gradient

    @cached_property
    def cauchy_stress(self) -> np.ndarray:
        """P F^T / det F, shape (n, 3, 3)."""
        F = self.deformation_gradient
        return self.stress @ F.swapaxes(1, 2) / np.linalg.det(F)[:, None, None]

    @cached_property
    def principal_stretches(self) -> np.ndarray:
        """Square roots of the eigenvalues of F^T F, that of the thickness among them, the greatest first, shape (n, 3)."""
        within = principal_stretches(self.F)
        if self.plane == "space":
            return within
        stretches = np.column_stack([within, self.deformation_gradient[:, 2, 2]])
        return -np.sort(-stretches, axis=1)

    def greatest_stretch(self) -> np.ndarray:
        """Greatest principal stretch, of a body in the plane that within the plane, shape (n,)."""
        if self.plane == "space":
            return self.principal_stretches[:, 0].copy()
        return principal_stretches(self.F)[:, 0]

    def pressure(self) -> np.ndarray:
        """Minus a third of the trace of the Cauchy stress, shape (n,)."""
        return -np.trace(self.cauchy_stress, axis1=1, axis2=2) / 3

    def von_mises(self) -> np.ndarray:
        """Root of 3/2 s:s, s the deviator of the Cauchy stress, shape (n,)."""
        deviator = self.cauchy_stress + self.pressure()[:, None, None] * np.eye(3)
        return np.sqrt(1.5 * (deviator * deviator).sum(axis=(1, 2)))

    def thickness(self) -> np.ndarray | None:
        """C33, the square of the stretch of the thickness of a body in the plane, shape (n,)."""
        return None if self.plane == "space" else self.deformation_gradient[:, 2, 2] ** 2


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


def _in_space(vectors: np.ndarray) -> np.ndarray:
    """Vectors with three components, shape (n, 3)."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


POINT_FIELDS = {
    "position": PointField(lambda state: _in_space(state.position), 3, "length"),
    "displacement": PointField(lambda state: _in_space(state.displacement), 3, "length"),
    "principal_stretch": PointField(PointState.greatest_stretch),
    "principal_stretches": PointField(lambda state: state.principal_stretches, 3),
    "volume_ratio": PointField(lambda state: state.volume_ratio.copy()),
    "C33": PointField(PointState.thickness),
    "stress": PointField(lambda state: state.stress, 9, "stress"),
    "cauchy_stress": PointField(lambda state: state.cauchy_stress, 9, "stress"),
    "von_mises": PointField(PointState.von_mises, unit="stress"),
    "pressure": PointField(PointState.pressure, unit="stress"),
    "energy_density": PointField(lambda state: state.energy_density, unit="stress"),
    "deformation_gradient": PointField(lambda state: state.deformation_gradient, 9),
    "domain_deviation": PointField(lambda state: state.deviation),
    "member_deviation": PointField(lambda state: state.member_deviation, unit="stress"),
    "damage": PointField(lambda state: state.damage),
}
"""All fields on the points, by their names in result files: a new one is one line."""


def point_fields(state: PointState) -> dict[str, np.ndarray]:
    """The fields of `POINT_FIELDS` that have a meaning in a state, and shown state of the force, shape (n,) or (n, components)."""
    fields = {}
    for name, field in POINT_FIELDS.items():
        values = field.values(state)
        if values is not None:
            fields[name] = values if field.components == 1 else values.reshape(-1, field.components)
    return fields | state.kept
