"""Force model under test, in a material and a plane, with the bodies, forces and runs that its
properties need.
"""

import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..body import Body
from ..forces import ForceModel, ForceSettings, InternalForce, InvalidState
from ..materials import PLANES, Law, dimension_of
from ..results import Result
from ..run.simulate import SimulationFailed, SimulationInterrupted, simulate
from ..scenes import Scene
from ..solvers.equilibrium import Diverging, NotConverged

FAILURES = (InvalidState, NotConverged, Diverging, SimulationFailed)
"""Errors of states and equilibria that do not exist."""


@dataclass(frozen=True, eq=False)
class Subject:
    """Force model under test.

    No two subjects are equal, so that a function with `functools.cache` computes a result that
    several properties share once for each.

    Attributes
    ----------
    model : ForceModel
    law : Law
    plane : {"stress", "strain", "space"}
    stated : tuple of dict
        Errors by strain that the card of an artifact states; empty for an exact model.
    """

    model: ForceModel
    law: Law
    plane: str = "stress"
    stated: tuple[dict, ...] = ()

    @property
    def dimension(self) -> int:
        """Dimension, 2 or 3, of the bodies on which the model is tested."""
        return dimension_of(self.plane)

    def sized(self, plane: Any, space: Any) -> Any:
        """Return the first argument if the model is tested on bodies in the plane (stress or
        strain), the second if on solids.
        """
        return plane if self.dimension == 2 else space

    def exact_stress(self, F: np.ndarray) -> np.ndarray:
        """Return the first Piola-Kirchhoff stress of the material law at a deformation gradient
        F, both of shape (d, d).
        """
        return PLANES[self.plane].first_piola_stress(self.law, F)

    def bind(
        self, body: Body, law: Law | None = None, model: ForceModel | None = None, **settings
    ) -> InternalForce:
        """Return the force of the model under test, or of another `model`, on a body.

        `law` is the material, by default the subject's; `settings` are those of `ForceSettings`,
        with double precision as the default.
        """
        settings = ForceSettings(**{"precision": "float64", "plane": self.plane} | settings)
        return (model or self.model).bind(body, law or self.law, settings)

    def takes(self, setting: str) -> tuple:
        """Return the values of a force setting (such as "precision") that the model declares to
        honor; empty for an unused setting.
        """
        return self.model.honored(self.plane).get(setting, ())

    def scene(self, sides: Iterable[float], **described) -> Scene:
        """Return a scene with a rectangle or box of given sides, of the subject's material;
        `described` adds or replaces keys of it.
        """
        body = {"shape": self.sized("rectangle", "box"), "size": tuple(sides)[: self.dimension]}
        return Scene(
            **{"name": "test", "plane": self.plane, "material": self.law.describe(), "body": body}
            | described
        )

    def held_at(self, region: str) -> dict[str, Any]:
        """Return the entry of ``prescribed`` in a scene that holds a region in place: all
        displacements are zero.
        """
        return {"region": region, **{f"x{axis + 1}": 0.0 for axis in range(self.dimension)}}

    def run(self, scene: Scene, **options) -> Result:
        """Simulate a scene with the model under test; `options` are arguments of `simulate`.
        Raise KeyboardInterrupt after Ctrl-C.
        """
        try:
            with warnings.catch_warnings(
                action="ignore"
            ):  # the measured values show the cause of warnings
                return simulate(scene, **{"force": self.model} | options)
        except SimulationInterrupted:
            raise KeyboardInterrupt from None


def forces_at(force: InternalForce, positions: np.ndarray) -> np.ndarray:
    """Return the forces on the points of the force's body at given positions, both of shape (n,
    d).
    """
    out = np.empty_like(positions)
    force(positions, out)
    return out


def force_densities(force: InternalForce, positions: np.ndarray) -> np.ndarray:
    """Return the forces per volume on the points at given positions, shape (n, d), in units of
    shear modulus / spacing.
    """
    return (
        forces_at(force, positions)
        / force.body.volumes[:, None]
        * force.body.spacing
        / force.law.shear_modulus
    )


def mean_stress_at(force: InternalForce, F: np.ndarray) -> np.ndarray:
    """Return the mean first Piola-Kirchhoff stress of a body, shape (d, d), in a homogeneous
    state with deformation gradient F.
    """
    forces_at(force, force.body.points @ F.T)
    return force.mean_stress()


def off(found: np.ndarray, expected: np.ndarray) -> float:
    """Return the greatest difference between two arrays, divided by the greatest magnitude in
    `expected`.
    """
    return float(np.abs(found - expected).max() / np.abs(expected).max())
