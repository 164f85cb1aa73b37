"""Two materials side by side share a stretch: the force is the sum of both."""

import pdsurrogate as pds

scene = pds.Scene(
    name="layers",
    spacing=0.1,
    body=pds.shapes.Rectangle(size=(2.0, 1.0)),
    material=pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=1e4),
    materials=(
        {
            "region": {"half_plane": {"point": (0.0, 0.5), "normal": (0.0, 1.0)}},
            "material": pds.materials.NeoHookean(shear_modulus=5.0, bulk_modulus=5e4),
        },
    ),
    prescribed=(
        pds.Prescribed(region="left", x1=0.0),
        pds.Prescribed(region="bottom", x2=0.0),
        pds.Prescribed(region="right", x1=1.0),
    ),
    steps=(1.0,),
)
force = pds.simulate(scene).levels[-1]["forces"]["right"][0]

# Both layers become thinner alike, and each is in uniaxial tension: F = (mu1 + mu2)/2 (l - l^-2).
exact = (1.0 + 5.0) / 2 * (1.5 - 1.5**-2)
print(f"force {force:.5f}, exact {exact:.5f}")
assert abs(force / exact - 1) < 1e-3  # mu/K, and points beside two laws
