"""How a force model is evaluated on a body: the choices that are not the model's own."""

from __future__ import annotations

from dataclasses import dataclass

from ..kernels.bond_pass import FALL_BACK, TURNED
from ..kernels.node_state import ROTATIONS
from ..kernels.reference import CORRECTIONS

OUTSIDE_POLICIES = {"fallback": FALL_BACK, "warn": TURNED, "raise": TURNED, "extrapolate": TURNED}
"""What is done about bonds outside a surrogate's domain."""

PRECISIONS = ("float32", "float64")


@dataclass(frozen=True)
class ForceSettings:
    """Choices for the evaluation of a force model.

    Parameters
    ----------
    precision : {"float32", "float64"}, optional
        Of the bond pass; positions, sums and the node state's own computation are always double.  By default the model's own choice.
    correction : {"tensor", "scalar", "none"}, optional
        Correction of incomplete horizons: THEORY [5], the paper's (24)-(25), or nothing.  By default "tensor" where the model allows it.
    rotation : {"polar", "convected"}
        Rotation of a horizon: of the polar decomposition, or the paper's (22)-(23).
    outside : {"fallback", "warn", "raise", "extrapolate"}
        What is done about bonds outside the model's domain: the exact bond force, a warning, an error, or nothing.  A bond turned by a
        right angle from its horizon has no features, and gets the exact bond force even where extrapolation is asked for.
    breakable : bool
        Whether bonds may break, which keeps reference data that an unbreakable body has no use for.
    """

    precision: str | None = None
    correction: str | None = None
    rotation: str = "polar"
    outside: str = "fallback"
    breakable: bool = False

    def __post_init__(self) -> None:
        for key, choices in (
            ("precision", (None, *PRECISIONS)),
            ("correction", (None, *CORRECTIONS)),
            ("rotation", tuple(ROTATIONS)),
            ("outside", tuple(OUTSIDE_POLICIES)),
        ):
            if getattr(self, key) not in choices:
                names = ", ".join(choice for choice in choices if choice)
                raise ValueError(f"{key} must be one of {names}, not {getattr(self, key)!r}")
