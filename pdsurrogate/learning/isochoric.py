"""Learning of the isochoric energy W(I1bar, I2bar): samples at three stretches of product 1,
features and measures of stability.
"""

from functools import partial
from itertools import product

import numpy as np

from ..forces import Domain, IsochoricNetwork
from ..forces.agreement import isochoric_slopes, isochoric_stresses
from ..forces.learned_energy import ISOCHORIC_FEATURES
from ..materials import Law, solid
from .base import checked_columns, named
from .target import EnergyTarget, Samples, checked_derivatives

INVARIANTS = ("I1bar", "I2bar")
DERIVATIVES = ("W", "dW/dI1bar", "dW/dI2bar")

STATES_OF_STABILITY = 1000
DIRECTIONS = 24
STEP = 1e-4
"""Numbers of states and of pairs of directions at which the stiffness against shear waves is
evaluated, and the shear of its central differences, whose error is 1e-8 of the stiffness in double
precision. Chosen: 24,000 samples of a smooth function of few variables; with fewer the least value
may lie between them.
"""


@named()
def log_isochoric_invariants(X) -> np.ndarray:
    """Return the features log(I1bar/3) and log(I2bar/3), shape (n, 2), of the invariants I1bar
    and I2bar, the columns of X.
    """
    return np.log(np.column_stack(checked_columns(X, INVARIANTS, INVARIANTS[::-1])) / 3)


@named()
def isochoric_energy_size(features) -> np.ndarray:
    """Return (I1bar + I2bar)/6, shape (n,), from the features log(I1bar/3) and log(I2bar/3): the
    size of the energy of rubber.

    The training divides residuals by this size.
    """
    return np.exp(features).mean(axis=1)


@named(INVARIANTS, DERIVATIVES)
def isochoric_derivatives_by_features(X, y) -> np.ndarray:
    """Return W and its derivatives by log(I1bar/3) and log(I2bar/3), shape (n, 3), from W and
    its derivatives by I1bar and I2bar in y.
    """
    (I1, I2), (W, by_1, by_2) = checked_derivatives(X, y, INVARIANTS, DERIVATIVES)
    return np.column_stack([W, I1 * by_1, I2 * by_2])


@named()
def isochoric_derivatives_by_invariants(X, z) -> np.ndarray:
    """Return W and its derivatives by I1bar and I2bar, shape (n, 3), from W and its derivatives
    by log(I1bar/3) and log(I2bar/3) in z.
    """
    I1, I2 = checked_columns(X, INVARIANTS, INVARIANTS[::-1])
    return np.column_stack([z[:, 0], z[:, 1] / I1, z[:, 2] / I2])


@named()
def isochoric_feature_names(transformer, input_features):
    """Return the names of the features of the isochoric energy, in the form that scikit-learn's
    transformers require.
    """
    return np.asarray(ISOCHORIC_FEATURES, dtype=object)


