"""Internal force plus loads, supports at places between points, and rigid regions."""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter

import numpy as np

from ..forces import InternalForce
from ..forces.internal_force import tangent_of
from .held import Support
from .loads import Loads
from .rigid import RigidRegion


class LoadedForce:
    """Internal force plus loads, supports at places between points, and rigid regions, used by
    solvers for a body that has any of these.

    A call moves the positions, in place, to the nearest positions in which regions are rigid.
    Forces on the points of a region are replaced by forces of equal resultant whose accelerations,
    force divided by volume, are those of a rigid body: steps of explicit solvers, and of those that
    apply `inverse_with_regions`, then are rigid motions of the region.

    Parameters
    ----------
    internal : InternalForce
    loads : Loads
    supports : sequence of Support
    rigid : sequence of RigidRegion

    Attributes
    ----------
    has_energy : bool
        Whether the sum of forces and loads is minus the derivative of an energy.
    no_energy_because : str or None
        Why the loads have no potential; None if they have one.
    obstacles : list of Obstacle
        Those of the loads.
    internal, loads, supports, rigid
    """

    tangent = tangent_of

    def __init__(
        self,
        internal: InternalForce,
        loads: Loads,
        supports: Sequence[Support] = (),
        rigid: Sequence[RigidRegion] = (),
    ) -> None:
        self.internal = internal
        self.loads = loads
        self.obstacles = loads.obstacles
        self.supports = supports
        self.rigid = rigid
        self.no_energy_because = loads.no_potential_because
        self.has_energy = internal.has_energy and self.no_energy_because is None

    def __call__(self, positions: np.ndarray, out: np.ndarray) -> None:
        """Write internal force plus loads on every point at positions (n, d), in two dimensions per
        unit thickness, to `out` (n, d).

        Raises
        ------
        InvalidState
            If the state has no force, or a region cannot follow the prescribed displacements.
        OutsideDomain
            See `InternalForce`.
        """
        for region in self.rigid:
            region.snap(positions)
        for support in self.supports:
            support.place(positions)
        self.internal(positions, out)
        self.loads.forces(positions, self.thickness(), out)
        self._gather(positions, out)

    def applied(self) -> np.ndarray:
        """Return the forces of the loads on the points in the state last evaluated, shape (n,
        d).
        """
        found = np.zeros_like(self.body.points)
        self.loads.forces(self.positions[: len(self.body)], self.thickness(), found)
        return found

    def of_contact(self, forces: np.ndarray) -> np.ndarray:
        """Return the forces on the points (n, d) under forces of the obstacles at places
        (k, obstacles) in the state last evaluated.
        """
        positions = self.positions[: len(self.body)]
        found = np.zeros_like(self.body.points)
        for obstacle, column in zip(self.obstacles, forces.T, strict=True):
            obstacle.surface.add(column[:, None] * obstacle.pushed(positions)[1], found)
        self._gather(positions, found)
        return found

    def touching(self) -> np.ndarray:
        """Return whether obstacles push at places (k, obstacles) in the state last evaluated."""
        return self.loads.pushed(self.positions[: len(self.body)], self.loads.pushes) > 0

    def _gather(self, positions: np.ndarray, out: np.ndarray) -> None:
        """Replace forces on points at supports and in rigid regions, in place, by those that move
        them.
        """
        for support in self.supports:
            support.fold(out)
        for region in self.rigid:
            region.carry(positions, out)

    def thickness(self) -> np.ndarray | None:
        """Return the stretch of the thickness at the points in the state last evaluated, shape
        (n,); None if no load needs it.

        Raises
        ------
        InvalidState
            If the stretch of the thickness has no value.
        """
        if not self.loads.needs_thickness:
            return None
        F = self.internal.deformation_gradients()
        return self.internal.volume_ratios() / (F[:, 0, 0] * F[:, 1, 1] - F[:, 0, 1] * F[:, 1, 0])

    def energy(self) -> float:
        """Return stored energy plus potential of the loads in the state last evaluated, in two
        dimensions per unit thickness.
        """
        return self.internal.energy() + self.loads.potential(
            self.internal.positions[: len(self.body)]
        )


# What solvers ask about the internal force alone, it answers itself.
for _name in [
    "body",
    "plane",
    "precision",
    "law",
    "laws",
    "stiffness_moduli",
    "force_scale",
    "nearly_incompressible",
    "zero_energy_modes",
    "broken",
    "positions",
    "supported",
    "evaluations",
    "state_arrays",
    "place",
    "move_plane",
    "move_planes",
    "pair_forces",
    "forces_of_planes",
    "levers_on_planes",
    "pass_bonds",
    "deformation_gradients",
    "linearized_dilatation",
]:
    setattr(LoadedForce, _name, property(attrgetter(f"internal.{_name}")))
