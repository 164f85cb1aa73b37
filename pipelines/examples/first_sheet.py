"""A sheet with a hole under tension: a scene in Python, its picture before the run, fields and a loading curve after it.

A notebook as a script: cells begin with ``# %%``, which Jupytext and editors open as a notebook.
"""

# %%
import numpy as np

import pdsurrogate as pds

scene = pds.Scene(
    name="strip-with-hole",
    spacing=0.1,
    body=pds.shapes.Rectangle(size=(3.0, 1.0)),
    holes=(pds.shapes.Circle(center=(1.5, 0.5), radius=0.25),),
    material={"law": "neo-hookean", "shear_modulus": 100.0, "bulk_modulus": 10_000.0},
    prescribed=(pds.Prescribed(region="left", x1=0.0, x2=0.0), pds.Prescribed(region="right", x1=1.5, x2=0.0)),
    steps=(pds.Step(to=1.0, outputs=3),),
)
pds.preview(scene).savefig("scene.png")

# %% The surrogate of this law by default; the exact force beside it.
learned, exact = pds.simulate(scene), pds.simulate(scene, "analytic")
for row, other in zip(learned.history, exact.history, strict=True):
    print(f"t = {row['t']:.3f}: force {row['force_right_1']:.4f}, exact {other['force_right_1']:.4f} {learned.summary['units']['force']}")

# %% Where the stress is greatest, and by how much it exceeds the mean.
stress = learned.field("cauchy_stress_11")
print("greatest at", learned.field("position")[np.argmax(stress)][:2], "by a factor of", stress.max() / stress.mean())
learned.plot("cauchy_stress_11").savefig("stress.png")
learned.loading_figure().savefig("loading.png")

# %%
difference = np.abs(learned.displacement() - exact.displacement()).max()
