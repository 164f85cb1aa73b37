"""Measures of a deformed body: energy, displacements of the edges, fields on the points and at
probes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arguments import suggestion
from ..body import Body, fields_at
from ..forces import InternalForce
from ..forces.internal_force import stored_by
from ..materials.states import principal_stretches
from ..ranks import Share
from ..scenes import Probe, Units


def strain_energy(force: InternalForce) -> float:
    """Return this rank's share of the stored energy of a body in the state that its force evaluated
    last; for a sheet per unit thickness.

    If the force model has no energy (``force.has_energy`` is False), sum the law's energy at the
    deformation gradients of the rank's own points instead.
    """
    if force.has_energy:
        return stored_by(force)
    return float(force.stress_and_energy()[1] @ (force.body.volumes * force.body.share.own))


def edge_displacements(
    body: Body, displacements: np.ndarray, axis: int, box: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the displacements along `axis` of the two edges of a sheet that are normal to this
    axis.

    On a lattice the two outermost points of each line along the axis, one cell wide, are
    extrapolated linearly to the edge; on a cloud the displacement at places a cell apart follows
    from a fit to the points around, see `fields_at`. `box` (2, 2) are the lower and the upper
    corner of the sheet, which a cloud needs.

    Returns
    -------
    position, lower, upper : ndarray, shape (lines,)
        Coordinate of each line along the other axis, and the displacement of its lower and upper
        end.
    """
    x = body.points[:, axis]
    u = displacements[:, axis]
    if body.tessellate is not None:
        low, high = box[:, 1 - axis]
        count = round((high - low) / body.spacing)
        along = low + (high - low) * (np.arange(count) + 0.5) / count
        places = np.repeat(along, 2)[:, None].repeat(2, axis=1)
        places[:, axis] = np.tile(box[:, axis], count)
        return along, *(fields_at(body, places)[0].component(axis) @ u).reshape(-1, 2).T
    order, line = _lines_along(body, axis)
    lines = np.split(order, np.flatnonzero(np.diff(line)) + 1)
    first, second, before, last = np.array(
        [points[[0, 1, -2, -1]] for points in lines if len(points) > 1]
    ).T
    low = x.min() - body.cell[axis] / 2
    high = x.max() + body.cell[axis] / 2

    def continued(outer: np.ndarray, inner: np.ndarray, place: float) -> np.ndarray:
        return u[outer] + (u[outer] - u[inner]) * (place - x[outer]) / (x[outer] - x[inner])

    return (
        body.points[first, 1 - axis],
        continued(first, second, low),
        continued(last, before, high),
    )


