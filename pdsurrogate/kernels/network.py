"""Multilayer perceptrons: activations, packed weights, sums of hidden units, and the compiled bond
force with its NumPy twin.

Four units are packed into a group, whose weights are scalars of the inner loop over a block of
bonds: a state is loaded once for four units, and an accumulator is written once for four units.
Networks of a bond force have one to three hidden layers; their inputs are padded to a multiple of
four with zero weights; only the two inputs of a network with one hidden layer are not padded.

Activation functions return their first and second derivative, too: a network that represents an
energy gives the stress through the slope and the stiffness through the curvature. NumPy evaluates
the same expressions for checks and training; compiled, unused derivatives cost nothing. The
algebraic sigmoid is exact to rounding; the others use `exponential`, whose error is below 2e-7 in
single and 1e-15 in double precision.
"""

from functools import cache

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows, put_column, tuple_of
from ..engine.compile import compile_bond_force, expanded, inlined, kernel, widest_vectors
from .algebra import entries, state_at, total
from .elementary import exponential, inverse_square_root, like, select
from .feature_sets import MOST_SHARED, N_OUTPUTS, FeatureSet, write_tractions

GROUP = 4
"""Units that are evaluated together: a state is loaded, and an accumulator written, once for all of
them. Chosen: a smaller group loads each state more often, and a larger one pads narrow layers with
more units.
"""

SQUARE = GROUP * GROUP
"""Number of weights between a group of inputs and a group of units, each of `GROUP` members."""

PAIR = 2
"""Number of inputs that a single hidden layer reads without padding."""

PAIR_WEIGHTS = (PAIR + 2) * GROUP
"""Number of weights of a group of units with a pair of inputs and one output: biases, weights of
both inputs, output weights.
"""

MOST_HIDDEN = 3
"""Greatest number of hidden layers, whose widths `N_SIZES` provides for. Chosen: two to four
features need no more.
"""

N_WORK_ROWS = 0
N_HIDDEN = 1
WIDTHS = 2
"""Indices in a network's array of sizes: its number of rows of working memory, its number of hidden
layers, and the first of the widths of its inputs and hidden layers.
"""

N_SIZES = WIDTHS + 1 + MOST_HIDDEN


def algebraic(x):
    """Return the value, slope and curvature of x / sqrt(1 + x^2), the cheapest smooth sigmoid.

    All three follow from one inverse square root.
    """
    r = inverse_square_root(like(x, 1.0) + x * x)
    slope = r * r * r
    return x * r, slope, like(x, -3.0) * x * slope * r * r


def logistic(x):
    """Return the value, slope and curvature of 1 / (1 + exp(-x))."""
    value = like(x, 1.0) / (like(x, 1.0) + exponential(-x))
    slope = value * (like(x, 1.0) - value)
    return value, slope, slope * (like(x, 1.0) - value - value)


def tanh(x):
    """Return the value, slope and curvature of tanh x as 1 - 2/(1 + exp(2x)); the error near 0
    is that of rounding numbers near 1.
    """
    value = like(x, 1.0) - like(x, 2.0) / (like(x, 1.0) + exponential(x + x))
    slope = like(x, 1.0) - value * value
    return value, slope, like(x, -2.0) * value * slope


def relu(x):
    """Return the value, slope and curvature of max(x, 0)."""
    zero = like(x, 0.0)
    return np.maximum(x, zero), select(x > zero, like(x, 1.0), zero), zero


def identity(x):
    """Return the value, slope and curvature of the activation x: x, 1 and 0."""
    return x, like(x, 1.0), like(x, 0.0)


ACTIVATIONS = {
    function.__name__: function for function in (algebraic, logistic, tanh, relu, identity)
}
"""Activation functions ``f(x) -> (value, slope, curvature)`` by name: those of scikit-learn's
``MLPRegressor`` and the algebraic sigmoid.
"""

SMOOTH = ("algebraic", "logistic", "tanh")
"""Names of the activations smooth enough for a network that represents an energy."""


