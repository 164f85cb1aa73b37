"""Slow tears in equilibrium against slow tears in dynamics: peaks of the load, energies and cost,
and what the order of breaking and the tolerance change.

python pipelines/slow_tears.py --lacking        measures what docs/figures/slow-tears.json lacks
python pipelines/slow_tears.py quasi-static     measures the tears in equilibrium
python pipelines/slow_tears.py --docs           writes the page

Sheets of some 400 points are torn in equilibrium, and in dynamics at 0.004 and at 0.0004 times the
speed of shear waves, which takes some minutes a tear on one core of 2 GHz, and half an hour for the
trousers.
"""

import time
from itertools import product
from unittest.mock import patch

import numpy as np
from cases import LISTED, of_rows, percent, report, rows_of, scene_of

import pdsurrogate as pds
from pdsurrogate.run import tearing
from pdsurrogate.run.damage import Damage

SEEDS = (0, 1, 2, 3, 4, 5)
"""Seeds of relaxed points; 0 is the lattice."""

SHEETS = "strip", "notched"
"""Sheets between clamps."""


SLOWER = LISTED["slower tears"]
"""A tenth of the rate of each file, for the process "slower dynamics"."""


def scene(name, seed, process):
    """A sheet, or a double cantilever."""
    changes = {"body.arrangement": "relaxed", "body.seed": seed} if seed else {}
    if process.startswith("slower"):
        process, changes = "dynamics", changes | SLOWER[name]
    return scene_of(f"slow-tear-{name}", changes | {"fracture.process": process})


def figures_of(scene):
    """Run a scene; return the greatest load, the numbers of broken bonds and force evaluations, and
    the greatest error of the energy balance in percent.
    """
    result = pds.simulate(scene, "bond-energy", threads=1)
    summary = result.summary
    crack = summary["crack"]
    peak = crack["peak"]
    account = summary.get("quasi_static") or summary["dynamics"][-1]
    return (
        peak.get("nominal_stress", peak.get("force")),
        crack["broken_bonds"],
        summary["n_force_evaluations"],
        account["greatest_energy_gap"],
    )


def torn(name, seed, process):
    """Figures of one tear."""
    yield name, seed, process, *figures_of(scene(name, seed, process))


LEGS = LISTED["legs"]
"""Changes of the scene `trousers`: with legs of 8 x 2 mm, and of half the points for dynamics."""

LEG_MOTIONS = {"slower dynamics": (4.0, 0.1), "slower dynamics, damped": (4.0, 1.0)}
"""Times over `LEG_TIME`, and damping, of other motions of the legs."""

LEG_TIME = 13.0 / (0.004 * (0.72 / 1e-3) ** 0.5)
"""Time of 13 mm at 0.004 times the speed of shear waves."""


def legs(name, process):
    """Critical stretch of a trouser tear, mean force on its legs from a travel of 21 mm on,
    energy by that force (Rivlin and Thomas), force evaluations and error of the balance.
    """
    slower, damping = LEG_MOTIONS.get(process, (1.0, 0.1))
    motion = {"duration": slower * LEG_TIME, "density": 1e-3, "damping": damping}
    motion["viscosity"] = 0.002
    last = {"to": 25.0} | (
        {"outputs": 13} if process == "quasi-static" else {"outputs": 60, "dynamics": motion}
    )
    changes = {"steps": [12.0, last], **LEGS[name]}
    if process != "quasi-static":
        changes["fracture"] = changes["fracture"] | {"process": "dynamics"}
    scene = pds.load_scene("trousers", changes)
    result = pds.simulate(scene, "bond-energy", threads=1)
    rows = np.array([(row["t"], row["force_one_3"]) for row in result.history if row["t"] > 21.0])
    mean = abs(np.trapezoid(rows[:, 1], rows[:, 0]) / np.ptp(rows[:, 0]))
    found = pds.tearing_energy(scene.law(), mean, scene.body.size[1] / 2, 2.0)
    summary = result.summary
    gap = (summary.get("quasi_static") or summary["dynamics"][-1])["greatest_energy_gap"]
    evaluations = summary["n_force_evaluations"]
    yield name, process, summary["critical_stretch"], mean, found, evaluations, gap


