"""Regressor with a transformation of the target that depends on the inputs, and functions for such transformations."""

import warnings
from collections.abc import Callable
from functools import update_wrapper

import numpy as np
from sklearn import config_context, get_config
from sklearn.base import BaseEstimator, MetaEstimatorMixin, RegressorMixin, clone
from sklearn.compose import TransformedTargetRegressor
from sklearn.linear_model import LinearRegression
from sklearn.multioutput import MultiOutputRegressor
from sklearn.pipeline import Pipeline
from sklearn.utils import get_tags
from sklearn.utils.metadata_routing import MetadataRouter, MethodMapping, get_routing_for_object
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, has_fit_parameter, validate_data

from ..arguments import in_order
from .base import distinct_samples


class NamedFunction:
    """Function of a module whose ``repr`` is its name, with the names of the columns of X and y that it reads, None for any.

    A pickle holds the module and the name only, as that of a plain function does.
    """

    __name__: str
    __qualname__: str

    def __init__(self, function: Callable, columns: tuple[str, ...] | None = None, targets: tuple[str, ...] | None = None) -> None:
        update_wrapper(self, function)
        self.columns, self.targets = columns, targets

    def __call__(self, *args, **kwargs):
        return self.__wrapped__(*args, **kwargs)

    def __repr__(self) -> str:
        return self.__name__

    def __reduce__(self) -> str:
        return self.__qualname__


def named(columns: tuple[str, ...] | None = None, targets: tuple[str, ...] | None = None) -> Callable[[Callable], NamedFunction]:
    """Return a decorator that makes a `NamedFunction` with these names of its columns and targets."""
    return lambda function: NamedFunction(function, columns, targets)


def columns_read(function) -> tuple[tuple[str, ...] | None, tuple[str, ...] | None]:
    """Return the names of the columns of X and y that a function, or a partial of one, reads; None where it has no names."""
    function = getattr(function, "func", function)
    return getattr(function, "columns", None), getattr(function, "targets", None)


def check_targets(y, names) -> None:
    """Raise ValueError if a target does not have the named columns."""
    if np.shape(y)[1:] != (len(names),):
        raise ValueError(f"y must have the {len(names)} columns {', '.join(names)}, not shape {np.shape(y)}")


def checked_columns(X, columns: tuple[str, ...], positive: tuple[str, ...]) -> np.ndarray:
    """Return the columns of X; raise ValueError unless they are as many as are named, and the named ones positive."""
    X = np.asarray(X, dtype=float)
    if X.ndim != 2 or X.shape[1] != len(columns):
        raise ValueError(f"X must have the {len(columns)} columns {', '.join(columns)}, not shape {X.shape}")
    for name in positive:
        values = X[:, columns.index(name)]
        if not (values > 0).all():
            raise ValueError(f"{name} must be positive; the least given is {values.min():g}")
    return X.T


def is_search(model) -> bool:
    """Return whether an estimator is one of scikit-learn's searches over parameters."""
    return isinstance(model, BaseEstimator) and (hasattr(model, "param_grid") or hasattr(model, "param_distributions"))


def weighted_part(estimator) -> tuple[str, object]:
    """Return the name of sample weights in ``fit`` of an estimator, and the regressor that they are for.

    In a pipeline the name is prefixed with that of the last step, however deeply pipelines are nested.
    """
    if isinstance(estimator, Pipeline):
        name, last = estimator.steps[-1]
        parameter, regressor = weighted_part(last)
        return f"{name}__{parameter}", regressor
    if isinstance(estimator, TransformedTargetRegressor):
        return weighted_part(LinearRegression() if estimator.regressor is None else estimator.regressor)
    if isinstance(estimator, MultiOutputRegressor) or is_search(estimator):
        return weighted_part(estimator.estimator)
    return "sample_weight", estimator


