"""Division of a body among ranks (parallel processes), and the numbers that rows of a rank's
arrays have in the whole body.
"""

from dataclasses import replace

import numpy as np
import scipy

from ..ranks import Communicator, Rows, Share, bisected, bond_counts
from .body import Body
from .ghosts import WITH_ROUNDING

HALO = 1.0
"""Width of the halo in horizons.

One horizon holds the bonds of a rank's own points. Quantities of halo points that need all of their
bonds (deformation gradients, moments) come from their owners. The alternative is a halo of two
horizons for force maps, three for bond energies and five with smoothed dilatations: a rank with a
cube of 60 points a side as its share of a solid would then hold 2.1 times its own points.
"""


def divided(body: Body, ranks: Communicator, halo: float = HALO) -> Body:
    """Return the part of a body that this rank computes, with a halo of points of other ranks.

    Call this function before the bonds of the whole body are first used (they are built then).

    Parameters
    ----------
    body : Body
    ranks : Communicator
    halo : float
        Width of the halo in horizons: points of other ranks within this distance of a point of this
        rank are included.

    Raises
    ------
    ValueError
        If there are fewer than four points for each rank.
    """
    n = len(body)
    if n < 4 * ranks.size:
        raise ValueError(f"{n} points are too few for {ranks.size} ranks; use fewer ranks")
    part = slice(n * ranks.rank // ranks.size, n * (ranks.rank + 1) // ranks.size)
    weights = np.concatenate(
        ranks.everywhere(bond_counts(body.points, body.horizon * WITH_ROUNDING, part))
    )
    owners = bisected(body.points, weights, ranks.size)
    own = np.flatnonzero(owners == ranks.rank)
    reach = halo * body.horizon * WITH_ROUNDING
    lower = body.points[own].min(axis=0) - 2 * reach
    upper = body.points[own].max(axis=0) + 2 * reach
    near = np.flatnonzero(((body.points >= lower) & (body.points <= upper)).all(axis=1))
    distance, _ = scipy.spatial.cKDTree(body.points[own]).query(
        body.points[near], distance_upper_bound=2 * reach
    )
    numbers = near[distance <= reach]
    share = Share(numbers, owners[numbers], n, ranks)
    groups = {name: share.local(np.sort(members)) for name, members in body.groups.items()}
    chosen = np.isin(np.arange(n), numbers)
    cells = body.mesh_cells and body.mesh_cells.only(chosen)[0]
    part = replace(
        body,
        points=body.points[numbers],
        volumes=body.volumes[numbers],
        groups=groups,
        mesh_cells=cells,
        share=share,
    )
    if body.inside is not None or body.tessellate is not None:
        # Made in the whole body, so that nodes between two ranks have one place.
        vars(part)["cells"] = body.cells.only(chosen)[0]
    return part


def part_of(body: Body, numbers: np.ndarray) -> Body:
    """Return a body of the points of another one with these numbers, rising, without its reflection
    planes, boundary and groups.
    """
    return replace(
        body,
        points=body.points[numbers],
        volumes=body.volumes[numbers],
        groups={},
        mesh_cells=None,
        planes=(),
        boundary=None,
        share=Share.whole(len(numbers)),
    )


def rows_of(body: Body, kind: str) -> Rows:
    """Return a `Rows` that relates the rows of arrays on this rank, which has the part `body`, to
    the rows of arrays of the whole body.

    `kind` names what a row belongs to: "points", "images" (points and images), "bonds" (directed
    bonds), or "pairs".
    """
    share = body.share
    bonds = body.bonds
    ghosts = body.ghosts
    if kind == "points":
        return Rows(share.ranks, share.numbers, share.own, share.size)
    if kind == "images":
        names = body.names[len(body) :]
        own = share.own[ghosts.source]
        whole = np.sort(np.concatenate(share.everywhere(names[own])))
        numbers = np.concatenate([share.numbers, share.size + np.searchsorted(whole, names)])
        return Rows(share.ranks, numbers, np.concatenate([share.own, own]), share.size + len(whole))
    pointers = bonds.pointers if kind == "bonds" else bonds.pairs_of_points[0][: len(body) + 1]
    counts = np.diff(pointers).astype(np.int64)
    whole = share.gather(counts)
    total = share.ranks.to_all(None if whole is None else int(whole.sum()))
    starts = Rows(share.ranks, share.numbers, share.own, share.size).hand_out(
        None if whole is None else np.cumsum(whole) - whole
    )
    numbers = np.repeat(starts - pointers[:-1].astype(np.int64), counts) + np.arange(counts.sum())
    own = np.repeat(share.own, counts)
    if kind == "bonds" and share.divided:
        body.bond_halo.fill(numbers)
    elif share.divided:
        # Pairs whose first point is in the halo, from that point's owner, as values of the bond
        # from there.
        directed = numbers[bonds.pair_of]
        body.bond_halo.fill(directed)
        forward = body.bond_owners == bonds.first[bonds.pair_of]
        numbers[bonds.pair_of[forward]] = directed[forward]
    return Rows(share.ranks, numbers, own, total)
