"""Learned energies: networks of two invariants, stored as plain arrays, for a sheet under plane
stress or for the isochoric part.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ..engine.compile import block_function_of, isochoric_energy_signature
from ..kernels import isochoric_energy as kernel
from ..kernels.domain import distance_coefficients
from ..kernels.energy_density import (
    ENERGY_ROWS,
    N_CONSTANTS,
    NETWORK_WORK_ROWS,
    network_energy_density,
    pack_network,
)
from ..kernels.network import ACTIVATIONS, GROUP, SMOOTH, pack_units
from ..materials import PLANES, Law
from .agreement import invariant_states, isochoric_states, isochoric_stresses
from .bond_energy import EnergyModel, EnergySurrogate, IsochoricEnergy
from .compiled_force import CompiledBondForce
from .domain import Domain
from .learned import CHUNK, Learned, check_shape
from .pair_passes import EnergyDerivatives

ENERGY_FEATURES = ("log J", "log(tr C/(2 J))")
"""Features of an energy network: the logarithms of the area ratio and of
cosh(log(lambda_1/lambda_2)); both vanish without deformation.
"""

ISOCHORIC_FEATURES = ("log(I1bar/3)", "log(I2bar/3)")
"""Features of a network of the isochoric energy. At small strains both are quadratic in the strains
and nearly equal. An energy that is given by principal stretches is a smooth function of these
features there too, as every smooth symmetric function of three logarithms with sum zero is a smooth
function of their second and third elementary symmetric functions.
"""


def energy_shape(law: Law) -> dict[str, float]:
    """Return the dimensionless parameters, by name, that the plane-stress energy of a law depends
    on.

    They include the ratio of bulk and shear modulus, which determines the thickness under plane
    stress.
    """
    return {**law.shape, "bulk_modulus/shear_modulus": law.bulk_modulus / law.shear_modulus}


@dataclass(frozen=True, repr=False)
class LearnedEnergy(Learned, EnergyModel):
    """Base class of learned energies: a network of one hidden layer that maps two invariants to an
    energy.

    Parameters
    ----------
    name : str
    activation : str
        One of `pdsurrogate.kernels.network.SMOOTH`.
    hidden_weights : ndarray, shape (2, n)
    hidden_biases, output_weights : ndarray, shape (n,)
        Biases and output weights, for unscaled features.
    domain : Domain
        Bounds of the principal stretches in training; its bounds of J3^2 are recorded, but not
        checked in a run.
    law : str
        Name of the law that it describes.
    shape : mapping
        Dimensionless parameters of the law that its energy depends on.
    stated : mapping, optional
        Relative errors of the stress, ``rms`` and ``max``, that its card (the metadata of its
        artifact) states, and ``bulk_ratio``, K/mu of the training states; None without a card.
    covariance : LawCovariance, optional
        Covariance of its law, if this was fitted to measurements that determine it.
    """

    name: str
    activation: str
    hidden_weights: np.ndarray
    hidden_biases: np.ndarray
    output_weights: np.ndarray
    domain: Domain
    law: str
    shape: Mapping[str, float]

    names: ClassVar[Mapping[str, Collection[str]]] = {"activation": SMOOTH}
    arrays: ClassVar[tuple[str, ...]] = ("hidden_weights", "hidden_biases", "output_weights")
    exact: ClassVar[str] = "bond-energy"
    feature_set: ClassVar[str]
    features: ClassVar[tuple[str, ...]]

    @property
    def size(self) -> str:
        return f"{self.output_weights.size} units"

    def check_arrays(self) -> None:
        units = self.output_weights.shape
        if len(units) != 1 or units == (0,):
            raise ValueError(f"output_weights has shape {units}, not that of a vector")
        check_shape(self.hidden_biases, "hidden_biases", units)
        check_shape(self.hidden_weights, "hidden_weights", (2, *units))

    @property
    def at_rest(self) -> tuple[float, float]:
        """Output of the network in the undeformed state, and its derivative by the first feature
        there.

        They are subtracted from a model's energy, so that energy and stress of the undeformed state
        are zero; an isochoric energy, whose stress is zero there in any case, subtracts the first
        alone.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> value, slope = pds.load_surrogate("neo-hookean-energy").at_rest
        >>> round(value, 3), round(slope, 3)
        (-31.53, -0.893)
        """
        value, slope, *_ = self._sums(np.zeros(()), np.zeros(()))
        return float(value), float(slope)

    def _sums(self, first: np.ndarray, second: np.ndarray) -> list[np.ndarray]:
        """Return the output of the network at values of both features, its first derivatives by
        them, and its second ones.

        The sums are written out, since in matrix products the order of summation would depend on
        the number of states.
        """
        w1, w2 = self.hidden_weights
        v = self.output_weights
        value, slope, curvature = ACTIVATIONS[self.activation](
            first[..., None] * w1 + second[..., None] * w2 + self.hidden_biases
        )
        slope = slope * v
        curvature = curvature * v
        terms = value * v, slope * w1, slope * w2
        return [
            term.sum(axis=-1)
            for term in (*terms, curvature * w1 * w1, curvature * w1 * w2, curvature * w2 * w2)
        ]


@dataclass(frozen=True, repr=False)
class EnergyNetwork(LearnedEnergy, EnergySurrogate):
    """Learned energy psi(tr C, J) of a sheet under plane stress: a network.

    Energy and stress of the undeformed sheet vanish by construction. The features are
    `ENERGY_FEATURES`.

    Parameters
    ----------
    name : str
        Name of the model.
    activation : str
        One of `pdsurrogate.kernels.network.SMOOTH`.
    hidden_weights : ndarray, shape (2, n)
        Weights of the hidden layer, for unscaled features.
    hidden_biases, output_weights : ndarray, shape (n,)
        Biases of the hidden layer, and weights of the output.
    domain : Domain
        Bounds of the principal stretches in training; its bounds of J3^2 are recorded, but not
        checked in a run.
    law : str
        Name of the law that it describes.
    shape : mapping
        Dimensionless parameters of the law that its energy depends on, as `shape_of` returns them.
    stated : mapping, optional
        Relative errors of the stress, ``rms`` and ``max``, that its card (the metadata of its
        artifact) states, and ``bulk_ratio``, K/mu of the training states; None without a card.
    covariance : LawCovariance, optional
        Covariance of its law, if this was fitted to measurements that determine it.

    See Also
    --------
    pdsurrogate.load_surrogate : loads a stored model.
    pdsurrogate.BondEnergyForce : exact energy of any law.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.load_surrogate("neo-hookean-energy")
    >>> model
    <EnergyNetwork neo-hookean-energy@1 of neo-hookean>
    """

    kind: ClassVar[str] = "energy-network"
    trial = staticmethod(invariant_states)
    shape_of = staticmethod(energy_shape)
    default_precision = "float32"
    feature_set: ClassVar[str] = "invariants"
    features: ClassVar[tuple[str, ...]] = ENERGY_FEATURES

    def energy_derivatives(self, law: Law, trace, area_ratio) -> EnergyDerivatives:
        trace, J = (np.asarray(value, dtype=float) for value in (trace, area_ratio))
        rows = np.empty((6, J.size))
        for at in range(0, J.size, CHUNK):
            rows[:, at : at + CHUNK] = self._derivatives(trace[at : at + CHUNK], J[at : at + CHUNK])
        return EnergyDerivatives(*rows)

    def _derivatives(self, trace, J):
        constant, flat = self.at_rest
        x = np.log(J)
        value, by_x, by_u, xx, xu, uu = self._sums(x, np.log(trace / (2 * J)))
        by_x = by_x - flat
        psi = value - constant - flat * x
        return (
            psi,
            by_u / trace,
            (by_x - by_u) / J,
            (uu - by_u) / trace**2,
            (xu - uu) / (trace * J),
            (xx - 2 * xu + uu - by_x + by_u) / J**2,
        )

    def compiled(self, dtype) -> CompiledBondForce:
        sizes, weights = pack_network(
            self.hidden_weights, self.hidden_biases, self.output_weights, dtype
        )
        found = CompiledBondForce(
            network_energy_density(ACTIVATIONS[self.activation], dtype).address,
            sizes,
            weights,
            NETWORK_WORK_ROWS,
        )
        # Energy and stress at rest are exactly zero in the kernel's precision: its own rest values
        # are subtracted.
        energy, by_trace, by_area = found.evaluate(np.array([[2.0], [1.0]]), ENERGY_ROWS)[
            :, 0
        ].astype(dtype)
        # 2 psi_I + psi_J = dpsi/dlog J at rest, of which psi_I is half of dpsi/dlog(tr C/(2 J)).
        slope = by_area + 2 * by_trace
        found.weights[-N_CONSTANTS:] = energy, slope
        return found

    def answer(self, *states: np.ndarray) -> np.ndarray:
        trace, J, first, second = states
        _, by_trace, by_J, *_ = self._derivatives(trace, J)
        return np.stack(
            [2 * by_trace * first + by_J * second, 2 * by_trace * second + by_J * first], axis=1
        )


@dataclass(frozen=True, repr=False)
class IsochoricNetwork(LearnedEnergy):
    """Learned isochoric energy W(I1bar, I2bar), a network, for plane strain and three dimensions.

    It serves every bulk modulus, since the volumetric energy U(J) comes from the law. The features
    are `ISOCHORIC_FEATURES`. The energy of an undeformed body vanishes by construction; its stress
    vanishes for every function of these invariants.

    Parameters
    ----------
    name : str
        Name of the model.
    activation : str
        One of `pdsurrogate.kernels.network.SMOOTH`.
    hidden_weights : ndarray, shape (2, n)
        Weights of the hidden layer, for unscaled features.
    hidden_biases, output_weights : ndarray, shape (n,)
        Biases of the hidden layer, and weights of the output.
    domain : Domain
        Bounds of the isochoric principal stretches in training; its bounds of J3^2 are recorded,
        but not checked in a run.
    law : str
        Name of the law that it describes.
    shape : mapping
        Dimensionless parameters of the law.
    stated : mapping, optional
        Relative errors of the stress, ``rms`` and ``max``, that its card (the metadata of its
        artifact) states, and ``bulk_ratio``, K/mu of the training states; None without a card.
    covariance : LawCovariance, optional
        Covariance of its law, if this was fitted to measurements that determine it.

    See Also
    --------
    pdsurrogate.load_surrogate : loads a stored model.
    pdsurrogate.BondEnergyForce : exact energy of any law.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.load_surrogate("neo-hookean-isochoric")
    >>> model
    <IsochoricNetwork neo-hookean-isochoric@1 of neo-hookean>
    """

    kind: ClassVar[str] = "isochoric-network"
    trial = staticmethod(isochoric_states)
    # Under plane stress every bond would evaluate the network in every step of a Newton iteration
    # for the thickness.
    several_materials = ("strain", "space")
    feature_set: ClassVar[str] = "isochoric invariants"
    features: ClassVar[tuple[str, ...]] = ISOCHORIC_FEATURES

    def honored(self, plane: str) -> Mapping[str, tuple]:
        # In plane strain the stress across the plane is formed in double precision.
        honors = super().honored(plane)
        return honors if plane == "space" else {**honors, "precision": ("float64",)}

    def isochoric_derivatives(self, I1, I2) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return W and its derivatives by I1bar and by I2bar, evaluated in NumPy.

        Parameters
        ----------
        I1, I2 : array_like
            Isochoric invariants, of one shape.

        Returns
        -------
        W, W1, W2 : ndarray
            Arrays of the shape of the invariants, in units of mu.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> W, W1, W2 = pds.load_surrogate("neo-hookean-isochoric").isochoric_derivatives(
        ...     [3.0, 4.0], [3.0, 4.0]
        ... )
        >>> W.round(3).tolist()
        [0.0, 0.5]
        """
        I1, I2 = (np.asarray(value, dtype=float) for value in (I1, I2))
        W, by_first, by_second, *_ = self._sums(np.log(I1 / 3), np.log(I2 / 3))
        return W - self.at_rest[0], by_first / I1, by_second / I2

    def isochoric_energy(
        self, law: Law, plane: str, outside: str, precision: str
    ) -> IsochoricEnergy:
        """Return the learned isochoric energy of the bonds, in the form that compiled kernels
        evaluate.

        Parameters
        ----------
        law : Law
            Law whose exact energy takes over at the edge of the domain with the policy "fallback".
        plane : {"strain", "space"}
        outside : {"fallback", "warn", "raise", "extrapolate"}
            Policy outside the domain.
        precision : {"float32", "float64"}

        Returns
        -------
        IsochoricEnergy

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> model = pds.load_surrogate("neo-hookean-isochoric")
        >>> model.isochoric_energy(
        ...     pds.materials.NeoHookean(), "space", "fallback", "float64"
        ... ).precision
        'float64'
        """
        response = PLANES[plane].isochoric_response
        exact = IsochoricEnergy.exact(law, plane)
        parts = ACTIVATIONS[self.activation], response.invariants, response.of_invariants
        block = block_function_of(
            kernel.network_block, isochoric_energy_signature(precision), *parts
        )
        guard = {"fallback": kernel.TAKE_OVER, "extrapolate": kernel.EXTRAPOLATE}.get(
            outside, kernel.COUNT
        )
        sizes = np.array([len(self._units()) // GROUP, guard, 0])
        return replace(
            exact,
            address=block.address or 0,
            sizes=sizes,
            weights=self.isochoric_weights,
            precision=precision,
        )

    @property
    def isochoric_weights(self) -> np.ndarray:
        distances = distance_coefficients(self.domain.least_stretch, self.domain.greatest_stretch)
        return np.concatenate([distances.ravel(), [self.at_rest[0]], self._units()])

    def _units(self) -> np.ndarray:
        return pack_units(self.hidden_weights, self.hidden_biases, self.output_weights)

    def answer(self, *states: np.ndarray) -> np.ndarray:
        I1, I2, squares = states
        return isochoric_stresses(squares, *self.isochoric_derivatives(I1, I2)[1:])
