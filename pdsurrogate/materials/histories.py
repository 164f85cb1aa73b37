"""Stress over time of homogeneous deformations of laws with memory, as references for simulations
and for fits to tests.

Between the times given, the stretch along the stress is linear in time. Steps of branches follow a
parabola through the strains at the ends and in the middle, and long ones are divided, so that no
step is too long.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..kernels.branches import NODES, SHARES, slowness, weight_of_bow, weights_of_ends
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

STRAIN = 0.025
"""Greatest change of the logarithm of the stretch in a step of branches. Chosen: the overstress in
equibiaxial tension then errs by less than a thousandth of itself in steps of any duration.
"""

ROUNDED = 1e-12
"""Greatest stress across a sheet that counts as zero, relative to the bulk modulus: the error of
the volume ratio. Rounding leaves some 1e-15.
"""


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
        return _swelling(law, mode, time, stretch)
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
        begin, end = squares[row - 1 : row + 1]
        moved = np.log(end[..., 0] / begin[..., 0]) / 2
        parts = max(
            1, int(np.ceil(np.abs(moved[step.any(axis=-1)[..., None]]).max(initial=0) / STRAIN))
        )
        places = [begin, *(on_way(begin, end, n / parts) for n in range(1, parts)), end]
        found[row] = found[row - 1]
        for one, other in pairwise(places):
            found[row] = advanced(found[row], one, step / parts, knots)(other)
    return found


def on_way(begin: np.ndarray, end: np.ndarray, share: float) -> np.ndarray:
    """Return the squares of stretches (..., 3) after a share of a step in which the first stretch
    is linear in time and the others are powers of it.
    """
    ratios = end / begin
    log = np.log(ratios[..., :1]) / 2
    some = np.abs(log) > 1e-9
    bent = np.log1p(share * np.expm1(log)) / np.where(some, log, 1.0)
    return begin * ratios ** np.where(some, bent, share)


def _held(rate: np.ndarray, other: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what `pdsurrogate.kernels.branches.held` does, with all nodes at once."""
    first, second, y = 3 * (rate - 1), 3 * (other - 1), step
    for _ in range(4):
        w = -np.expm1(-y)
        x = w[..., None] * NODES
        gained = (slowness(x, first[..., None], second[..., None]) - 1) / (1 - x) @ SHARES
        y = np.maximum(y + (step - y - w * gained) / slowness(w, first, second), 0)
    w = -np.expm1(-y)
    r = slowness(w, first, second)
    return y - np.log(r), w * r


def advanced(
    states: np.ndarray, before: np.ndarray, step: np.ndarray, knots: np.ndarray | None = None
) -> Callable:
    """Return the function that gives internal variables (..., n_branches, 3) after a step by the
    squares of stretches (..., 1, 3) at its end.

    `step` (..., n_branches) is the time of the step over the relaxation times, `before` (..., 1, 3)
    are the squares at the beginning, `knots` those of times that depend on the overstress, for
    which Cb is linear.
    """
    rate = (before / states).sum(axis=-1) / 3

    def unimodular(grown: np.ndarray) -> np.ndarray:
        return grown / np.cbrt(grown.prod(axis=-1, keepdims=True))

    def after_times(passed: np.ndarray) -> Callable:
        decay, begin, end = weights_of_ends(rate * passed)
        known = decay[..., None] * states + (passed * begin)[..., None] * before
        weight = (passed * end)[..., None]
        return lambda after: unimodular(known + weight * after)

    if knots is None or not knots.size:
        still, whole = _held(rate, (states / before).sum(axis=-1) / 3, step)
        whole = whole / sum(weights_of_ends(still)[1:])
        _, *ends = weights_of_ends(2 * step)

        def along(after: np.ndarray) -> np.ndarray:
            """Return the states by theory (92a)-(92c)."""
            bow = 2 * (before + after) - 4 * on_way(before, after, 0.5)
            rise = step * ((after - before - bow) / states).sum(axis=-1) / 3
            k = np.maximum(still + rise * ends[1], step)
            decay, begin, end = weights_of_ends(k)
            mean = begin[..., None] * before + end[..., None] * after
            mean -= weight_of_bow(k, decay, begin)[..., None] * bow
            share = whole * np.exp(-rise * sum(ends) / 12)
            return unimodular(decay[..., None] * states + share[..., None] * mean)

        return along
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


def _swelling(law: Law, mode: str, time: np.ndarray, stretch: np.ndarray) -> History:
    """Return a history row by row, with the volumes that leave the thickness free of stress; NaN
    from the first row on that has none.
    """
    memory = law.memory
    moduli = np.array([branch.modulus for branch in memory.branches])[:, None]
    times = np.array([branch.time for branch in memory.branches])
    knots = padded_knots(memory.branches)
    squares, states = np.ones(3), np.ones((len(times), 3))
    volume, peak, before = 0.0, 0.0, stretch[0]
    found = History(
        time,
        np.full((len(time), 3), np.nan),
        np.full(len(time), np.nan),
        np.full((len(time), *states.shape), np.nan),
    )
    for row, elapsed in enumerate(np.diff(time, prepend=time[0])):
        change = abs(np.log(stretch[row] / before)) if elapsed else 0.0
        parts = max(1, int(np.ceil(change / STRAIN)))
        for along in np.linspace(before, stretch[row], parts + 1)[1:]:
            grown = advanced(states, squares, elapsed / parts / times, knots)

            def at(volume, along=along, grown=grown, peak=peak):
                """Return squares, states, energy and principal Kirchhoff stresses."""
                logs = np.array(LOGS[mode](np.log(along), volume)) - volume / 3
                squares = np.exp(2 * logs)
                states = grown(squares)
                energy, slopes = isochoric(law, logs[None])
                if memory.softening:
                    slopes = slopes * softened(memory.softening, energy, np.maximum(peak, energy))
                stress = slopes[0] + (moduli * squares / states).sum(axis=0)
                J3 = np.exp(volume)
                pressure = law.shear_modulus * J3 * law.volumetric(J3, law.parameters)[1]
                return squares, states, float(energy[0]), stress - stress.mean() + pressure

            volume = scipy.optimize.newton(
                lambda x, at=at: at(x)[-1][2], volume, tol=1e-12, disp=False
            )
            squares, states, energy, stress = at(volume)
            # SciPy's search may stop at rounding without having converged by its own measure.
            if not abs(stress[2]) <= ROUNDED * law.bulk_modulus:
                return found
            peak = max(peak, energy)
        before = stretch[row]
        found.stretches[row] = np.sqrt(squares) * np.exp(volume / 3)
        found.nominal_stress[row] = stress[0] / before
        found.states[row] = states
    return found
