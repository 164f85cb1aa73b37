"""Settings of the evaluation of a force model on a body."""

from collections.abc import Mapping
from dataclasses import dataclass, fields

from ..body import Body
from ..kernels.bond_force import FALL_BACK, TURNED
from ..kernels.reference_state import CORRECTIONS
from ..materials import PLANES, dimension_of
from ..paper.rotation import convected_rotations

OUTSIDE_POLICIES = {"fallback": FALL_BACK, "warn": TURNED, "raise": TURNED, "extrapolate": TURNED}
"""Policies for bonds outside a surrogate's domain, each with its guard in compiled passes
(`pdsurrogate.kernels.bond_force`).
"""

PRECISIONS = ("float32", "float64")

ROTATIONS = {"polar": None, "convected": convected_rotations}
"""Definitions of the rotation of a horizon (the material around a point) by name, each with the
compiled pass that overwrites the rotation from the polar decomposition; None for the polar
decomposition itself.
"""

SETTINGS = {
    "precision": PRECISIONS,
    "correction": tuple(CORRECTIONS),
    "rotation": tuple(ROTATIONS),
    "outside": tuple(OUTSIDE_POLICIES),
    "breakable": (True,),
    "plane": tuple(PLANES),
}
"""Settings of a force evaluation that models honor or refuse, and their possible values other than
the default of `ForceSettings`.
"""

WHERE = {"stress": "", "strain": " in plane strain", "space": " of solids"}
OTHERS = {
    "stress": "force=bond-energy supports every law under plane stress",
    "strain": "force=analytic and force=bond-energy support both",
    "space": "force=bond-energy, force=nosb and artifacts of isochoric energies support solids",
}
"""Advice for error messages about a model that does not support a plane: which models do, by the
plane.
"""
ROTATION = "polar"
OUTSIDE = "fallback"
"""Default rotation of a horizon and default policy outside the domain, for models that honor
these settings.
"""


@dataclass(frozen=True)
class ForceSettings:
    """Settings of the evaluation of a force model on a body; the model chooses values for settings
    that are None.

    A setting that a model cannot honor is rejected (`check`), so that no setting is ignored
    silently.

    Parameters
    ----------
    precision : {"float32", "float64"}, optional
        Precision of the compiled pass over the bonds; positions, sums and the states of the points
        are always in double precision.
    correction : {"tensor", "scalar", "none"}, optional
        Correction of incomplete horizons in bond forces: theory (21), the paper's (24)-(25), or
        nothing. By default "tensor" if the model allows it.
    rotation : {"polar", "convected"}, optional
        Rotation of a horizon: from the polar decomposition, which is the default, or by the paper's
        (22)-(23).
    outside : {"fallback", "warn", "raise", "extrapolate"}, optional
        Policy for bonds outside the model's domain: the exact bond force (the default), a warning,
        an error, or nothing. A bond turned by a right angle from its horizon has no features, and
        gets the exact bond force even with "extrapolate".
    breakable : bool
        Whether bonds may break, for which more reference data are kept.
    paths : bool
        Whether branches keep the strain before the last one, by which a step of an equilibrium
        knows how the path bends (`InternalForce.elapse`); forces without branches do not use it.
    plane : {"stress", "strain", "space"}
        Plane stress (free thickness) or plane strain (held thickness) for a body in the plane;
        "space" for every body in three dimensions.

    See Also
    --------
    pdsurrogate.forces.ForceModel.bind : combines a model, a body, a law and settings.

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
    paths: bool = False
    plane: str = "stress"

    def __post_init__(self) -> None:
        for field in fields(self):
            key = field.name
            value = getattr(self, field.name)
            values = SETTINGS.get(key, (True,))
            if value not in (field.default, *values):
                raise ValueError(
                    f"{key} must be one of {', '.join(map(str, values))}, not {value!r}"
                )

    def check(self, name: str, honors: Mapping[str, tuple]) -> None:
        """Check that a model can honor all settings that are given.

        Parameters
        ----------
        name : str
            Name of the model.
        honors : mapping
            Values that the model can honor, by setting; the model does not use a setting that is
            missing here.

        Raises
        ------
        ValueError
            If a setting is not honored; the message names the setting, the model, and the values
            that it accepts.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> try:
        ...     pds.ForceSettings(correction="tensor").check("mine", {"correction": ("none",)})
        ... except ValueError as error:
        ...     print(error)
        mine does not support correction=tensor; it supports correction=none
        """
        for field in fields(self):
            key = field.name
            value = getattr(self, field.name)
            # The default of every setting but the plane is a value that all models accept.
            usual = value == field.default and (key != "plane" or key not in honors)
            if usual or key not in SETTINGS or value in honors.get(key, ()):
                continue
            where = WHERE[self.plane] if key != "plane" else ""
            taken = {key: honors[key]} if key in honors else honors
            words = (
                ", ".join(_words(key, *values) for key, values in taken.items())
                or "none of these settings"
            )
            others = OTHERS if key == "plane" else {}
            advice = f"; {others[value]}" if value in others else ""
            raise ValueError(
                f"{name} does not support {_words(key, value)}{where}; it supports {words}{advice}"
            )

    def check_body(self, body: Body) -> None:
        """Raise ValueError for a body whose dimension does not match `plane`.

        Parameters
        ----------
        body : Body

        Raises
        ------
        ValueError
            For a solid under plane stress or in plane strain, or a sheet with "space".

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.ForceSettings(plane="strain").check_body(pds.Body.rectangle(1.0, 1.0, 0.25, 0.7875))
        """
        if body.dimension != dimension_of(self.plane):
            right = "plane=stress or plane=strain" if body.dimension == 2 else "plane=space"
            raise ValueError(
                f"plane={self.plane} needs a {dimension_of(self.plane)}D body, but this one is"
                f" {body.dimension}D: use {right}"
            )


def _words(key: str, *values) -> str:
    """Return a setting and its values in words."""
    return "bonds that break (fracture)" if key == "breakable" else f"{key}={'|'.join(values)}"
