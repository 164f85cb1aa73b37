"""Messages of errors and warnings of force evaluations."""

from collections.abc import Callable, Sequence

import numpy as np

from ..body import Body
from ..materials import PLANES, Law


def at_point(body: Body, i: int, what: str) -> str:
    """Return the message `what`, preceded by the number and the reference position of point i."""
    return (
        f"point {body.share.numbers[i]} at ({', '.join(f'{x:.4g}' for x in body.points[i])}):"
        f" {what}"
    )


def why_invalid(
    F: np.ndarray, whose: str, plane: str, laws: Callable[[int], Sequence[Law]]
) -> tuple[int, str]:
    """Find a deformation gradient at which a law has no state; return its index in F and the reason
    in words.

    Parameters
    ----------
    F : ndarray, shape (k, d, d)
        Deformation gradients.
    whose : str
        Words for messages that say what a gradient belongs to, such as " of a bond"; "" for a
        point.
    plane : str
        "stress", "strain" or "space" (three dimensions).
    laws : callable
        ``laws(number)`` returns the laws that need a state at gradient `number`; the 100 gradients
        with the greatest tr C are tried.
    """
    with np.errstate(invalid="ignore"):  # values that are not finite are expected in this search
        J = np.linalg.det(F)
    if not np.isfinite(J).all():
        return (
            int((~np.isfinite(J)).argmax()),
            f"{'the' if whose else 'its'} deformation gradient{whose} is not finite",
        )
    if J.min() <= 0:
        return (
            int(J.argmin()),
            f"det F = {J.min():.3g}{whose}: the material is turned inside out there",
        )
    trace = (F * F).sum(axis=(1, 2))
    order = np.argsort(-trace)[:100]
    worst = int(order[0])
    tried = [(place, law) for place, number in enumerate(order.tolist()) for law in laws(number)]
    # Line searches meet such states by the thousand: a law is asked about all gradients at once.
    lacking = []
    for law in {id(law): law for _, law in tried}.values():
        places = np.array([place for place, other in tried if other is law])
        lacking += [
            (place, law)
            for place in places[~PLANES[plane].has_state(law, F[order[places]])][:1].tolist()
        ]
    if lacking:
        place, law = min(lacking, key=lambda one: one[0])
        return int(order[place]), str(PLANES[plane].why_no_state(law, F[order[place]]))
    return (
        worst,
        (
            f"no state{whose} was found there or nearby, at tr C = {trace[worst]:.4g} and det F ="
            f" {J[worst]:.4g}"
        ),
    )


def locate(body: Body, values: np.ndarray, what: str) -> str:
    """Return the message `what`, preceded by the first point at which `values`, shape (n, ...),
    are not finite (`at_point`).
    """
    return at_point(
        body, int(np.flatnonzero(~np.isfinite(values.reshape(len(body), -1)).all(axis=1))[0]), what
    )
