"""Targets that surrogates learn (bond force, energy of a sheet, isochoric energy), their
samples, and the outer estimator of pipelines.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from sklearn.base import BaseEstimator, MetaEstimatorMixin, RegressorMixin, clone
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import FunctionTransformer
from sklearn.utils import get_tags
from sklearn.utils.validation import check_is_fitted, validate_data

from ..arguments import in_order
from ..forces import Domain, LearnedBondForce, LearnedEnergy
from ..materials import Law
from .base import NamedFunction, check_targets, checked_columns, columns_read
from .sampling import PERTURBATION
from .sobolev import SobolevRegressor

Range = tuple[float, float]
"""Least and greatest principal stretch."""

REPORTED_STATES = 20_000
REPORT_SEED = 1_000_003
"""Number of states in each set of a report of errors, and their seed, which no training samples
use. Chosen: each bin of strain has a tenth as many states, and 2,000 give the RMS of a bin to two
percent.
"""

ANCHOR = (0.0, 0.0)
"""Features of the undeformed state, in which an energy is zero."""


def is_search(model) -> bool:
    """Return whether an estimator is one of scikit-learn's searches over parameters."""
    return isinstance(model, BaseEstimator) and (
        hasattr(model, "param_grid") or hasattr(model, "param_distributions")
    )


