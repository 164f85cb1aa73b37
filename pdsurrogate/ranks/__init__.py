"""Runs shared by several processes (ranks): their communicator, the points that each rank owns,
and sums over all ranks.
"""

from .communicator import ALONE, Communicator, NotUnderMPI, communicator
from .share import Halo, Rows, Share, bisected, bond_counts

__all__ = [
    "ALONE",
    "Communicator",
    "Halo",
    "NotUnderMPI",
    "Rows",
    "Share",
    "bisected",
    "bond_counts",
    "communicator",
]
