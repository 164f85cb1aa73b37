"""Several processes that share one run: who they are, which points each of them owns, and what is known of the whole body."""

from .communicator import ALONE, Communicator, NotUnderMPI, communicator
from .part import HALO, Part, divided
from .partition import bisected, bond_counts
from .reductions import ReductionsOfParts

__all__ = [
    "ALONE",
    "HALO",
    "Communicator",
    "NotUnderMPI",
    "Part",
    "ReductionsOfParts",
    "bisected",
    "bond_counts",
    "communicator",
    "divided",
]
