"""Several processes that share one run: who they are, which points each of them owns, and what is known of the whole body."""

from .communicator import ALONE, Communicator, NotUnderMPI, communicator
from .partition import bisected, bond_counts
from .share import HALO, RankShare, divided

__all__ = [
    "ALONE",
    "HALO",
    "Communicator",
    "NotUnderMPI",
    "RankShare",
    "bisected",
    "bond_counts",
    "communicator",
    "divided",
]
