"""A large body in space brought to equilibrium: time, memory, evaluations, and where the time goes.

python pipelines/large_body.py             the scene bonded-block with 100 points a side, a million
python pipelines/large_body.py 32          with 32
python pipelines/large_body.py --docs      and put the figures into the documentation
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import resource
import time
from pathlib import Path

import numba
from pages import markdown_table, replace_block
from rich.console import Console

import pdsurrogate as pds
from pdsurrogate.results.provenance import processor

console = Console()

PARTS = {
    "setup: points, bonds, force": ("run/run.py", "__init__"),
    "force evaluations": ("forces/internal_force.py", "__call__"),
    "setup: preconditioner": ("solvers/preconditioner.py", "preconditioner_of"),
    "preconditioner: D linearized": ("forces/volume_energy.py", "take"),
    "pressure steps: D": ("forces/volume_energy.py", "changes"),
    "pressure steps: transpose of D": ("forces/volume_energy.py", "forces"),
    "pressure steps: multigrid cycle": ("solvers/multigrid.py", "cycle"),
    "pressure steps: preconditioner": ("solvers/preconditioner.py", "precondition"),
}
"""Functions whose time is told, by file and name; none of them calls another."""


def split(profile: cProfile.Profile) -> dict[str, tuple[int, float]]:
    """Calls of every part, and seconds spent in them and in what they call."""
    found = {}
    for (file, _, name), (_, calls, _, seconds, _) in pstats.Stats(profile).stats.items():
        for part, (place, wanted) in PARTS.items():
            if Path(file).as_posix().endswith(f"pdsurrogate/{place}") and name == wanted:
                found[part] = calls, seconds
    if missing := PARTS.keys() - found.keys():
        raise RuntimeError(f"the run calls no function named in PARTS for {', '.join(sorted(missing))}: correct the names there")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("points", nargs="?", type=int, default=100, help="points a side (100)")
    parser.add_argument("--docs", action="store_true", help="put the figures into the documentation")
    arguments = parser.parse_args()
    scene = pds.load_scene("bonded-block", {"spacing": 1 / arguments.points, "solver.tolerance": 1e-5})
    # Kernels are compiled or loaded by a small one.
    pds.simulate(pds.load_scene("bonded-block", {"spacing": 1 / 18, "solver.tolerance": 1e-2}))
    began, worked, profile = time.perf_counter(), time.process_time(), cProfile.Profile()
    result = profile.runcall(pds.simulate, scene)
    seconds, worked = time.perf_counter() - began, time.process_time() - worked
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    level = result.levels[-1]
    lines = [
        f"{len(result.body):,} points ({arguments.points} per side): {seconds:,.0f} s of wall time and {worked:,.0f} s of processor time "
        f"on {numba.get_num_threads()} threads of {processor()}, shared with other programs; {memory:.2f} GiB at most;",
        f"{result.summary['n_force_evaluations']} evaluations in total; residual {level['residual']:.1e}, nominal stress "
        f"{level['nominal_stress']:.5f}. Wall time of the parts:",
    ]
    rows = [[part, str(calls), f"{spent:,.0f}", f"{100 * spent / seconds:.0f}"] for part, (calls, spent) in split(profile).items()]
    left = seconds - sum(spent for _, spent in split(profile).values())
    rows.append(["other", "", f"{left:,.0f}", f"{100 * left / seconds:.0f}"])
    table = markdown_table(["part", "calls", "seconds", "%"], rows)
    console.print("\n".join(lines), table, sep="\n\n", soft_wrap=True)
    if arguments.docs:
        replace_block("large-body", "\n".join([*lines, "", table]))


if __name__ == "__main__":
    main()
