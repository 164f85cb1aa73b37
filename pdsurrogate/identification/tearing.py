"""Tearing energies of specimens, by the law of their material."""

from ..materials import Law, homogeneous
from ..materials.tearing import tearing_energy
from ..measurements.breaks import with_deviation
from ..measurements.specimens import TROUSER, MechanicalTests, Tear

MOST_OFF = 0.1
"""Greatest relative difference between the energy of a law at break and the work of the tests
without a remark. Chosen: 5 % in the stress, less than the scatter of most strengths.
"""


def energy_of(law: Law, tear: Tear) -> float:
    """Return the energy of a tear per undeformed area, in units of stress times mm: that of trouser
    legs, or the work per volume of a strip times its height (Rivlin and Thomas 1953).
    """
    if tear.mode == TROUSER:
        return tearing_energy(law, tear.nominal_stress * tear.length, tear.length, 1.0)
    return homogeneous.pure_shear(law, tear.stretch).energy_density * tear.length


def off_at_break(law: Law, tests: MechanicalTests | None) -> list[str]:
    """Return a remark if the energy of a law at the mean stretch at break in tension is not the
    work of the tests: a scene with this law and their strength tears at another load.
    """
    broken = tests.at_break.get("uniaxial") if tests else None
    if not broken:
        return []
    stretch, work = broken["stretch"][0], broken["work"][0]
    try:
        energy = homogeneous.uniaxial(law, stretch).energy_density
    except ValueError as error:
        return [f"no state at break: {error}"]
    if abs(energy - work) <= MOST_OFF * work:
        return []
    return [
        f"at the mean stretch at break, {stretch:.4g}, its energy per volume is {energy:.4g}, and"
        f" the work of the tests {work:.4g}: strengths that scenes take from these tests are off by"
        " as much; fit a law that follows the curves to the break"
    ]


def tearing_energies(law: Law, tests: MechanicalTests | None) -> tuple[dict[str, dict], list[str]]:
    """Return the tearing energy by mode of tear test, as number of specimens, mean and standard
    deviation (None for one), and remarks on those that the law cannot evaluate.
    """
    found: dict[str, list[float]] = {}
    remarks = []
    for tear in tests.tears if tests else ():
        try:
            energy = energy_of(law, tear)
            found.setdefault(tear.mode, []).append(energy)
        except ValueError as error:
            remarks.append(f"{tear.name}: no tearing energy: {error}")
    return {
        mode: {"specimens": len(energies), "energy": with_deviation(energies)}
        for mode, energies in found.items()
    }, remarks
