"""Multilayer perceptrons of one to three hidden layers as bond-force block functions, and their NumPy twin.

Units are packed in groups of four, whose weights are scalars of the inner loop over bonds: a state is loaded once for four units, and an
accumulator is written once for four. Inputs are padded to a multiple of four with zero weights, except a pair of inputs to a single hidden
layer.
"""

from functools import cache

import numpy as np
from numba import carray

from ..engine.block_arrays import BLOCK, STATE_ROWS, TRACTION_ROWS, block_rows, column_like, put_column
from ..engine.compile import bond_force_signature, compile_block_function, inlined, kernel, widest_vectors
from .feature_sets import FeatureSet

GROUP = 4

PAIR = 2
"""Number of inputs that a single hidden layer takes without padding."""

N_OUTPUTS = 2
"""Number of outputs of every bond-force network; the feature set defines their meaning."""


MOST_HIDDEN = 3
"""Greatest number of hidden layers."""

MOST_SHARED = 2
"""Greatest number of values that the functions of a feature set share."""

N_WEIGHTS, N_WORK_ROWS, N_HIDDEN, WIDTHS = 0, 1, 2, 3
"""Places in a network's sizes: length of its weights, rows of working memory, hidden layers, then the widths of inputs and hidden layers.
"""

N_SIZES = WIDTHS + 1 + MOST_HIDDEN


def pack(layers, at_rest, dtype):
    """Pack the layers of a network for `network_block`: return its sizes and its weights in `dtype`.

    `layers` lists (weights, biases), weights of shape (n_in, n_out), the output layer last; `at_rest` is subtracted from the two outputs.
    Raise ValueError for more hidden layers than `MOST_HIDDEN`, or other than two outputs.
    """
    hidden, (output_weights, output_biases) = layers[:-1], layers[-1]
    if not 1 <= len(hidden) <= MOST_HIDDEN:
        raise ValueError(f"a network needs one to {MOST_HIDDEN} hidden layers, this one has {len(hidden)}")
    if output_weights.shape[1] != N_OUTPUTS:
        raise ValueError(f"a bond-force network has {N_OUTPUTS} outputs, this one {output_weights.shape[1]}")
    n_inputs = hidden[0][0].shape[0]
    widths = [n_inputs if n_inputs == PAIR and len(hidden) == 1 else _padded(n_inputs)] + [_padded(biases.size) for _, biases in hidden]
    parts = []
    for (weights, biases), n_in, n_out in zip(hidden, widths[:-1], widths[1:], strict=True):
        W = np.zeros((n_in, n_out))
        W[: weights.shape[0], : weights.shape[1]] = weights
        B = np.zeros(n_out)
        B[: biases.size] = biases
        for group in range(0, n_out, GROUP):
            parts += [B[group : group + GROUP], W[:, group : group + GROUP].ravel()]
    V = np.zeros((widths[-1], N_OUTPUTS))
    V[: output_weights.shape[0]] = output_weights
    parts += [V[group : group + GROUP].T.ravel() for group in range(0, widths[-1], GROUP)]
    packed = np.concatenate([*parts, output_biases, at_rest]).astype(dtype)
    sizes = np.zeros(N_SIZES, dtype=np.int64)
    sizes[:WIDTHS] = packed.size, sum(widths) + MOST_SHARED + GROUP, len(hidden)
    sizes[WIDTHS : WIDTHS + len(widths)] = widths
    return sizes, packed


def network_outputs(features, layers, activation):
    """Return the outputs of a network in NumPy, shape (n, n_out), from features of shape (n, n_in); `layers` are those of `pack`."""
    *hidden, (output_weights, output_biases) = layers
    values = features
    for weights, biases in hidden:
        values = activation(values @ weights + biases)[0]
    return values @ output_weights + output_biases


