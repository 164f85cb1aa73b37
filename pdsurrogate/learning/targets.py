"""Targets that surrogates learn (bond force, energy of a sheet, isochoric energy) and their samples."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from sklearn.base import clone
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import FunctionTransformer
from sklearn.utils.validation import check_is_fitted

from ..forces import Domain, LearntBondForce, LearntEnergy
from ..materials import Law
from .sampling import PERTURBATION
from .sobolev import SobolevRegressor
from .target import InputAwareTargetRegressor, NamedFunction, check_targets, checked_columns, columns_read

Range = tuple[float, float]
"""Least and greatest principal stretch."""

REPORTED_STATES, REPORT_SEED = 20_000, 1_000_003
"""States in each set of a report of errors, enough for an RMS accurate to a percent, and their seed, which no training samples use."""

ANCHOR = (0.0, 0.0)
"""Features of an energy at rest, where it is zero."""

STRAIN_BINS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 3.0)
"""Bounds of the bins of greatest principal strain in error reports: two or three in a decade, up to the strain at a stretch of 4."""


@dataclass(frozen=True)
class Samples:
    """Training samples of a surrogate, as `pdsurrogate.training_samples` returns them.

    Attributes
    ----------
    X : ndarray, shape (n, n_columns)
        Inputs: five quantities of a bond (stretch, rotation, length, C33, J), or two invariants of a deformation.
    y : ndarray, shape (n, n_outputs)
        Dimensionless targets: the bond force along and across the bond, or the energy and its derivatives by the invariants.
    design : dict
        Everything that is needed to draw the samples again.
    target : Target
        Quantity that y holds.
    stretches : ndarray, shape (n, 2) or (n, 3), optional
        Principal stretches of the states, for energies.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> samples = pds.training_samples(pds.materials.NeoHookean(), n_samples=300)
    >>> samples.X.shape, samples.y.shape, samples.target.name
    ((300, 5), (300, 2), 'bond-force')
    """

    X: np.ndarray
    y: np.ndarray
    design: dict
    target: Target
    stretches: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.X)

    def take(self, rows: np.ndarray) -> Samples:
        """Return the samples of the given rows."""
        stretches = None if self.stretches is None else self.stretches[rows]
        return Samples(self.X[rows], self.y[rows], self.design, self.target, stretches)


class Target(ABC):
    """A quantity that surrogates learn; the instances are `BOND_FORCE`, `SHEET_ENERGY` and `ISOCHORIC_ENERGY`.

    A fitted pipeline carries its target by the names of the columns that its transformation of the target reads.

    Attributes
    ----------
    name : str
        Name in the argument ``target`` of public functions.
    columns, outputs : tuple of str
        Columns of X and y of the samples.
    stretch_range : tuple of float
        Default of the least and the greatest principal stretch of samples.
    n_samples : int
        Default of the number of samples.
    units : str
        Units of features and targets, for cards.
    weight_function : str
        Text about weight functions, for cards.
    has_committees : bool
        Whether an artefact may hold a committee.
    _reported : dict
        Options with which `draw` makes the samples of a report.
    _bins_share_generator : bool
        Whether one generator draws the samples of all bins of strain in a report, or each bin has its own.
    """

    name: ClassVar[str]
    columns: ClassVar[tuple[str, ...]]
    outputs: ClassVar[tuple[str, ...]]
    stretch_range: ClassVar[Range]
    n_samples: ClassVar[int]
    units: ClassVar[str]
    weight_function: ClassVar[str]
    has_committees: ClassVar[bool] = True
    _reported: ClassVar[dict[str, float]] = {"near_rest": 0.0}
    _bins_share_generator: ClassVar[bool] = True

    @abstractmethod
    def reached(self, law: Law, low: float, high: float) -> bool:
        """Return whether a law has all states of samples whose principal stretches have logarithms from `low` to `high`."""

    @abstractmethod
    def draw(self, law: Law, n_samples: int, stretch_range: Range, near_rest: float, random_state: int) -> Samples:
        """Return samples in the order in which they are drawn; a target may take further options of `pdsurrogate.training_samples`."""

    @abstractmethod
    def _draw_strain(self, law: Law, strains: Range, stretch_range: Range, n_samples: int, random_state) -> Samples:
        """Return samples whose greatest principal strain lies in a bin; `random_state` is a seed or a generator."""

    def carried_by(self, model) -> bool:
        """Return whether a pipeline, fitted or not, was made for this target: its transformation reads the columns of this target."""
        return isinstance(model, InputAwareTargetRegressor) and columns_read(model.func)[0] == self.columns

    @abstractmethod
    def pipeline(self, regressor):
        """Return an unfitted pipeline; a target may take further options of `pdsurrogate.surrogate_pipeline`."""

    @abstractmethod
    def _predictor(self, model, law: Law) -> Callable[[np.ndarray], np.ndarray]:
        """Return the function from X to the outputs of a model."""

    @abstractmethod
    def errors(self, predicted: np.ndarray, samples: Samples) -> dict[str, float]:
        """Return the relative errors (``rms``, ``max``) of predictions, of the shape of ``samples.y``."""

    @abstractmethod
    def _more_errors(self, model, law: Law, samples: Samples) -> dict[str, object]:
        """Return the entries of a report that only this target has, such as bounds of the stiffness at samples on the surface."""

    @abstractmethod
    def domain_of_states(self, law: Law, X: np.ndarray) -> Domain:
        """Return the domain of a surrogate that is fitted to states (columns `columns`) of an unknown design."""

    @abstractmethod
    def surrogate(
        self, model, law: Law, domain: Domain, name: str, states: np.ndarray | None = None
    ) -> tuple[LearntBondForce | LearntEnergy, dict]:
        """Return the surrogate of a fitted model and a report of its resampling, empty for a surrogate that equals the model."""

    @abstractmethod
    def scaling(self, model) -> dict:
        """Return the scalings of a fitted model for its card."""

    def report(self, model, law: Law, stretch_range: Range, n_samples: int = REPORTED_STATES, random_state: int = REPORT_SEED) -> dict:
        """Return the report of `pdsurrogate.evaluate`."""
        predict = self._predictor(model, law)
        samples = self.draw(law, n_samples, stretch_range, random_state=random_state, **self._reported)
        bins, shared = [], np.random.default_rng(random_state + 1)
        for number, strains in enumerate(strain_bins(*stretch_range)):
            random = shared if self._bins_share_generator else random_state + 2 + number
            some = self._draw_strain(law, strains, stretch_range, max(n_samples // 10, 100), random)
            bins.append({"strain": list(strains), **self.errors(predict(some.X), some)})
        return {
            "stretch_range": list(stretch_range),
            "n_samples": n_samples,
            "random_state": random_state,
            "on_surface": self.errors(predict(samples.X), samples),
            "by_strain": bins,
            **self._more_errors(model, law, samples),
        }

    def domain(self, law: Law, samples: Samples) -> Domain:
        """Return the domain of a surrogate that is fitted to samples of a design."""
        found, design = self.domain_of_states(law, samples.X), samples.design
        bulk = found.least_bulk, found.greatest_bulk
        if design.get("off_surface"):
            # The bounds of the perturbation, which the samples nearly reach.
            reach = np.exp(design.get("perturbation", PERTURBATION)["log_C33"])
            bulk = float(1 / reach), float(reach)
        # The hull of the test data, for an energy without a law.
        hull = None if design.get("hull") is None else tuple((float(n1), float(n2), float(d)) for n1, n2, d in design["hull"])
        least, greatest = design["stretch_range"]
        return Domain(least, greatest, *bulk, hull)

    def more_reports(self, surrogate, law: Law, stretch_range: Range) -> dict[str, dict]:
        """Return reports over further ranges of stretches for the card, by title."""
        return {}

    def shape(self, law: Law) -> dict[str, float]:
        """Return the dimensionless parameters of a law that the target depends on."""
        return dict(law.shape)


class EnergyTarget(Target):
    """Energy as a function of two invariants, learnt by a network together with its derivatives by them.

    Attributes
    ----------
    _surrogate_type : type
        Type of the force model that a fitted network becomes.
    _n_units : int
        Units of the network of a pipeline that is made without a regressor.
    _flat : tuple of int
        Features by which the derivative is made zero at rest, where all features are zero.
    _functions : tuple of NamedFunction
        Functions of a pipeline, which pickles store by their names: features of the invariants, names of the features, size of the energy,
        derivatives by features from those by invariants, and the inverse of the latter.
    """

    units = "dimensionless; energy in the shear modulus"
    weight_function = "any: the energy learnt is that of the material alone"
    _surrogate_type: ClassVar[type[LearntEnergy]]
    _n_units: ClassVar[int]
    _flat: ClassVar[tuple[int, ...]]
    _functions: ClassVar[tuple[NamedFunction, ...]]

    @abstractmethod
    def _states(self, law: Law, stretches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return X and y at given principal stretches, shape (n, 2) or (n, 3)."""

    @abstractmethod
    def _draw_logs(self, random: np.random.Generator, n_samples: int, low: float, high: float, near_rest: float) -> np.ndarray:
        """Return logarithms of principal stretches, uniform within their bounds except for a share near rest."""

    @abstractmethod
    def _of_strain(self, random: np.random.Generator, strains: Range, low: float, high: float, n_samples: int) -> np.ndarray:
        """Return principal stretches whose greatest strain lies in a bin."""

    @abstractmethod
    def _stresses(self, stretches, first, second) -> np.ndarray:
        """Return principal stresses from the derivatives of the energy by the two invariants."""

    def _samples_at(self, law: Law, stretches: np.ndarray, design: dict) -> Samples:
        """Return the samples at given principal stretches."""
        return Samples(*self._states(law, stretches), design, self, stretches)

    def draw(self, law: Law, n_samples: int, stretch_range: Range, near_rest: float, random_state: int) -> Samples:
        low, high = stretch_range
        logs = self._draw_logs(np.random.default_rng(random_state), n_samples, low, high, near_rest)
        design = {
            "name": self.name,
            "n_samples": n_samples,
            "stretch_range": [low, high],
            "near_rest": near_rest,
            "random_state": random_state,
        }
        return self._samples_at(law, np.exp(logs), design)

    def _draw_strain(self, law: Law, strains: Range, stretch_range: Range, n_samples: int, random_state) -> Samples:
        random = np.random.default_rng(random_state)
        return self._samples_at(law, self._of_strain(random, strains, *stretch_range, n_samples), {})

    def pipeline(self, regressor: SobolevRegressor | None) -> InputAwareTargetRegressor:
        if regressor is not None and not isinstance(regressor, SobolevRegressor):
            raise ValueError(f"an energy is learnt with its derivatives, by a SobolevRegressor, not by a {type(regressor).__name__}")
        inner = SobolevRegressor(self._n_units, random_state=0) if regressor is None else clone(regressor)
        features, names, size, *targets = self._functions
        inner.set_params(anchor=ANCHOR, flat=self._flat, size=size)
        transformer = FunctionTransformer(features, feature_names_out=names, check_inverse=False)
        return InputAwareTargetRegressor(Pipeline([("features", transformer), ("regressor", inner)]), *targets)

    def _network_of(self, model) -> SobolevRegressor:
        """Return the network of a pipeline for this energy; raise ValueError if the pipeline cannot become a surrogate."""
        pipeline: Any = getattr(model, "regressor_", getattr(model, "regressor", None))
        network: Any = pipeline[-1] if self.carried_by(model) and isinstance(pipeline, Pipeline) else None
        right = isinstance(network, SobolevRegressor) and getattr(pipeline[0], "func", None) is self._functions[0]
        if not right or (network.anchor, network.flat) != (ANCHOR, self._flat):
            made = f"a surrogate_pipeline for the target {self.name}, which ends in a SobolevRegressor"
            raise ValueError(f"only {made} with anchor {ANCHOR} and flat {self._flat}, can become a surrogate of it")
        return network

    def surrogate(self, model, law: Law, domain: Domain, name: str, states: np.ndarray | None = None) -> tuple[LearntEnergy, dict]:
        network = self._network_of(model)
        check_is_fitted(model)
        arrays = np.ascontiguousarray(network.hidden_weights_), network.hidden_biases_.copy(), network.output_weights_.copy()
        return self._surrogate_type(name, network.activation, *arrays, domain, law.name, self.shape(law)), {}

    def errors(self, predicted: np.ndarray, samples: Samples) -> dict[str, float]:
        """Return the relative errors of stress (``rms``, ``max``) and energy (``energy_rms``)."""
        stresses = (self._stresses(samples.stretches, *values.T[1:]) for values in (predicted, samples.y))
        return {**relative_errors(*stresses), "energy_rms": relative_errors(predicted[:, :1], samples.y[:, :1])["rms"]}

    def scaling(self, model) -> dict:
        return {"folded": "features are standardised and targets scaled within the regressor; the payload is on plain features"}


def checked_derivatives(X, y, columns: tuple[str, str], outputs: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns of X, checked to be positive, and those of y."""
    check_targets(y, outputs)
    return checked_columns(X, columns, columns[::-1]), y.T


def relative_errors(predicted: np.ndarray, exact: np.ndarray) -> dict[str, float]:
    """Return the RMS (``rms``) and the greatest (``max``) error of vectors, shape (n, d), divided by the RMS of the exact ones."""
    error = np.linalg.norm(predicted - exact, axis=1)
    size = np.sqrt((exact**2).sum(axis=1).mean())
    return {"rms": float(np.sqrt((error**2).mean()) / size), "max": float(error.max() / size)}


def strain_bins(low: float, high: float) -> list[tuple[float, float]]:
    """Return the bins of greatest principal strain up to that of a range of stretches, at which the last bin ends."""
    reach = max(high - 1, 1 - low)
    return [(least, min(greatest, reach)) for least, greatest in pairwise(STRAIN_BINS) if least < reach * (1 - 1e-9)]
