"""Regressors of stretches, for scikit-learn's general checks, whose inputs are none."""

import numpy as np


class AnyInput:
    """Before such a regressor among the bases of a class: columns of any number, name and sign
    are made into two stretches.
    """

    _columns = None

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.positive_only = False
        return tags

    def _stretches(self, X):
        first = np.exp(np.tanh(X @ np.linspace(1, 2, X.shape[1]) / 10))
        return np.stack([first, first**-0.5], axis=1)
