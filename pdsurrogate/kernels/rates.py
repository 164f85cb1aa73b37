"""Relaxation times of branches that fall with the overstress, theory (101), (102): the relaxation
times that pass in a step.

A branch relaxes f(s) times faster at an overstress s^2 = tr(S^2)/2 than near rest. log f is a sum
of hinges d max(0, log s - u) with the `knots` (u, d) of the branch. If x relaxation times pass in a
step, the step is that of a branch of constant time (`branches`), and x follows from the mean of 1/f
over it.

Functions take reals, or arrays from Python, and contain no branch.
"""

from collections.abc import Callable

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows, put_column, rows_from
from ..engine.compile import inlined, widest_vectors
from ..engine.passes import Pass, share_of
from .algebra import ByDimension
from .branches import LONGEST, SERIES, tensors_of
from .elementary import exponential, logarithm, select
from .selective_energy import gradient_of_bond

LEAST = 1e-30
"""Squared overstress that counts as none; its rounding errors are greater."""

SETTLED = 1e-7
"""Last change of log x in a search: the error of a secant's step is far below it."""

NONE = 1e300
"""Residual before the first trial."""

MOST_ITERATIONS = 60
"""Most iterations of a search; four or five are usual."""


@inlined
def log_overstress(first, second):
    """Return log s of a state whose invariants are Cb : C_k^-1 and Cb^-1 : C_k."""
    square = first * first * (1.0 / 3.0) - second
    return 0.5 * logarithm(select(square > LEAST, square, LEAST))


@inlined
def log_mean_time(begin, end):
    """Return the logarithm of the mean of 1/f over a step in which log f changes linearly with the
    relaxation times that have passed.
    """
    change = end - begin
    small = (change < SERIES) & (change > -SERIES)
    d = select(small, change, 0.0)
    safe = select(small, 1.0, change)
    series = 1.0 - d * (0.5 - d * (1 / 6 - d * (1 / 24 - d / 120)))
    mean = select(small, series, (1.0 - exponential(-safe)) / safe)
    return logarithm(mean) - begin


@inlined
def next_trial(x, residual, before, low, high):
    """Return the next trial of a search, and the bounds of its zero; `before` are x and residual of
    the trial before, `NONE` at first.
    """
    low = select(residual < 0.0, x, low)
    high = select(residual < 0.0, high, x)
    risen = residual - before[1]
    steep = abs(risen) > 0.0
    slope = (x - before[0]) / select(steep, risen, 1.0)
    # The residual rises at least as fast as x, but where a body is unloaded.
    slope = select(steep & (slope > 0.0) & (before[1] < NONE), slope, 1.0)
    found = x - slope * residual
    inside = (found >= low) & (found <= high)
    return select(inside, found, 0.5 * (low + high)), low, high


def times_passed(
    steps: np.ndarray, begun: np.ndarray, log_rate: Callable, greatest: np.ndarray
) -> np.ndarray:
    """Return how many relaxation times pass in steps of `steps` times near rest.

    `begun` are log f at the beginning, `log_rate` gives those at the end by the times that have
    passed, and `greatest` is the greatest log f.
    """
    some = np.isfinite(steps) & (steps > 0)
    start = np.log(np.where(some, steps, 1.0))
    low, high = start, start + greatest
    x, before = start + begun, (0.0, NONE)
    for _ in range(MOST_ITERATIONS):
        residual = x - start + log_mean_time(begun, log_rate(np.exp(x)))
        new, low, high = next_trial(x, residual, before, low, high)
        x, before, moved = new, (x, residual), np.abs(new - x)
        if not (moved > SETTLED).any():
            break
    return np.where(some, np.exp(x), steps)


def search_rows(dimension: int) -> int:
    """Return the number of rows of a thread's buffer for `passed_times`."""
    return dimension * dimension + dimension + 3 * tensors_of(dimension).TENSOR + 9


