"""Parts of a scene, such as its material, grips and units, and all keys of a scene."""

import dataclasses
import warnings
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    field_validator,
    model_serializer,
    model_validator,
)

from ..arguments import check_known
from ..kernels.weights import WEIGHT_FUNCTIONS
from ..materials import LAWS, Branch, Law, Memory, Softening
from ..materials.memory import from_prony
from .loading import DynamicsSettings, Load, Prescribed, Probe, Step
from .obstacles import Obstacle
from .regions import EDGES, Face, Region, RegionName, RegionReference, reserved_names
from .shapes import Mesh
from .solids import AnyBody, AnyPrecut, AnyShape
from .strength import Strength
from .strict_model import MEASURED, Finite, Positive, StrictModel, Vector, Whole, refused, the_one

SceneName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._-]{0,63}$")]
"""Name of a scene, after which result files are named: no path, and no character with a meaning
to a terminal or a shell.
"""

UnitName = Annotated[str, Field(pattern=r"^[\w/^*. -]{1,16}$")]

Level = Annotated[Positive, Field(le=100)]
"""Stretch between grips, up to 100; rubber breaks below 10."""

USUAL: dict[str, dict[int, Any]] = {
    "plane": {2: "stress", 3: "space"},
    "horizon_ratio": {2: 3.15, 3: 1.75},
}
"""Defaults of two keys of a scene by the dimension of the body. The horizon of 3.15 spacings is the
paper's, above three so that rounding does not decide which points lie within. In three dimensions
short horizons are more accurate and cheaper: 26 bonds.
"""

RIGID = "rigid"
"""Text that a scene gives in the place of a material law for a region that moves as one rigid
body.
"""


