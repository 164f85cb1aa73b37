"""Ranks: the processes that share one run, and the messages between them."""

import importlib.util
import math
import os
import socket
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np

LAUNCHED = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "PMIX_SIZE")
"""Environment variables in which launchers of MPI state how many processes they have started."""


_PAUSE = 0.01
_PART = 0.1
"""Greatest number of seconds between two checks of a rank that waits asleep, and the same divided
by the time it has waited so far. Chosen: too short to be noticed, and long enough that a waiting
rank takes no processor time from the others.
"""


class NotUnderMPI(RuntimeError):
    """Error for several processes that a launcher has started without messages between them:
    mpi4py is not in use, or of another MPI.
    """


class Communicator:
    """Messages between all ranks of a run: the processes of MPI, or one process, which loads
    nothing of MPI.

    Parameters
    ----------
    mpi : module, optional
        ``mpi4py.MPI``; without it there is one rank.

    Attributes
    ----------
    rank, size : int
    """

    def __init__(self, mpi=None) -> None:
        self._mpi = mpi
        self._world = mpi and mpi.COMM_WORLD
        self.rank, self.size = (self._world.rank, self._world.size) if mpi else (0, 1)
        # A rank may leave while others wait in a message to it: the end of a run is agreed upon
        # apart.
        self._ends = mpi and self._world.Dup()

    def __deepcopy__(self, memo):
        return self

    def here(self) -> int:
        """Return the number of ranks on this machine."""
        return self.everywhere(socket.gethostname()).count(socket.gethostname())

    def barrier(self) -> None:
        """Wait for all ranks, asleep."""
        if self._mpi:
            _wait(self._world.Ibarrier().Test)

    def to_all(self, value):
        """Return the value of the first rank, on every rank."""
        return self._world.bcast(value, root=0) if self._mpi else value

    def everywhere(self, value) -> list:
        """Return the values of all ranks in a list, on every rank."""
        return self._world.allgather(value) if self._mpi else [value]

    def to_each(self, values: Sequence) -> list:
        """Send one of the given values to each rank, and return the values that this rank
        receives, both in the order of the ranks.
        """
        return self._world.alltoall(list(values)) if self._mpi else list(values)

    def total(self, here):
        """Return the sum over all ranks of a number, of each number of a tuple, or of an array,
        on every rank.
        """
        if not self._mpi:
            return here
        values = np.asarray(here)
        sums = np.empty_like(values)
        self._world.Allreduce(np.ascontiguousarray(values), sums)
        if isinstance(here, np.ndarray | np.generic):
            return sums if sums.ndim else sums[()]
        return tuple(sums.tolist()) if isinstance(here, tuple) else sums.item()

    def greatest(self, here: float | np.ndarray) -> float:
        """Return one number, the greatest entry of `here` (a number or an array) on all ranks; NaN
        if an entry is NaN.

        An array without entries counts as 0.
        """
        if not isinstance(here, float):
            here = float(np.max(here)) if np.size(here) else 0.0
        if not self._mpi:
            return here
        found = np.empty(self.size)
        self._world.Allgather(np.array(here), found)
        # the MPI standard does not define the maximum of a NaN, NumPy does
        return float(found.max())

    def agree(self, error: Exception | None) -> None:
        """Raise on every rank the error of the lowest rank that has found one; `error` is the
        error found on this rank, or None.
        """
        if not self.total(int(error is not None)):
            return
        # All ranks raise the error of the first rank that has one.
        found = self.everywhere(error and (type(error), str(error)))
        if self.size == 1:
            raise error
        kind, message = next(other for other in found if other is not None)
        raise kind(message) from error

    @contextmanager
    def together(self) -> Iterator[None]:
        """Context whose errors all ranks raise: if its block fails on any rank, every rank
        raises the error of the first such rank.
        """
        error = None
        try:
            yield
        except Exception as raised:
            error = raised
        self.agree(error)

    def gather(self, rows: np.ndarray) -> list[np.ndarray] | None:
        """Return, on the first rank, the list of the arrays `rows` of all ranks; None on the
        others.
        """
        return self._world.gather(rows)

    def hand_out(self, parts: Sequence[np.ndarray] | None) -> np.ndarray:
        """Return this rank's item of `parts`, a list of one array for each rank that the first
        rank gives; the others give None.
        """
        return self._world.scatter(parts)

    def exchange(self, outgoing: dict[int, np.ndarray], incoming: dict[int, np.ndarray]) -> None:
        """Send the arrays `outgoing`, by rank, and overwrite the arrays `incoming`, by rank,
        with those received; all at the same time.
        """
        if not self._mpi:
            return
        byte = self._mpi.BYTE
        requests = [
            self._world.Irecv([array.reshape(-1).view(np.uint8), byte], source=rank)
            for rank, array in incoming.items()
        ]
        requests += [
            self._world.Isend([array.reshape(-1).view(np.uint8), byte], dest=rank)
            for rank, array in outgoing.items()
        ]
        self._mpi.Request.Waitall(requests)

    def leave(self, seconds: float) -> bool:
        """Wait for all ranks to end, for some seconds at most; if they do, finalize MPI and return
        True, else return False.

        After False a rank that exits with a status other than 0 aborts the others, and MPI reports
        that.
        """
        if not self._mpi:
            return True
        if not _wait(self._ends.Ibarrier().Test, seconds):
            return False
        self._mpi.Finalize()
        return True


def _wait(arrived: Callable[[], bool], seconds: float = math.inf) -> bool:
    """Sleep until `arrived` returns true, and return True; or return False after some seconds."""
    began = time.monotonic()
    while not arrived():
        waited = time.monotonic() - began
        if waited > seconds:
            return False
        time.sleep(min(_PAUSE, _PART * waited))
    return True


ALONE = Communicator()
"""The communicator of one process."""

_world: Communicator | None = None


def communicator() -> Communicator:
    """Return the communicator of this run.

    A run has several ranks only under a launcher of MPI and where mpi4py is in use, as under
    ``python -m mpi4py``.

    Raises
    ------
    NotUnderMPI
        If a launcher has started several processes, and mpi4py is not in use or belongs to another
        MPI than the launcher: each would run the scene by itself.
    """
    global _world
    mpi = None
    if "mpi4py.run" in sys.modules or "mpi4py.MPI" in sys.modules:
        from mpi4py import MPI as mpi  # noqa: N811 - of which a run of one process loads nothing

        if mpi.COMM_WORLD.size > 1:
            _world = _world or Communicator(mpi)
            return _world
    started = max(
        (int(os.environ[name]) for name in LAUNCHED if os.environ.get(name, "").isdecimal()),
        default=1,
    )
    if started == 1:
        return ALONE
    alone = f"{started} processes were started, but each would run the whole scene by itself"
    if mpi:
        library = mpi.Get_library_version().split(",")[0].split("\n")[0]
        raise NotUnderMPI(
            f"{alone}: the launcher is not that of mpi4py, which uses {library}; use the mpiexec of"
            " this MPI"
        )
    missing = "" if importlib.util.find_spec("mpi4py") else 'pip install "pdsurrogate[mpi]" && '
    raise NotUnderMPI(
        f"{alone}; for one run on all of them use: {missing}mpiexec -n {started} python -m mpi4py"
        " -m pdsurrogate ..."
    )
