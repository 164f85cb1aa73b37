"""Learnt bond forces: maps from features of a bond to its force, each with a training domain and the material that it describes."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from ..engine.block_arrays import TRACTION_ROWS
from ..kernels.bond_state import along_and_across, lateral_stretch
from ..kernels.feature_sets import FEATURE_SETS, N_OUTPUTS
from ..materials import Law
from .agreement import bond_states, check_agreement
from .bond_force import AnalyticBondForce, BondStates, ForceSurrogate, bond_arrays
from .members import greatest_deviations
from .protocol import CompiledBondForce, Domain, Member


@dataclass(frozen=True, repr=False)
class LearntBondForce(ForceSurrogate):
    """Learnt map from features of a bond to its dimensionless force.

    A model that consists only of arrays lists their names in `arrays`, declares them as fields, and checks them in `check_arrays`.

    Parameters
    ----------
    name : str
    feature_set : str
        One of `pdsurrogate.kernels.feature_sets.FEATURE_SETS`.
    at_rest : ndarray, shape (2,)
        Outputs at rest, which are subtracted from all outputs.
    domain : Domain
        States on which it was trained.
    law : str
        Name of the law that it describes.
    shape : mapping
        Dimensionless parameters of the law that its bond force depends on.
    stated : mapping, optional
        Relative errors on the plane-stress surface, ``rms`` and ``max``, that its card states, and ``bulk_ratio``, K/mu
        of the training states; None without a card.
    members : tuple of Member, optional
        Members of its committee, in a run that reports their deviation.
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
    arrays: ClassVar[tuple[str, ...]] = ()
    default_precision: ClassVar[str] = "float32"

    @property
    def facts(self) -> dict[str, str]:
        """Main properties in words."""
        return {**super().facts, **learnt_facts(self)}

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name} of {self.law}>"

    @abstractmethod
    def outputs(self, features: np.ndarray) -> np.ndarray:
        """Return the outputs, before `at_rest` is subtracted, for features of shape (n, n_features); shape (n, 2)."""

    @abstractmethod
    def packed(self, dtype) -> tuple[int, np.ndarray, np.ndarray, int]:
        """Return the address of the block function, its sizes and weights, and the rows of working memory that it needs.

        The last `N_OUTPUTS` weights are `at_rest`.
        """

    def payload(self) -> dict[str, np.ndarray | str]:
        """Return the arrays of doubles and the names from which `from_payload` builds the same model."""
        return {key: getattr(self, key) for key in ("feature_set", *self.arrays, "at_rest")}

    @classmethod
    def from_payload(cls, name: str, payload: dict, domain: Domain, law: str, shape: Mapping[str, float]) -> Self:
        """Build a model from its payload.

        Raises
        ------
        ValueError
            If anything is missing, of the wrong shape, or not finite.
        """
        check_payload(cls.kind, payload, {"feature_set": FEATURE_SETS}, (*cls.arrays, "at_rest"))
        check_shape(payload["at_rest"], "at_rest", (N_OUTPUTS,))
        arrays = {key: payload[key] for key in cls.arrays}
        found = cls(name, payload["feature_set"], payload["at_rest"], domain, law, dict(shape), **arrays)
        found.check_arrays()
        return found

    def check_arrays(self) -> None:
        """Raise ValueError if an array of `arrays` is not of the right shape."""

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the features."""
        return FEATURE_SETS[self.feature_set].names

    @property
    def gives_transverse(self) -> bool:
        """Whether the model provides T_mm, by coaxiality; models of the paper's features do not."""
        return FEATURE_SETS[self.feature_set].gives_transverse

    def bond_force(self, stretch, rotation, length, C33, J) -> np.ndarray:
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
        def force_of(model: LearntBondForce, law: Law, some: slice) -> np.ndarray:
            of = states.chosen(some)
            inside = of.has_stretch_tensor & (model.domain.beyond_bounds(of.stretches, of.J**2 * of.C33) <= 0)
            force = np.empty((len(inside), N_OUTPUTS))
            for which, source in ((inside, model), (~inside, AnalyticBondForce(law))):
                if which.any():
                    force[which] = source.bond_force(*of.chosen(which).quantities())
            return force

        return greatest_deviations(self, law, force_of, len(states.a))

    def compiled(self, dtype) -> CompiledBondForce:
        """Return the block function and packed weights in the given precision."""
        features, found = FEATURE_SETS[self.feature_set], CompiledBondForce(*self.packed(dtype))
        if features.anchored is not None and np.abs(self.bond_force([1.0], [0.0], [1.0], [1.0], [1.0])).max() < 1e-9:
            # The force at rest is exactly zero in the kernel's precision: the kernel's own rest value is subtracted as well.
            rest = found.evaluate(np.array([[1.0, 0.0, 1.0, 1.0, 1.0, 1.0]]).T, TRACTION_ROWS)[0, 0]
            found.weights[features.anchored - N_OUTPUTS] += found.weights.dtype.type(rest / features.rest_factor)
        return replace(found, needs_length=features.needs_length)

    def check_material(self, law: Law) -> None:
        """Raise ValueError if the model was not trained for this material, or its forces are not those of the law as it is now."""
        check_described(self, law, law.shape, "analytic")
        check_agreement(self, law, bond_states, self.bond_force, "analytic")


def learnt_facts(model) -> dict[str, str]:
    """Return the material that a learnt model describes, in words."""
    stretches = f"{model.domain.least_stretch:g} to {model.domain.greatest_stretch:g}"
    error = {} if model.stated is None else {"RMS error": f"{model.stated['rms']:.2g}"}
    return {"law": model.law, **model.shape, "stretches": stretches, **error}


def check_described(model, law: Law, shape: Mapping[str, float], exact: str) -> None:
    """Check that a learnt model describes a material.

    Parameters
    ----------
    model
        Model with its `name`, and the `law` and `shape` that it was trained for.
    law : Law
    shape : mapping
        Dimensionless parameters of `law` that the model depends on.
    exact : str
        Name of the force model that accepts every law, for the error message.

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


def check_payload(kind: str, payload: dict, names: Mapping[str, Collection[str]], arrays: Sequence[str]) -> None:
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
        If anything is missing, or anything else is there.
    """
    if set(payload) != {*names, *arrays}:
        raise ValueError(f"{kind}: the payload has {', '.join([*names, *arrays])}, not {', '.join(payload)}")
    for key, known in names.items():
        if not isinstance(payload[key], str) or payload[key] not in known:
            raise ValueError(f"unknown {key.replace('_', ' ')} {payload[key]!r}")
    for key in arrays:
        value = payload[key]
        if not isinstance(value, np.ndarray) or value.dtype != np.float64 or not np.isfinite(value).all():
            raise ValueError(f"{key} is not an array of finite doubles")


def check_shape(array: np.ndarray, what: str, shape: tuple[int, ...]) -> None:
    """Raise ValueError if an array has another shape."""
    if array.shape != shape:
        raise ValueError(f"{what} has shape {array.shape}, not {shape}")
