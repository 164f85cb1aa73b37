"""Speed against error of every force model, measured in one interleaved run."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numba
import numpy as np

from .. import learning
from ..artifacts import load_surrogate
from ..body import Body
from ..engine.threads import at_most, most_threads
from ..forces import AnalyticBondForce, BANOSBForce, BondEnergyForce, EnergySurrogate, ForceModel, ForceSurrogate, NOSBForce
from ..forces.kernel_values import kernel_bond_force, kernel_energy
from ..learning.levenberg_marquardt import listening
from ..learning.sobolev import SobolevRegressor
from ..materials import Law, NeoHookean
from ..results.provenance import processor
from ..run.run import Silent
from ..run.simulate import SimulationFailed, SimulationInterrupted, simulate
from ..scenes import load_scene
from .speed import TimedModel, measure_speed, sheet

Progress = Callable[[str, float, int, str], None]
"""Function that receives the stage, how much of it is done (fractions of a model count), the total, and a description."""

FITTING, TIMING, ERRORS, SCENE = "Fitting", "Timing", "Errors", "Section 6.2"
"""Stages of a comparison."""

RIVAL, REFERENCE = "BA-NOSB", "NOSB"
"""Titles of the models to whose cost that of the others is compared."""


SHIPPED = {("symmetric", 20): "neo-hookean@1", ("isochoric", 4): "neo-hookean@2"}
"""Shipped networks of Neo-Hookean rubber by their features and units, which need no fit."""


@dataclass(frozen=True)
class Candidate(TimedModel):
    """Force model in one precision, with the changes to the scene that it needs."""

    title: str
    changes: tuple[str, ...]


class Plan(NamedTuple):
    """Force model to be loaded or fitted, and its precisions; ``{size}`` in the title is replaced by the model's size."""

    title: str
    made: Callable[[], ForceModel]
    precisions: tuple[str, ...] = ("float32",)
    changes: tuple[str, ...] = ()


def plans(law: Law, quick: bool) -> Iterator[Plan]:
    """Yield the force models of a material: the exact ones, BA-NOSB, and surrogates of several sizes to be fitted now.

    For the default Neo-Hookean law the shipped networks are used as they are.
    """
    shipped = isinstance(law, NeoHookean)
    samples = learning.training_samples(law, 3000 if quick else 8000, learning.reachable_stretches(law), random_state=0)

    def fitted(features, regressor) -> ForceSurrogate:
        model = learning.surrogate_pipeline(regressor, features=features).fit(samples.X, samples.y)
        return learning.surrogate_of(model, law, samples)

    def network(features: str, units: int, precisions: tuple[str, ...] = ("float32",)) -> Plan:
        iterations = 150 if quick else 600
        regressor = learning.LevenbergMarquardtRegressor((units,), "algebraic", max_iter=iterations, n_iter_no_change=100, random_state=0)
        artefact = SHIPPED.get((features, units)) if shipped else None
        made = partial(fitted, features, regressor) if artefact is None else partial(load_surrogate, artefact)
        return Plan(f"network, {features}, {units} units", made, precisions)

    def fitted_energy() -> EnergySurrogate:
        reach = learning.reachable_stretches(law, (0.5, 5.0))
        energies = learning.training_samples(law, 1000 if quick else 2000, reach, target="sheet-energy")
        regressor = SobolevRegressor(12, max_iter=200 if quick else 1000, random_state=0)
        return learning.surrogate_of(learning.surrogate_pipeline(regressor, "sheet-energy").fit(energies.X, energies.y), law, energies)

    double, both = ("float64",), ("float32", "float64")
    yield Plan(REFERENCE, NOSBForce, double)
    yield Plan(RIVAL, BANOSBForce, double)
    yield Plan("analytic bond force", partial(AnalyticBondForce, law), double)
    if shipped:
        # Its domain is too small for the scene (theory, section 5): as in the paper, it is also evaluated outside.
        paper = partial(load_surrogate, "neo-hookean-paper")
        yield Plan("network, paper's features, 20 units", paper, changes=("outside=extrapolate",))
    for units in (12, 20) if quick else (8, 12, 20, 40):
        yield network("symmetric", units, both if units == 20 else both[:1])
    yield Plan("bond-level energy, exact", BondEnergyForce, double)
    yield Plan("bond-level energy, network, 12 units", fitted_energy, both)
    for units in (8,) if quick else (4, 8):
        yield network("isochoric", units)
    # The response of Neo-Hookean rubber does not depend on the isochoric features; other laws need higher degrees.
    for degree in (4,) if shipped else (((10, 4),) if quick else ((8, 4), (10, 4), (12, 6))):
        yield Plan("polynomial, isochoric, {size}", partial(fitted, "isochoric", learning.ChebyshevRegressor(degree)))


def _share_of(progress: Progress, stage: str, number: int, of: int, what: str) -> Callable[[float, str], None]:
    """Return a function that reports the share of one of several models in a stage that is done, and a text."""
    return lambda share, text="": progress(stage, number + share, of, f"{what}: {text}" if text else what)


def candidates(law: Law, quick: bool, body: Body, progress: Progress) -> list[Candidate]:
    """Return the planned models in each of their precisions, fitted where necessary."""
    planned, found = list(plans(law, quick)), []
    for number, plan in enumerate(planned):
        told = _share_of(progress, FITTING, number, len(planned), plan.title.format(size="").removesuffix(", "))
        told(0.0)
        with listening(lambda now, most, loss, told=told: told(now / most, f"iteration {now} of at most {most}, loss {loss:.2e}")):
            model = plan.made()
        title = plan.title.format(size=model.size)
        found += [Candidate(model, precision, body, title, plan.changes) for precision in plan.precisions]
    return found


