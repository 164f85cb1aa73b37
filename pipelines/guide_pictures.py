"""Pictures of the guides that no built-in scene or tutorial draws: laws in tension, errors of
regressors, and the division among ranks.

python pipelines/guide_pictures.py    writes docs/figures/guide/*.png, in a minute
"""

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from pages import FIGURES
from sklearn.ensemble import RandomForestRegressor
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures

import pdsurrogate as pds
from pdsurrogate.discretization import discretize
from pdsurrogate.materials import LAWS, homogeneous
from pdsurrogate.ranks import bisected, bond_counts
from pdsurrogate.results import figures

FOLDER = FIGURES / "guide"


def laws():
    """Nominal stress of every law in uniaxial tension, with default parameters."""
    stretches = np.linspace(1, 6, 51)
    figure = Figure(figsize=(4.8, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.set_prop_cycle(color=matplotlib.colormaps["tab10"].colors)  # the style has six colors only
    for name, kind in LAWS.items():
        law = kind()
        stresses = [
            homogeneous.uniaxial(law, stretch).nominal_stress / law.shear_modulus
            for stretch in stretches
        ]
        # With its default parameters this law is Neo-Hookean.
        axes.plot(stretches, stresses, "--" if name == "polyconvex" else "-", label=name)
    axes.set(xlabel="stretch", ylabel="nominal stress / shear modulus")
    axes.legend(fontsize=8)
    return figure


def regressors():
    """Error of the bond force by strain for three regressors that learned the same samples of
    Ogden's law.
    """
    law = pds.materials.Ogden()
    samples = pds.training_samples(law, 2000, (0.6, 2.5), random_state=0)
    brought = {
        "RandomForestRegressor(50)": RandomForestRegressor(50, random_state=0),
        "PolynomialFeatures(6), Ridge(1e-4)": make_pipeline(PolynomialFeatures(6), Ridge(1e-4)),
        "ChebyshevRegressor(8)": pds.learning.ChebyshevRegressor(8),
    }
    figure = Figure(figsize=(4.8, 3.2), layout="constrained")
    axes = figure.subplots()
    for name, regressor in brought.items():
        model = pds.surrogate_pipeline(regressor, features="isochoric").fit(samples.X, samples.y)
        bins = pds.evaluate(model, law, (0.6, 2.5), 4000)["by_strain"]
        axes.loglog(
            [np.sqrt(np.prod(row["strain"])) for row in bins],
            [row["rms"] for row in bins],
            "o-",
            label=name,
        )
    axes.set(xlabel="greatest principal strain", ylabel="RMS error of the force / RMS force")
    axes.legend()
    return figure


def ranks(size=4):
    """Points of the scene `hole` in the color of the rank that computes them."""
    body = discretize(pds.load_scene("hole", spacing=0.08))[0]
    weights = bond_counts(body.points, body.horizon, slice(0, len(body)))
    owners = bisected(body.points, weights, size)
    figure = Figure(figsize=(3.6, 3.8), layout="constrained")
    axes = figure.subplots()
    for rank in range(size):
        axes.plot(*body.points[owners == rank].T, "s", markersize=2.8, label=f"rank {rank}")
    axes.set(aspect="equal", xlabel="x₁ (cm)", ylabel="x₂ (cm)")
    figure.legend(loc="outside lower center", ncols=size, markerscale=2)
    return figure


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    with matplotlib.rc_context(figures.STYLE):
        for draw in (laws, regressors, ranks):
            figures.save(draw(), FOLDER / f"{draw.__name__}.png")
            print(FOLDER / f"{draw.__name__}.png")
