"""Cross-validation of laws over modes of loading."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from sklearn.base import clone

from .data import TestData
from .stress_regressor import StressRegressor


def held_out_modes(models: Iterable[StressRegressor], data: TestData, fitted_to: Iterable[str] | None = None) -> list[dict]:
    """Fit each law to some modes of loading, and return its errors in the others.

    Parameters
    ----------
    models : iterable of StressRegressor
    data : TestData
        Data of at least two modes.
    fitted_to : iterable of str, optional
        Modes to which each law is fitted, with all others held out; by default each mode is held out in turn.

    Returns
    -------
    list of dict
        For each law and each split: ``law``, ``fitted_to``, ``held_out`` (R^2 by mode) and ``relative_rms`` of the rows held out, NaN if
        they are past the limit of the law.
    """
    modes = data.modes
    splits = [list(fitted_to)] if fitted_to is not None else [[mode for mode in modes if mode != left] for left in modes]
    rows = []
    for model in models:
        for train in splits:
            known, unseen = data.of(*train), data.of(*(mode for mode in modes if mode not in train))
            if not len(known) or not len(unseen):
                raise ValueError(
                    f"{data.name}: nothing is fitted or nothing held out: fitted to {', '.join(train) or 'no mode'}, of {', '.join(modes)}"
                )
            fitted = clone(model).fit(known.stretches, known.nominal_stress, known.balanced_weights())
            predicted = fitted.predict(unseen.stretches)
            rows.append(
                {
                    "law": model.law,
                    "fitted_to": train,
                    "held_out": unseen.r_squared(predicted),
                    "relative_rms": float(np.sqrt(((predicted - unseen.nominal_stress) ** 2).sum() / (unseen.nominal_stress**2).sum())),
                }
            )
    return rows