def _padded(width):
    """Return the width rounded up to whole groups."""
    return -(-width // GROUP) * GROUP


@kernel
def _pre_activations(rows, n_rows, weights, z):
    """Compute four units of a layer before their activation: z = biases + rows @ weights."""
    widest_vectors()
    rows = block_rows(rows)
    z = block_rows(z)
    for k in range(BLOCK):
        z[0, k] = weights[0]
        z[1, k] = weights[1]
        z[2, k] = weights[2]
        z[3, k] = weights[3]
    for q in range(0, n_rows, GROUP):
        w = weights[GROUP + GROUP * q : GROUP + GROUP * (q + GROUP)]
        w00, w01, w02, w03 = w[0], w[1], w[2], w[3]
        w10, w11, w12, w13 = w[4], w[5], w[6], w[7]
        w20, w21, w22, w23 = w[8], w[9], w[10], w[11]
        w30, w31, w32, w33 = w[12], w[13], w[14], w[15]
        for k in range(BLOCK):
            x0 = rows[q, k]
            x1 = rows[q + 1, k]
            x2 = rows[q + 2, k]
            x3 = rows[q + 3, k]
            z[0, k] += w00 * x0 + w10 * x1 + w20 * x2 + w30 * x3
            z[1, k] += w01 * x0 + w11 * x1 + w21 * x2 + w31 * x3
            z[2, k] += w02 * x0 + w12 * x1 + w22 * x2 + w32 * x3
            z[3, k] += w03 * x0 + w13 * x1 + w23 * x2 + w33 * x3


@cache
def network_block(features: FeatureSet, activation, dtype):
    """Return the block function of networks with a feature set and an activation; `sizes` and `weights` from `pack` are arguments of it."""
    shared_of, inputs, traction_of = inlined(features.shared), inlined(features.inputs), inlined(features.traction)
    activate = inlined(activation)

    def network(states, sizes, weights, response, parameters, work, scratch, traction):
        widest_vectors()
        states = carray(states, (STATE_ROWS, BLOCK))
        traction = carray(traction, (TRACTION_ROWS, BLOCK))
        sizes = carray(sizes, (N_SIZES,))
        weights = carray(weights, (sizes[N_WEIGHTS],))
        work = carray(work, (sizes[N_WORK_ROWS], BLOCK))
        n_hidden = sizes[N_HIDDEN]
        width = sizes[WIDTHS]
        rows = block_rows(work[0:width])
        kept = block_rows(work[width : width + MOST_SHARED])
        for k in range(BLOCK):
            a, b, U_mm, J, C33 = states[0, k], states[1, k], states[2, k], states[3, k], states[4, k]
            shared = shared_of(a, b, J, C33)
            values = inputs(shared, a, b, U_mm, J, C33, states[5, k])
            put_column(kept, k, shared)
            put_column(rows, k, values)
        for q in range(len(values), width):
            for k in range(BLOCK):
                rows[q, k] = 0
        at = 0
        free = width + MOST_SHARED
        for layer in range(1, n_hidden):
            units = sizes[WIDTHS + layer]
            activated = block_rows(work[free : free + units])
            for group in range(0, units, GROUP):
                z = block_rows(activated[group : group + GROUP])
                size = GROUP * (1 + width)
                _pre_activations(rows, width, weights[at : at + size], z)
                at += size
                for r in range(GROUP):
                    for k in range(BLOCK):
                        z[r, k] = activate(z[r, k])[0]
            free += units
            rows = activated
            width = units

        units = sizes[WIDTHS + n_hidden]
        outputs = at + units * (1 + width)
        last = outputs + units * N_OUTPUTS
        for k in range(BLOCK):
            traction[0, k] = weights[last]
            traction[1, k] = weights[last + 1]
        z = block_rows(work[free : free + GROUP])
        for group in range(0, units, GROUP):
            w = weights[at : at + GROUP * (1 + width)]
            at += GROUP * (1 + width)
            v = weights[outputs + N_OUTPUTS * group : outputs + N_OUTPUTS * (group + GROUP)]
            u0, u1, u2, u3 = v[0], v[1], v[2], v[3]
            v0, v1, v2, v3 = v[4], v[5], v[6], v[7]
            if width == GROUP:
                b0, b1, b2, b3 = w[0], w[1], w[2], w[3]
                w00, w01, w02, w03 = w[4], w[5], w[6], w[7]
                w10, w11, w12, w13 = w[8], w[9], w[10], w[11]
                w20, w21, w22, w23 = w[12], w[13], w[14], w[15]
                w30, w31, w32, w33 = w[16], w[17], w[18], w[19]
                for k in range(BLOCK):
                    x0 = rows[0, k]
                    x1 = rows[1, k]
                    x2 = rows[2, k]
                    x3 = rows[3, k]
                    z0 = activate(b0 + w00 * x0 + w10 * x1 + w20 * x2 + w30 * x3)[0]
                    z1 = activate(b1 + w01 * x0 + w11 * x1 + w21 * x2 + w31 * x3)[0]
                    z2 = activate(b2 + w02 * x0 + w12 * x1 + w22 * x2 + w32 * x3)[0]
                    z3 = activate(b3 + w03 * x0 + w13 * x1 + w23 * x2 + w33 * x3)[0]
                    traction[0, k] += u0 * z0 + u1 * z1 + u2 * z2 + u3 * z3
                    traction[1, k] += v0 * z0 + v1 * z1 + v2 * z2 + v3 * z3
            elif width == PAIR:
                b0, b1, b2, b3 = w[0], w[1], w[2], w[3]
                w00, w01, w02, w03 = w[4], w[5], w[6], w[7]
                w10, w11, w12, w13 = w[8], w[9], w[10], w[11]
                for k in range(BLOCK):
                    x0 = rows[0, k]
                    x1 = rows[1, k]
                    z0 = activate(b0 + w00 * x0 + w10 * x1)[0]
                    z1 = activate(b1 + w01 * x0 + w11 * x1)[0]
                    z2 = activate(b2 + w02 * x0 + w12 * x1)[0]
                    z3 = activate(b3 + w03 * x0 + w13 * x1)[0]
                    traction[0, k] += u0 * z0 + u1 * z1 + u2 * z2 + u3 * z3
                    traction[1, k] += v0 * z0 + v1 * z1 + v2 * z2 + v3 * z3
            else:
                _pre_activations(rows, width, w, z)
                for k in range(BLOCK):
                    z0 = activate(z[0, k])[0]
                    z1 = activate(z[1, k])[0]
                    z2 = activate(z[2, k])[0]
                    z3 = activate(z[3, k])[0]
                    traction[0, k] += u0 * z0 + u1 * z1 + u2 * z2 + u3 * z3
                    traction[1, k] += v0 * z0 + v1 * z1 + v2 * z2 + v3 * z3
        rest0 = weights[last + 2]
        rest1 = weights[last + 3]
        for k in range(BLOCK):
            a, b, U_mm, J, C33 = states[0, k], states[1, k], states[2, k], states[3, k], states[4, k]
            again = column_like(kept, k, shared)
            T_nn, T_nm, T_mm = traction_of(again, traction[0, k] - rest0, traction[1, k] - rest1, a, b, U_mm, J, C33)
            traction[0, k] = T_nn
            traction[1, k] = T_nm
            traction[2, k] = T_mm

    return compile_block_function(network, bond_force_signature(np.dtype(dtype)))
