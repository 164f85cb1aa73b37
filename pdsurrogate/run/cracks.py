"""Cracks of a run: which bonds break, where cracks begin and how their tips move."""

import logging

import numpy as np
import scipy

from ..materials.states import determinant
from ..ranks.share import connected
from .run import Run

logger = logging.getLogger(__name__)

LEAST_RATIO = 0.1
"""Determinant of the deformation gradient below which a point that has lost bonds counts as failed;
intact rubber in a tear stays above 0.5. Chosen lower than the bound for a single bond
(`COLLAPSED`), since a point that fails loses all its bonds.
"""


class Cracks:
    """Bonds that break, and the summary of where cracks begin and grow, for a run with damage.

    Parameters
    ----------
    run : Run
    timed : bool
        Whether the stage takes a time.
    """

    def __init__(self, run: Run, timed: bool = True) -> None:
        self.run = run
        self.timed = timed
        self.damage = run.damage
        # Flags of points and ghosts that have lost bonds, the numbers of such points, and those of
        # their ghosts.
        self._lost = np.zeros(len(run.body.all_points), dtype=bool)
        self._torn = self._torn_images = np.empty(0, dtype=np.int64)
        self._count_lost(np.flatnonzero(run.damage.broken))
        if run.state.crack is None:
            run.state.crack = {
                "start": None,
                "tips": [],
                "broken_bonds": 0,
                "failed_points": 0,
                "through": False,
            }

    @property
    def time(self) -> float:
        """Time since the stage began."""
        return self.run.state.time

    def bonds_of_failed_points(self) -> np.ndarray:
        """Return the numbers of the intact pairs of points that have lost bonds and whose
        deformation gradient has collapsed, or that have swung through a clamp.

        At a crack front or on a fragment a point may have so few bonds left that their deformation
        gradient is meaningless. If it turns the point inside out, or compresses it to a tenth of
        its area or volume (`LEAST_RATIO`), all bonds of the point break, also if its image beyond
        a grip is turned inside out, or if it swings through the plane that bonds join it to. For a
        point with all its bonds det F <= 0 is an error.
        """
        run = self.run
        bonds = run.body.bonds
        n = len(run.body)
        share = run.body.share
        if not run.state.crack["broken_bonds"]:
            return np.empty(0, dtype=np.int64)
        ratios = determinant(run.force.deformation_gradients()[self._torn])
        turned = ~(determinant(run.force.deformation_gradients(images=True)[self._torn_images]) > 0)
        collapsed = self._torn[~(ratios > LEAST_RATIO)]
        if len(self._torn_images):
            swung = run.loading.swung_through(
                run.state.parameter, run.positions, self._torn, self.damage.broken
            )
            collapsed = np.union1d(collapsed, swung)
        crushed = run.force.collapsed_pairs()
        if not share.any(len(collapsed) or turned.any() or len(crushed)):
            return collapsed
        collapsed = np.union1d(collapsed, run.body.ghosts.source[self._torn_images[turned]])
        lost = self._lost.copy()
        failed = np.zeros_like(self._lost)
        failed[collapsed] = True
        run.body.ghosts.fill(failed)
        failing = failed[bonds.first] | failed[bonds.second]
        if share.any(len(crushed)):
            # A bond whose own gradient has collapsed is broken if one of its ends has lost other
            # bonds.
            run.body.ghosts.fill(lost)
            failing[crushed[lost[bonds.first[crushed]] | lost[bonds.second[crushed]]]] = True
        pairs = np.flatnonzero(failing & ~self.damage.broken)
        if share.any(len(pairs)):
            run.state.crack["failed_points"] += share.count(failed[:n])
        return pairs

    def _count_lost(self, pairs: np.ndarray) -> None:
        """Count the ends of broken pairs, given by number, among the points that have lost
        bonds.
        """
        bonds = self.run.body.bonds
        self._lost[bonds.first[pairs]] = self._lost[bonds.second[pairs]] = True
        self._torn = np.flatnonzero(self._lost[: len(self.run.body)])
        self._torn_images = np.flatnonzero(self._lost[self.run.body.ghosts.source])

    def break_bonds(self, pairs: np.ndarray, cause: str = "energy") -> None:
        """Break pairs, given by number, in one event: `mark` them, and remove them from the
        force.
        """
        self.mark(pairs, cause)
        self.run.force.break_bonds(pairs)

    def mark(self, pairs: np.ndarray, cause: str) -> None:
        """Mark pairs as broken in one event: update damage and the summary about cracks, whose
        start has a `cause`, "energy" or "strength", in a body with strengths.
        """
        run = self.run
        crack = self.run.state.crack
        share = self.run.body.share
        crack["broken_bonds"] += share.total(
            int(np.count_nonzero(share.own[run.body.bonds.first[pairs]]))
        )
        self.damage.break_bonds(pairs)
        self._count_lost(pairs)
        if crack["start"] is None:
            places = starts_of_cracks(*self.damage.in_order(pairs), run.body.horizon)
            row = run.state.history[-1]
            cause = "energy" if share.any(cause == "energy") else "strength"
            stress = {"nominal_stress": row["nominal_stress"]} if "nominal_stress" in row else {}
            crack["start"] = {
                "event": "first bond broken",
                **self._now(),
                **stress,
                **({} if run.problem.strengths is None else {"cause": cause}),
                "x": places[0],
                "tips": places,
            }
            logger.info(
                "%s: the first bond broken is at %s", run.loading.at(run.state.parameter), places
            )

    def _now(self) -> dict[str, float]:
        """Return the present loading parameter, and the time if there is one, by name, for the
        summary about cracks.
        """
        run = self.run
        time = {"time": run.state.elapsed + self.time} if self.timed else {}
        return time | {run.loading.parameter: run.state.parameter}

    def separated(self) -> bool:
        """Return whether the body has separated between its supports: no chain of bonds leads
        from one to another.
        """
        run = self.run
        _, piece = run.loading.pieces(~self.damage.broken)
        pieces = [
            np.unique(np.concatenate(run.body.share.everywhere(np.unique(piece[points]))))
            for points in run.loading.ends(~self.damage.broken)
        ]
        return not all(np.isin(pieces[0], others).any() for others in pieces[1:])

    def output(self, with_way: bool = False) -> bool:
        """Record the places of the crack tips at an output, and if wanted the way of the largest
        crack's tip since the last one; return whether the body has separated between its supports.
        """
        run = self.run
        crack = self.run.state.crack
        crack["through"] = self.separated()
        entry = {**self._now(), "broken_bonds": crack["broken_bonds"]}
        places, events = self.damage.take_recent()
        tips = crack_tips(places, run.body.horizon)
        if tips and not any(output["tips"] for output in crack["tips"]):
            # The list now includes cracks that began slightly later.
            crack["start"]["tips"] = starts_of_cracks(places, events, run.body.horizon)
        # The tip of the largest crack keeps its place while no bond breaks.
        last = crack["tips"][-1]["tip"] if crack["tips"] else None
        if with_way:
            entry["way"] = way_of_tip(places, run.body.horizon)
        crack["tips"].append({**entry, "tip": tips[0] if tips else last, "tips": tips})
        return crack["through"]


