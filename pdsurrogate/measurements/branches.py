"""Course of a mechanical test: the break, loading and unloading, holds and cycles, hysteresis, and
the stretch at zero force.
"""

from itertools import pairwise

import numpy as np

LEAST = 0.01
"""Fraction of the range of strain by which it must turn back to be of another branch. Chosen: the
scatter of stresses in any laboratory, which a smaller reversal does not exceed.
"""

SETTLED = 0.1
"""Fraction of the duration of a branch during which the strain stands still in a hold."""

FALLEN = ((1 + LEAST, 0.8), (0.98, 0.5), (0.8, 0.1))
"""Break: the stress falls from its peak to at most the second fraction while the strain is still
above the first one. Elastic unloading, also of filled rubber, keeps more stress.
"""

SUDDEN = 0.3
"""Least fraction of the peak that the stress of a specimen that breaks loses from one row to the
next, unless it stretches further or the fall is quick: stress that relaxes in a hold takes longer
than a tenth of the loading, in which it would have relaxed as well; unloading goes by and by.
"""

MOST_SLACK = 0.3
"""Greatest slack before the first row with a force, as a fraction of the range of strain."""

MOST_PRELOAD = 0.1
"""Greatest strain of a preload, as a fraction of that range: no row shows where the force is zero,
and farther from the rows it may as well be a stress that relaxes.
"""

UNORDERED = 4.0
"""Least mean number of rows of a branch: rows that turn more often are in no order."""


def strain_of(stretch: np.ndarray) -> np.ndarray:
    """Return the size of the logarithmic strain, in tension and in compression."""
    return np.abs(np.log(stretch))


def break_row(stretch: np.ndarray, stress: np.ndarray, time: np.ndarray) -> int | None:
    """Return the last row before the specimen breaks, that of the peak of the stress; None if it
    does not break.
    """
    strain, size = strain_of(stretch), np.abs(stress)
    peak = int(size.argmax())
    after = slice(peak + 1, None)
    if not size[after].size or not strain[peak] * size[peak]:
        return None
    same = np.sign(stretch[after] - 1) == np.sign(stretch[peak] - 1)
    share, rest = same * strain[after] / strain[peak], size[after] / size[peak]
    sudden = float(-np.diff(rest, prepend=1.0).min()) >= SUDDEN
    clock = time if (np.diff(time) > 0).all() else np.arange(len(stretch), dtype=float)
    quick = clock[after] - clock[peak] <= SETTLED * (clock[peak] - clock[0])
    going = sudden | (quick & (share > 1 - LEAST / 10))
    broken = any(
        ((share > least) & (rest <= most) & (going | (least > 1))).any() for least, most in FALLEN
    )
    # A camera or clip that loses the specimen jumps back at once, and no load ever returns.
    lost = peak > 0 and rest[0] <= FALLEN[-1][1] and bool((rest <= 2 * FALLEN[-1][1]).all())
    return peak if broken or lost else None