def groups_of(rows):
    """Cut a matrix into groups of four columns, and return each group as a vector, row by row.

    The last group is padded with zeros.
    """
    padded = np.pad(rows, ((0, 0), (0, -rows.shape[1] % GROUP)))
    return [padded[:, at : at + GROUP].ravel() for at in range(0, padded.shape[1], GROUP)]


def units_of(n_inputs):
    """Return the function ``units(w, x)`` that computes four hidden units before their activation:
    biases + weights times inputs.

    `w` is a tuple of four biases and four weights for each input, `x` a tuple of `n_inputs` inputs.
    """
    sums = [
        [f"w[{r}]", *(f"w[{GROUP * (q + 1) + r}] * x[{q}]" for q in range(n_inputs))]
        for r in range(GROUP)
    ]
    return entries("w, x", [total(terms) for terms in sums])


column_of_pair, column_of_group = (
    entries("rows, k", [f"rows[{r}, k]" for r in range(count)]) for count in (PAIR, GROUP)
)
units_of_pair = units_of(PAIR)
units_of_group = units_of(GROUP)


def pack_units(hidden_weights, hidden_biases, output_weights):
    """Pack the weights of hidden units with two inputs and one output into one vector, in groups
    of four units, for `unit_sums`.
    """
    return np.concatenate(groups_of(np.vstack([hidden_biases, hidden_weights, output_weights])))


def unit_sums(activation):
    """Return the function that evaluates a hidden layer of two features p and q over a block, and
    its derivatives by both features.

    It adds ``v a(b + w1 p + w2 q)``, summed over the units, to row 0 of `sums`, its derivative by p
    to row 1 and its derivative by q to row
    2. Here a is the `activation`, and w1, w2, b and v are the two input weights, the bias and the
       output weight of a unit. `weights` begin with those from `pack_units`; `units` is the number
       of units.
    """
    activate = inlined(activation)
    converted = entries("x, w", [f"like(x, w[{n}])" for n in range(PAIR_WEIGHTS)])

    @expanded
    def add_units(features, weights, units, sums):
        for at in range(0, GROUP * units, PAIR_WEIGHTS):
            w = converted(sums[0, 0], tuple_of(weights[at : at + PAIR_WEIGHTS], PAIR_WEIGHTS))
            for k in range(BLOCK):
                z = units_of_pair(w, column_of_pair(features, k))
                a0, d0, _ = activate(z[0])
                a1, d1, _ = activate(z[1])
                a2, d2, _ = activate(z[2])
                a3, d3, _ = activate(z[3])
                d0 = w[12] * d0
                d1 = w[13] * d1
                d2 = w[14] * d2
                d3 = w[15] * d3
                sums[0, k] += w[12] * a0 + w[13] * a1 + w[14] * a2 + w[15] * a3
                sums[1, k] += w[4] * d0 + w[5] * d1 + w[6] * d2 + w[7] * d3
                sums[2, k] += w[8] * d0 + w[9] * d1 + w[10] * d2 + w[11] * d3

    return add_units


def pack(layers, at_rest, dtype):
    """Pack the layers of a bond-force network for `network_block`: return its sizes and its weights
    in `dtype`.

    `layers` lists (weights, biases), weights of shape (n_in, n_out), the output layer last;
    `at_rest`, the two outputs in the undeformed state, is appended for subtraction.
    """
    hidden = layers[:-1]
    output_weights, output_biases = layers[-1]
    n_inputs = hidden[0][0].shape[0]
    widths = [n_inputs if n_inputs == PAIR and len(hidden) == 1 else _padded(n_inputs)] + [
        _padded(biases.size) for _, biases in hidden
    ]
    parts = []
    for (weights, biases), n_in in zip(hidden, widths[:-1], strict=True):
        parts += groups_of(
            np.vstack([biases, np.pad(weights, ((0, n_in - weights.shape[0]), (0, 0)))])
        )
    parts += groups_of(output_weights.T)
    packed = np.concatenate([*parts, output_biases, at_rest]).astype(dtype)
    sizes = np.zeros(N_SIZES, dtype=np.int64)
    sizes[:WIDTHS] = sum(widths) + MOST_SHARED + GROUP, len(hidden)
    sizes[WIDTHS : WIDTHS + len(widths)] = widths
    return sizes, packed


