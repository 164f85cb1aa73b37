"""Calibration of a law by fields and forces of a sheet with two holes from finite elements.

python pipelines/calibration.py               measures all cases
python pipelines/calibration.py energies      those of energies without a law

The data in pipelines/data/two_holes.npz are solutions by FElupe 11 (9-node quadrilaterals, plane
stress; 22,975 nodes, which differ from 9,239 nodes by 2e-5 cm rms and 1e-4 of the force): sheet 2 x
3 cm, circular holes of radius 0.4 at (0.7, 1.9) and 0.25 at (1.4, 1.0), bottom held, top moved by d
= 0.3 to 1.5 cm, displacements at 987 places. "gent" is incompressible with the shear modulus 0.4
kPa and the chain limit 30. "GT" and "CA" are the slightly compressible laws (K = 100 mu) of Gent
and Thomas, 0.5 (I1bar - 3) + log(I2bar/3) kPa, and of Carroll, 0.15 (I1bar - 3) + 3.1e-4 (I1bar^4 -
81) + 0.095 (sqrt I2bar - sqrt 3) kPa, with "_stresses": nominal stresses of homogeneous sheets of
these laws in the states of `states`. The noise is drawn here.
"""

import time
from pathlib import Path

import numpy as np
from cases import of_rows, report, scene_of
from pages import FIGURES

import pdsurrogate as pds
from pdsurrogate.calibration.reporting import figures
from pdsurrogate.identification import MODES, nominal_stress
from pdsurrogate.results.figures import save

DATA = np.load(Path(__file__).with_name("data") / "two_holes.npz")
TRUTH = pds.materials.Gent(0.4, 4000.0, 30.0)
FORCE_NOISE = 0.005
"""Standard deviation of the forces, relative to each."""


def measurements(law, noise, seed):
    """Table, values with noise, and standard deviations."""
    places, u, forces = (
        DATA["places"],
        DATA[f"{law}_displacements"].astype(float),
        DATA[f"{law}_forces"],
    )
    rows = [(step, axis, *place) for step in range(1, 6) for place in places for axis in (1, 2)]
    X = np.array([*rows, *((step, 0, 0.0, 0.0) for step in range(1, 6))])
    exact, deviation = (
        np.concatenate([u.ravel(), forces]),
        np.concatenate([np.full(u.size, noise), FORCE_NOISE * forces]),
    )
    return X, exact + deviation * np.random.default_rng(seed).standard_normal(len(X)), deviation


def states():
    """Uniaxial, equibiaxial and pure shear up to a stretch of 2."""
    stretches = np.linspace(1.1, 2.0, 10)
    return np.vstack(
        [np.stack([stretches, lateral(stretches)], axis=1) for lateral in MODES.values()]
    )


def calibrated(what, fitted, noise, spacing, refine):
    """Gent's law from fields and forces, or from forces alone; the first corrected one is drawn."""
    X, y, deviation = measurements("gent", noise, seed=1)
    chosen = np.full(len(y), True) if fitted == "fields" else X[:, 1] == 0
    model = pds.SceneRegressor(
        scene_of("two-holes", {"spacing": spacing}), "gent", refine=refine, bulk_ratio=1e4
    )
    model.fit(X[chosen], y[chosen], standard_deviation=deviation[chosen])
    if what == CASES[1][0]:
        drawn = figures(model, X, y, ["force"])["residuals"]
        save(drawn, FIGURES / "guide" / "calibration.png")
    stress, error = model.nominal_stress(states())
    exact = nominal_stress(TRUTH, states())
    found = zip(model.parameters_, model.standard_errors_, strict=True)
    cells = (f"{value:.4g} ± {sd:.2g}" for value, sd in found)
    off, within = stress / exact - 1, np.mean(np.abs(stress - exact) < 2 * error)
    yield what, *cells, 100 * np.sqrt((off**2).mean()), 100 * within, model.lack_of_fit_


def without_a_law(law, noise):
    """Energies without a law: errors of stresses in unseen tests by mode."""
    X, y, deviation = measurements(law, noise, seed=1)
    began, exact = time.process_time(), DATA[f"{law}_stresses"]
    model = pds.SceneRegressor(scene_of("two-holes", {}), None, bulk_ratio=100)
    model.fit(X, y, standard_deviation=deviation)
    seconds, (stress, error) = time.process_time() - began, model.nominal_stress(states())
    squares = ((stress / exact - 1) ** 2).reshape(len(MODES), -1).mean(axis=1)
    terms = ", ".join(name.removeprefix("weight of ") for name in model.parameter_names_)
    off = 100 * np.sqrt([*squares, squares.mean()])
    within = 100 * np.mean(np.abs(stress - exact) < 2 * error)
    yield law, noise, terms, *off, within, model.lack_of_fit_, seconds


NOISE = "fields with noise of 0.0003 cm and forces, spacing 0.1, "
CASES = [
    (f"{NOISE}not corrected", "fields", 3e-4, 0.1, 1),
    (f"{NOISE}corrected by 0.025", "fields", 3e-4, 0.1, 4),
    (f"{NOISE}corrected by 0.025".replace("0.0003", "0.003"), "fields", 3e-3, 0.1, 4),
    ("forces alone, corrected by 0.025", "forces", 3e-3, 0.1, 4),
]
LAWS = [(law, noise) for law in ("GT", "CA") for noise in (3e-4, 3e-3)]

if __name__ == "__main__":
    report(
        __doc__,
        of_rows("calibration", calibrated, CASES),
        of_rows("energies", without_a_law, LAWS),
    )
