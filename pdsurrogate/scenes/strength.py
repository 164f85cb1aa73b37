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
    W_b; `energy` must be given beside the strength. With `equibiaxial` or `hydrostatic` beside it,
    states break at a surface of stresses in the place of a work.

    Parameters
    ----------
    uniaxial : float or "artifact", optional
        Nominal stress at break in uniaxial tension; ``"artifact"`` for the mean of the tests behind
        the artifact that is the material or the force of the run. Unit: stress.
    stretch : float or "artifact", optional
        Stretch at break in uniaxial tension. Unit: none.
    equibiaxial : float or "artifact", optional
        Nominal stress at break in equibiaxial tension: a second number, which makes the strength a
        surface of Drucker and Prager's form. At most that in uniaxial tension, and more than half
        of it. Unit: stress.
    hydrostatic : float, optional
        Nominal stress at break in equal tension in all directions, in the place of `equibiaxial`;
        more than a third of that in uniaxial tension. Unit: stress.
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
    equibiaxial: Annotated[Positive, *MEASURED] | None = None
    hydrostatic: Positive | None = None
    at_grips: bool = True
    scatter: Scatter | None = None

    def model_post_init(self, _) -> None:
        the_one(self, ("uniaxial", "stretch"))
        if self.equibiaxial is not None and self.hydrostatic is not None:
            raise ValueError(
                "give equibiaxial or hydrostatic beside the strength in uniaxial tension, not both:"
                " the surface has two numbers"
            )
