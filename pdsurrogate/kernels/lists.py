"""Lists of the pairs of points, and points whose bonds are alike (`pdsurrogate.body`)."""

import numpy as np

from ..engine.compile import inlined, kernel

ODD = np.uint64(0x9E3779B97F4A7C15)
"""An odd number of 64 bits, half of them ones, that mixes others by multiplication."""


@kernel
def pairs_on_lattice(table, places, ways, first, second):
    """Return how many pairs i < j of points on a lattice there are, sorted by i and j; write as
    many of them as `first` and `second` have room for.

    `table` holds the number of the point at each place of the lattice, -1 where there is none;
    `places` (n,) are those of the points i, and `ways` lead from there to the others.
    """
    count = 0
    ends = np.empty(ways.shape[0], dtype=np.int64)
    for i in range(places.shape[0]):
        many = 0
        for way in ways:
            j = table[places[i] + way]
            if j > i:
                # images may be out of order
                k = many
                while k > 0 and ends[k - 1] > j:
                    ends[k] = ends[k - 1]
                    k -= 1
                ends[k] = j
                many += 1
        if count + many <= first.shape[0]:
            for k in range(many):
                first[count + k] = i
                second[count + k] = ends[k]
        count += many
    return count


@kernel
def sort_numbers(numbers, pointers, order):
    """Write where the entries of each number begin once `numbers` (k,) are sorted to `pointers`,
    zeros before, and the stable order to `order`, unless that is empty; then all numbers must have
    a pointer.
    """
    for number in numbers:
        if number + np.uint32(1) < pointers.shape[0]:
            pointers[number + np.uint32(1)] += np.uint64(1)
    for i in range(1, pointers.shape[0]):
        pointers[i] += pointers[i - 1]
    if order.shape[0] > 0:
        place = pointers.copy()
        for k in range(numbers.shape[0]):
            order[place[numbers[k]]] = k
            place[numbers[k]] += np.uint64(1)


@inlined
def other_end(i, e, own, others, incidence, ends):
    """Return the other end of a pair of point i, by its place e: from ``others[i]`` on the pairs in
    which the point is second, then those in which it is first.
    """
    middle = others[i + 1]
    return ends[0, incidence[e]] if e < middle else ends[1, e - middle + own[i]]


@kernel
def list_ends(points, own, others, incidence, backward, forward, out):
    """Write values of the pairs of each of some `points`, one after the other: first of those in
    which it is second, from `backward`, then of those in which it is first, from `forward`.

    For the other arguments see `pdsurrogate.body.bonds.pairs_of_points`.
    """
    b = 0
    for i in points:
        for e in range(others[i], others[i + 1]):
            out[b] = backward[incidence[e]]
            b += 1
        for p in range(own[i], own[i + 1]):
            out[b] = forward[p]
            b += 1


@kernel
def add_to_ends(first, second, values, sign, out):
    """Add the values (k, c) of pairs to the rows of `out` (n, c) of their first ends, and `sign`
    times them to those of their second ends, unless these are from n on.
    """
    for p in range(first.shape[0]):
        for c in range(values.shape[1]):
            out[first[p], c] += values[p, c]
        if second[p] < out.shape[0]:
            for c in range(values.shape[1]):
                out[second[p], c] += sign * values[p, c]


@inlined
def mixed(key, value):
    """Return a key of 64 bits, each of which depends on many bits of a key and of a value."""
    key = (key ^ (key >> np.uint64(32)) ^ value) * ODD
    return key ^ (key >> np.uint64(29))


@kernel
def key_points(points, volumes, cell, rounding, own, others, incidence, ends, keys):
    """Write a number of 64 bits for each point, which says what its bonds are: their vectors, the
    ways in the order of the points, and the volumes (as numbers of 64 bits) of their ends.

    Components of vectors count as multiples of the sides of a `cell` where they differ from these
    by no more than `rounding` sides.
    """
    component = np.empty(1)
    bits = component.view(np.uint64)
    for i in range(keys.shape[0]):
        key = mixed(ODD, volumes[i])
        for e in range(others[i], others[i + 1] + own[i + 1] - own[i]):
            j = other_end(i, e, own, others, incidence, ends)
            key = mixed(mixed(key, volumes[j]), np.uint64(np.int64(j) - i))
            for c in range(points.shape[1]):
                way = points[j, c] - points[i, c]
                steps = np.rint(way / cell[c])
                near = np.abs(way - steps * cell[c]) <= rounding * cell[c]
                component[0] = way
                key = mixed(key, np.uint64(np.int64(steps)) if near else bits[0])
        keys[i] = key


@kernel
def key_blocks(names, own, others, ends, block, keys):
    """Write a number of 64 bits for each `block` of so many pairs, which says what they are: the
    `names` of their ends, and their places in the lists of their first ends.
    """
    for b in range(keys.shape[0]):
        key = ODD
        for p in range(b * block, (b + 1) * block):
            i = ends[0, p]
            key = mixed(mixed(key, names[i]), names[ends[1, p]])
            key = mixed(key, others[i + np.uint32(1)] - others[i] + np.uint64(p) - own[i])
        keys[b] = key


@kernel
def find_firsts(keys, table, firsts):
    """Write the index of the first equal key of each of the `keys`; `table` holds zeros, a power of
    two and more than keys.
    """
    mask = np.uint64(table.shape[0] - 1)
    for k in range(keys.shape[0]):
        slot = (keys[k] >> np.uint64(7)) & mask
        while table[slot] > 0 and keys[table[slot] - 1] != keys[k]:
            slot = (slot + np.uint64(1)) & mask
        if table[slot] == 0:
            table[slot] = k + 1
        firsts[k] = table[slot] - 1
