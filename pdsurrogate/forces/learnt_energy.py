"""Learnt plane-stress energies: networks of two invariants, from plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ..kernels.activations import ACTIVATIONS, SMOOTH
from ..kernels.block_arrays import BLOCK
from ..kernels.energy_density import ENERGY_ROWS, INVARIANT_ROWS, N_CONSTANTS, NETWORK_WORK_ROWS, network_energy_density, pack_network
from ..materials import Law
from .agreement import check_agreement, invariant_states
from .bond_energy import EnergySurrogate
from .energy_density import EnergyDerivatives
from .learnt import check_described, checked_array, evaluate_block
from .protocol import CompiledBondForce, Domain

ENERGY_FEATURES = ("log J", "log(tr C/(2 J))")
"""What an energy network sees: the logarithms of the area ratio and of cosh(log lambda_1/lambda_2); both vanish at rest."""

CHUNK = 65_536
"""States evaluated at once in NumPy."""


def energy_shape(law: Law) -> dict[str, float]:
    """The dimensionless parameters that the plane-stress energy of a law depends on: with C33 condensed out, the bulk modulus is one."""
    return {**law.shape, "bulk_modulus/shear_modulus": law.bulk_modulus / law.shear_modulus}


@dataclass(frozen=True)
class EnergyNetwork(EnergySurrogate):
    """A network of one hidden layer for psi(tr C, J), without energy and stress at rest by construction.

    Parameters
    ----------
    name : str
    activation : str
        One of `pdsurrogate.kernels.activations.SMOOTH`.
    hidden_weights : ndarray, shape (2, n)
    hidden_biases, output_weights : ndarray, shape (n,)
        On the features `ENERGY_FEATURES` as they are, unscaled.
    domain : Domain
        Principal stretches trained on; its bounds of J3^2 are those of the training states, and not tested.
    law : str
        Name of the law that it describes.
    shape : mapping
        See `energy_shape`.
    stated : mapping, optional
        Relative errors of the stress, ``rms`` and ``max``, that its card states, and ``bulk_ratio``, K/mu
        of the training states; None without a card.
    """

    name: str
    activation: str
    hidden_weights: np.ndarray
    hidden_biases: np.ndarray
    output_weights: np.ndarray
    domain: Domain
    law: str
    shape: Mapping[str, float]
    stated: Mapping[str, float] | None = field(default=None, kw_only=True)

    kind: ClassVar[str] = "energy-network"
    default_precision: ClassVar[str] = "float32"
    feature_set: ClassVar[str] = "invariants"
    features: ClassVar[tuple[str, ...]] = ENERGY_FEATURES

    @property
    def size(self) -> str:
        """The model's size in words, for tables."""
        return f"{self.output_weights.size} units"

    @property
    def _at_rest(self) -> tuple[float, float]:
        """Sum over the units and its derivative by log J at rest, which are taken off."""
        value, slope, _ = ACTIVATIONS[self.activation](self.hidden_biases)
        return float((value * self.output_weights).sum()), float((slope * self.output_weights * self.hidden_weights[0]).sum())

    def energy_derivatives(self, law: Law, trace, area_ratio) -> EnergyDerivatives:
        """Energy and derivatives in NumPy; see `EnergySurrogate`.  The law is not asked: the network has learnt it."""
        trace, J = (np.asarray(value, dtype=float) for value in (trace, area_ratio))
        rows = np.empty((6, J.size))
        for at in range(0, J.size, CHUNK):
            rows[:, at : at + CHUNK] = self._derivatives(trace[at : at + CHUNK], J[at : at + CHUNK])
        return EnergyDerivatives(*rows)

    def _derivatives(self, trace, J):
        constant, flat = self._at_rest
        w1, w2, v = *self.hidden_weights, self.output_weights
        x, u = np.log(J), np.log(trace / (2 * J))
        value, slope, curvature = ACTIVATIONS[self.activation](x[:, None] * w1 + u[:, None] * w2 + self.hidden_biases)
        slope, curvature = slope * v, curvature * v
        # Sums written out, not matrix products: the order of summation must not depend on how many states there are.
        by_x, by_u = (slope * w1).sum(axis=1) - flat, (slope * w2).sum(axis=1)
        xx, xu, uu = (curvature * w1 * w1).sum(axis=1), (curvature * w1 * w2).sum(axis=1), (curvature * w2 * w2).sum(axis=1)
        psi = (value * v).sum(axis=1) - constant - flat * x
        return (
            psi,
            by_u / trace,
            (by_x - by_u) / J,
            (uu - by_u) / trace**2,
            (xu - uu) / (trace * J),
            (xx - 2 * xu + uu - by_x + by_u) / J**2,
        )

    def compiled(self, dtype) -> CompiledBondForce:
        """Block function and packed weights in the given precision."""
        sizes, weights = pack_network(self.hidden_weights, self.hidden_biases, self.output_weights, 0.0, 0.0, dtype)
        address = network_energy_density(ACTIVATIONS[self.activation], dtype).address
        # Zero at rest is made zero as the kernel rounds it: take off what it gives there.
        states = np.ones((INVARIANT_ROWS, BLOCK), dtype=dtype)
        states[0] = 2
        work, result = np.zeros((NETWORK_WORK_ROWS, BLOCK), dtype=dtype), np.zeros((ENERGY_ROWS, BLOCK), dtype=dtype)
        evaluate_block(address, states, sizes, weights, work, result)
        weights[-N_CONSTANTS] = result[0, 0]
        # 2 psi_I + psi_J = dpsi/dlog J at rest, of which psi_I is half of dpsi/dlog(tr C/(2 J)).
        weights[-N_CONSTANTS + 1] = result[2, 0] + 2 * result[1, 0]
        weights[-N_CONSTANTS + 2] = weights[-N_CONSTANTS + 1]
        return CompiledBondForce(address, sizes, weights, NETWORK_WORK_ROWS)

    def check_material(self, law: Law) -> None:
        """Raise ValueError if the model was not trained for this material, or its stress is not that of the law as it is now."""
        check_described(self, law, energy_shape(law), "bond-energy")
        check_agreement(self, law, invariant_states, self._principal_stresses, "bond-energy")

    def _principal_stresses(self, trace, J, first, second) -> np.ndarray:
        _, by_trace, by_J, *_ = self._derivatives(trace, J)
        return np.stack([2 * by_trace * first + by_J * second, 2 * by_trace * second + by_J * first], axis=1)

    def payload(self) -> dict[str, np.ndarray | str]:
        """Arrays of doubles and names that `from_payload` builds the same model from."""
        return {
            "activation": self.activation,
            "hidden_weights": self.hidden_weights,
            "hidden_biases": self.hidden_biases,
            "output_weights": self.output_weights,
        }

    @classmethod
    def from_payload(cls, name: str, payload: dict, domain: Domain, law: str, shape: Mapping[str, float]) -> EnergyNetwork:
        """Build a model from what `payload` gave.

        Raises
        ------
        ValueError
            If anything is missing, of the wrong shape, or not finite.
        """
        keys = ("hidden_weights", "hidden_biases", "output_weights")
        if set(payload) != {"activation", *keys}:
            raise ValueError(f"an energy network's payload has activation, {', '.join(keys)}")
        if not isinstance(payload["activation"], str) or payload["activation"] not in SMOOTH:
            raise ValueError(f"unknown activation {payload['activation']!r}")
        output = checked_array(payload["output_weights"], "output_weights")
        if output.ndim != 1 or output.size == 0:
            raise ValueError(f"output_weights has shape {output.shape}, not that of a vector")
        biases = checked_array(payload["hidden_biases"], "hidden_biases", output.shape)
        weights = checked_array(payload["hidden_weights"], "hidden_weights", (2, output.size))
        return cls(name, payload["activation"], weights, biases, output, domain, law, dict(shape))
