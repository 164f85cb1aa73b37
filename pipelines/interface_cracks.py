"""Cracks along an interface of two layers: energy release rate at the peak of the load, against
what the scene gives, and energy balance.

python pipelines/interface_cracks.py            the tables python pipelines/interface_cracks.py
--docs     and put them into docs/validation/interface-cracks.md

A strip of 4 x 1 of two layers, with a precut of 1.5 along their interface, is pulled in pure shear
at 0.02 times the speed of shear waves of the softer layer. The bonds across the interface are
weaker than the layers. Far ahead of the crack both layers are in pure shear with the same traction,
so that G is the energy W h of the strip there, by the laws alone.

On one core of 2 GHz all tears take some 10 minutes.
"""

import scipy
from pages import markdown_table, report

import pdsurrogate as pds
from pdsurrogate.materials import homogeneous
from pdsurrogate.scenes.tip_diameter import tip_diameters

ENERGY, CRITICAL = 0.35, 2.2
"""Fracture energy, over shear modulus and height, of the interface of equal layers, and critical
stretch of that of different ones.
"""

BULK = 20.0
"""Bulk modulus over shear modulus of every layer."""

EQUAL = [
    ("bond-energy", 2.2, 16),
    ("bond-energy", 2.2, 20),
    ("bond-energy", 3.15, 16),
    ("bond-energy", 3.15, 20),
    ("neo-hookean", 3.15, 20),
]
"""Force model, horizon in spacings, and rows of points, of the tears between equal layers."""

DIFFERENT = [(1.0, 16), (1.0, 20), (3.0, 16), (3.0, 20), (10.0, 16)]
"""Ratio of the moduli of the layers, and rows of points, of the tears between different layers,
at a horizon of 2.2 spacings.
"""


def tear(
    force: str, ratio: float, rows: int, stiffer: float, interface: dict, layers: dict
) -> dict:
    """Return the summary of a tear of the strip, whose upper layer is so many times stiffer;
    `layers` are stronger than the `interface`.
    """
    laws = [
        {"law": "neo-hookean", "shear_modulus": modulus, "bulk_modulus": BULK * modulus}
        for modulus in (1.0, stiffer)
    ]
    scene = {
        "name": "strip",
        "spacing": 1.0 / rows,
        "horizon_ratio": ratio,
        "stretches": [1.05],
        "body": {"shape": "rectangle", "size": [4.0, 1.0]},
        "precuts": [{"start": [-1.0, 0.5], "end": [1.5, 0.5]}],
        "regions": {"upper": {"box": [[-1.0, 0.5], [5.0, 2.0]]}},
        "material": laws[0],
        "materials": [{"region": "upper", "material": laws[1]}],
        "grips": [{"edge": "bottom"}, {"edge": "top", "travel": 1.0}],
        "fracture": layers | {"interfaces": [{"between": ["upper", "rest"]} | interface]},
        "dynamics": {
            "stretch": 2.0,
            "stretch_rate": 0.02,
            "density": 1.0,
            "damping": 0.02,
            "outputs": 10,
        },
    }
    return pds.simulate(pds.Scene.model_validate(scene), force).summary


def energy_ahead(stretch: float, stiffer: float) -> float:
    """Return W h of two layers of half the height each, which a stretch of the strip leaves in
    pure shear with the same traction.
    """
    soft, stiff = (
        pds.materials.NeoHookean(1.0, BULK),
        pds.materials.NeoHookean(stiffer, BULK * stiffer),
    )

    def of_both(of_soft: float):
        return homogeneous.pure_shear(soft, of_soft), homogeneous.pure_shear(
            stiff, 2 * stretch - of_soft
        )

    def excess(of_soft: float) -> float:
        one, other = of_both(of_soft)
        return one.nominal_stress - other.nominal_stress

    found = scipy.optimize.brentq(excess, 1.0, 2 * stretch - 1.0)
    return sum(layer.energy_density for layer in of_both(found)) / 2


def balance(summary: dict) -> str:
    """Return the greatest error of the energy balance in percent; a dash for a force without
    energy.
    """
    gap = summary["dynamics"][-1]["greatest_energy_gap"]
    return "-" if gap is None else f"{gap:+.2f}"


def equal() -> str:
    """Layers of one rubber: G at the peak against the energy of the interface."""
    rows = []
    for force, ratio, points in EQUAL:
        summary = tear(force, ratio, points, 1.0, {"energy": ENERGY}, {"energy": 3 * ENERGY})
        found = energy_ahead(summary["crack"]["peak"]["stretch"], 1.0)
        rows.append(
            [
                force,
                f"{ratio:g}",
                f"{points}",
                f"{found:.3f}",
                f"{found / ENERGY:.2f}",
                balance(summary),
            ]
        )
        print(rows[-1], flush=True)
    return markdown_table(
        [
            "force",
            "horizon (spacings)",
            "rows",
            "G at the peak (μ h)",
            "G / prescribed",
            "energy error (%)",
        ],
        rows,
    )


def different() -> str:
    """Layers of different moduli: G at the peak against that of a crack in the softer rubber
    with the same critical stretch.
    """
    rows, soft, diameter = (
        [],
        pds.materials.NeoHookean(1.0, BULK),
        tip_diameters("stress", 2.2, "bond energy").at(CRITICAL),
    )
    for stiffer, points in DIFFERENT:
        summary = tear(
            "bond-energy",
            2.2,
            points,
            stiffer,
            {"critical_stretch": CRITICAL},
            {"critical_stretch": 2 * CRITICAL},
        )
        found = energy_ahead(summary["crack"]["peak"]["stretch"], stiffer)
        within = homogeneous.uniaxial(soft, CRITICAL).energy_density * diameter * 2.2 / points
        rows.append(
            [f"{stiffer:g}", f"{points}", f"{found:.3f}", f"{found / within:.2f}", balance(summary)]
        )
        print(rows[-1], flush=True)
    return markdown_table(
        ["upper layer (μ)", "rows", "G at the peak (μ h)", "G / within", "energy error (%)"], rows
    )


if __name__ == "__main__":
    report(__doc__, {f"interface-{part.__name__}": part for part in (equal, different)})
