"""Choice of a law by its prediction of modes of loading that it was not fitted to."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from sklearn.base import clone

from .data import TestData
from .stress_regressor import StressRegressor


def held_out_modes(models: Iterable[StressRegressor], data: TestData, fitted_to: Iterable[str] | None = None) -> list[dict]:
    """Cross-validation over modes of loading.

    Parameters
    ----------
    models : iterable of StressRegressor
    data : TestData
        With at least two modes.
    fitted_to : iterable of str, optional
        Modes that every law is fitted to, all others held out; by default each mode is held out in turn.

    Returns
    -------
    list of dict
        For each law and each way of holding out: ``law``, ``fitted_to``, ``held_out`` (R^2 by mode) and ``relative_rms`` of the rows
        held out (NaN where the law ends before them).
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
