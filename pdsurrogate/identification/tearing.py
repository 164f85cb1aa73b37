"""Tearing energies of specimens, by the law of their material."""

import numpy as np

from ..materials import Law, homogeneous
from ..materials.tearing import tearing_energy
from ..measurements.specimens import TROUSER, MechanicalTests, Tear


def energy_of(law: Law, tear: Tear) -> float:
    """Return the energy of a tear per undeformed area, in units of stress times mm: that of trouser
    legs, or the work per volume of a strip times its height (Rivlin and Thomas 1953).
    """
    if tear.mode == TROUSER:
        return tearing_energy(law, tear.nominal_stress * tear.length, tear.length, 1.0)
    return homogeneous.pure_shear(law, tear.stretch).energy_density * tear.length


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
        mode: {
            "specimens": len(energies),
            "energy": [
                float(np.mean(energies)),
                float(np.std(energies, ddof=1)) if len(energies) > 1 else None,
            ],
        }
        for mode, energies in found.items()
    }, remarks
