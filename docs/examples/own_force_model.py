"""A force model of your own: an object with a method bond_force is simulated like any other."""

import numpy as np

import pdsurrogate as pds


class MyRubber:
    """Neo-Hookean rubber, the force of theory (12) along and across a bond."""

    def bond_force(self, stretch, rotation, length, C33, J):
        """Forces (n, 2) along and across bonds, in units of the shear modulus."""
        a, b = stretch * np.cos(rotation), stretch * np.sin(rotation)
        p, k = (J * J * C33) ** (-1 / 3), C33 / J
        T_nn, T_nm = p * (a - k * (J + b * b) / a), p * (1 + k) * b
        return np.stack([T_nn * a + T_nm * b, T_nm * a - T_nn * b], axis=1) / stretch[:, None]


rubber = pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=1e4)
scene = pds.load_scene("uniaxial", spacing=0.2, stretches=1.3, material=rubber)
stress = pds.simulate(scene, MyRubber()).levels[-1]["nominal_stress"]

exact = 1.3 - 1.3**-2  # mu (l - l^-2), incompressible
print(f"stress {stress:.5f}, exact {exact:.5f}")
assert abs(stress / exact - 1) < 1e-3  # mu/K, and the solver
