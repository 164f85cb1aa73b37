"""What all learnt bond forces share: features in, outputs made into a force, a domain, a material."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ..engine.block_arrays import BLOCK, STATE_ROWS, TRACTION_ROWS
from ..engine.compile import call_block, kernel
from ..kernels.bond_state import along_and_across, lateral_stretch
from ..kernels.feature_sets import FEATURE_SETS, N_OUTPUTS
from ..materials import Law
from .agreement import bond_states, check_agreement
from .analytic import bond_arrays
from .bond_force import BondStates, ForceSurrogate
from .members import bond_deviations
from .protocol import CompiledBondForce, Domain, Member


@dataclass(frozen=True, repr=False)
class LearntBondForce(ForceSurrogate):
    """A learnt map from features of a bond to its dimensionless force.

    Parameters
    ----------
    name : str
    feature_set : str
        One of `pdsurrogate.kernels.feature_sets.FEATURE_SETS`.
    at_rest : ndarray, shape (2,)
        Taken off the outputs.
    domain : Domain
        Where it was trained.
    law : str
        Name of the law that it describes.
    shape : mapping
        Those dimensionless parameters of the law that its bond force depends on.
    stated : mapping, optional
        Relative errors on the plane-stress surface, ``rms`` and ``max``, that its card states, and ``bulk_ratio``, K/mu
        of the training states; None without a card.
    members : tuple of Member, optional
        Of its committee, where a run is to tell their deviation.
    """

    name: str
    feature_set: str
    at_rest: np.ndarray
    domain: Domain
    law: str
    shape: Mapping[str, float]
    stated: Mapping[str, float] | None = field(default=None, kw_only=True)
    members: tuple[Member, ...] = field(default=(), kw_only=True)

    kind: ClassVar[str]
    default_precision: ClassVar[str] = "float32"

    @property
    def facts(self) -> dict[str, str]:
        """What a person wants to know of it first, in words."""
        stretches = f"{self.domain.least_stretch:g} to {self.domain.greatest_stretch:g}"
        error = {} if self.stated is None else {"RMS error": f"{self.stated['rms']:.2g}"}
        return {**super().facts, "law": self.law, **self.shape, "stretches": stretches, **error}

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name} of {self.law}>"

    @abstractmethod
    def outputs(self, features: np.ndarray) -> np.ndarray:
        """Outputs, before `at_rest` is taken off, for features of shape (n, n_features); shape (n, 2)."""

    @abstractmethod
    def packed(self, dtype) -> tuple[int, np.ndarray, np.ndarray, int]:
        """Address of the block function, its sizes and weights, and the rows of working memory it needs.

        The last `N_OUTPUTS` weights are `at_rest`.
        """

    @classmethod
    @abstractmethod
    def from_payload(cls, name: str, payload: dict, domain: Domain, law: str, shape: Mapping[str, float]) -> LearntBondForce:
        """Build a model from what `payload` gave.

        Raises
        ------
        ValueError
            If anything is missing, of the wrong shape, or not finite.
        """

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the features."""
        return FEATURE_SETS[self.feature_set].names

    @property
    def gives_transverse(self) -> bool:
        """Whether T_mm is known: from coaxiality, or not at all with the paper's features."""
        return FEATURE_SETS[self.feature_set].gives_transverse

    def bond_force(self, stretch, rotation, length, C33, J) -> np.ndarray:
        """Dimensionless (t_n, t_tau) of theory (9); see `ForceSurrogate.bond_force`."""
        stretch, rotation, length, C33, J = bond_arrays(stretch, rotation, length, C33, J)
        a, b = stretch * np.cos(rotation), stretch * np.sin(rotation)
        U_mm = lateral_stretch(a, b, J)
        features = FEATURE_SETS[self.feature_set]
        with np.errstate(invalid="ignore"):  # a bond turned past a right angle has no stretch tensor: NaN
            shared = features.shared(a, b, J, C33)
            outputs = self.outputs(np.stack(features.inputs(shared, a, b, U_mm, J, C33, length), axis=1)) - self.at_rest
            T_nn, T_nm, _ = features.traction(shared, outputs[:, 0], outputs[:, 1], a, b, U_mm, J, C33)
        return along_and_across(T_nn, T_nm, a, b, stretch)

    def member_deviations(self, law: Law, states: BondStates) -> np.ndarray:
        """Return the greatest deviation of the members' bond force (`bond_deviations`), shape (n,)."""
        return bond_deviations(self, law, states)

    def compiled(self, dtype) -> CompiledBondForce:
        """Block function and packed weights in the given precision."""
        address, sizes, weights, work_rows = self.packed(dtype)
        features = FEATURE_SETS[self.feature_set]
        if features.anchored is not None and np.abs(self.bond_force([1.0], [0.0], [1.0], [1.0], [1.0])).max() < 1e-9:
            # Zero at rest is made zero as the kernel rounds it: take off what it gives there, beyond what is taken off already.
            states = np.ones((STATE_ROWS, BLOCK), dtype=dtype)
            states[1] = 0
            work, traction = np.zeros((work_rows, BLOCK), dtype=dtype), np.zeros((TRACTION_ROWS, BLOCK), dtype=dtype)
            evaluate_block(address, states, sizes, weights, work, traction)
            weights[features.anchored - N_OUTPUTS] += traction[0, 0] / traction.dtype.type(features.rest_factor)
        return CompiledBondForce(address, sizes, weights, work_rows, features.needs_length)

    def check_material(self, law: Law) -> None:
        """Raise ValueError if the model was not trained for this material, or its forces are not those of the law as it is now."""
        check_described(self, law, law.shape, "analytic")
        check_agreement(self, law, bond_states, self.bond_force, "analytic")


