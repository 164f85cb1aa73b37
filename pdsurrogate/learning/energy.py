"""Learning of the energy of a sheet under plane stress: invariants, features, training samples
and measures of material stability.
"""

import numpy as np

from ..forces import BondEnergyForce, Domain, EnergyNetwork
from ..forces.bond_energy import EnergySurrogate
from ..forces.learned_energy import ENERGY_FEATURES
from ..materials import Law, plane_stress
from .base import checked_columns, named
from .sampling import bond_states_reached, log_stretches, range_of_stretches
from .target import EnergyTarget, Samples, checked_derivatives

INVARIANTS = ("tr C", "J")
DERIVATIVES = ("psi", "dpsi/dtr C", "dpsi/dJ")


@named()
def log_invariants(X) -> np.ndarray:
    """Return the features log J and log(tr C/(2 J)), shape (n, 2), of the invariants tr C and J,
    the columns of X.
    """
    trace, J = checked_columns(X, INVARIANTS, INVARIANTS[::-1])
    return np.column_stack([np.log(J), np.log(trace / (2 * J))])


@named()
def rubber_energy_size(features) -> np.ndarray:
    """Return (tr C + J^-2)/2, shape (n,), from the features that `log_invariants` returns: the size
    of the energy of rubber.

    The training divides residuals by this size.
    """
    x, u = features.T
    return np.exp(x + u) + np.exp(-2 * x) / 2


@named(INVARIANTS, DERIVATIVES)
def derivatives_by_features(X, y) -> np.ndarray:
    """Return the energy and its derivatives by log J and log(tr C/(2 J)), shape (n, 3).

    X holds tr C and J, and y the energy and its derivatives by tr C and J.
    """
    (trace, J), (energy, by_trace, by_J) = checked_derivatives(X, y, INVARIANTS, DERIVATIVES)
    by_ratio = trace * by_trace
    return np.column_stack([energy, J * by_J + by_ratio, by_ratio])


@named()
def derivatives_by_invariants(X, z) -> np.ndarray:
    """Return the energy and its derivatives by tr C and J, shape (n, 3), from energy and
    derivatives by log J and log(tr C/(2 J)) in z.
    """
    trace, J = checked_columns(X, INVARIANTS, INVARIANTS[::-1])
    return np.column_stack([z[:, 0], z[:, 2] / trace, (z[:, 1] - z[:, 2]) / J])


@named()
def _names(transformer, input_features):
    return np.asarray(ENERGY_FEATURES, dtype=object)


class _SheetEnergy(EnergyTarget):
    name = "sheet-energy"
    columns = INVARIANTS
    outputs = DERIVATIVES
    stretch_range = (0.5, 5.0)
    n_samples = 2_000
    _surrogate_type = EnergyNetwork
    _n_units = 12
    _flat = (0,)
    _functions = (
        log_invariants,
        _names,
        rubber_energy_size,
        derivatives_by_features,
        derivatives_by_invariants,
    )
    reached = staticmethod(bond_states_reached)
    _draw_logs = staticmethod(log_stretches)

    def _states(self, law: Law, stretches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        trace = (stretches**2).sum(axis=1)
        J = stretches.prod(axis=1)
        J3 = plane_stress.volume_ratio(law, trace, J)
        p, q, _, _, energy = plane_stress.response(law, trace, J, J3)
        return np.column_stack([trace, J]), np.column_stack([energy, p / 2, q / J])

    def _stresses(self, stretches: np.ndarray, first, second) -> np.ndarray:
        # Principal nominal stresses 2 psi_I lambda + psi_J J/lambda.
        return 2 * first[:, None] * stretches + second[:, None] * stretches[:, ::-1]

    def predicted(self, model: EnergySurrogate, law: Law, X: np.ndarray) -> np.ndarray:
        return np.column_stack(model.energy_derivatives(law, *X.T)[:3])

    def _more_errors(self, model: EnergySurrogate, law: Law, samples: Samples) -> dict[str, float]:
        rest = model.energy_derivatives(law, np.array([2.0]), np.array([1.0]))
        acoustic, curvature = _stability(model.energy_derivatives(law, *samples.X.T), samples)
        exact_acoustic, exact_curvature = _stability(
            BondEnergyForce().energy_derivatives(law, *samples.X.T), samples
        )
        return {
            "at_rest": float(max(abs(rest.psi[0]), abs(2 * rest.by_trace[0] + rest.by_area[0]))),
            "least_acoustic": acoustic,
            "least_acoustic_exact": exact_acoustic,
            "least_curvature": curvature,
            "least_curvature_exact": exact_curvature,
        }

    def domain_of_states(self, law: Law, X: np.ndarray) -> Domain:
        bulk = plane_stress.volume_ratio(law, *X.T) ** 2  # J3^2 = J^2 C33
        return Domain(*range_of_stretches(*X.T), float(bulk.min()), float(bulk.max()))


SHEET_ENERGY = _SheetEnergy()
"""Target: the energy of a sheet under plane stress, as a function of tr C and J in the plane;
C33 follows from zero stress across it.
"""


def _stability(energy, samples) -> tuple[float, float]:
    """Return two measures of the stability of a sheet, each the least value over all samples.

    The first is the second derivative of the energy along rank-one changes m (x) n of F with unit
    vectors m and n; the second is the lesser eigenvalue of the matrix of second derivatives of the
    energy by the logarithms of the two principal stretches. `energy` holds the first and second
    derivatives of the energy by tr C and J at the samples.
    """
    first, second = samples.stretches.T
    m, n = (angles.reshape(-1, 1) for angles in np.meshgrid(*2 * [np.arange(0, np.pi, np.pi / 12)]))
    # F is diagonal here: m . F n and cof F : m (x) n.
    along, cofactor = (
        a * np.cos(m) * np.cos(n) + b * np.sin(m) * np.sin(n)
        for a, b in ((first, second), (second, first))
    )
    acoustic = 2 * energy.by_trace + 4 * energy.by_trace_trace * along**2
    acoustic += 4 * energy.by_trace_area * along * cofactor + energy.by_area_area * cofactor**2
    a = 2 * first**2
    b = 2 * second**2
    J = first * second

    def second_derivative(s, t):
        return (
            energy.by_trace_trace * s * t
            + energy.by_trace_area * J * (s + t)
            + energy.by_area_area * J * J
            + energy.by_area * J
        )

    aa, bb = (second_derivative(s, s) + 2 * (energy.by_trace * s) for s in (a, b))
    ab = second_derivative(a, b)
    curvature = (aa + bb) / 2 - np.sqrt(((aa - bb) / 2) ** 2 + ab**2)
    return float(acoustic.min()), float(curvature.min())
