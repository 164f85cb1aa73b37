"""Loading in a scene: grips and prescriptions, loads, steps and probes."""

import re
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from .amplitudes import Amplitude
from .regions import RegionReference
from .strict_model import Finite, Positive, SpaceDirection, StrictModel, Vector, Whole, the_one

CONTROLLED = r"^probes\.(.+)\.displacement\.([0-2])$"
"""Pattern of the key of a displacement that a step can control: name of the probe, and
component.
"""

LoadName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]


class Prescribed(StrictModel):
    """Prescribed displacements of a region: for each component a value times an amplitude;
    components without a value are free.

    If the region is given by ``near`` (see `pdsurrogate.Region`) and several points are equally
    near, their mean displacement is prescribed. A rotation prescribes all components; the
    displacements x1, x2 and x3 are added to it.

    Parameters
    ----------
    region : str or Region
        What is held or moved.
    x1, x2, x3 : float, optional
        Displacement at amplitude 1 along this axis; 0 holds the component. Bodies in the plane have
        no x3. Unit: length.
    rotation : float, optional
        Angle at amplitude 1 by which the region is turned, counter-clockwise seen from where the
        axis points to. Unit: degrees.
    about : point, optional
        Center of the rotation. Unit: length.
    axis : vector, optional
        Direction of the axis of the rotation of a solid, of any length. Unit: none.
    amplitude : str or table
        Factor of the values, as a function of the loading parameter t. Unit: none.
    name : str, optional
        Name under which results report the force; by default the name of the region.

    See Also
    --------
    pdsurrogate.Region : region of a body.
    pdsurrogate.Load : forces instead of displacements.
    pdsurrogate.Step : step of the loading parameter.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.Prescribed(region="right", x1=0.5, x2=0.0).displacement
    (0.5, 0.0, None)
    """

    region: RegionReference
    x1: Finite | None = None
    x2: Finite | None = None
    x3: Finite | None = None
    rotation: Finite | None = None
    about: Vector | None = None
    axis: SpaceDirection | None = None
    amplitude: Amplitude = "ramp"
    name: LoadName | None = None

    def model_post_init(self, _) -> None:
        if all(value is None for value in (*self.displacement, self.rotation)):
            raise ValueError(
                "needs at least one of x1, x2, x3 (solids) and rotation; 0 holds a component"
            )
        if (self.rotation is None) != (self.about is None):
            raise ValueError(
                "rotation and about (the place to rotate about) must be given together"
            )
        if self.axis is not None and self.rotation is None:
            raise ValueError("axis, the direction of the axis of a rotation, needs rotation")

    @property
    def displacement(self) -> tuple[float | None, float | None, float | None]:
        """Prescribed displacements x1, x2 and x3 at amplitude 1; None for a component without a
        value.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.Prescribed(region="left", x1=0.0).displacement
        (0.0, None, None)
        """
        return self.x1, self.x2, self.x3


class Load(StrictModel):
    """Load on a region, times an amplitude: exactly one of a traction, a pressure, a body force and
    a total force.

    Parameters
    ----------
    region : str or Region
        Where the load acts. Only a body force may leave it out: it then acts on the whole body.
    traction : vector, optional
        Force per undeformed area of the boundary, of constant direction. Unit: stress.
    pressure : float, optional
        Pressure on the deformed boundary, whose normal it follows; a positive value pushes into the
        body. Unit: stress.
    body_force : vector, optional
        Force per undeformed volume. Unit: stress/length.
    force : vector, optional
        Total force on the points of the region, shared equally among them; in the plane per unit
        thickness. Unit: force.
    thickness : {"deformed", "undeformed"}, optional
        For a pressure under plane stress: whether it acts on the deformed thickness of the sheet
        (true pressure, the default), or on the undeformed thickness.
    amplitude : str or table
        Factor of the load, as a function of the loading parameter t. Unit: none.
    name : str, optional
        Name under which results report the force of the load; by default the name of the region.

    See Also
    --------
    pdsurrogate.Region : region of a body.
    pdsurrogate.Prescribed : displacements instead of forces.
    pdsurrogate.Step : step of the loading parameter.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.Load(region="right", traction=(0.2, 0.0)).kind
    'traction'
    """

    kinds: ClassVar[tuple[str, ...]] = ("traction", "pressure", "body_force", "force")

    region: RegionReference = "body"
    traction: Vector | None = None
    pressure: Finite | None = None
    body_force: Vector | None = None
    force: Vector | None = None
    thickness: Literal["deformed", "undeformed"] | None = None
    amplitude: Amplitude = "ramp"
    name: LoadName | None = None

    @property
    def kind(self) -> str:
        """Return the kind of the load: ``traction``, ``pressure``, ``body_force`` or ``force``.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.Load(region="left", pressure=0.1).kind
        'pressure'
        """
        return the_one(self, self.kinds)

    def model_post_init(self, _) -> None:
        if self.kind != "body_force" and "region" not in self.model_fields_set:
            raise ValueError(f"a {self.kind} needs the region on which it acts")
        if self.thickness is not None and self.kind != "pressure":
            raise ValueError("thickness applies to a pressure only")