@kernel
def evaluate_block(address, states, sizes, weights, work, result):
    """Evaluate a block; learnt models ask nothing of the material law, so none is handed over."""
    call_block(address, states, sizes, weights, 0, work, work, work, result)


def check_described(model, law: Law, shape: Mapping[str, float], exact: str) -> None:
    """Check that a learnt model describes a material.

    Parameters
    ----------
    model
        With the `name`, `law` and `shape` of what it was trained for.
    law : Law
    shape : mapping
        Of the dimensionless parameters of `law` that matter to the model.
    exact : str
        Name of the force model that serves every law, for the error.

    Raises
    ------
    ValueError
        If it does not.
    """
    if law.name != model.law:
        raise ValueError(f"{model.name} describes the law {model.law}, not {law.name}; force={exact} serves every law")
    if set(shape) != set(model.shape):
        raise ValueError(
            f"{model.name} describes {model.law} with {', '.join(sorted(model.shape)) or 'no parameters'}, "
            f"not with {', '.join(sorted(shape)) or 'none'}; fit another, or use force={exact}, which serves every law"
        )
    for key, value in shape.items():
        if not np.isclose(value, model.shape[key], rtol=1e-9, atol=0):
            raise ValueError(
                f"{model.name} describes {model.law} with {key} = {float(model.shape[key])!r}, not {float(value)!r}; "
                f"fit another, or use force={exact}, which serves every law"
            )


def checked_feature_set(payload: dict) -> str:
    """The feature set named by a payload.

    Raises
    ------
    ValueError
        If it is unknown.
    """
    if not isinstance(payload["feature_set"], str) or payload["feature_set"] not in FEATURE_SETS:
        raise ValueError(f"unknown feature set {payload['feature_set']!r}")
    return payload["feature_set"]


def checked_array(value, what: str, shape: tuple[int, ...] | None = None) -> np.ndarray:
    """An array of finite doubles.

    Raises
    ------
    ValueError
        If it is anything else, or of another shape.
    """
    if not isinstance(value, np.ndarray) or value.dtype != np.float64 or not np.isfinite(value).all():
        raise ValueError(f"{what} is not an array of finite doubles")
    if shape is not None and value.shape != shape:
        raise ValueError(f"{what} has shape {value.shape}, not {shape}")
    return value
