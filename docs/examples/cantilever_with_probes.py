"""A slender cantilever with probes: the deflection of its tip against the theory of beams."""

import pdsurrogate as pds

length, height, traction = 2.0, 0.2, 1e-4
scene = pds.Scene(
    name="cantilever",
    spacing=0.02,
    body=pds.shapes.Rectangle(size=(length, height)),
    material=pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=100.0),
    prescribed=(pds.Prescribed(region="left", x1=0.0, x2=0.0),),
    loads=(pds.Load(region="right", traction=(0.0, traction)),),
    probes=(
        pds.Probe(name="tip", at=(length, height / 2)),
        pds.Probe(name="middle", at=(length / 2, height / 2)),
    ),
    steps=(1.0,),
)
probes = pds.simulate(scene, "bond-energy").levels[-1]["probes"]
tip = probes["tip"]["displacement"][1]

# Timoshenko: F L^3/(3 E I) + F L/(5/6 mu A) with E = 9 K mu/(3 K + mu), per unit of width.
E, load = 900 / 301, traction * height
exact = load * length**3 / (E * height**3 / 4) + load * length / (5 / 6 * height)
print(f"tip {tip:.5f}, beam {exact:.5f}; middle {probes['middle']['displacement'][1]:.5f}")
assert abs(tip / exact - 1) < 0.03  # ten points through the thickness
