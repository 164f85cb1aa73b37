"""Learning of the bond force of a sheet: training samples, pipeline, errors, domain of validity,
and conversion to a surrogate.
"""

from collections.abc import Callable
from typing import ClassVar

import numpy as np

from ..arguments import check_seed, check_whole_number
from ..forces import AnalyticBondForce, Domain
from ..forces.agreement import WIDEST
from ..kernels.weights import WEIGHT_FUNCTIONS
from ..materials import Law
from ..materials.law import check_number, checked_law
from . import sampling
from .export import force_of, taken_over
from .pipeline import bond_force_pipeline
from .sampling import COLUMNS, OUTPUTS, checked_range
from .target import Range, Samples, Target, relative_errors

SLOPE_STEP = 1e-4
"""Relative change of the bond stretch in central differences of the force: in double precision
their error is 1e-8 of the slope.
"""

LENGTHS = 2
ORIENTATIONS = 5
"""Bond lengths for each deformation gradient of Algorithm 1, and orientations for each length:
enough for both to be spread, and few enough for a thousand gradients among 10,000 samples.
"""


class _BondForce(Target):
    name = "bond-force"
    columns = COLUMNS
    outputs = OUTPUTS
    stretch_range = WIDEST
    n_samples = 8_000
    units = "dimensionless; rotation in radians; length in horizons; force in w l mu / kappa"
    weight_function = (
        "any: the force learned is dimensionless, t kappa / (w l mu); known are "
        + ", ".join(WEIGHT_FUNCTIONS)
    )

    _reported: ClassVar = {"near_rest": 0.25, "off_surface": 0.0}
    reached = staticmethod(sampling.bond_states_reached)
    pipeline = staticmethod(bond_force_pipeline)
    surrogate = staticmethod(taken_over)

    def draw(
        self,
        law: Law,
        n_samples: int,
        stretch_range: Range,
        near_rest: float,
        random_state: int,
        off_surface: float = 2 / 3,
    ) -> Samples:
        X, y, design, stretches = sampling.wide_bonds(
            law, n_samples, stretch_range, near_rest, off_surface, random_state
        )
        return Samples(X, y, design, self, stretches)

    def predicted(self, model, law: Law, X: np.ndarray) -> np.ndarray:
        return force_of(model)(*X.T)

    def errors(self, predicted: np.ndarray, samples: Samples) -> dict[str, float]:
        return relative_errors(predicted, samples.y)

    def domain_of_states(self, law: Law, X: np.ndarray) -> Domain:
        stretch, rotation, J, C33 = (
            X[:, COLUMNS.index(name)] for name in ("stretch", "rotation", "J", "C33")
        )
        # Components of the stretch tensor U, which stretch and rotation of a bond and the area
        # ratio define.
        U_nn = stretch * np.cos(rotation)
        U_nm = stretch * np.sin(rotation)
        low, high = sampling.range_of_stretches(
            U_nn**2 + 2 * U_nm**2 + ((J + U_nm**2) / U_nn) ** 2, J
        )
        bulk = J**2 * C33
        return Domain(low, high, float(bulk.min()), float(bulk.max()))

    def _more_errors(self, model, law: Law, samples: Samples) -> dict[str, object]:
        force = force_of(model)
        design = samples.design
        off = self.draw(
            law,
            len(samples),
            tuple(design["stretch_range"]),
            0,
            design["random_state"] + 1,
            off_surface=1,
        )
        states = np.vstack([samples.X, off.X])
        return {
            "off_surface": self.errors(force(*off.X.T), off),
            "at_rest": float(np.linalg.norm(force([1.0], [0.0], [1.0], [1.0], [1.0]))),
            "least_slope": float(stiffness_slopes(force, states).min()),
            "least_slope_exact": float(
                stiffness_slopes(AnalyticBondForce(law).bond_force, states).min()
            ),
        }


BOND_FORCE = _BondForce()
"""Target: the dimensionless bond force along and across a bond, as a function of stretch,
rotation, length, C33 and J of the bond.
"""


