"""Identification of laws from test data, as the commands ``pdsurrogate identify`` and ``pdsurrogate fit`` carry it out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from sklearn.base import clone

from ..forces import ForceModel
from ..forces.homogeneous import nominal_states
from ..materials import LAWS, Law
from .committee import committee
from .data import TestData
from .energy import EnergyRegressor
from .examination import examine
from .regressor import N_TERMS, LawRegressor, fitted_laws
from .reporting import differences, held_out_modes, report
from .stress_regressor import StressRegressor, free_sides

EDGE = 1e-6
"""Least log-stretch between a test and the domain of an artefact at which the test counts as outside: rounding decides below it."""


@dataclass(frozen=True)
class IdentificationSettings:
    """Settings of an identification.

    Parameters
    ----------
    n_terms : int
        Terms of Ogden's law.
    bulk_modulus, bulk_ratio : float, optional
        Bulk modulus of the law, or its ratio to the shear modulus; at most one of them.

    Raises
    ------
    ValueError
        If both are given, or one is not positive.
    """

    n_terms: int = N_TERMS
    bulk_modulus: float | None = None
    bulk_ratio: float | None = None

    def __post_init__(self) -> None:
        if len(self.bulk) > 1:
            raise ValueError("--bulk-modulus and --bulk-ratio say the same: choose one")
        for key, value in self.bulk.items():
            if not 0 < value < float("inf"):
                raise ValueError(f"--{key.replace('_', '-')} must be positive and finite, not {value:g}")

    @property
    def bulk(self) -> dict[str, float]:
        """Arguments of a regressor for the bulk modulus, without those that are not given."""
        given = {"bulk_modulus": self.bulk_modulus, "bulk_ratio": self.bulk_ratio}
        return {key: value for key, value in given.items() if value is not None}

    def fitted(self, data: TestData, law: str | None) -> StressRegressor:
        """Return a regressor of a law, or for None of an energy without a law, fitted to test data; raise ValueError for other names."""
        if law is not None and law not in LAWS:
            raise ValueError(f"unknown law {law!r}; there are {', '.join(sorted(LAWS))}")
        if law is not None and law not in fitted_laws():
            raise ValueError(f"the terms of {law} are found from test data by fit --free, which names no law")
        regressor = EnergyRegressor(**self.bulk) if law is None else LawRegressor(law, n_terms=self.n_terms, **self.bulk)
        return regressor.fit(data.stretches, data.nominal_stress, data.balanced_weights())


def identify(
    data: TestData,
    laws: Sequence[str],
    settings: IdentificationSettings,
    hold_out: bool = False,
    progress: Callable[[float, str], None] = lambda done, text: None,
) -> tuple[list[StressRegressor], list[dict], list[dict]]:
    """Fit laws to test data.

    Parameters
    ----------
    data : TestData
    laws : sequence of str
        Names of laws.
    settings : IdentificationSettings
    hold_out : bool
        Whether each mode is held out in turn from further fits.
    progress : callable
        Called with the number of laws that are done and a description.

    Returns
    -------
    models : list of StressRegressor
        Fitted regressors.
    reports : list of dict
        See `examined`.
    held_out : list of dict
        See `held_out_modes`.
    """
    models, held_out = [], []
    for number, law in enumerate(laws):
        progress(number, law)
        models.append(settings.fitted(data, law))
        if hold_out:
            progress(number + 0.5, f"{law}, each mode held out in turn")
            held_out += held_out_modes([clone(models[-1])], data)
    return models, [examined(model, data, models) for model in models], held_out


def examined(model: StressRegressor, data: TestData, others: Sequence[StressRegressor] = ()) -> dict:
    """Return the `report` of a fitted regressor with the ``refusals`` and ``remarks`` of its examination."""
    found, free = examine(model, data, others), {}
    if isinstance(model, EnergyRegressor):
        free = {"form": "polyconvex energy without a law", "cross_validation": model.cross_validation_}
    return {**report(model, data), **free, "refusals": found.refusals, "remarks": found.remarks}


class Identified(NamedTuple):
    """Law identified from test data, for the fit of a surrogate.

    Attributes
    ----------
    data : TestData
    model : StressRegressor
    report : dict
        See `examined`; also the ``committee``, if there is one.
    members : list of Law
        Laws of the members of the committee.
    """

    data: TestData
    model: StressRegressor
    report: dict
    members: list[Law]


def identified(data: TestData, law: str | None, settings: IdentificationSettings, n_members: int | None, seed: int) -> Identified:
    """Return a law, or for None an energy without a law, fitted to test data, with a `committee` of `n_members`."""
    model = settings.fitted(data, law)
    found, weights = examined(model, data), data.balanced_weights()
    if not n_members:
        return Identified(data, model, found, [])
    members = committee(model, data.stretches, data.nominal_stress, n_members, data.tests, seed, sample_weight=weights)
    own = " with exponents of its own" if law is None else ""
    found["committee"] = f"each fitted to half of {len(set(data.tests))} tests{own}, seed {seed}"
    return Identified(data, model, found, [member.law_ for member in members])


class SimulatedTests(NamedTuple):
    """Test data simulated with a force model.

    Attributes
    ----------
    stress : ndarray
        Nominal stresses.
    differences : dict
        Greatest difference from the stresses measured, by mode (`differences`).
    off_law : float
        Greatest difference from the law, relative to the greatest stress; NaN if a state has no stress.
    outside : int
        Number of rows outside the domain of the force model.
    """

    stress: np.ndarray
    differences: dict[str, dict]
    off_law: float
    outside: int


def simulate_tests(force: ForceModel, tests: Identified) -> SimulatedTests:
    """Return the nominal stresses of a force model in the states of test data, compared with data and law."""
    data, model = tests.data, tests.model
    first, second = data.stretches.T
    stress, beyond = nominal_states(force, model.law_, np.column_stack([first, np.where(free_sides(first, second), np.nan, second)]))
    law = model.predict(data.stretches)
    off_law = np.abs(stress - law).max() / np.abs(law).max()
    return SimulatedTests(stress, differences(data, stress), float(off_law), int((beyond > EDGE).sum()))
