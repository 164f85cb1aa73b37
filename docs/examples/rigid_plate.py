"""A rigid part: a steel plate bonded to rubber is pulled sideways; forces and moments balance."""

import pdsurrogate as pds

scene = pds.Scene(
    name="mount",
    plane="strain",
    spacing=0.1,
    body=pds.shapes.Rectangle(size=(2.0, 1.2)),
    regions={"plate": {"box": ((0.0, 1.0), (2.0, 1.2))}},
    material=pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=50.0),
    materials=({"region": "plate", "material": "rigid"},),
    prescribed=(pds.Prescribed(region="bottom", x1=0.0, x2=0.0),),
    loads=(pds.Load(region="plate", force=(0.2, 0.0), name="pull"),),
    steps=(1.0,),
)
level = pds.simulate(scene).levels[-1]
plate = level["rigid"]["plate"]
print(f"moves by {plate['displacement'][0]:.4f}, turns by {plate['rotation']:.2f} degrees")

# Free body: what the rubber exerts on the plate balances the pull, whose moment about the origin is
# taken at the deformed places. The tolerance is that of the solver.
pull = level["moments"]["pull"]
print(f"moment of the rubber {plate['moment']:.5f}, of the pull {pull:.5f}")
assert abs(plate["moment"] + pull) < 1e-4 * abs(pull)
