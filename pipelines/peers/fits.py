"""Tests foretold from others: Treloar's and Kawabata's rubber, and VHB 4910 at a rate left out.

Errors are RMS of the stresses that are foretold, in percent of their greatest.
"""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MODES = {"uniaxial": -0.5, "pure-shear": 0.0, "equibiaxial": 1.0}
"""Powers of the stretch that are the stretch across, of incompressible rubber."""


def foretold(fit, only=None):
    """Errors of a fit, which takes rows by mode and gives the stress along l1 of (l1, l2)."""
    import csv

    import numpy as np

    def rows(name):
        with (ROOT / f"pdsurrogate/identification/{name}.csv").open(encoding="utf-8") as file:
            return list(csv.DictReader(line for line in file if line[0] != "#"))

    def off(known, asked):
        known = {mode: np.array(known[mode]) for mode in only or known if mode in known}
        x, y, stress = np.array(asked).T
        if not known:
            return float("nan")
        return 100 * float(np.sqrt(np.mean((fit(known)(x, y) - stress) ** 2)) / stress.max())

    treloar, found = {}, {}
    for row in rows("treloar"):
        x = float(row["stretch"])
        one = [x, x ** MODES[row["mode"]], float(row["nominal_stress"])]
        treloar.setdefault(row["mode"], []).append(one)
    for left in MODES:
        known = {mode: one for mode, one in treloar.items() if mode != left}
        found[f"{left} (%)"] = off(known, treloar[left])
    known, asked = {"uniaxial": [], "pure-shear": []}, []
    for row in rows("kawabata"):
        x, y, along, across = map(float, row.values())
        mode = "pure-shear" if y == 1 else "uniaxial" if abs(y * x**0.5 - 1) < 0.02 else None
        if mode:
            known[mode] += [[x, y, along]]
        else:
            asked += [[x, y, along], [y, x, across]]
    found["Kawabata's grid (%)"] = off(known, asked)
    return {name: error if error == error else "-" for name, error in found.items()}


def ours(law=None):
    """An energy without a law, or a law."""
    import numpy as np

    import pdsurrogate as pds

    def fit(known):
        rows = np.concatenate(list(known.values()))
        model = (
            pds.identification.LawRegressor(law) if law else pds.identification.EnergyRegressor()
        )
        weights = np.concatenate([np.full(len(one), 1 / len(one)) for one in known.values()])
        model.fit(rows[:, :2], rows[:, 2], weights * len(rows) / weights.sum())
        return lambda x, y: model.predict(np.stack([x, y], axis=1))

    return foretold(fit)


def ogden(terms=3, starts=8):
    """Ogden's law by least squares of SciPy from random starts, modes weighted alike."""
    import numpy as np
    from scipy.optimize import least_squares

    def stress(p, x, y):
        mu, a = p[:terms, None], p[terms:, None]
        return (mu * (x**a - (x * y) ** -a)).sum(axis=0) / x

    def fit(known):
        rows = np.concatenate(list(known.values()))
        weights = np.concatenate([np.full(len(one), len(one) ** -0.5) for one in known.values()])
        random = np.random.default_rng(0)
        limits = [-np.inf] * terms + [-8] * terms, [np.inf] * terms + [10] * terms
        fits = [
            least_squares(
                lambda p: weights * (stress(p, *rows.T[:2]) - rows[:, 2]),
                np.r_[random.normal(size=terms) * 0.1, random.uniform(-4, 6, terms)],
                bounds=limits,
                max_nfev=500,
            )
            for _ in range(starts)
        ]
        best = min(fits, key=lambda one: one.cost).x
        return lambda x, y: stress(best, x, y)

    return foretold(fit)


def felupe(law, **start):
    """A law of FElupe by its `optimize`."""
    import felupe
    import numpy as np

    def fit(known):
        short = {"uniaxial": "ux", "pure-shear": "ps", "equibiaxial": "bx"}
        data = {short[mode]: rows[:, [0, 2]].T for mode, rows in known.items()}
        material = felupe.Hyperelastic(getattr(felupe, law), **start)
        material, _ = material.optimize(incompressible=True, **data)

        def stress(x, y):
            gradient = np.zeros((3, 3, len(x), 1))
            gradient[range(3), range(3), :, 0] = x, y, 1 / (x * y)
            first = material.gradient([gradient, None])[0]
            return first[0, 0, :, 0] - first[2, 2, :, 0] / (x * x * y)

        return stress

    return foretold(fit)


