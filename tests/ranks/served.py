"""Run by `several_ranks.Ranks` on several ranks: cases one after another, each on the first
ranks, in one start of the processes.
"""

import base64
import contextlib
import importlib
import io
import os
import pickle
import sys
import time
from types import SimpleNamespace

from mpi4py import MPI

from pdsurrogate.engine.compile import compilation_clock
from pdsurrogate.ranks import ALONE, Communicator

WORLD = MPI.COMM_WORLD


def orders():
    """What the first rank reads from its standard input, on every rank; none of them takes
    processor time while it waits.
    """
    while True:
        line = sys.stdin.readline() if WORLD.rank == 0 else None
        arrival = WORLD.Ibarrier()
        while not arrival.Test():
            time.sleep(0.003)
        line = WORLD.bcast(line)
        if not line:
            return
        yield pickle.loads(base64.b64decode(line))


def done(communicator, folder, module, function, arguments):
    """What a function returns or how it ends, and what it prints, as of a process that does
    nothing else.
    """
    vars(sys.modules["pdsurrogate.ranks.communicator"])["_world"] = communicator
    os.chdir(folder)
    found = {"value": None, "error": None, "status": 0, "compiled": False}
    compiles = lambda: found.update(compiled=True)  # noqa: E731
    with (
        contextlib.redirect_stdout(io.StringIO()) as out,
        contextlib.redirect_stderr(io.StringIO()) as err,
        compilation_clock(compiles),
    ):
        try:
            found["value"] = getattr(importlib.import_module(module), function)(*arguments)
        except SystemExit as exit:
            found["status"] = exit.code or 0
        except Exception as error:
            found |= {"status": 1, "error": repr(error)}
    return found | {"out": out.getvalue(), "err": err.getvalue()}


def main():
    replies = os.fdopen(os.dup(1), "w")
    for ranks, *case in orders():
        takes_part = WORLD.rank < ranks
        mpi = SimpleNamespace(
            COMM_WORLD=WORLD.Split(not takes_part),
            BYTE=MPI.BYTE,
            Request=MPI.Request,
            Finalize=lambda: None,
        )
        found = done(Communicator(mpi) if ranks > 1 else ALONE, *case) if takes_part else None
        arrival = WORLD.Ibarrier()
        while not arrival.Test():
            time.sleep(0.003)
        found = WORLD.gather(found)
        if WORLD.rank == 0:
            replies.write(base64.b64encode(pickle.dumps(found[:ranks])).decode() + "\n")
            replies.flush()


if __name__ == "__main__":
    main()
