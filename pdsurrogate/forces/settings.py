"""How a force model is evaluated on a body: the choices that are not the model's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

from ..body import Body
from ..kernels.bond_force import FALL_BACK, TURNED
from ..kernels.reference_state import CORRECTIONS
from ..materials import PLANES, dimension_of
from ..paper.rotation import convected_rotations

OUTSIDE_POLICIES = {"fallback": FALL_BACK, "warn": TURNED, "raise": TURNED, "extrapolate": TURNED}
"""What is done about bonds outside a surrogate's domain."""

PRECISIONS = ("float32", "float64")

ROTATIONS = {"polar": None, "convected": convected_rotations}
"""How the rotation of a horizon is taken from F: of the polar decomposition, as the pass over the points gives it, or by a pass of its own
after that one."""

WHERE = {"stress": "", "strain": " in plane strain", "space": " in space"}
OTHERS = {
    "stress": "force=analytic and force=bond-energy take every law under plane stress",
    "strain": "force=analytic and force=bond-energy take both",
    "space": "force=bond-energy, force=nosb and artefacts of isochoric energies take bodies in space",
}
"""In words: what a plane is called, and which models take it where another does not."""

ROTATION, OUTSIDE = "polar", "fallback"
"""What models that have a choice do where none is made."""


@dataclass(frozen=True)
class ForceSettings:
    """Choices for the evaluation of a force model; what is left at its default is the model's own choice.

    A choice that a model cannot honour is refused (`check`), so that none is ignored.

    Parameters
    ----------
    precision : {"float32", "float64"}, optional
        Of the bond pass; positions, sums and the node state's own computation are always double.
    correction : {"tensor", "scalar", "none"}, optional
        Correction of incomplete horizons: theory (21), the paper's (24)-(25), or nothing.  By default "tensor" where the model allows it.
    rotation : {"polar", "convected"}, optional
        Rotation of a horizon: of the polar decomposition, which is the default, or the paper's (22)-(23).
    outside : {"fallback", "warn", "raise", "extrapolate"}, optional
        What is done about bonds outside the model's domain: the exact bond force (the default), a warning, an error, or
        nothing.  A bond turned by a
        right angle from its horizon has no features, and gets the exact bond force even where extrapolation is asked for.
    breakable : bool
        Whether bonds may break, which keeps reference data that an unbreakable body has no use for.
    plane : {"stress", "strain", "space"}
        Whether the thickness of a body in the plane is free or held; "space" of every body in space.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.ForceSettings(precision="float64", plane="strain").plane
    'strain'
    """

    precision: str | None = None
    correction: str | None = None
    rotation: str | None = None
    outside: str | None = None
    breakable: bool = False
    plane: str = "stress"

    def __post_init__(self) -> None:
        for key, choices in (
            ("precision", (None, *PRECISIONS)),
            ("correction", (None, *CORRECTIONS)),
            ("rotation", (None, *ROTATIONS)),
            ("outside", (None, *OUTSIDE_POLICIES)),
            ("plane", tuple(PLANES)),
        ):
            if getattr(self, key) not in choices:
                names = ", ".join(choice for choice in choices if choice)
                raise ValueError(f"{key} must be one of {names}, not {getattr(self, key)!r}")

    def check(self, name: str, honours: Mapping[str, tuple]) -> None:
        """Refuse what a model cannot honour.

        Parameters
        ----------
        name : str
            Of the model.
        honours : mapping
            Values that the model can honour, by setting; one that is missing it has no use for.

        Raises
        ------
        ValueError
            Names the setting, the model, and what it takes.
        """
        for field in fields(self):
            key, value = field.name, getattr(self, field.name)
            # Of all but the plane the default is what a model does anyway.
            usual = value == field.default and (key != "plane" or key not in honours)
            if usual or value in honours.get(key, ()):
                continue
            where = WHERE[self.plane] if key != "plane" else ""
            taken = {key: honours[key]} if key in honours else honours
            words = ", ".join(_words(key, *values) for key, values in taken.items()) or "none of these settings"
            advice = f"; {OTHERS[value]}" if key == "plane" else ""
            raise ValueError(f"{name} does not take {_words(key, value)}{where}; it takes {words}{advice}")

    def check_body(self, body: Body) -> None:
        """Refuse a body of another dimension than the state that `plane` names."""
        if body.dimension != dimension_of(self.plane):
            right = "plane=stress or plane=strain" if body.dimension == 2 else "plane=space"
            raise ValueError(
                f"plane={self.plane} is of bodies of {dimension_of(self.plane)} dimensions; this one has {body.dimension}: {right}"
            )


def _words(key: str, *values) -> str:
    """A setting and its values, in words."""
    return "bonds that break (fracture)" if key == "breakable" else f"{key}={'|'.join(values)}"
