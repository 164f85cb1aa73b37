"""Search for coinciding places: positions that are equal to rounding."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree


def same_places(places: np.ndarray, tolerance: float) -> np.ndarray:
    """Return for each place (k, d) the number of the first place that coincides with it, directly or through others, within a tolerance."""
    pairs = cKDTree(places).query_pairs(tolerance, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), dtype=bool), pairs.T), shape=(len(places), len(places)))
    labels = connected_components(graph, directed=False)[1]
    _, first = np.unique(labels, return_index=True)
    return first[labels]
