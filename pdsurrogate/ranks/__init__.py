"""Several processes that share one run: their communicator, the points that each of them owns, and sums over all of them."""

from .communicator import ALONE, Communicator, NotUnderMPI, communicator
from .share import Halo, Rows, Share, bisected, bond_counts

__all__ = ["ALONE", "Communicator", "Halo", "NotUnderMPI", "Rows", "Share", "bisected", "bond_counts", "communicator"]
