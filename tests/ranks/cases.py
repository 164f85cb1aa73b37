"""Cases that `served.py` runs: the command line, with what happens in the midst of a run;
scenes; a script; and errors.
"""

import os
import resource
import runpy
import sys

import numpy as np
from commands import words_of

import pdsurrogate as pds
from pdsurrogate.cli import main
from pdsurrogate.problem import compile_scene
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.ranks import communicator
from pdsurrogate.run import run
from pdsurrogate.run.transient import Transient
from pdsurrogate.solvers.nearest_bonds import inverse_of, laplacian_of


def command(*arguments):
    sys.argv = ["pdsurrogate", *words_of(arguments)]
    main()


def not_under_mpi(*arguments):
    """Run as one of two processes that a launcher has started without mpi4py."""
    known = {
        name: sys.modules.pop(name) for name in ("mpi4py.run", "mpi4py.MPI") if name in sys.modules
    }
    os.environ["PMI_SIZE"], size = "2", os.environ.get("PMI_SIZE")
    try:
        command(*arguments)
    finally:
        sys.modules |= known
        os.environ["PMI_SIZE"] = size


def in_pieces(*arguments):
    """Run a body so small as if it were too large to be gathered."""
    most, run.MOST_GATHERED = run.MOST_GATHERED, 10
    try:
        command(*arguments)
    finally:
        run.MOST_GATHERED = most


def disturbed(what, at, *arguments):
    """Run, until something happens on one rank before a step of the dynamics."""
    words = words_of(arguments)
    ranks, step, limits = communicator(), Transient.step, resource.getrlimit(resource.RLIMIT_FSIZE)

    def counted(transient):
        if transient.integrator.steps == at:
            if ranks.rank == 0:
                open(words[words.index("--out") + 1] + ".happened", "w").close()
            happens(what, ranks, transient.run)
        step(transient)

    Transient.step = counted
    try:
        command(*arguments)
    finally:
        Transient.step = step
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def happens(what, ranks, run):
    last = ranks.rank == ranks.size - 1
    if what == "interrupted" and last:
        run.interruption.told = True
    elif what == "invalid" and last:
        run.positions[run.body.share.own.nonzero()[0][-1]] += 100 * run.body.spacing
    elif what == "killed" and last:
        os.kill(os.getpid(), 9)
    elif what == "full" and ranks.rank == 0:
        resource.setrlimit(resource.RLIMIT_FSIZE, (500, resource.RLIM_INFINITY))


def levels(scene, force, changes):
    return pds.simulate(pds.load_scene(scene, changes), force).levels


def pressed(dynamics):
    """A bonded block pressed by a plate and a disc that overlap the parts of several ranks: its
    last level, and the displacements.
    """
    plate = {"half_plane": {"point": (0, 1), "normal": (0, 1)}, "x2": -0.2, "name": "plate"}
    disc = {"disc": {"center": (1.3, 0.5), "radius": 0.25}, "x1": -0.1, "name": "disc"}
    step = {"to": 1.0} | ({"dynamics": {"duration": 0.5, "density": 1.0}} if dynamics else {})
    scene = pds.Scene(
        name="pressed",
        spacing=0.1,
        body=pds.shapes.Rectangle(size=(1.0, 1.0)),
        material={"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 10.0},
        prescribed=(pds.Prescribed(region="bottom", x1=0.0, x2=0.0),),
        obstacles=(plate, disc),
        steps=(step,),
        solver={"tolerance": 1e-7},
    )
    result = pds.simulate(scene, "bond-energy")
    return result.levels[-1], result.displacement() if communicator().rank == 0 else None


def inverse_by_multigrid():
    """What the preconditioner of a block of 6,240 points, held at one end and rolling on one
    side, makes of forces; on the first rank.
    """
    scene = pds.load_scene(
        "bonded-block",
        {
            "spacing": 0.05,
            "body.size": [0.65, 1.2, 1.0],
            "body.lower": [0.0, -0.6, -0.5],
            "probes": [],
        },
    )
    problem = compile_scene(
        scene, checked_models(scene, pds.load_surrogate("bond-energy")), communicator()
    )
    body, share = problem.body, problem.body.share
    free = share.own[:, None] * np.ones(3)
    free[body.points[:, 0] < 0.05] = 0
    free[body.points[:, 1] < -0.55, 1] = 0
    forces = np.sin(7 * body.points) * body.volumes[:, None]
    return share.gather(inverse_of(laplacian_of(body, 1.0), free)(forces))


def script(path):
    runpy.run_path(path, run_name="__main__")


class Rubber:
    """Exact forces of bonds, with an error on one rank beyond a stretch."""

    def __init__(self, limit):
        self.limit = limit

    def bond_force(self, stretch, rotation, length, C33, J):
        if communicator().rank == 1 and stretch.max() > self.limit:
            raise RuntimeError("boom")
        return pds.AnalyticBondForce().bond_force(stretch, rotation, length, C33, J)


def with_an_error(limit):
    pds.simulate(pds.load_scene("uniaxial", spacing=0.25, stretches=[1.3, 1.5]), Rubber(limit))


def different_scenes():
    pds.simulate(pds.load_scene("uniaxial", spacing=0.25 - 0.05 * communicator().rank), "analytic")


if __name__ == "__main__":
    disturbed(sys.argv[1], int(sys.argv[2]), *sys.argv[3:])
