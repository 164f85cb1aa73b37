"""Learnt bond forces: multilayer perceptrons, from plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..body import Body
from ..kernels.activations import ACTIVATIONS
from ..kernels.blocks import BLOCK, STATE_ROWS, TRACTION_ROWS
from ..kernels.feature_sets import FEATURE_NAMES, FEATURE_SETS
from ..kernels.network import MOST_HIDDEN, N_OUTPUTS, N_WORK_ROWS, network_block, outputs_at_rest, pack
from ..materials import Law
from .analytic import bond_arrays
from .bondwise import BondForceEvaluation
from .protocol import CompiledBondForce, Domain
from .settings import ForceSettings


@dataclass(frozen=True)
class NetworkForce:
    """A network that maps features of a bond to its dimensionless force.

    Parameters
    ----------
    name : str
    feature_set : {"symmetric", "paper"}
    activation : str
    layers : tuple of (ndarray, ndarray)
        Weights of shape (n_in, n_out) and biases of every layer, the output layer last, on unscaled features and outputs.
    at_rest : ndarray, shape (2,)
        Taken off the outputs.
    domain : Domain
        Where it was trained.
    law : str
        Name of the law that it describes.
    shape : mapping
        Those dimensionless parameters of the law that its bond force depends on.
    """

    name: str
    feature_set: str
    activation: str
    layers: tuple[tuple[np.ndarray, np.ndarray], ...]
    at_rest: np.ndarray
    domain: Domain
    law: str
    shape: Mapping[str, float]

    kind = "bond-force-network"
    default_precision = "float32"

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the features."""
        return FEATURE_NAMES[self.feature_set]

    @property
    def gives_transverse(self) -> bool:
        """T_mm follows from coaxiality with the symmetric features; the paper's (t_n, t_tau) leave it open."""
        return self.feature_set == "symmetric"

    @property
    def hidden_layer_sizes(self) -> tuple[int, ...]:
        """Units of the hidden layers."""
        return tuple(biases.size for _, biases in self.layers[:-1])

    def bond_force(self, stretch, rotation, length, C33, J) -> np.ndarray:
        """Dimensionless (t_n, t_tau) of [1]; see `ForceSurrogate.bond_force`."""
        stretch, rotation, length, C33, J = bond_arrays(stretch, rotation, length, C33, J)
        a, b = stretch * np.cos(rotation), stretch * np.sin(rotation)
        U_mm = (J + b * b) / a
        inputs, traction, _ = FEATURE_SETS[self.feature_set]
        with np.errstate(invalid="ignore"):  # a bond turned past a right angle has no stretch tensor: NaN
            values = np.stack(inputs(a, b, U_mm, J, C33, length), axis=1)
            for weights, biases in self.layers[:-1]:
                values = ACTIVATIONS[self.activation](values @ weights + biases)
            outputs = values @ self.layers[-1][0] + self.layers[-1][1] - self.at_rest
            T_nn, T_nm, _ = traction(outputs[:, 0], outputs[:, 1], a, b, U_mm, J, C33)
        return np.stack([(T_nn * a + T_nm * b) / stretch, (T_nm * a - T_nn * b) / stretch], axis=1)

    def compiled(self, dtype) -> CompiledBondForce:
        """Block function and packed weights in the given precision."""
        sizes, weights = pack(self.layers, self.at_rest, dtype)
        address, work_rows = network_block(self.feature_set, self.activation, dtype).address, int(sizes[N_WORK_ROWS])
        if self.feature_set == "symmetric" and np.abs(self.bond_force([1.0], [0.0], [1.0], [1.0], [1.0])).max() < 1e-9:
            # Zero at rest is made zero as the kernel rounds it: take off what it gives there, beyond what is taken off already.
            states = np.ones((STATE_ROWS, BLOCK), dtype=dtype)
            states[1] = 0
            work, traction = np.zeros((work_rows, BLOCK), dtype=dtype), np.zeros((TRACTION_ROWS, BLOCK), dtype=dtype)
            weights[-N_OUTPUTS] += outputs_at_rest(address, sizes, weights, work, states, traction)
        return CompiledBondForce(address, sizes, weights, work_rows)

    def check_material(self, law: Law) -> None:
        """Raise ValueError if the network was not trained for this material."""
        if law.name != self.law:
            raise ValueError(f"{self.name} describes the law {self.law}, not {law.name}; force=analytic serves every law")
        for key, value in law.shape.items():
            if not np.isclose(value, self.shape[key], rtol=1e-9, atol=0):
                raise ValueError(
                    f"{self.name} describes {self.law} with {key} = {self.shape[key]:g}, not {value:g}; "
                    "fit another, or use force=analytic, which serves every law"
                )

    def bind(self, body: Body, law: Law, settings: ForceSettings) -> BondForceEvaluation:
        """Prepare the evaluation on a body."""
        return BondForceEvaluation(self, body, law, settings)

    def payload(self) -> dict:
        """Plain containers and arrays that `from_payload` builds the same network from."""
        return {
            "feature_set": self.feature_set,
            "activation": self.activation,
            "layers": [{"weights": weights, "biases": biases} for weights, biases in self.layers],
            "at_rest": self.at_rest,
        }

    @classmethod
    def from_payload(cls, name: str, payload: Mapping, domain: Domain, law: str, shape: Mapping[str, float]) -> NetworkForce:
        """Build a network from what `payload` gave.

        Raises
        ------
        ValueError
            If anything is missing, of the wrong shape, or not finite.
        """
        if not isinstance(payload, dict) or set(payload) != {"feature_set", "activation", "layers", "at_rest"}:
            raise ValueError("a network's payload has feature_set, activation, layers and at_rest")
        if payload["feature_set"] not in FEATURE_SETS:
            raise ValueError(f"unknown feature set {payload['feature_set']!r}")
        if payload["activation"] not in ACTIVATIONS:
            raise ValueError(f"unknown activation {payload['activation']!r}")
        if not isinstance(payload["layers"], list) or not 2 <= len(payload["layers"]) <= MOST_HIDDEN + 1:
            raise ValueError(f"a network has one to {MOST_HIDDEN} hidden layers and an output layer")
        layers, width = [], len(FEATURE_NAMES[payload["feature_set"]])
        for number, layer in enumerate(payload["layers"]):
            if not isinstance(layer, dict) or set(layer) != {"weights", "biases"}:
                raise ValueError(f"layer {number} has no weights and biases")
            weights, biases = (_real_array(layer[key], f"layer {number} {key}") for key in ("weights", "biases"))
            if weights.ndim != 2 or biases.shape != weights.shape[1:] or weights.shape[0] != width or biases.size == 0:
                raise ValueError(f"layer {number} has weights {weights.shape} and biases {biases.shape} after a layer of {width}")
            layers.append((weights, biases))
            width = biases.size
        at_rest = _real_array(payload["at_rest"], "at_rest")
        if width != N_OUTPUTS or at_rest.shape != (N_OUTPUTS,):
            raise ValueError(f"a bond-force network has {N_OUTPUTS} outputs")
        return cls(name, payload["feature_set"], payload["activation"], tuple(layers), at_rest, domain, law, dict(shape))


def _real_array(value, what: str) -> np.ndarray:
    if not isinstance(value, np.ndarray) or value.dtype != np.float64 or not np.isfinite(value).all():
        raise ValueError(f"{what} is not an array of finite doubles")
    return value
