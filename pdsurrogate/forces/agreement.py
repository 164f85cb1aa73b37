"""Check that a learned model agrees with its material law: comparison of its force with the exact
force at a few states.

Comparing the law's name and parameters is not enough: the expression of a user's own law may have
changed since the model was fitted.
"""

import warnings
from dataclasses import replace

import numpy as np

from ..materials import PLANES, Law, plane_stress
from .bond_force import exact_bond_force

MOST_OF_STATED = 5.0
"""Greatest accepted error of a learned model with a card (the metadata of its artifact), as a
multiple of the maximum error on the card.

The card states the maximum over thousands of states in the whole training range, edges included;
the errors at the dozen trial states, which lie within the range, stay below it. Chosen: five times
leaves room for parameters that a scene states with fewer digits; a model of another material is off
by far more.
"""

MOST_UNSTATED = 0.05
"""Greatest accepted error of a learned model without a card (the metadata of an artifact), divided
by the greatest exact force at the trial states. Chosen to catch mistakes, such as a model of
another material; errors between `NOTED` and this limit only cause a warning.
"""

NOTED = 0.01
"""Error of a learned model without a card (the metadata of an artifact), divided by the greatest
exact force at the trial states, beyond which `check_agreement` warns. Chosen: equal to the limit
for RMS errors on cards (`pdsurrogate.artifacts.card.NOTED`).
"""

ROUNDING = 1e-6
"""Least value that `check_agreement` uses for the maximum error on a card (the metadata of an
artifact): smaller errors are rounding, which differs from machine to machine.
"""

WIDEST = (0.5, 4.0)
"""Least and greatest principal stretch of default training samples, which limit the trial states of
`check_agreement` however wide the domain of a model is: beyond them a law may have no state, and
forces grow so large that errors at smaller stretches do not show. The card of a bond force that was
trained on stretches above the least one also states the errors over this range.
"""

PLACES = np.stack(
    [0.07 + 0.86 * (np.arange(1, 13) * step % 1) for step in (0.7548776662, 0.5698402910)], axis=1
)
"""Positions of the 12 trial states in the box of both log-stretches, as fractions of its sides,
shape (12, 2). They are evenly spread (the plastic number's sequence) and at least 7 % of a side
away from the edges, where fits are least exact.
"""


def bond_states(law: Law, first, second):
    """Return the arguments of `ForceSurrogate.bond_force` at n trial states, and the exact bond
    forces of a law there, shape (n, 2).

    `first` and `second` are the principal stretches of the states, shape (n,); the bonds lie at
    several angles to the principal axes.
    """
    angle = 0.3 + np.arange(len(first))
    cos = np.cos(angle)
    sin = np.sin(angle)
    a = first * cos**2 + second * sin**2
    b = (second - first) * sin * cos
    J = first * second
    C33 = plane_stress.thickness_stretch_squared(law, first**2 + second**2, J)
    stretch = np.hypot(a, b)
    rotation = np.arctan2(b, a)
    return (stretch, rotation, np.linspace(0.2, 1, len(first)), C33, J), exact_bond_force(
        law, stretch, rotation, C33, J
    )


def invariant_states(law: Law, first, second):
    """Return n trial states for a plane-stress energy, and its exact derivatives by both principal
    stretches there, shape (n, 2).

    `first` and `second` are the principal stretches, shape (n,); the states are a tuple of tr C, J,
    and these stretches.
    """
    trace = first**2 + second**2
    J = first * second
    p, q, *_ = plane_stress.response(law, trace, J, plane_stress.volume_ratio(law, trace, J))
    return (trace, J, first, second), np.stack(
        [p * first + q / first, p * second + q / second], axis=1
    )


