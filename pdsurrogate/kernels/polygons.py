"""Polygons in the plane, given by their segments."""

import numpy as np


def encloses(places: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return flags of the places (m, 2) that lie within closed polygons, given by starts and ends
    of their segments, shape (s, 2) each.

    A place is inside if a ray from it toward larger x1 crosses the segments an odd number of times.
    """
    inside = np.zeros(len(places), dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        for start, end in zip(starts, ends, strict=True):
            spans = (start[1] > places[:, 1]) != (end[1] > places[:, 1])
            crossing = start[0] + (places[:, 1] - start[1]) * (end[0] - start[0]) / (
                end[1] - start[1]
            )
            inside ^= spans & (places[:, 0] < crossing)
    return inside


def distances_to_segments(places: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return the distance of each place (k, d) to the segment from its start to its end (k, d),
    or to one segment (d,), shape (k,).
    """
    along = ends - starts
    share = np.clip(((places - starts) * along).sum(axis=1) / (along**2).sum(axis=-1), 0, 1)
    return np.linalg.norm(places - starts - share[:, None] * along, axis=1)
