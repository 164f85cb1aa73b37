"""Learned bond forces: maps from features of a bond to its force, as networks, polynomials and
splines, stored as plain arrays.
"""

from abc import abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from itertools import chain, product
from typing import ClassVar, Self

import numpy as np

from ..engine.block_arrays import TRACTION_ROWS
from ..kernels import network, polynomial, spline
from ..kernels.bond_force import along_and_across, lateral_stretch
from ..kernels.feature_sets import FEATURE_SETS, N_OUTPUTS
from .agreement import bond_states
from .bond_force import ForceSurrogate, bond_arrays
from .compiled_force import CompiledBondForce
from .domain import Domain
from .learned import Learned, check_payload, check_shape

LAYER = ("weights", "biases")
"""Names of the two arrays of a network's layer, in this order; keys of a payload append the
number of the layer, as in ``weights_0``.
"""

MOST_COEFFICIENTS = 2**20
"""Maximum number of entries of the table of a spline. Chosen: the table takes 4 MB in single
precision, which represents indices exactly up to sixteen times this number; a larger table would
fit the processor's cache less.
"""


@dataclass(frozen=True, repr=False)
class LearnedBondForce(Learned, ForceSurrogate):
    """Base class of learned maps from features of a bond to its dimensionless force.

    Parameters
    ----------
    name : str
    feature_set : str
        One of `pdsurrogate.kernels.feature_sets.FEATURE_SETS`.
    at_rest : ndarray, shape (2,)
        Outputs for an undeformed bond, which are subtracted from all outputs.
    domain : Domain
        States on which it was trained.
    law : str
        Name of the law that it describes.
    shape : mapping
        Dimensionless parameters of the law that its bond force depends on.
    stated : mapping, optional
        Relative errors at states of plane stress, ``rms`` and ``max``, that its card (the metadata
        of its artifact) states, and ``bulk_ratio``, K/mu of the training states; None without a
        card.
    covariance : LawCovariance, optional
        Covariance of its law, if this was fitted to measurements that determine it.
    """

    name: str
    feature_set: str
    at_rest: np.ndarray
    domain: Domain
    law: str
    shape: Mapping[str, float]

    names: ClassVar[Mapping[str, Collection[str]]] = {"feature_set": FEATURE_SETS}
    exact: ClassVar[str] = "analytic"
    trial = staticmethod(bond_states)
    default_precision = "float32"

    @abstractmethod
    def outputs(self, features: np.ndarray) -> np.ndarray:
        """Return the two outputs of the map, before `at_rest` is subtracted.

        Parameters
        ----------
        features : ndarray, shape (n, n_features)
            Values of `features`.

        Returns
        -------
        ndarray, shape (n, 2)

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> model = pds.load_surrogate("neo-hookean@1")
        >>> model.outputs(np.ones((3, len(model.features)))).shape
        (3, 2)
        """

    @abstractmethod
    def packed(self, dtype) -> tuple[int, np.ndarray, np.ndarray, int]:
        """Return the model compiled for blocks of bonds.

        Parameters
        ----------
        dtype : dtype
            Precision, float32 or float64.

        Returns
        -------
        address : int
            Address of the compiled function.
        sizes : ndarray of int64
        weights : ndarray
            In the given precision; the last `N_OUTPUTS` are `at_rest`.
        work_rows : int
            Rows of working memory needed.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> address, sizes, weights, work_rows = pds.load_surrogate("gent@1").packed("float64")
        >>> weights.dtype.name, work_rows
        ('float64', 0)
        """

    def check_arrays(self) -> None:
        check_shape(self.at_rest, "at_rest", (N_OUTPUTS,))

    def check_scale(self, *keys: str) -> None:
        """Check the fields that map the features to the range of the training.

        Parameters
        ----------
        *keys : str
            Names of the field with the origin of every feature, and of the field with its unit.

        Raises
        ------
        ValueError
            If a field has a wrong shape, or a unit is not positive.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.load_surrogate("gent@1").check_scale("center", "half_width")
        """
        for key in keys:
            check_shape(getattr(self, key), key, (len(self.features),))
        if not (getattr(self, keys[1]) > 0).all():
            raise ValueError(f"{keys[1]} must be positive")

    @property
    def features(self) -> tuple[str, ...]:  # type: ignore[override]  # read-only here
        """Names of the features of a bond that the model maps to its force.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.load_surrogate("neo-hookean-paper@1").features
        ('stretch', 'rotation', 'length', 'C33', 'J')
        """
        return FEATURE_SETS[self.feature_set].names

    @property
    def gives_transverse(self) -> bool:  # type: ignore[override]
        """Whether the model provides the stress component T_mm across a bond; models with the
        paper's features do not.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> (
        ...     pds.load_surrogate("neo-hookean@1").gives_transverse,
        ...     pds.load_surrogate("neo-hookean-paper@1").gives_transverse,
        ... )
        (True, False)
        """
        return FEATURE_SETS[self.feature_set].gives_transverse

    def bond_force(self, stretch, rotation, length, C33, J) -> np.ndarray:
        stretch, rotation, length, C33, J = bond_arrays(stretch, rotation, length, C33, J)
        a = stretch * np.cos(rotation)
        b = stretch * np.sin(rotation)
        U_mm = lateral_stretch(a, b, J)
        features = FEATURE_SETS[self.feature_set]
        with np.errstate(
            invalid="ignore"
        ):  # a bond turned past a right angle has no stretch tensor: NaN
            shared = features.shared(a, b, J, C33)
            outputs = (
                self.outputs(np.stack(features.inputs(shared, a, b, U_mm, J, C33, length), axis=1))
                - self.at_rest
            )
            T_nn, T_nm, _ = features.traction(
                shared, outputs[:, 0], outputs[:, 1], a, b, U_mm, J, C33
            )
        return along_and_across(T_nn, T_nm, a, b, stretch)

    def answer(self, *states: np.ndarray) -> np.ndarray:
        return self.bond_force(*states)

    def compiled(self, dtype) -> CompiledBondForce:
        features = FEATURE_SETS[self.feature_set]
        found = CompiledBondForce(*self.packed(dtype))
        if (
            features.anchored is not None
            and np.abs(self.bond_force([1.0], [0.0], [1.0], [1.0], [1.0])).max() < 1e-9
        ):
            # The force at rest is exactly zero in the kernel's precision: the kernel's own rest
            # value is subtracted as well.
            rest = found.evaluate(np.array([[1.0, 0.0, 1.0, 1.0, 1.0, 1.0]]).T, TRACTION_ROWS)[0, 0]
            found.weights[features.anchored - N_OUTPUTS] += found.weights.dtype.type(
                rest / features.rest_factor
            )
        return replace(found, needs_length=features.needs_length)


