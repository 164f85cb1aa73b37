"""What kinds of energies are learnt, a sheet's under plane stress and the isochoric one: their invariants, samples and surrogates."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..forces import LearntEnergy
from ..materials import Law
from .target import check_targets


class EnergyForm(ABC):
    """An energy as a function of two invariants, learnt with its derivatives by them.

    Attributes
    ----------
    invariants : tuple of str
        Columns of X.
    targets : tuple of str
        Columns of y, in units of the shear modulus.
    surrogate : type
        Of force model that a fitted network becomes.
    stretch_range : tuple of float
        Principal stretches that samples are drawn from where nothing is said.
    n_units : int
        Units of the network where nothing is said.
    flat : tuple of int
        Features by which the derivative is made zero at rest, where all features are zero.
    log_features, feature_names, size, derivatives_by_features, derivatives_by_invariants : callable
        Parts of the pipeline, functions of a module: they are stored by their names.
    """

    name: ClassVar[str]
    invariants: ClassVar[tuple[str, str]]
    targets: ClassVar[tuple[str, str, str]]
    surrogate: ClassVar[type[LearntEnergy]]
    stretch_range: ClassVar[tuple[float, float]]
    n_units: ClassVar[int]
    flat: ClassVar[tuple[int, ...]]
    log_features: ClassVar[Callable]
    feature_names: ClassVar[Callable]
    size: ClassVar[Callable]
    derivatives_by_features: ClassVar[Callable]
    derivatives_by_invariants: ClassVar[Callable]

    @staticmethod
    @abstractmethod
    def states(law: Law, stretches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """X and y at given principal stretches, shape (n, 2) or (n, 3)."""

    @staticmethod
    @abstractmethod
    def draw(random: np.random.Generator, n_samples: int, low: float, high: float, near_rest: float) -> np.ndarray:
        """Logarithms of principal stretches, even within their bounds but for a share near rest."""

    @staticmethod
    @abstractmethod
    def of_strain(random: np.random.Generator, strains: tuple[float, float], low: float, high: float, n_samples: int) -> np.ndarray:
        """Principal stretches whose greatest strain lies in a bin."""

    @staticmethod
    @abstractmethod
    def stresses(stretches: np.ndarray, first, second) -> np.ndarray:
        """Principal stresses from the derivatives of the energy by the two invariants."""

    @staticmethod
    @abstractmethod
    def derivatives(model: LearntEnergy, law: Law, X: np.ndarray) -> np.ndarray:
        """Columns `targets` as a model has them."""

    @staticmethod
    @abstractmethod
    def stability(model: LearntEnergy, law: Law, samples: EnergySamples) -> dict[str, float]:
        """What is reported of a model at rest and of the second derivatives of its energy, beside the exact ones."""

    @staticmethod
    @abstractmethod
    def shape(law: Law) -> dict[str, float]:
        """Those dimensionless parameters of a law that the energy depends on."""

    @staticmethod
    @abstractmethod
    def bulk_range(law: Law, X: np.ndarray) -> tuple[float, float]:
        """Bounds of J3^2 of training states, for the card."""

    @staticmethod
    @abstractmethod
    def range_of(X: np.ndarray) -> tuple[float, float]:
        """Least and greatest principal stretch of states."""


@dataclass(frozen=True)
class EnergySamples:
    """Samples of an energy and its derivatives.

    Attributes
    ----------
    X : ndarray, shape (n, 2)
        Invariants, see `EnergyForm.invariants`.
    y : ndarray, shape (n, 3)
        Energy and its derivatives by them, see `EnergyForm.targets`.
    stretches : ndarray, shape (n, 2) or (n, 3)
        Principal stretches, in the plane or three of product 1.
    design : dict
        How they were drawn.
    form : EnergyForm
        Which energy it is.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> samples = pds.energy_design(pds.NeoHookean(), n_samples=300)
    >>> samples.X.shape[1]
    2
    """

    X: np.ndarray
    y: np.ndarray
    stretches: np.ndarray
    design: dict
    form: EnergyForm

    def __len__(self) -> int:
        return len(self.X)

    @classmethod
    def of(cls, law: Law, stretches: np.ndarray, design: dict, form: EnergyForm) -> EnergySamples:
        """Samples at given principal stretches."""
        return cls(*form.states(law, stretches), stretches, design, form)


def checked_invariants(X, form: EnergyForm) -> tuple[np.ndarray, np.ndarray]:
    """Columns of X, positive.

    Raises
    ------
    ValueError
        If they are not.
    """
    X = np.asarray(X, dtype=float)
    if X.ndim != 2 or X.shape[1] != len(form.invariants):
        raise ValueError(f"X must have the columns {', '.join(form.invariants)}, not shape {X.shape}")
    for name, values in reversed(list(zip(form.invariants, X.T, strict=True))):
        if not (values > 0).all():
            raise ValueError(f"{name} must be positive; the least given is {values.min():g}")
    return X[:, 0], X[:, 1]


def checked_derivatives(X, y, form: EnergyForm):
    """Columns of X and y, checked."""
    invariants = checked_invariants(X, form)
    check_targets(y, form.targets)
    return invariants, y.T
