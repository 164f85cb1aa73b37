"""Make the artifacts that pdsurrogate ships, from nothing: sample, search, cross-validate, fit,
store.

python pipelines/fit_shipped.py --out DIR    writes them to DIR
python pipelines/fit_shipped.py --check      compares their forces with those of what is shipped

The search and the cross-validation are printed, and kept on the cards. Training magnifies the last
bit of a sum into other weights, as good but not the same, so that the bytes of a payload depend on
the processor and the libraries: the check fails where forces or stresses over the domain differ by
more than the cards state.
"""

import argparse
import json
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

# With these, processors with AVX2 use the same code: OpenBLAS would choose by processor and NumPy
# take AVX-512.  Read as both load.
os.environ |= {
    "OPENBLAS_CORETYPE": "Haswell",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
}

import numpy as np
from rich.console import Console
from sklearn.base import clone
from sklearn.model_selection import ParameterGrid

import pdsurrogate as pds
from pdsurrogate.artifacts.store import law_of
from pdsurrogate.learning.sampling import random_order

SHIPPED = Path(__file__).resolve().parents[1] / "artifacts"
FIRST = "1"
"""Version of an artifact that was not improved since."""

console = Console()

ROUNDS = 200
"""Iterations of a network in the search."""


def as_drawn(samples):
    """Return samples in the order in which they were drawn, as the shipped artifacts were fitted
    to them; Algorithm 1 keeps that order.
    """
    if samples.design["name"] == "algorithm 1":
        return samples
    return samples.take(
        np.argsort(
            random_order(len(samples), samples.design["near_rest"], samples.design["random_state"])
        )
    )


def search(model, samples, grid):
    """Relative errors on the folds left out over a small grid of the regressor's parameters;
    networks run for fewer rounds than in the end.
    """
    names, rows = {name.rpartition("__")[2]: name for name in model.get_params()}, []
    rounds = {"max_iter": ROUNDS} if "max_iter" in names else {}
    for entry in ParameterGrid(grid):
        settings = {names[key]: value for key, value in (entry | rounds).items()}
        tried = clone(model).set_params(**settings)
        errors = [row["rms"] for row in pds.cross_validate(tried, samples, 3, n_jobs=2)]
        spread = max(errors) - min(errors)
        rows.append({**entry, "rms": sum(errors) / len(errors), "spread": spread})
    return rows


def make(name, law, description, samples, model, grid, folder, version=FIRST, folds=5):
    """One artifact."""
    console.rule(f"{name}@{version}")
    samples = as_drawn(samples)
    searched = search(model, samples, grid)
    table = pds.cross_validate(model, samples, folds, n_jobs=2)
    console.print(f"Search, networks {ROUNDS} iterations", *searched, sep="\n")
    console.print("Cross-validation of the final settings", *table, sep="\n")
    model.fit(samples.X, samples.y)
    text = pds.CardText(description, table, searched)
    path = pds.store(model, samples, law, folder, name, version, text)
    console.print(path, pds.load_card(path).errors["box"]["on_surface"], soft_wrap=True)


def make_all(folder):
    """All artifacts."""
    law = pds.materials.NeoHookean()
    make(
        "neo-hookean",
        law,
        "Bond force of slightly compressible Neo-Hookean rubber: symmetric features, wide design;"
        " the default force.",
        pds.training_samples(law, 8000, random_state=0),
        pds.surrogate_pipeline(
            pds.LevenbergMarquardtRegressor(
                (20,), "algebraic", max_iter=2000, n_iter_no_change=200, random_state=0
            )
        ),
        {
            "hidden_layer_sizes": [(8,), (12,), (20,)],
            "activation": ["algebraic", "logistic", "tanh"],
        },
        folder,
    )
    make(
        "neo-hookean",
        law,
        "Bond force of slightly compressible Neo-Hookean rubber: isochoric features, 4 units; the"
        " default force since version 2.",
        pds.training_samples(law, 8000, random_state=0),
        # The outputs of this law are constant in these features (theory (16)): any network has them
        # to rounding, and the smallest will do.
        pds.surrogate_pipeline(
            pds.LevenbergMarquardtRegressor(
                (4,), "algebraic", max_iter=2000, n_iter_no_change=200, random_state=0
            ),
            features="isochoric",
        ),
        {"hidden_layer_sizes": [(4,), (8,)], "activation": ["algebraic", "logistic", "tanh"]},
        folder,
        version="2",
    )
    make(
        "neo-hookean-paper",
        law,
        "The paper's own network: its five features, Algorithm 1 on its box of stretches, 20"
        " logistic units.",
        pds.learning.algorithm_1(law, random_state=0),
        pds.surrogate_pipeline(
            pds.LevenbergMarquardtRegressor(
                (20,), "logistic", max_iter=1000, n_iter_no_change=100, random_state=0
            ),
            features="paper",
        ),
        {"hidden_layer_sizes": [(10,), (20,)], "activation": ["logistic", "tanh"]},
        folder,
    )
    make(
        "neo-hookean-energy",
        law,
        "Plane-stress energy of slightly compressible Neo-Hookean rubber, K = 100 mu: 12 units on"
        " two logarithmic invariants.",
        pds.training_samples(law, 2000, random_state=0, target="sheet-energy"),
        pds.surrogate_pipeline(
            pds.learning.SobolevRegressor(12, "algebraic", max_iter=1000, random_state=0),
            "sheet-energy",
        ),
        {"activation": ["algebraic", "logistic", "tanh"], "n_units": [4, 8, 12]},
        folder,
    )
    for law, title in (
        (pds.materials.NeoHookean(), "Neo-Hookean rubber"),
        (pds.materials.Ogden(), "Ogden rubber, three terms of 1972 for Treloar's data"),
        (pds.materials.ArrudaBoyce(), "Arruda-Boyce rubber with chains of 26.5 links"),
        (pds.materials.FullNetwork(), "full-network rubber with chains of 60 links"),
    ):
        make(
            f"{law.name}-isochoric",
            law,
            f"Isochoric energy of {title}, for plane strain, space and every bulk modulus: 8 units"
            " on two logarithmic invariants.",
            pds.training_samples(law, 1000, random_state=0, target="isochoric-energy"),
            # Of two trainings the better: one in a few ends where the stress is a thousandth off.
            pds.surrogate_pipeline(
                pds.learning.SobolevRegressor(
                    8, "algebraic", max_iter=500, n_init=2, random_state=0
                ),
                "isochoric-energy",
            ),
            {"n_units": [4, 8]},
            folder,
            folds=3,
        )
    for law, title in (
        (pds.materials.Gent(), "Gent rubber with the paper's chain limit of 120"),
        (pds.materials.Ogden(), "Ogden rubber, three terms of 1972 for Treloar's data"),
        (pds.materials.FullNetwork(), "full-network rubber with chains of 60 links"),
    ):
        make(
            law.name,
            law,
            f"Bond force of {title}: a polynomial in the two isochoric features.",
            pds.training_samples(law, 8000, random_state=0),
            pds.surrogate_pipeline(pds.learning.ChebyshevRegressor((9, 4)), features="isochoric"),
            {"degree": [8, (8, 4), (9, 3), (9, 4), 10, (10, 4), (12, 6)]},
            folder,
        )


