"""A sheet with a cut tears at a critical stretch of its bonds; the energy account closes."""

import pdsurrogate as pds

changes = {
    "spacing": 0.25,
    "stretches": [1.1, 1.2],
    "fracture.critical_stretch": 2.0,
    "dynamics.stretch": 1.7,
    "dynamics.stretch_rate": 40.0,
    "dynamics.viscosity": 5e-5,  # 0.55 spacings divided by the speed of shear waves
    "dynamics.outputs": 10,
}
result = pds.simulate(pds.load_scene("tear", changes), "bond-energy")
crack = result.summary["crack"]
print(f"{crack['broken_bonds']} broken bonds, through: {crack['through']}")

# The work of the grips is stored, moves, is damped or is released by the broken bonds.
rows = [row for row in result.history if "time" in row]
parts = ("strain_energy", "kinetic_energy", "damped_energy", "released_energy")
found = sum(rows[-1][part] - rows[0][part] for part in parts)
print(f"work of the grips {rows[-1]['work']:.0f}, found {found:.0f} kPa cm2")
assert abs(found / rows[-1]["work"] - 1) < 5e-3  # the gap at which a run warns
