"""Errors and warnings of force evaluations, and the part of their messages that names a point."""

from collections.abc import Callable

import numpy as np

from ..body import Body


class OutsideDomain(RuntimeError):
    """Bonds are outside the domain of a surrogate, and the policy is to stop.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> scene = pds.load_scene("uniaxial", {"outside": "raise", "spacing": 0.1, "stretches": [4.0]})
    >>> try:
    ...     pds.simulate(scene, "neo-hookean")
    ... except pds.SimulationFailed as failed:
    ...     print(isinstance(failed.__cause__, pds.forces.OutsideDomain))
    True
    """


class OutsideDomainWarning(RuntimeWarning):
    """Bonds are outside the domain of a surrogate, and its values there are extrapolated.

    Examples
    --------
    >>> import warnings, pdsurrogate as pds
    >>> warnings.simplefilter("error", pds.forces.OutsideDomainWarning)
    """


class InvalidState(RuntimeError):
    """A deformation that has no force: det F <= 0, a limit of the material law passed, or numbers that are not finite.

    Examples
    --------
    >>> import numpy as np, pdsurrogate as pds
    >>> body = pds.Body.rectangle(1.0, 1.0, 0.1, 0.315)
    >>> force = pds.AnalyticBondForce().bind(body, pds.materials.NeoHookean(), pds.ForceSettings())
    >>> try:
    ...     force(body.points * [-1.0, 1.0], np.empty_like(body.points))
    ... except pds.forces.InvalidState as error:
    ...     print("turned inside out" in str(error))
    True
    """


def at_point(body: Body, i: int, what: str) -> str:
    """Return a message that begins with the number and the place of a point."""
    return f"point {body.share.numbers[i]} at ({', '.join(f'{x:.4g}' for x in body.points[i])}): {what}"


def why_invalid(F: np.ndarray, whose: str, check: Callable[[int], object], otherwise: str) -> tuple[int, str]:
    """Return the number of a deformation gradient without a state, and the reason.

    Parameters
    ----------
    F : ndarray, shape (k, d, d)
    whose : str
        Owner of a gradient in messages, "" for a point.
    check : callable
        Function of a number that raises ValueError where the law has no state; the most strained states are tried.
    otherwise : str
        Message if it has a state in all of them, with places for `trace` and `J` of the most strained state.
    """
    with np.errstate(invalid="ignore"):  # values that are not finite are expected in this search
        J = np.linalg.det(F)
    if not np.isfinite(J).all():
        return int((~np.isfinite(J)).argmax()), f"{'the' if whose else 'its'} deformation gradient{whose} is not finite"
    if J.min() <= 0:
        return int(J.argmin()), f"det F = {J.min():.3g}{whose}: the material is turned inside out there"
    trace = (F * F).sum(axis=(1, 2))
    order = np.argsort(-trace)
    worst = int(order[0])
    for number in order[:100].tolist():
        try:
            check(number)
        except ValueError as error:
            return number, str(error)
    return worst, otherwise.format(trace=trace[worst], J=J[worst])


def locate(body: Body, values: np.ndarray, what: str) -> str:
    """Return a message about the first point at which values are not finite."""
    return at_point(body, int(np.flatnonzero(~np.isfinite(values.reshape(len(body), -1)).all(axis=1))[0]), what)