TARGETS = {"energy-network": "sheet-energy", "isochoric-network": "isochoric-energy"}
"""Targets of the kinds of artifacts that are not bond forces."""

DECIDING = (
    "name",
    "version",
    "kind",
    "description",
    "material",
    "weight_function",
    "features",
    "domain",
)
"""Entries of cards that do not follow from the training and must be equal, numbers to nine
digits.
"""

APART = 2.0
"""Greatest difference of two fits in units of the error that the shipped card states: each may
be so far from the exact force.
"""

ROUNDING = 100 * np.finfo(float).eps
"""Difference that is no more than rounding, for laws whose outputs a network has exactly."""


def faults(made, shipped):
    """Return what decides against the artifacts of one folder: entries of cards, and forces that
    are too far from the shipped ones.
    """
    found = []
    for path in sorted(
        {
            path.relative_to(folder).parent
            for folder in (made, shipped)
            for path in folder.rglob("card.json")
        }
    ):
        if not all((folder / path / "card.json").is_file() for folder in (made, shipped)):
            found.append(f"{path} is in one folder alone")
            continue
        cards = [
            json.loads(
                (folder / path / "card.json").read_text(),
                parse_float=lambda digits: f"{float(digits):.9g}",
            )
            for folder in (made, shipped)
        ]
        unlike = [key for key in DECIDING if cards[0][key] != cards[1][key]]
        found += [f"{path}: {', '.join(unlike)} of the card"] if unlike else []
        for quantity, (difference, stated) in deviations(made / path, shipped / path).items():
            console.print(
                f"{path}: {quantity} differs by {difference:.1e}, stated error {stated:.1e}"
            )
            if not difference <= max(APART * stated, ROUNDING):
                found.append(
                    f"{path}: {quantity} differs by {difference:.1e}, more than {APART:g} times the"
                    f" stated error of {stated:.1e}"
                )
    return found


def deviations(made, shipped):
    """Return, by quantity, the relative RMS difference of two artifacts over the domain, and the
    error that the shipped card states.
    """
    card, (one, other) = (
        pds.load_card(shipped),
        (pds.load_surrogate(folder) for folder in (made, shipped)),
    )
    law, stated, target = law_of(card), card.errors["box"], TARGETS.get(card.kind, "bond-force")
    drawn = {"random_state": stated["random_state"], "target": target, "near_rest": 0.0}
    samples = pds.training_samples(
        law, stated["n_samples"], tuple(stated["stretch_range"]), **drawn
    )
    first, second = (samples.target.predicted(model, law, samples.X) for model in (one, other))
    found = samples.target.errors(first, replace(samples, y=second))
    return {key: (found[key], stated["on_surface"][key]) for key in found.keys() - {"max"}}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    group = parser.add_mutually_exclusive_group(required=True)
    group.add_argument("--out", type=Path, metavar="DIR", help="folder to write the artifacts to")
    group.add_argument(
        "--check", action="store_true", help="compare with the shipped artifacts instead"
    )
    arguments = parser.parse_args()
    if arguments.out is not None:
        make_all(arguments.out)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        make_all(Path(folder))
        wrong = faults(Path(folder), SHIPPED)
    console.print(
        "\n".join(wrong)
        or "The shipped artifacts are what this pipeline makes, within their stated errors.",
        soft_wrap=True,
    )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