def measure_error(entry: Candidate, law: Law, n_samples: int) -> dict:
    """Return the force errors of the kernel in its own precision, on and off the plane-stress surface, and the least stiffness slope.

    The result is empty if the model has no bond force.
    """
    if isinstance(entry.model, EnergySurrogate):
        # An energy gives the stress on the surface only, since C33 is not among its inputs.
        samples = learning.training_samples(law, n_samples, learning.reachable_stretches(law), 0.25, 1_000_003, target="sheet-energy")
        errors = samples.target.errors(np.stack(kernel_energy(entry.model, law, entry.precision, *samples.X.T), axis=1), samples)
        return {"rms_on_surface": errors["rms"], "max_on_surface": errors["max"]}
    if not isinstance(entry.model, ForceSurrogate):
        return {}
    reach = learning.reachable_stretches(law)
    report = learning.evaluate(kernel_bond_force(entry.model, law, entry.precision), law, reach, n_samples=n_samples)
    # Differences of single-precision forces would be noise: the slope is that of the same model in double precision.
    slope = report if entry.precision == "float64" else learning.evaluate(entry.model.bond_force, law, reach, n_samples=n_samples)
    errors = {f"{kind}_{where}": report[where][kind] for where in ("on_surface", "off_surface") for kind in ("rms", "max")}
    return {**errors, "least_slope": slope["least_slope"]}


class _Levels(Silent):
    """Progress of a run: reports the number of finished levels, and the residual of the current one."""

    def __init__(self, levels: int, told: Callable[[float, str], None]) -> None:
        self._levels, self._told, self._done = levels, told, 0

    def level(self, number: int, parameter: float) -> None:
        self._done = number

    def residual(self, evaluations: int, residual: float, tolerance: float) -> None:
        self._told(self._done / self._levels, f"residual {residual:.1e}, {evaluations} evaluations")


def measure_scene(entry: Candidate, law: Law, spacing: float, told: Callable[[float, str], None]) -> dict:
    """Return the greatest errors at the levels of the paper's section 6.2, with the number of evaluations and the seconds."""
    changes = [f"spacing={spacing}", f"precision={entry.precision}", *entry.changes]
    scene = load_scene("uniaxial", changes, material=law.describe())
    try:
        result = simulate(scene, entry.model, progress=_Levels(len(scene.stretches), told))
    except SimulationInterrupted:
        raise KeyboardInterrupt from None
    except SimulationFailed as error:
        return {"scene_failure": str(error)}
    return {
        "scene_stress_error": max(abs(level["nominal_stress_error"]) for level in result.levels),
        "scene_displacement_error": max(abs(level["lateral_displacement_error"]) for level in result.levels),
        "scene_evaluations": result.summary["n_force_evaluations"],
        "scene_seconds": result.summary["seconds_total"] - result.summary["seconds_compile"],
        "scene_method": result.levels[-1]["method"],
    }


def compare(
    law: Law | None = None, quick: bool = False, progress: Progress = lambda stage, done, of, text: None, threads: int | None = None
) -> dict:
    """Measure the speed and the error of every force model.

    Parameters
    ----------
    law : Law, optional
        Neo-Hookean with K = 100 mu by default.
    quick : bool
        Coarser scene, smaller fits and shorter timings: for a first look, not for quoting.
    progress : callable
        See `Progress`.
    threads : int, optional
        Greatest number of threads that is measured; by default all.

    Returns
    -------
    dict
        ``machine``, ``material``, ``settings`` and ``models``: a list of rows, one for each model and precision.

    Raises
    ------
    ValueError
        If there are fewer threads.
    """
    law, body = law or NeoHookean(), sheet()
    spacing, patience, n_samples = (0.05, 10.0, 2000) if quick else (0.02, 200.0, 20_000)
    with at_most(threads):
        entries, rows = candidates(law, quick, body, progress), []
        speeds = measure_speed(entries, law, patience, partial(progress, TIMING))
        for number, (entry, speed) in enumerate(zip(entries, speeds, strict=True)):
            progress(ERRORS, number, len(entries), f"{entry.title}, {entry.precision}")
            described = {"force": entry.title, "precision": entry.precision, "size": entry.model.size}
            rows.append({**described, **speed, **measure_error(entry, law, n_samples)})
        for number, (entry, row) in enumerate(zip(entries, rows, strict=True)):
            told = _share_of(progress, SCENE, number, len(entries), f"{entry.title}, {entry.precision}")
            row.update(measure_scene(entry, law, spacing, told))
        cost = {row["force"]: row["ns_per_directed_bond_1"] for row in rows}
        for row in rows:
            row["speedup_over_ba_nosb"] = cost[RIVAL] / row["ns_per_directed_bond_1"]
            row["cost_over_nosb"] = row["ns_per_directed_bond_1"] / cost[REFERENCE]
        return {
            "machine": {"processor": processor(), "threads": most_threads(), "numba": numba.__version__},
            "material": law.describe(),
            "settings": {"quick": quick, "points": len(body), "patience": patience, "scene_spacing": spacing},
            "models": rows,
        }
