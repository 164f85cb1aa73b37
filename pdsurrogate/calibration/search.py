"""Search for the law of measurements: its variables, weighted residuals and their Jacobian."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..materials import Law
from ..materials.covariance import derivatives_of_numbers
from ..progress import event
from .measured import FAILURES

logger = logging.getLogger(__name__)

DIFFERENCE = 1e-6
"""Change of a search variable in central differences of the numbers of a law; of a coefficient of
an energy, relative to it. Chosen: the error by rounding is then 1e-10, and that by curvature less.
"""


@dataclass(frozen=True)
class Space:
    """Variables of a search: parameters or, where flags say so, their logarithms, between
    bounds; each of shape (n_parameters,).
    """

    low: np.ndarray
    high: np.ndarray
    logarithmic: np.ndarray

    def of(self, kept: np.ndarray) -> "Space":
        """Return the variables that a mask chooses."""
        return Space(self.low[kept], self.high[kept], self.logarithmic[kept])

    def parameters(self, x: np.ndarray) -> np.ndarray:
        return np.exp(x, out=x.copy(), where=self.logarithmic)

    def sizes(self, x: np.ndarray) -> np.ndarray:
        """Return the derivatives of the parameters by the variables."""
        return np.where(self.logarithmic, self.parameters(x), 1.0)


class Search:
    """Weighted residuals of a law at the measurements and their Jacobian by the variables of a
    `space`, for `scipy.optimize.least_squares`.

    If `held`, the measurements do not depend on a common factor of all moduli, and the first one
    keeps its value.
    """

    def __init__(self, model, space: Space, y: np.ndarray, root: np.ndarray, held: bool) -> None:
        self.model = model
        self.tests = model.tests_
        self.space = space
        self.held = held
        self.count = 0
        self._stated = root
        self.aim(y)

    def aim(self, y: np.ndarray, x: np.ndarray | None = None) -> None:
        """Set the measurements, which maps of images follow, and forget what is known; residuals
        at x, if given, give robust weights.
        """
        root = self._stated
        if x is not None:
            off = root * (self.values(x) - y)
            root = root.copy()
            for test, here in self.tests:
                root[here] *= np.sqrt(test.robust(off[here]))
        self.y = y
        self.root = root
        for test, here in self.tests:
            test.weigh(y[here], root[here])
        self.forget()

    def forget(self) -> None:
        """Delete what is known of laws with other unknowns or other maps of images."""
        self.known: dict[bytes, tuple[np.ndarray, np.ndarray | None]] = {}

    def law_at(self, x: np.ndarray) -> Law:
        return self.model.unknown_.law_of(self.space.parameters(x))

    def values(self, x: np.ndarray) -> np.ndarray:
        """Return the measurements at the search variables; raise one of `FAILURES` where a scene
        has no equilibrium.
        """
        return self._known(x)[0]

    def residuals(self, x: np.ndarray) -> np.ndarray:
        try:
            return self.root * (self.values(x) - self.y)
        except (*FAILURES, ValueError):
            return np.full(len(self.y), np.inf)  # the search then turns back

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        return self.root[:, None] * self._known(x, True)[1]

    def numbers(self, x: np.ndarray) -> tuple[list[str], np.ndarray]:
        """Return the names of the numbers of the law, and their derivatives by the variables."""
        numbers, chain = derivatives_of_numbers(
            self.law_at,
            x,
            DIFFERENCE * (np.abs(x) if self.model.law is None else np.ones_like(x)),
        )
        if self.held:
            chain[:, 0] = 0.0
        return [f"material.{name}" for name in numbers], chain

    def _known(self, x: np.ndarray, slopes: bool = False) -> tuple[np.ndarray, Any]:
        """Return the measurements at the search variables, and with `slopes` their derivatives."""
        found = self.known.get(x.tobytes())
        if found is not None and not (slopes and found[1] is None):
            return found
        law = self.law_at(x)
        names, chain = self.numbers(x) if slopes else ([], None)
        values = np.empty(len(self.y))
        derivatives = np.empty((len(self.y), len(names)))
        for test, here in self.tests:
            self.count += test.count
            values[here], derivatives[here] = test.differentiate(law, names)
            if slopes:
                test.chain(chain)
        squares = ((self.root * (values - self.y)) ** 2).sum()
        logger.info(
            "%d equilibria, sum of squared residuals %.4g for %d measurements",
            self.count,
            squares,
            len(values),
        )
        event("calibrating", 0, 1, equilibria=self.count, sum_of_squared_residuals=squares)
        self.known[x.tobytes()] = found = values, derivatives @ chain if slopes else None
        return found


def errors_of(jacobian: np.ndarray) -> np.ndarray:
    """Return the standard errors of search variables by the noise, from the derivatives of
    weighted measurements by them.
    """
    return np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-14, hermitian=True)))


@contextmanager
def failing(what: str) -> Iterator[None]:
    """Raise a ValueError that says what fails, during a context, where a law has no equilibrium."""
    try:
        yield
    except FAILURES as error:
        raise ValueError(f"{what}: {error}") from None
