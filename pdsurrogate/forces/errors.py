"""Errors and warnings of force evaluations, and the words that name a point in them."""

from __future__ import annotations

import numpy as np

from ..body import Body


class OutsideDomain(RuntimeError):
    """Bonds are outside the domain of a surrogate, and the policy is to stop."""


class OutsideDomainWarning(RuntimeWarning):
    """Bonds are outside the domain of a surrogate, and its values there are extrapolated."""


class InvalidState(RuntimeError):
    """Deformation that has no force: det F <= 0, a limit of the material law passed, or numbers that are not finite."""


def at_point(body: Body, i: int, what: str) -> str:
    """Return a message that begins with the number and the place of a point."""
    return f"point {body.share.number(i)} at ({', '.join(f'{x:.4g}' for x in body.points[i])}): {what}"


def locate(body: Body, values: np.ndarray, what: str) -> str:
    """Return a message about the first point at which values are not finite."""
    return at_point(body, int(np.flatnonzero(~np.isfinite(values.reshape(len(body), -1)).all(axis=1))[0]), what)