@dataclass(frozen=True, repr=False)
class NetworkForce(LearnedBondForce):
    """Learned bond force as a neural network of features of a bond.

    Parameters
    ----------
    name : str
        Name of the model.
    feature_set : str
        One of `pdsurrogate.kernels.feature_sets.FEATURE_SETS`.
    at_rest : ndarray, shape (2,)
        Outputs for an undeformed bond, which are subtracted from all outputs.
    domain : Domain
        States on which it was trained.
    law : str
        Name of the law that it describes.
    shape : mapping
        Dimensionless parameters of the law that its bond force depends on.
    activation : str
        One of `pdsurrogate.kernels.network.ACTIVATIONS`.
    layers : tuple of (ndarray, ndarray)
        Weights of shape (n_in, n_out) and biases of every layer, the output layer last, on unscaled
        features and outputs.
    stated : mapping, optional
        Relative errors at states of plane stress, ``rms`` and ``max``, that its card (the metadata
        of its artifact) states, and ``bulk_ratio``, K/mu of the training states; None without a
        card.
    covariance : LawCovariance, optional
        Covariance of its law, if this was fitted to measurements that determine it.

    See Also
    --------
    pdsurrogate.load_surrogate : loads a stored model.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.load_surrogate("neo-hookean-paper@1")
    >>> model.size
    '20 units'
    """

    activation: str
    layers: tuple[tuple[np.ndarray, np.ndarray], ...]

    kind: ClassVar[str] = "bond-force-network"
    names: ClassVar[Mapping[str, Collection[str]]] = {
        "feature_set": FEATURE_SETS,
        "activation": network.ACTIVATIONS,
    }

    @property
    def size(self) -> str:
        return f"{' + '.join(str(biases.size) for _, biases in self.layers[:-1])} units"

    def outputs(self, features: np.ndarray) -> np.ndarray:
        return network.network_outputs(features, self.layers, network.ACTIVATIONS[self.activation])

    def packed(self, dtype) -> tuple[int, np.ndarray, np.ndarray, int]:
        sizes, weights = network.pack(self.layers, self.at_rest, dtype)
        block = network.network_block(
            FEATURE_SETS[self.feature_set], network.ACTIVATIONS[self.activation], dtype
        )
        return block.address, sizes, weights, int(sizes[network.N_WORK_ROWS])

    def payload(self) -> dict[str, np.ndarray | str]:
        layers = {
            f"{key}_{n}": array
            for n, layer in enumerate(self.layers)
            for key, array in zip(LAYER, layer, strict=True)
        }
        return {
            "feature_set": self.feature_set,
            "activation": self.activation,
            **layers,
            "at_rest": self.at_rest,
        }

    @classmethod
    def from_payload(
        cls, name: str, payload: dict, domain: Domain, law: str, shape: Mapping[str, float]
    ) -> Self:
        n_layers = sum(key.startswith(LAYER[0]) for key in payload)
        keys = [[f"{key}_{n}" for key in LAYER] for n in range(n_layers)]
        check_payload(cls.kind, payload, cls.names, [*chain(*keys), "at_rest"])
        layers = tuple(tuple(payload[key] for key in pair) for pair in keys)
        found = cls(
            name,
            payload["feature_set"],
            payload["at_rest"],
            domain,
            law,
            dict(shape),
            payload["activation"],
            layers,
        )
        found.check_arrays()
        return found

    def check_arrays(self) -> None:
        if not 2 <= len(self.layers) <= network.MOST_HIDDEN + 1:
            raise ValueError(
                f"a network has one to {network.MOST_HIDDEN} hidden layers and an output layer"
            )
        width = len(self.features)
        for number, (weights, biases) in enumerate(self.layers):
            if (
                weights.ndim != 2
                or biases.shape != weights.shape[1:]
                or weights.shape[0] != width
                or biases.size == 0
            ):
                raise ValueError(
                    f"layer {number} has weights {weights.shape} and biases {biases.shape} after a"
                    f" layer of {width}"
                )
            width = biases.size
        if width != N_OUTPUTS:
            raise ValueError(f"a bond-force network has {N_OUTPUTS} outputs, this one {width}")
        super().check_arrays()


