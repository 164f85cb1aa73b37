"""Cracks along an interface of two layers: energy release rate at the peak of the load, against
what the scene gives, and energy balance.

python pipelines/interface_cracks.py            measures all tears; --help names other uses

A strip of 4 x 1 of two layers, with a precut of 1.5 along their interface, is torn slowly in pure
shear, until past its peak. The bonds across the interface are weaker than the layers. Far ahead of
the crack both layers are in pure shear with the same traction, so that G is the energy W h of the
strip there, by the laws alone.
"""

import scipy
from cases import ending_at, listed, of_rows, report, rows_of, scene_of
from tip_diameters import PAST_PEAK, bonds_a_spacing

import pdsurrogate as pds
from pdsurrogate.materials import homogeneous
from pdsurrogate.scenes.tip_diameter import tip_diameters

ENERGY, CRITICAL = 0.35, 2.2
"""Fracture energy, over shear modulus and height, of the interface of equal layers, and critical
stretch of that of different ones.
"""

BULK = 20.0
"""Bulk modulus over shear modulus of every layer."""

EQUAL = listed("equal layers")
"""Force model, horizon in spacings, and rows of points, of the tears between equal layers."""

DIFFERENT = listed("different layers")
"""Ratio of the moduli of the layers, and rows of points, of the tears between different layers,
at a horizon of 2.2 spacings.
"""


def tear(force, ratio, rows, stiffer, interface, layers):
    """Return G at the peak and the energy error of a tear of the strip, whose upper layer is so
    many times stiffer; `layers` are stronger than the `interface`.
    """
    modulus = "materials.0.material."
    changes = {
        "spacing": 1.0 / rows,
        "horizon_ratio": ratio,
        modulus + "shear_modulus": stiffer,
        modulus + "bulk_modulus": BULK * stiffer,
        "fracture": layers | {"interfaces": [{"between": ["upper", "rest"]} | interface]},
    }
    with ending_at(PAST_PEAK * bonds_a_spacing({"ratio": ratio, "plane": "stress"})):
        summary = pds.simulate(scene_of("two-layers", changes), force, threads=1).summary
    found = energy_ahead(summary["crack"]["peak"]["stretch"], stiffer)
    return found, summary["quasi_static"]["greatest_energy_gap"]


def energy_ahead(stretch, stiffer):
    """Return W h of two layers of half the height each, which a stretch of the strip leaves in
    pure shear with the same traction.
    """
    soft, stiff = (
        pds.materials.NeoHookean(1.0, BULK),
        pds.materials.NeoHookean(stiffer, BULK * stiffer),
    )

    def of_both(of_soft):
        return homogeneous.pure_shear(soft, of_soft), homogeneous.pure_shear(
            stiff, 2 * stretch - of_soft
        )

    def excess(of_soft):
        one, other = of_both(of_soft)
        return one.nominal_stress - other.nominal_stress

    found = scipy.optimize.brentq(excess, 1.0, 2 * stretch - 1.0)
    return sum(layer.energy_density for layer in of_both(found)) / 2


def equal(force, ratio, rows):
    """Layers of one rubber: G at the peak against the energy of the interface."""
    found, gap = tear(force, ratio, rows, 1.0, {"energy": ENERGY}, {"energy": 3 * ENERGY})
    yield force, ratio, rows, found, found / ENERGY, gap


def different(stiffer, rows):
    """Layers of different moduli: G at the peak."""
    limits = {"critical_stretch": CRITICAL}, {"critical_stretch": 2 * CRITICAL}
    yield stiffer, rows, *tear("bond-energy", 2.2, rows, stiffer, *limits)


def beside(figures):
    """Tears with G over that of a crack in the softer rubber with the same critical stretch."""
    soft = pds.materials.NeoHookean(1.0, BULK)
    diameter = tip_diameters("stress", 2.2, "bond energy").at(CRITICAL)
    within = homogeneous.uniaxial(soft, CRITICAL).energy_density * diameter * 2.2
    for stiffer, rows, found, gap in rows_of(figures):
        yield stiffer, rows, found, found / within * rows, gap


if __name__ == "__main__":
    report(
        __doc__,
        of_rows("interface-equal", equal, EQUAL),
        of_rows("interface-different", different, DIFFERENT, rows=beside),
    )