def crack_tips(places: np.ndarray, horizon: float) -> list[list[float]]:
    """Return the places of the crack tips, that of the largest crack first.

    A crack is a group of broken pairs linked by distances of up to a horizon; its tip is the mean
    place of the tenth of its pairs that broke last.

    Parameters
    ----------
    places : ndarray, shape (k, d)
        Middles of the pairs, in the order in which they broke.
    horizon : float
    """
    return [_tip(places[members]) for members in _groups(places, horizon)]


def way_of_tip(places: np.ndarray, horizon: float) -> list[list[float]]:
    """Return where the tip of the largest crack was after every tenth of its pairs, at most ten
    places; `places` and `horizon` as of `crack_tips`.
    """
    members = next(iter(_groups(places, horizon)), places[:0])
    counts = np.unique(np.arange(1, 11) * len(members) // 10)
    return [_tip(places[members[:count]]) for count in counts[counts > 0]]


def _tip(places: np.ndarray) -> list[float]:
    return places[-max(1, len(places) // 10) :].mean(axis=0).tolist()


def crack_path(outputs: list[dict]) -> dict[str, float] | None:
    """Return the direction of the largest crack in the plane of x1 and x2, and how far it strays
    from a straight line.

    The line is that of least squared distances through the places of the tip at the outputs;
    ``direction`` is its angle with the x1 axis in degrees, from -90 to 90, and ``stray`` the
    greatest distance of a tip from it. None if the tip was at fewer than three places. Outputs of
    slow tears, in which a crack may jump, have the way of the tip.
    """
    ways = [output.get("way", output["tip"] and [output["tip"]]) for output in outputs]
    tips = np.array(list(dict.fromkeys(tuple(tip) for way in ways for tip in way or ())))
    if len(tips) < 3:
        return None
    off = tips - tips.mean(axis=0)
    line = np.linalg.svd(off, full_matrices=False)[2][0]
    direction = np.degrees(np.arctan2(line[1], line[0])) % 180
    distances = np.linalg.norm(off - np.outer(off @ line, line), axis=1)
    return {"direction": float(direction - 180 * (direction > 90)), "stray": float(distances.max())}


def starts_of_cracks(places: np.ndarray, events: np.ndarray, horizon: float) -> list[list[float]]:
    """Return the places where cracks began: one for each group of broken pairs linked by distances
    of up to a horizon.

    Parameters
    ----------
    places : ndarray, shape (k, d)
        Middles of the pairs.
    events : ndarray of int, shape (k,)
        Number of the event in which each pair broke, rising with time.
    horizon : float

    Returns
    -------
    list of list of float
        Middle of one pair for each group: among the pairs that broke first, the one nearest to
        their mean. Groups are in the order in which they began; of those that began together the
        largest is first.
    """
    found = []
    for members in _groups(places, horizon):
        first = members[events[members] == events[members].min()]
        off = places[first] - places[first].mean(axis=0)
        found.append(
            (events[first[0]], places[first[np.einsum("kc,kc->k", off, off).argmin()]].tolist())
        )
    return [place for _, place in sorted(found, key=lambda start: start[0])]


def _groups(places: np.ndarray, horizon: float) -> list[np.ndarray]:
    """Return groups of places (k, d), linked by chains of distances of up to a horizon: the
    numbers of each, the largest group first.
    """
    if not len(places):
        return []
    near = scipy.spatial.cKDTree(places).query_pairs(horizon, output_type="ndarray")
    count, group = connected(len(places), *near.T)
    order = np.argsort(-np.bincount(group), kind="stable")[:count]
    return [np.flatnonzero(group == number) for number in order]
