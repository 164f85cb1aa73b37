"""Stress over time of homogeneous deformations of laws with memory, as references for simulations
and for fits to tests.

Each time given is the end of a step, in which the isochoric Cauchy-Green tensor is linear in time.
A step has the error of the third order of its length, and no step is too long: the internal
variables of branches stay positive definite.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.branches import weights_of_ends
from ..kernels.softening import softening_factor
from .law import InvariantLaw, Law, PrincipalStretchLaw
from .memory import Branch, Softening, padded_knots

LOGS: dict[str, Callable] = {
    "uniaxial": lambda x, volume: (x, (volume - x) / 2, (volume - x) / 2),
    "equibiaxial": lambda x, volume: (x, x, volume - 2 * x),
    "pure-shear": lambda x, volume: (x, 0 * x, volume - x),
}
"""Logarithms of the principal stretches by those of the stretch along the stress and of the volume
ratio, by mode of loading; the third is that of the thickness, which is free of stress.
"""

ITERATIONS = 60
DIFFERENCE = 1e-7
SOLVED = 1e-10
"""Settings of Newton's method for stretch and volume: the greatest number of iterations, the
interval of the differences of logarithms that give slopes, and the last step.
"""

GREATEST_MOVE = 0.2
"""Greatest change of a logarithm in an iteration, so that a search stays within a law's limit."""


@dataclass(frozen=True)
class History:
    """Course of a homogeneous deformation over time.

    Attributes
    ----------
    time : ndarray, shape (n,)
    stretches : ndarray, shape (n, 3)
        Principal stretches along the stress, across it, and through the thickness.
    nominal_stress : ndarray, shape (n,)
        Unit: that of the shear modulus.
    states : ndarray, shape (n, n_branches, 3)
        Principal values of the internal variables C_k.
    """

    time: np.ndarray
    stretches: np.ndarray
    nominal_stress: np.ndarray
    states: np.ndarray


def stress_history(
    law: Law, mode: str, time: ArrayLike, stretch: ArrayLike, incompressible: bool = False
) -> History:
    """Return the history of a law with memory, from rest, at given stretches.

    Parameters
    ----------
    law : Law
    mode : str
        "uniaxial", "equibiaxial" or "pure-shear".
    time, stretch : array-like, shape (n,)
        Times, which never decrease, and stretches along the stress. A first stretch other than 1,
        and a further one at the same time, is reached at once.
    incompressible : bool
        Whether the volume is kept, as if the bulk modulus were infinite.

    Returns
    -------
    History
        Stresses are NaN past the limit of the law.

    Raises
    ------
    ValueError
        If the mode is unknown, times decrease, or a stretch is not positive.

    References
    ----------
    Reese, Govindjee, Int. J. Solids Struct. 35 (1998) 3455, for branches; Shutov, Landgraf,
    Ihlemann, Finite Elem. Anal. Des. 65 (2013) 44, for updates in closed form; Ogden, Roxburgh,
    Proc. R. Soc. A 455 (1999) 2861, for softening.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.materials.histories import stress_history
    >>> memory = pds.materials.Memory((pds.materials.Branch(1.0, 2.0),))
    >>> law = pds.materials.NeoHookean(memory=memory)
    >>> found = stress_history(law, "uniaxial", [0, 2, 100], [1.5] * 3, incompressible=True)
    >>> found.nominal_stress.round(3).tolist()
    [2.111, 1.318, 1.056]
    """
    time, stretch = _checked(mode, time, stretch)
    if not (stretch > 0).all():
        raise ValueError(f"a stretch must be positive and finite, not {stretch.min():g}")
    along = np.log(stretch)
    if not incompressible:
        return _solved(law, mode, time, lambda row, x: (along[row], x[0]), 1)
    logs = np.stack(LOGS[mode](along, np.zeros_like(along)), axis=1)
    squares = np.exp(2 * logs)
    branches = law.memory.branches
    states = branch_states(time, squares, branches)
    energy, slopes = isochoric(law, logs)
    if law.memory.softening is not None:
        peak = np.maximum.accumulate(energy)
        slopes = softened(law.memory.softening, energy, peak)[:, None] * slopes
    for number, branch in enumerate(branches):
        slopes = slopes + branch.modulus * squares / states[:, number]
    return History(time, np.exp(logs), (slopes[:, 0] - slopes[:, 2]) / stretch, states)


