"""Identification of laws from test data for the command line, with reports as dictionaries and
figures.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from sklearn.base import clone

from ..forces import ForceModel
from ..forces.homogeneous import nominal_states
from ..progress import event
from ..results.figures import styled
from .data import BIAXIAL, MODES, TestData
from .energy import EnergyRegressor, mode_of
from .examination import examine, standardized
from .history_regressor import FREE, HistoryRegressor
from .regressor import LawRegressor
from .stress_regressor import (
    LawEstimator,
    StressRegressor,
    nominal_stress,
    sheet_of,
    states,
)
from .tearing import off_at_break, tearing_energies

LARGE_GROWTH = 1.05
"""Greatest volume ratio that an identified law may give in the tests without a warning: the volume
of rubber grows by a percent or so. Chosen just above the 4 % to which the default bulk modulus
leads at Treloar's greatest stretch (`BULK_RATIO`).
"""


def report(model: StressRegressor, data: TestData, predicted: np.ndarray) -> dict:
    """Return a report of a fit as plain values: the data, the parameters with standard errors (None
    where infinite), and the errors of predicted stresses.

    ``residuals`` lists the rows with the greatest residuals.
    """
    return {
        "data": data.name,
        "rows": len(data),
        **parameters_of(model),
        "r_squared": data.r_squared(predicted),
        "differences": differences(data, predicted),
        "residuals": standardized(model, data),
        **facts_of_tests(data),
    }


def facts_of_tests(data: TestData) -> dict:
    """Return the unit of the stresses, and states at break, if the tests have them."""
    found: dict = {"stress_unit": data.unit} if data.unit else {}
    broken = data.tests.at_break if data.tests else {}
    at_break = {mode: row for mode, row in broken.items() if mode in data.modes}
    return found | ({"at_break": at_break} if at_break else {})


def parameters_of(model: LawEstimator) -> dict:
    """Return the fitted law of a regressor for a report: its parameters with standard errors, None
    where infinite, and their covariance.

    The covariance is None if the parameters are not all determined.
    """
    try:
        covariance = model.law_covariance().describe()
    except ValueError:
        covariance = None
    return {
        "law": model.law_.describe(),
        "parameters": dict(zip(model.parameter_names_, model.parameters_.tolist(), strict=True)),
        "standard_errors": dict(
            zip(model.parameter_names_, map(plain, model.standard_errors_), strict=True)
        ),
        "covariance": covariance,
        "at_bound": model.at_bound_,
    }


def plain(value: float) -> float | None:
    """Return a number for a report, None if it is not finite."""
    return float(value) if np.isfinite(value) else None


def differences(data: TestData, stress: np.ndarray) -> dict[str, dict]:
    """Return, by mode, the greatest difference of given stresses (simulated or of a law) from the
    measured stresses.

    ``difference`` is relative to the greatest stress measured in the mode, and ``stretch`` is the
    stretch along the stress; both are None if the stress of a state is not finite.
    """
    found: dict[str, dict] = {}
    for mode in data.modes:
        rows = data.mode == mode
        off = (stress[rows] - data.nominal_stress[rows]) / max(
            np.abs(data.nominal_stress[rows]).max(), 1e-300
        )
        place = int(np.argmax(np.abs(off)))  # argmax treats NaN as the greatest
        known = np.isfinite(off[place])
        found[mode] = {
            "difference": float(off[place]) if known else None,
            "stretch": float(data.stretches[rows][place, 0]) if known else None,
        }
    return found


def figure(
    models: list[StressRegressor], data: TestData, simulated: np.ndarray | None = None
) -> Figure:
    """Return a figure with a panel for each mode: points of the tests, a line for each fitted law,
    and crosses for simulated stresses.

    Biaxial tests follow no single curve: their panel shows the stress of each law over the measured
    stress, and the line of equality.
    """
    modes = data.modes
    with styled(2.6 * max(len(modes), 2), 2.9) as drawn:
        for axis, mode in zip(drawn.subplots(1, len(modes), squeeze=False)[0], modes, strict=True):
            rows = data.of(mode)
            if mode == BIAXIAL:
                axis.set(title=mode, xlabel="measured stress", ylabel="stress of the law")
                places = along = rows.nominal_stress
                stretches = rows.stretches
                style = {"ls": "", "marker": ".", "ms": 3}
                axis.plot(places, places, "-", color="0.6", lw=0.8)
            else:
                axis.set(title=mode, xlabel="stretch")
                places = rows.stretches[:, 0]
                along = np.linspace(min(1.0, places.min()), places.max(), 200)
                stretches = np.column_stack([along, MODES[mode](along)])
                style = {"lw": 1}
                axis.plot(places, rows.nominal_stress, "ko", ms=3.5, mfc="none", label="test")
            for model in models:
                axis.plot(along, nominal_stress(model.law_, stretches), label=model.law, **style)
            if simulated is not None:
                axis.plot(places, simulated[data.mode == mode], "rx", ms=3, label="simulated")
        drawn.axes[0].legend()
        drawn.axes[0].set_ylabel(drawn.axes[0].get_ylabel() or "nominal stress")
        return drawn


def held_out_modes(
    models: Iterable[StressRegressor], data: TestData, fitted_to: Iterable[str] | None = None
) -> list[dict]:
    """Fit each law to some modes of loading, and return the errors of the fit in the other modes.

    Parameters
    ----------
    models : iterable of StressRegressor
    data : TestData
        Data of at least two modes.
    fitted_to : iterable of str, optional
        Modes to which each law is fitted, with all others held out; by default each mode is held
        out in turn.

    Returns
    -------
    list of dict
        For each law and each split: ``law``, ``fitted_to``, ``held_out`` (R^2 by mode) and
        ``relative_rms`` error of the rows held out, NaN if the law has no stress in one of these
        rows.
    """
    modes = data.modes
    splits = (
        [list(fitted_to)]
        if fitted_to is not None
        else [[mode for mode in modes if mode != left] for left in modes]
    )
    rows = []
    for model in models:
        for train in splits:
            known = data.of(*train)
            unseen = data.of(*(mode for mode in modes if mode not in train))
            if not len(known) or not len(unseen):
                raise ValueError(
                    f"{data.name}: no mode can be held out: there are {', '.join(modes)}, to fit"
                    f" {', '.join(train) or 'none'}"
                )
            predicted = clone(model).fit_tests(known).predict(unseen.stretches)
            off = np.sqrt(
                ((predicted - unseen.nominal_stress) ** 2).sum() / (unseen.nominal_stress**2).sum()
            )
            scores = {"held_out": unseen.r_squared(predicted), "relative_rms": float(off)}
            rows.append({"law": model.law, "fitted_to": train, **scores})
    return rows


def fitted(
    data: TestData, law: str | None, n_terms: int, bulk: dict[str, float], **memory: Any
) -> StressRegressor:
    """Fit a law (Ogden's with `n_terms` terms), or an energy without a law if `law` is None, to
    test data; return the regressor.

    `bulk` is a dictionary as `stress_regressor.bulk_arguments` returns it, and `memory` has further
    arguments of a `HistoryRegressor`.
    """
    regressor: StressRegressor
    if memory:
        regressor = HistoryRegressor(law or FREE, n_terms=n_terms, **memory, **bulk)
    elif law is None:
        regressor = EnergyRegressor(**bulk)
    else:
        regressor = LawRegressor(law, n_terms=n_terms, **bulk)
    return regressor.fit_tests(data)


def identify(
    data: TestData, laws: Sequence[str], n_terms: int, bulk: dict[str, float], hold_out: bool
) -> tuple[list[StressRegressor], list[dict], list[dict]]:
    """Fit several laws to test data, and report on each fit.

    Parameters
    ----------
    data : TestData
    laws : sequence of str
        Names of laws.
    n_terms : int
        Terms of Ogden's law.
    bulk : dict
        See `stress_regressor.bulk_arguments`.
    hold_out : bool
        Whether each mode is held out in turn from further fits.

    Returns
    -------
    models : list of StressRegressor
        Fitted regressors.
    reports : list of dict
        See `examined`.
    held_out : list of dict
        See `held_out_modes`.
    """
    models = []
    held_out = []
    for number, law in enumerate(laws):
        event("fitting", number, len(laws), law=law)
        models.append(fitted(data, law, n_terms, bulk))
        if hold_out:
            event("fitting", number + 0.5, len(laws), law=f"{law}, each mode held out in turn")
            held_out += held_out_modes(models[-1:], data)
    return models, [examined(model, data) for model in models], held_out


def examined(model: StressRegressor, data: TestData) -> dict:
    """Return the `report` of a fitted regressor, with the ``refusals`` and ``remarks`` of the
    examination of fit and data (`examine`).

    ``differences`` compare the tests with the law at its bulk modulus, as in a simulation of the
    tests; ``volume_ratio`` is the greatest volume ratio.
    """
    predicted, volume = states(model.law_, data.stretches)
    found = report(model, data, predicted)
    found["volume_ratio"] = float(np.nanmax(volume)) if np.isfinite(volume).any() else None
    form = model.law
    if isinstance(model, EnergyRegressor):
        form = "energy without a law"
        found |= {"form": form, "unmeasured": unmeasured(model, data)}
    found |= judged(model, data, form)
    remarks = found["remarks"]
    energies, untorn = tearing_energies(model.law_, data.tests)
    found |= {"tearing": energies} if energies else {}
    remarks += [f"{form}: {text}" for text in (*untorn, *off_at_break(model.law_, data.tests))]
    if found["volume_ratio"] and found["volume_ratio"] > LARGE_GROWTH:
        remarks.append(
            f"{form}: with this bulk modulus the volume grows by"
            f" {100 * (found['volume_ratio'] - 1):.0f} % in the tests, more than that of rubber;"
            " set a greater one with --bulk-modulus"
        )
    return found


def judged(model: StressRegressor, data: TestData, form: str) -> dict[str, list[str]]:
    """Return the ``refusals`` and ``remarks`` on a fit of a law or an energy, the `form`, and on
    its data.
    """
    found = examine(model, data)
    remarks = list(found.remarks)
    if model.at_bound_:
        longer = " Tests at other rates, or held for longer, determine more." * model.over_time
        remarks.append(
            f"{form}: {', '.join(model.at_bound_)} reached a bound of the search range: the data"
            f" do not determine it, or another law would fit better.{longer}"
        )
    return {"refusals": found.refusals, "remarks": remarks}


def unmeasured(model: EnergyRegressor, data: TestData) -> list[dict]:
    """Return stresses and standard deviations of an energy in the modes of loading without data,
    at stretches of most bodies of rubber.
    """
    greatest = data.stretches.max()
    stretches = np.array([one for one in (1.5, 2.0, 3.0) if one <= greatest] or [greatest])
    found = []
    measured = {*mode_of(data.stretches).tolist()}
    for mode in (mode for mode in MODES if mode not in measured):
        states = np.column_stack([stretches, MODES[mode](stretches)])
        rows = zip(
            stretches.tolist(),
            model.predict(states),
            model.standard_deviations(states),
            strict=True,
        )
        found += [
            {
                "mode": mode,
                "stretch": at,
                "nominal_stress": plain(y),
                "standard_deviation": plain(sd),
            }
            for at, y, sd in rows
        ]
    return found


def simulate_tests(
    force: ForceModel, data: TestData, model: StressRegressor
) -> tuple[np.ndarray, float, int]:
    """Return the stresses of a force model in the states of test data, and their difference from a
    law fitted to the data.

    Returns
    -------
    stress : ndarray, shape (n,)
        Nominal stresses.
    off_law : float
        Greatest difference from the stresses of `model`, relative to the greatest of these; NaN if
        a state has no stress.
    outside : int
        Number of rows outside the domain of the force model.
    """
    stress, beyond = nominal_states(force, model.law_, np.column_stack(sheet_of(data.stretches)))
    law = model.predict(data.stretches)
    # A test outside the domain of a force model by less, in log-stretch, may be so by rounding.
    return stress, float(np.abs(stress - law).max() / np.abs(law).max()), int((beyond > 1e-6).sum())
