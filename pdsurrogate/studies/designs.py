"""Designs: the values of the parameters of a study in each of its runs."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from ..scenes import SceneError
from .description import MOST_RUNS, Distribution, Study


def parameters_of_runs(study: Study) -> list[dict[str, Any]]:
    """Return, for each run, the values of its parameters by dotted key; the last parameter of a grid changes fastest.

    Raise SceneError if the lists of a zip differ in length, or a grid has more than `MOST_RUNS` runs.
    """
    keys = list(study.parameters)
    if study.design == "grid":
        number = math.prod(len(values) for values in study.parameters.values())
        if number > MOST_RUNS:
            raise SceneError(
                f"parameters: the grid has {number} runs, the limit is {MOST_RUNS}; to draw from it, use design=latin-hypercube"
            )
        rows = itertools.product(*study.parameters.values())
    elif study.design == "zip":
        lengths = {key: len(values) for key, values in study.parameters.items()}
        if len(set(lengths.values())) > 1:
            told = ", ".join(f"{key} has {length}" for key, length in lengths.items())
            raise SceneError(f"parameters: design=zip needs lists of equal length, but {told} values")
        rows = zip(*study.parameters.values(), strict=True)
    else:
        shares = _shares(study, len(keys)).T
        rows = zip(*map(_drawn, study.parameters.values(), shares), strict=True)
    return [dict(zip(keys, row, strict=True)) for row in rows]


def _shares(study: Study, dimension: int) -> np.ndarray:
    """Return places in the unit cube, shape (samples, dimension)."""
    random = np.random.default_rng(study.seed)
    if study.design == "random":
        return random.random((study.samples, dimension))
    from scipy.stats.qmc import LatinHypercube

    return LatinHypercube(dimension, rng=random).random(study.samples)


def _drawn(values: tuple | Distribution, shares: np.ndarray) -> list:
    """Return quantiles of a distribution, or of a list whose entries have equal probability."""
    if isinstance(values, Distribution):
        quantiles = values.build().ppf(shares)
        return [int(value) if values.discrete else float(value) for value in quantiles]
    return [values[min(int(share * len(values)), len(values) - 1)] for share in shares]