@dataclass(frozen=True, repr=False)
class PolynomialForce(LearnedBondForce):
    """Learned bond force as a sum of products of Chebyshev polynomials in two features of a bond.

    Parameters
    ----------
    name, feature_set, at_rest, domain, law, shape
        As for `NetworkForce`.
    center, half_width : ndarray, shape (2,)
        Features are mapped to (x - center)/half_width, which is in [-1, 1] for the training states.
    coefficients : ndarray, shape (2, degree1 + 1, degree2 + 1)
        Coefficients of the products T_i(x1) T_j(x2) of Chebyshev polynomials, for each of the two
        outputs.
    stated, covariance
        As for `NetworkForce`.

    See Also
    --------
    pdsurrogate.load_surrogate : loads a stored model.
    pdsurrogate.learning.ChebyshevRegressor : fits the polynomial.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.load_surrogate("gent@1")
    <PolynomialForce gent@1 of gent>
    """

    center: np.ndarray
    half_width: np.ndarray
    coefficients: np.ndarray

    kind: ClassVar[str] = "bond-force-polynomial"
    arrays: ClassVar[tuple[str, ...]] = ("center", "half_width", "coefficients", "at_rest")

    def payload(self) -> dict[str, np.ndarray | str]:
        return {
            "centre" if key == "center" else key: value for key, value in super().payload().items()
        }  # the name in files

    @classmethod
    def from_payload(
        cls, name: str, payload: dict, domain: Domain, law: str, shape: Mapping[str, float]
    ) -> Self:
        renamed = {"center" if key == "centre" else key: value for key, value in payload.items()}
        return super().from_payload(name, renamed, domain, law, shape)

    @property
    def size(self) -> str:
        first, second = (length - 1 for length in self.coefficients.shape[1:])
        return f"degree {first}" if first == second else f"degrees {first} and {second}"

    def outputs(self, features: np.ndarray) -> np.ndarray:
        x, y = ((features - self.center) / self.half_width).T
        return np.stack(
            [
                np.polynomial.chebyshev.chebval2d(x, y, coefficients)
                for coefficients in self.coefficients
            ],
            axis=1,
        )

    def packed(self, dtype) -> tuple[int, np.ndarray, np.ndarray, int]:
        counts, weights = polynomial.pack(
            self.center, self.half_width, self.coefficients, self.at_rest, dtype
        )
        block = polynomial.polynomial_block(FEATURE_SETS[self.feature_set], counts, dtype)
        return block.address, np.zeros(1, dtype=np.int64), weights, 0

    def check_arrays(self) -> None:
        super().check_arrays()
        count = len(self.features)
        if count != 2:
            raise ValueError(f"a polynomial takes two features, {self.feature_set} are {count}")
        self.check_scale("center", "half_width")
        shape = self.coefficients.shape
        if len(shape) != 3 or shape[0] != N_OUTPUTS:
            raise ValueError(
                f"coefficients have shape {shape}, not ({N_OUTPUTS}, degree + 1, degree + 1)"
            )
        if not all(1 <= length <= polynomial.MOST_DEGREE + 1 for length in shape[1:]):
            raise ValueError(f"the degrees must be 0 to {polynomial.MOST_DEGREE}")


