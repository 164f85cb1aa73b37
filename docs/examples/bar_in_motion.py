"""A scene in time: a bar under a sudden load, and where the work of the load goes."""

import pdsurrogate as pds

bar = pds.Scene(
    name="bar",
    spacing=0.1,
    body=pds.shapes.Rectangle(size=(2.0, 0.5)),
    material=pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=100.0),
    prescribed=(pds.Prescribed(region="left", x1=0.0, x2=0.0),),
    loads=(pds.Load(region="right", traction=(0.1, 0.0), amplitude="1"),),  # from t = 0 on
    steps=({"to": 1.0, "outputs": 40, "dynamics": {"duration": 10.0, "density": 1.0}},),
)
result = pds.simulate(bar, "bond-energy")
for row in result.history[::10]:
    print(f"time {row['time']:5.2f}: work {row['work']:.5f}, stored {row['strain_energy']:.5f}")

# Nothing damps, so that all of the work is stored or moves. The explicit scheme, of second order in
# the time step, may lose a thousandth of the greatest work.
first, last = result.history[0], result.history[-1]
found = sum(last[part] - first[part] for part in ("strain_energy", "kinetic_energy"))
assert abs(found - last["work"]) < 1e-3 * max(row["work"] for row in result.history)
