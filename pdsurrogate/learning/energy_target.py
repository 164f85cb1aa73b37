"""Energies as targets: an energy of two invariants that a network learns together with its derivatives by them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

import numpy as np
from sklearn.base import clone
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import FunctionTransformer
from sklearn.utils.validation import check_is_fitted

from ..forces import Domain, LearntEnergy
from ..forces.bond_energy import EnergySurrogate
from ..materials import Law
from .sobolev import SobolevRegressor
from .target import InputAwareTargetRegressor, check_targets
from .targets import Samples, Target, hull_of
from .validation import strain_bins

ANCHOR = (0.0, 0.0)
"""Features at rest, where the energy is zero."""


class EnergyTarget(Target):
    """An energy as a function of two invariants, learnt with its derivatives by them.

    Attributes
    ----------
    surrogate_type : type
        Force model that a fitted network becomes.
    n_units : int
        Units of the network, where the user gives no regressor.
    flat : tuple of int
        Features by which the derivative is made zero at rest, where all features are zero.
    log_features, feature_names, size, derivatives_by_features, derivatives_by_invariants : callable
        Parts of the pipeline, which are functions of a module: pickles store them by their names.
    """

    units = "dimensionless; energy in the shear modulus"
    weight_function = "any: the energy learnt is that of the material alone"
    surrogate_type: ClassVar[type[LearntEnergy]]
    n_units: ClassVar[int]
    flat: ClassVar[tuple[int, ...]]
    log_features: ClassVar[Callable]
    feature_names: ClassVar[Callable]
    size: ClassVar[Callable]
    derivatives_by_features: ClassVar[Callable]
    derivatives_by_invariants: ClassVar[Callable]

    @abstractmethod
    def states(self, law: Law, stretches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return X and y at given principal stretches, shape (n, 2) or (n, 3)."""

    @abstractmethod
    def draw_logs(self, random: np.random.Generator, n_samples: int, low: float, high: float, near_rest: float) -> np.ndarray:
        """Return logarithms of principal stretches, even within their bounds but for a share near rest."""

    @abstractmethod
    def of_strain(self, random: np.random.Generator, strains: tuple[float, float], low: float, high: float, n_samples: int) -> np.ndarray:
        """Return principal stretches whose greatest strain lies in a bin."""

    @abstractmethod
    def stresses(self, stretches: np.ndarray, first, second) -> np.ndarray:
        """Return principal stresses from the derivatives of the energy by the two invariants."""

    @abstractmethod
    def derivatives(self, model: LearntEnergy, law: Law, X: np.ndarray) -> np.ndarray:
        """Return the energy of a model and its derivatives, columns `outputs`."""

    @abstractmethod
    def stability(self, model: LearntEnergy, law: Law, samples: Samples) -> dict[str, float]:
        """Return a model's energy at rest and bounds of its second derivatives, with those of the law."""

    @abstractmethod
    def bulk_range(self, law: Law, X: np.ndarray) -> tuple[float, float]:
        """Return bounds of J3^2 of training states, for the card."""

    @abstractmethod
    def range_of(self, X: np.ndarray) -> tuple[float, float]:
        """Return the least and the greatest principal stretch of states."""

    def samples_at(self, law: Law, stretches: np.ndarray, design: dict) -> Samples:
        """Return the samples at given principal stretches."""
        return Samples(*self.states(law, stretches), design, self, stretches)

    def draw(self, law: Law, n_samples: int, stretch_range: tuple[float, float], near_rest: float, random_state: int) -> Samples:
        low, high = stretch_range
        logs = self.draw_logs(np.random.default_rng(random_state), n_samples, low, high, near_rest)
        design = {
            "name": self.name,
            "n_samples": n_samples,
            "stretch_range": [low, high],
            "near_rest": near_rest,
            "random_state": random_state,
        }
        return self.samples_at(law, np.exp(logs), design)

    def pipeline(self, regressor: SobolevRegressor | None) -> InputAwareTargetRegressor:
        if regressor is not None and not isinstance(regressor, SobolevRegressor):
            raise ValueError(f"an energy is learnt with its derivatives, by a SobolevRegressor, not by a {type(regressor).__name__}")
        inner = SobolevRegressor(self.n_units, random_state=0) if regressor is None else clone(regressor)
        inner.set_params(anchor=ANCHOR, flat=self.flat, size=self.size)
        features = FunctionTransformer(self.log_features, feature_names_out=self.feature_names, check_inverse=False)
        return InputAwareTargetRegressor(
            Pipeline([("features", features), ("regressor", inner)]),
            func=self.derivatives_by_features,
            inverse_func=self.derivatives_by_invariants,
        )

    def predicted_by(self, model) -> bool:
        return isinstance(model, InputAwareTargetRegressor) and model.func is self.derivatives_by_features

    def network_of(self, model) -> SobolevRegressor:
        """Return the network of a pipeline for this energy; raise ValueError if the pipeline cannot become a surrogate."""
        pipeline = getattr(model, "regressor_", getattr(model, "regressor", None))
        if (
            not self.predicted_by(model)
            or not isinstance(pipeline, Pipeline)
            or not isinstance(pipeline[-1], SobolevRegressor)
            or getattr(pipeline[0], "func", None) is not self.log_features
        ):
            raise ValueError(
                f"only a surrogate_pipeline for the target {self.name}, which ends in a SobolevRegressor, can become a surrogate of it"
            )
        network = pipeline[-1]
        if (network.anchor, network.flat) != (ANCHOR, self.flat):
            found = f"{network.anchor} and {network.flat}"
            raise ValueError(f"the network of the target {self.name} must have anchor {ANCHOR} and flat {self.flat}, not {found}")
        return network

    def surrogate(self, model, law: Law, domain: Domain, name: str, states: np.ndarray | None = None) -> tuple[LearntEnergy, dict]:
        network = self.network_of(model)
        check_is_fitted(model)
        arrays = np.ascontiguousarray(network.hidden_weights_), network.hidden_biases_.copy(), network.output_weights_.copy()
        return self.surrogate_type(name, network.activation, *arrays, domain, law.name, self.shape(law)), {}

    def domain(self, law: Law, samples: Samples) -> Domain:
        return Domain(*samples.design["stretch_range"], *self.bulk_range(law, samples.X), hull_of(samples.design))

    def domain_of_states(self, law: Law, X: np.ndarray) -> Domain:
        return Domain(*self.range_of(X), *self.bulk_range(law, X))

    def errors(self, predicted: np.ndarray, samples: Samples) -> dict[str, float]:
        """Return the relative errors of stress (``rms``, ``max``) and energy (``energy_rms``)."""
        exact = self.stresses(samples.stretches, *samples.y.T[1:])
        error = np.linalg.norm(self.stresses(samples.stretches, *predicted.T[1:]) - exact, axis=1)
        size = np.sqrt((exact**2).sum(axis=1).mean())
        energy, size_of_energy = predicted[:, 0] - samples.y[:, 0], np.sqrt((samples.y[:, 0] ** 2).mean())
        return {
            "rms": float(np.sqrt((error**2).mean()) / size),
            "max": float(error.max() / size),
            "energy_rms": float(np.sqrt((energy**2).mean()) / size_of_energy),
        }

    def report(self, model, law: Law, stretch_range: tuple[float, float], n_samples: int, random_state: int) -> dict:
        low, high = stretch_range
        samples = self.draw(law, n_samples, stretch_range, 0.0, random_state)

        def errors(samples: Samples) -> dict[str, float]:
            return self.errors(self.derivatives(model, law, samples.X), samples)

        bins, random = [], np.random.default_rng(random_state + 1)
        for strains in strain_bins(low, high):
            stretches = self.of_strain(random, strains, low, high, max(n_samples // 10, 100))
            bins.append({"strain": list(strains), **errors(self.samples_at(law, stretches, {}))})
        return {
            "stretch_range": [low, high],
            "n_samples": n_samples,
            "random_state": random_state,
            "on_surface": errors(samples),
            "by_strain": bins,
            **self.stability(model, law, samples),
        }

    def more_reports(self, surrogate: EnergySurrogate, law: Law, stretch_range: tuple[float, float]) -> dict[str, dict]:
        return {}

    def regressor(self, model) -> SobolevRegressor:
        return model.regressor_[-1]

    def scaling(self, model) -> dict:
        return {"folded": "features are standardised and targets scaled within the regressor; the payload is on plain features"}


def checked_invariants(X, columns: tuple[str, str]) -> tuple[np.ndarray, np.ndarray]:
    """Return the two columns of X; raise ValueError if they are not positive."""
    X = np.asarray(X, dtype=float)
    if X.ndim != 2 or X.shape[1] != len(columns):
        raise ValueError(f"X must have the columns {', '.join(columns)}, not shape {X.shape}")
    for name, values in reversed(list(zip(columns, X.T, strict=True))):
        if not (values > 0).all():
            raise ValueError(f"{name} must be positive; the least given is {values.min():g}")
    return X[:, 0], X[:, 1]


def checked_derivatives(X, y, columns: tuple[str, str], outputs: tuple[str, ...]):
    """Return the columns of X, checked to be positive, and those of y."""
    invariants = checked_invariants(X, columns)
    check_targets(y, outputs)
    return invariants, y.T