class DynamicsSettings(StrictModel):
    """Settings of explicit dynamics, common to `StepDynamics` (during a step) and `Dynamics` (after
    the last stretch in equilibrium).

    Parameters
    ----------
    density : float
        Mass per undeformed volume; with kPa, cm and s, 1e-4 is 1000 kg/m^3. Unit: stress
        time^2/length^2.
    damping : float
        Rate c in the equation of motion M (a + c v) = f (masses M, accelerations a, velocities v,
        forces f). Unit: 1/time.
    viscosity : float, optional
        Retardation time of a Kelvin-Voigt solid. It damps waves as short as a bond, which arise
        where material unloads behind a crack. By default 0.7 spacings divided by the speed of shear
        waves with fracture, else 0. Unit: time.
    safety : float
        Time step divided by the critical time step. The default stays stable if the tangent becomes
        twice as stiff between two estimates of the highest frequency (0.7^2 = 1/2). Unit: none.
    """

    density: Positive
    damping: Annotated[Finite, Field(ge=0)] = 0.0
    viscosity: Annotated[Finite, Field(ge=0)] | None = None
    safety: Annotated[Positive, Field(le=1)] = 0.7


class StepDynamics(DynamicsSettings):
    """Explicit dynamics during a step of the loading program.

    Parameters
    ----------
    density : float
        Mass per undeformed volume; with kPa, cm and s, 1e-4 is 1000 kg/m^3. Unit: stress
        time^2/length^2.
    damping : float
        Rate c in the equation of motion M (a + c v) = f (masses M, accelerations a, velocities v,
        forces f). Unit: 1/time.
    viscosity : float, optional
        Retardation time of a Kelvin-Voigt solid. It damps waves as short as a bond, which arise
        where material unloads behind a crack. By default 0.7 spacings divided by the speed of shear
        waves with fracture, else 0. Unit: time.
    safety : float
        Time step divided by the critical time step. The default stays stable if the tangent becomes
        twice as stiff between two estimates of the highest frequency (0.7^2 = 1/2). Unit: none.
    duration : float
        Duration of the step, in which the loading parameter changes linearly. Unit: time.

    See Also
    --------
    pdsurrogate.Step : step that takes these settings.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.Step(to=2.0, dynamics=pds.StepDynamics(duration=0.5, density=1e-4)).dynamics.duration
    0.5
    """

    pace: ClassVar[str] = "duration"
    """Name of the setting that sets how fast the loading parameter changes."""

    duration: Positive


class Step(StrictModel):
    """Step of the loading program, which moves the loading parameter t from its present value to
    `to`, in equilibrium or in dynamics.

    Parameters
    ----------
    to : float
        Value of t at the end of the step. An unchanged value holds the body; a smaller value
        unloads it. Unit: none.
    outputs : int
        Number of states that are recorded at equal intervals of t or time, the last at the end of
        the step.
    largest_increment : float, optional
        Greatest change of t between two equilibria. Unit: none.
    dynamics : StepDynamics, optional
        Settings of explicit dynamics; without them the step is in equilibrium.
    duration : float, optional
        Time that a step in equilibrium takes, in which t changes linearly; 0 is a sudden change.
        Materials with branches need it. Either all steps in equilibrium have a duration or none.
        Unit: time.
    control : str, optional
        Component of the displacement of a probe, such as ``"probes.tip.displacement.0"``
        (components count from 0), that the step changes in place of t. `to` and `largest_increment`
        are then displacements, and t, the factor of the loads, is found: loads can be followed
        beyond their maximum, like the pressure in a balloon.

    See Also
    --------
    pdsurrogate.StepDynamics : settings of explicit dynamics during a step.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.Step(to=1.0, outputs=5).outputs
    5
    """

    to: Finite
    outputs: Annotated[Whole, Field(ge=1, le=10_000)] = 1
    largest_increment: Positive | None = None
    dynamics: StepDynamics | None = None
    duration: Annotated[Finite, Field(ge=0)] | None = None
    control: Annotated[str, Field(pattern=CONTROLLED)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_number(cls, value):
        return (
            {"to": value}
            if isinstance(value, int | float) and not isinstance(value, bool)
            else value
        )

    def model_post_init(self, _) -> None:
        if self.dynamics is not None and self.largest_increment is not None:
            raise ValueError("largest_increment does not apply to a step in dynamics: leave it out")
        if self.dynamics is not None and self.duration is not None:
            raise ValueError(
                "duration is that of a step in equilibrium: give dynamics.duration alone"
            )
        if self.dynamics is not None and self.control is not None:
            raise ValueError("control does not apply to a step in dynamics: leave it out")

    @property
    def kind(self) -> str:
        """Return the key that tells apart the kinds of steps: ``control`` for one that controls a
        displacement, else ``dynamics``.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.Step(to=0.5, control="probes.tip.displacement.0").kind
        'control'
        """
        return "dynamics" if self.control is None else "control"


def controlled_place(control: str) -> tuple[str, int]:
    """Return the probe and the component of its displacement that a step controls."""
    _, name, component, _ = re.split(CONTROLLED, control)
    return name, int(component)


class Probe(StrictModel):
    """A place in the undeformed body whose displacement, stress and deformation gradient are
    reported at every output.

    Parameters
    ----------
    name : str
        Name of the probe in results: letters, digits and ``_.-``, at most 64 characters.
    at : point
        The place. Unit: length.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.Probe(name="tip", at=(2.0, 0.5)).name
    'tip'
    """

    name: LoadName
    at: Vector
