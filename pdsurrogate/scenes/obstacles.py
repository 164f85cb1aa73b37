"""Obstacles in a scene: rigid bodies without friction that the boundary of a body cannot enter."""

from typing import ClassVar

from .amplitudes import Amplitude
from .loading import LoadName
from .regions import Ball, Disc, HalfPlane, HalfSpace
from .strict_model import Finite, Positive, SpaceDirection, SpacePoint, StrictModel, the_one


class Roller(StrictModel):
    """Cylinder of infinite length, in three dimensions.

    Parameters
    ----------
    center : point
        A place on the axis. Unit: length.
    axis : vector
        Direction of the axis, of any length. Unit: none.
    radius : float
        Radius. Unit: length.
    """

    center: SpacePoint
    axis: SpaceDirection
    radius: Positive


class Obstacle(StrictModel):
    """Rigid obstacle without friction, fixed or with a prescribed displacement; it has exactly one
    shape, and the body lies outside it.

    Parameters
    ----------
    half_plane : HalfPlane, optional
        Obstacle with a straight side, for a body in the plane; `normal` points into the obstacle,
        away from the body.
    disc : Disc, optional
        Round obstacle, for a body in the plane.
    half_space : HalfSpace, optional
        Obstacle with a flat face, for a solid; `normal` points into the obstacle, away from the
        body.
    ball : Ball, optional
        Sphere, for a solid.
    cylinder : Roller, optional
        Cylinder of infinite length, for a solid.
    x1, x2, x3 : float, optional
        Displacement at amplitude 1 along this axis; 0 without a value. Obstacles in the plane have
        no x3. Unit: length.
    amplitude : str or table
        Factor of the displacement, as a function of the loading parameter t. Unit: none.
    name : str, optional
        Name under which results report force, contact area and penetration; by default
        ``obstacles.0`` and so on.

    See Also
    --------
    pdsurrogate.Prescribed : displacements of a region that is bonded to what moves it.
    pdsurrogate.Step : step of the loading parameter.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> flange = pds.Obstacle(
    ...     half_plane={"point": (0.0, 1.0), "normal": (0.0, 1.0)}, x2=-0.3, name="flange"
    ... )
    >>> flange.shape
    'half_plane'
    """

    shapes: ClassVar[dict[str, int]] = {
        "half_plane": 2,
        "disc": 2,
        "half_space": 3,
        "ball": 3,
        "cylinder": 3,
    }
    """Dimension of the bodies for which a shape is meant."""

    half_plane: HalfPlane | None = None
    disc: Disc | None = None
    half_space: HalfSpace | None = None
    ball: Ball | None = None
    cylinder: Roller | None = None
    x1: Finite = 0.0
    x2: Finite = 0.0
    x3: Finite | None = None
    amplitude: Amplitude = "ramp"
    name: LoadName | None = None

    def model_post_init(self, _) -> None:
        the_one(self, self.shapes)

    @property
    def shape(self) -> str:
        """Return the key of the obstacle's shape, such as ``half_plane``.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.Obstacle(disc={"center": (0.0, 2.0), "radius": 0.5}).shape
        'disc'
        """
        return the_one(self, self.shapes)
