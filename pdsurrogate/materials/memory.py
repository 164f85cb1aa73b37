"""Memory of rubber beside its elastic energy: viscoelastic branches and softening."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

NEARLY = 1.5
"""Factor by which rates may lie outside of those of tests. Chosen: curves at a rate 1.7 times
greater than all others were predicted as well as those were fitted, at a third not.
"""


@dataclass(frozen=True)
class Branch:
    """Viscoelastic branch, with the energy modulus/2 (Cbar : C_k^-1 - 3) of an internal variable
    C_k of determinant 1.

    C_k follows Cbar, the isochoric right Cauchy-Green tensor, by C_k' = (Cbar - (Cbar : C_k^-1)/3
    C_k) / time. The time may fall with the overstress, the root of half the trace of the square of
    the branch's deviatoric Kirchhoff stress; in small simple shear it is the shear stress.

    Parameters
    ----------
    modulus : float
        Shear modulus that the branch adds in fast motions, in the unit of the law's.
    time : float
        Relaxation time; the greatest one if it depends on the overstress.
    times : sequence of pair of float
        Overstresses, in the unit of the modulus, and relaxation times at them, which do not rise.
        Between two of them the time is a power of the overstress. The first one is `time`, and
        holds below, the last one above.

    Examples
    --------
    >>> from pdsurrogate.materials import Branch
    >>> cubic = Branch(0.5, 10.0, ((0.1, 10.0), (1.0, 0.01)))
    >>> round(cubic.time_at(0.2), 9)
    1.25
    """

    modulus: float
    time: float
    times: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        for key in ("modulus", "time"):
            value = getattr(self, key)
            if not 0 < value < math.inf:
                raise ValueError(f"{key} of a branch must be positive and finite, not {value}")
        if not self.times:
            return
        if len(self.times) < 2 or self.times[0][1] != self.time:
            raise ValueError(
                "times of a branch must be two pairs of overstress and time or more, the first of"
                f" them with its time {self.time:g}"
            )
        for (low, slow), (high, fast) in pairwise(self.times):
            if not (0 < low < high < math.inf and slow >= fast > 0):
                raise ValueError(
                    "times of a branch must be at rising overstresses and must not rise, but"
                    f" {fast:g} at {high:g} follows {slow:g} at {low:g}"
                )

    @classmethod
    def of_regressor(cls, modulus: float, regressor: Any, overstresses: ArrayLike) -> Self:
        """Return a branch with relaxation times that a regressor has learned.

        Parameters
        ----------
        modulus : float
        regressor : object
            Its ``predict(X)`` gives logarithms of relaxation times (n,) by those of overstresses
            (n, 1), as regressors of scikit-learn do. Where they rise, the time before is kept.
        overstresses : array-like, shape (n,)
            Rising overstresses at which it is asked; between them times are powers of them.

        Returns
        -------
        Branch

        Examples
        --------
        >>> import numpy as np
        >>> from sklearn.isotonic import IsotonicRegression
        >>> from pdsurrogate.materials import Branch
        >>> overstress, time = np.array([0.1, 0.2, 0.4]), np.array([9.0, 4.0, 1.0])
        >>> known = IsotonicRegression(increasing=False, out_of_bounds="clip")
        >>> known = known.fit(np.log(overstress), np.log(time))
        >>> learned = Branch.of_regressor(0.5, known, [0.1, 0.4])
        >>> round(learned.time_at(0.2), 6)
        3.0
        """
        stresses = np.asarray(overstresses, dtype=float)
        logs = np.asarray(regressor.predict(np.log(stresses)[:, None]), dtype=float)
        times = np.exp(np.minimum.accumulate(logs)).tolist()
        return cls(modulus, times[0], tuple(zip(stresses.tolist(), times, strict=True)))

    def time_at(self, overstress: float) -> float:
        """Return the relaxation time at an overstress.

        Examples
        --------
        >>> from pdsurrogate.materials import Branch
        >>> Branch(0.5, 10.0).time_at(0.2)
        10.0
        """
        stresses, times = np.log(self.times or [(1.0, self.time)]).T
        return float(np.exp(np.interp(np.log(overstress), stresses, times)))

    def knots(self) -> np.ndarray:
        """Return the logarithms of the overstresses, divided by the modulus, at which the exponent
        of the time changes, and by how much it falls, shape (2, n); empty for a constant time.
        """
        if not self.times:
            return np.empty((2, 0))
        stresses, times = np.log(self.times).T
        exponents = -np.diff(times) / np.diff(stresses)
        return np.stack(
            [stresses - np.log(self.modulus), np.diff(exponents, prepend=0.0, append=0.0)]
        )

    def scaled(self, factor: float, time: float) -> Self:
        """Return the branch with all stresses multiplied by a factor, and all times by another."""
        times = tuple((stress * factor, one * time) for stress, one in self.times)
        return replace(self, modulus=self.modulus * factor, time=self.time * time, times=times)

    def describe(self) -> dict[str, Any]:
        """Return the keys of a branch that state it."""
        if self.times:
            return {"modulus": self.modulus, "times": [list(pair) for pair in self.times]}
        return {"modulus": self.modulus, "time": self.time}


@dataclass(frozen=True)
class Softening:
    """Softening of the isochoric energy W below its greatest value W_max so far (Mullins), by the
    factor eta = 1 - erf((W_max - W)/(m + beta W_max))/r of Ogden and Roxburgh (1999).

    Parameters
    ----------
    r : float
        At least 1: the stress falls by up to 1/r of its value.
    m : float
        Energy per volume, in the unit of the law's shear modulus.
    beta : float
        Not negative; `m` and `beta` are not both zero.
    """

    r: float
    m: float
    beta: float = 0.0

    def __post_init__(self) -> None:
        if not 1 <= self.r < math.inf:
            raise ValueError(f"r of softening must be at least 1, not {self.r}")
        for key in ("m", "beta"):
            value = getattr(self, key)
            if not 0 <= value < math.inf:
                raise ValueError(f"{key} of softening must not be negative, not {value}")
        if self.m == self.beta == 0:
            raise ValueError("m and beta of softening must not both be zero")


@dataclass(frozen=True)
class Memory:
    """Branches and softening of a material; the memory of an elastic material is empty, and false.

    Parameters
    ----------
    branches : tuple of Branch
    softening : Softening, optional

    Examples
    --------
    >>> from pdsurrogate.materials import Branch, Memory
    >>> Memory((Branch(0.4, 2.0), Branch(0.1, 50.0))).modulus
    0.5
    """

    branches: tuple[Branch, ...] = ()
    softening: Softening | None = None

    def __bool__(self) -> bool:
        return bool(self.branches) or self.softening is not None

    @property
    def modulus(self) -> float:
        """Shear modulus that all branches add in fast motions."""
        return sum(branch.modulus for branch in self.branches)

    @property
    def thinning(self) -> bool:
        """Whether relaxation times depend on the overstress."""
        return any(branch.times for branch in self.branches)

    def scaled(self, factor: float, time: float = 1.0) -> Self:
        """Return the memory with all moduli and energies multiplied by a factor, and all times by
        another.
        """
        softening = self.softening
        return replace(
            self,
            branches=tuple(one.scaled(factor, time) for one in self.branches),
            softening=softening and replace(softening, m=softening.m * factor),
        )

    def numbers(self) -> dict[str, float]:
        """Return the numbers of branches and softening by dotted key, without times that depend on
        the overstress.

        Examples
        --------
        >>> from pdsurrogate.materials import Branch, Memory
        >>> Memory((Branch(0.4, 2.0),)).numbers()
        {'branches.0.modulus': 0.4, 'branches.0.time': 2.0}
        """
        return {
            f"{part}.{name}": value
            for part, one in self._parts().items()
            for name, value in vars(one).items()
            if isinstance(value, int | float) and not (name == "time" and one.times)
        }

    def with_numbers(self, values: Mapping[str, float]) -> Self:
        """Return the memory with other values of some of its `numbers`.

        Raises
        ------
        ValueError
            If the values are not those of a memory.

        Examples
        --------
        >>> from pdsurrogate.materials import Branch, Memory
        >>> Memory((Branch(0.4, 2.0),)).with_numbers({"branches.0.time": 3.0}).branches
        (Branch(modulus=0.4, time=3.0, times=()),)
        """
        parts = {
            part: replace(
                one,
                **{name: values[key] for name in vars(one) if (key := f"{part}.{name}") in values},
            )
            for part, one in self._parts().items()
        }
        softening = parts.pop("softening", None)
        return replace(self, branches=tuple(parts.values()), softening=softening)

    def _parts(self) -> dict[str, Any]:
        """Return branches and softening by key."""
        found: dict[str, Any] = {f"branches.{n}": one for n, one in enumerate(self.branches)}
        return found | ({} if self.softening is None else {"softening": self.softening})

    def describe(self) -> dict[str, Any]:
        """Return the keys of a material that state this memory, ``branches`` and ``softening``."""
        found: dict[str, Any] = {}
        if self.branches:
            found["branches"] = [each.describe() for each in self.branches]
        if self.softening is not None:
            found["softening"] = vars(self.softening).copy()
        return found


def padded_knots(branches: Sequence[Branch]) -> np.ndarray:
    """Return the `Branch.knots` of branches, shape (n_branches, 2, n_knots)."""
    each = [branch.knots() for branch in branches]
    found = np.zeros((len(each), 2, max((one.shape[1] for one in each), default=0)))
    for one, knots in zip(found, each, strict=True):
        one[:, : knots.shape[1]] = knots
    return found


def untested_rates(measured: tuple[float, float], least: float, greatest: float) -> str | None:
    """Return in words which rates of stretch are outside of those of the tests behind branches;
    None if none is.

    Parameters
    ----------
    measured : tuple of float
        Least and greatest rate of the tests.
    least, greatest : float
        Rates of a motion in the same unit: the least is the mean one of the whole motion, in which
        holds count, the greatest one that of its moving part.

    Examples
    --------
    >>> from pdsurrogate.materials.memory import untested_rates
    >>> untested_rates((0.01, 0.05), 0.01, 0.06)
    >>> untested_rates((0.01, 0.05), 0.02, 1.0)[:40]
    'rates of stretch up to 1, where those of'
    """
    slow, fast = measured
    if fast * NEARLY < greatest:
        return (
            f"rates of stretch up to {greatest:.3g}, where those of the tests end at {fast:.3g}:"
            " faster branches are not known"
        )
    if least * NEARLY < slow:
        return (
            f"rates of stretch down to {least:.3g}, where those of the tests end at {slow:.3g}:"
            " slower branches are not told from the elastic energy"
        )
    return None


def from_prony(shear_modulus: float, pairs: Sequence[tuple[float, float]]) -> tuple[Branch, ...]:
    """Return the branches of a Prony series: each pair is the ratio of a branch's modulus to that
    of fast motions, which `shear_modulus` (of slow motions) and all branches add up to, and a time.
    """
    slow = 1 - sum(ratio for ratio, _ in pairs)
    if slow <= 0:
        raise ValueError(f"the ratios of prony add up to {1 - slow:g}; they must stay below 1")
    return tuple(Branch(ratio / slow * shear_modulus, time) for ratio, time in pairs)
