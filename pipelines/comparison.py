"""Speed and error of every force model of Neo-Hookean sheets.

python pipelines/comparison.py                    measures all models, in some minutes
python pipelines/comparison.py isochoric --docs   those with such a word in their names, and writes
the table and the figure of all; --help names other uses
"""

from collections.abc import Callable
from functools import cache, partial

import matplotlib
import numpy as np
from cases import Study, of_rows, report
from clock import TimedModel, measure_speed, sheet
from matplotlib.figure import Figure
from pages import FIGURES

import pdsurrogate as pds
from pdsurrogate import learning
from pdsurrogate.forces import FORCES, EnergySurrogate, ForceSurrogate
from pdsurrogate.forces.kernel_values import kernel_bond_force, kernel_energy
from pdsurrogate.results.figures import STYLE, save

LAW = pds.materials.NeoHookean()
REACH = learning.reachable_stretches(LAW)
SAMPLES = 20_000
"""Number of states at which errors are measured."""


def fitted(regressor, features, *drawn, **more):
    """A surrogate of the law."""
    samples = learning.training_samples(LAW, *drawn, random_state=0, **more)
    model = learning.surrogate_pipeline(regressor, features).fit(samples.X, samples.y)
    return learning.surrogate_of(model, LAW, samples)


def network(features, units):
    """A network for the bond force."""
    rounds = {"max_iter": 600, "n_iter_no_change": 100, "random_state": 0}
    regressor = learning.LevenbergMarquardtRegressor((units,), "algebraic", **rounds)
    return fitted(regressor, features, 8000, REACH)


def energy():
    """A network for the energy."""
    regressor, target = learning.SobolevRegressor(12, max_iter=1000, random_state=0), "sheet-energy"
    stretches = learning.reachable_stretches(LAW, (0.5, 5.0))
    return fitted(regressor, target, 2000, stretches, target=target)


EXACT = [name for name in FORCES if "stress" in pds.load_surrogate(name).honors["plane"]]
PAPER = "network, paper's features, 20 units"
TWENTY, ENERGY = "network, symmetric, 20 units", "bond-level energy, network, 12 units"
MODELS: dict[str, Callable[[], pds.forces.ForceModel]] = {
    **{name: partial(pds.load_surrogate, name) for name in ("nosb", "ba-nosb", *EXACT)},
    PAPER: partial(pds.load_surrogate, "neo-hookean-paper"),
    **{
        f"network, symmetric, {units} units": partial(network, "symmetric", units)
        for units in (8, 12, 20, 40)
    },
    TWENTY: partial(pds.load_surrogate, "neo-hookean@1"),
    ENERGY: energy,
    "network, isochoric, 4 units": partial(pds.load_surrogate, "neo-hookean@2"),
    "network, isochoric, 8 units": partial(network, "isochoric", 8),
    "polynomial, isochoric, degree 4": partial(
        fitted, learning.ChebyshevRegressor(4), "isochoric", 8000, REACH
    ),
}
"""Force models, shipped or fitted."""

CASES = [(name, "float64") for name in MODELS if name in (*FORCES, TWENTY, ENERGY)]
CASES += [(name, "float32") for name in MODELS if name not in FORCES]


@cache
def model_of(name):
    """A model that serves both precisions."""
    return MODELS[name]()


def errors_of(model, precision):
    """Relative errors of a learned model against the exact law, of the compiled kernel in its own
    precision: RMS at states of plane stress and at others, and greatest there; and the least slope
    of the force by the bond stretch. None for what a model has not.
    """
    if isinstance(model, EnergySurrogate):
        samples = learning.training_samples(
            LAW, SAMPLES, REACH, 0.25, 1_000_003, target="sheet-energy"
        )
        found = kernel_energy(model, LAW, precision, *samples.X.T)
        errors = samples.target.errors(np.stack(found, axis=1), samples)
        return [errors["rms"], None, errors["max"], None, None]
    if not isinstance(model, ForceSurrogate):
        return [None] * 5
    compiled = kernel_bond_force(model, LAW, precision)
    report = learning.evaluate(compiled, LAW, REACH, n_samples=SAMPLES)
    errors = [
        report[where][kind] for kind in ("rms", "max") for where in ("on_surface", "off_surface")
    ]
    # Differences of single-precision forces would be noise: the slope is that of the same model in
    # double precision.
    slope = learning.evaluate(model.bond_force, LAW, REACH, n_samples=SAMPLES)["least_slope"]
    return [*errors, slope]


def of_scene(model, *changes):
    """Greatest errors (%) and cost of the paper's section 6.2; None if it fails."""
    try:
        result = pds.simulate(pds.load_scene("uniaxial", changes), model)
    except pds.SimulationFailed:
        return [None] * 4
    errors = (
        100 * max(abs(level[f"{key}_error"]) for level in result.levels)
        for key in ("nominal_stress", "lateral_displacement")
    )
    seconds = result.summary["seconds_total"] - result.summary["seconds_compile"]
    return [*errors, result.summary["n_force_evaluations"], seconds]


def compared(name, precision):
    """Cost, errors and a run of a model."""
    model = model_of(name)
    # Its domain is too small for the scene (theory, section 5): as in the paper, it is also
    # evaluated outside.
    changes = ["outside=extrapolate"] * (name == PAPER)
    (cost,) = measure_speed([TimedModel(model, precision, sheet())], LAW)
    scene = of_scene(model, f"precision={precision}", *changes)
    yield f"{name}, {precision}", *cost.values(), *errors_of(model, precision), *scene


STUDY = of_rows("speed", compared, CASES)


def drawn(figures):
    """The table, and the figure: RMS force errors at states that do not satisfy plane stress,
    against the cost; a model without a measured error is a vertical line at its cost.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(8.6, 4.4), layout="constrained")
        axis, colors = figure.subplots(), matplotlib.colormaps["tab20"].colors
        for ((name, cost, _, _, error, *_),), color in zip(figures.values(), colors, strict=False):
            if error is None:
                axis.axvline(cost, lw=1.2, ls="--", label=name, color=color)
            else:
                axis.plot(cost, max(error, 1e-9), "o", ms=6, label=name, color=color)
        figure.legend(loc="outside right upper", fontsize=7, frameon=False)
        axis.set(
            xscale="log",
            yscale="log",
            xlabel="whole force evaluation, ns per directed bond, one thread",
            ylabel="relative RMS force error off the surface",
        )
        axis.grid(alpha=0.3)
        save(figure, FIGURES / "speed.png")
    return STUDY.tables["speed"](figures)


if __name__ == "__main__":
    report(__doc__, Study("speed", STUDY.cases, {"speed": drawn}))
