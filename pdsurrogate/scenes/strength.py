"""Strength of a material in a scene: when it tears without a cut."""

from typing import Annotated

from pydantic import Field

from .strict_model import Finite, Positive, StrictModel, the_one


class Strength(StrictModel):
    """Strength of a material without cuts, given by the nominal stress `uniaxial` or the `stretch`
    at which a specimen breaks in uniaxial tension.

    The law of the material turns one into the other, and into the work at break W_b. Bonds break
    where W_b is reached in the mean over a region whose radius follows from the fracture energy and
    W_b; `energy` must be given beside the strength.

    Parameters
    ----------
    uniaxial : float, optional
        Nominal stress at break in uniaxial tension. Unit: stress.
    stretch : float, optional
        Stretch at break in uniaxial tension. Unit: none.
    at_grips : bool
        Whether strength acts at clamped boundaries, too. Where a clamp meets a free boundary the
        law has a singular stress, so that specimens without cuts tear there first. Without it,
        strength does not act within the radius of the region of boundaries and points that are held
        in all directions.

    See Also
    --------
    pdsurrogate.Fracture : criterion of which a strength is a part.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.Fracture(energy=3.0, strength={"stretch": 4.2}).strength.stretch
    4.2
    """

    uniaxial: Positive | None = None
    stretch: Annotated[Finite, Field(gt=1)] | None = None
    at_grips: bool = True

    def model_post_init(self, _) -> None:
        the_one(self, ("uniaxial", "stretch"))
