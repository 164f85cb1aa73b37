"""Number of ranks (parallel processes) that work on a body: small bodies are left to fewer ranks
than were started.
"""

from ..discretization import estimated_points
from ..ranks import Communicator
from ..scenes import Scene

POINTS_PER_RANK = 25_000
"""Least number of points of a body for each rank that works on it."""


class RanksWait(UserWarning):
    """Warning that a body is too small for all ranks that were started, so that some of them
    wait.
    """


def working_ranks(scene: Scene, ranks: Communicator) -> int:
    """Return the number of ranks, of those that were started, that work on the body of a scene.

    Raises
    ------
    SceneError
        If the file of a mesh cannot be read.
    """
    if ranks.size == 1:
        return 1
    return int(max(1, min(ranks.size, estimated_points(scene) // max(POINTS_PER_RANK, 1))))


def note_of_waiting(points: int, working: int, started: int) -> str:
    """Return the text of the warning that only some of the ranks that were started work on a
    body with so many points.
    """
    what = f"{working} of {started} ranks {'work' if working > 1 else 'works'} on {points} points"
    return (
        f"{what}, since ranks with fewer than {POINTS_PER_RANK} points each save no time; the"
        " others wait"
    )
