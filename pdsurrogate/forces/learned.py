"""Base class of learned models, which are plain arrays with a training domain and the material
that they describe, and their checks.
"""

from abc import abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np

from ..materials import Law
from ..materials.covariance import LawCovariance
from .agreement import check_agreement
from .domain import Domain
from .protocol import ForceModel

CHUNK = 65_536
"""Number of bonds or points evaluated together. Chosen: a feature or an output of so many takes 0.5
MB; greater numbers only take more memory.
"""


@dataclass(frozen=True, repr=False)
class Learned(ForceModel):
    """Base class of learned force models: fields that are names or arrays, with the domain and
    material of the training.

    Attributes
    ----------
    kind : str
        Kind of the model, as the card (metadata) of its artifact names it.
    names : mapping
        Fields that are names (such as an activation function), in the order of `payload`, with
        their allowed values.
    arrays : tuple of str
        Fields that are arrays, in the order of `payload`.
    exact : str
        Name of the force model that accepts every law, for error messages.
    trial : callable
        Function of a law and stretches that returns states and the exact answers there, see
        `pdsurrogate.forces.agreement`.
    domain, law, shape
        Training domain, name of the law, and dimensionless parameters of the law, which subclasses
        declare as fields.
    """

    kind: ClassVar[str]
    names: ClassVar[Mapping[str, Collection[str]]]
    arrays: ClassVar[tuple[str, ...]]
    exact: ClassVar[str]
    trial: ClassVar[Callable]
    stated: Mapping[str, float] | None = field(default=None, kw_only=True)
    covariance: LawCovariance | None = field(default=None, kw_only=True, compare=False)

    @property
    def facts(self) -> dict[str, str]:
        stretches = f"{self.domain.least_stretch:g} to {self.domain.greatest_stretch:g}"
        error = {} if self.stated is None else {"RMS error": f"{self.stated['rms']:.2g}"}
        return {**super().facts, "law": self.law, **self.shape, "stretches": stretches, **error}

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name} of {self.law}>"

    def payload(self) -> dict[str, Any]:
        """Return the fields that define the model, from which `from_payload` rebuilds it.

        Returns
        -------
        dict
            Arrays of doubles, and names, by key.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> sorted(pds.load_surrogate("neo-hookean-energy").payload())
        ['activation', 'hidden_biases', 'hidden_weights', 'output_weights']
        """
        return {key: getattr(self, key) for key in (*self.names, *self.arrays)}

    @classmethod
    def from_payload(
        cls, name: str, payload: dict, domain: Domain, law: str, shape: Mapping[str, float]
    ) -> Self:
        """Return the model that the fields in a payload define, after checking them.

        Parameters
        ----------
        name : str
            Name of the model.
        payload : dict
            Arrays and names by key, as `payload` returns them.
        domain : Domain
            States on which the model was trained.
        law : str
            Name of the law that it describes.
        shape : mapping
            Dimensionless parameters of the law.

        Returns
        -------
        Learned
            Model of the class on which the method is called.

        Raises
        ------
        ValueError
            If a field is missing, unknown, of the wrong shape, or not finite.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> model = pds.load_surrogate("neo-hookean@1")
        >>> type(model).from_payload("copy", model.payload(), model.domain, model.law, model.shape)
        <NetworkForce copy of neo-hookean>
        """
        check_payload(cls.kind, payload, cls.names, cls.arrays)
        found = cls(name=name, domain=domain, law=law, shape=dict(shape), **payload)
        found.check_arrays()
        return found

    @abstractmethod
    def check_arrays(self) -> None:
        """Check the shapes of the arrays of the model.

        Raises
        ------
        ValueError
            If an array has a wrong shape.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.load_surrogate("neo-hookean-energy").check_arrays()
        """

    @abstractmethod
    def answer(self, *states: np.ndarray) -> np.ndarray:
        """Return the model's forces or stresses at the states that `trial` returns.

        Parameters
        ----------
        *states : ndarray, shape (n,)
            Quantities of the states: those of a bond, or the invariants of an energy with the
            squares of the stretches.

        Returns
        -------
        ndarray, shape (n, components)

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> stretch, rotation, length, C33, J = (
        ...     np.ones(1),
        ...     np.zeros(1),
        ...     np.ones(1),
        ...     np.ones(1),
        ...     np.ones(1),
        ... )
        >>> pds.load_surrogate("neo-hookean@1").answer(stretch, rotation, length, C33, J).shape
        (1, 2)
        """

    @staticmethod
    def shape_of(law: Law) -> dict[str, float]:
        """Return the dimensionless parameters of a law that the model depends on.

        Parameters
        ----------
        law : Law

        Returns
        -------
        dict of str to float

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.load_surrogate("gent@1").shape_of(pds.materials.Gent(chain_limit=120.0))
        {'chain_limit': 120.0}
        """
        return law.shape

    def check_material(self, law: Law) -> None:
        """Check that the model was trained for a material, and that its forces are those of the law
        as it is now.

        Parameters
        ----------
        law : Law

        Raises
        ------
        ValueError
            If the law or one of its dimensionless parameters differs, or the forces of the law do;
            the message names what would be right.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.load_surrogate("neo-hookean@1").check_material(
        ...     pds.materials.NeoHookean(shear_modulus=2.0, bulk_modulus=200.0)
        ... )
        """
        shape = self.shape_of(law)
        serves = f"force={self.exact}, which supports every law"
        if law.name != self.law:
            raise ValueError(
                f"{self.name} describes the law {self.law}, not {law.name}; force={self.exact}"
                " supports every law"
            )
        if set(shape) != set(self.shape):
            raise ValueError(
                f"{self.name} describes {self.law} with parameters {sorted(self.shape)}, not"
                f" {sorted(shape)}; use {serves}"
            )
        for key, value in shape.items():
            if not np.isclose(value, self.shape[key], rtol=1e-9, atol=0):
                own = float(self.shape[key])
                other = float(value)
                raise ValueError(
                    f"{self.name} describes {self.law} with {key} = {own!r}, not {other!r}; fit"
                    f" another, or use {serves}"
                )
        check_agreement(self, law, type(self).trial, f"fit it again, or use {serves}")


def check_payload(
    kind: str, payload: dict, names: Mapping[str, Collection[str]], arrays: Sequence[str]
) -> None:
    """Check that a payload consists of known names and of arrays of finite doubles.

    Parameters
    ----------
    kind : str
        Kind of the model.
    payload : dict
    names : mapping
        Allowed names, by key.
    arrays : sequence of str
        Keys of the arrays.

    Raises
    ------
    ValueError
        If a name or array is missing, unknown or invalid, or the payload has other keys.
    """
    if set(payload) != {*names, *arrays}:
        raise ValueError(
            f"{kind}: the payload has {', '.join([*names, *arrays])}, not {', '.join(payload)}"
        )
    for key, known in names.items():
        if not isinstance(payload[key], str) or payload[key] not in known:
            raise ValueError(f"unknown {key.replace('_', ' ')} {payload[key]!r}")
    for key in arrays:
        value = payload[key]
        if (
            not isinstance(value, np.ndarray)
            or value.dtype != np.float64
            or not np.isfinite(value).all()
        ):
            raise ValueError(f"{key} is not an array of finite doubles")


def check_shape(array: np.ndarray, what: str, shape: tuple[int, ...]) -> None:
    """Raise ValueError if the array that messages call `what` does not have the given shape."""
    if array.shape != shape:
        raise ValueError(f"{what} has shape {array.shape}, not {shape}")
