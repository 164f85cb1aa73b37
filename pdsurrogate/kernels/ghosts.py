"""Values on ghosts computed from the values on their sources, and the transpose of that linear map.

The displacement of a ghost is the displacement of its source, each component times a parity, plus a
shift; the neighborhood of a ghost is the neighborhood of its source, each direction times a
reflection. With P = diag(parity) and S = diag(reflection)

    y = shift + P y_source,    F = I + P (F_source - I) S,    K = S K_source S,

for positions y, deformation gradients F and inverse shape tensors K, in every dimension; the
parities and reflections of an image of an image are products. Ghosts follow the points in arrays of
n + m rows; matrices are stored by columns.
"""

from ..engine.passes import Pass, share_of


@Pass
def place_points(chunk, given, source, parity, shift, positions):
    """Copy the positions of points, and compute the positions of ghosts: shift + P y, y the
    position of the source and P = diag(parity).
    """
    n, dimension = given.shape
    for i in share_of(n, chunk):
        for r in range(dimension):
            positions[i, r] = given[i, r]
    for g in share_of(parity.shape[0], chunk):
        for r in range(dimension):
            positions[n + g, r] = shift[g, r] + parity[g, r] * given[source[g], r]


@Pass
def sum_on_planes(chunk, lever, on_points, found):
    """Write minus the forces (planes, d) that do work on the displacements of planes, which move
    their ghosts by `lever` (m, planes, d); the rows of ghosts in `on_points` are the last.
    """
    m, planes, dimension = lever.shape
    n = on_points.shape[0] - m
    for p in share_of(planes, chunk):
        for r in range(dimension):
            total = 0.0
            for g in range(m):
                total -= lever[g, p, r] * on_points[n + g, r]
            found[p, r] = total


@Pass
def fold_vectors(chunk, values, source, parity):
    """Add P v to the vector on the source of each ghost, v the vector on the ghost, P =
    diag(parity).

    The vectors on the ghosts stay as they are. The first chunk does all the work, since ghosts
    share sources.
    """
    m, dimension = parity.shape
    n = values.shape[0] - m
    for g in range(m if chunk.number == 0 else 0):
        for r in range(dimension):
            values[source[g], r] += parity[g, r] * values[n + g, r]


@Pass
def fill_matrices(chunk, values, source, parity, reflection, rest, shift):
    """Write the matrices on ghosts, rest I + P (F - rest I) S + shift, F the matrix on the source,
    P = diag(parity), S = diag(reflection).

    `rest` is 1 for a deformation gradient and 0 for a change of a deformation gradient.
    """
    m, dimension = parity.shape
    n = values.shape[0] - m
    for g in share_of(m, chunk):
        for c in range(dimension):
            for r in range(dimension):
                at = c * dimension + r
                identity = rest if r == c else 0.0
                image = 0.0
                for k in range(dimension):
                    image += (
                        values[source[g], k * dimension + r] - (rest if r == k else 0.0)
                    ) * reflection[g, k, c]
                values[n + g, at] = identity + parity[g, r] * image + shift[g, at]


@Pass
def fold_matrices(chunk, values, source, parity, reflection, folded):
    """Add P M S to the matrix on the source of each ghost, where M is the matrix on the ghost, and
    move M to `folded`, so that its place is zero.

    P = diag(parity) and S = diag(reflection): this is the transpose of `fill_matrices`. The first
    chunk does all the work, since ghosts share sources.
    """
    m, dimension = parity.shape
    n = values.shape[0] - m
    for g in range(m if chunk.number == 0 else 0):
        for c in range(dimension):
            for r in range(dimension):
                at = c * dimension + r
                image = 0.0
                for k in range(dimension):
                    image += values[n + g, k * dimension + r] * reflection[g, c, k]
                values[source[g], at] += parity[g, r] * image
        for at in range(dimension * dimension):
            folded[g, at] = values[n + g, at]
            values[n + g, at] = 0.0
