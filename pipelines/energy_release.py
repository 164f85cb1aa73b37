"""Energy release rates of cracks against theory: strip in pure shear, central crack, edge notch and
trouser tear.

python pipelines/energy_release.py                       all parts python
pipelines/energy_release.py rate-strip rate-plate  some of them python pipelines/energy_release.py
--docs                and put their tables into docs/validation/energy-release.md

On one core of 2 GHz all parts take some 10 minutes, half of them the trouser tear.
"""

import numpy as np
from pages import markdown_table, report

import pdsurrogate as pds
from pdsurrogate.materials import homogeneous

GRIPS = [{"edge": "bottom"}, {"edge": "top", "travel": 1.0}]
SLIDING = [{"edge": "bottom", "holds": "normal"}, {"edge": "top", "holds": "normal", "travel": 1.0}]


def sheet(
    size: tuple[float, float], spacing: float, tip: float, plane: str, bulk_modulus: float, **more
) -> pds.Scene:
    """A rectangle with a cut along its middle from the left to a tip; the shear modulus is 1."""
    middle, law = (
        size[1] / 2,
        {
            "law": "neo-hookean",
            "shear_modulus": 1.0,
            "bulk_modulus": bulk_modulus,
        },
    )
    body, cut = (
        {"shape": "rectangle", "size": size},
        {
            "start": [-1.0, middle],
            "end": [tip, middle],
        },
    )
    return pds.Scene.model_validate(
        {
            "name": "sheet",
            "spacing": spacing,
            "plane": plane,
            "body": body,
            "precuts": [cut],
            "material": law,
            **more,
        }
    )


def rate(level: dict) -> float:
    """G of the only crack at an output."""
    (crack,) = level["cracks"]
    return crack["energy_release_rate"]


def strip() -> str:
    """A long crack in a clamped strip releases W h."""
    rows = []
    for points in (20, 40, 80):
        scene = sheet(
            (9.0, 2.0), 2.0 / points, 4.5, "stress", 100.0, stretches=[1.3, 2.0], grips=GRIPS
        )
        levels, law = pds.simulate(scene, "bond-energy").levels, scene.material.build()
        exact = [
            2.0 * homogeneous.pure_shear(law, level["stretch"]).energy_density for level in levels
        ]
        rows.append(
            [
                f"{points}",
                *(
                    f"{100 * (rate(level) / g - 1):+.2f}"
                    for level, g in zip(levels, exact, strict=True)
                ),
            ]
        )
    return markdown_table(["points across the strip", "stretch 1.3 (%)", "stretch 2 (%)"], rows)


def plate_row(plane: str, bulk: float, points: int) -> list[str]:
    """Half of a plate with a central crack at small strain."""
    held = [
        {"region": "left", "x1": 0.0},
        {"region": "bottom", "x2": -0.01},
        {"region": "top", "x2": 0.01},
    ]
    (level,) = pds.simulate(
        sheet((4.0, 8.0), 1 / points, 1.0, plane, bulk, prescribed=held, steps=[{"to": 1.0}]),
        "bond-energy",
    ).levels
    young, poisson = 9 * bulk / (3 * bulk + 1), (3 * bulk - 2) / (2 * (3 * bulk + 1))
    modulus = young if plane == "stress" else young / (1 - poisson**2)
    exact = (level["forces"]["top"][1] / 4) ** 2 * np.pi / modulus / np.cos(np.pi / 8)
    return [
        f"plane {plane}, K = {bulk:g} μ",
        f"{points}",
        f"{100 * (rate(level) / exact - 1):+.2f}",
    ]


def plate() -> str:
    """Central crack against linear fracture mechanics."""
    rows = [
        plate_row(plane, bulk, points)
        for plane, bulk in (("stress", 2.0), ("strain", 20.0))
        for points in (10, 20)
    ]
    return markdown_table(["plate", "points in half the crack", "error (%)"], rows)


def notch_rows(plane: str, bulk: float) -> list[list[str]]:
    """An edge notch of a fifth of the width, against differences of the energy."""
    spacing, stretches, levels = 0.02, [1.1, 1.3, 1.5, 2.0], []
    for step in (-1, 0, 1):
        # A cut that ends between the places where bonds cross it grows by whole spacings.
        scene = sheet(
            (2.0, 2.0),
            spacing,
            0.402 + step * spacing,
            plane,
            bulk,
            stretches=stretches,
            grips=SLIDING,
        )
        levels.append(pds.simulate(scene, "bond-energy").levels)
    rows = []
    for shorter, level, longer in zip(*levels, strict=True):
        difference = (shorter["energy"] - longer["energy"]) / (2 * spacing)
        rows.append(
            [
                f"plane {plane}",
                f"{level['stretch']:g}",
                f"{rate(level):.4f}",
                f"{100 * (rate(level) / difference - 1):+.2f}",
            ]
        )
    return rows


def notch() -> str:
    """Edge notches in both planes."""
    rows = [*notch_rows("stress", 100.0), *notch_rows("strain", 20.0)]
    return markdown_table(
        ["sheet", "stretch", "G (μ cm)", "error against differences of the energy (%)"], rows
    )


def formula() -> str:
    """A short edge notch in a long sheet, and the formula of Rivlin and Thomas."""
    scene = sheet(
        (4.0, 8.0), 0.04, 0.404, "stress", 100.0, stretches=[1.1, 1.3, 1.5, 2.0], grips=SLIDING
    )
    rows, law = [], scene.material.build()
    for level in pds.simulate(scene, "bond-energy").levels:
        stretch = level["stretch"]
        simple = (
            2
            * np.pi
            / np.sqrt(stretch)
            * homogeneous.uniaxial(law, stretch).energy_density
            * level["cracks"][0]["length"]
        )
        rows.append(
            [f"{stretch:g}", f"{rate(level):.4f}", f"{simple:.4f}", f"{rate(level) / simple:.3f}"]
        )
    return markdown_table(["stretch", "G (μ cm)", "2 k W a (μ cm)", "ratio"], rows)


def trousers() -> str:
    """The trouser tear at a critical stretch: G along the tear, and the formula of Rivlin and
    Thomas.
    """
    result = pds.simulate(pds.load_scene("trousers", {"fracture": {"critical_stretch": 2.3947}}))
    law, rows = result.scene.material.build(), []
    for begin, end in ((17.8, 21.1), (21.1, 24.5), (24.5, 28.1)):
        levels = [level for level in result.levels if begin < level["t"] < end]
        force = float(np.mean([level["forces"]["one"][2] for level in levels]))
        found = np.array([rate(level) for level in levels])
        lengths = [levels[place]["cracks"][0]["length"] for place in (0, -1)]
        travel = f"{levels[0]['t']:.1f} to {levels[-1]['t']:.1f}"
        simple = pds.tearing_energy(law, force, 8.0, 2.0)
        rows.append(
            [
                travel,
                f"{lengths[0]:.1f} to {lengths[1]:.1f}",
                f"{found.mean():.2f}",
                f"{found.std(ddof=1):.2f}",
                f"{simple:.2f}",
            ]
        )
    head = [
        "travel (mm)",
        "length of the tear and its cut (mm)",
        "mean G (N/mm)",
        "deviation of one output (N/mm)",
        "2 F λ/h - w (N/mm)",
    ]
    return markdown_table(head, rows)


if __name__ == "__main__":
    report(
        __doc__,
        {f"rate-{part.__name__}": part for part in (strip, plate, notch, formula, trousers)},
    )