def records(stretch: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the number of the record, from 0, of every row: rows that jump back to the start and
    load again are of a further specimen, unless time goes on.
    """
    strain = strain_of(stretch)
    span = np.ptp(strain)
    if unordered(turning_points(stretch, LEAST * float(np.ptp(stretch)))):
        return np.zeros(len(stretch), dtype=int)
    jumps = (np.diff(strain) < -0.5 * span) & ~(np.diff(time) > 0)
    for row in np.flatnonzero(jumps):
        rising = np.diff(strain[row + 1 : row + 4])
        jumps[row] = len(rising) == 2 and bool((rising > LEAST * span).all())
    return np.r_[0, np.cumsum(jumps)]


def turning_points(stretch: np.ndarray, least: float) -> list[int]:
    """Return the rows at which the stretch turns by more than `least`, with the first and last."""
    found, low, high, rising = [0], 0, 0, None
    for row, value in enumerate(stretch.tolist()):
        high = row if value > stretch[high] else high
        low = row if value < stretch[low] else low
        if rising is not False and stretch[high] - value > least:
            found += [] if rising is None else [high]
            rising, low = False, row
        elif rising is not True and value - stretch[low] > least:
            found += [] if rising is None else [low]
            rising, high = True, row
    return [*found, len(stretch) - 1]


def unordered(turns: list[int]) -> bool:
    """Whether rows that turn at some of them are in no order."""
    return len(turns) > 3 and turns[-1] < UNORDERED * (len(turns) - 1)


def branches(
    stretch: np.ndarray, time: np.ndarray, resolution: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return branch ("loading", "unloading" or "hold") and cycle, from 1, of every row of a
    specimen up to its break; rows in no order are all of loading.
    """
    least = max(LEAST * float(np.ptp(stretch)), 2.5 * resolution)
    turns = turning_points(stretch, least)
    branch, cycle = np.full(len(stretch), "loading", dtype="<U9"), np.ones(len(stretch), dtype=int)
    timed = bool((np.diff(time) > 0).any())

    def crosses(first: int, last: int) -> bool:
        """Whether rows go from tension to compression or back."""
        ends = stretch[[first, last]] - 1
        return bool(ends.prod() < 0 and (np.abs(ends) > least).all())

    listed = len(turns) == 2 and (not timed or crosses(*turns))
    if listed or unordered(turns):
        return branch, cycle
    clock = time if timed and (np.diff(time) >= 0).all() else np.arange(len(stretch), dtype=float)
    number, holds = 1, []
    for first, last in pairwise(turns):
        rows = np.arange(first + (first > 0), last + 1)
        back = np.full(len(rows), abs(stretch[last] - 1) < abs(stretch[first] - 1))
        if crosses(first, last):
            back = (stretch[rows] - 1) * (stretch[first] - 1) > 0
        branch[rows[back]] = "unloading"
        cycle[rows] = number
        if first > 0 and not back.all():
            number += 1
            cycle[rows[~back]] = number
        travel = abs(stretch[last] - stretch[first])
        # A turn alone is within `least` for thrice as long as a straight way.
        share = max(SETTLED, 5 * least / travel) if travel > 0 else SETTLED
        holds += _holds(stretch, clock, first, last, least, share)
    for hold in holds:
        branch[hold] = "hold"
    return branch, cycle


def _holds(stretch, clock, first, last, least, share) -> list[slice]:
    """Return slices that begin in rows first to last, in which the stretch stays within `least` for
    more than a share of their duration.
    """
    found, whole, start, end = [], clock[last] - clock[first], first, first
    while start < last:
        end = max(end, start)
        while end + 1 < len(stretch) and abs(stretch[end + 1] - stretch[start]) <= least:
            end += 1
        if end - start >= 3 and clock[end] - clock[start] > share * whole:
            middle = np.median(stretch[start : end + 1])
            while abs(stretch[start] - middle) > least / 4:
                start += 1
            found.append(slice(start + 1, end + 1))
            start = end
        start += 1
    return found


def creep(stretch: np.ndarray, stress: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return which rows of a first loading are of creep: the stress stands still for a tenth of the
    time at least, and the strain goes on at less than half of its rate before.
    """
    found = np.zeros(len(stretch), dtype=bool)
    if len(stretch) < 8 or not (np.diff(time) > 0).all():
        return found
    size = np.log(np.maximum(np.abs(stress), 0.05 * np.abs(stress).max() + 1e-300))
    for rows in _holds(size, time, 0, len(size) - 1, LEAST, SETTLED):
        rates = [
            abs(stretch[last] - stretch[first]) / (time[last] - time[first])
            for first, last in ((0, rows.start), (rows.start, rows.stop - 1))
            if last > first
        ]
        loaded = size[rows.start] > size.min()
        found[rows] = loaded and len(rates) == 2 and rates[1] < rates[0] / 2
    return found


def energy_lost(stretch: np.ndarray, stress: np.ndarray, branch, cycle) -> float | None:
    """Return the energy lost in the first cycle relative to the work of its loading, over the
    stretches of both branches; None if there is no unloading.
    """
    first = cycle == 1
    up, down = first & (branch == "loading"), first & (branch == "unloading")
    if up.sum() < 2 or not down.any():
        return None
    down[np.flatnonzero(up)[-1]] = True
    curves = []
    for rows in (up, down):
        order = np.argsort(stretch[rows], kind="stable")
        curves.append((stretch[rows][order], stress[rows][order]))
    least, most = (pick(c[0][end] for c in curves) for pick, end in ((max, 0), (min, -1)))
    places = np.linspace(least, most, 201)
    loaded, unloaded = (np.interp(places, *curve) for curve in curves)
    return float((loaded - unloaded).sum() / loaded.sum()) if loaded.sum() else None


def stretch_at_zero(stretch: np.ndarray, stress: np.ndarray, mode: str) -> float:
    """Return the stretch at zero force of a first loading: 1 unless the rows show slack (no force
    at first) or a preload (force at a stretch of 1).

    The rows up to a strain of 0.5 are fitted by Mooney's law, which describes most rubber there,
    with a shift of the stretch; slack is also found by a line through the first loaded rows.
    """
    size = np.abs(stress)
    start, greatest = stretch[size.argmin()], float(size.max())
    loaded = size > 0.005 * greatest
    if not loaded.all():  # the last row without force
        start = stretch[np.flatnonzero(~loaded)[-1]]
    some = (np.abs(stretch - start) <= 0.5) & loaded
    reach = min(1.0, float(np.abs(stretch - start).max()))
    if some.sum() < 5 or not reach > 0:
        return 1.0
    power = {"uniaxial": -2.0, "equibiaxial": -5.0, "pure-shear": -3.0}[mode]

    def misfit(shift: float) -> tuple[np.ndarray, float]:
        """Squared residuals, and slope at zero force."""
        x = stretch[some] - shift
        first = x - x**power
        second = first * (x**2 if mode == "equibiaxial" else 1 / x if mode == "uniaxial" else 1)
        columns = np.column_stack([first, second])
        weights = np.linalg.lstsq(columns, stress[some], rcond=None)[0]
        slope = (1 - power) * weights.sum()
        return (columns @ weights - stress[some]) ** 2, float(slope)

    middle = 0.0 if loaded.all() else start - 1
    shifts = middle + np.linspace(-MOST_SLACK, MOST_SLACK, 601) * reach
    shifts = shifts[stretch[some].min() - shifts > 0.1]
    best = min(shifts.tolist(), key=lambda one: misfit(one)[0].mean())
    error, slope = misfit(best)
    side, slack = float(np.sign(stretch[size.argmax()] - start)), abs(best)
    moved = side * (stretch - 1)
    if misfit(0.0)[0].mean() >= 16 * error.mean() and slack >= 0.01 * reach:
        if best * side > 0:
            shown = bool(((moved > slack / 2) & (size < slope * slack / 4)).any())
        else:  # no row is without force: all have it, and the curve near them
            near = np.abs(stretch[some] - start) <= 4 * slack
            shown = bool((np.abs(moved) < slack / 4).any() and size.min() > slope * slack / 2)
            shown &= bool(error[near].mean() < (slope * slack / 8) ** 2)
            shown &= slack <= MOST_PRELOAD * reach
        if shown:
            return 1.0 + best
    rows = np.flatnonzero(some)[:4]
    line = np.column_stack([moved[rows], np.ones(len(rows))])
    slope, there = np.linalg.lstsq(line, size[rows], rcond=None)[0]
    slack = -there / slope if slope > 0 else 0.0
    slope *= slack / 4  # a quarter of the force that slack would have had
    unloaded = (moved > slack / 2) & ~loaded & (0.005 * greatest < slope)
    return 1.0 + side * float(slack) if slack >= 0.01 * reach and unloaded.any() else 1.0
