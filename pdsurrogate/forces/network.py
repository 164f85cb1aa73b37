"""Learnt bond forces: multilayer perceptrons, stored as plain arrays."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import ClassVar

import numpy as np

from ..kernels.activations import ACTIVATIONS
from ..kernels.feature_sets import FEATURE_SETS, N_OUTPUTS
from ..kernels.network import MOST_HIDDEN, N_WORK_ROWS, network_block, network_outputs, pack
from .learnt import LearntBondForce, check_payload, check_shape
from .protocol import Domain

LAYER = ("weights", "biases")
"""Parts of a layer, in this order; the keys of a payload append the number of the layer."""


@dataclass(frozen=True, repr=False)
class NetworkForce(LearntBondForce):
    """Network that maps features of a bond to its dimensionless force.

    Parameters
    ----------
    activation : str
        One of `pdsurrogate.kernels.activations.ACTIVATIONS`.
    layers : tuple of (ndarray, ndarray)
        Weights of shape (n_in, n_out) and biases of every layer, the output layer last, on unscaled features and outputs.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.load_surrogate("neo-hookean-paper@1")
    >>> model.size
    '20 units'
    """

    activation: str
    layers: tuple[tuple[np.ndarray, np.ndarray], ...]

    kind: ClassVar[str] = "bond-force-network"

    @property
    def size(self) -> str:
        return f"{' + '.join(str(biases.size) for _, biases in self.layers[:-1])} units"

    def outputs(self, features: np.ndarray) -> np.ndarray:
        return network_outputs(features, self.layers, ACTIVATIONS[self.activation])

    def packed(self, dtype) -> tuple[int, np.ndarray, np.ndarray, int]:
        sizes, weights = pack(self.layers, self.at_rest, dtype)
        block = network_block(FEATURE_SETS[self.feature_set], ACTIVATIONS[self.activation], dtype)
        return block.address, sizes, weights, int(sizes[N_WORK_ROWS])

    def payload(self) -> dict[str, np.ndarray | str]:
        layers = {f"{key}_{n}": array for n, layer in enumerate(self.layers) for key, array in zip(LAYER, layer, strict=True)}
        return {"feature_set": self.feature_set, "activation": self.activation, **layers, "at_rest": self.at_rest}

    @classmethod
    def from_payload(cls, name: str, payload: dict, domain: Domain, law: str, shape: Mapping[str, float]) -> NetworkForce:
        n_layers = sum(key.startswith(LAYER[0]) for key in payload)
        keys = [[f"{key}_{n}" for key in LAYER] for n in range(n_layers)]
        names: dict[str, Collection[str]] = {"feature_set": FEATURE_SETS, "activation": ACTIVATIONS}
        check_payload(cls.kind, payload, names, [*chain(*keys), "at_rest"])
        if not 2 <= n_layers <= MOST_HIDDEN + 1:
            raise ValueError(f"a network has one to {MOST_HIDDEN} hidden layers and an output layer")
        layers, width = tuple(tuple(payload[key] for key in pair) for pair in keys), len(FEATURE_SETS[payload["feature_set"]].names)
        for number, (weights, biases) in enumerate(layers):
            if weights.ndim != 2 or biases.shape != weights.shape[1:] or weights.shape[0] != width or biases.size == 0:
                raise ValueError(f"layer {number} has weights {weights.shape} and biases {biases.shape} after a layer of {width}")
            width = biases.size
        if width != N_OUTPUTS:
            raise ValueError(f"a bond-force network has {N_OUTPUTS} outputs, this one {width}")
        check_shape(payload["at_rest"], "at_rest", (N_OUTPUTS,))
        return cls(name, payload["feature_set"], payload["at_rest"], domain, law, dict(shape), payload["activation"], layers)