class InputAwareTargetRegressor(MetaEstimatorMixin, RegressorMixin, BaseEstimator):
    """Fit a regressor to ``func(X, y)`` and predict with ``inverse_func(X, ...)``.

    The class is like `sklearn.compose.TransformedTargetRegressor`, but with transformations that
    depend on the inputs, such as a division by a known size of the target. Chosen transformed
    outputs can be made exactly zero at an input, by subtracting the prediction there.

    Parameters
    ----------
    regressor : estimator, default=None
        Any regressor; LinearRegression if None.
    func, inverse_func : callable, default=None
        ``func(X, y)`` and its inverse ``inverse_func(X, z)``; the identity if None. Samples for
        which `func` returns NaN are left out of the training, with a warning. If `func` has names
        of columns (`named`), the columns of tables are reordered by them, and tables with other
        names are refused.
    anchor : array-like, shape (n_features,), default=None
        Input at which the transformed outputs with the numbers `anchored_outputs` are zero.
    anchored_outputs : tuple of int, default=()

    Attributes
    ----------
    regressor_ : estimator
    offsets_ : ndarray, shape (n_outputs,)
        Values subtracted from the predictions of the transformed outputs, so that the anchored ones
        are zero at `anchor`.
    training_inputs_ : ndarray, shape (n_samples, n_features), or None
        Inputs of the training; None after reading from a file.
    n_features_in_ : int

    See Also
    --------
    pdsurrogate.surrogate_pipeline : makes such a regressor for a bond force or an energy.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pipeline = pds.surrogate_pipeline(pds.learning.ChebyshevRegressor(4), features="isochoric")
    >>> isinstance(pipeline, pds.learning.InputAwareTargetRegressor)
    True
    """

    training_inputs_ = None

    def __init__(
        self, regressor=None, func=None, inverse_func=None, anchor=None, anchored_outputs=()
    ):
        self.regressor = regressor
        self.func = func
        self.inverse_func = inverse_func
        self.anchor = anchor
        self.anchored_outputs = anchored_outputs

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        inner = (
            get_tags(self.regressor) if self.regressor is not None else get_tags(LinearRegression())
        )
        tags.target_tags.multi_output = inner.target_tags.multi_output
        tags.regressor_tags.poor_score = True
        return tags

    def fit(self, X, y):
        """Fit the regressor to the transformed target.

        Parameters
        ----------
        X : array-like, shape (n_samples, n_features)
        y : array-like, shape (n_samples,) or (n_samples, n_outputs)

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If the regressor does not take double precision, only one of `func` and `inverse_func`
            is given, the columns of a table have other names than those of `func`, or the
            transformed target is NaN for all samples.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> samples = pds.training_samples(pds.materials.NeoHookean(), n_samples=300)
        >>> pipeline = pds.surrogate_pipeline(
        ...     pds.learning.ChebyshevRegressor(4), features="isochoric"
        ... )
        >>> round(pipeline.fit(samples.X, samples.y).score(samples.X, samples.y), 2)
        1.0
        """
        if (self.func is None) != (self.inverse_func is None):
            raise ValueError("func and inverse_func must be given together, or neither of them")
        for key in ("regressor_", "offsets_", "training_inputs_"):
            vars(self).pop(key, None)  # of an earlier training, which must not outlive a failed one
        columns, targets = columns_read(self.func)
        X, y = validate_data(
            self,
            in_order(X, columns, "X"),
            in_order(y, targets, "y"),
            multi_output=True,
            y_numeric=True,
        )
        regressor = clone(self.regressor) if self.regressor is not None else LinearRegression()
        z = y if self.func is None else np.asarray(self.func(X, y))
        undetermined = np.isnan(z).reshape(len(X), -1).any(axis=1)
        if undetermined.any():
            first = int(undetermined.argmax())
            which = (
                f"{undetermined.sum()} of {len(X)} samples do not determine the transformed target,"
                f" such as sample {first}"
            )
            if undetermined.all():
                raise ValueError(f"{which}, so that no samples are left for training")
            warnings.warn(f"{which}, {X[first]}: they are left out", stacklevel=2)
            X = X[~undetermined]
            z = z[~undetermined]
        try:
            regressor.fit(X, z)
        except RuntimeError as error:
            if "dtype" not in str(error):
                raise
            raise ValueError(
                "the regressor takes numbers of another precision than the samples, which have"
                f" double precision ({error}): give a network of double precision, as"
                " module.double() of torch is"
            ) from None
        offsets = np.zeros(z.shape[1] if z.ndim == 2 else 1)
        if self.anchor is not None:
            at_anchor = np.ravel(
                regressor.predict(np.asarray(self.anchor, dtype=float).reshape(1, -1))
            )
            chosen = list(self.anchored_outputs)
            offsets[chosen] = at_anchor[chosen]
        self.regressor_ = regressor
        self.offsets_ = offsets
        self.training_inputs_ = np.array(X, dtype=float)
        return self

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "offsets_")

    def __getstate__(self):
        # `force_model_of` finds the domain of a model in memory from its inputs; a file has the
        # domain on the card of its artifact.
        return {
            key: value for key, value in super().__getstate__().items() if key != "training_inputs_"
        }

    def predict(self, X):
        """Predict the target.

        Parameters
        ----------
        X : array-like, shape (n_samples, n_features)

        Returns
        -------
        ndarray, shape (n_samples,) or (n_samples, n_outputs)
            As the target in training.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> samples = pds.training_samples(pds.materials.NeoHookean(), n_samples=300)
        >>> pipeline = pds.surrogate_pipeline(
        ...     pds.learning.ChebyshevRegressor(4), features="isochoric"
        ... ).fit(samples.X, samples.y)
        >>> pipeline.predict(samples.X[:3]).shape
        (3, 2)
        """
        check_is_fitted(self)
        X = validate_data(self, in_order(X, columns_read(self.func)[0], "X"), reset=False)
        z = self.regressor_.predict(X)
        z = z - (self.offsets_ if z.ndim == 2 else self.offsets_[0])
        return z if self.inverse_func is None else np.asarray(self.inverse_func(X, z))


