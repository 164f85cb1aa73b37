"""Targets that surrogates learn (bond force, energy of a sheet, isochoric energy) and their samples."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..forces import Domain, LearntBondForce, LearntEnergy
from ..materials import Law
from .sampling import PERTURBATION

Range = tuple[float, float]
"""Least and greatest principal stretch."""

REPORTED_STATES, REPORT_SEED = 20_000, 1_000_003
"""States in each set of a report of errors, whose RMS they give to a percent, and their seed, which is none that samples are drawn with."""


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
    """

    name: ClassVar[str]
    columns: ClassVar[tuple[str, ...]]
    outputs: ClassVar[tuple[str, ...]]
    stretch_range: ClassVar[Range]
    n_samples: ClassVar[int]
    units: ClassVar[str]
    weight_function: ClassVar[str]
    has_committees: ClassVar[bool] = True

    @abstractmethod
    def reached(self, law: Law, low: float, high: float) -> bool:
        """Return whether a law has all states of samples whose principal stretches have logarithms from `low` to `high`."""

    @abstractmethod
    def draw(self, law: Law, n_samples: int, stretch_range: Range, near_rest: float, random_state: int, **options) -> Samples:
        """Return samples in the order in which they are drawn; `options` are those of `pdsurrogate.training_samples`."""

    @abstractmethod
    def pipeline(self, regressor, **options):
        """Return an unfitted pipeline; `options` are those of `pdsurrogate.surrogate_pipeline`."""

    @abstractmethod
    def predicted_by(self, model) -> bool:
        """Return whether a pipeline predicts this target."""

    @abstractmethod
    def errors(self, predicted: np.ndarray, samples: Samples) -> dict[str, float]:
        """Return the relative errors (``rms``, ``max``) of predictions, of the shape of ``samples.y``."""

    @abstractmethod
    def domain_of_states(self, law: Law, X: np.ndarray) -> Domain:
        """Return the domain of a surrogate that is fitted to states (columns `columns`) of an unknown design."""

    @abstractmethod
    def surrogate(
        self, model, law: Law, domain: Domain, name: str, states: np.ndarray | None = None
    ) -> tuple[LearntBondForce | LearntEnergy, dict]:
        """Return the surrogate of a fitted model and a report of its resampling, empty for a surrogate that equals the model."""

    @abstractmethod
    def report(self, model, law: Law, stretch_range: Range, n_samples: int = REPORTED_STATES, random_state: int = REPORT_SEED) -> dict:
        """Return the report of `pdsurrogate.evaluate`."""

    def domain(self, law: Law, samples: Samples) -> Domain:
        """Return the domain of a surrogate that is fitted to samples of a design."""
        found, design = self.domain_of_states(law, samples.X), samples.design
        bulk = found.least_bulk, found.greatest_bulk
        if design.get("off_surface"):
            # The bounds of the perturbation, which the samples nearly reach.
            reach = np.exp(design.get("perturbation", PERTURBATION)["log_C33"])
            bulk = float(1 / reach), float(reach)
        # The hull of the test data, for an energy without a law.
        hull = None if design.get("hull") is None else tuple(tuple(map(float, plane)) for plane in design["hull"])
        return Domain(*design["stretch_range"], *bulk, hull)

    def more_reports(self, surrogate, law: Law, stretch_range: Range) -> dict[str, dict]:
        """Return reports over further ranges of stretches for the card, by title."""
        return {}

    def shape(self, law: Law) -> dict[str, float]:
        """Return the dimensionless parameters of a law that the target depends on."""
        return dict(law.shape)

    @abstractmethod
    def scaling(self, model) -> dict:
        """Return the scalings of a fitted model for its card."""