class _IsochoricEnergy(EnergyTarget):
    name = "isochoric-energy"
    columns = INVARIANTS
    outputs = DERIVATIVES
    stretch_range = (0.25, 4.0)
    n_samples = 1_000
    _surrogate_type = IsochoricNetwork
    _n_units = 8
    _flat = ()
    _functions = (
        log_isochoric_invariants,
        isochoric_feature_names,
        isochoric_energy_size,
        isochoric_derivatives_by_features,
        isochoric_derivatives_by_invariants,
    )

    def reached(self, law: Law, low: float, high: float) -> bool:
        # The corners of the box of stretches decide.
        corners = [(a, b, -a - b) for a, b in product((low, high, -low / 2, -high / 2), repeat=2)]
        squares = np.exp(
            2
            * np.array(
                [corner for corner in corners if low <= min(corner) and max(corner) <= high]
            ).T
        )
        with np.errstate(all="ignore"):
            found = solid.isochoric_response(
                law, squares.sum(axis=0), (1 / squares).sum(axis=0), np.ones(squares.shape[1])
            )
        return bool(np.isfinite(found).all())

    def _states(self, law: Law, stretches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        squares = stretches**2
        I1 = squares.sum(axis=1)
        I2 = (1 / squares).sum(axis=1)
        W = solid.isochoric_response(law, I1, I2, np.ones_like(I1))[3]
        return np.column_stack([I1, I2]), np.column_stack([W, *isochoric_slopes(law, I1, I2)])

    def _draw_logs(
        self, random: np.random.Generator, n_samples: int, low: float, high: float, near_rest: float
    ) -> np.ndarray:
        low = np.log(low)
        high = np.log(high)
        found = np.empty((0, 3))
        while len(found) < n_samples:
            logs = random.uniform(low, high, (4 * n_samples, 2))
            third = -logs.sum(axis=1, keepdims=True)
            found = np.concatenate(
                [found, np.hstack([logs, third])[((third >= low) & (third <= high))[:, 0]]]
            )
        logs = found[:n_samples]
        n_near = int(near_rest * n_samples)
        direction = random.standard_normal((n_near, 3))
        direction -= direction.mean(axis=1, keepdims=True)
        # Strains from 0.1 % to 30 %, uniform in their logarithm, and within the bounds.
        size = np.exp(random.uniform(np.log(1e-3), np.log(0.3), n_near)) / np.linalg.norm(
            direction, axis=1
        )
        most = np.minimum(low / direction.min(axis=1), high / direction.max(axis=1))
        logs[:n_near] = np.minimum(size, most)[:, None] * direction
        return logs

    def _stresses(self, stretches: np.ndarray, first, second) -> np.ndarray:
        return isochoric_stresses(stretches.T**2, first, second)

    def predicted(self, model: IsochoricNetwork, law: Law, X: np.ndarray) -> np.ndarray:
        return np.column_stack(model.isochoric_derivatives(*X.T))

    def _more_errors(self, model: IsochoricNetwork, law: Law, samples: Samples) -> dict[str, float]:
        rest = self.predicted(model, law, np.array([[3.0, 3.0]]))[0]
        squares = samples.stretches[:STATES_OF_STABILITY].T ** 2
        return {
            "at_rest": float(abs(rest[0])),
            "shear_modulus": float(2 * (rest[1] + rest[2])),
            "least_acoustic": _least_acoustic(
                lambda I1, I2: model.isochoric_derivatives(I1, I2)[1:], squares
            ),
            "least_acoustic_exact": _least_acoustic(partial(isochoric_slopes, law), squares),
        }

    def domain_of_states(self, law: Law, X: np.ndarray) -> Domain:
        squares = solid.response.stretches((*X.T, np.ones(len(X))))[3:]
        return Domain(float(np.sqrt(np.min(squares))), float(np.sqrt(np.max(squares))), 1.0, 1.0)


ISOCHORIC_ENERGY = _IsochoricEnergy()
"""Target: the isochoric energy W of a law (its energy apart from that of the volume change), as
a function of I1bar and I2bar.
"""


def _least_acoustic(derivatives, squares) -> float:
    """Return the least second derivative of W, divided by |F a|^2, along changes F (a (x) n) of F
    with perpendicular unit vectors a and n.

    F (a (x) n) is the rank-one change (F a) (x) n; the division accounts for the length of F a. All
    rank-one changes that keep the volume have this form, so that shear waves are stable if the
    value is positive. ``derivatives(I1, I2)`` returns the derivatives of W by both invariants;
    `squares`, shape (3, n), are the squares of the principal stretches of the states F. The minimum
    is over all states and over `DIRECTIONS` random pairs a, n.
    """
    random = np.random.default_rng(0)
    least = np.inf
    for _ in range(DIRECTIONS):
        a, n, _ = np.linalg.qr(random.standard_normal((3, 3)))[0]
        a2 = a * a
        n2 = n * n
        an = a * n
        moved = a2 @ squares

        def slope(t, an=an, n2=n2, moved=moved):
            # The derivative by t at F (I + t a (x) n), with the principal stretches of F.
            I1 = squares.sum(axis=0) + 2 * t * (an @ squares) + t * t * moved
            I2 = (
                (1 / squares).sum(axis=0)
                - 2 * t * (an @ (1 / squares))
                + t * t * (n2 @ (1 / squares))
            )
            by_1, by_2 = derivatives(I1, I2)
            return by_1 * 2 * (an @ squares + t * moved) + by_2 * 2 * (
                t * (n2 @ (1 / squares)) - an @ (1 / squares)
            )

        least = min(least, float(((slope(STEP) - slope(-STEP)) / (2 * STEP) / moved).min()))
    return least
