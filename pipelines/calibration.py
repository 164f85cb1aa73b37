"""Calibration of a law by fields and forces of a sheet with two holes from finite elements.

python pipelines/calibration.py [calibration] [energies]   print the tables, of a law and of
energies without one python pipelines/calibration.py --docs                     and put them into
docs/validation/calibration.md

The data in pipelines/data/two_holes.npz are solutions by FElupe 11 (9-node quadrilaterals, plane
stress; 22,975 nodes, which differ from 9,239 nodes by 2e-5 cm rms and 1e-4 of the force): sheet 2 x
3 cm, circular holes of radius 0.4 at (0.7, 1.9) and 0.25 at (1.4, 1.0), bottom held, top moved by d
= 0.3 to 1.5 cm, displacements at 987 places. "gent" is incompressible with the shear modulus 0.4
kPa and the chain limit 30. "GT" and "CA" are the slightly compressible laws (K = 100 mu) of Gent
and Thomas, 0.5 (I1bar - 3) + log(I2bar/3) kPa, and of Carroll, 0.15 (I1bar - 3) + 3.1e-4 (I1bar^4 -
81) + 0.095 (sqrt I2bar - sqrt 3) kPa, with "_stresses": nominal stresses of homogeneous sheets of
these laws in the states of `states`. The noise is drawn here.
"""

import logging
import time
from pathlib import Path

import numpy as np
from pages import FIGURES, markdown_table, report

import pdsurrogate as pds
from pdsurrogate.calibration.reporting import figures
from pdsurrogate.identification import MODES, nominal_stress
from pdsurrogate.results.figures import save

DATA = np.load(Path(__file__).with_name("data") / "two_holes.npz")
TRUTH = pds.materials.Gent(0.4, 4000.0, 30.0)
FORCE_NOISE = 0.005
"""Standard deviation of the forces, relative to each."""


def scene(spacing: float) -> pds.Scene:
    holes = [
        {"shape": "circle", "center": [0.7, 1.9], "radius": 0.4},
        {"shape": "circle", "center": [1.4, 1.0], "radius": 0.25},
    ]
    sheet = {
        "name": "two-holes",
        "spacing": spacing,
        "body": {"size": [2.0, 3.0]},
        "holes": holes,
        "material": "gent",
    }
    grips = [{"edge": "bottom"}, {"edge": "top", "travel": 1.0}]
    return pds.Scene.model_validate(
        {**sheet, "grips": grips, "stretches": [1.1, 1.2, 1.3, 1.4, 1.5]}
    )


def measurements(law: str, noise: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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


def states() -> np.ndarray:
    """Uniaxial, equibiaxial and pure shear up to a stretch of 2."""
    stretches = np.linspace(1.1, 2.0, 10)
    return np.vstack(
        [np.stack([stretches, lateral(stretches)], axis=1) for lateral in MODES.values()]
    )


def row(what: str, model: pds.SceneRegressor) -> list[str]:
    stress, error = model.nominal_stress(states())
    exact = nominal_stress(TRUTH, states())
    off, within = stress / exact - 1, np.mean(np.abs(stress - exact) < 2 * error)
    cells = [
        f"{value:.4g} ± {sd:.2g}"
        for value, sd in zip(model.parameters_, model.standard_errors_, strict=True)
    ]
    return [
        what,
        *cells,
        f"{100 * np.sqrt((off**2).mean()):.2f}",
        f"{100 * within:.0f}",
        f"{model.lack_of_fit_:.2f}",
    ]


def table() -> str:
    """Laws from fields and forces; the residuals are drawn."""
    rows, drawn = [["true values", "0.4", "30", "", "", ""]], None
    for noise in (3e-4, 3e-3):
        X, y, deviation = measurements("gent", noise, seed=1)
        for spacing, refine in ((0.1, 1), (0.1, 4)) if noise < 1e-3 else ((0.1, 4),):
            model = pds.SceneRegressor(scene(spacing), "gent", refine=refine, bulk_ratio=1e4).fit(
                X, y, standard_deviation=deviation
            )
            how = (
                f"spacing {spacing:g}, corrected by {spacing / refine:g}"
                if refine > 1
                else f"spacing {spacing:g}, not corrected"
            )
            rows.append(row(f"fields with noise of {noise:g} cm and forces, {how}", model))
        drawn = drawn or figures(model, X, y, ["force"])["residuals"]
    forces = X[:, 1] == 0
    model = pds.SceneRegressor(scene(0.1), "gent", refine=4, bulk_ratio=1e4).fit(
        X[forces], y[forces], standard_deviation=deviation[forces]
    )
    rows.append(row("forces alone, corrected by 0.025", model))
    heads = [
        "measurements",
        "μ (kPa)",
        "chain limit",
        "stresses off, rms (%)",
        "within two standard errors (%)",
        "lack of fit",
    ]
    save(drawn, FIGURES / "guide" / "calibration.png")
    return markdown_table(heads, rows)


def _terms(model: pds.SceneRegressor) -> str:
    """Return the names of the terms of an energy."""
    return ", ".join(name.removeprefix("weight of ") for name in model.parameter_names_)


def energies() -> str:
    """Energies without a law: errors of stresses in unseen tests by mode."""
    rows = []
    for law in ("GT", "CA"):
        exact = DATA[f"{law}_stresses"]
        for noise in (3e-4, 3e-3):
            X, y, deviation = measurements(law, noise, seed=1)
            began = time.process_time()
            model = pds.SceneRegressor(scene(0.1), None, bulk_ratio=100).fit(
                X, y, standard_deviation=deviation
            )
            seconds, (stress, error) = time.process_time() - began, model.nominal_stress(states())
            squares = ((stress / exact - 1) ** 2).reshape(len(MODES), -1).mean(axis=1)
            off = [f"{100 * np.sqrt(value):.2f}" for value in (*squares, squares.mean())]
            within = f"{100 * np.mean(np.abs(stress - exact) < 2 * error):.0f}"
            rows.append(
                [
                    law,
                    f"{noise:g}",
                    _terms(model),
                    *off,
                    within,
                    f"{model.lack_of_fit_:.2f}",
                    f"{seconds:.0f}",
                ]
            )
    modes = [f"{mode}, rms (%)" for mode in MODES]
    return markdown_table(
        [
            "law",
            "noise (cm)",
            "terms",
            *modes,
            "all, rms (%)",
            "within two standard errors (%)",
            "lack of fit",
            "processor s",
        ],
        rows,
    )


if __name__ == "__main__":
    logging.basicConfig(format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    logging.getLogger(pds.SceneRegressor.__module__).setLevel(logging.INFO)
    report(__doc__, {"calibration": table, "energies": energies})
