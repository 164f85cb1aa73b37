"""What an energy buys: figures of the energy surrogate beside those of the other force models.

python pipelines/energy_report.py                  all tables, some ten minutes python
pipelines/energy_report.py drift            one of: scenes, modes, drift, isochoric_drift, solvers,
tear
"""

from __future__ import annotations

import time

import numpy as np
from pages import markdown_table, report

import pdsurrogate as pds
from pdsurrogate.forces import ForceSettings
from pdsurrogate.materials import homogeneous
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.results import measures
from pdsurrogate.run.run import Run
from pdsurrogate.solvers.methods import SOLVERS
from pdsurrogate.solvers.stability import FrequencyEstimate

DOUBLE = ForceSettings(precision="float64")


def scenes() -> str:
    """Sections 6.2 to 6.4 of the paper: errors against the exact solution and finite elements."""
    rows = []
    for scene in ("uniaxial", "pure-shear", "hole"):
        for force in ("neo-hookean-energy", "neo-hookean"):
            result = pds.simulate(pds.load_scene(scene), force)
            for level in result.levels:
                errors = {
                    key.removesuffix("_error"): f"{100 * value:+.4f}"
                    for key, value in level.items()
                    if key.endswith("_error")
                }
                displacement = errors.get("greatest_lateral_displacement", "")
                rows.append(
                    [
                        scene,
                        force,
                        f"{level['stretch']:g}",
                        errors["nominal_stress"],
                        displacement,
                        str(level["evaluations"]),
                    ]
                )
    return markdown_table(
        [
            "scene",
            "force",
            "stretch",
            "stress error (%)",
            "largest displacement error (%)",
            "evaluations",
        ],
        rows,
    )


STATES = {
    "undeformed": np.eye(2),
    "uniaxial 2": np.diag(
        [2.0, homogeneous.uniaxial(pds.materials.NeoHookean(), 2.0).lateral_stretch]
    ),
    "uniaxial 3": np.diag(
        [3.0, homogeneous.uniaxial(pds.materials.NeoHookean(), 3.0).lateral_stretch]
    ),
    "shear 0.8": np.array([[1.0, 0.8], [0.0, 1.0]]),
    "equibiaxial 2": np.diag([2.0, 2.0]),
}


def modes() -> str:
    """Least eigenvalue over the greatest on 12 x 12 points, translations and the rotation of the
    deformed body left out.
    """
    body, law = pds.Body.rectangle(1.2, 1.2, 0.1, 0.315), pds.materials.NeoHookean()
    rows = []
    for force in ("bond-energy", "neo-hookean-energy", "nosb"):
        row = [force]
        for F in STATES.values():
            y = body.points @ F.T
            bound = pds.load_surrogate(force).bind(body, law, DOUBLE)
            A = bound.tangent(y) @ np.eye(y.size)
            n = len(y)
            rigid = np.zeros((2 * n, 3))
            rigid[0::2, 0] = rigid[1::2, 1] = 1
            rigid[:, 2] = np.stack([-y[:, 1], y[:, 0]], axis=1).ravel()
            complement = np.linalg.svd(rigid)[0][:, 3:]
            values = np.linalg.eigvalsh(complement.T @ (A + A.T) / 2 @ complement)
            row.append(f"{values[0] / values[-1]:.1e}")
        rows.append(row)
    return markdown_table(["force model", *STATES], rows)


ENERGY = "neo-hookean-energy"

STEPS = 20_000


def drift() -> str:
    """Undamped velocity Verlet of a free sheet let go from a stretch of 1.2, in steps of a
    twentieth of the critical one.

    The energy is kinetic plus that of the force; for forces that have none, plus that of the
    points' deformation gradients, which for NOSB is the energy of which its force is the gradient.
    Drift is the change of its mean over 500 steps from the first such span to the last, over the
    stored energy at the start; the greatest departure of any step from the start is beside it.
    """
    cases = [
        ("bond-energy", "float64"),
        ("neo-hookean-energy", "float64"),
        ("neo-hookean-energy", "float32"),
        ("neo-hookean", "float64"),
        ("nosb", "float64"),
        ("ba-nosb", "float64"),
    ]
    return _drifts(
        [(name, precision, pds.materials.NeoHookean(), "stress") for name, precision in cases]
    )


def isochoric_drift() -> str:
    """The same of the learned isochoric energies, in plane strain."""
    laws = (
        pds.materials.NeoHookean(),
        pds.materials.ArrudaBoyce(),
        pds.materials.Ogden(),
        pds.materials.FullNetwork(),
    )
    return _drifts([(f"{law.name}-isochoric", "float64", law, "strain") for law in laws])


