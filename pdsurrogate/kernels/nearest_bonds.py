"""Bonds of a body that a network of nearest bonds needs in addition to short ones (theory,
section 11).
"""

from ..engine.compile import kernel


@kernel
def add_unspanned(points, pointers, neighbors, first, second, sources, touching, near):
    """Flag in `near`, in place, the bonds that no two shorter ones with an angle of at least 90
    degrees between them span.

    A bond with the image of another point keeps its flag, since the bond of that point with the
    image of the first may differ.

    Parameters
    ----------
    points : ndarray, shape (n + m, d)
        Points and images.
    pointers, neighbors : ndarray of int
        Neighbor lists of the points, see `Bonds`.
    first, second, sources : ndarray of int, shape (k,)
        Ends of the bonds, and the point at the second end or that it is an image of.
    touching : float
        Cosine of the angle of the two shorter bonds, times both lengths over the squared length of
        the bond, that counts as 90 degrees.
    near : ndarray of bool, shape (k,)
    """
    n = pointers.shape[0] - 1
    for b in range(first.shape[0]):
        i = first[b]
        j = second[b]
        if near[b] or (j >= n and sources[b] != i):
            continue
        square = 0.0
        for c in range(points.shape[1]):
            square += (points[j, c] - points[i, c]) ** 2
        near[b] = True
        for e in range(pointers[i], pointers[i + 1]):
            k = neighbors[e]
            product = 0.0
            for c in range(points.shape[1]):
                product += (points[i, c] - points[k, c]) * (points[j, c] - points[k, c])
            if k != j and product <= touching * square:
                near[b] = False
                break
