"""Boundary of a plane body from closed polygons (chains of facets) of its outline and holes, which may cross or touch each other."""

import numpy as np
from scipy.spatial import cKDTree

from ..body import encloses
from ..ranks.share import connected

ROUNDING = 1e-9
"""Distance, divided by the extent of a body, within which places coincide."""

BESIDE = 1e-6
"""Distance from a facet, divided by the extent of a body, of the places that decide on which side of it there is material. Chosen between
`ROUNDING`, within which a place is on the facet, and the least cell, beyond which it may be past the material."""


def same_places(places: np.ndarray, tolerance: float) -> np.ndarray:
    """Return for each place (k, d) the number of the first place of its cluster.

    Two places are in one cluster if a chain of places joins them in which neighbors lie within `tolerance` of each other.
    """
    _, labels = connected(len(places), *cKDTree(places).query_pairs(tolerance, output_type="ndarray").T)
    _, first = np.unique(labels, return_index=True)
    return first[labels]


def pieces(chains: list[np.ndarray], tolerance: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the facets of closed polygons (chains of nodes), divided at all places where polygons cross or touch each other or themselves.

    Returns
    -------
    nodes : ndarray, shape (k, 2)
    facets : ndarray of int, shape (f, 2)
        Chain by chain, in order around each.
    curves : ndarray of int, shape (f, 2)
        For each facet the numbers of its chain and of its run; a run is a sequence of facets of one chain between two places where chains
        meet.
    """
    starts = np.concatenate(chains)
    ends = np.concatenate([np.roll(chain, -1, axis=0) for chain in chains])
    chain = np.repeat(np.arange(len(chains)), [len(nodes) for nodes in chains])
    facet, share, place = _meetings(starts, ends, chain, tolerance)
    order = np.lexsort((np.concatenate([np.zeros(len(starts)), share]), np.concatenate([np.arange(len(starts)), facet])))
    nodes = np.concatenate([starts, place])
    number = same_places(nodes, 4 * tolerance)
    meets = np.zeros(len(nodes), dtype=bool)
    meets[number[len(starts) :]] = True
    first, chain = number[order], np.concatenate([chain, chain[facet]])[order]
    facets, curves = [], []
    for of_chain in range(len(chains)):
        around = first[chain == of_chain]
        around = around[around != np.roll(around, -1)]  # of nodes that coincide the last one is left
        runs = np.cumsum(meets[around])
        runs[runs == 0] = runs[-1] if len(runs) else 0  # a chain goes on at its beginning
        facets.append(np.stack([around, np.roll(around, -1)], axis=1))
        curves.append(np.stack([np.full(len(around), of_chain), runs], axis=1))
    return nodes, np.concatenate(facets), np.concatenate(curves)


def _meetings(starts: np.ndarray, ends: np.ndarray, chain: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where facets, other than neighbors in a chain, cross or touch: facet numbers (m,), fractions (m,) and places (m, 2).

    Each meeting is listed for both of its facets; the fraction is the distance from the start of the facet divided by its length.
    """
    along = ends - starts
    lengths = np.linalg.norm(along, axis=1)
    pairs = cKDTree((starts + ends) / 2).query_pairs(lengths.max() + tolerance, output_type="ndarray")
    first, second = pairs.T
    neighbors = (ends[first] == starts[second]).all(axis=1) | (ends[second] == starts[first]).all(axis=1)
    neighbors &= chain[first] == chain[second]
    one, other = pairs[~neighbors & (lengths[pairs] > tolerance).all(axis=1)].T

    def touching(facet: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        share = ((places - starts[facet]) * along[facet]).sum(axis=1) / lengths[facet] ** 2
        share = np.clip(share, 0, 1)
        return share, np.linalg.norm(starts[facet] + share[:, None] * along[facet] - places, axis=1) <= tolerance

    facets, shares, places = [], [], []
    touched = np.zeros(len(one), dtype=bool)
    for facet, partner in ((one, other), (other, one)):
        for end, at_end in ((starts, 0.0), (ends, 1.0)):
            share, there = touching(facet, end[partner])
            touched |= there
            facets += [facet[there], partner[there]]
            shares += [share[there], np.full(there.sum(), at_end)]
            places += [end[partner][there]] * 2
    one, other = one[~touched], other[~touched]
    between = starts[other] - starts[one]

    def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]

    with np.errstate(divide="ignore", invalid="ignore"):
        turn = cross(along[one], along[other])
        share, of_other = cross(between, along[other]) / turn, cross(between, along[one]) / turn
    crossing = (share > 0) & (share < 1) & (of_other > 0) & (of_other < 1)
    one, other, share, of_other = one[crossing], other[crossing], share[crossing], of_other[crossing]
    crossed = starts[one] + share[:, None] * along[one]
    return np.concatenate([*facets, one, other]), np.concatenate([*shares, share, of_other]), np.concatenate([*places, crossed, crossed])


def between_material_and_none(nodes: np.ndarray, facets: np.ndarray, curves: np.ndarray, beside: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the facets on the boundary of the body (material on one side only), with the material on their left, and their chain numbers.

    `facets` and `curves` are those of `pieces`, with the outline as chain 0 and holes as the others. The material on either side changes
    only where chains meet, so the longest facet of each run is tested, at the distance `beside` from its middle.
    """
    runs, run = np.unique(curves, axis=0, return_inverse=True)
    run = run.ravel()
    first, second = nodes[facets].transpose(1, 0, 2)
    along = second - first
    lengths = np.linalg.norm(along, axis=1)
    order = np.lexsort((-lengths, run))
    asked = order[np.searchsorted(run[order], np.arange(len(runs)))]  # the longest
    middles = (first + second)[asked] / 2
    left = beside * np.stack([-along[asked, 1], along[asked, 0]], axis=1) / lengths[asked, None]

    def material(places: np.ndarray) -> np.ndarray:
        inside = encloses(places, first[curves[:, 0] == 0], second[curves[:, 0] == 0])
        for hole in range(1, int(curves[:, 0].max()) + 1):
            inside &= ~encloses(places, first[curves[:, 0] == hole], second[curves[:, 0] == hole])
        return inside

    there, beyond = material(middles + left)[run], material(middles - left)[run]
    facets = np.where(there[:, None], facets, facets[:, ::-1])
    kept = np.flatnonzero(there != beyond)
    # Facets on the boundaries of two curves are assigned to the first.
    _, once = np.unique(facets[kept], axis=0, return_index=True)
    kept = kept[np.sort(once)]
    return facets[kept], curves[kept, 0]