class InputAwareTargetRegressor(MetaEstimatorMixin, RegressorMixin, BaseEstimator):
    """Fit a regressor to ``func(X, y)`` and predict with ``inverse_func(X, ...)``.

    Like `sklearn.compose.TransformedTargetRegressor`, but with transformations that depend on the inputs, such as a division by a known
    size of the target. Chosen transformed outputs can be made exactly zero at one input, by subtracting the prediction there.

    Parameters
    ----------
    regressor : estimator, default=None
        Any regressor; LinearRegression if None.
    func, inverse_func : callable, default=None
        ``func(X, y)`` and its inverse ``inverse_func(X, z)``; the identity if None. Samples for which `func` returns NaN are left out of
        the training, with a warning. If `func` has names of columns (`named`), the columns of tables are reordered by
        them, and tables with other names are refused.
    anchor : array-like, shape (n_features,), default=None
        Input at which the transformed outputs with the numbers `anchored_outputs` are zero.
    anchored_outputs : tuple of int, default=()

    Attributes
    ----------
    regressor_ : estimator
    offsets_ : ndarray, shape (n_outputs,)
        Values subtracted from the transformed outputs.
    training_inputs_ : ndarray, shape (n_samples, n_features), or None
        Inputs of the training; None after reading from a file.
    n_features_in_ : int

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pipeline = pds.surrogate_pipeline(pds.learning.ChebyshevRegressor(4), features="isochoric")
    >>> isinstance(pipeline, pds.learning.InputAwareTargetRegressor)
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
            Weights for the regressor, or for the last step of a pipeline at any depth. A whole number stands for as many copies of a
            sample, 0 for none: if the regressor accepts weights, repeated samples are merged into weights, so that both trainings are the
            same. Scalings are those of the distinct samples. With scikit-learn's metadata routing the weights go to the parts of
            `regressor` that request them, and to the regressor if none does.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If only one of `func` and `inverse_func` is given, the columns of a table have other names than those of `func`, or the
            transformed target is not finite.
        """
        if (self.func is None) != (self.inverse_func is None):
            raise ValueError("func and inverse_func are given together or not at all")
        for key in ("regressor_", "offsets_", "training_inputs_"):
            vars(self).pop(key, None)  # of an earlier training, which must not outlive a failed one
        columns, targets = columns_read(self.func)
        X, y = validate_data(self, in_order(X, columns, "X"), in_order(y, targets, "y"), multi_output=True, y_numeric=True)
        regressor = clone(self.regressor) if self.regressor is not None else LinearRegression()
        rows = np.arange(len(X))
        if sample_weight is not None:
            sample_weight = _check_sample_weight(sample_weight, X, ensure_non_negative=True)
        if has_fit_parameter(weighted_part(regressor)[1], "sample_weight"):
            kept, sample_weight = distinct_samples(X, y, sample_weight)
            X, y, rows = X[kept], y[kept], rows[kept]
        z = y if self.func is None else np.asarray(self.func(X, y))
        undetermined = np.isnan(z).reshape(len(X), -1).any(axis=1)
        if undetermined.any():
            first = rows[undetermined].min()
            which = f"{undetermined.sum()} of {len(X)} samples do not determine the transformed target, such as sample {first}"
            if undetermined.all():
                raise ValueError(f"{which}, and nothing is left to train on")
            warnings.warn(f"{which}, {X[rows == first][0]}: they are left out", stacklevel=2)
            X, z, rows = X[~undetermined], z[~undetermined], rows[~undetermined]
            sample_weight = None if sample_weight is None else sample_weight[~undetermined]
        if not np.isfinite(z).all():
            first = np.flatnonzero(~np.isfinite(z).reshape(len(X), -1).all(axis=1))[0]
            raise ValueError(f"the transformed target of sample {rows[first]} is not finite: the transformation has no value at {X[first]}")
        self._fit_weighted(regressor, X, z, sample_weight)
        offsets = np.zeros(z.shape[1] if z.ndim == 2 else 1)
        if self.anchor is not None:
            at_anchor = np.ravel(regressor.predict(np.asarray(self.anchor, dtype=float).reshape(1, -1)))
            chosen = list(self.anchored_outputs)
            offsets[chosen] = at_anchor[chosen]
        self.regressor_, self.offsets_, self.training_inputs_ = regressor, offsets, np.array(X, dtype=float)
        return self

    def _fit_weighted(self, regressor, X, z, weights) -> None:
        """Fit the regressor, with the weights, if any, for the part that accepts them."""
        if weights is None:
            regressor.fit(X, z)
        elif get_config()["enable_metadata_routing"] and self._routes_weights():
            regressor.fit(X, z, sample_weight=weights)
        else:
            with config_context(enable_metadata_routing=False):
                regressor.fit(X, z, **{weighted_part(regressor)[0]: weights})

    def _routes_weights(self) -> bool:
        """Return whether a part of the regressor requests weights by scikit-learn's metadata routing."""
        return self.regressor is not None and get_routing_for_object(self.regressor).consumes("fit", ["sample_weight"])

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "offsets_")

    def get_metadata_routing(self):
        """Return scikit-learn's routing of metadata: to this estimator, or to the parts of the regressor that request them."""
        own = super().get_metadata_routing()
        if own.consumes("fit", ["sample_weight"]) or not self._routes_weights():
            return own
        return MetadataRouter(owner=self).add(regressor=self.regressor, method_mapping=MethodMapping().add(caller="fit", callee="fit"))

    def __getstate__(self):
        # `force_model_of` finds the domain of a model in memory from its inputs; a file has the domain on the card of its artefact.
        return {key: value for key, value in super().__getstate__().items() if key != "training_inputs_"}

    def predict(self, X):
        """Predict the target, shape as in training."""
        check_is_fitted(self)
        X = validate_data(self, in_order(X, columns_read(self.func)[0], "X"), reset=False)
        z = self.regressor_.predict(X)
        z = z - (self.offsets_ if z.ndim == 2 else self.offsets_[0])
        return z if self.inverse_func is None else np.asarray(self.inverse_func(X, z))