@dataclass(frozen=True)
class Samples:
    """Training samples of a surrogate, as `pdsurrogate.training_samples` returns them.

    Parameters
    ----------
    X : ndarray, shape (n, n_columns)
        Inputs: five quantities of a bond (stretch, rotation, length, C33, J), or two invariants of
        a deformation.
    y : ndarray, shape (n, n_outputs)
        Dimensionless targets: the bond force along and across the bond, or the energy and its
        derivatives by the invariants.
    design : dict
        Everything that is needed to draw the samples again.
    target : Target
        Quantity that y holds.
    stretches : ndarray, shape (n, 2) or (n, 3)
        Principal stretches of the states; of a bond off the plane-stress surface those before its
        perturbation.

    See Also
    --------
    pdsurrogate.training_samples : draws samples.
    pdsurrogate.evaluate : measures the errors of a model on new samples.

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
    stretches: np.ndarray

    def __len__(self) -> int:
        return len(self.X)

    def take(self, rows: np.ndarray) -> Samples:
        """Return some of the samples, with the same design and target.

        Parameters
        ----------
        rows : ndarray of int or bool, or slice
            Rows of the samples.

        Returns
        -------
        Samples

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> samples = pds.training_samples(pds.materials.NeoHookean(), n_samples=300)
        >>> len(samples.take(slice(10)))
        10
        """
        return Samples(self.X[rows], self.y[rows], self.design, self.target, self.stretches[rows])


class Target:
    """A quantity that surrogates learn; the instances are `BOND_FORCE`, `SHEET_ENERGY` and
    `ISOCHORIC_ENERGY`.

    The target of a pipeline is recognized by the names of the columns that the pipeline's
    transformation of the target reads. Subclasses and instances define the attributes and methods
    to which this class assigns no value.

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
    reached : callable
        ``reached(law, low, high)``: whether a law is finite in all states of samples whose log
        principal stretches are from low to high.
    draw : callable
        ``draw(law, n_samples, stretch_range, near_rest, random_state)``: samples in the order in
        which they are drawn; a target may take further options of `pdsurrogate.training_samples`.
    pipeline : callable
        ``pipeline(regressor)``: unfitted pipeline; a target may take further options of
        `pdsurrogate.surrogate_pipeline`.
    errors : callable
        ``errors(predicted, samples)``: relative errors (``rms``, ``max``) of predictions, of the
        shape of ``samples.y``.
    domain_of_states : callable
        ``domain_of_states(law, X)``: domain of a surrogate that is fitted to the states X (columns
        `columns`), without a record of how they were drawn.
    surrogate : callable
        ``surrogate(model, law, domain, name, states=None)``: surrogate of a fitted model, and a
        report of its resampling, empty for a surrogate that equals the model; ``states`` are the
        inputs of its training.
    predicted : callable
        ``predicted(model, law, X)``: outputs of a model.
    _more_errors : callable
        ``_more_errors(model, law, samples)``: entries of a report that only this target has, such
        as the least stiffness at the samples.
    _reported : dict
        Options with which `draw` makes the samples of a report.
    """

    name: str
    columns: tuple[str, ...]
    outputs: tuple[str, ...]
    stretch_range: Range
    n_samples: int
    units: str
    weight_function: str
    reached: Callable[[Law, float, float], bool]
    draw: Callable[..., Samples]
    pipeline: Callable[..., InputAwareTargetRegressor]
    errors: Callable[[np.ndarray, Samples], dict[str, float]]
    domain_of_states: Callable[[Law, np.ndarray], Domain]
    surrogate: Callable[..., tuple[LearnedBondForce | LearnedEnergy, dict]]
    predicted: Callable[[Any, Law, np.ndarray], np.ndarray]
    _more_errors: Callable[[Any, Law, Samples], dict]
    _reported: ClassVar[dict[str, float]] = {"near_rest": 0.0}

    def carried_by(self, model) -> bool:
        """Return whether a model, fitted or not, is a pipeline for this target: one whose
        transformation reads the target's columns.
        """
        return (
            isinstance(model, InputAwareTargetRegressor)
            and columns_read(model.func)[0] == self.columns
        )

    def report(
        self,
        model,
        law: Law,
        stretch_range: Range,
        n_samples: int = REPORTED_STATES,
        random_state: int = REPORT_SEED,
    ) -> dict:
        """Return the errors of a model against a law over a range of stretches, in the form that
        `pdsurrogate.evaluate` returns.
        """
        samples = self.draw(
            law, n_samples, stretch_range, random_state=random_state, **self._reported
        )
        # Half of the states lie near the undeformed state, so that there are some in every bin.
        spread = self.draw(
            law,
            max(n_samples, 1000),
            stretch_range,
            random_state=random_state + 1,
            **{**self._reported, "near_rest": 0.5},
        )
        outputs = self.predicted(model, law, spread.X)
        strain = np.abs(spread.stretches - 1).max(axis=1)
        bins = []
        for low, high in strain_bins(*stretch_range):
            if len(rows := np.flatnonzero((low <= strain) & (strain <= high))):
                bins.append(
                    {"strain": [low, high], **self.errors(outputs[rows], spread.take(rows))}
                )
        return {
            "stretch_range": list(stretch_range),
            "n_samples": n_samples,
            "random_state": random_state,
            "on_surface": self.errors(self.predicted(model, law, samples.X), samples),
            "by_strain": bins,
            **self._more_errors(model, law, samples),
        }

    def domain(self, law: Law, samples: Samples) -> Domain:
        """Return the domain in which a surrogate fitted to the samples holds, from the states
        and the design of the samples.
        """
        found = self.domain_of_states(law, samples.X)
        design = samples.design
        bulk = found.least_bulk, found.greatest_bulk
        if design.get("off_surface"):
            # The bounds of the perturbation, which the samples nearly reach.
            reach = np.exp(design.get("perturbation", PERTURBATION)["log_C33"])
            bulk = float(1 / reach), float(reach)
        # The hull of the test data, for an energy without a law.
        hull = (
            None
            if design.get("hull") is None
            else tuple((float(n1), float(n2), float(d)) for n1, n2, d in design["hull"])
        )
        least, greatest = design["stretch_range"]
        rates = design.get("rates")
        return Domain(least, greatest, *bulk, hull, rates and (rates[0], rates[1]))


class EnergyTarget(Target):
    """Energy as a function of two invariants, learned by a network together with its derivatives by
    the invariants.

    Attributes
    ----------
    _surrogate_type : type
        Type of the force model that a fitted network becomes.
    _n_units : int
        Units of the network of a pipeline that is made without a regressor.
    _flat : tuple of int
        Numbers of the features by which the derivative is made zero in the undeformed state, where
        all features are zero.
    _functions : tuple of NamedFunction
        Five functions of a pipeline, which pickles store by their names: features from the
        invariants, names of the features, size of the energy, derivatives by features from
        derivatives by invariants, and derivatives by invariants from derivatives by features.
    _states : callable
        ``_states(law, stretches)``: X and y at given principal stretches, shape (n, 2) or (n, 3).
    _draw_logs : callable
        ``_draw_logs(random, n_samples, low, high, near_rest)``: logarithms of principal stretches,
        uniform within their bounds except for the share `near_rest`, which has small strains.
    _stresses : callable
        ``_stresses(stretches, first, second)``: principal stresses from the derivatives of the
        energy by the two invariants.
    """

    units = "dimensionless; energy in the shear modulus"
    weight_function = "any: the energy learned is that of the material alone"
    _surrogate_type: type[LearnedEnergy]
    _n_units: int
    _flat: tuple[int, ...]
    _functions: tuple[NamedFunction, ...]
    _states: Callable[[Law, np.ndarray], tuple[np.ndarray, np.ndarray]]
    _draw_logs: Callable[[np.random.Generator, int, float, float, float], np.ndarray]
    _stresses: Callable[..., np.ndarray]

    def draw(
        self, law: Law, n_samples: int, stretch_range: Range, near_rest: float, random_state: int
    ) -> Samples:
        low, high = stretch_range
        stretches = np.exp(
            self._draw_logs(np.random.default_rng(random_state), n_samples, low, high, near_rest)
        )
        design = {
            "name": self.name,
            "n_samples": n_samples,
            "stretch_range": [low, high],
            "near_rest": near_rest,
            "random_state": random_state,
        }
        return Samples(*self._states(law, stretches), design, self, stretches)

    def pipeline(self, regressor: SobolevRegressor | None) -> InputAwareTargetRegressor:
        if regressor is not None and not isinstance(regressor, SobolevRegressor):
            raise ValueError(
                "an energy is fitted with its derivatives: give a SobolevRegressor, not a"
                f" {type(regressor).__name__}"
            )
        inner = (
            SobolevRegressor(self._n_units, random_state=0)
            if regressor is None
            else clone(regressor)
        )
        features, names, size, *targets = self._functions
        inner.set_params(anchor=ANCHOR, flat=self._flat, size=size)
        transformer = FunctionTransformer(features, feature_names_out=names, check_inverse=False)
        return InputAwareTargetRegressor(
            Pipeline([("features", transformer), ("regressor", inner)]), *targets
        )

    def _network_of(self, model) -> SobolevRegressor:
        """Return the network of a pipeline; raise ValueError unless the pipeline has the
        features, `anchor` and `flat` of this target.
        """
        pipeline: Any = getattr(model, "regressor_", getattr(model, "regressor", None))
        network: Any = (
            pipeline[-1] if self.carried_by(model) and isinstance(pipeline, Pipeline) else None
        )
        right = (
            isinstance(network, SobolevRegressor)
            and getattr(pipeline[0], "func", None) is self._functions[0]
        )
        if not right or (network.anchor, network.flat) != (ANCHOR, self._flat):
            raise ValueError(
                f"only a surrogate_pipeline for the target {self.name}, which ends in a"
                f" SobolevRegressor with anchor {ANCHOR} and flat {self._flat}, can become a"
                " surrogate of it"
            )
        return network

    def surrogate(
        self, model, law: Law, domain: Domain, name: str, states: np.ndarray | None = None
    ) -> tuple[LearnedEnergy, dict]:
        network = self._network_of(model)
        check_is_fitted(model)
        arrays = (
            np.ascontiguousarray(network.hidden_weights_),
            network.hidden_biases_.copy(),
            network.output_weights_.copy(),
        )
        return (
            self._surrogate_type(
                name,
                network.activation,
                *arrays,
                domain,
                law.name,
                self._surrogate_type.shape_of(law),
            ),
            {},
        )

    def errors(self, predicted: np.ndarray, samples: Samples) -> dict[str, float]:
        """Return the relative errors of stress (``rms``, ``max``) and energy (``energy_rms``)."""
        stresses = (
            self._stresses(samples.stretches, *values.T[1:]) for values in (predicted, samples.y)
        )
        return {
            **relative_errors(*stresses),
            "energy_rms": relative_errors(predicted[:, :1], samples.y[:, :1])["rms"],
        }


def checked_derivatives(
    X, y, columns: tuple[str, str], outputs: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Return X and y transposed; raise ValueError unless they have these `columns` and
    `outputs`, and all invariants X are positive.
    """
    check_targets(y, outputs)
    return checked_columns(X, columns, columns[::-1]), y.T


def relative_errors(predicted: np.ndarray, exact: np.ndarray) -> dict[str, float]:
    """Return the RMS (``rms``) and greatest (``max``) error of predicted vectors, shape (n, d),
    divided by the RMS of the exact ones.
    """
    error = np.linalg.norm(predicted - exact, axis=1)
    size = np.sqrt((exact**2).sum(axis=1).mean())
    return {"rms": float(np.sqrt((error**2).mean()) / size), "max": float(error.max() / size)}


def strain_bins(low: float, high: float) -> list[tuple[float, float]]:
    """Return bins (least, greatest) of the greatest absolute principal strain, up to the greater
    of high - 1 and 1 - low.
    """
    reach = max(high - 1, 1 - low)
    return [
        (least, min(greatest, reach))
        for least, greatest in pairwise((0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 3.0))
        if least < reach * (1 - 1e-9)
    ]