def stretch_history(
    law: Law, mode: str, time: ArrayLike, nominal_stress: ArrayLike, incompressible: bool = False
) -> History:
    """Return the history of a law with memory, from rest, at given nominal stresses (creep).

    Parameters
    ----------
    law : Law
    mode : str
        "uniaxial", "equibiaxial" or "pure-shear".
    time, nominal_stress : array-like, shape (n,)
        Times, which never decrease, and stresses. A first stress other than 0, and a further one at
        the same time, acts at once.
    incompressible : bool
        Whether the volume is kept, as if the bulk modulus were infinite.

    Returns
    -------
    History
        Stretches and stresses are NaN from the first row on that has no state.

    Raises
    ------
    ValueError
        If the mode is unknown, or times decrease.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.materials.histories import stretch_history
    >>> memory = pds.materials.Memory((pds.materials.Branch(1.0, 2.0),))
    >>> law = pds.materials.NeoHookean(memory=memory)
    >>> found = stretch_history(law, "uniaxial", [0, 2, 100], [1.0] * 3, incompressible=True)
    >>> found.stretches[:, 0].round(3).tolist()
    [1.197, 1.307, 1.463]
    """
    time, wanted = _checked(mode, time, nominal_stress)
    if incompressible:
        return _solved(law, mode, time, lambda row, x: (x[0], 0.0), 1, wanted)
    return _solved(law, mode, time, lambda row, x: (x[0], x[1]), 2, wanted)