def network_outputs(features, layers, activation):
    """Evaluate a network in NumPy: return its outputs, shape (n, n_out), from features of shape (n,
    n_in).

    `layers` lists (weights, biases) with the output layer last, as for `pack`.
    """
    *hidden, (output_weights, output_biases) = layers
    values = features
    for weights, biases in hidden:
        values = activation(values @ weights + biases)[0]
    return values @ output_weights + output_biases


def _padded(width):
    """Return the number of units of a layer rounded up to a multiple of four (`GROUP`)."""
    return -(-width // GROUP) * GROUP


@kernel
def _pre_activations(rows, n_rows, weights, z):
    """Compute four units of a layer over a block before their activation: z = biases + weights
    times the first `n_rows` rows of `rows`.

    `weights` holds the four biases, then the weights of the four units for each input.
    """
    widest_vectors()
    rows = block_rows(rows)
    z = block_rows(z)
    biases = tuple_of(weights, GROUP)
    for k in range(BLOCK):
        put_column(z, k, biases)
    for q in range(0, n_rows, GROUP):
        w = tuple_of(weights[GROUP * (1 + q) :], SQUARE)
        inputs = block_rows(rows[q : q + GROUP])
        for k in range(BLOCK):
            put_column(z, k, units_of_group(column_of_group(z, k) + w, column_of_group(inputs, k)))


def add_outputs(activate, column, units, n_weights):
    """Return the function that evaluates four units of the last hidden layer over a block and adds
    their contributions to both outputs.

    `activate` is the activation, and ``units(w, x)`` computes the four units before their
    activation from `n_weights` weights and from x, the column of inputs that ``column(rows, k)``
    returns for bond k.
    """
    n_outputs = GROUP * N_OUTPUTS

    @expanded
    def add(rows, weights, output_weights, outputs):
        w = tuple_of(weights, n_weights)
        v = tuple_of(output_weights, n_outputs)
        for k in range(BLOCK):
            z = units(w, column(rows, k))
            z0 = activate(z[0])[0]
            z1 = activate(z[1])[0]
            z2 = activate(z[2])[0]
            z3 = activate(z[3])[0]
            outputs[0, k] += v[0] * z0 + v[1] * z1 + v[2] * z2 + v[3] * z3
            outputs[1, k] += v[4] * z0 + v[5] * z1 + v[6] * z2 + v[7] * z3

    return add


@cache
def network_block(features: FeatureSet, activation, dtype):
    """Return the function, compiled for blocks of bonds, that evaluates networks with a feature set
    and an activation as a bond force.

    The function takes the sizes and weights from `pack` as arguments.
    """
    shared_of = inlined(features.shared)
    inputs = inlined(features.inputs)
    activate = inlined(activation)
    put_tractions = write_tractions(features)
    add_from_pair = add_outputs(activate, column_of_pair, units_of_pair, GROUP * (1 + PAIR))
    add_from_group = add_outputs(activate, column_of_group, units_of_group, GROUP * (1 + GROUP))
    add_from_units = add_outputs(activate, column_of_group, inlined(lambda w, x: x), GROUP)

    def network(states, sizes, weights, response, parameters, work, scratch, traction):
        n_hidden = sizes[N_HIDDEN]
        width = sizes[WIDTHS]
        rows = block_rows(work[0:width])
        kept = block_rows(work[width : width + MOST_SHARED])
        for k in range(BLOCK):
            a, b, U_mm, J, C33 = state_at(states, k)
            shared = shared_of(a, b, J, C33)
            values = inputs(shared, a, b, U_mm, J, C33, states[5, k])
            put_column(kept, k, shared)
            put_column(rows, k, values)
        rows[len(values) : width] = 0
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
            if width == GROUP:
                add_from_group(rows, w, v, traction)
            elif width == PAIR:
                add_from_pair(rows, w, v, traction)
            else:
                _pre_activations(rows, width, w, z)
                add_from_units(z, w, v, traction)
        put_tractions(states, kept, weights[last + 2 :], traction)

    return compile_bond_force(network, dtype)