def _drifts(cases: list[tuple]) -> str:
    """Of force models by name, each with its precision, law and plane."""
    body, rows = pds.Body.rectangle(2.0, 1.0, 0.1, 0.315), []
    for name, precision, law, plane in cases:
        force = pds.load_surrogate(name).bind(
            body, law, ForceSettings(precision=precision, plane=plane)
        )
        # In plane strain without a change of volume, which would be thrown back as hard as the bulk
        # modulus is.
        start = body.points @ np.diag([1.2, 1.0 if plane == "stress" else 1 / 1.2])
        mass, y, f = body.volumes[:, None], start.copy(), np.empty_like(start)
        step = 0.05 * 2 / np.sqrt(FrequencyEstimate(body.volumes, np.ones_like(y))(force, y))

        force(y, f)
        v, first = np.zeros_like(y), measures.strain_energy(force)
        totals, failure = [], ""
        try:
            for _ in range(STEPS):
                v += 0.5 * step * f / mass
                y += step * v
                force(y, f)
                v += 0.5 * step * f / mass
                totals.append(0.5 * float((mass * v * v).sum()) + measures.strain_energy(force))
        except RuntimeError:
            failure = f"stops after {len(totals)} steps"
        totals = np.array(totals) / first - 1
        change = failure or f"{totals[-500:].mean() - totals[:500].mean():+.1e}"
        rows.append([name, precision, change, f"{np.abs(totals).max():.1e}"])
        print(rows[-1], flush=True)
    return markdown_table(
        [
            "force model",
            "precision",
            f"drift of the energy in {STEPS:,} steps",
            "largest difference",
        ],
        rows,
    )


def solvers() -> str:
    """Evaluations and wall time to a residual of 1e-6, from a homogeneous guess; the methods of
    one case in turn, medians of three.
    """
    rows = []
    for scene, stretch, repeats in (("uniaxial", 1.5, 3), ("tear", 1.1, 1)):
        for method, precision in (
            ("quasi-newton", None),
            ("minimizer", "float64"),
            ("relaxation", None),
        ):
            seconds = []
            for _ in range(repeats):
                chosen = (
                    pds.load_scene(scene, precision=precision)
                    if precision
                    else pds.load_scene(scene)
                )
                run = Run(chosen, checked_models(chosen, pds.load_surrogate(ENERGY)))
                run.warm_up()
                (y,) = run.loading.course.guesses(run.positions, 1.0, stretch, None)
                run.loading.apply(stretch, run.force, y)
                solver = SOLVERS[method](run.loading.free, run.body.volumes)
                began = time.perf_counter()
                found = solver.solve(run.force, y)
                seconds.append(time.perf_counter() - began)
            points = f"{len(run.body):,}"
            rows.append(
                [
                    scene,
                    points,
                    method,
                    run.force.precision,
                    str(found.evaluations),
                    f"{np.median(seconds):.2f}",
                ]
            )
            print(rows[-1], flush=True)
    return markdown_table(
        ["scene", "points", "method", "precision", "evaluations", "seconds"], rows
    )


def tear() -> str:
    """Work of the grips against stored, kinetic, damped and released energy while the sheet
    tears.
    """
    rows = []
    for spacing in (0.1, 0.05):
        # Farther than the scene's own 1.6, at which the coarser sheet has not yet come apart.
        result = pds.simulate(
            pds.load_scene("tear", {"spacing": spacing, "dynamics.stretch": 1.7}), ENERGY
        )
        history = [row for row in result.history if "work" in row]
        begin, end = history[0], history[-1]
        gained = sum(
            end[key] - begin[key]
            for key in ("strain_energy", "kinetic_energy", "damped_energy", "released_energy")
        )
        spent = begin["strain_energy"] + end["work"]
        parts = [
            f"{end[key]:.4g}"
            for key in (
                "work",
                "strain_energy",
                "kinetic_energy",
                "damped_energy",
                "released_energy",
            )
        ]
        rows.append(
            [
                f"{spacing:g}",
                f"{begin['strain_energy']:.4g}",
                *parts,
                f"{100 * (end['work'] - gained) / spent:+.2f}",
            ]
        )
    return markdown_table(
        [
            "spacing",
            "stored at first",
            "work",
            "stored",
            "kinetic",
            "damped",
            "released",
            "energy error (%)",
        ],
        rows,
    )


if __name__ == "__main__":
    report(
        __doc__,
        {
            function.__name__: function
            for function in (scenes, modes, drift, isochoric_drift, solvers, tear)
        },
    )
