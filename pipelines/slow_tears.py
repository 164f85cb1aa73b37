"""Slow tears in equilibrium against slow tears in dynamics: peaks of the load, energies and cost,
and what the order of breaking and the tolerance change.

python pipelines/slow_tears.py --lacking        measures what docs/figures/slow-tears.json lacks
python pipelines/slow_tears.py quasi-static     measures the tears in equilibrium
python pipelines/slow_tears.py --docs           writes the page

Sheets of some 400 points are torn in equilibrium, and in dynamics at 0.004 times the speed of shear
waves, which takes some ten minutes a tear on one core of 2 GHz, and half an hour for the trousers.
"""

from itertools import product
from unittest.mock import patch

import numpy as np
from cases import Study, report, rounded
from pages import markdown_table

import pdsurrogate as pds
from pdsurrogate.run import tearing
from pdsurrogate.run.damage import Damage

SEEDS = (0, 1, 2, 3, 4, 5)
"""Seeds of relaxed points; 0 is the lattice."""

RUBBER = {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 20.0}
ROWS, CRITICAL = 12, 2.0
RATE = 0.004

SHEETS = {
    "strip": ((3.0, 1.0), 1.0, (1.3, 1.6)),
    "notched": ((1.5, 2.0), 0.5, (1.1, 1.6)),
}
"""Sheets between clamps: size, length of the cut at half the height, and stretches at which
dynamics begin and end.
"""


def sheet(name, seed, process):
    """A sheet with a cut from its edge, pulled apart between clamps."""
    size, cut, (begin, end) = SHEETS[name]
    body = {"shape": "rectangle", "size": size}
    if seed:
        body |= {"arrangement": "relaxed", "seed": seed}
    ends = [[-1.0, size[1] / 2], [cut, size[1] / 2]]
    return {
        "name": name,
        "spacing": 1.0 / ROWS,
        "horizon_ratio": 2.2,
        "body": body,
        "precuts": [dict(zip(("start", "end"), ends, strict=True))],
        "material": RUBBER,
        "grips": [{"edge": "bottom"}, {"edge": "top", "travel": 1.0}],
        "stretches": [begin],
        "fracture": {"critical_stretch": CRITICAL, "process": process},
        "dynamics": {
            "stretch": end,
            "stretch_rate": RATE / size[1],
            "density": 1.0,
            "damping": 0.02,
            "outputs": 8,
        },
    }


def cantilever(process):
    """A double cantilever, whose ends move apart: a stable tear."""
    moving = {"duration": 1.0 / RATE, "density": 1.0, "damping": 0.02}
    held = [{"region": "up", "x1": 0.0, "x2": 1.0}, {"region": "down", "x1": 0.0, "x2": -1.0}]
    return {
        "name": "cantilever",
        "spacing": 1.0 / ROWS,
        "horizon_ratio": 2.2,
        "body": {"shape": "rectangle", "size": [3.0, 1.0]},
        "precuts": [{"start": [-1.0, 0.5], "end": [1.0, 0.5]}],
        "material": RUBBER,
        "regions": {
            "up": {"box": [[-0.1, 0.5], [0.2, 1.1]]},
            "down": {"box": [[-0.1, -0.1], [0.2, 0.5]]},
        },
        "prescribed": held,
        "steps": [0.3, {"to": 1.3, "outputs": 10, "dynamics": moving}],
        "fracture": {"critical_stretch": 1.8, "process": process},
    }


def figures_of(scene):
    """Run a scene; return the greatest load, the numbers of broken bonds and force evaluations, and
    the greatest error of the energy balance in percent.
    """
    result = pds.simulate(pds.Scene.model_validate(scene), "bond-energy", threads=1)
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
    scene = cantilever(process) if name == "cantilever" else sheet(name, seed, process)
    yield name, seed, process, *figures_of(scene)


def legs():
    """Critical stretch of the trouser tear, mean force on its legs from a travel of 21 mm on,
    energy by that force (Rivlin and Thomas), force evaluations and error of the balance.
    """
    scene = pds.load_scene("trousers", steps=[12.0, {"to": 25.0, "outputs": 13}])
    result = pds.simulate(scene, "bond-energy", threads=1)
    rows = np.array([(row["t"], row["force_one_3"]) for row in result.history if row["t"] > 21.0])
    mean = abs(np.trapezoid(rows[:, 1], rows[:, 0]) / np.ptp(rows[:, 0]))
    found = pds.tearing_energy(scene.law(), mean, 8.0, 2.0)
    summary = result.summary
    gap = summary["quasi_static"]["greatest_energy_gap"]
    yield summary["critical_stretch"], mean, found, summary["n_force_evaluations"], gap