def roughness(body: Body, displacements: np.ndarray, axis: int) -> float:
    """Return the roughness of a sheet's lateral displacement (normal to the loaded axis `axis`),
    which reveals zero-energy modes.

    The roughness is the root mean square of the second differences of this displacement between
    neighboring points on lines along `axis`, divided by the greatest absolute value of the
    displacement.  For a smooth field of wavelength L the roughness is about (2 pi cell/L)^2 /
    sqrt(2); for a mode that alternates from point to point it is 4.  On a cloud four times the
    deviation of the displacements of points (at most 10,000) from a fit to the points around
    replaces the second differences.
    """
    greatest = np.abs(displacements[:, 1 - axis]).max()
    if body.tessellate is not None:
        # Each needs a fit to some fifty others.
        some = np.arange(0, len(body), -(-len(body) // 10_000))
        second = (
            4
            * (displacements[some] - fields_at(body, body.points[some])[0](displacements))[
                :, 1 - axis
            ]
        )
    else:
        order, line = _lines_along(body, axis)
        u = displacements[order, 1 - axis]
        x = body.points[order, axis]
        neighbors = (line[2:] == line[:-2]) & (
            np.abs(x[2:] - x[:-2] - 2 * body.cell[axis]) < 0.1 * body.cell[axis]
        )
        second = (u[2:] - 2 * u[1:-1] + u[:-2])[neighbors]
    return float(np.sqrt((second**2).mean()) / greatest) if len(second) and greatest > 0 else 0.0


def _lines_along(body: Body, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of a sheet's points, sorted along lines parallel to an axis, and the
    number of each point's line.

    A line is one cell wide.
    """
    across = body.points[:, 1 - axis]
    line = np.floor((across - across.min()) / body.cell[1 - axis] + 0.5).astype(int)
    order = np.lexsort((body.points[:, axis], line))
    return order, line[order]


class PointState:
    """Deformation, stress and energy of the points in one state of a body, from which the fields in
    result files are computed.

    Parameters
    ----------
    force : InternalForce
        Force model on the body.
    positions : ndarray, shape (n, d)
        Deformed positions of the points.
    damage : ndarray, shape (n,), optional
        Broken bonds of each point as a share of its bonds, in a run with fracture.

    Attributes
    ----------
    plane : str
        State of stress or strain: "stress", "strain" or "space".
    laws : list of tuple
        Material laws, each with the points that it describes.
    position, displacement : ndarray, shape (n, d)
        Places in the undeformed body, and displacements from them.
    volumes : ndarray, shape (n,)
        Undeformed volumes; in the plane areas, of a sheet of unit thickness.
    F : ndarray, shape (n, d, d)
        Deformation gradients.
    volume_ratio : ndarray, shape (n,)
        Volume ratio at which the volumetric energy is evaluated: under plane stress J3, which is
        det F times the stretch of the thickness; otherwise det F, or a mean over neighboring points
        if the force is a bond energy with a separate volumetric part (selective).
    stress : ndarray, shape (n, 3, 3)
        First Piola-Kirchhoff stress, see `InternalForce.stress_and_energy`.
    energy_density : ndarray, shape (n,)
        Stored energy per undeformed volume.
    deviation : ndarray, shape (n,), or None
        How far the points are beyond the training domain of a surrogate, see
        `InternalForce.learned`; None without a domain.
    kept : dict of ndarray
        Internal variables that the force model marks for output (`pdsurrogate.forces.term.Kept`
        with ``shown``), by name.
    """

    def __init__(
        self, force: InternalForce, positions: np.ndarray, damage: np.ndarray | None = None
    ) -> None:
        force.place(positions)
        self.laws = force.laws
        self.plane = force.plane
        self.displacement = positions - force.body.points
        self.damage = damage
        self.position = force.body.points
        self.volumes = force.body.volumes
        self.volume_ratio = force.volume_ratios()
        self.F = force.deformation_gradients()
        self.stress, self.energy_density = force.stress_and_energy()
        self.deviation = force.learned.domain_deviation()
        self.kept = {
            array.name: array.at_points(force.body) for array in force.states if array.shown
        }

    @cached_property
    def deformation_gradient(self) -> np.ndarray:
        """Deformation gradient in three dimensions, shape (n, 3, 3); for a sheet its last entry
        is the stretch of the thickness.
        """
        if self.plane == "space":
            return self.F
        gradient = np.zeros((len(self.F), 3, 3))
        gradient[:, :2, :2] = self.F
        gradient[:, 2, 2] = (
            1.0 if self.plane == "strain" else self.volume_ratio / np.linalg.det(self.F)
        )
        return gradient

    @cached_property
    def cauchy_stress(self) -> np.ndarray:
        """Cauchy stress P F^T / det F, shape (n, 3, 3)."""
        F = self.deformation_gradient
        return self.stress @ F.swapaxes(1, 2) / np.linalg.det(F)[:, None, None]

    @cached_property
    def stretches(self) -> np.ndarray:
        """Principal stretches in descending order, shape (n, d); for a sheet only the two in its
        plane.
        """
        return principal_stretches(self.F)

    @cached_property
    def principal_stretches(self) -> np.ndarray:
        """Three principal stretches in descending order, including the stretch of a sheet's
        thickness, shape (n, 3).
        """
        if self.plane == "space":
            return self.stretches
        return -np.sort(
            -np.column_stack([self.stretches, self.deformation_gradient[:, 2, 2]]), axis=1
        )

    def part(self, rows: slice) -> PointState:
        """Return the state of some of the points."""
        found = copy(self)
        for name, values in vars(self).items():
            if isinstance(values, np.ndarray):
                setattr(found, name, values[rows])
        found.kept = {name: values[rows] for name, values in self.kept.items()}
        return found

    def pressure(self) -> np.ndarray:
        """Return the pressure, minus a third of the trace of the Cauchy stress, shape (n,)."""
        return -np.trace(self.cauchy_stress, axis1=1, axis2=2) / 3

    def von_mises(self) -> np.ndarray:
        """Return the von Mises stress, the root of 3/2 s:s with the deviator s of the Cauchy
        stress, shape (n,).
        """
        deviator = self.cauchy_stress + self.pressure()[:, None, None] * np.eye(3)
        return np.sqrt(1.5 * (deviator * deviator).sum(axis=(1, 2)))


@dataclass(frozen=True)
class PointField:
    """Definition of a field on the points, such as a displacement or stress, for result files.

    Attributes
    ----------
    values : callable
        Function of a `PointState` that returns the values, or None if the field has no meaning
        there.
    components : int
        Number of values at a point; a tensor has 9, row by row.
    unit : {"length", "stress", None}
        Which of the scene's units the values have; None if they have none.
    symbol : str
        Symbol or words in pictures; by default the name with blanks for underscores.
    """

    values: Callable[[PointState], np.ndarray | None]
    components: int = 1
    unit: str | None = None
    symbol: str = ""


def _with_three_components(vectors: np.ndarray) -> np.ndarray:
    """Return vectors of two or three components, padded with zeros to shape (n, 3)."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


POINT_FIELDS = {
    "position": PointField(lambda state: _with_three_components(state.position), 3, "length", "X"),
    "displacement": PointField(
        lambda state: _with_three_components(state.displacement), 3, "length", "u"
    ),
    "principal_stretch": PointField(
        lambda state: state.stretches[:, 0].copy(), symbol="greatest principal stretch λ₁"
    ),
    "principal_stretches": PointField(lambda state: state.principal_stretches, 3, symbol="λ"),
    "volume_ratio": PointField(lambda state: state.volume_ratio.copy(), symbol="volume ratio J"),
    "C33": PointField(
        lambda state: None if state.plane == "space" else state.deformation_gradient[:, 2, 2] ** 2,
        symbol="C₃₃",
    ),
    "stress": PointField(lambda state: state.stress, 9, "stress", "P"),
    "cauchy_stress": PointField(lambda state: state.cauchy_stress, 9, "stress", "σ"),
    "von_mises": PointField(PointState.von_mises, unit="stress", symbol="von Mises stress"),
    "pressure": PointField(PointState.pressure, unit="stress", symbol="pressure p"),
    "volume": PointField(lambda state: state.volumes),
    "energy_density": PointField(
        lambda state: state.energy_density, unit="stress", symbol="energy density W"
    ),
    "deformation_gradient": PointField(lambda state: state.deformation_gradient, 9, symbol="F"),
    "domain_deviation": PointField(lambda state: state.deviation),
    "damage": PointField(lambda state: state.damage),
}
"""Fields on the points by their names in result files."""


def fields_by_part(state: PointState, size: int) -> Iterator[dict[str, np.ndarray]]:
    """Yield `point_fields` of parts of so many points."""
    for start in range(0, len(state.position), size):
        yield point_fields(state.part(slice(start, start + size)))


def point_fields(state: PointState) -> dict[str, np.ndarray]:
    """Return, by name, the fields of `POINT_FIELDS` that are defined in a state, and the internal
    variables in ``state.kept``.

    Every field has shape (n,) or (n, components).
    """
    fields = {}
    for name, field in POINT_FIELDS.items():
        values = field.values(state)
        if values is None:
            continue
        n = len(state.position)
        if np.size(values) != n * field.components:
            shape = (n,) if field.components == 1 else (n, field.components)
            raise ValueError(
                f"the field {name} has values of shape {np.shape(values)} at a state, not {shape}"
            )
        fields[name] = values if field.components == 1 else values.reshape(-1, field.components)
    return fields | state.kept


def values_of(fields: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """Return the values of a field, or of a component such as ``stress_22``, from the fields of a
    state; see `Result.field`.

    Raises
    ------
    ValueError
        If the state has no such field, or the field no such component.
    """
    base, indices = _split(name) if name not in fields else (name, ())
    if base not in fields:
        components = [field + name[len(base) :] for field in fields]
        raise ValueError(
            f"field: the state has no field {name!r};"
            f" {suggestion(name, fields, unlisted=components)}"
        )
    values = fields[base]
    values = values.reshape(-1, 3, 3) if values.ndim == 2 and values.shape[1] == 9 else values
    if indices and values.ndim - 1 != len(indices):
        needed = ("no components", f"components such as {base}_1", f"components such as {base}_22")
        raise ValueError(f"field: {name!r} does not exist: {base} has {needed[values.ndim - 1]}")
    return values[(slice(None), *indices)]


def scalars_of(fields: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """Return the values of a scalar field or a component, or the lengths of a vector field,
    shape (n,); raise ValueError for a tensor.
    """
    values = values_of(fields, name)
    if values.ndim == 3:
        raise ValueError(f"field: {name} has nine components; give one of them, such as {name}_22")
    return values if values.ndim == 1 else np.linalg.norm(values, axis=1)


def label_of(name: str, units: Units) -> str:
    """Return the label of a field or a component in pictures: symbol or words, and the unit,
    such as "u₂ (cm)" or "|u| (cm)".
    """
    base, indices = _split(name) if name not in POINT_FIELDS else (name, ())
    field = POINT_FIELDS.get(base, PointField(lambda state: None))
    symbol = (field.symbol or base.replace("_", " ")) + "".join("₁₂₃"[index] for index in indices)
    if field.components == 3 and not indices:
        symbol = f"|{symbol}|"
    return units.label(symbol, field.unit) if field.unit else symbol


def greatest_of(fields: Mapping[str, np.ndarray], name: str) -> float:
    """Return the greatest absolute value of all components of the field to which a name, such as
    ``stress_22``, belongs.
    """
    return float(np.abs(fields[name if name in fields else _split(name)[0]]).max())


def _split(name: str) -> tuple[str, tuple[int, ...]]:
    """Split the name of a component into field and indices, ("stress", (1, 1)) for
    ``stress_22``; other names have no indices, ().
    """
    found = re.fullmatch(r"(.+)_([123]{1,2})", name)
    return (found[1], tuple(int(digit) - 1 for digit in found[2])) if found else (name, ())


class Probes:
    """Places in a body at which displacement, stress and deformation gradient are read.

    Parameters
    ----------
    body : Body
    probes : sequence of Probe
    portion_of : ndarray of int, shape (n,), optional
        Number of the material of every point, in a body of several materials.
    share : Share
        Points of the body that this rank owns; by default ``body.share``.

    Raises
    ------
    ValueError
        If a probe lies outside the body, or has too few points around it; the message names the
        probe's key in the scene, ``probes.0.at``.
    """

    def __init__(
        self,
        body: Body,
        probes: tuple[Probe, ...],
        portion_of: np.ndarray | None = None,
        share: Share | None = None,
    ) -> None:
        self._names = [probe.name for probe in probes]
        self._rows = []
        self._share = share or body.share
        for number, probe in enumerate(probes):
            try:
                rows = fields_at(body, np.array([probe.at]), portion_of)
            except ValueError as error:
                raise ValueError(f"probes.{number}.at: {error}") from None
            own = self._share.own_columns
            self._rows.append((rows[0].changed(own), [own(row) for row in rows[1]]))

    def __len__(self) -> int:
        return len(self._names)

    def read(self, state: PointState, planes: np.ndarray) -> dict[str, dict[str, list]]:
        """Return displacement, stress and deformation gradient at every probe in a state.

        `planes` are the displacements of planes of symmetry across themselves (planes,).

        A local fit to the values at the surrounding points is evaluated at the position of the
        probe.

        Returns
        -------
        dict
            For the name of each probe: ``displacement`` (d components), ``stress`` (first
            Piola-Kirchhoff, 3 by 3) and ``F`` (3 by 3).
        """
        stress, gradient = (
            field.reshape(len(field), 9) for field in (state.stress, state.deformation_gradient)
        )
        read = self.displacements(state.displacement, planes)
        for name, (_, tensors) in zip(self._names, self._rows, strict=True):
            for key, field in (("stress", stress), ("F", gradient)):
                found = [(row @ field[:, entry])[0] for entry, row in enumerate(tensors)]
                read[name][key] = self._share.total(np.reshape(found, (3, 3))).tolist()
        return read

    def weights(self, name: str, axis: int) -> np.ndarray:
        """Return the weights of the points, shape (n,), in a component of the displacement at a
        probe.
        """
        return self._rows[self._names.index(name)][0].component(axis).toarray()[0]

    def displacements(
        self, displacements: np.ndarray, planes: np.ndarray
    ) -> dict[str, dict[str, list]]:
        """Return the entries of `read` that are displacements, from those of the points, shape
        (n, d), and of planes.
        """
        # The weights of a row sum to 1 and reproduce the place, so they apply to displacements as
        # to positions.
        rows = zip(self._names, self._rows, strict=True)
        return {
            name: {"displacement": self._share.total(moved(displacements, planes)[0]).tolist()}
            for name, (moved, _) in rows
        }

    def columns(self, displacements: np.ndarray, planes: np.ndarray) -> dict[str, float]:
        """Return the displacements at the probes as columns of the history, from those of the
        points, shape (n, d), and of planes.
        """
        read = self.displacements(displacements, planes).items()
        return {
            f"{name}_displacement_{axis}": value
            for name, row in read
            for axis, value in enumerate(row["displacement"], 1)
        }