def algorithm_1(
    law: Law,
    n_samples: int = 10_000,
    stretch_range: tuple[float, float] = (0.8, 4.0),
    horizon: float = 1.0,
    weight: str = "inverse",
    nondimensional: bool = True,
    random_state: int = 0,
) -> Samples:
    """Draw samples of bond forces by the paper's Algorithm 1: loops over principal stretches, bond
    lengths and bond orientations.

    The paper loops over "various" values. Here lengths and orientations are drawn uniformly from
    their ranges, and stretches uniformly in the logarithm. On a full grid of values a network can
    be exact at the few stretches of the grid and wrong by percents between them. With stretches
    drawn uniformly, only two in a thousand pairs would have both stretches near their least value,
    where C33 is greatest, and the error of a network would be ten times as large there as
    elsewhere.

    Parameters
    ----------
    law : Law
    n_samples : int
        Number of samples, rounded to whole pairs of stretches: ten samples have the same pair.
    stretch_range : tuple of float
        Least and greatest principal stretch.
    horizon : float
        Horizon delta; lengths are in (0, delta].
    weight : str
        Weight function.
    nondimensional : bool
        Whether lengths are divided by the horizon, and forces t by w l mu/kappa, with the weight w
        and length l of the bond, the shear modulus mu, and the shape tensor kappa I of a full
        circular horizon. Otherwise lengths have the unit of `horizon`, and forces are those of Eq.
        (2) of the paper on such a horizon, in the unit of the shear modulus divided by a length
        cubed.
    random_state : int
        Seed.

    Returns
    -------
    Samples

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> samples = pds.learning.algorithm_1(
    ...     pds.materials.NeoHookean(), n_samples=200, random_state=0
    ... )
    >>> samples.X.shape
    (200, 5)
    """
    checked_law(law)
    check_whole_number(n_samples, "n_samples", 1)
    check_seed(random_state)
    check_number(horizon, "horizon")
    if not 0 < horizon < np.inf:
        raise ValueError(f"horizon must be positive and finite, not {horizon}")
    if weight not in WEIGHT_FUNCTIONS:
        raise ValueError(f"unknown weight {weight!r}; there are {', '.join(WEIGHT_FUNCTIONS)}")
    low, high = checked_range(stretch_range)
    random = np.random.default_rng(random_state)
    pairs = max(1, round(n_samples / (LENGTHS * ORIENTATIONS)))
    stretches = np.repeat(
        np.exp(sampling.log_stretches(random, pairs, low, high, near_rest=0.0)),
        LENGTHS * ORIENTATIONS,
        axis=0,
    )
    length = np.repeat(horizon * (1 - random.uniform(0, 1, pairs * LENGTHS)), ORIENTATIONS)
    angle = 2 * np.pi * (1 - random.uniform(0, 1, len(length)))
    U_nn, U_nm, J, C33 = sampling.on_surface(law, stretches[:, 0], stretches[:, 1], angle)
    X, y = sampling.force_on_bonds(law, U_nn, U_nm, J, C33, length)
    if nondimensional:
        X[:, 2] /= horizon
    else:
        y *= sampling.force_factor(length, horizon, weight, law.shear_modulus)[:, None]
    design = {
        "name": "algorithm 1",
        "n_samples": len(X),
        "stretch_range": [low, high],
        "horizon": horizon,
        "weight": weight,
        "nondimensional": nondimensional,
        "random_state": random_state,
    }
    return Samples(X, y, design, BOND_FORCE, stretches)


def stiffness_slopes(force: Callable, states: np.ndarray) -> np.ndarray:
    """Return d t_n / d lambda_b, shape (n,): the derivatives of the force along the bond by the
    bond stretch, at fixed other quantities.

    ``force(stretch, rotation, length, C33, J)`` returns the components (t_n, t_tau), shape (n, 2);
    `states`, shape (n, 5), has the columns `COLUMNS`.
    """
    stretch = states[:, 0]
    low, high = (
        force(stretch * (1 + sign * SLOPE_STEP), *states[:, 1:].T)[:, 0] for sign in (-1, 1)
    )
    return (high - low) / (2 * SLOPE_STEP * stretch)