class BranchSpec(StrictModel):
    """Viscoelastic branch of a material.

    Parameters
    ----------
    modulus : float
        Shear modulus that the branch adds in fast motions. Unit: stress.
    time : float, optional
        Relaxation time. Unit: time.
    times : list of pair of float, optional
        Instead of `time`: overstresses and relaxation times at them, which do not rise. Between
        two of them the time is a power of the overstress; the first one holds below, the last one
        above. The overstress is the root of half the trace of the square of the branch's deviatoric
        Kirchhoff stress; in small simple shear it is the shear stress. Unit: stress, time.
    """

    modulus: Positive
    time: Positive | None = None
    times: tuple[tuple[Positive, Positive], ...] = ()

    @model_validator(mode="after")
    def _of_one_form(self) -> Self:
        if (self.time is None) == (not self.times):
            raise ValueError("give a branch either a time or times at overstresses")
        self.build()
        return self

    @model_serializer(mode="wrap")
    def _without_the_other_form(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {key: value for key, value in dump(self).items() if value}

    def build(self) -> Branch:
        """Return the branch.

        Raises
        ------
        ValueError
            For times at overstresses that do not rise, or that rise themselves.
        """
        return Branch(self.modulus, self.time or self.times[0][1], self.times)


class SofteningSpec(StrictModel):
    """Softening of a material below its greatest isochoric energy so far (Mullins), by Ogden and
    Roxburgh's factor.

    Parameters
    ----------
    r : float
        The stress falls by up to 1/r of its value. Unit: none.
    m : float
        Energy below the greatest one within which the stress falls. Unit: stress.
    beta : float
        Share of the greatest energy that adds to `m`. Unit: none.
    """

    r: Annotated[Finite, Field(ge=1)]
    m: Annotated[Finite, Field(ge=0)]
    beta: Annotated[Finite, Field(ge=0)] = 0.0


MEMORY = "branches", "prony", "softening"
"""Keys of a material that state its memory."""


class MaterialSpec(StrictModel):
    """Material in a scene: the name of a material law with its parameters, ``"rigid"``, or the
    artifact from which a run takes it.

    Parameters
    ----------
    law : str
        Name of a law, or ``"rigid"``.
    artifact : str, optional
        In the place of all others: artifact whose card has law and parameters, in the units of
        their tests, which a run converts to those of the scene. The numbers of `fracture` that are
        ``"artifact"`` are then those of this card. The force may be another one, such as
        ``bond-energy``.
    branches : list of BranchSpec
        Viscoelastic branches beside the elastic energy. In equilibrium they need the `times` of
        `stretches`, or a `duration` of steps.
    prony : list of pair of float
        Branches as a Prony series: pairs of a ratio and a relaxation time. A ratio is the modulus
        of the branch over that of fast motions, which `shear_modulus` and the moduli of all
        branches add up to. Unit: none, time.
    softening : SofteningSpec, optional
        Softening below the greatest energy so far.
    **extra_data : float or list of float
        Parameters of the law. ``card`` in the place of `law` is the path of a file with a material
        card of another program, ``name`` a material in it; other parameters replace its own.
        ``convention`` is another program, whose names the constants have: see the guide.
    """

    model_config = ConfigDict(extra="allow", frozen=True)

    law: str
    artifact: str | None = None
    branches: tuple[BranchSpec, ...] = ()
    prony: tuple[tuple[Positive, Positive], ...] = ()
    softening: SofteningSpec | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_name(cls, value: Any) -> Any:
        if isinstance(value, Law):  # in Python: as a regressor has found it
            return value.describe()
        if isinstance(value, Mapping) and ("card" in value or "convention" in value):
            return _of_program(dict(value))
        if isinstance(value, Mapping) and "artifact" in value:
            if len(value) > 1:
                other = next(key for key in value if key != "artifact")
                raise ValueError(f"the material is that of the artifact: leave {other} out")
            return {"law": "", **value}
        return {"law": value} if isinstance(value, str) else value

    @model_serializer(mode="wrap")
    def _without_empty_memory(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out what an elastic material does not have."""
        left = (*MEMORY, "artifact", "law")
        return {key: value for key, value in dump(self).items() if value or key not in left}

    def model_post_init(self, _) -> None:
        if self.artifact is not None:
            return
        if self.rigid:
            given = [key for key in MEMORY if getattr(self, key)] + list(self.model_extra or {})
            if given:
                raise ValueError(f"{RIGID} has no parameters; remove {given[0]}")
            return
        if self.branches and self.prony:
            raise ValueError("branches and prony are two forms of one thing; give one")
        law = self.build()
        for key in ("shear_modulus", "bulk_modulus"):
            value = getattr(law, key)
            # Forces and their squares, which norms need, then neither overflow nor vanish in double
            # precision at any spacing that is allowed.
            if not 1e-30 <= value <= 1e30:
                raise ValueError(
                    f"{key} is {value:g}, outside the supported range from 1e-30 to 1e+30; use"
                    " another unit of stress"
                )

    @property
    def rigid(self) -> bool:
        """Return whether the material is ``"rigid"``: it has no law, and its region moves as one
        rigid body.
        """
        return self.law == RIGID

    def build(self) -> Law:
        """Return the material law with the parameters given.

        Raises
        ------
        ValueError
            For an unknown law, an unknown or missing parameter, a value that makes no sense, or a
            material that a run takes from an artifact.
        """
        if self.artifact is not None:
            raise ValueError(f"it is that of the artifact {self.artifact}, which only runs read")
        check_known(self.law, sorted(LAWS), f"unknown law {self.law!r}")
        law = LAWS[self.law]
        known = law.defaults()
        given: dict[str, Any] = {}
        for key, value in (self.model_extra or {}).items():
            check_known(key, sorted(known), f"{self.law} has no parameter {key!r}", "it has")
            listed = isinstance(value, list | tuple)
            if any(
                isinstance(number, bool) or not isinstance(number, int | float)
                for number in (value if listed else [value])
            ):
                raise ValueError(f"{key} must be a number, not {value!r}")
            try:
                given[key] = tuple(map(float, value)) if listed else float(value)
            except OverflowError:
                raise ValueError(f"{key} is too large a number") from None
        try:
            built = law(**given)
        except TypeError:
            raise ValueError(
                f"{self.law}: a parameter is a list instead of a number, or a number instead of a"
                " list"
            ) from None
        branches = tuple(each.build() for each in self.branches)
        softening = Softening(**self.softening.model_dump()) if self.softening else None
        memory = Memory(branches or from_prony(built.shear_modulus, self.prony), softening)
        return dataclasses.replace(built, memory=memory)

    @property
    def remembers(self) -> bool:
        """Return whether the material has branches or softening.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.load_scene("uniaxial").material.remembers
        False
        """
        return bool(self.branches or self.prony or self.softening)


def _of_program(given: dict[str, Any]) -> dict[str, Any]:
    """Return the keys of a material that is stated as another program states it: with a ``card`` in
    a file, or with constants whose names are those of the ``convention``.
    """
    own = {key: given.pop(key) for key in (*MEMORY, "bulk_modulus") if key in given}
    if "card" in given:
        from ..cards.reading import read_card

        source = str(given.pop("card"))
        keys, _, remarks = read_card(source, str(given.pop("name", "")))
        for remark in remarks:
            warnings.warn(f"{source}: {remark}", stacklevel=2)
        if "law" in given:
            raise ValueError("card states the law; remove law")
        keys |= given
    else:
        from ..cards.programs import keys_of_constants

        source = str(given.pop("convention"))
        keys = keys_of_constants(source, str(given.pop("law", "")), given)
        if "bulk_modulus" in own and "bulk_modulus" in keys:
            raise ValueError("the constants state a bulk modulus: leave bulk_modulus out")
    keys |= own
    if "bulk_modulus" not in keys:
        raise ValueError(f"{source} states no bulk modulus: give bulk_modulus")
    return keys


class Criterion(StrictModel):
    """Fracture of bonds beyond a critical stretch, given by either `critical_stretch` or `energy`.

    Parameters
    ----------
    critical_stretch : float, optional
        Stretch of a bond beyond which it breaks permanently. Unit: none.
    energy : float or "artifact", optional
        Fracture energy per undeformed area of crack; ``"artifact"`` for the mean of the tear tests
        behind the artifact that is the material or the force of the run.
        `pdsurrogate.critical_stretch_of` converts it with the effective diameter of a crack tip,
        and the package rejects it if no diameter was measured for the force model, the plane, the
        arrangement of the points and `horizon_ratio`.
        Unit: stress length.
    strength : Strength, optional
        Strength without a cut, needs `energy`: bonds then break where this strength is exceeded in
        the mean over a region, and beyond the critical stretch only at cuts and cracks.
    """

    critical_stretch: Annotated[Finite, Field(gt=1)] | None = None
    energy: Annotated[Positive, *MEASURED] | None = None
    strength: Strength | None = None

    def model_post_init(self, _) -> None:
        the_one(self, ("critical_stretch", "energy"))
        if self.strength is not None and self.energy is None:
            raise ValueError(
                "strength needs energy in place of critical_stretch: their ratio is the size of the"
                " region over which the strength must be exceeded in the mean"
            )


class InterfaceFracture(Criterion):
    """Fracture of the bonds that cross from one material to another, given by either
    `critical_stretch` or `energy`.

    Between materials with different laws or parameters, `critical_stretch` alone: no crack tips
    were measured there.

    Parameters
    ----------
    between : pair of str
        Names of the two materials: the name of the region of an entry of `materials`,
        ``"materials.N"`` (counted from 0) for a region without a name, or ``"rest"`` for the
        material of the rest of the body.
    critical_stretch : float, optional
        Stretch of a bond beyond which it breaks permanently. Unit: none.
    energy : float or "artifact", optional
        Fracture energy per undeformed area of crack; ``"artifact"`` for the mean of the tear tests
        behind the artifact that is the material or the force of the run.
        `pdsurrogate.critical_stretch_of` converts it with the effective diameter of a crack tip,
        and the package rejects it if no diameter was measured for the force model, the plane, the
        arrangement of the points and `horizon_ratio`.
        Unit: stress length.
    strength : Strength, optional
        Strength without a cut, needs `energy`: bonds then break where this strength is exceeded in
        the mean over a region, and beyond the critical stretch only at cuts and cracks.
    """

    between: tuple[str, str]

    def model_post_init(self, context: Any) -> None:
        super().model_post_init(context)
        if self.strength is not None and self.strength.scatter is not None:
            raise ValueError("strength.scatter is one of materials, not of an interface")


class Fracture(Criterion):
    """Fracture of bonds beyond a critical stretch, given by either `critical_stretch` or `energy`.

    Parameters
    ----------
    critical_stretch : float, optional
        Stretch of a bond beyond which it breaks permanently. Unit: none.
    energy : float or "artifact", optional
        Fracture energy per undeformed area of crack; ``"artifact"`` for the mean of the tear tests
        behind the artifact that is the material or the force of the run.
        `pdsurrogate.critical_stretch_of` converts it with the effective diameter of a crack tip,
        and the package rejects it if no diameter was measured for the force model, the plane, the
        arrangement of the points and `horizon_ratio`.
        Unit: stress length.
    strength : Strength, optional
        Strength without a cut, needs `energy`: bonds then break where this strength is exceeded in
        the mean over a region, and beyond the critical stretch only at cuts and cracks.
    interfaces : list of InterfaceFracture
        Pairs of materials whose common interface has a fracture energy or critical stretch of its
        own. Bonds between other materials break at the smaller of the critical stretches of the
        two.
    process : {"dynamics", "quasi-static"}, optional
        How the body tears: ``"dynamics"`` with inertia, from the last equilibrium on;
        ``"quasi-static"`` in equilibrium throughout, in which the settings of dynamics only say how
        far, with how many outputs, and in which time the loading goes. By default in dynamics if
        the scene has any, and its held parts move at a thousandth of the speed of shear waves or
        faster, or loads or obstacles drive the body.
    """

    interfaces: tuple[InterfaceFracture, ...] = ()
    process: Literal["dynamics", "quasi-static"] | None = None


class Part(StrictModel):
    """Region of the body that is rigid, or has another material than the rest of the body.

    Parameters
    ----------
    region : str or Region
        Where the body has this material.
    material : MaterialSpec or str
        The material or the name of its law; ``"rigid"`` for a region that moves as one body.
    force : str, optional
        Artifact that is the force model of this material. By default the force model of the rest of
        the body, or, if that model is a surrogate, the surrogate of this material's law.
    fracture : Criterion, optional
        When bonds within this material break; by default as in the rest of the body. Needs
        `fracture` of the scene.

    See Also
    --------
    pdsurrogate.Region : region of a body.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> part = pds.Part(region="stiff", material={"law": "neo-hookean", "shear_modulus": 10.0})
    >>> part.material.build().shear_modulus
    10.0
    """

    region: RegionReference
    material: MaterialSpec
    force: str | None = None
    fracture: Criterion | None = None

    def model_post_init(self, _) -> None:
        for key in ("force", "fracture"):
            if self.material.rigid and getattr(self, key) is not None:
                raise ValueError(
                    f"{key} does not apply to a rigid region, which is not deformed: leave it out"
                )


class Grip(StrictModel):
    """Grip along one edge of the body, or face of a solid.

    Parameters
    ----------
    edge : {"left", "right", "bottom", "top", "back", "front"}
        Edge of the bounding box; ``"back"`` and ``"front"`` are faces of solids, normal to x3.
    holds : {"all", "normal"}
        Components that the grip holds: ``"all"`` for a clamp, ``"normal"`` for a roller, along
        which the edge may slide.
    travel : float
        Share of the elongation of the body by which this grip moves outward; the shares of both
        grips add up to 1. Unit: none.
    """

    edge: Face
    holds: Literal["normal", "all"] = "all"
    travel: Annotated[Finite, Field(ge=0, le=1)] = 0.0


class Hold(StrictModel):
    """Points that are held besides the grips, given by either `box` or `points`.

    Parameters
    ----------
    box : pair of points, optional
        Two opposite corners of a box that contains the points, the first with the least
        coordinates. Unit: length.
    points : list of int, optional
        Numbers of the points, from 0.
    components : list of {"x1", "x2", "x3"}, optional
        Components of the displacement that are held; by default all.
    travel : vector, optional
        Displacement of the points, divided by the elongation of the body; by default they stay in
        place. Unit: none.
    """

    box: tuple[Vector, Vector] | None = None
    points: tuple[Annotated[Whole, Field(ge=0)], ...] | None = None
    components: Annotated[tuple[Literal["x1", "x2", "x3"], ...] | None, Field(min_length=1)] = None
    travel: Vector | None = None

    def model_post_init(self, _) -> None:
        the_one(self, ("box", "points"))
        for name, along in zip(("x1", "x2", "x3"), self.travel or (), strict=False):
            if along and name not in (self.components or (name,)):
                raise ValueError(
                    f"travel moves the points along {name}, which is not among the components"
                    " that are held: add it, or set its travel to 0"
                )


class SolverSpec(StrictModel):
    """Settings of the solver for equilibrium.

    Parameters
    ----------
    method : {"automatic", "minimizer", "quasi-newton", "relaxation", "explicit", "newton"}
        Method: ``"automatic"`` chooses between the next three; ``"minimizer"`` minimizes the
        energy, which the force must have; ``"quasi-newton"`` is L-BFGS on the residual force;
        ``"relaxation"`` is adaptive dynamic relaxation; ``"explicit"`` is damped explicit stepping
        with a fixed time step, as in the paper; ``"newton"`` continues ``"automatic"`` with
        Newton's method to tolerances down to 1e-10, and needs ``precision = "float64"``.
    tolerance : float
        Greatest residual: the largest force per volume on a free component, times the spacing,
        divided by the shear modulus. Unit: none.
    most_evaluations : int
        Greatest number of force evaluations in the search for one equilibrium.
    largest_increment : float
        With grips the greatest change of the stretch between two equilibria. With steps the
        greatest strain of a bond in a first guess, by which increments are limited; at 1 a bond
        would vanish. Unit: none.
    """

    method: Literal[
        "automatic", "minimizer", "quasi-newton", "relaxation", "explicit", "newton"
    ] = "automatic"
    tolerance: Annotated[Positive, Field(le=1e-2)] = 1e-6
    most_evaluations: Annotated[Whole, Field(gt=0)] = 50_000
    largest_increment: Annotated[Finite, Field(ge=1e-4)] = 0.5


class Dynamics(DynamicsSettings):
    """Explicit dynamics from the last equilibrium on, while the grips move apart at a constant
    rate.

    Parameters
    ----------
    stretch : float
        Stretch at which the run ends, unless the body separates before; greater than the last of
        `stretches`. Unit: none.
    stretch_rate : float
        Change of the stretch per unit time. Unit: 1/time.
    outputs : int
        Number of states that are recorded at equal intervals of time.
    """

    pace: ClassVar[str] = "stretch_rate"
    """Name of the setting that sets how fast the loading parameter changes."""

    stretch: Level
    stretch_rate: Positive
    outputs: Annotated[Whole, Field(ge=1, le=10_000)] = 30


_OneOrMany = BeforeValidator(
    lambda value: (value,) if isinstance(value, int | float | dict) else value
)
"""Validator that turns a single entry into a tuple with this entry."""


_known_weight = refused(
    lambda name: name not in WEIGHT_FUNCTIONS,
    f"unknown weight function; there are {', '.join(WEIGHT_FUNCTIONS)}",
)


def _dimension_of(data: Mapping[str, Any]) -> int:
    """Return the dimension of the body in the fields of a scene that is being validated; 2 if
    the body was invalid.
    """
    return data["body"].dimension if "body" in data else 2


def with_unit(what: str, unit: str | None) -> str:
    """Return the name of a quantity with its unit, if it has one, as in print: "force (kPa·cm²)"
    for the unit "kPa cm^2".
    """
    return (
        f"{what} ({unit.replace(' ', '·').replace('^2', '²').replace('^3', '³')})" if unit else what
    )


class Units(StrictModel):
    """Names of the units of a scene. Values are not converted, and quantities without a named unit
    are shown without one.

    Parameters
    ----------
    length : str, optional
        Name of the unit of length, such as ``"mm"``.
    stress : str, optional
        Name of the unit of stress, such as ``"MPa"``.
    time : str, optional
        Name of the unit of time, such as ``"s"``.
    """

    length: UnitName | None = None
    stress: UnitName | None = None
    time: UnitName | None = None

    def _times_length(self, power: int) -> str:
        """Return the unit of length to a power, one less in the plane, after a blank; empty for
        the power 0.
        """
        power -= isinstance(self, _UnitsPerThickness)
        return f" {self.length}" + (f"^{power}" if power > 1 else "") if power else ""

    @property
    def force(self) -> str | None:
        """Return the unit of forces, stress times length^2, in the plane stress times length;
        None if either unit has no name.
        """
        return self.stress + self._times_length(2) if self.stress and self.length else None

    @property
    def area(self) -> str | None:
        """Return the unit of areas, length^2, in the plane length; None if the unit of length
        has no name.
        """
        return self.length and self._times_length(2).strip()

    @property
    def energy(self) -> str | None:
        """Return the unit of energies and moments, stress times length^3, in the plane length^2;
        None if either unit has no name.
        """
        return self.stress + self._times_length(3) if self.stress and self.length else None

    def label(self, what: str, kind: str) -> str:
        """Return the name `what` of a quantity with its unit in brackets, for headers and axes;
        `kind` is "length" or "force", say.
        """
        return with_unit(what, getattr(self, kind))

    def amount(self, number: float | str, kind: str, form: str = "", power: str = "") -> str:
        """Return a number, or text such as "0 to 2", followed by the unit of its `kind` ("length",
        say) and a power such as "^2".

        `form` is the format specification of the number, such as ".4g".
        """
        unit = getattr(self, kind)
        return f"{number:{form}} {unit}{power}" if unit else f"{number:{form}}"


class _UnitsPerThickness(Units):
    """Names of the units of a body in the plane, whose forces, areas and energies are those per
    thickness.
    """


class SceneData(StrictModel):
    """Keys of a scene, before checks that its parts fit together."""

    name: SceneName
    title: str = ""
    # Volumes of cells, 1e-36 to 1e36, are normal numbers in single precision.
    spacing: Annotated[Positive, Field(ge=1e-12, le=1e12)] | None
    stretches: Annotated[tuple[Level, ...], _OneOrMany] = ()
    times: Annotated[tuple[Annotated[Finite, Field(ge=0)], ...], _OneOrMany] = ()
    body: AnyBody
    holes: tuple[AnyShape, ...] = ()
    precuts: tuple[AnyPrecut, ...] = ()
    plane: Literal["stress", "strain", "space"] = Field(None, validate_default=True)
    material: MaterialSpec | None = None
    materials: tuple[Part, ...] = ()
    grips: tuple[Grip, ...] = ()
    holds: tuple[Hold, ...] = ()
    regions: Annotated[dict[RegionName, Region], Field(default_factory=dict)]
    prescribed: tuple[Prescribed, ...] = ()
    loads: tuple[Load, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    steps: Annotated[tuple[Step, ...], _OneOrMany] = ()
    probes: tuple[Probe, ...] = ()
    support: Literal["reflected", "points"] = "reflected"
    horizon_ratio: Annotated[Finite, Field(gt=1, le=100)] = Field(None, validate_default=True)
    weight: Annotated[str, AfterValidator(_known_weight)] = "inverse"
    correction: Literal["tensor", "scalar", "none"] | None = None
    rotation: Literal["polar", "convected"] | None = None
    precision: Literal["float32", "float64"] | None = None
    outside: Literal["fallback", "warn", "raise", "extrapolate"] | None = None
    solver: SolverSpec = SolverSpec()
    fracture: Fracture | None = None
    dynamics: Dynamics | None = None
    units: Annotated[Units, Field(validate_default=True)] = Units()
    reference: Literal["uniaxial", "finite-elements"] | None = None

    @field_validator("plane", "horizon_ratio", mode="before")
    @classmethod
    def _usual(cls, value: Any, info: ValidationInfo) -> Any:
        """Return the value given for `plane` or `horizon_ratio`, or else its default for the
        dimension of the body.
        """
        return USUAL[str(info.field_name)][_dimension_of(info.data)] if value is None else value

    @field_validator("units")
    @classmethod
    def _of_the_body(cls, value: Units, info: ValidationInfo) -> Units:
        return _UnitsPerThickness(**value.model_dump()) if _dimension_of(info.data) == 2 else value

    @field_validator("regions")
    @classmethod
    def _free_names(cls, value: dict, info: ValidationInfo) -> dict:
        for name in value:
            if name in reserved_names(_dimension_of(info.data)):
                raise ValueError(f"{name} is the name of a predefined region; choose another name")
        return value

    @property
    def dimension(self) -> int:
        """Return the dimension of the body, 2 or 3.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.load_scene("uniaxial").dimension
        2
        """
        return self.body.dimension

    @property
    def stretched(self) -> bool:
        """Return whether grips and stretches define the loading.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.load_scene("uniaxial").stretched
        True
        """
        return bool(self.grips)

    @property
    def remembers(self) -> bool:
        """Return whether a material of the scene has branches or softening.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.load_scene("uniaxial").remembers
        False
        """
        specs = [self.material, *(part.material for part in self.materials)]
        return any(spec is not None and spec.remembers for spec in specs)

    @property
    def loaded_axis(self) -> int:
        """Return the axis along which grips pull the body: 0 for x1, 1 for x2, 2 for x3.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.load_scene("uniaxial").loaded_axis
        0
        """
        return EDGES[self.grips[0].edge][0]

    @model_validator(mode="before")
    @classmethod
    def _spacing_of_a_mesh(cls, value: Any) -> Any:
        """Return the keys of a scene before validation, with ``spacing`` None if the body is a
        mesh and no spacing is given.
        """
        body = value.get("body") if isinstance(value, Mapping) else None
        meshed = isinstance(body, Mesh) or (isinstance(body, dict) and body.get("shape") == "mesh")
        return {"spacing": None, **value} if meshed else value


def entries_of(scene: SceneData, *keys: str) -> Iterator[tuple[str, Any]]:
    """Yield each entry of the lists `keys` of a scene, preceded by its dotted key, such as
    ``loads.0``.
    """
    for key in keys:
        yield from ((f"{key}.{number}", entry) for number, entry in enumerate(getattr(scene, key)))