@ByDimension
def passed_times(algebra):
    """Build the pass that finds how many relaxation times pass in a step."""
    tensors = tensors_of(algebra.DIMENSION)
    of_bond = gradient_of_bond(algebra)
    tensor = tensors.TENSOR
    state_rows = algebra.MATRIX + algebra.DIMENSION
    # Rows of Cb at both ends and of C_k; of log f and log s, and of the search.
    rate_row = 3 * tensor
    search_row = rate_row + 3

    @inlined
    def overstress(Cb, C_k):
        return log_overstress(
            tensors.contraction(Cb, tensors.cofactor_of(C_k)),
            tensors.contraction(C_k, tensors.cofactor_of(Cb)),
        )

    @inlined
    def add_hinges(knots, logs, rates):
        """Write log f at `logs` to `rates`, rows of a block."""
        for k in range(BLOCK):
            rates[0, k] = 0.0
        for knot in range(knots.shape[1]):
            place, change = knots[0, knot], knots[1, knot]
            for k in range(BLOCK):
                above = logs[0, k] - place
                rates[0, k] += change * select(above > 0.0, above, 0.0)

    @Pass
    def passed_times(
        chunk,
        elapsed,
        positions,
        gradients,
        ends,
        geometry,
        volumes,
        pairs,
        times,
        all_knots,
        history,
        buffers,
        found,
    ):
        """Write the relaxation times that pass in a time `elapsed` between the state of the
        `history` and that at these positions to `found` (n_blocks, n_branches, BLOCK).

        `all_knots` (n_branches, 2, n_knots) are those of the branches, all else as in
        `selective_memory.accept_steps`.
        """
        states, all_strains, _, _, _ = history
        widest_vectors()
        sums = block_rows(buffers[chunk.thread])
        bonds = rows_from(sums, algebra.MATRIX)
        strains = rows_from(sums, state_rows)
        before = rows_from(strains, tensor)
        C_k = rows_from(before, tensor)
        begun = rows_from(strains, rate_row)
        ended = rows_from(begun, 1)
        logs = rows_from(begun, 2)
        search = rows_from(strains, search_row)
        free = volumes.shape[0] > 0
        for block in share_of(geometry.shape[0], chunk):
            at = block * BLOCK
            reference = block_rows(geometry[block])
            into = block_rows(found[block])
            for k in range(0, BLOCK, 4):
                algebra.gather_pairs(gradients, positions, ends, at + k, sums, bonds, k)
                tensors.take_listed(all_strains, tensor, pairs, at + k, 0, before, k)
            for k in range(BLOCK):
                F = of_bond(sums, bonds, reference, k)
                J = algebra.determinant(F)
                J3 = volumes[at + k] if free else J
                Cb = tensors.isochoric(tensors.green(F, (J3 / J) * (J3 / J)), J3)
                put_column(strains, k, Cb)
                ended[0, k] = select(J > 0.0, J3, J)
            for k in range(BLOCK):
                # A first guess may turn pairs inside out: they count as held.
                for n in range(tensor):
                    strains[n, k] = select(ended[0, k] > 0.0, strains[n, k], before[n, k])
            for branch in range(times.shape[0]):
                h = elapsed / times[branch]
                knots = all_knots[branch]
                if not 0.0 < h < LONGEST:
                    for k in range(BLOCK):
                        into[branch, k] = h
                    continue
                longest = 0.0
                for knot in range(knots.shape[1]):
                    longest -= knots[0, knot] * knots[1, knot]
                start = np.log(h)
                for k in range(0, BLOCK, 4):
                    tensors.take_listed(
                        states, states.shape[1], pairs, at + k, branch * tensor, C_k, k
                    )
                for k in range(BLOCK):
                    logs[0, k] = overstress(tensors.tensor_at(before, k), tensors.tensor_at(C_k, k))
                add_hinges(knots, logs, begun)
                for k in range(BLOCK):
                    put_column(
                        search, k, (start + begun[0, k], 0.0, NONE, start, start + longest, 0.0)
                    )
                for _ in range(MOST_ITERATIONS):
                    for k in range(BLOCK):
                        Cb = tensors.tensor_at(strains, k)
                        B, b = tensors.begin_step(
                            tensors.tensor_at(C_k, k),
                            tensors.tensor_at(before, k),
                            exponential(search[0, k]),
                        )
                        logs[0, k] = overstress(Cb, tensors.end_step(B, b, Cb))
                    add_hinges(knots, logs, ended)
                    unsettled = 0.0
                    for k in range(BLOCK):
                        x = search[0, k]
                        residual = x - start + log_mean_time(begun[0, k], ended[0, k])
                        known = search[1, k], search[2, k]
                        new, low, high = next_trial(x, residual, known, search[3, k], search[4, k])
                        # A settled pair stays as it is while others of its block go on.
                        done = search[5, k]
                        new = select(done > 0.0, x, new)
                        done = select(abs(new - x) > SETTLED, done, 1.0)
                        put_column(search, k, (new, x, residual, low, high, done))
                        unsettled += 1.0 - done
                    if unsettled == 0.0:
                        break
                for k in range(BLOCK):
                    into[branch, k] = exponential(search[0, k])

    return passed_times