def _checked(mode: str, time: ArrayLike, values: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values as arrays of finite numbers, of one length."""
    if mode not in LOGS:
        raise ValueError(f"mode must be {', '.join(LOGS)}, not {mode!r}")
    time, values = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
    if time.ndim != 1 or time.shape != values.shape or not len(time):
        raise ValueError(f"give a value for each time, not {values.shape} for {time.shape}")
    if not (np.isfinite(time).all() and np.isfinite(values).all()):
        raise ValueError("times and values must be finite numbers")
    if (np.diff(time) < 0).any():
        row = int(np.argmax(np.diff(time) < 0)) + 1
        raise ValueError(f"times must not decrease: {time[row]:g} follows {time[row - 1]:g}")
    return time, values


def isochoric(law: Law, logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the isochoric elastic energy (n,) of a law and its derivatives (n, 3) by logarithms of
    principal stretches (n, 3) whose sum is 0, in the unit of the shear modulus.
    """
    squares = np.exp(2 * logs)
    parameters = law.parameters
    with np.errstate(all="ignore"):  # past the limit of a law: NaN
        if isinstance(law, PrincipalStretchLaw):
            energy, *slopes, _ = law.sums((*logs.T, *squares.T), parameters)
            slopes = np.stack(slopes, axis=1)
        elif isinstance(law, InvariantLaw):
            I1, I2 = squares.sum(axis=1), (1 / squares).sum(axis=1)
            energy, W1, W2, *_ = law.isochoric(I1, I2, parameters)
            first, second = (np.broadcast_to(W, I1.shape)[:, None] for W in (W1, W2))
            slopes = 2 * (first * squares - second / squares)
        else:
            raise TypeError(f"{law.name} has no energy of isochoric stretches")
    return law.shear_modulus * energy, law.shear_modulus * slopes


def softened(softening: Softening, energy: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """Return the factor eta of Ogden and Roxburgh at an energy and its greatest value so far."""
    with np.errstate(all="ignore"):  # past the limit of a law: NaN
        return softening_factor(energy, peak, (softening.r, softening.m, softening.beta))[0]


def branch_states(time: np.ndarray, squares: np.ndarray, branches: Sequence[Branch]) -> np.ndarray:
    """Return the principal values of internal variables, from rest, at squares of isochoric
    principal stretches with fixed axes.

    Parameters
    ----------
    time : ndarray, shape (n, ...)
        Of one history, or of several side by side.
    squares : ndarray, shape (n, ..., 3)
    branches : sequence of Branch

    Returns
    -------
    ndarray, shape (n, ..., n_branches, 3)
    """
    times = np.array([branch.time for branch in branches])
    knots = padded_knots(branches)
    found = np.ones((*time.shape, len(times), 3))
    steps = np.diff(time, axis=0)[..., None] / times
    squares = squares[..., None, :]
    for row, step in enumerate(steps, start=1):
        found[row] = advanced(found[row - 1], squares[row - 1], step, knots)(squares[row])
    return found


def advanced(
    states: np.ndarray, before: np.ndarray, step: np.ndarray, knots: np.ndarray | None = None
) -> Callable:
    """Return the function that gives internal variables (..., n_branches, 3) after a step by the
    squares of stretches (..., 1, 3) at its end.

    `step` (..., n_branches) is the time of the step over the relaxation times, `before` (..., 1, 3)
    are the squares at the beginning, `knots` those of times that depend on the overstress.
    """
    rate = (before / states).sum(axis=-1) / 3

    def after_times(passed: np.ndarray) -> Callable:
        decay, begin, end = weights_of_ends(rate * passed)
        known = decay[..., None] * states + (passed * begin)[..., None] * before
        weight = (passed * end)[..., None]

        def at(after: np.ndarray) -> np.ndarray:
            grown = known + weight * after
            return grown / np.cbrt(grown.prod(axis=-1, keepdims=True))

        return at

    if knots is None or not knots.size:
        return after_times(step)
    from ..kernels.rates import log_overstress, times_passed  # here, for few have such times

    def log_rate(squares: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return the logarithm of the rate of relaxation, 0 near rest."""
        logs = log_overstress((squares / states).sum(axis=-1), (states / squares).sum(axis=-1))
        places, changes = knots[:, 0], knots[:, 1]
        return (changes * np.maximum(logs[..., None] - places, 0)).sum(axis=-1)

    begun = log_rate(before, states)

    def solved(after: np.ndarray) -> np.ndarray:
        passed = times_passed(
            step,
            begun,
            lambda times: log_rate(after, after_times(times)(after)),
            -(knots[:, 0] * knots[:, 1]).sum(axis=-1),
        )
        return after_times(passed)(after)

    return solved


def _solved(
    law: Law,
    mode: str,
    time: np.ndarray,
    coordinates: Callable,
    unknowns: int,
    wanted: np.ndarray | None = None,
) -> History:
    """Return a history row by row, with `unknowns` found by Newton's method.

    ``coordinates(row, x)`` returns logarithms of stretch and volume ratio. The stress across the
    thickness vanishes, and `wanted` are the nominal stresses, if given; with a kept volume the
    pressure takes care of the former.
    """
    memory, parameters = law.memory, law.parameters
    moduli = np.array([branch.modulus for branch in memory.branches])[:, None]
    times = np.array([branch.time for branch in memory.branches])
    knots = padded_knots(memory.branches)
    kept = wanted is not None and unknowns == 1
    stretches, stress = np.full((len(time), 3), np.nan), np.full(len(time), np.nan)
    states = np.full((len(time), len(times), 3), np.nan)
    state, squares, peak, x = np.ones((len(times), 3)), np.ones(3), 0.0, np.zeros(unknowns)
    for row, elapsed in enumerate(np.diff(time, prepend=time[0])):
        grown = advanced(state, squares, elapsed / times, knots)

        def at(x, row=row, grown=grown, peak=peak):
            """Return logarithms, squares, energy, principal Kirchhoff stresses and states."""
            along, volume = coordinates(row, x)
            logs = np.array(LOGS[mode](along, volume))
            bare = logs - volume / 3
            squares = np.exp(2 * bare)
            energy, slopes = isochoric(law, bare[None])
            factor = (
                softened(memory.softening, energy, np.maximum(peak, energy))
                if memory.softening
                else 1.0
            )
            states = grown(squares)
            slopes = factor * slopes[0] + (moduli * squares / states).sum(axis=0)
            J3 = np.exp(volume)
            pressure = law.shear_modulus * J3 * law.volumetric(J3, parameters)[1]
            kirchhoff = slopes - (slopes[2] if kept else slopes.mean() - pressure)
            return logs, squares, energy[0], kirchhoff, states

        def residual(x, row=row, at=at):
            logs, *_, kirchhoff, _ = at(x)
            nominal = [] if wanted is None else [kirchhoff[0] * np.exp(-logs[0]) - wanted[row]]
            return np.array([*nominal, *([] if kept else [kirchhoff[2]])])

        x = _root(residual, x)
        logs, squares, energy, kirchhoff, state = at(x)
        if not np.isfinite(kirchhoff).all():
            break
        peak = max(peak, float(energy))
        stretches[row], states[row] = np.exp(logs), state
        stress[row] = kirchhoff[0] * np.exp(-logs[0])
    return History(time, stretches, stress, states)


def _root(residual: Callable[[np.ndarray], np.ndarray], start: np.ndarray) -> np.ndarray:
    """Return a zero near `start`, NaN if there is none, by Newton's method with slopes from
    differences.
    """
    x = start
    for _ in range(ITERATIONS):
        here = residual(x)
        moved = x + DIFFERENCE * np.eye(len(x))
        slopes = np.stack([(residual(one) - here) / DIFFERENCE for one in moved], axis=1)
        if not np.isfinite(slopes).all() or not np.linalg.det(slopes):
            break
        step = np.linalg.solve(slopes, here)
        x = x - step * min(1.0, GREATEST_MOVE / max(np.abs(step).max(), GREATEST_MOVE))
        if np.abs(step).max() < SOLVED:
            return x
    return np.full_like(start, np.nan)
