"""A regressor whose target is transformed by functions that see the inputs."""

from __future__ import annotations

import numpy as np
from sklearn import get_config
from sklearn.base import BaseEstimator, MetaEstimatorMixin, RegressorMixin, clone
from sklearn.compose import TransformedTargetRegressor
from sklearn.linear_model import LinearRegression
from sklearn.multioutput import MultiOutputRegressor
from sklearn.pipeline import Pipeline
from sklearn.utils import get_tags
from sklearn.utils.metadata_routing import MetadataRouter, MethodMapping, process_routing
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data


def check_targets(y, names) -> None:
    """Raise ValueError if a target has other columns than those named."""
    if np.shape(y)[1:] != (len(names),):
        raise ValueError(f"y must have the {len(names)} columns {', '.join(names)}, not shape {np.shape(y)}")


def is_search(model) -> bool:
    """Whether an estimator is one of scikit-learn's searches over parameters."""
    return isinstance(model, BaseEstimator) and (hasattr(model, "param_grid") or hasattr(model, "param_distributions"))


def weight_parameter(estimator) -> str:
    """What ``fit`` of an estimator calls the weights of samples: of a pipeline those of its last step, as deep as they are nested."""
    if isinstance(estimator, Pipeline):
        name, last = estimator.steps[-1]
        return f"{name}__{weight_parameter(last)}"
    if isinstance(estimator, TransformedTargetRegressor) and estimator.regressor is not None:
        return weight_parameter(estimator.regressor)
    if isinstance(estimator, MultiOutputRegressor) or is_search(estimator):
        return weight_parameter(estimator.estimator)
    return "sample_weight"


class InputAwareTargetRegressor(MetaEstimatorMixin, RegressorMixin, BaseEstimator):
    """Fit a regressor to ``func(X, y)`` and predict with ``inverse_func(X, ...)``.

    As `sklearn.compose.TransformedTargetRegressor`, but for transformations that depend on the inputs, such as a known size that the
    target is divided by.  On request the prediction of chosen outputs is made exactly zero at one input, by taking
    off what the regressor gives there.

    Parameters
    ----------
    regressor : estimator, default=None
        Any regressor; LinearRegression if None.
    func, inverse_func : callable, default=None
        ``func(X, y)`` and its inverse ``inverse_func(X, z)``; the identity if None.
    anchor : array-like, shape (n_features,), default=None
        Input at which the transformed outputs named in `anchored_outputs` are zero.
    anchored_outputs : tuple of int, default=()

    Attributes
    ----------
    regressor_ : estimator
    offsets_ : ndarray, shape (n_outputs,)
        Taken off the transformed outputs.
    training_inputs_ : ndarray, shape (n_samples, n_features), or None
        What it was fitted to; None of one that was read from a file.
    n_features_in_ : int

    Examples
    --------
    >>> import pdsurrogate as pd
    >>> pipeline = pd.bond_force_pipeline("isochoric", pd.ChebyshevRegressor(4))
    >>> isinstance(pipeline, pd.InputAwareTargetRegressor)
    True
    """

    training_inputs_ = None

    def __init__(self, regressor=None, func=None, inverse_func=None, anchor=None, anchored_outputs=()):
        self.regressor = regressor
        self.func = func
        self.inverse_func = inverse_func
        self.anchor = anchor
        self.anchored_outputs = anchored_outputs

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        inner = get_tags(self.regressor) if self.regressor is not None else get_tags(LinearRegression())
        tags.target_tags.multi_output = inner.target_tags.multi_output
        tags.regressor_tags.poor_score = True
        return tags

    def fit(self, X, y, sample_weight=None):
        """Fit the regressor to the transformed target.

        Parameters
        ----------
        X : array-like, shape (n_samples, n_features)
        y : array-like, shape (n_samples,) or (n_samples, n_outputs)
        sample_weight : array-like, shape (n_samples,), optional
            For the regressor, or the last step of a pipeline, whatever that is nested in; the scalings before it take none.  With
            scikit-learn's metadata routing it goes where it is requested.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If only one of `func` and `inverse_func` is given, or the transformed target is not finite.
        """
        if (self.func is None) != (self.inverse_func is None):
            raise ValueError("func and inverse_func are given together or not at all")
        X, y = validate_data(self, X, y, multi_output=True, y_numeric=True)
        self.training_inputs_ = np.array(X, dtype=float)
        z = y if self.func is None else np.asarray(self.func(X, y))
        if not np.isfinite(z).all():
            first = np.flatnonzero(~np.isfinite(z).reshape(len(X), -1).all(axis=1))[0]
            raise ValueError(f"the transformed target of sample {first} is not finite: the transformation has no value at {X[first]}")
        self.regressor_ = clone(self.regressor) if self.regressor is not None else LinearRegression()
        weights = {}
        if sample_weight is not None:
            sample_weight = _check_sample_weight(sample_weight, X)
            if get_config()["enable_metadata_routing"]:
                weights = process_routing(self, "fit", sample_weight=sample_weight).regressor.fit
            else:
                weights = {weight_parameter(self.regressor_): sample_weight}
        self.regressor_.fit(X, z, **weights)
        self.offsets_ = np.zeros(z.shape[1] if z.ndim == 2 else 1)
        if self.anchor is not None:
            at_anchor = np.ravel(self.regressor_.predict(np.asarray(self.anchor, dtype=float).reshape(1, -1)))
            chosen = list(self.anchored_outputs)
            self.offsets_[chosen] = at_anchor[chosen]
        return self

    def get_metadata_routing(self):
        """Where metadata go, as scikit-learn asks: to the regressor."""
        regressor = self.regressor if self.regressor is not None else LinearRegression()
        return MetadataRouter(owner=self).add(regressor=regressor, method_mapping=MethodMapping().add(caller="fit", callee="fit"))

    def __getstate__(self):
        # The inputs tell where a fitted model holds (`force_model_of`) as long as it is in memory; a file of it comes with a card.
        return {key: value for key, value in super().__getstate__().items() if key != "training_inputs_"}

    def predict(self, X):
        """Predict the target, shape as in training."""
        check_is_fitted(self)
        X = validate_data(self, X, reset=False)
        z = self.regressor_.predict(X)
        z = z - (self.offsets_ if z.ndim == 2 else self.offsets_[0])
        return z if self.inverse_func is None else np.asarray(self.inverse_func(X, z))
