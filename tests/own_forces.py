"""Forces and energies in Python, as users write them, for tests."""

import numpy as np


class MyRubber:
    """Neo-Hookean rubber, theory (12); the guide's example."""

    def bond_force(self, stretch, rotation, length, C33, J):
        a, b = stretch * np.cos(rotation), stretch * np.sin(rotation)
        p, k = (J * J * C33) ** (-1 / 3), C33 / J
        T_nn, T_nm = p * (a - k * (J + b * b) / a), p * (1 + k) * b
        return np.stack([T_nn * a + T_nm * b, T_nm * a - T_nn * b], axis=1) / stretch[:, None]


class MyEnergy:
    """Mooney-Rivlin rubber with a fifth of its modulus in the second invariant."""

    def energy(self, I1bar, I2bar):
        return 0.4 * (I1bar - 3) + 0.1 * (I2bar - 3), 0.4, 0.1