def hyper_surrogate(law):
    """A law of hyper-surrogate by its `fit_material`, to uniaxial tension: it takes one test."""
    from hyper_surrogate.data.experimental import ExperimentalData
    from hyper_surrogate.data.fitting import fit_material
    from hyper_surrogate.mechanics import materials
    from sympy import Symbol, lambdify

    def fit(known):
        x, _, stress = known["uniaxial"].T
        data = ExperimentalData.from_uniaxial(x, stress * x)
        kind = getattr(materials, law)
        found, _ = fit_material(kind, data)
        one, two, volume = map(Symbol, ("I1", "I2", "J"))
        numbers = zip(found._symbols.values(), found._params.values(), strict=True)
        energy = found.sef_from_invariants(one, two, volume).subs([*numbers, (volume, 1)])
        slopes = [lambdify((one, two), energy.diff(which)) for which in (one, two)]

        def along(x, y):
            z = (x * y) ** -2
            of = x * x + y * y + z, x * x * y * y + z * (x * x + y * y)
            first, second = (slope(*of) for slope in slopes)
            return 2 / x * (x * x - z) * (first + y * y * second)

        return along

    return foretold(fit, ["uniaxial"])


RATES = "0.03", "0.05", "0.01"


def vhb():
    """Curves of VHB 4910 by name: time, stretch and stress, and which are foretold for a rate."""
    import csv

    import numpy as np

    curves = {}
    path = ROOT / "pipelines/data/experiment-hossain-2012-cycles.csv"
    with path.open(encoding="utf-8") as file:
        for name, *row in csv.reader(line for line in file if line[0] != "#"):
            curves.setdefault(name, []).append(row)
    del curves["specimen"]
    return {name: np.array(rows, float).T for name, rows in curves.items()}


def prony(terms=2, branches=2):
    """Ogden's law with a Prony series (quasi-linear viscoelasticity) by SciPy."""
    import numpy as np
    from scipy.optimize import least_squares

    def stress(p, time, x):
        mu, a, share, log = np.split(p, [terms, 2 * terms, 2 * terms + branches])
        at = np.array([x, x**-0.5])
        kirchhoff = sum(m * at**k for m, k in zip(mu, a, strict=True))
        mean = (kirchhoff[0] + 2 * kirchhoff[1]) / 3
        second = (kirchhoff - mean) / at**2
        total = (1 - share.sum()) * second
        for g, tau in zip(share, 10**log, strict=True):
            step = np.diff(time) / tau
            fade, gain = np.exp(-step), -np.expm1(-step) / np.maximum(step, 1e-12)
            part, change = np.zeros_like(second), np.diff(second)
            for k in range(len(step)):
                part[:, k + 1] = fade[k] * part[:, k] + gain[k] * change[:, k]
            total = total + g * part
        return x * total[0] - total[1] / x**2

    curves = {name: (rows[:, ::5] if rows.shape[1] > 200 else rows) for name, rows in vhb().items()}
    found = {}
    for rate in RATES:
        out = [name for name in curves if "3.0" in name or f"at {rate}" in name]
        known = [rows for name, rows in curves.items() if name not in out]

        def off(p, known=known):
            return np.concatenate(
                [
                    (stress(p, *rows[:2]) - rows[2]) / rows[2].max() / rows.shape[1] ** 0.5
                    for rows in known
                ]
            )

        start = np.r_[20.0, 1.0, 1.5, -1.5, 0.3, 0.3, 0.7, 2.0]
        limits = (
            np.r_[[-500.0] * 2, [-6.0] * 2, [0.0] * 2, [-1.0] * 2],
            np.r_[[500.0] * 2, [6.0] * 2, [0.5] * 2, [4.0] * 2],
        )
        p = least_squares(off, start, bounds=limits, x_scale=np.maximum(abs(start), 0.1)).x
        rms = [
            np.sqrt(np.mean((stress(p, *rows[:2]) - rows[2]) ** 2)) / rows[2].max()
            for name, rows in curves.items()
            if name in out
        ]
        found[f"at {rate} (%)"] = 100 * float(np.mean(rms))
    return found


def ours_vhb():
    """Branches and an energy by `HistoryRegressor`, as on the page of histories."""
    import histories
    import numpy as np

    return {
        f"at {rate} (%)": float(
            np.mean(
                list(
                    histories.errors(*histories.cycles("VHB 4910"), f"at {rate}", "3.0")[2].values()
                )
            )
        )
        for rate in RATES
    }
