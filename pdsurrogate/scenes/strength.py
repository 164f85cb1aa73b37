"""Strength of a material in a scene: when it tears without a cut."""

from typing import Annotated

from pydantic import AfterValidator, Field

from .strict_model import (
    MEASURED,
    Finite,
    Positive,
    StrictModel,
    Vector,
    Whole,
    refused,
    the_one,
)


class Scatter(StrictModel):
    """Weibull's distribution of strengths over a body: random factors of squares (cubes in space)
    whose sides are the correlation length, each independent of the others.

    Parameters
    ----------
    modulus : float or "artifact"
        Weibull modulus of the nominal stress at break: about 1.2 over its relative deviation. Unit:
        none.
    length : float
        Correlation length, at least the spacing. Unit: length.
    specimen : vector
        Sides of the uniformly stretched part of the specimens whose mean strength is given: a body
        of this size has this strength in the mean, a larger one less. Unit: length.
    seed : int
        Seed of the factors: another one is another body.
    """

    modulus: Annotated[Positive, *MEASURED]
    length: Positive
    specimen: Annotated[
        Vector, AfterValidator(refused(lambda sides: min(sides) <= 0, "sides must be positive"))
    ]
    seed: Annotated[Whole, Field(ge=0)] = 0


class Strength(StrictModel):
    """Strength of a material without cuts, given by the nominal stress `uniaxial` or the `stretch`
    at which a specimen breaks in uniaxial tension.

    The law of the material turns one into the other, and into the work at break W_b. Bonds break
    where W_b is reached in the mean over a region whose radius follows from the fracture energy and
    W_b; `energy` must be given beside the strength.

    Parameters
    ----------
    uniaxial : float or "artifact", optional
        Nominal stress at break in uniaxial tension; ``"artifact"`` for the mean of the tests behind
        the artifact of the run. Unit: stress.
    stretch : float or "artifact", optional
        Stretch at break in uniaxial tension. Unit: none.
    at_grips : bool
        Whether strength acts at clamped boundaries, too. Where a clamp meets a free boundary the
        law has a singular stress, so that specimens without cuts tear there first. Without it,
        strength does not act within the radius of the region of boundaries and points that are held
        in all directions.
    scatter : Scatter, optional
        Random strengths instead of the same one everywhere.
    """

    uniaxial: Annotated[Positive, *MEASURED] | None = None
    stretch: Annotated[Finite, Field(gt=1), *MEASURED] | None = None
    at_grips: bool = True
    scatter: Scatter | None = None

    def model_post_init(self, _) -> None:
        the_one(self, ("uniaxial", "stretch"))