VARIANTS = {
    "as it is": {"OVERLOAD": tearing.OVERLOAD},
    "half the excess": {"OVERLOAD": tearing.OVERLOAD / 2},
    "half the tolerances": {"FINE": tearing.FINE / 2, "COARSE": tearing.COARSE / 2},
    "a fiftieth of the tolerances": {"FINE": tearing.FINE / 50, "COARSE": tearing.COARSE / 50},
    "one bond of the body at a time": {"OVERLOAD": tearing.OVERLOAD},
}


def varied(name, seed, variant):
    """Figures of a tear with another excess, tolerance or order."""
    foremost = Damage.foremost

    def one(damage, pairs, loads, alike):
        return foremost(damage, pairs[[loads.argmax()]], loads[[loads.argmax()]], alike)

    chosen = one if "one bond" in variant else foremost
    with patch.multiple(tearing, **VARIANTS[variant]), patch.object(Damage, "foremost", chosen):
        yield name, seed, variant, *figures_of(sheet(name, seed, "quasi-static"))


def beside(figures):
    """The table of tears in equilibrium and in dynamics, with the means over seeds."""
    found = {tuple(row[:3]): row[3:] for rows in figures.values() for row in rows}
    lines = []
    ratios = {}
    for name, seed, process in found:
        slow, fast = (found.get((name, seed, one)) for one in ("quasi-static", "dynamics"))
        if process == "dynamics" or slow is None or fast is None:
            continue
        if seed:
            ratios.setdefault(name, []).append((slow[0], fast[0]))
        lines.append(
            [
                name,
                f"seed {seed}" if seed else "lattice",
                *(f"{one[0]:.4f}" for one in (slow, fast)),
                f"{slow[0] / fast[0]:.3f}",
                *(str(one[1]) for one in (slow, fast)),
                *(str(one[2]) for one in (slow, fast)),
                f"{slow[3]:+.2f}",
            ]
        )
    for name, pairs in ratios.items():
        means = np.mean(pairs, axis=0)
        lines.append(
            [
                name,
                f"mean of {len(pairs)} seeds",
                *(f"{mean:.4f}" for mean in means),
                f"{means[0] / means[1]:.3f}",
                *5 * [""],
            ]
        )
    titles = ["sheet", "points", "peak, slow tear", "peak, dynamics", "ratio"]
    titles += [
        f"{what}, {how}" for what in ("bonds", "evaluations") for how in ("slow", "dynamics")
    ]
    return markdown_table([*titles, "energy error, slow (%)"], lines)


def orders(figures):
    """The table of variants."""
    rows = [row for rows in figures.values() for row in rows]
    first = {(name, seed): peak for name, seed, variant, peak, *_ in rows if variant == "as it is"}
    return markdown_table(
        ["sheet", "points", "variant", "peak", "change (%)", "bonds", "evaluations"],
        [
            [
                name,
                f"seed {seed}" if seed else "lattice",
                variant,
                f"{peak:.4f}",
                f"{100 * (peak / first[name, seed] - 1):+.2f}",
                str(bonds),
                str(evaluations),
            ]
            for name, seed, variant, peak, bonds, evaluations, _ in rows
        ],
    )


def trousers(figures):
    """The table of the trouser tear."""
    return markdown_table(
        ["critical stretch", "force (N)", "G (N/mm)", "evaluations", "energy error (%)"],
        [
            [f"{critical:.4f}", f"{force:.3f}", f"{found:.3f}", str(count), f"{gap:+.2f}"]
            for rows in figures.values()
            for critical, force, found, count, gap in rows
        ],
    )


PROCESSES = "quasi-static", "dynamics"
TEARS = [*product(SHEETS, SEEDS, PROCESSES), *product(["cantilever"], [0], PROCESSES)]


def cases_of(measure, arguments):
    """Cases of a study, by what is measured."""
    return {
        ", ".join(map(str, one)): (lambda one=one: rounded(list(measure(*one))))
        for one in arguments
    }


if __name__ == "__main__":
    report(
        __doc__,
        Study("slow-tears", cases_of(torn, TEARS), {"slow-tears": beside}),
        Study(
            "slow-tears-order",
            cases_of(varied, product(SHEETS, (0, 1), VARIANTS)),
            {"slow-tears-order": orders},
        ),
        Study("slow-tears-trousers", {"trousers": legs}, {"slow-tears-trousers": trousers}),
    )