VARIANTS = {
    "as it is": {"OVERLOAD": tearing.OVERLOAD},
    "half the excess": {"OVERLOAD": tearing.OVERLOAD / 2},
    "half the tolerances": {"FINE": tearing.FINE / 2, "ROUGH": tearing.ROUGH / 2},
    "a fiftieth of the tolerances": {"FINE": tearing.FINE / 50, "ROUGH": tearing.ROUGH / 50},
    "one bond of the body at a time": {"OVERLOAD": tearing.OVERLOAD},
}


def varied(name, seed, variant):
    """Figures of a tear with another excess, tolerance or order."""
    foremost = Damage.foremost

    def one(damage, pairs, loads, *shares):
        return foremost(damage, pairs[[loads.argmax()]], loads[[loads.argmax()]], *shares)

    chosen = one if "one bond" in variant else foremost
    with patch.multiple(tearing, **VARIANTS[variant]), patch.object(Damage, "foremost", chosen):
        yield name, seed, variant, *figures_of(scene(name, seed, "quasi-static"))


def timed(stretch, spacing, *processes):
    """Points, process, force evaluations, broken bonds and processor time of the scene `tear`."""
    changes = {"spacing": spacing, "fracture.critical_stretch": stretch}
    for process in processes:
        scene = pds.load_scene("tear", {**changes, "fracture.process": process})
        began = time.process_time()
        summary = pds.simulate(scene, threads=1).summary
        spent = time.process_time() - began
        counts = summary["n_force_evaluations"], summary["crack"]["broken_bonds"]
        yield summary["n_points"], stretch, process, *counts, spent


def points(seed):
    """Arrangement of the points in words."""
    return f"seed {seed}" if seed else "lattice"


def beside(figures):
    """Tears in equilibrium and in dynamics, with the means over lattice and seeds."""
    found = {tuple(row[:3]): row[3:] for row in rows_of(figures)}
    peaks = {}
    for (name, seed, process), fast in found.items():
        slow = found.get((name, seed, "quasi-static"))
        if process == "quasi-static" or slow is None:
            continue
        if name in SHEETS:
            peaks.setdefault((name, process), []).append((slow[0], fast[0], slow[2], fast[2]))
        counts = slow[1], fast[1], slow[2], fast[2]
        ratio = slow[0], fast[0], slow[0] / fast[0]
        yield name, points(seed), RATES[process], *ratio, *counts, slow[3]
    for (name, process), several in peaks.items():
        slow, fast, *counts = np.mean(several, axis=0)
        ratio = slow, fast, slow / fast
        counts = map(round, counts)
        yield name, f"mean of {len(several)}", RATES[process], *ratio, "", "", *counts, ""


def orders(figures):
    """Variants, with the change of the peak."""
    first = {}
    for name, seed, variant, peak, bonds, evaluations, _ in rows_of(figures):
        change = percent(peak, first.setdefault((name, seed), peak))
        yield name, points(seed), variant, peak, change, bonds, evaluations


RATES = {"dynamics": 0.004, "slower dynamics": 0.0004}
"""Rate of the clamps over the speed of shear waves."""

PROCESSES = "quasi-static", *RATES
TEARS = [*product(SHEETS, SEEDS, PROCESSES), *product(["cantilever"], [0], PROCESSES)]
TROUSERS = [
    ("as the scene", "quasi-static"),
    *(("half as wide", one) for one in (*PROCESSES[:2], *LEG_MOTIONS)),
]
TIMED = (2.0, 0.21, "quasi-static"), (3.5, 0.0642, *PROCESSES[:2])
"""The scene `tear` with 728 and with some 8,000 points, processes in turn."""


if __name__ == "__main__":
    report(
        __doc__,
        of_rows("slow-tears", torn, TEARS, rows=beside),
        of_rows("slow-tears-time", timed, TIMED),
        of_rows("slow-tears-order", varied, product(SHEETS, (0, 1), VARIANTS), rows=orders),
        of_rows("slow-tears-trousers", legs, TROUSERS),
    )
