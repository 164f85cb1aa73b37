"""Bonds of a body that a network of nearest bonds needs in addition to short ones (theory,
section 11).
"""

from ..engine.compile import kernel
from .lists import other_end


@kernel
def add_unspanned(points, own, others, incidence, ends, first, second, sources, touching, near):
    """Flag in `near`, in place, the bonds that no two shorter ones with an angle of at least 90
    degrees between them span.

    A bond with the image of another point keeps its flag, since the bond of that point with the
    image of the first may differ.

    Parameters
    ----------
    points : ndarray, shape (n + m, d)
        Points and images.
    own, others, incidence, ends : ndarray of int
        Pairs of the points, see `Bonds`.
    first, second, sources : ndarray of int, shape (k,)
        Ends of the bonds, and the point at the second end or that it is an image of.
    touching : float
        Cosine of the angle of the two shorter bonds, times both lengths over the squared length of
        the bond, that counts as 90 degrees.
    near : ndarray of bool, shape (k,)
    """
    for b in range(first.shape[0]):
        i = first[b]
        j = second[b]
        if near[b] or (j != sources[b] and sources[b] != i):
            continue
        square = 0.0
        for c in range(points.shape[1]):
            square += (points[j, c] - points[i, c]) ** 2
        near[b] = True
        for e in range(others[i], others[i + 1] + own[i + 1] - own[i]):
            k = other_end(i, e, own, others, incidence, ends)
            product = 0.0
            for c in range(points.shape[1]):
                product += (points[i, c] - points[k, c]) * (points[j, c] - points[k, c])
            if k != j and product <= touching * square:
                near[b] = False
                break
