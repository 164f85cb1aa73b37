"""A law of your own, by its energy and derivatives, in a simulation against its closed solution."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

import pdsurrogate as pds


@dataclass(frozen=True)
class Exponential(pds.materials.InvariantLaw):
    """W = mu/(2 b) (exp(b (I1bar - 3)) - 1), Demiray 1972."""

    name: ClassVar[str] = "exponential"
    reference: ClassVar[str] = "Demiray 1972"
    stiffening: float = 0.05

    @staticmethod
    def isochoric(I1, I2, parameters):
        """W and its derivatives W1, W2, W11, W12, W22, in units of mu."""
        b = parameters[1]
        growth, zero = np.exp(b * (I1 - 3)), 0 * I1
        return (growth - 1) / (2 * b), growth / 2, zero, b * growth / 2, zero, zero


pds.materials.LAWS["exponential"] = Exponential
law = Exponential(shear_modulus=1.0, bulk_modulus=1e5, stiffening=0.1)
scene = pds.load_scene("uniaxial", spacing=0.1, stretches=2.0, material=law)
stress = pds.simulate(scene, "analytic").levels[-1]["nominal_stress"]

# Incompressible: P = mu exp(b (I1 - 3)) (l - l^-2), I1 = l^2 + 2/l; K/mu = 1e5 is nearly so.
exact = np.exp(0.1 * (2.0**2 + 2 / 2.0 - 3)) * (2.0 - 2.0**-2)
print(f"stress {stress:.5f}, exact {exact:.5f}")
assert abs(stress / exact - 1) < 2e-4  # mu/K times I1
