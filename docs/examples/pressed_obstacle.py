"""An obstacle without friction presses a block on rollers: the force against the law."""

import pdsurrogate as pds

scene = pds.Scene(
    name="pressed",
    spacing=0.05,
    horizon_ratio=1.75,
    body=pds.shapes.Rectangle(size=(2.0, 1.0)),
    material=pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=1e4),
    prescribed=(
        pds.Prescribed(region="bottom", x2=0.0),
        pds.Prescribed(region={"near": (1.0, 0.5)}, x1=0.0, name="middle"),
    ),
    obstacles=({"half_plane": {"point": (0, 1), "normal": (0, 1)}, "x2": -0.2, "name": "press"},),
    steps=(1.0,),
)
level = pds.simulate(scene, "bond-energy").levels[-1]
force = -level["forces"]["press"][1]

# Incompressible sheet, 2 wide: F = 2 mu (l^-2 - l) at l = 0.8
exact = 2 * (0.8**-2 - 0.8)
print(f"force {force:.4f}, exact {exact:.4f}, contact {level['contact']['press']['area']:.3f}")
assert abs(force / exact - 1) < 1e-3