def isochoric_states(law: Law, first, second):
    """Return n trial states for an isochoric energy, and the exact deviatoric principal Kirchhoff
    stresses there, shape (n, 3).

    The states are a tuple of I1bar, I2bar, and squared principal stretches of product 1, shape (3,
    n). These stretches are `first`, `second` (shape (n,)) and 1, divided by their geometric mean.
    Where one of a state lies outside the range of all given stretches and 1, the logarithms of its
    three stretches are multiplied by the factor that takes it to the end of the range.
    """
    logs = np.log([first, second, np.ones_like(first)])
    low = logs.min()
    high = logs.max()
    logs -= logs.mean(axis=0)
    # Within the bounds of the two that were given.
    logs *= np.minimum(1, np.minimum(low / logs.min(axis=0), high / logs.max(axis=0)))
    squares = np.exp(2 * logs)
    I1 = squares.sum(axis=0)
    I2 = (1 / squares).sum(axis=0)
    return (I1, I2, squares), isochoric_stresses(squares, *isochoric_slopes(law, I1, I2))


def isochoric_slopes(law: Law, I1, I2) -> tuple[np.ndarray, np.ndarray]:
    """Return the derivatives of the isochoric energy W of a law by I1bar and by I2bar at given
    values of both.
    """
    p, _, r, _ = PLANES["space"].isochoric_response(law, I1, I2, np.ones_like(I1))
    return p / 2 + I1 * r / 2, -r / 2


def isochoric_stresses(squares, by_1, by_2) -> np.ndarray:
    """Return deviatoric principal Kirchhoff stresses (n, 3) from squared stretches (3, n) and
    the derivatives of W by I1bar and I2bar.
    """
    stresses = 2 * (squares * by_1 - by_2 / squares)
    return (stresses - stresses.mean(axis=0)).T


def check_agreement(model, law: Law, exact, remedy: str) -> None:
    """Check that a learned model gives the exact forces of a law at a few states.

    Parameters
    ----------
    model : Learned
        Model whose `answer` at the states from `exact` is compared.
    law : Law
    exact : {`bond_states`, `invariant_states`, `isochoric_states`}
        Function of the law and two principal stretches that returns states and the exact answers
        there.
    remedy : str
        End of the error message: what the user can do.

    Raises
    ------
    ValueError
        If the error exceeds `MOST_OF_STATED` times the error on the model's card (the metadata of
        its artifact), or `MOST_UNSTATED` for a model without a card, or if the law has no state
        somewhere in the domain.

    Warns
    -----
    UserWarning
        If the model has no card and its error exceeds `NOTED`.
    """
    advice = (
        "the law has changed since, the model belongs to another material, or its fit is too"
        f" coarse; {remedy}"
    )
    if model.stated is not None:
        # States lie on the plane-stress surface of training: the force at given C33 does not depend
        # on the bulk modulus, the surface does.
        bulk = model.stated["bulk_ratio"] * law.shear_modulus
        law = law if law.bulk_modulus == bulk else replace(law, bulk_modulus=bulk)
    low, high = np.log(
        [max(model.domain.least_stretch, WIDEST[0]), min(model.domain.greatest_stretch, WIDEST[1])]
    )
    try:
        states, right = exact(law, *np.exp(low + (high - low) * PLACES.T))
    except ValueError as error:  # the law has no state somewhere in the domain
        raise ValueError(
            f"the domain of {model.name} contains states that the law does not have ({error}):"
            f" {advice}"
        ) from None
    size = np.linalg.norm(right, axis=1)
    error = np.linalg.norm(model.answer(*states) - right, axis=1).max()
    if model.stated is None:
        reference = size.max()
        most = MOST_UNSTATED
        said = f"the greatest force, more than {100 * MOST_UNSTATED:g} %"
    else:
        reference = np.sqrt((size**2).mean())
        most = MOST_OF_STATED * max(model.stated["max"], ROUNDING)
        said = (
            "their root mean square, but its card states a greatest error of"
            f" {100 * model.stated['max']:.2g} %"
        )
    if not error <= most * reference:
        raise ValueError(
            f"{model.name} differs from the forces of {law.name} by {100 * error / reference:.3g} %"
            f" of {said}: {advice}"
        )
    if model.stated is None and error > NOTED * reference:
        shape = "".join(f", {key} = {value:g}" for key, value in law.shape.items())
        off = f"{100 * error / reference:.2g} % of the greatest force"
        warnings.warn(
            f"{model.name} deviates from {law.name}{shape} by {off}: fit it to this law, or less"
            " coarsely",
            stacklevel=3,
        )
