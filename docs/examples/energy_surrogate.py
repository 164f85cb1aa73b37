"""A learned isochoric energy: one surrogate for solids and plane strain of every bulk modulus."""

import pdsurrogate as pds

law = pds.materials.Yeoh(shear_modulus=1.0, bulk_modulus=1e3, second=0.02, third=1e-4)
samples = pds.training_samples(law, 2000, random_state=0, target="isochoric-energy")
model = pds.surrogate_pipeline(target="isochoric-energy").fit(samples.X, samples.y)
scene = pds.Scene(
    name="strip",
    plane="strain",
    spacing=0.1,
    body=pds.shapes.Rectangle(size=(1.0, 1.0)),
    material=law,
    prescribed=(
        pds.Prescribed(region="left", x1=0.0),
        pds.Prescribed(region="bottom", x2=0.0),
        pds.Prescribed(region="right", x1=0.5),
    ),
    steps=(0.5, 1.0),
)
force = pds.simulate(scene, model).levels[-1]["forces"]["right"][0]

# Incompressible plane strain: P = mu (1 + 2 a x + 3 b x^2) (l - l^-3), x = l^2 + l^-2 - 2.
x = 1.5**2 + 1.5**-2 - 2
exact = (1 + 2 * 0.02 * x + 3 * 1e-4 * x**2) * (1.5 - 1.5**-3)
print(f"force {force:.5f}, exact {exact:.5f}")
assert abs(force / exact - 1) < 1e-3  # mu/K
