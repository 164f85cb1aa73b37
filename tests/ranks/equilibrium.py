"""Run by `test_ranks_results.py` on several ranks: levels of scenes in equilibrium, a line each."""

import json
import sys

import pdsurrogate as pds
from pdsurrogate.ranks import communicator


def main(cases):
    for scene, force, changes in cases:
        levels = pds.simulate(pds.load_scene(scene, changes), force).levels
        if communicator().rank == 0:
            print("levels", json.dumps(levels), flush=True)


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