@dataclass(frozen=True, repr=False)
class SplineForce(LearnedBondForce):
    """Learned bond force as a cubic spline in two or three features of a bond, with two continuous
    derivatives.

    Beyond its box the spline has the value at the edge of the box.

    Parameters
    ----------
    name, feature_set, at_rest, domain, law, shape
        As for `NetworkForce`.
    low, step : ndarray, shape (n,)
        Lower end of the box and width of a cell, for each feature.
    coefficients : ndarray, shape (2, cells_1 + 3, …, cells_n + 3)
        Coefficients of the B-splines, for each of the two outputs.
    stated, covariance
        As for `NetworkForce`.

    See Also
    --------
    pdsurrogate.surrogate_pipeline : takes any regressor, whose predictions become such a spline.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.forces.SplineForce.kind, issubclass(pds.forces.SplineForce, pds.forces.ForceModel)
    ('bond-force-spline', True)
    """

    low: np.ndarray
    step: np.ndarray
    coefficients: np.ndarray

    kind: ClassVar[str] = "bond-force-spline"
    arrays: ClassVar[tuple[str, ...]] = ("low", "step", "coefficients", "at_rest")

    @property
    def size(self) -> str:
        counts = (count - spline.SUPPORT + 1 for count in self.coefficients.shape[1:])
        return f"{' x '.join(map(str, counts))} cells"

    def outputs(self, features: np.ndarray) -> np.ndarray:
        cells = np.array(self.coefficients.shape[1:]) - (spline.SUPPORT - 1)
        place = (features - self.low) / self.step
        place = np.minimum(np.where(place > 0, place, 0), cells)
        first = np.minimum(np.floor(place), cells - 1).astype(int)
        weights = [spline.cubic_weights(within) for within in (place - first).T]
        found = np.zeros((len(features), N_OUTPUTS))
        for offsets in product(range(spline.SUPPORT), repeat=len(cells)):
            share = np.prod(
                [weight[offset] for weight, offset in zip(weights, offsets, strict=True)], axis=0
            )
            found += share[:, None] * self.coefficients[:, *(first + offsets).T].T
        return found

    def packed(self, dtype) -> tuple[int, np.ndarray, np.ndarray, int]:
        sizes, weights = spline.pack(self.low, self.step, self.coefficients, self.at_rest, dtype)
        return (
            spline.spline_block(FEATURE_SETS[self.feature_set], dtype).address,
            sizes,
            weights,
            spline.WORK_ROWS,
        )

    def check_arrays(self) -> None:
        super().check_arrays()
        count = len(self.features)
        shape = self.coefficients.shape
        if count not in spline.FEATURES:
            raise ValueError(
                f"a spline takes two or three features, {self.feature_set} are {count}"
            )
        self.check_scale("low", "step")
        if len(shape) != 1 + count or shape[0] != N_OUTPUTS or min(shape[1:]) < spline.SUPPORT:
            raise ValueError(
                f"coefficients have shape {shape}, not {N_OUTPUTS} and at least {spline.SUPPORT} by"
                f" each of {count} features"
            )
        if self.coefficients.size > MOST_COEFFICIENTS:
            raise ValueError(
                f"there are {self.coefficients.size} coefficients, at most {MOST_COEFFICIENTS} are"
                " taken"
            )
