"""Energies as targets: a network learns an energy of two invariants together with its derivatives by them."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, NamedTuple

import numpy as np
from sklearn.base import clone
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import FunctionTransformer
from sklearn.utils.validation import check_is_fitted

from ..forces import Domain, LearntEnergy
from ..materials import Law
from .named import NamedFunction
from .sobolev import SobolevRegressor
from .target import InputAwareTargetRegressor, check_targets
from .targets import REPORT_SEED, REPORTED_STATES, Range, Samples, Target
from .validation import relative_errors, strain_bins

ANCHOR = (0.0, 0.0)
"""Features at rest, where the energy is zero."""


class PipelineFunctions(NamedTuple):
    """Functions of a module that a pipeline for an energy is made of; pickles store them by their names."""

    features: NamedFunction
    feature_names: NamedFunction
    size: NamedFunction
    derivatives_by_features: NamedFunction
    derivatives_by_invariants: NamedFunction


class EnergyTarget(Target):
    """Energy as a function of two invariants, learnt with its derivatives by them.

    Attributes
    ----------
    surrogate_type : type
        Type of the force model that a fitted network becomes.
    n_units : int
        Units of the network of a pipeline that is made without a regressor.
    flat : tuple of int
        Features by which the derivative is made zero at rest, where all features are zero.
    functions : PipelineFunctions
    """

    units = "dimensionless; energy in the shear modulus"
    weight_function = "any: the energy learnt is that of the material alone"
    surrogate_type: ClassVar[type[LearntEnergy]]
    n_units: ClassVar[int]
    flat: ClassVar[tuple[int, ...]]
    functions: ClassVar[PipelineFunctions]

    @abstractmethod
    def states(self, law: Law, stretches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return X and y at given principal stretches, shape (n, 2) or (n, 3)."""

    @abstractmethod
    def draw_logs(self, random: np.random.Generator, n_samples: int, low: float, high: float, near_rest: float) -> np.ndarray:
        """Return logarithms of principal stretches, uniform within their bounds except for a share near rest."""

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

    def samples_at(self, law: Law, stretches: np.ndarray, design: dict) -> Samples:
        """Return the samples at given principal stretches."""
        return Samples(*self.states(law, stretches), design, self, stretches)

    def draw(self, law: Law, n_samples: int, stretch_range: Range, near_rest: float, random_state: int) -> Samples:
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
        features, names, size, *targets = self.functions
        inner.set_params(anchor=ANCHOR, flat=self.flat, size=size)
        transformer = FunctionTransformer(features, feature_names_out=names, check_inverse=False)
        return InputAwareTargetRegressor(Pipeline([("features", transformer), ("regressor", inner)]), *targets)

    def predicted_by(self, model) -> bool:
        return isinstance(model, InputAwareTargetRegressor) and model.func is self.functions.derivatives_by_features

    def network_of(self, model) -> SobolevRegressor:
        """Return the network of a pipeline for this energy; raise ValueError if the pipeline cannot become a surrogate."""
        pipeline = getattr(model, "regressor_", getattr(model, "regressor", None))
        if (
            not self.predicted_by(model)
            or not isinstance(pipeline, Pipeline)
            or not isinstance(pipeline[-1], SobolevRegressor)
            or getattr(pipeline[0], "func", None) is not self.functions.features
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

    def errors(self, predicted: np.ndarray, samples: Samples) -> dict[str, float]:
        """Return the relative errors of stress (``rms``, ``max``) and energy (``energy_rms``)."""
        stresses = (self.stresses(samples.stretches, *values.T[1:]) for values in (predicted, samples.y))
        return {**relative_errors(*stresses), "energy_rms": relative_errors(predicted[:, :1], samples.y[:, :1])["rms"]}

    def report(self, model, law: Law, stretch_range: Range, n_samples: int = REPORTED_STATES, random_state: int = REPORT_SEED) -> dict:
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
